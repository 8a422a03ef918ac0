use super::*;
use crate::{PointPrefix, PointRadius, Scalars};
use proptest::prelude::*;

type Corner = ([i32; 3], OctNormal, [u8; 4], Scalars);

/// Geometry as a sorted list of triangles with their corners' values, rotated to a canonical
/// first corner: what must survive coding whatever the order.
fn canonical(mesh: &Mesh) -> Vec<[Corner; 3]> {
    let corner = |v: u32| {
        let v = v as usize;
        let colour = mesh.colours.get(v).copied().unwrap_or_default();
        let scalars = mesh.scalars.get(v).copied().unwrap_or_default();
        (mesh.positions[v], mesh.normals[v], colour, scalars)
    };
    let mut out: Vec<_> = mesh
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(corner);
            // Corners can be equal: the least of all three beginnings.
            [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap()
        })
        .collect();
    out.sort();
    out
}

fn grid_mesh(n: i32, shift: u8, colours: bool) -> Mesh {
    let mut mesh = Mesh::default();
    for y in 0..n {
        for x in 0..n {
            mesh.positions.push([x << shift, y << shift, ((x * y) % 7) << shift]);
            mesh.normals.push(OctNormal::encode([x as f32, y as f32, 1.0]));
            if colours {
                mesh.colours.push([x as u8, y as u8, 7, 255]);
                let code = 1 + (500 * x + 31 * y) as u16;
                mesh.scalars.push(Scalars([code, 0, 1 + (x * y % 50) as u16, u16::from(x > 3)]));
            }
        }
    }
    for y in 0..n - 1 {
        for x in 0..n - 1 {
            let v = (y * n + x) as u32;
            let n = n as u32;
            mesh.triangles.push([v, v + 1, v + n]);
            mesh.triangles.push([v + 1, v + n + 1, v + n]);
        }
    }
    mesh
}

#[test]
fn meshes_survive_coding() {
    for (n, shift, colours) in [(2, 0, false), (40, 3, true), (9, 20, false)] {
        let mesh = grid_mesh(n, shift, colours);
        assert_survives(&mesh, shift);
    }
    assert_survives(&Mesh::default(), 0);
}

/// Once found by random changes: encoding took the square of their number, here a minute.
#[test]
fn many_vertices_of_no_triangle_survive_coding() {
    let mut mesh = grid_mesh(3, 0, false);
    mesh.positions.resize(300_000, [1, 2, 0]);
    mesh.normals.resize(300_000, OctNormal::encode([0.0, 0.0, 1.0]));
    assert_survives(&mesh, 0);
}

/// Vertices' values, sorted: those that no triangle uses must survive as well.
fn vertices(mesh: &Mesh) -> Vec<Corner> {
    let colour = |v: usize| mesh.colours.get(v).copied().unwrap_or_default();
    let scalars = |v: usize| mesh.scalars.get(v).copied().unwrap_or_default();
    let mut out: Vec<Corner> = (0..mesh.positions.len())
        .map(|v| (mesh.positions[v], mesh.normals[v], colour(v), scalars(v)))
        .collect();
    out.sort();
    out
}

fn assert_survives(mesh: &Mesh, shift: u8) {
    let page = encode_mesh(mesh, shift).unwrap();
    let decoded = decode_mesh(&page).unwrap();
    assert_eq!(canonical(mesh), canonical(&decoded));
    assert_eq!(vertices(mesh), vertices(&decoded));
    let counts = (mesh.positions.len() as u32, mesh.triangles.len() as u32);
    assert_eq!(mesh_counts(&page).unwrap(), counts);
}

#[test]
fn the_comparison_sees_every_difference() {
    let mesh = grid_mesh(4, 0, true);
    type Change = fn(&mut Mesh);
    let changes: [Change; 6] = [
        |m| m.positions[5][1] += 1,
        |m| m.scalars[5].0[2] += 1,
        |m| m.normals[5] = OctNormal::encode([0.0, 1.0, 0.0]),
        |m| m.colours[5][2] ^= 1,
        |m| m.triangles[3].swap(0, 1),
        |m| m.triangles.truncate(17),
    ];
    for change in changes {
        let mut other = mesh.clone();
        change(&mut other);
        assert_ne!(canonical(&mesh), canonical(&other));
    }
}

/// A torus of squares, its normals those of the true surface.
fn torus(n: i32) -> Mesh {
    let mut mesh = Mesh::default();
    let angle = |i: i32| std::f64::consts::TAU * f64::from(i) / f64::from(n);
    for i in 0..n {
        for j in 0..n {
            let ((s, c), (t, d)) = (angle(i).sin_cos(), angle(j).sin_cos());
            let normal = [c * d, s * d, t];
            let ring = [3.0 * c, 3.0 * s, 0.0];
            let place = |k: usize| (4000.0 * (ring[k] + normal[k])).round() as i32;
            mesh.positions.push([place(0), place(1), place(2)]);
            mesh.normals.push(OctNormal::encode(normal.map(|x| x as f32)));
            let v = |i: i32, j: i32| ((i % n) * n + j % n) as u32;
            mesh.triangles.push([v(i, j), v(i + 1, j), v(i + 1, j + 1)]);
            mesh.triangles.push([v(i, j), v(i + 1, j + 1), v(i, j + 1)]);
        }
    }
    mesh
}

