//! Views all round a statue.

use crate::camera::Camera;
use crate::framing::{FOV_Y_DEG, Framing};

/// Cameras at equal angles all round, at one distance from the centre of the bounds, from which all of
/// the statue is in every picture; the first is before it, and it turns to the left: the next ones see
/// more of its right side. `elevation_deg` is how far above the horizon they are.
pub fn cameras(framing: &Framing, frames: u32, elevation_deg: f64, aspect: f64) -> Vec<Camera> {
    let directions = directions(frames, elevation_deg);
    let fitting = |d: &[f64; 3]| framing.fitting(*d, aspect, FOV_Y_DEG);
    let distance = |camera: &Camera| camera.eye.distance(framing.centre);
    let farthest = directions.iter().map(|d| distance(&fitting(d))).fold(0.0, f64::max);
    let place = |d: &[f64; 3]| {
        let eye = framing.centre + framing.direction(*d) * farthest;
        framing.camera(eye, framing.centre, FOV_Y_DEG)
    };
    directions.iter().map(place).collect()
}

/// The same in parallel projection, all of one scale.
pub fn parallel_cameras(
    framing: &Framing,
    frames: u32,
    elevation_deg: f64,
    aspect: f64,
) -> Vec<Camera> {
    let cameras = cameras(framing, frames, elevation_deg, aspect);
    let height = |c: &Camera| super::camera::fitting(framing, c, aspect).half_extent(1.0).y * 2.0;
    let highest = cameras.iter().map(height).fold(0.0, f64::max);
    let parallel = |c: &Camera| super::camera::orthographic(framing, c.axes()[2], c.up, highest);
    cameras.iter().map(parallel).collect()
}

fn directions(frames: u32, elevation_deg: f64) -> Vec<[f64; 3]> {
    let (sin_e, cos_e) = elevation_deg.to_radians().sin_cos();
    let direction = |i: u32| {
        let azimuth = std::f64::consts::TAU * f64::from(i) / f64::from(frames);
        [azimuth.sin() * cos_e, sin_e, azimuth.cos() * cos_e]
    };
    (0..frames).map(direction).collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn every_view_is_as_far_away_and_turns_by_the_same_angle() {
        let bounds = (DVec3::new(-1.0, 0.0, -3.0), DVec3::new(5.0, 12.0, 1.0));
        let framing = Framing::new(bounds, DVec3::Y, DVec3::Z);
        let cameras = cameras(&framing, 12, 10.0, 0.8);
        assert_eq!(cameras.len(), 12);
        let way = |c: &Camera| c.eye - framing.centre;
        let first = way(&cameras[0]);
        assert!(first.x.abs() < 1e-9 && first.z > 0.0, "the first is before it");
        assert!(way(&cameras[3]).x > 0.0, "then comes its right side");
        for (a, b) in cameras.iter().zip(cameras.iter().cycle().skip(1)) {
            let (a, b) = (way(a), way(b));
            assert!((a.length() - first.length()).abs() < 1e-9);
            assert!(((a.y / a.length()).asin().to_degrees() - 10.0).abs() < 1e-9);
            let turn = DVec3::new(a.x, 0.0, a.z).angle_between(DVec3::new(b.x, 0.0, b.z));
            assert!((turn.to_degrees() - 30.0).abs() < 1e-6);
        }
        for camera in &cameras {
            let clip = camera.clip_from_view(0.8) * camera.view_from_world();
            for i in 0..8 {
                let pick = |a: usize| if i >> a & 1 == 1 { bounds.1[a] } else { bounds.0[a] };
                let p = clip.project_point3(DVec3::new(pick(0), pick(1), pick(2)));
                assert!(p.x.abs() <= 1.0 && p.y.abs() <= 1.0, "{p}");
            }
        }
    }
}
