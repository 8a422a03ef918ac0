//! Model-relative coordinates: the same views and paths for every statue.
//!
//! The origin is the centre of the statue's bounds, lengths are fractions of its height along the
//! up axis, and the axes are right, up and front (towards a viewer before the statue).

use glam::DVec3;
use hlod_compress::Header;

use crate::camera::{Camera, Projection};
use crate::model::Model;

/// How model-relative coordinates lie in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Framing {
    /// Centre of the bounds, world space.
    pub centre: DVec3,
    /// Unit vectors right, up and front.
    pub axes: [DVec3; 3],
    /// Extent along up, world units; of flat things at least a tenth of the largest extent.
    pub height: f64,
    /// Bounds along the axes of world space.
    pub bounds: (DVec3, DVec3),
    /// Half the extents along right, up and front.
    pub half: [f64; 3],
    /// Corners of the box that these are of, world space.
    pub corners: [DVec3; 8],
}

/// Field of view of named views and new paths: a mild telephoto.
pub const FOV_Y_DEG: f64 = 35.0;

impl Framing {
    /// Of one model, by the directions its header declares.
    pub fn of(model: &Model) -> Framing {
        Framing::of_header(model.header())
    }

    /// Of a file, by its header alone.
    pub fn of_header(header: &Header) -> Framing {
        let place = |p| DVec3::from_array(header.lattice.position(p));
        let bounds = (place(header.bounds[0]), place(header.bounds[1]));
        let up = DVec3::from_array(header.up.direction());
        let front = DVec3::from_array(header.front.direction());
        Framing::new(bounds, up, front)
    }

    /// Width, height and depth, in the source's unit: along right, up and front.
    pub fn size(&self) -> [f64; 3] {
        self.half.map(|half| 2.0 * half)
    }

    /// `up` and `front` are perpendicular unit vectors along axes.
    pub fn new(bounds: (DVec3, DVec3), up: DVec3, front: DVec3) -> Framing {
        let size = bounds.1 - bounds.0;
        let height = size.dot(up.abs()).max(0.1 * size.max_element()).max(f64::MIN_POSITIVE);
        let axes = [up.cross(front), up, front];
        Framing {
            centre: (bounds.0 + bounds.1) / 2.0,
            axes,
            height,
            bounds,
            half: axes.map(|axis| size.dot(axis.abs()) / 2.0),
            corners: corners(bounds),
        }
    }

    /// The same statue with other axes, unit vectors right, up and front at right angles. `extents` are the least and
    /// the most along each; where they are not known yet, those of the bounds are taken, which are too large.
    pub fn turned(&self, axes: [DVec3; 3], extents: Option<[[f64; 2]; 3]>) -> Framing {
        let (low, high) = self.bounds;
        let of_bounds = axes.map(|axis| {
            let (middle, reach) = ((low + high).dot(axis), (high - low).dot(axis.abs()));
            [(middle - reach) / 2.0, (middle + reach) / 2.0]
        });
        let extents = extents.unwrap_or(of_bounds);
        let half = extents.map(|[least, most]| (most - least) / 2.0);
        let along = |place: [f64; 3]| axes[0] * place[0] + axes[1] * place[1] + axes[2] * place[2];
        let centre = along(extents.map(|[least, most]| (least + most) / 2.0));
        let largest = half.into_iter().fold(0.0, f64::max);
        Framing {
            centre,
            axes,
            height: (2.0 * half[1].max(0.1 * largest)).max(f64::MIN_POSITIVE),
            bounds: self.bounds,
            half,
            corners: std::array::from_fn(|i| {
                let side = |axis: usize| if i >> axis & 1 == 1 { 1.0 } else { -1.0 };
                centre + along([0, 1, 2].map(|axis| side(axis) * half[axis]))
            }),
        }
    }

    /// Half of what the box reaches along a unit vector.
    pub fn reach(&self, direction: DVec3) -> f64 {
        (0..3).map(|i| self.half[i] * self.axes[i].dot(direction).abs()).sum()
    }

    /// A model-relative point in world space.
    pub fn point(&self, p: [f64; 3]) -> DVec3 {
        self.centre + self.vector(p)
    }

    /// A model-relative vector in world space.
    pub fn vector(&self, v: [f64; 3]) -> DVec3 {
        self.height * self.direction(v)
    }

    /// A model-relative direction in world space, of unchanged length.
    pub fn direction(&self, v: [f64; 3]) -> DVec3 {
        self.axes[0] * v[0] + self.axes[1] * v[1] + self.axes[2] * v[2]
    }

    /// A world point in model-relative coordinates.
    pub fn relative(&self, p: DVec3) -> [f64; 3] {
        self.axes.map(|axis| (p - self.centre).dot(axis) / self.height)
    }

    /// A perspective camera; the near plane is as far as nothing is in front of it.
    pub fn camera(&self, eye: DVec3, target: DVec3, fov_y_deg: f64) -> Camera {
        let projection = Projection::Perspective { fov_y: fov_y_deg.to_radians() };
        // Looking along the up axis, the front is up in the picture.
        let along_up = (target - eye).normalize_or_zero().dot(self.axes[1]).abs() > 0.999;
        let up = if along_up { self.axes[2] } else { self.axes[1] };
        Camera { eye, target, up, projection, near: self.near(eye) }
    }

