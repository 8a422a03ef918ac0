use std::collections::HashMap;

use hlod_compress::OctNormal;

use super::*;

const CELL: u32 = 1 << 16;

fn budget(distance: f64) -> Budget {
    Budget {
        whole: distance,
        distance,
        normal_noise: 2.0,
        grid_shift: 2,
        cell_min: [0; 3],
        cell_units: CELL,
        is_closed: true,
    }
}

fn source(mesh: Mesh) -> Source {
    let carried = vec![Carried::default(); mesh.triangles.len()];
    Source { mesh, carried, ..Source::default() }
}

/// A grid of squares over part of the cell's middle, at some height.
fn sheet(n: u32, height: impl Fn(f64, f64) -> f64, normal: impl Fn(f64, f64) -> [f32; 3]) -> Mesh {
    let mut mesh = Mesh::default();
    for y in 0..=n {
        for x in 0..=n {
            let [u, v] = [x, y].map(|c| f64::from(c) / f64::from(n));
            let place = |c: f64| 10_000 + (c * 40_000.0).round() as i32;
            mesh.positions.push([place(u), place(v), 30_000 + height(u, v).round() as i32]);
            mesh.normals.push(OctNormal::encode(normal(u, v)));
            if x < n && y < n {
                let a = y * (n + 1) + x;
                mesh.triangles.push([a, a + 1, a + n + 2]);
                mesh.triangles.push([a, a + n + 2, a + n + 1]);
            }
        }
    }
    mesh
}

fn ball(rings: u32) -> Mesh {
    let sectors = 2 * rings;
    let mut mesh = Mesh::default();
    let mut add = |polar: f64, turn: f64| {
        let d = [polar.sin() * turn.cos(), polar.sin() * turn.sin(), polar.cos()];
        mesh.positions.push(d.map(|c| 32_768 + (20_000.0 * c).round() as i32));
        mesh.normals.push(OctNormal::encode(d.map(|c| c as f32)));
    };
    add(0.0, 0.0);
    for ring in 1..rings {
        for sector in 0..sectors {
            let [r, s] = [ring, sector].map(f64::from);
            let (polar, turn) = (r / f64::from(rings), 2.0 * s / f64::from(sectors));
            add(polar * std::f64::consts::PI, turn * std::f64::consts::PI);
        }
    }
    add(std::f64::consts::PI, 0.0);
    let last = mesh.positions.len() as u32 - 1;
    let at = |ring: u32, sector: u32| 1 + (ring - 1) * sectors + sector % sectors;
    for s in 0..sectors {
        mesh.triangles.push([0, at(1, s), at(1, s + 1)]);
        mesh.triangles.push([last, at(rings - 1, s + 1), at(rings - 1, s)]);
        for r in 1..rings - 1 {
            let [a, b, c, d] = [at(r, s), at(r, s + 1), at(r + 1, s), at(r + 1, s + 1)];
            mesh.triangles.extend([[a, c, d], [a, d, b]]);
        }
    }
    mesh
}

/// Twice the number of triangles less edges that only one triangle has, and Euler's number.
fn topology(mesh: &Mesh) -> (usize, i64) {
    let mut edges: Vec<[u32; 2]> = mesh
        .triangles
        .iter()
        .flat_map(|t| (0..3).map(|k| [t[k], t[(k + 1) % 3]]))
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    let open = edges.chunk_by(|a, b| a == b).filter(|c| c.len() == 1).count();
    edges.dedup();
    let mut vertices: Vec<u32> = mesh.triangles.as_flattened().to_vec();
    vertices.sort_unstable();
    vertices.dedup();
    (open, vertices.len() as i64 - edges.len() as i64 + mesh.triangles.len() as i64)
}

#[test]
fn a_flat_sheet_needs_a_handful_of_triangles() {
    let flat = source(sheet(40, |_, _| 0.0, |_, _| [0.0, 0.0, 1.0]));
    let both = simplify(&flat, &budget(64.0));
    for simplified in [both.appearance, both.geometric] {
        assert!(simplified.mesh.triangles.len() <= 12, "{}", simplified.mesh.triangles.len());
        let (lo, hi) = simplified.mesh.bounds().expect("it is not empty");
        for (bound, outline) in [(lo, 10_000), (hi, 50_000)] {
            assert!(bound[..2].iter().all(|c| c.abs_diff(outline) <= 64), "{lo:?} {hi:?}");
        }
        assert!(simplified.distance <= 64.0);
    }
}

