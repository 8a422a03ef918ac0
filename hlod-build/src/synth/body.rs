//! Neck, shoulders, cloak, foot and plinth, in the statue's own coordinates (mm, y up, the
//! front towards +z, the plinth's underside at y = 0).

use super::field::{Field, Op};
use super::head::{self, Frame, turned, v};
use super::inscription;
use super::noise::{Stream, hash64};
use super::relief::{Panel, Relief};
use super::shape::Shape;
use glam::{DMat3, DVec3};

/// The plinth's corners, mm.
pub const PLINTH: [[f64; 3]; 2] = [[-150.0, 0.0, -120.0], [150.0, 140.0, 120.0]];
/// Width, height and depth of everything, to a few mm.
pub const SIZE: [f64; 3] = [410.0, 605.0, 240.0];
/// Radius of the plinth's edges, mm.
pub const PLINTH_ROUND: f64 = 1.6;

fn ball(center: DVec3, radii: DVec3) -> Shape {
    Shape::ellipsoid(center, DMat3::IDENTITY, radii)
}

/// Put the whole statue together; marks too fine for `spacing` mm are left out.
pub fn statue(seed: u64, spacing: f64) -> Field {
    let part_seed = |n: u64| (hash64(seed ^ (n << 40)) >> 32) as u32;
    let chisel = |depth: f64, pitch: f64, stroke: f64, cover: f64, n: u64| {
        // Rows narrower than two samples would only alias.
        let shown = ((pitch / spacing - 1.6) / 2.0).clamp(0.0, 1.0);
        (shown > 0.0).then(|| {
            Op::Relief(Relief::Chisel {
                depth: (depth * shown) as f32,
                pitch: pitch as f32,
                stroke: stroke as f32,
                cover: cover as f32,
                seed: part_seed(n),
            })
        })
    };
    let mut ops = Vec::new();
    // Flesh.
    ops.push(Op::Begin);
    neck(&mut ops);
    torso(0.0, &mut ops);
    cut_bust(0.0, &mut ops);
    head::face(&mut ops);
    ops.extend(chisel(0.10, 2.6, 12.0, 0.25, 1));
    ops.push(Op::End(0.5));
    // Hair.
    ops.push(Op::Begin);
    head::hair(seed, part_seed(8), &mut ops);
    ops.extend(chisel(0.18, 2.2, 12.0, 0.4, 2));
    ops.push(Op::End(1.5));
    // Cloak.
    ops.push(Op::Begin);
    cloak(part_seed(3), &mut ops);
    ops.extend(chisel(0.24, 3.1, 17.0, 0.6, 4));
    ops.push(Op::End(1.0));
    // Brooch.
    ops.push(Op::Begin);
    brooch(&mut ops);
    ops.push(Op::End(1.5));
    // Foot.
    ops.push(Op::Begin);
    foot(&mut ops);
    ops.extend(chisel(0.15, 2.7, 15.0, 0.5, 5));
    ops.push(Op::End(3.0));
    // Plinth.
    ops.push(Op::Begin);
    plinth(seed, &mut ops);
    ops.extend(chisel(0.42, 4.2, 24.0, 0.95, 6));
    ops.extend(inscription::cuts().map(Op::Incise));
    ops.push(Op::End(1.5));
    // Grain.
    let mut octaves = Vec::new();
    let mut wave = 11.0;
    while wave > 3.0 * spacing && wave > 0.15 {
        octaves.push([wave as f32, (0.011 * wave) as f32]);
        wave *= 0.47;
    }
    ops.push(Op::Finish(Relief::Grain { octaves, seed: part_seed(7) }));
    Field::new(ops)
}

fn neck(ops: &mut Vec<Op>) {
    let f = Frame::head();
    let nape = f.point(v(0., -42., -26.));
    ops.push(Op::Add(Shape::cone(v(0., 290., -22.), nape, 62., 55.), 16.0));
    let pit = v(0., 312., 40.);
    for s in [-1.0, 1.0] {
        // From behind the ear to the pit of the neck, and from the nape to the shoulder.
        let mastoid = f.point(v(s * 58., -44., -22.));
        ops.push(Op::Add(Shape::cone(mastoid, pit + v(s * 10., 0., 0.), 10., 7.5), 14.0));
        ops.push(Op::Add(
            Shape::cone(f.point(v(s * 16., -78., -52.)), v(s * 104., 290., -38.), 20., 24.),
            26.0,
        ));
        // Collar bones.
        ops.push(Op::Add(
            Shape::cone(pit + v(s * 14., -5., 10.), v(s * 92., 312., 20.), 6.5, 7.),
            16.0,
        ));
    }
    // Windpipe, and the hollow between the collar bones.
    ops.push(Op::Add(Shape::cone(f.point(v(0., -106., 30.)), pit + v(0., 14., 0.), 13., 9.), 20.0));
    ops.push(Op::Carve(ball(v(0., 316., 60.), v(9., 9., 10.)), 9.0));
}

/// Chest, back and shoulders, thicker by `grow` mm.
fn torso(grow: f64, ops: &mut Vec<Op>) {
    let g = DVec3::splat(grow);
    ops.push(Op::Add(ball(v(0., 226., -8.), v(142., 104., 82.) + g), 30.0));
    ops.push(Op::Add(ball(v(0., 288., -22.), v(128., 40., 54.) + g), 30.0));
    for s in [-1.0, 1.0] {
        let lean = turned(0.0, 0.0, s * 0.25);
        ops.push(Op::Add(
            Shape::ellipsoid(v(s * 150., 246., -14.), lean, v(58., 74., 62.) + g),
            30.0,
        ));
        ops.push(Op::Add(ball(v(s * 58., 244., 38.), v(62., 44., 40.) + g), 26.0));
    }
}

