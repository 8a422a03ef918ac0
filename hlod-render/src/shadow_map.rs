//! Shadow maps, to be compared with what this program draws instead: uniform, light-space perspective (Wimmer,
//! Scherzer & Purgathofer, *Light space perspective shadow maps*, EGSR 2004) and perspective (Stamminger &
//! Drettakis, *Perspective shadow maps*, SIGGRAPH 2002).
//!
//! All three are pictures that are taken from the light, and such pictures of one scene differ by nothing but a
//! homography of the rays through the light. So there is one map, drawn and looked up in one way, and a 3 × 3
//! matrix over light space's (x, y, w) makes it one of the three. Depth stays that along the ray. With that most of
//! the cases of the papers vanish: a light behind the camera, one in its plane, and casters behind the camera, for
//! which Stamminger & Drettakis draw the camera back, are all the same matrix. What is left is one condition: its
//! third row must be positive on every ray that a visible point lies on. Where it is not, or where texels would
//! differ too much, the map is uniform, and is counted (`map.wgsl`, `fit`).

use glam::{DMat3, DMat4, DVec2, DVec3, DVec4};

use crate::camera::{Camera, Projection};
use crate::light_space::Face;

/// How a map looks at what the light sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum MapProjection {
    /// As the light does, at everything that casts.
    Plain,
    /// As the light does, at what is visible; as the following.
    Uniform,
    /// With a perspective across the light's rays, along the line of sight.
    LightSpace,
    /// In the space behind the camera's projection.
    Perspective,
}

impl MapProjection {
    /// Every one.
    pub const ALL: [MapProjection; 4] = [
        MapProjection::Plain,
        MapProjection::Uniform,
        MapProjection::LightSpace,
        MapProjection::Perspective,
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            MapProjection::Plain => "plain",
            MapProjection::Uniform => "uniform",
            MapProjection::LightSpace => "light-space",
            MapProjection::Perspective => "perspective",
        }
    }
}

/// A shadow map: one for each of the light's faces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ShadowMap {
    /// How it looks.
    pub projection: MapProjection,
    /// Texels of a side.
    pub size: u32,
}

impl ShadowMap {
    /// Most texels of a side: 64 MiB.
    pub const SIZE_MAX: u32 = 4096;
}

/// What came of the maps of a frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct MapCount {
    /// Maps that were drawn: one for each face of the light that sees anything.
    pub maps: u32,
    /// Of them, those that had to be uniform though something else was asked for.
    pub fallbacks: u32,
    /// Visible points that were looked up at 60° of incidence or less.
    pub judged: u64,
    /// Of them, those on which a texel is longer than [`TEXEL_MAX_PX`].
    pub denied: u64,
}

impl MapCount {
    pub(crate) fn add(&mut self, other: MapCount) {
        self.maps += other.maps;
        self.fallbacks += other.fallbacks;
        self.judged += other.judged;
        self.denied += other.denied;
    }

    /// Share of the points that were looked up on which texels are too long.
    pub fn denied_share(&self) -> f64 {
        self.denied as f64 / (self.judged as f64).max(1.0)
    }
}

/// How long texels may be where they move shadows' edges by no more than a quarter of a pixel.
pub const TEXEL_MAX_PX: f32 = 0.35;

/// From light space's (x, y, w) to the map's plane, of which the picture is fitted later; positive, and 1 in its
/// third row in the middle of what is seen; what turns to the left still does. None where perspective gains nothing:
/// parallel views, light along the line of sight. `receivers` are corners of boxes round what is visible, relative to
/// `centre`.
pub(crate) fn homography(
    projection: MapProjection,
    face: &Face,
    (camera, aspect): (&Camera, f64),
    centre: DVec3,
    receivers: &[DVec3],
) -> Option<DMat3> {
    let Projection::Perspective { .. } = camera.projection else { return None };
    let view = Seen::new(camera, aspect, centre, receivers)?;
    // Rows of light space that rays have.
    let [x, y, _, w] = rows(&face.light_from_world);
    let matrix = match projection {
        MapProjection::Plain | MapProjection::Uniform => return None,
        MapProjection::LightSpace => light_space(&view, [x, y, w], receivers)?,
        MapProjection::Perspective => perspective(&view, [x, y, w])?,
    };
    let middle = view.middle.extend(1.0);
    let ray = DVec3::new(x.dot(middle), y.dot(middle), w.dot(middle));
    let scale = (matrix * ray).z / ray.z;
    if !scale.is_finite() || scale.abs() <= 1e-12 || ray.z <= 0.0 {
        return None;
    }
    let matrix = matrix * (1.0 / scale);
    let turn = DVec3::new(matrix.determinant().signum(), 1.0, 1.0);
    Some(DMat3::from_diagonal(turn) * matrix)
}

