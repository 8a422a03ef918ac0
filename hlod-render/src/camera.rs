//! Where a picture is taken from.

use glam::{DMat4, DVec2, DVec3, DVec4, Mat4};

/// How depth becomes perspective.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// Vertical field of view in radians.
    Perspective {
        /// Angle between the lower and the upper edge.
        fov_y: f64,
    },
    /// Parallel rays.
    Orthographic {
        /// World length of the picture's height.
        height: f64,
    },
}

/// A camera in world space (source units).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Its position.
    pub eye: DVec3,
    /// A point straight ahead; must differ from the eye.
    pub target: DVec3,
    /// Any vector that is upwards in the picture; not parallel to the line of sight.
    pub up: DVec3,
    /// Perspective or parallel.
    pub projection: Projection,
    /// Distance of the near plane; perspective only.
    pub near: f64,
}

impl Camera {
    /// Unit vectors right, up and backwards in world space.
    pub fn axes(&self) -> [DVec3; 3] {
        let back = (self.eye - self.target).normalize_or(DVec3::Z);
        let right =
            self.up.cross(back).try_normalize().unwrap_or_else(|| back.any_orthonormal_vector());
        [right, back.cross(right), back]
    }

    /// View space: x right, y up, −z ahead.
    pub fn view_from_world(&self) -> DMat4 {
        let [right, up, back] = self.axes();
        let rotation = DMat4::from_cols(
            DVec4::new(right.x, up.x, back.x, 0.0),
            DVec4::new(right.y, up.y, back.y, 0.0),
            DVec4::new(right.z, up.z, back.z, 0.0),
            DVec4::W,
        );
        rotation * DMat4::from_translation(-self.eye)
    }

    /// Tangents of half the horizontal and vertical field of view, or half the width and height.
    pub fn half_extent(&self, aspect: f64) -> DVec2 {
        let y = match self.projection {
            Projection::Perspective { fov_y } => (fov_y / 2.0).tan(),
            Projection::Orthographic { height } => height / 2.0,
        };
        DVec2::new(y * aspect, y)
    }

    /// Clip space with reversed depth: 1 at the near plane, 0 at infinity (perspective) or behind
    /// everything within `depth_range` (orthographic).
    pub fn clip_from_view(&self, aspect: f64) -> DMat4 {
        let half = self.half_extent(aspect);
        match self.projection {
            Projection::Perspective { .. } => DMat4::from_cols(
                DVec4::new(1.0 / half.x, 0.0, 0.0, 0.0),
                DVec4::new(0.0, 1.0 / half.y, 0.0, 0.0),
                DVec4::new(0.0, 0.0, 0.0, -1.0),
                DVec4::new(0.0, 0.0, self.near, 0.0),
            ),
            Projection::Orthographic { .. } => {
                // What lies up to four times the eye's distance before or behind the target shows.
                let range = 4.0 * self.eye.distance(self.target);
                let depth = 1.0 / (2.0 * range);
                DMat4::from_cols(
                    DVec4::new(1.0 / half.x, 0.0, 0.0, 0.0),
                    DVec4::new(0.0, 1.0 / half.y, 0.0, 0.0),
                    DVec4::new(0.0, 0.0, depth, 0.0),
                    DVec4::new(0.0, 0.0, 0.5 + depth * (range / 4.0), 1.0),
                )
            }
        }
    }

    /// For shaders: computed in f64, rounded once. `offset` moves the picture, in clip space.
    pub fn clip_from_model(&self, world_from_model: DMat4, aspect: f64, offset: DVec2) -> Mat4 {
        let moved = DMat4::from_translation(offset.extend(0.0));
        (moved * self.clip_from_view(aspect) * self.view_from_world() * world_from_model).as_mat4()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(projection: Projection) -> Camera {
        Camera {
            eye: DVec3::new(3.0, 0.0, 0.0),
            target: DVec3::ZERO,
            up: DVec3::Y,
            projection,
            near: 0.1,
        }
    }

    #[test]
    fn perspective_puts_near_at_one_and_infinity_at_zero() {
        let c = camera(Projection::Perspective { fov_y: std::f64::consts::FRAC_PI_2 });
        let clip = c.clip_from_view(2.0) * c.view_from_world();
        let project = |p: DVec3| clip.project_point3(p);
        assert!((project(DVec3::new(2.9, 0.0, 0.0)).z - 1.0).abs() < 1e-9);
        assert!(project(DVec3::new(-1e9, 0.0, 0.0)).z < 1e-8);
        // 90° vertically: at distance 3 the upper edge is 3 above; twice as wide to the right (−z).
        let corner = project(DVec3::new(0.0, 3.0, -6.0));
        assert!((corner.x - 1.0).abs() < 1e-9 && (corner.y - 1.0).abs() < 1e-9, "{corner}");
    }

    #[test]
    fn orthographic_orders_depth_and_keeps_size() {
        let c = camera(Projection::Orthographic { height: 2.0 });
        let clip = c.clip_from_view(1.0) * c.view_from_world();
        let [near, far] = [2.0, -5.0].map(|x| clip.project_point3(DVec3::new(x, 1.0, 0.0)));
        assert!(near.z > far.z && near.z < 1.0 && far.z > 0.0);
        assert!((near.y - 1.0).abs() < 1e-9 && (far.y - 1.0).abs() < 1e-9);
    }
}