/// Segments of edges that only one triangle has.
fn rim(mesh: &Mesh) -> Vec<[DVec3; 2]> {
    let cube = Cube { min: [0; 3], units: CELL };
    let borders = crate::borders::Borders::of(mesh, &cube);
    let at = |p: u32| DVec3::from_array(borders.positions[p as usize].map(f64::from));
    borders.edges.iter().map(|edge| edge.ends.map(at)).collect()
}

/// Largest distance of an end or a middle of one line's segments from another line.
fn apart(from: &[[DVec3; 2]], to: &[[DVec3; 2]]) -> f64 {
    let distance = |p: DVec3| {
        let of = |[a, b]: [DVec3; 2]| {
            let t = (p - a).dot(b - a) / (b - a).length_squared();
            p.distance(a.lerp(b, t.clamp(0.0, 1.0)))
        };
        to.iter().map(|s| of(*s)).fold(f64::INFINITY, f64::min)
    };
    from.iter().flat_map(|[a, b]| [*a, a.midpoint(*b)]).map(distance).fold(0.0, f64::max)
}

/// A flat sheet whose rim meanders loses its inside, but no more of its outline than half the budget.
#[test]
fn rims_move_less_than_the_surface_may() {
    let mut mesh = sheet(100, |_, _| 0.0, |_, _| [0.0, 0.0, 1.0]);
    for p in &mut mesh.positions {
        let turn = f64::from(p[0]) / 2_000.0 * std::f64::consts::TAU;
        p[1] += (120.0 * turn.sin()).round() as i32;
    }
    let before = rim(&mesh);
    let distance = 128.0;
    let both = simplify(&source(mesh), &budget(distance));
    for simplified in [both.appearance, both.geometric] {
        let after = rim(&simplified.mesh);
        let off = apart(&before, &after).max(apart(&after, &before));
        assert!(off <= 0.5 * distance, "{off}");
        assert!(simplified.mesh.triangles.len() < 1_000, "{}", simplified.mesh.triangles.len());
    }
    let shifted: Vec<_> = before.iter().map(|s| s.map(|p| p + DVec3::Y * 70.0)).collect();
    assert!(apart(&before, &shifted) > 0.5 * distance, "a line that is off is told");
}

/// The eight octants of a ball, simplified apart, meet in the same edges, corner for corner and
/// normal for normal: put together they are closed again.
#[test]
fn pieces_simplified_apart_fit_together() {
    let half = CELL / 2;
    let mut pieces = vec![(ball(120), [0i32; 3])];
    for axis in 0..3 {
        pieces = pieces
            .into_iter()
            .flat_map(|(mesh, min)| {
                let (low, high) = crate::partition::cut(&mesh, axis, half as i32);
                let mut above = min;
                above[axis] = half as i32;
                [(low, min), (high, above)]
            })
            .collect();
    }
    for distance in [30.0, 120.0, 480.0] {
        let mut joined = [Mesh::default(), Mesh::default()];
        let mut index_of: [HashMap<_, u32>; 2] = Default::default();
        for (mesh, cell_min) in &pieces {
            let budget = Budget { cell_min: *cell_min, cell_units: half, ..budget(distance) };
            let both = simplify(&source(mesh.clone()), &budget);
            for (k, simplified) in [both.appearance, both.geometric].into_iter().enumerate() {
                let mut number = |v: u32| {
                    let vertex = crate::partition::Vertex::of(&simplified.mesh, v);
                    *index_of[k].entry(vertex).or_insert_with(|| vertex.push_to(&mut joined[k]))
                };
                let triangles: Vec<_> =
                    simplified.mesh.triangles.iter().map(|t| t.map(&mut number)).collect();
                joined[k].triangles.extend(triangles);
            }
        }
        for mesh in &joined {
            assert_eq!(topology(mesh), (0, 2), "distance {distance}");
        }
    }
}