/// What of a face's picture some points take up: all of it where one lies beside or behind a lamp.
pub(crate) fn picture_of(face: &Face, points: &[DVec3]) -> [DVec2; 2] {
    /// A face sees no more: see [`crate::light_space::faces`].
    const TANGENT_MAX: f64 = 3.2;
    let widest = if face.limit > 0.0 { face.limit } else { TANGENT_MAX };
    let mut bounds = [DVec2::INFINITY, DVec2::NEG_INFINITY];
    for point in points {
        let p = face.light_from_world * point.extend(1.0);
        let at = DVec2::new(p.x, p.y) / p.w;
        let is_lamp = face.near > 0.0;
        if is_lamp && (p.w <= face.near || at.abs().max_element() > widest) {
            return [DVec2::splat(-widest), DVec2::splat(widest)];
        }
        bounds = [bounds[0].min(at), bounds[1].max(at)];
    }
    // Levels of detail reach beyond the scan by their errors.
    let margin = (bounds[1] - bounds[0]) * 1e-3;
    [bounds[0] - margin, bounds[1] + margin]
}

fn rows(matrix: &DMat4) -> [DVec4; 4] {
    [0, 1, 2, 3].map(|i| matrix.row(i))
}

/// What a camera sees; relative to a scene's centre.
struct Seen {
    eye: DVec3,
    right: DVec3,
    up: DVec3,
    ahead: DVec3,
    half: DVec2,
    /// Distances along the line of sight between which everything visible is.
    near: f64,
    far: f64,
    middle: DVec3,
}

impl Seen {
    fn new(camera: &Camera, aspect: f64, centre: DVec3, receivers: &[DVec3]) -> Option<Seen> {
        let [right, up, back] = camera.axes();
        let eye = camera.eye - centre;
        let depths = receivers.iter().map(|p| -back.dot(*p - eye));
        let (near, far) =
            depths.fold((f64::INFINITY, 0.0), |(n, f): (f64, f64), d| (n.min(d), f.max(d)));
        // The nearest plane as far away as it can be, for what is near gets most texels (Stamminger &
        // Drettakis, section 4).
        let near = near.max(far / 1000.0).max(camera.near);
        let middle = eye - back * ((near + far) / 2.0);
        let half = camera.half_extent(aspect);
        (far > near).then_some(Seen { eye, right, up, ahead: -back, half, near, far, middle })
    }

    /// World space → the cube from −1 to 1 that the frustum becomes.
    fn clip_from_world(&self) -> DMat4 {
        let row = |n: DVec3| n.extend(-n.dot(self.eye));
        let (w, range) = (row(self.ahead), self.far - self.near);
        let depth =
            w * ((self.far + self.near) / range) - DVec4::W * (2.0 * self.far * self.near / range);
        DMat4::from_cols(row(self.right) / self.half.x, row(self.up) / self.half.y, depth, w)
            .transpose()
    }
}

/// Stamminger & Drettakis, section 3. The light is a point of the projective space behind the camera's projection,
/// wherever it is in the world; what it sees of the cube there is a picture on the plane across the way to the
/// cube's middle.
fn perspective(view: &Seen, [x, y, w]: [DVec4; 3]) -> Option<DMat3> {
    let clip = view.clip_from_world();
    // The light is where all three rows vanish.
    let light = clip * null_of([x, y, w])?;
    // From the light to the cube's middle; finite also where the light is at infinity.
    let away = (-light.truncate()).try_normalize()?;
    let u = (DVec3::X - away * away.x)
        .try_normalize()
        .filter(|u| u.is_finite())
        .unwrap_or_else(|| away.any_orthonormal_vector());
    let v = away.cross(u);
    // Three planes through the light: each is a row that vanishes there.
    let across = |n: DVec3| clip.transpose() * n.extend(0.0);
    let size = light.length();
    let depth =
        clip.transpose() * (away * (light.w / size)).extend(-away.dot(light.truncate()) / size);
    Some(
        DMat3::from_cols(
            in_rays(across(u), [x, y, w]),
            in_rays(across(v), [x, y, w]),
            in_rays(depth, [x, y, w]),
        )
        .transpose(),
    )
}