/// What a regular surface costs is known: hardly anything for its triangles, and little for positions
/// and normals that are where they are expected.
#[test]
fn regular_surfaces_cost_little() {
    let mesh = torus(64);
    assert_survives(&mesh, 0);
    let (page, account) = encode_mesh_with_account(&mesh, 0).unwrap();
    let bits = 8.0 * page.len() as f64 / mesh.triangles.len() as f64;
    assert!(bits < 13.0, "{bits} bits a triangle");
    let parts = account.shape + account.normals;
    assert!((parts - page.len() as f64).abs() < 64.0, "{parts} of {} bytes", page.len());
    let normals = 8.0 * account.normals / mesh.positions.len() as f64;
    assert!(normals < 4.0, "{normals} bits a normal");
}

/// Surfaces joined and torn in every way: several sheets along an edge, sheets that meet in a vertex,
/// inside out beside each other, triangles twice, without area, and vertices left over.
#[test]
fn odd_meshes_survive_coding() {
    let with = |triangles: &[[u32; 3]]| Mesh {
        positions: (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(|c| 10 * c)).collect(),
        normals: vec![OctNormal::encode([1.0, 2.0, -3.0]); 8],
        colours: Vec::new(),
        scalars: Vec::new(),
        triangles: triangles.to_vec(),
    };
    for triangles in [
        &[][..],
        &[[0, 0, 0]],
        &[[0, 1, 1], [1, 1, 2]],
        &[[0, 1, 2], [0, 1, 2]],
        &[[0, 1, 2], [0, 2, 1]],
        &[[0, 1, 2], [0, 1, 3], [0, 1, 4], [1, 0, 5], [1, 0, 6]],
        &[[0, 1, 2], [0, 3, 4], [0, 5, 6]],
        &[[0, 1, 2], [1, 0, 3], [2, 1, 3], [0, 2, 3], [4, 5, 6]],
        &[[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5], [4, 5, 0], [0, 5, 1]],
    ] {
        assert_survives(&with(triangles), 0);
    }
}

#[test]
fn far_apart_is_an_error_or_survives() {
    let mut mesh = grid_mesh(3, 0, false);
    mesh.positions[4] = [i32::MAX, 0, 0];
    assert_survives(&mesh, 0);
    mesh.positions[0] = [-1, 0, 0];
    assert!(matches!(encode_mesh(&mesh, 0), Err(FormatError::TooLarge { .. })));
}

#[test]
fn more_bytes_than_a_page_may_have_are_not_looked_at() {
    let page = vec![TAG_TRIANGLES; PAGE_BYTES_MAX as usize + 1];
    for error in [decode_page(&page).unwrap_err(), encoded_counts(&page).unwrap_err()] {
        assert!(matches!(error, FormatError::TooLarge { unit: "bytes", .. }), "{error}");
    }
    assert!(matches!(decode_page(&page[1..]), Err(FormatError::Malformed { .. })));
}

fn vertices_as_points(mesh: &Mesh) -> Points {
    let count = mesh.positions.len();
    let radii = |from: u8| (0..count).map(|i| PointRadius(from + (i % 5) as u8)).collect();
    Points {
        positions: mesh.positions.clone(),
        normals: mesh.normals.clone(),
        colours: mesh.colours.clone(),
        scalars: mesh.scalars.clone(),
        radii: radii(30),
        prefixes: vec![PointPrefix { radii: vec![PointRadius(50); count / 3] }],
    }
}

#[test]
fn pages_of_both_kinds_survive_and_say_what_they_hold() {
    let mesh = grid_mesh(7, 3, true);
    let points = vertices_as_points(&grid_mesh(9, 1, true));
    let counts = |content: &PageContent| {
        let page = encode_page(content, 3, 1).unwrap();
        let back = decode_page(&page).unwrap();
        assert_eq!(canonical(&back.mesh), canonical(&content.mesh));
        assert_eq!(back.points.len(), content.points.len());
        assert_eq!(back.points.prefixes.len(), content.points.prefixes.len());
        for length in 0..page.len() {
            assert!(decode_page(&page[..length]).is_err(), "cut to {length} of {}", page.len());
        }
        let counts = encoded_counts(&page).unwrap();
        (counts.vertices, counts.triangles, counts.points)
    };
    let nothing = PageContent::default();
    assert_eq!(counts(&nothing), (0, 0, 0));
    assert_eq!(counts(&PageContent { points: points.clone(), ..nothing.clone() }), (0, 0, 81));
    assert_eq!(counts(&PageContent { mesh: mesh.clone(), ..nothing }), (49, 72, 0));
    assert_eq!(counts(&PageContent { mesh, points }), (49, 72, 81));
}

