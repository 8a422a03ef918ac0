//! Bytes and rates of page codecs: `cargo bench -p hlod-compress -- FILE.hlod …`
//!
//! One thread. Without files a synthetic relief is coded, which shows that things work and not
//! what scans cost. The baselines are meshoptimizer's vertex and index codecs (Kapoulkine
//! 2016–2026), alone and through zstd.

use std::path::Path;
use std::time::Instant;

use hlod_compress::{
    HlodFile, Mesh, OctNormal, PageContent, RepresentationKind, decode_page,
    encode_mesh_with_account, encode_page,
};

type Error = Box<dyn std::error::Error>;

fn main() -> Result<(), Error> {
    // Cargo passes `--bench`.
    let files: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    println!("one thread of {}", std::env::consts::ARCH);
    if files.is_empty() {
        return measure("a synthetic relief", &[(relief(300), 0)]);
    }
    for file in &files {
        for (kind, name) in [
            (RepresentationKind::Source, "leaves"),
            (RepresentationKind::Appearance, "appearance above"),
            (RepresentationKind::Geometric, "geometric above"),
        ] {
            let pages = pages(Path::new(file), kind)?;
            if pages.iter().any(|(mesh, _)| !mesh.triangles.is_empty()) {
                measure(&format!("{file}, {name}"), &pages)?;
            }
            let points = point_pages(Path::new(&file), kind)?;
            if !points.is_empty() {
                measure_points(&format!("{file}, {name}"), &points)?;
            }
        }
    }
    Ok(())
}

/// Meshes of one kind of page and their grids.
fn pages(path: &Path, kind: RepresentationKind) -> Result<Vec<(Mesh, u8)>, Error> {
    let file = HlodFile::open(path)?;
    let mut out = Vec::new();
    for node in file.read_skeleton()? {
        for r in node.representations.iter().filter(|r| r.kind == kind) {
            let mesh = decode_page(&file.read_page(r.page)?)?.mesh;
            let lowest = mesh.bounds().unwrap_or_default().0;
            let offsets = mesh.positions.iter().flat_map(|p| [0, 1, 2].map(|i| p[i] - lowest[i]));
            let shift = offsets.fold(0, |all, offset| all | offset).trailing_zeros().min(30);
            out.push((mesh, shift as u8));
        }
    }
    Ok(out)
}

/// Pages of points, and the grids that their positions lie on.
fn point_pages(path: &Path, kind: RepresentationKind) -> Result<Vec<(PageContent, u8)>, Error> {
    let file = HlodFile::open(path)?;
    let mut out = Vec::new();
    for node in file.read_skeleton()? {
        for r in node.representations.iter().filter(|r| r.kind == kind && r.points > 0) {
            let points = decode_page(&file.read_page(r.page)?)?.points;
            let lowest = points.bounds().unwrap_or_default().0;
            let offsets = points.positions.iter().flat_map(|p| [0, 1, 2].map(|i| p[i] - lowest[i]));
            let shift = offsets.fold(0, |all, offset| all | offset).trailing_zeros().min(30);
            out.push((PageContent { points, ..PageContent::default() }, shift as u8));
        }
    }
    Ok(out)
}

fn measure_points(what: &str, pages: &[(PageContent, u8)]) -> Result<(), Error> {
    let points: usize = pages.iter().map(|(content, _)| content.points.len()).sum();
    let begin = Instant::now();
    let coded: Vec<Vec<u8>> = pages
        .iter()
        .map(|(content, shift)| encode_page(content, 0, *shift))
        .collect::<Result<_, _>>()?;
    let encoded = points as f64 / begin.elapsed().as_secs_f64() / 1e6;
    let mut rates = Vec::new();
    for _ in 0..5 {
        let begin = Instant::now();
        let back: usize = coded
            .iter()
            .map(|page| decode_page(page).map(|c| c.points.len()))
            .sum::<Result<_, _>>()?;
        assert_eq!(back, points);
        rates.push(points as f64 / begin.elapsed().as_secs_f64() / 1e6);
    }
    rates.sort_by(f64::total_cmp);
    let bytes: usize = coded.iter().map(Vec::len).sum();
    println!(
        "\n{what}: {} pages, {points} points: {:.3} B a point, encoded {encoded:.2} M/s, decoded {:.2} M/s",
        pages.len(),
        bytes as f64 / points as f64,
        rates[2]
    );
    Ok(())
}

/// A codec as this table needs it: to bytes and back.
type Codec<'a> = (&'a str, &'a dyn Fn(&Mesh, u8) -> Result<Vec<u8>, Error>, Decode<'a>);
type Decode<'a> = &'a dyn Fn(&[u8], &Mesh) -> Result<usize, Error>;