#[test]
fn a_ball_keeps_its_shape_within_the_budget_and_stays_closed() {
    let ball = source(ball(80));
    let mut last = usize::MAX;
    for distance in [50.0, 100.0, 200.0, 400.0] {
        let both = simplify(&ball, &budget(distance));
        let mesh = &both.geometric.mesh;
        assert!(both.geometric.distance <= distance && both.appearance.distance <= distance);
        assert_eq!(topology(mesh), (0, 2));
        assert!(mesh.triangles.len() < last, "{} {last}", mesh.triangles.len());
        // Every corner is on the sphere to within the budget: an independent look at it.
        for &v in mesh.triangles.as_flattened() {
            let p = DVec3::from_array(mesh.positions[v as usize].map(f64::from));
            let off = (p.distance(DVec3::splat(32_768.0)) - 20_000.0).abs();
            assert!(off <= distance + 1.0, "{off}");
        }
        last = mesh.triangles.len();
    }
    // Twice the error halves a sphere's triangles; from 25,000 to what 2 % of the radius needs.
    assert!(last < 400, "{last}");
}

/// Normals say what positions do not: a groove that is shallower than the budget.
#[test]
fn appearance_keeps_shading_that_shape_does_not_need() {
    let slope = |x: f64| if (0.5..0.6).contains(&x) { 0.5 } else { 0.0 };
    let normal = |x: f64, _: f64| {
        let s = slope(x) as f32;
        let length = (1.0 + s * s).sqrt();
        [s / length, 0.0, 1.0 / length]
    };
    let grooved = source(sheet(60, |_, _| 0.0, normal));
    let both = simplify(&grooved, &budget(64.0));
    let (appearance, geometric) =
        (both.appearance.mesh.triangles.len(), both.geometric.mesh.triangles.len());
    assert!(geometric <= 12 && appearance > 3 * geometric, "{appearance} {geometric}");
    // And the certificate says so.
    let [all, _, most] = both.geometric.normal_deviation;
    assert!(all > 0.3 && most > 0.1, "{:?}", both.geometric.normal_deviation);
    assert!(both.appearance.visual < both.geometric.visual);
}

#[test]
fn borders_on_cell_faces_stay_on_them() {
    let mut mesh =
        sheet(40, |x, y| 300.0 * (9.0 * x).sin() * (7.0 * y).cos(), |_, _| [0.0, 0.0, 1.0]);
    // Stretch the sheet to the whole cell: its outline lies on four faces.
    for p in &mut mesh.positions {
        for c in &mut p[..2] {
            *c = ((i64::from(*c) - 10_000) * i64::from(CELL) / 40_000) as i32;
        }
    }
    let both = simplify(&source(mesh), &budget(100.0));
    let mesh = &both.geometric.mesh;
    let on_face = |p: &[i32; 3]| p[..2].iter().any(|&c| c == 0 || c == CELL as i32);
    let (open, _) = topology(mesh);
    let mut edges: Vec<[u32; 2]> = Vec::new();
    for t in &mesh.triangles {
        edges.extend((0..3).map(|k| [t[k], t[(k + 1) % 3]]));
    }
    let lone: Vec<_> = edges.iter().filter(|[a, b]| !edges.contains(&[*b, *a])).collect();
    assert_eq!(lone.len(), open);
    assert!(lone.iter().all(|e| e.iter().all(|&v| on_face(&mesh.positions[v as usize]))));
    assert!(both.geometric.distance <= 100.0);
}

#[test]
fn hostile_geometry_keeps_its_bound() {
    // Coincident sheets that face apart, doubled triangles, an edge of three triangles, thousands
    // of specks below the grid, a needle: all in one cell.
    let mut mesh = sheet(12, |x, y| 200.0 * (x * y * 9.0).sin(), |_, _| [0.0, 0.0, 1.0]);
    let count = mesh.positions.len() as u32;
    let back = sheet(12, |x, y| 200.0 * (x * y * 9.0).sin(), |_, _| [0.0, 0.0, -1.0]);
    mesh.positions.extend(back.positions);
    mesh.normals.extend(back.normals);
    mesh.triangles
        .extend(back.triangles.iter().map(|t| [t[0] + count, t[2] + count, t[1] + count]));
    let doubled: Vec<[u32; 3]> = mesh.triangles[..40].to_vec();
    mesh.triangles.extend(doubled);
    let mut add = |corners: [[i32; 3]; 3]| {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(corners);
        mesh.normals.extend([OctNormal::encode([1.0, 0.0, 0.0]); 3]);
        mesh.triangles.push([first, first + 1, first + 2]);
    };
    add([[30_000, 30_000, 30_000], [33_333, 30_000, 30_000], [31_000, 31_000, 39_000]]);
    add([[100, 100, 100], [60_000, 100, 100], [60_000, 101, 100]]);
    for i in 0..1_000 {
        let p = [500 + 60 * i, 60_000, 5_000 + i % 7];
        add([p, [p[0] + 1, p[1], p[2]], [p[0], p[1] + 1, p[2]]]);
    }
    let hostile = source(mesh);
    for distance in [20.0, 150.0] {
        let both = simplify(&hostile, &budget(distance));
        for simplified in [&both.appearance, &both.geometric] {
            assert!(simplified.distance <= distance, "{} {distance}", simplified.distance);
            assert!(simplified.mesh.triangles.len() < hostile.mesh.triangles.len());
            assert_eq!(simplified.mesh.validate(), Ok(()));
        }
    }
}

