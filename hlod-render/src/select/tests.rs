use std::collections::BTreeSet;

use hlod_compress::{
    CellKey, Children, Errors, Lattice, NodeFlags, NodeRecord, NormalCone, OctNormal, PageRef,
    Representation, SkeletonBlock,
};

use super::*;

const UNITS: i32 = 1 << 12;

pub(crate) fn lattice() -> Lattice {
    Lattice {
        origin: [-1.0; 3],
        step: 2.0 / f64::from(UNITS),
        root_units: UNITS as u32,
        depth_max: 6,
    }
}

/// A complete octree of edge 2 round the origin; errors halve with each depth, leaves have none.
fn tree(depth: u8, cone: NormalCone) -> Skeleton {
    tree_of(depth, cone, RepresentationKind::Appearance)
}

/// The same, with representations of another kind above the leaves.
pub(crate) fn tree_of(depth: u8, cone: NormalCone, upper: RepresentationKind) -> Skeleton {
    let mut records = Vec::new();
    let mut cells = vec![CellKey::ROOT];
    let mut next = 0;
    while next < cells.len() {
        let cell = cells[next];
        let leaf = cell.depth() == depth;
        let kind = if leaf { RepresentationKind::Source } else { upper };
        let geometric = if leaf { 0.0 } else { 0.1 / f32::from(1u16 << cell.depth()) };
        let lo = lattice().cell_min(cell);
        let edge = lattice().cell_units(cell.depth()) as i32;
        records.push(NodeRecord {
            cell,
            child_mask: if leaf { 0 } else { 0xff },
            flags: NodeFlags { closed_oriented: true },
            bounds: [lo, lo.map(|c| c + edge)],
            cone,
            representations: vec![Representation {
                kind,
                errors: Errors { geometric, border: geometric / 2.0, ..Errors::NONE },
                vertices: 3,
                triangles: 1,
                points: 0,
                cover_radius: 0.0,
                page: PageRef { offset: 0, page_bytes: 1, crc32: 0 },
            }],
            children: if leaf { Children::None } else { Children::Here(cells.len() as u32) },
        });
        if !leaf {
            cells.extend((0..8).map(|o| cell.child(o)));
        }
        next += 1;
    }
    let block = SkeletonBlock { nodes: records };
    block.validate().unwrap();
    Skeleton::new(lattice(), &block)
}

fn camera(eye: DVec3) -> Camera {
    let projection = Projection::Perspective { fov_y: 0.8 };
    Camera { eye, target: DVec3::ZERO, up: DVec3::Y, projection, near: 0.01 }
}

fn view(eye: DVec3) -> View {
    View::new(&camera(eye), DMat4::IDENTITY, 640, 480)
}

const APPEARANCE: RepresentationKind = RepresentationKind::Appearance;

fn at_tau(error_threshold_px: f64) -> Selection {
    Selection { kind: APPEARANCE, error_threshold_px }
}

/// How often a small box round `p` is covered by drawn nodes.
fn covered(skeleton: &Skeleton, front: &Front, p: DVec3) -> usize {
    let inside = |d: &&Draw| {
        let n = &skeleton.nodes()[d.node as usize];
        p.cmpgt(n.min).all() && p.cmplt(n.max).all()
    };
    front.draws.iter().filter(inside).count()
}

#[test]
fn every_visible_point_is_covered_once_whatever_is_resident() {
    let skeleton = tree(3, NormalCone::ALL);
    let view = view(DVec3::new(0.3, 0.2, 3.0));
    let (mut seed, mut held) = (7u64, 0);
    for round in 0..40 {
        // The root is always there; of the rest a random part.
        let resident: BTreeSet<u32> = (0..skeleton.nodes().len() as u32)
            .filter(|&n| {
                seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1);
                n == 0 || (seed >> 33) % 8 < round % 8
            })
            .collect();
        let front = select(&skeleton, &view, at_tau(0.5), &|n, _| resident.contains(&n));
        // From 1: the point of 0 lies on the cells' faces.
        for i in 1..200 {
            let p = DVec3::new(
                (f64::from(i) * 0.77).sin(),
                (f64::from(i) * 1.31).cos(),
                (f64::from(i) * 2.1).sin(),
            ) * 0.6;
            assert_eq!(covered(&skeleton, &front, p), 1, "{p} in round {round}");
        }
        for draw in &front.draws {
            assert!(resident.contains(&draw.node));
        }
        // What is here and waits for others is neither drawn nor forgotten.
        let drawn: BTreeSet<u32> = front.draws.iter().map(|draw| draw.node).collect();
        held += front.held.len();
        assert!(front.held.iter().all(|(n, _)| resident.contains(n) && !drawn.contains(n)));
        // Nor is what can stand in for what is drawn.
        let kept: BTreeSet<u32> = front.held.iter().map(|(n, _)| *n).collect();
        assert_eq!(kept.len(), front.held.len(), "each once");
        for draw in &front.draws {
            let mut above = draw.node;
            while above != 0 {
                above = skeleton.nodes()[above as usize].parent;
                assert!(kept.contains(&above) || !resident.contains(&above), "{above}");
            }
        }
        let complete = front.draws.len() == front.ideal_nodes;
        assert_eq!(complete, front.wanted.is_empty(), "what is missing is asked for");
    }
    assert!(held > 100, "{held} nodes wait for others");
}