#[test]
fn every_truncation_is_an_error() {
    let page = encode_mesh(&grid_mesh(6, 1, true), 1).unwrap();
    for length in 0..page.len() {
        assert!(decode_mesh(&page[..length]).is_err(), "cut to {length} of {} bytes", page.len());
    }
}

/// Pages with bytes changed, cut, repeated and exchanged: an error or some valid page, and soon. As
/// many as `HLOD_DAMAGED_PAGES` says; the number printed with a panic reproduces it.
#[test]
fn damaged_pages_are_errors_or_valid() {
    let mut pages: Vec<Vec<u8>> = [grid_mesh(6, 2, true), grid_mesh(12, 0, false), torus(9)]
        .iter()
        .zip([2, 0, 0])
        .map(|(mesh, shift)| encode_mesh(mesh, shift).unwrap())
        .collect();
    let points = vertices_as_points(&grid_mesh(9, 1, true));
    let both = PageContent { mesh: grid_mesh(5, 1, true), points: points.clone() };
    pages.push(encode_points(&points, 1).unwrap());
    pages.push(encode_page(&both, 1, 1).unwrap());
    let count = std::env::var("HLOD_DAMAGED_PAGES").map_or(30_000, |n| n.parse().unwrap());
    let mut valid = 0u64;
    for number in 0..count {
        let page = damaged(&pages, number);
        let result = std::panic::catch_unwind(|| decode_page(&page));
        let Ok(result) = result else { panic!("damaged page {number} made the decoder panic") };
        if let Ok(content) = result {
            let is_valid = content.mesh.validate().is_ok() && content.points.validate().is_ok();
            assert!(is_valid, "damaged page {number} became an invalid one");
            valid += 1;
        }
    }
    println!("{count} damaged pages: {valid} are valid, the others errors");
    // Plain bits have no redundancy: another sign is another mesh. Checksums see that.
    assert!(valid < count / 10, "hardly any damage is seen: {valid} of {count}");
}

/// Damage `number`, of one to four kinds.
fn damaged(pages: &[Vec<u8>], number: u64) -> Vec<u8> {
    // splitmix64 (Steele, Lea & Flood 2014).
    let mut state = number.wrapping_mul(0x2545_f491_4f6c_dd1d);
    let mut random = |below: usize| {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) % below.max(1) as u64) as usize
    };
    let mut page = pages[random(pages.len())].clone();
    for _ in 0..1 + random(4) {
        let at = random(page.len());
        match random(6) {
            0 => page[at] ^= 1 << random(8),
            1 => page[at] = random(256) as u8,
            // Headers matter most.
            2 => page[random(44)] = [0, 1, 0x7f, 0x80, 0xff][random(5)],
            3 => page.truncate(at.max(1)),
            4 => {
                let copied = page[at..(at + random(32)).min(page.len())].to_vec();
                let to = random(page.len());
                page.splice(to..to, copied);
            }
            _ => {
                let other = &pages[random(pages.len())];
                let from = random(other.len());
                page.truncate(at.max(1));
                page.extend(&other[from..]);
            }
        }
        // Every damage must find a header to damage.
        page.resize(page.len().max(44), 0);
    }
    page
}

proptest! {
    #[test]
    fn damaged_pages_never_panic(at in 0usize..600, value in any::<u8>(), cut in 0usize..600) {
        let mut page = encode_mesh(&grid_mesh(8, 0, true), 0).unwrap();
        let at = at % page.len();
        page[at] = value;
        page.truncate(page.len() - cut % page.len());
        if let Ok(mesh) = decode_mesh(&page) {
            prop_assert!(mesh.validate().is_ok());
        }
    }

    #[test]
    fn any_triangles_survive_coding(
        triangles in prop::collection::vec(prop::array::uniform3(0u32..12), 0..40),
        positions in prop::collection::vec(prop::array::uniform3(0i32..9), 12),
        coloured in any::<bool>(),
    ) {
        let normals = positions.iter().map(|p| OctNormal::encode(p.map(|c| c as f32 - 4.0)));
        let colours = positions.iter().map(|p| [p[0] as u8, 255 - p[1] as u8, p[2] as u8, 9]);
        let scalars = positions.iter().map(|p| Scalars([p[0] as u16, 65_535 - p[1] as u16, 0, (p[2] as u16) << 12]));
        let mesh = Mesh {
            normals: normals.collect(),
            colours: if coloured { colours.collect() } else { Vec::new() },
            scalars: if coloured { scalars.collect() } else { Vec::new() },
            positions: positions.clone(),
            triangles,
        };
        assert_survives(&mesh, 0);
    }

    #[test]
    fn arbitrary_bytes_never_panic(mut bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        if let Some(tag) = bytes.first_mut() {
            *tag = TAG_TRIANGLES;
        }
        let _ = decode_mesh(&bytes);
    }
}