#[test]
fn colours_are_kept_where_shape_needs_no_triangles() {
    let mut mesh = sheet(40, |_, _| 0.0, |_, _| [0.0, 0.0, 1.0]);
    let red = |p: &[i32; 3]| if (20_000..30_000).contains(&p[0]) { 255 } else { 0 };
    mesh.colours = mesh.positions.iter().map(|p| [red(p), 0, 0, 255]).collect();
    let both = simplify(&source(mesh), &budget(64.0));
    assert!(both.geometric.mesh.triangles.len() <= 12);
    let colours = &both.appearance.mesh.colours;
    assert!(colours.iter().any(|c| c[0] > 200) && colours.iter().any(|c| c[0] < 50));
}

/// Dust beside larger surface vanishes; apart from it, it becomes triangles with a back where little
/// of it is, single ones where there is nothing else; what touches a face of the cell stays.
#[test]
fn dust_vanishes_or_becomes_single_triangles() {
    let tetrahedron = |mesh: &mut Mesh, at: [i32; 3]| {
        let first = mesh.positions.len() as u32;
        for corner in [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]] {
            mesh.positions.push(std::array::from_fn(|i| at[i] + 30 * corner[i]));
            mesh.normals.push(OctNormal::encode(corner.map(|c| c as f32)));
        }
        let corners = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
        mesh.triangles.extend(corners.map(|t| t.map(|c: u32| first + c)));
    };
    let count_at = |mesh: &Mesh, at: [i32; 3]| {
        let is_near =
            |v: &u32| (0..3).all(|i| mesh.positions[*v as usize][i].abs_diff(at[i]) < 400);
        mesh.triangles.iter().filter(|t| t.iter().all(is_near)).count()
    };
    let (beside, apart, on_face) = ([32_768 + 20_060, 32_768, 32_768], [3000; 3], [30, 30_000, 9]);
    let mut mesh = ball(60);
    [beside, apart, on_face].into_iter().for_each(|at| tetrahedron(&mut mesh, at));
    let both = simplify(&source(mesh), &budget(256.0));
    assert!(!both.is_opened);
    for simplified in [&both.appearance, &both.geometric] {
        // A triangle and its back have vertices of their own, because their normals differ.
        let mut welded = simplified.mesh.clone();
        let first_at: std::collections::HashMap<[i32; 3], u32> =
            welded.positions.iter().zip(0..).map(|(p, v)| (*p, v)).collect();
        for t in &mut welded.triangles {
            *t = t.map(|v| first_at[&welded.positions[v as usize]]);
        }
        assert_eq!(topology(&welded).0, 0, "open edges");
        assert_eq!(count_at(&simplified.mesh, apart), 2);
        assert_eq!(count_at(&simplified.mesh, on_face), 4);
        assert!(simplified.distance <= 256.0);
    }
    let without = simplify(&source(ball(60)), &budget(256.0));
    let difference = both.geometric.mesh.triangles.len() - without.geometric.mesh.triangles.len();
    assert_eq!(difference, 6, "what lies beside the ball is gone");

    // Two within reach of one another become one, a third does not.
    let mut mesh = Mesh::default();
    [[3000; 3], [3100; 3], [9000; 3]].into_iter().for_each(|at| tetrahedron(&mut mesh, at));
    let both = simplify(&source(mesh), &budget(256.0));
    assert!(both.is_opened);
    assert_eq!(both.appearance.mesh.triangles.len(), 2);
    assert_eq!(both.geometric.mesh.triangles.len(), 2);
}