fn measure(what: &str, pages: &[(Mesh, u8)]) -> Result<(), Error> {
    let triangles: usize = pages.iter().map(|(m, _)| m.triangles.len()).sum();
    let vertices: usize = pages.iter().map(|(m, _)| m.positions.len()).sum();
    println!("\n{what}: {} pages, {triangles} triangles, {vertices} vertices", pages.len());
    println!(" {:<16} {:>12} {:>14} {:>14}", "codec", "B/triangle", "encode, M/s", "decode, M/s");
    let ours = |mesh: &Mesh, shift| Ok(encode_mesh_with_account(mesh, shift)?.0);
    let ours_back = |bytes: &[u8], _: &Mesh| Ok(decode_page(bytes)?.mesh.triangles.len());
    let zstd = |mesh: &Mesh, _| Ok(zstd::bulk::compress(&meshopt_streams(mesh)?, 9)?);
    let zstd_back = |bytes: &[u8], mesh: &Mesh| {
        let limit = 64 * (mesh.positions.len() + mesh.triangles.len()) + 4096;
        let streams = zstd::bulk::decompress(bytes, limit)?;
        meshopt_back(&streams, mesh)
    };
    let flat = |mesh: &Mesh, _| meshopt_streams(mesh);
    let codecs: [Codec<'_>; 3] = [
        ("ours", &ours, &ours_back),
        ("meshopt + zstd", &zstd, &zstd_back),
        ("meshopt", &flat, &meshopt_back),
    ];
    for (name, encode, decode) in codecs {
        let begin = Instant::now();
        let coded: Vec<Vec<u8>> =
            pages.iter().map(|(mesh, shift)| encode(mesh, *shift)).collect::<Result<_, _>>()?;
        let encoded = triangles as f64 / begin.elapsed().as_secs_f64() / 1e6;
        // The median of five passes.
        let mut rates = Vec::new();
        for _ in 0..5 {
            let begin = Instant::now();
            let mut back = 0;
            for (bytes, (mesh, _)) in coded.iter().zip(pages) {
                back += decode(bytes, mesh)?;
            }
            assert_eq!(back, triangles);
            rates.push(triangles as f64 / begin.elapsed().as_secs_f64() / 1e6);
        }
        rates.sort_by(f64::total_cmp);
        let bytes: usize = coded.iter().map(Vec::len).sum();
        let each = bytes as f64 / triangles as f64;
        println!(" {name:<16} {each:>12.3} {encoded:>14.2} {:>14.2}", rates[2]);
    }
    let (mut shape, mut normals) = (0.0, 0.0);
    for (mesh, shift) in pages {
        let account = encode_mesh_with_account(mesh, *shift)?.1;
        shape += account.shape;
        normals += account.normals;
    }
    let bits = |bytes: f64| 8.0 * bytes / vertices as f64;
    println!(
        " ours, bits a vertex: shape {:.2}, normals {:.2}; vertices a triangle {:.3}",
        bits(shape),
        bits(normals),
        vertices as f64 / triangles as f64
    );
    Ok(())
}

/// Positions, normals and triangles, in the order in which triangles first use them, each behind its
/// length.
fn meshopt_streams(mesh: &Mesh) -> Result<Vec<u8>, Error> {
    let lowest = mesh.bounds().unwrap_or_default().0;
    let place = |p: &[i32; 3]| [0, 1, 2].map(|i| p[i].abs_diff(lowest[i]));
    let indices = mesh.triangles.as_flattened();
    let indices = meshopt::optimize_vertex_cache(indices, mesh.positions.len());
    let remap = meshopt::optimize_vertex_fetch_remap(&indices, mesh.positions.len());
    let indices = meshopt::remap_index_buffer(Some(&indices), indices.len(), &remap);
    let positions: Vec<[u32; 3]> = mesh.positions.iter().map(place).collect();
    let count = mesh.positions.len();
    let positions = meshopt::remap_vertex_buffer(&positions, count, &remap);
    let normals = meshopt::remap_vertex_buffer(&mesh.normals, count, &remap);
    let mut out = Vec::new();
    for stream in [
        meshopt::encode_vertex_buffer(&positions)?,
        meshopt::encode_vertex_buffer(&normals)?,
        meshopt::encode_index_buffer(&indices, count)?,
    ] {
        out.extend((stream.len() as u32).to_le_bytes());
        out.extend(stream);
    }
    Ok(out)
}

fn meshopt_back(streams: &[u8], mesh: &Mesh) -> Result<usize, Error> {
    let mut rest = streams;
    let mut next = || {
        let (length, tail) = rest.split_first_chunk().ok_or("cut off")?;
        let (stream, tail) = tail.split_at(u32::from_le_bytes(*length) as usize);
        rest = tail;
        Ok::<_, Error>(stream)
    };
    let count = mesh.positions.len();
    let positions: Vec<[u32; 3]> = meshopt::decode_vertex_buffer(next()?, count)?;
    let normals: Vec<OctNormal> = meshopt::decode_vertex_buffer(next()?, count)?;
    let indices: Vec<u32> = meshopt::decode_index_buffer(next()?, 3 * mesh.triangles.len())?;
    assert_eq!((positions.len(), normals.len()), (count, count));
    Ok(indices.len() / 3)
}

/// A wavy relief with hills of several sizes.
fn relief(n: i32) -> Mesh {
    let mut mesh = Mesh::default();
    for y in 0..n {
        for x in 0..n {
            let (u, v) = (f64::from(x) * 0.13, f64::from(y) * 0.11);
            let height = 60.0 * u.sin() * v.cos() + 9.0 * (7.0 * u + 3.0 * v).sin();
            mesh.positions.push([16 * x, 16 * y, height.round() as i32]);
            let slope = [
                -7.8 * u.cos() * v.cos() - 8.2 * (7.0 * u + 3.0 * v).cos(),
                6.6 * u.sin() * v.sin() - 3.0 * (7.0 * u + 3.0 * v).cos(),
                16.0,
            ];
            mesh.normals.push(OctNormal::encode(slope.map(|c| c as f32)));
        }
    }
    for y in 0..n - 1 {
        for x in 0..n - 1 {
            let v = (y * n + x) as u32;
            let n = n as u32;
            mesh.triangles.extend([[v, v + 1, v + n], [v + 1, v + n + 1, v + n]]);
        }
    }
    mesh
}