/// The lower outline of a bust: one sweep from shoulder to foot.
fn cut_bust(grow: f64, ops: &mut Vec<Op>) {
    let g = DVec3::splat(grow);
    ops.push(Op::Keep(ball(v(0., 352., -6.), v(208., 172., 190.) + g), 5.0));
}

/// Where the cloak is pinned, x and y, and where it goes over the other shoulder.
const GATHER: [[f32; 2]; 2] = [[-104.0, 300.0], [118.0, 322.0]];

fn cloak(seed: u32, ops: &mut Vec<Op>) {
    torso(9.0, ops);
    // A thick roll runs from the brooch round the neck.
    let roll = [
        v(-100., 300., 52.),
        v(-62., 286., 74.),
        v(-10., 280., 84.),
        v(44., 290., 74.),
        v(88., 312., 40.),
        v(96., 330., -6.),
        v(66., 338., -56.),
        v(0., 340., -84.),
        v(-66., 336., -58.),
        v(-104., 322., -10.),
        v(-100., 300., 52.),
    ];
    ops.push(Op::Carve(
        Shape::ellipsoid(v(-4., 330., 22.), turned(0.25, 0., 0.), v(84., 58., 78.)),
        6.0,
    ));
    for w in roll.windows(2) {
        let out = ((w[0] + w[1]) * 0.5 - v(-4., 250., -6.)).normalize();
        ops.push(Op::Add(Shape::ridge(w[0], w[1], [13.; 2], (out, 36.0), 0.10), 7.0));
    }
    ops.push(Op::Relief(Relief::Folds { gather: GATHER, count: 9.0, height: 15.0, seed }));
    cut_bust(-2.0, ops);
}

fn brooch(ops: &mut Vec<Op>) {
    let c = v(-102., 292., 62.);
    let lean = turned(1.0, -0.5, 0.0);
    ops.push(Op::Add(Shape::ellipsoid(c, lean, v(24., 9., 24.)), 1.0));
    // Behind it the cloth is bunched.
    ops.push(Op::Add(ball(v(-114., 292., 39.), v(18., 14., 15.)), 6.0));
    let up = lean * v(0., 1., 0.);
    for i in 0..12 {
        let (ca, sa) = head::cos_sin(f64::from(i) * std::f64::consts::TAU / 12.0 - 3.0);
        let at = c + up * 4.5 + lean * v(ca * 18., 0., sa * 18.);
        ops.push(Op::Add(ball(at, DVec3::splat(3.6)), 1.2));
    }
    ops.push(Op::Carve(Shape::ellipsoid(c + up * 10.5, lean, v(13., 5., 13.)), 1.0));
    ops.push(Op::Add(Shape::ellipsoid(c + up * 6.0, lean, v(8., 5., 8.)), 1.0));
}

fn foot(ops: &mut Vec<Op>) {
    let cylinder = |y: f64, half: f64, radius: f64, round: f64| Shape::Cylinder {
        center: [0.0, y as f32, 0.0],
        radius: radius as f32,
        half: half as f32,
        round: round as f32,
    };
    ops.push(Op::Add(cylinder(145., 7., 84., 2.), 1.0));
    ops.push(Op::Add(cylinder(158., 8., 76., 7.8), 1.0));
    ops.push(Op::Add(cylinder(178., 24., 57., 4.), 5.0));
    ops.push(Op::Carve(Shape::Torus { center: [0.0, 179.0, 0.0], radius: [66.0, 13.0] }, 2.0));
    ops.push(Op::Add(cylinder(196., 5., 62., 4.8), 1.0));
}

fn plinth(seed: u64, ops: &mut Vec<Op>) {
    let (low, high) = (DVec3::from(PLINTH[0]), DVec3::from(PLINTH[1]));
    ops.push(Op::Add(
        Shape::Box {
            center: ((low + high) * 0.5).as_vec3().to_array(),
            half: ((high - low) * 0.5).as_vec3().to_array(),
            round: PLINTH_ROUND as f32,
        },
        1.0,
    ));
    // Break chips from the edges, away from the panel.
    let mut random = Stream::new(seed, 0xc41b);
    for i in 0..26 {
        let mut p =
            v(random.signed() * 150.0, 70.0 + random.signed() * 70.0, random.signed() * 120.0);
        let x = if random.unit() < 0.5 { -150.0 } else { 150.0 };
        let z = if random.unit() < 0.4 { 120.0 } else { -120.0 };
        match i % 3 {
            0 => (p.x, p.z) = (x, z),
            1 => (p.x, p.y) = (x, 140.0),
            _ => (p.y, p.z) = (140.0, z),
        }
        let big = 3.0 + 6.5 * random.unit() * random.unit();
        let axes = turned(random.signed() * 1.5, random.signed() * 1.5, random.signed());
        let out = (p - v(0., 70., 0.)).normalize() * (0.35 * big);
        let radii = v(big * 1.5, big * 0.75, big);
        if Panel::keeps_clear(p, 1.6 * big) {
            ops.push(Op::Carve(Shape::ellipsoid(p + out, axes, radii), 1.5));
        }
    }
}
