//! Bytes and rates of page codecs: `cargo bench -p hlod-compress -- FILE.hlod …`
//!
//! One thread. Without files a synthetic relief is coded, which shows that things work and not
//! what scans cost. The baselines are meshoptimizer's vertex and index codecs (Kapoulkine
//! 2016–2026), alone and through zstd.

use std::path::Path;
use std::time::Instant;

use hlod_compress::{
    HlodFile, Mesh, OctNormal, PageContent, PointRadius, Points, RepresentationKind, Scalars,
    decode_page, encode_mesh_with_account, encode_page,
};

type Error = Box<dyn std::error::Error>;

fn main() -> Result<(), Error> {
    // Cargo passes `--bench`.
    let files: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    println!("one thread of {}", std::env::consts::ARCH);
    if files.is_empty() {
        measure("a synthetic relief", &[(relief(300), 0)])?;
        return measure_largest();
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

/// How long the largest pages hold up who decodes them: of as many primitives as there may be in one, all of
/// whose attributes are noise, of so few bits that it fits the most bytes.
fn measure_largest() -> Result<(), Error> {
    println!("\nthe largest pages, of noise");
    let most = 1 << 19;
    let mut noise = Noise(1);
    let mut sheet = relief(724);
    (sheet.normals, sheet.colours, sheet.scalars) = noise.attributes(sheet.positions.len(), 8);
    let (normals, colours, scalars) = noise.attributes(most, 4);
    let positions = noise.positions(most);
    let triangles = (0..2 * most).map(|i| noise.triangle((i / 2) as u32, most as u32)).collect();
    let soup = Mesh { positions, normals, colours, scalars, triangles };
    let (normals, colours, scalars) = noise.attributes(most, 2);
    let radii = (0..most).map(|_| PointRadius(noise.bits(2) as u8)).collect();
    let positions = noise.positions(most);
    let points = Points { positions, normals, colours, scalars, radii, prefixes: Vec::new() };
    for (name, mesh, points) in [
        ("a sheet", &sheet, None),
        ("a soup", &soup, None),
        ("points", &Mesh::default(), Some(&points)),
        ("a soup and points", &soup, Some(&points)),
    ] {
        let content =
            PageContent { mesh: mesh.clone(), points: points.cloned().unwrap_or_default() };
        let page = encode_page(&content, 0, 0)?;
        let mut seconds = Vec::new();
        for _ in 0..5 {
            let begin = Instant::now();
            let back = decode_page(&page)?;
            seconds.push(begin.elapsed().as_secs_f64());
            assert_eq!(back.mesh.triangles.len(), mesh.triangles.len());
            assert_eq!(back.points.len(), content.points.len());
        }
        seconds.sort_by(f64::total_cmp);
        println!(
            " {name:<18} {:>8} triangles {:>8} vertices {:>8} points: {:>5.1} MB in {:.2} s",
            mesh.triangles.len(),
            mesh.positions.len(),
            content.points.len(),
            page.len() as f64 / 1e6,
            seconds[2]
        );
    }
    Ok(())
}

/// Knuth's 64-bit congruential generator.
struct Noise(u64);

impl Noise {
    fn bits(&mut self, count: u32) -> u32 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> (64 - count)) as u32
    }

    fn attributes(
        &mut self,
        count: usize,
        bits: u32,
    ) -> (Vec<OctNormal>, Vec<[u8; 4]>, Vec<Scalars>) {
        let normals = (0..count)
            .map(|_| OctNormal::encode([0; 3].map(|_| self.bits(bits) as f32 - 1.5)))
            .collect();
        let colours = (0..count).map(|_| [0; 4].map(|_| self.bits(bits) as u8)).collect();
        let scalars =
            (0..count).map(|_| Scalars([0; 4].map(|_| 1 + self.bits(bits) as u16))).collect();
        (normals, colours, scalars)
    }

    fn positions(&mut self, count: usize) -> Vec<[i32; 3]> {
        (0..count).map(|_| [0; 3].map(|_| self.bits(10) as i32)).collect()
    }

    /// One with `corner` and two others.
    fn triangle(&mut self, corner: u32, vertices: u32) -> [u32; 3] {
        loop {
            let [a, b] = [self.bits(31) % vertices, self.bits(31) % vertices];
            if a != corner && b != corner && a != b {
                return [corner, a, b];
            }
        }
    }
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
