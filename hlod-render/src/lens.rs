//! From pixels of the picture to points of the world and back.

use glam::{DVec2, DVec3};

use crate::camera::{Camera, Projection};

/// A camera together with the size of its picture in pixels. Pixels are counted from the upper
/// left corner; (0.5, 0.5) is the centre of the first one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Where the picture is taken from.
    pub camera: Camera,
    /// Width and height in pixels, both at least 1.
    pub size: DVec2,
}

impl Lens {
    /// World point seen at `pixel`, `depth` ahead of the eye along the line of sight.
    pub fn point_at(&self, pixel: DVec2, depth: f64) -> DVec3 {
        let [right, up, back] = self.camera.axes();
        let across = self.across(pixel) * self.spread(depth);
        self.camera.eye + right * across.x + up * across.y - back * depth
    }

    /// Origin and unit direction of the ray on which everything lies that is seen at `pixel`.
    pub fn ray(&self, pixel: DVec2) -> (DVec3, DVec3) {
        let ahead = self.point_at(pixel, 1.0);
        match self.camera.projection {
            Projection::Perspective { .. } => {
                let eye = self.camera.eye;
                (eye, (ahead - eye).normalize_or(-self.camera.axes()[2]))
            }
            // What is beside the eye is seen, too.
            Projection::Orthographic { .. } => {
                let back = self.camera.axes()[2];
                let range = self.camera.eye.distance(self.camera.target);
                (self.point_at(pixel, -range), -back)
            }
        }
    }

    /// Depth of a world point ahead of the eye; negative behind it.
    pub fn depth_of(&self, point: DVec3) -> f64 {
        (self.camera.eye - point).dot(self.camera.axes()[2])
    }

    /// Where a world point is seen; `None` behind a perspective eye.
    pub fn pixel_of(&self, point: DVec3) -> Option<DVec2> {
        let [right, up, _] = self.camera.axes();
        let depth = self.depth_of(point);
        let spread = self.spread(depth);
        if spread <= 0.0 {
            return None;
        }
        let offset = point - self.camera.eye;
        let half = self.camera.half_extent(self.aspect());
        let ndc = DVec2::new(offset.dot(right), offset.dot(up)) / (half * spread);
        Some((DVec2::new(ndc.x, -ndc.y) + 1.0) / 2.0 * self.size)
    }

    /// World length of a pixel at a depth.
    pub fn pixel_length(&self, depth: f64) -> f64 {
        2.0 * self.camera.half_extent(self.aspect()).y * self.spread(depth) / self.size.y
    }

    /// Depth ahead of the eye from a value of the depth buffer: the inverse of
    /// [`Camera::clip_from_view`]. `None` where nothing is drawn.
    pub fn depth_from_buffer(&self, value: f64) -> Option<f64> {
        if value <= 0.0 || !value.is_finite() {
            return None;
        }
        match self.camera.projection {
            Projection::Perspective { .. } => Some(self.camera.near / value),
            Projection::Orthographic { .. } => {
                // Depth falls linearly along the line of sight: two values tell how.
                let clip = self.camera.clip_from_view(self.aspect());
                let at = |z: f64| clip.project_point3(DVec3::new(0.0, 0.0, -z)).z;
                Some((value - at(0.0)) / (at(1.0) - at(0.0)))
            }
        }
    }

    /// Offset from the line of sight at depth 1 (perspective) or in world units (parallel).
    fn across(&self, pixel: DVec2) -> DVec2 {
        let ndc = pixel / self.size * 2.0 - 1.0;
        self.camera.half_extent(self.aspect()) * DVec2::new(ndc.x, -ndc.y)
    }

    /// How much wider the picture is at a depth than what [`Camera::half_extent`] says.
    fn spread(&self, depth: f64) -> f64 {
        match self.camera.projection {
            Projection::Perspective { .. } => depth,
            Projection::Orthographic { .. } => 1.0,
        }
    }

    fn aspect(&self) -> f64 {
        self.size.x / self.size.y
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens(projection: Projection) -> Lens {
        let camera = Camera {
            eye: DVec3::new(10_003.0, 2.0, 1.0),
            target: DVec3::new(10_000.0, 1.0, 0.0),
            up: DVec3::Y,
            projection,
            near: 0.1,
        };
        Lens { camera, size: DVec2::new(800.0, 600.0) }
    }

    #[test]
    fn pixels_go_to_points_and_back_with_the_depth_of_the_buffer() {
        for projection in
            [Projection::Perspective { fov_y: 0.6 }, Projection::Orthographic { height: 2.5 }]
        {
            let lens = lens(projection);
            for (x, y, depth) in [(400.0, 300.0, 3.0), (0.5, 599.5, 0.7), (731.0, 12.0, 9.0)] {
                let pixel = DVec2::new(x, y);
                let point = lens.point_at(pixel, depth);
                assert!((lens.depth_of(point) - depth).abs() < 1e-9);
                assert!(lens.pixel_of(point).is_some_and(|p| p.distance(pixel) < 1e-6));
                // As the renderer's own matrices see it.
                let camera = lens.camera;
                let clip = camera.clip_from_view(800.0 / 600.0) * camera.view_from_world();
                let ndc = clip.project_point3(point);
                assert!((ndc.x - (x / 400.0 - 1.0)).abs() < 1e-8, "{projection:?}: {ndc}");
                assert!((ndc.y - (1.0 - y / 300.0)).abs() < 1e-8, "{projection:?}: {ndc}");
                let read = lens.depth_from_buffer(ndc.z);
                assert!(read.is_some_and(|d| (d - depth).abs() < 1e-6), "{projection:?}: {read:?}");
            }
            assert_eq!(lens.depth_from_buffer(0.0), None);
            assert_eq!(lens.depth_from_buffer(f64::NAN), None);
        }
    }

    #[test]
    fn a_pixel_is_as_long_as_its_distance_to_the_next() {
        let lens = lens(Projection::Perspective { fov_y: 0.6 });
        let step = lens
            .point_at(DVec2::new(7.0, 8.0), 4.0)
            .distance(lens.point_at(DVec2::new(7.0, 9.0), 4.0));
        assert!((step - lens.pixel_length(4.0)).abs() < 1e-9);
        assert_eq!(lens.pixel_of(lens.camera.eye + (lens.camera.eye - lens.camera.target)), None);
    }
}