/// Wimmer et al., section 3.2, with their n_opt. Across the light's rays, not across the whole of light space; a
/// lamp's is laid into the tangents that it sees the middle under.
fn light_space(view: &Seen, [x, y, w]: [DVec4; 3], receivers: &[DVec3]) -> Option<DMat3> {
    let place = |p: DVec3| {
        let p = p.extend(1.0);
        DVec2::new(x.dot(p), y.dot(p)) / w.dot(p)
    };
    let middle = view.middle.extend(1.0);
    let (at, depth) = (place(view.middle), w.dot(middle));
    // How the line of sight runs across the light's picture: its length is the sine of the angle between them,
    // in the units of that picture.
    let ahead = view.ahead.extend(0.0);
    let along = (DVec2::new(x.dot(ahead), y.dot(ahead)) - at * w.dot(ahead)) / depth;
    let sine = along.length() * depth;
    if depth <= 0.0 || sine < 0.01 {
        return None;
    }
    let axis = along.normalize();
    let steps = receivers.iter().map(|p| place(*p).dot(axis)).filter(|s| s.is_finite());
    let (low, high) =
        steps.fold((f64::INFINITY, -f64::INFINITY), |(l, h): (f64, f64), s| (l.min(s), h.max(s)));
    let far = view.near + (high - low) * depth * sine;
    let optimal = (view.near + (far * view.near).sqrt()) / sine / depth;
    let across = DVec3::new(-axis.y, axis.x, 0.0);
    let step = DVec3::new(axis.x, axis.y, -low);
    Some(DMat3::from_cols(across, step, step + DVec3::Z * optimal).transpose())
}

/// The point at which three rows vanish.
fn null_of([a, b, c]: [DVec4; 3]) -> Option<DVec4> {
    let minor = |i: usize| {
        let [j, k, l] = [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]][i];
        let pick = |r: DVec4| DVec3::new(r[j], r[k], r[l]);
        let sign = if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        sign * pick(a).dot(pick(b).cross(pick(c)))
    };
    let null = DVec4::new(minor(0), minor(1), minor(2), minor(3));
    let length = null.length();
    (length > 0.0).then(|| null / length)
}