    /// Half the distance to the bounds, or a small part of the height inside them: reversed
    /// floating-point depth leaves precision enough.
    pub fn near(&self, eye: DVec3) -> f64 {
        let outside = (self.bounds.0 - eye).max(eye - self.bounds.1).max(DVec3::ZERO).length();
        (0.5 * outside).max(1e-4 * self.height)
    }

    /// A view from `direction` (model-relative) that fits the whole statue.
    pub fn fitting(&self, direction: [f64; 3], aspect: f64, fov_y_deg: f64) -> Camera {
        let direction = self.direction(direction).normalize_or(DVec3::Z);
        let mut camera = self.camera(self.centre + direction * self.height, self.centre, fov_y_deg);
        let [right, up, back] = camera.axes();
        let tangent = (fov_y_deg.to_radians() / 2.0).tan();
        // As near as every corner of the bounds allows, with a margin of 4 %.
        let mut distance: f64 = 0.0;
        for corner in self.corners {
            let corner = corner - self.centre;
            let needed =
                (corner.dot(up).abs() / tangent).max(corner.dot(right).abs() / (tangent * aspect));
            distance = distance.max(needed * 1.04 + corner.dot(back));
        }
        camera.eye = self.centre + back * distance;
        camera.near = self.near(camera.eye);
        camera
    }
}

/// Corners of a box.
fn corners((min, max): (DVec3, DVec3)) -> [DVec3; 8] {
    std::array::from_fn(|i| {
        let pick = |axis: usize| if i >> axis & 1 == 1 { max[axis] } else { min[axis] };
        DVec3::new(pick(0), pick(1), pick(2))
    })
}

/// Views that have a name.
pub const NAMED_VIEWS: [(&str, [f64; 3]); 7] = [
    ("front", [0.0, 0.0, 1.0]),
    ("back", [0.0, 0.0, -1.0]),
    ("left", [-1.0, 0.0, 0.0]),
    ("right", [1.0, 0.0, 0.0]),
    ("top", [0.0, 1.0, 0.0]),
    ("bottom", [0.0, -1.0, 0.0]),
    ("three-quarter", [0.62, 0.22, 0.76]),
];

#[cfg(test)]
mod tests {
    use super::*;

    fn framing() -> Framing {
        Framing::new((DVec3::new(-1.0, 2.0, -3.0), DVec3::new(5.0, 12.0, 1.0)), DVec3::Y, DVec3::Z)
    }

    #[test]
    fn relative_coordinates_go_there_and_back() {
        let f = framing();
        assert_eq!(f.height, 10.0);
        assert_eq!(f.point([0.0, 0.5, 0.0]), DVec3::new(2.0, 12.0, -1.0));
        let p = [0.3, -0.2, 1.5];
        let back = f.relative(f.point(p));
        assert!((0..3).all(|i| (back[i] - p[i]).abs() < 1e-12));
        // Right of someone who looks at the front.
        assert_eq!(f.axes[0], DVec3::X);
        assert_eq!(f.size(), [6.0, 10.0, 4.0]);
    }

    #[test]
    fn a_turned_statue_is_as_large_as_it_is_along_its_own_axes() {
        let turn = glam::DMat3::from_rotation_z(0.5);
        let axes = [turn.x_axis, turn.y_axis, turn.z_axis];
        let loose = framing().turned(axes, None);
        // A square of 2 round a corner of the bounds.
        let extents = axes.map(|axis| {
            let at = DVec3::new(1.0, 4.0, 0.0).dot(axis);
            [at - 1.0, at + 1.0]
        });
        let tight = framing().turned(axes, Some(extents));
        assert!(tight.centre.distance(DVec3::new(1.0, 4.0, 0.0)) < 1e-12);
        assert!(tight.size().iter().all(|side| (side - 2.0).abs() < 1e-12));
        assert!((tight.height - 2.0).abs() < 1e-12 && tight.bounds == framing().bounds);
        assert!(tight.corners.iter().all(|c| {
            let off = *c - tight.centre;
            axes.iter().all(|axis| (off.dot(*axis).abs() - 1.0).abs() < 1e-12)
        }));
        assert!((tight.reach(axes[1]) - 1.0).abs() < 1e-12);
        assert!((tight.reach(DVec3::X) - (0.5f64.cos() + 0.5f64.sin())).abs() < 1e-12);
        assert!(loose.size()[1] > 10.0, "{:?}", loose.size());
        // Not turned it is what it was.
        let same = framing().turned(framing().axes, None);
        assert_eq!((same.centre, same.size()), (framing().centre, framing().size()));
    }

    #[test]
    fn fitting_views_hold_all_of_the_bounds_and_not_much_more() {
        for (_, direction) in NAMED_VIEWS {
            let f = framing();
            let c = f.fitting(direction, 1.5, FOV_Y_DEG);
            let clip = c.clip_from_view(1.5) * c.view_from_world();
            let mut widest: f64 = 0.0;
            for i in 0..8 {
                let pick = |a: usize| if i >> a & 1 == 1 { f.bounds.1[a] } else { f.bounds.0[a] };
                let ndc = clip.project_point3(DVec3::new(pick(0), pick(1), pick(2)));
                widest = widest.max(ndc.x.abs()).max(ndc.y.abs());
            }
            assert!((0.9..=1.0).contains(&widest), "{direction:?}: {widest}");
        }
    }
}
