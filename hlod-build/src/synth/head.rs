//! The head: skull, face, ears and hair, in a frame of their own (x to the statue's left,
//! y up, z forward, mm, origin between the ears), turned and tilted a little as a whole.

use super::field::Op;
use super::noise::Stream;
use super::relief::Relief;
use super::shape::Shape;
use glam::{DMat3, DVec3};

/// Cosine and sine by their series: the same bits on every machine, for |angle| ≤ 4.
pub fn cos_sin(angle: f64) -> (f64, f64) {
    let (mut cos, mut sin, mut term) = (0.0, 0.0, 1.0);
    for n in 0..30 {
        match n % 4 {
            0 => cos += term,
            1 => sin += term,
            2 => cos -= term,
            _ => sin -= term,
        }
        term *= angle / f64::from(n + 1);
    }
    (cos, sin)
}

/// Turn about x, then z, then y, in radians.
pub fn turned(x: f64, y: f64, z: f64) -> DMat3 {
    let ((cx, sx), (cy, sy), (cz, sz)) = (cos_sin(x), cos_sin(y), cos_sin(z));
    let rx = DMat3::from_cols_array(&[1.0, 0.0, 0.0, 0.0, cx, sx, 0.0, -sx, cx]);
    let ry = DMat3::from_cols_array(&[cy, 0.0, -sy, 0.0, 1.0, 0.0, sy, 0.0, cy]);
    let rz = DMat3::from_cols_array(&[cz, sz, 0.0, -sz, cz, 0.0, 0.0, 0.0, 1.0]);
    ry * rz * rx
}

/// A vector from its components.
pub fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Places solids of a local frame in the statue.
pub struct Frame {
    axes: DMat3,
    origin: DVec3,
}

impl Frame {
    /// The head's frame.
    pub fn head() -> Frame {
        Frame { axes: turned(0.05, 0.30, -0.05), origin: v(1.0, 478.0, 6.0) }
    }

    /// A point of the frame in the statue.
    pub fn point(&self, p: DVec3) -> DVec3 {
        self.axes * p + self.origin
    }

    fn ellipsoid(&self, center: DVec3, radii: DVec3) -> Shape {
        Shape::ellipsoid(self.point(center), self.axes, radii)
    }

    fn leaning(&self, center: DVec3, lean: DMat3, radii: DVec3) -> Shape {
        Shape::ellipsoid(self.point(center), self.axes * lean, radii)
    }

    fn cone(&self, a: DVec3, b: DVec3, ra: f64, rb: f64) -> Shape {
        Shape::cone(self.point(a), self.point(b), ra, rb)
    }

    fn lid(&self, center: DVec3, radius: f64, normal: DVec3, offset: f64) -> Shape {
        Shape::Lid {
            center: self.point(center).as_vec3().to_array(),
            radius: radius as f32,
            normal: (self.axes * normal.normalize()).as_vec3().to_array(),
            offset: offset as f32,
        }
    }
}

/// Skull and face, for the flesh part.
pub fn face(ops: &mut Vec<Op>) {
    let f = Frame::head();
    // Lay out the skull and the large masses of the face.
    ops.push(Op::Add(f.ellipsoid(v(0., 30., -14.), v(73., 76., 92.)), 14.0));
    ops.push(Op::Add(f.ellipsoid(v(0., 36., 29.), v(61., 46., 55.)), 18.0));
    ops.push(Op::Add(f.ellipsoid(v(0., -26., 28.), v(60., 80., 58.)), 18.0));
    ops.push(Op::Add(f.ellipsoid(v(0., -70., 36.), v(47., 38., 46.)), 16.0));
    for s in [-1.0, 1.0] {
        ops.push(Op::Add(f.ellipsoid(v(s * 47., -54., 8.), v(14., 30., 26.)), 22.0));
        ops.push(Op::Add(f.ellipsoid(v(s * 43., -23., 56.), v(15., 11., 16.)), 20.0));
    }
    ops.push(Op::Add(f.ellipsoid(v(0., -66., 67.), v(30., 24., 21.)), 16.0));
    ops.push(Op::Add(f.ellipsoid(v(0.5, -97., 70.), v(20., 15., 17.)), 14.0));
    brows_and_eyes(&f, ops);
    nose(&f, ops);
    mouth(&f, ops);
    for s in [-1.0, 1.0] {
        ear(&f, s, ops);
    }
}