/// A row that vanishes at the light as a sum of the rows that rays have.
fn in_rays(row: DVec4, [x, y, w]: [DVec4; 3]) -> DVec3 {
    let rays = [x, y, w];
    let gram = |i: usize, j: usize| rays[i].dot(rays[j]);
    let column = |j: usize| DVec3::new(gram(0, j), gram(1, j), gram(2, j));
    let products = DVec3::new(row.dot(x), row.dot(y), row.dot(w));
    DMat3::from_cols(column(0), column(1), column(2)).inverse() * products
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light_space::faces;
    use crate::scene::Light;

    const ASPECT: f64 = 4.0 / 3.0;

    fn camera() -> Camera {
        Camera {
            eye: DVec3::new(0.3, 1.0, 6.0),
            target: DVec3::new(0.0, 0.4, 0.0),
            up: DVec3::Y,
            projection: Projection::Perspective { fov_y: 0.8 },
            near: 0.01,
        }
    }

    fn receivers() -> Vec<DVec3> {
        let corner =
            |i: u32| DVec3::from_array([0, 1, 2].map(|a| f64::from(i >> a & 1) * 2.0 - 1.0));
        (0..8).map(|i| corner(i) * DVec3::new(1.5, 0.7, 4.0)).collect()
    }

    fn map(projection: MapProjection, light: Light) -> Option<(DMat3, Face)> {
        let face = faces(light, DVec3::X, &receivers()).remove(0);
        let seen = (&camera(), ASPECT);
        let matrix = homography(projection, &face, seen, DVec3::ZERO, &receivers())?;
        Some((matrix, face))
    }

    fn ray(face: &Face, p: DVec3) -> DVec3 {
        let p = face.light_from_world * p.extend(1.0);
        DVec3::new(p.x, p.y, p.w)
    }

    const LIGHTS: [(&str, Light); 6] = [
        ("parallel", Light::Directional(DVec3::new(0.3, 1.0, 0.2))),
        ("parallel, across the line of sight", Light::Directional(DVec3::new(1.0, 0.0, 0.05))),
        ("parallel, towards the camera", Light::Directional(DVec3::new(0.1, 0.4, -1.0))),
        ("a lamp before the camera", Light::Point(DVec3::new(0.0, 5.0, 1.0))),
        ("a lamp behind the camera", Light::Point(DVec3::new(4.0, 6.0, 11.0))),
        ("a lamp beside the camera", Light::Point(DVec3::new(5.0, 4.0, 6.0))),
    ];

    /// Points that the camera sees.
    fn visible() -> Vec<DVec3> {
        let camera = camera();
        let [right, up, back] = camera.axes();
        let half = camera.half_extent(ASPECT);
        let mut points = Vec::new();
        for depth in [2.5, 4.0, 7.0, 10.0] {
            for (a, b) in [(-0.9, -0.9), (0.9, -0.9), (0.0, 0.0), (-0.9, 0.9), (0.9, 0.9)] {
                points.push(camera.eye + (right * (a * half.x) + up * (b * half.y) - back) * depth);
            }
        }
        points
    }

    #[test]
    fn what_lies_on_one_ray_lies_on_one_texel_before_and_behind_the_camera() {
        for (what, light) in LIGHTS {
            for projection in [MapProjection::LightSpace, MapProjection::Perspective] {
                let Some((matrix, face)) = map(projection, light) else { panic!("{what}") };
                for p in visible() {
                    let to_light = match light {
                        Light::Directional(d) => d,
                        Light::Point(l) => l - p,
                    };
                    let at = matrix * ray(&face, p);
                    for share in [0.1, 0.5, 0.9] {
                        let caster = matrix * ray(&face, p + to_light * share);
                        let apart = (caster.truncate() / caster.z - at.truncate() / at.z).length();
                        assert!(apart < 1e-9, "{what}, {projection:?}: {apart}");
                        assert!((caster.z > 0.0) == (at.z > 0.0), "{what}, {projection:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_perspective_map_is_the_picture_of_the_cube_behind_the_projection() {
        // Straight from above: the way of each ray through that cube is parallel to its second axis,
        // and the map is the cube seen from there.
        let up = camera().axes()[1];
        let (matrix, face) = map(MapProjection::Perspective, Light::Directional(up)).unwrap();
        let clip =
            Seen::new(&camera(), ASPECT, DVec3::ZERO, &receivers()).unwrap().clip_from_world();
        let affine = |p: DVec3| {
            let m = matrix * ray(&face, p);
            let c = clip.project_point3(p);
            (m.truncate() / m.z, DVec2::new(c.x, c.z))
        };
        // Of three points the map between the two pictures, which must hold for all others.
        let points = visible();
        let [a, b, c] = [points[0], points[6], points[13]].map(affine);
        let columns = |o: DVec2, p: DVec2, q: DVec2| glam::DMat2::from_cols(p - o, q - o);
        let linear = columns(a.0, b.0, c.0) * columns(a.1, b.1, c.1).inverse();
        for p in points {
            let (m, c) = affine(p);
            let expected = a.0 + linear * (c - a.1);
            assert!((m - expected).length() < 1e-9 * (1.0 + m.length()), "{m} {expected}");
        }
    }

    #[test]
    fn perspective_spends_its_texels_where_the_camera_is_near() {
        // Lengths on the map of a step to the right at the near and the far end, each seen under the same
        // angle from the camera: uniform maps give the far one as many times more as it is farther.
        let light = Light::Directional(DVec3::new(0.05, 1.0, 0.1));
        let camera = camera();
        let [right, _, back] = camera.axes();
        let step = |projection: MapProjection, depth: f64| {
            let (matrix, face) = match map(projection, light) {
                Some(found) => found,
                None => (DMat3::IDENTITY, faces(light, DVec3::X, &receivers()).remove(0)),
            };
            let at = camera.eye - back * depth;
            let [p, q] = [at, at + right * (0.01 * depth)].map(|p| {
                let m = matrix * ray(&face, p);
                m.truncate() / m.z
            });
            p.distance(q)
        };
        let ratio = |projection| step(projection, 10.0) / step(projection, 2.5);
        assert!((ratio(MapProjection::Uniform) - 4.0).abs() < 1e-6);
        assert!((ratio(MapProjection::Perspective) - 1.0).abs() < 0.1);
        let between = ratio(MapProjection::LightSpace);
        assert!((1.0..3.0).contains(&between), "{between}");
    }

    #[test]
    fn nothing_is_gained_in_parallel_views_and_along_the_line_of_sight() {
        let face = faces(LIGHTS[0].1, DVec3::X, &receivers()).remove(0);
        let parallel = Camera { projection: Projection::Orthographic { height: 3.0 }, ..camera() };
        for projection in MapProjection::ALL {
            let seen = (&parallel, ASPECT);
            assert!(homography(projection, &face, seen, DVec3::ZERO, &receivers()).is_none());
        }
        let back = camera().axes()[2];
        assert!(map(MapProjection::LightSpace, Light::Directional(back)).is_none());
    }
}