#[test]
fn nodes_know_their_parents() {
    let skeleton = tree(3, NormalCone::ALL);
    assert_eq!(skeleton.nodes()[0].parent, 0);
    for (i, node) in skeleton.nodes().iter().enumerate().skip(1) {
        let parent = &skeleton.nodes()[node.parent as usize];
        let ChildLink::Nodes { first, count } = parent.children else { panic!("{i}: no parent") };
        assert!((first..first + count).contains(&(i as u32)) && parent.depth + 1 == node.depth);
    }
}

#[test]
fn the_front_keeps_the_threshold_and_is_no_finer_than_needed() {
    let skeleton = tree(4, NormalCone::ALL);
    for tau in [0.5, 4.0, 30.0] {
        let view = view(DVec3::new(0.0, 0.5, 4.0));
        let front = select(&skeleton, &view, at_tau(tau), &|_, _| true);
        assert!(front.draws.iter().all(|d| d.error_px <= tau));
        let parents_are_coarser = front.draws.iter().all(|d| {
            let depth = skeleton.nodes()[d.node as usize].depth;
            let parent = skeleton.nodes().iter().find(|n| {
                matches!(n.children, ChildLink::Nodes { first, count } if (first..first + count).contains(&d.node))
            });
            parent.is_none_or(|p| view.error_px(p.representations[0].error, p.min, p.max) > tau)
                || depth == 0
        });
        assert!(parents_are_coarser);
    }
}

#[test]
fn error_px_bounds_every_projected_length() {
    let view = view(DVec3::new(0.0, 0.0, 3.0));
    let (min, max) = (DVec3::new(0.4, 0.3, -0.2), DVec3::new(0.8, 0.9, 0.4));
    let error = 0.05;
    let bound = view.error_px(error, min, max);
    let project = |p: DVec3| {
        let ndc = view.clip_from_model.project_point3(p);
        DVec2::new(ndc.x * 320.0, ndc.y * 240.0)
    };
    let mut largest: f64 = 0.0;
    for i in 0..4000 {
        let f = f64::from(i);
        let at =
            min + (max - min) * DVec3::new((f * 0.618) % 1.0, (f * 0.414) % 1.0, (f * 0.732) % 1.0);
        let direction = DVec3::new((f * 1.3).sin(), (f * 2.7).sin(), (f * 0.9).cos()).normalize();
        largest = largest.max(project(at).distance(project(at + direction * error)));
    }
    assert!(largest <= bound, "{largest} > {bound}");
    assert!(bound < 1.6 * largest, "{bound} is far above {largest}");
    assert_eq!(view.error_px(error, DVec3::splat(-5.0), DVec3::splat(5.0)), f64::INFINITY);
}

#[test]
fn leaves_are_asked_for_by_a_threshold_of_zero() {
    let skeleton = tree(2, NormalCone::ALL);
    let front = select(&skeleton, &view(DVec3::new(0.0, 0.0, 90.0)), at_tau(0.0), &|_, _| true);
    assert_eq!(front.draws.len(), 64);
}

/// Leaves end where the scan does: a camera inside one of them does not make borders infinitely wide.
#[test]
fn borders_are_as_wide_as_drawn_nodes_are_wrong_there() {
    let skeleton = tree(3, NormalCone::ALL);
    let all = |_, _| true;
    let inside = select(&skeleton, &view(DVec3::new(0.1, 0.2, 0.3)), at_tau(0.0), &all);
    assert!(!inside.draws.is_empty());
    assert_eq!(inside.border_px, 0.0);
    let view = view(DVec3::new(0.3, 0.2, 9.0));
    let coarse = select(&skeleton, &view, at_tau(4.0), &all);
    let widest = |draw: &Draw| {
        let node = &skeleton.nodes()[draw.node as usize];
        view.error_px(node.representations[draw.representation].border_error, node.min, node.max)
    };
    let widest = coarse.draws.iter().map(widest).fold(0.0, f64::max);
    assert!(widest > 0.5, "{widest}");
    assert_eq!(coarse.border_px, widest);
}

#[test]
fn boxes_outside_the_frustum_and_backs_are_left_out() {
    let away = NormalCone { axis: OctNormal::encode([0.0, 0.0, -1.0]), cosine: 0.9 };
    let towards = NormalCone { axis: OctNormal::encode([0.0, 0.0, 1.0]), cosine: 0.9 };
    let eye = DVec3::new(0.0, 0.0, 30.0);
    let count = |cone| select(&tree(2, cone), &view(eye), at_tau(0.0), &|_, _| true).draws.len();
    assert_eq!(count(away), 0);
    assert_eq!(count(towards), 64);
    let mut turned = camera(eye);
    turned.target = eye + DVec3::Z;
    let view = View::new(&turned, DMat4::IDENTITY, 640, 480);
    assert!(select(&tree(1, NormalCone::ALL), &view, at_tau(1.0), &|_, _| true).draws.is_empty());
}

#[test]
fn tickets_survive() {
    assert_eq!(parse_ticket(page_ticket(77, 1)), (77, Some(1)));
    assert_eq!(parse_ticket(block_ticket(1 << 30)), (1 << 30, None));
}