fn brows_and_eyes(f: &Frame, ops: &mut Vec<Op>) {
    for s in [-1.0, 1.0] {
        // Sink the sockets first, then lay the brows over them.
        ops.push(Op::Carve(f.ellipsoid(v(s * 30., -3., 95.), v(20., 13.5, 22.)), 9.0));
        let lift = if s > 0.0 { 1.2 } else { 0.0 };
        let brow =
            [v(s * 9., 12.5, 88.), v(s * 28., 16.5 + lift, 80.), v(s * 47., 13.0 + lift, 62.)];
        ops.push(Op::Add(f.cone(brow[0], brow[1], 5.0, 4.6), 13.0));
        ops.push(Op::Add(f.cone(brow[1], brow[2], 4.6, 3.0), 13.0));
        // Set the eyeball, cut the pupil, and close the lids over it.
        let eye = v(s * 31., -3., 68.5);
        ops.push(Op::Add(f.ellipsoid(eye, DVec3::splat(14.4)), 1.2));
        let gaze = v(0.12, 0.06, 1.0).normalize();
        ops.push(Op::Carve(f.ellipsoid(eye + gaze * 15.4, v(4.9, 4.9, 1.9)), 0.6));
        ops.push(Op::Carve(
            f.ellipsoid(eye + gaze * 14.6 + v(-0.6, 1.2, 0.), v(2.4, 1.9, 3.6)),
            0.8,
        ));
        ops.push(Op::Add(f.lid(eye, 16.2, v(s * 0.10, 1.0, -0.42), -0.6), 1.4));
        ops.push(Op::Add(f.lid(eye, 15.5, v(s * 0.05, -1.0, -0.42), 1.0), 1.4));
        // The fold of skin below the brow and the corner towards the nose.
        ops.push(Op::Add(f.cone(v(s * 22., 12., 77.), v(s * 47., 6., 60.), 3.5, 4.5), 7.0));
        ops.push(Op::Add(f.cone(v(s * 15.5, -5., 75.), v(s * 18., -5., 76.), 2.4, 2.0), 4.0));
    }
}

fn nose(f: &Frame, ops: &mut Vec<Op>) {
    ops.push(Op::Add(f.cone(v(0., 10., 80.), v(0.4, -37., 88.), 9., 14.), 9.0));
    ops.push(Op::Add(f.cone(v(0., 12., 86.), v(0.8, -36., 106.), 6.5, 7.6), 6.0));
    ops.push(Op::Add(f.ellipsoid(v(0.8, -37.5, 106.), v(8.2, 7.8, 8.0)), 6.0));
    for s in [-1.0, 1.0] {
        ops.push(Op::Add(f.ellipsoid(v(s * 11.3, -41., 95.), v(6.2, 6.6, 9.)), 6.0));
        ops.push(Op::Carve(f.ellipsoid(v(s * 6.6 + 0.4, -49.5, 100.), v(3.4, 4.2, 5.4)), 2.0));
        // From the wing of the nose to the corner of the mouth the cheek sets off.
        ops.push(Op::Carve(f.cone(v(s * 20., -43., 90.5), v(s * 29., -62., 84.), 1.6, 2.6), 9.0));
    }
}

fn mouth(f: &Frame, ops: &mut Vec<Op>) {
    ops.push(Op::Carve(f.ellipsoid(v(0., -81.5, 97.), v(19., 6., 10.)), 8.0));
    for s in [-1.0, 1.0] {
        let lean = turned(0.0, s * 0.46, s * -0.08);
        ops.push(Op::Add(f.leaning(v(s * 9.5, -60.6, 84.), lean, v(17., 5.4, 8.)), 2.5));
        let lean = turned(0.0, s * 0.42, s * 0.15);
        ops.push(Op::Add(f.leaning(v(s * 7.0, -70.3, 83.), lean, v(16., 5.9, 8.5)), 3.5));
    }
    for s in [-1.0, 1.0] {
        let middle = v(s * 10., -64.8, 91.5);
        ops.push(Op::Carve(f.cone(v(0., -65.6, 93.5), middle, 1.5, 1.3), 1.2));
        ops.push(Op::Carve(f.cone(middle, v(s * 26., -65.2 + 0.4 * s, 81.), 1.3, 1.5), 1.2));
    }
    ops.push(Op::Carve(f.cone(v(0., -49., 97.), v(0., -56., 95.5), 1.8, 2.6), 4.0));
}

fn ear(f: &Frame, s: f64, ops: &mut Vec<Op>) {
    let lean = turned(0.16, s * 0.30, s * -0.10);
    let middle = v(s * 72., -10., -12.);
    // Fill behind the ear: it lies close, without a slit.
    ops.push(Op::Add(f.ellipsoid(v(s * 61., -14., -20.), v(14., 26., 17.)), 10.0));
    let at = |y: f64, z: f64, out: f64| middle + lean * v(s * out, y, z);
    ops.push(Op::Add(f.leaning(middle, lean, v(6.5, 27., 18.)), 5.0));
    ops.push(Op::Carve(f.leaning(at(-4., 3., 7.), lean, v(6., 13., 8.)), 3.0));
    // The rim: from the root over the top down to the lobe.
    let rim = [
        (0.0, 8.0),
        (9.0, 15.0),
        (19.0, 14.0),
        (26.0, 6.0),
        (27.0, -5.0),
        (21.0, -14.0),
        (8.0, -18.0),
        (-8.0, -14.0),
        (-20.0, -6.0),
    ];
    for w in rim.windows(2) {
        ops.push(Op::Add(f.cone(at(w[0].0, w[0].1, 4.0), at(w[1].0, w[1].1, 4.0), 2.8, 2.6), 4.5));
    }
    ops.push(Op::Add(f.cone(at(14., -6., 4.), at(-12., -5., 4.), 2.6, 3.0), 2.5));
    ops.push(Op::Add(f.leaning(at(-26., 3., 1.), lean, v(5., 8., 7.)), 4.0));
    ops.push(Op::Add(f.cone(at(-3., 11., 3.), at(-9., 11., 3.), 3.4, 3.), 2.5));
}

/// Middle and radii of the ground that locks lie on: in front it leaves the cap and
/// carries the fringe over the forehead.
const GROUND: (DVec3, DVec3) = (DVec3::new(0., 36., -16.), DVec3::new(77., 77., 101.));

/// Middle and radii of the cap under the locks.
const CAP: (DVec3, DVec3) = (DVec3::new(0., 36., -19.), DVec3::new(77., 77., 90.));

/// Hair: a cap that locks lie on in tiers from the crown down, each a chain of ridges
/// with strands, curling at its tip.
pub fn hair(seed: u64, ground: u32, ops: &mut Vec<Op>) {
    let f = Frame::head();
    // The fringe's ground, cut away over the face; then the cap.
    ops.push(Op::Add(f.ellipsoid(GROUND.0, GROUND.1 - 5.0), 1.0));
    ops.push(Op::Carve(f.ellipsoid(v(0., -30., 92.), v(100., 84., 85.)), 6.0));
    ops.push(Op::Add(f.ellipsoid(CAP.0, CAP.1), 3.0));
    ops.push(Op::Add(f.ellipsoid(v(0., -26., -46.), v(60., 50., 52.)), 14.0));
    for s in [-1.0, 1.0] {
        ops.push(Op::Carve(f.ellipsoid(v(s * 84., -18., -6.), v(16., 30., 19.)), 6.0));
    }
    ops.push(Op::Relief(Relief::Chisel {
        depth: 2.0,
        pitch: 5.0,
        stroke: 42.0,
        cover: 1.0,
        seed: ground,
    }));
    let mut random = Stream::new(seed, 0x4a1);
    // From the nape up: upper tiers lie on lower ones.
    let tiers = [
        (2.56, 15),
        (2.30, 19),
        (2.04, 23),
        (1.78, 26),
        (1.52, 28),
        (1.26, 27),
        (1.00, 24),
        (0.74, 19),
        (0.48, 13),
        (0.24, 8),
        (0.06, 4),
    ];
    for (tier, (polar, count)) in tiers.into_iter().enumerate() {
        for i in 0..count {
            let around = (f64::from(i) + 0.5 * (tier % 2) as f64 + 0.25 * random.signed())
                * std::f64::consts::TAU
                / f64::from(count);
            let polar = polar + 0.07 * random.signed();
            let curl = if random.unit() < 0.72 { 1.0 } else { -1.0 };
            lock(
                &f,
                polar,
                around - std::f64::consts::PI,
                curl * (0.9 + 0.5 * random.unit()),
                0.85 + 0.3 * random.unit(),
                ops,
            );
        }
    }
}

/// The lowest y at which hair grows, over z: temples, sideburns, nape.
fn hairline(p: DVec3) -> f64 {
    let table = [
        (-200.0, -82.0),
        (-45.0, -78.0),
        (-24.0, 2.0),
        (6.0, 12.0),
        (14.0, -6.0),
        (24.0, 4.0),
        (46.0, 40.0),
        (62.0, 58.0),
        (200.0, 60.0),
    ];
    let mut y = table[0].1;
    for w in table.windows(2) {
        if p.z >= w[0].0 {
            let t = ((p.z - w[0].0) / (w[1].0 - w[0].0)).min(1.0);
            y = w[0].1 + t * (w[1].1 - w[0].1);
        }
    }
    y
}

/// Where the ray from the middle leaves the hair's ground.
fn on_ground(direction: DVec3) -> DVec3 {
    let d = direction.normalize();
    let reach = 1.0 / (d / GROUND.1).length();
    // Below the ears the nape's mass carries on.
    let low = (-d.y - 0.1).max(0.0);
    GROUND.0 + d * (reach * (1.0 + 0.10 * low))
}

fn lock(f: &Frame, polar: f64, around: f64, curl: f64, size: f64, ops: &mut Vec<Op>) {
    const STEPS: usize = 6;
    const RADII: [f64; STEPS + 1] = [5.4, 8.0, 8.9, 8.4, 6.9, 4.8, 2.0];
    // The crown lies up and back; angles are taken round it.
    let tilt = turned(-0.42, 0.0, 0.0);
    let ((cp, sp), (ca, sa)) = (cos_sin(polar), cos_sin(around));
    let mut direction = tilt * v(sp * sa, cp, sp * ca);
    let mut p = on_ground(direction);
    if p.y < hairline(p) + 6.0 {
        return;
    }
    // Walk away from the crown over it, turning more and more.
    let crown = tilt * v(0.05, 1.0, 0.0);
    let mut heading = (direction - crown * direction.dot(crown) * 1.0).normalize_or(v(0., 0., 1.));
    if polar < 0.2 {
        heading = v(ca, 0.0, -sa);
    }
    let swirl = 0.35;
    for i in 0..STEPS {
        let t = i as f64 / STEPS as f64;
        let normal = ((p - GROUND.0) / (GROUND.1 * GROUND.1)).normalize();
        heading = (heading - normal * heading.dot(normal)).normalize_or(v(0., -1., 0.));
        let bend = if i == 0 { -swirl * curl } else { curl * (0.10 + 0.62 * t * t) };
        let (c, s) = cos_sin(bend);
        heading = heading * c + normal.cross(heading) * s;
        direction = p + heading * (8.4 * size) - GROUND.0;
        let q = on_ground(direction);
        // Tips lift a little from the ground.
        let lift = normal * (0.6 + 1.6 * t);
        ops.push(Op::Add(
            Shape::ridge(
                f.point(p + lift),
                f.point(q + lift),
                [RADII[i] * size, RADII[i + 1] * size],
                (f.axes * normal, 20.0),
                0.26,
            ),
            if i == 0 { 1.0 } else { 2.4 },
        ));
        p = q;
    }
}
