//! Pictures of one view under many lights, for relighting and photometric stereo.
//!
//! Lights lie on a spiral over the hemisphere before the camera: the k-th of N has the height
//! z = 1 − (k + ½) / N along the line of sight, so that every light stands for the same area of the sphere
//! (Archimedes), and is turned by the golden angle from the one before (Vogel 1979; Swinbank & Purser
//! 2006, Fibonacci grids). Pictures are of Lambert's law alone: no highlight, no ambient light, the
//! same albedo, and every light as strong as any other. Values are coded by the sRGB curve, which has to
//! be undone before they are compared.

use std::fmt::Write;

use glam::DVec3;

use crate::camera::Camera;
use crate::scene::{Light, Material};

const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// Unit vectors towards N lights in coordinates of the picture: x right, y up, z towards the viewer.
pub fn directions(lights: u32) -> Vec<DVec3> {
    let direction = |k: u32| {
        let z = 1.0 - (f64::from(k) + 0.5) / f64::from(lights);
        let radius = (1.0 - z * z).max(0.0).sqrt();
        let (sin, cos) = (f64::from(k) * GOLDEN_ANGLE).sin_cos();
        DVec3::new(radius * cos, radius * sin, z)
    };
    (0..lights).map(direction).collect()
}

/// A light as a shot has it, for a picture taken by `camera`.
pub fn light(camera: &Camera, direction: DVec3) -> Light {
    let [right, up, back] = camera.axes();
    Light::Directional(right * direction.x + up * direction.y + back * direction.z)
}

/// Lambert's law and nothing else.
pub fn material(material: &Material) -> Material {
    Material { highlight: 0.0, ambient: 0.0, ..*material }
}

/// Name of a light's picture; lights are counted from 0.
pub fn picture_name(light: u32) -> String {
    format!("light-{:04}.png", light + 1)
}

/// The list of lights as tools for reflectance transformation imaging read it: how many, then for each the
/// picture's name and the light's direction.
pub fn list(directions: &[DVec3]) -> String {
    let mut text = format!("{}\n", directions.len());
    for (k, d) in directions.iter().enumerate() {
        let name = picture_name(k as u32);
        let _ = writeln!(text, "{name} {:.9} {:.9} {:.9}", d.x, d.y, d.z);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_are_spread_evenly_over_the_hemisphere() {
        for count in [1, 4, 64, 500] {
            let all = directions(count);
            assert_eq!(all.len() as u32, count);
            assert!(all.iter().all(|d| (d.length() - 1.0).abs() < 1e-12 && d.z > 0.0));
        }
        let all = directions(200);
        // The mean of a hemisphere is half way to its pole.
        let mean = all.iter().sum::<DVec3>() / 200.0;
        assert!(mean.distance(DVec3::new(0.0, 0.0, 0.5)) < 0.01, "{mean}");
        // Discs of 200 lights have a radius of 0.1 rad: neighbours are about two apart.
        for (i, a) in all.iter().enumerate() {
            let others = all.iter().enumerate().filter(|(j, _)| *j != i);
            let nearest = others.map(|(_, b)| a.angle_between(*b)).fold(9.0, f64::min);
            assert!((0.1..0.26).contains(&nearest), "{i}: {nearest}");
        }
    }

    #[test]
    fn the_list_is_as_tools_read_it() {
        let text = list(&directions(3));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!((lines[0], lines.len()), ("3", 4));
        let words: Vec<&str> = lines[1].split(' ').collect();
        assert_eq!((words[0], words.len()), ("light-0001.png", 4));
        let z: f64 = words[3].parse().unwrap();
        assert!((z - (1.0 - 0.5 / 3.0)).abs() < 1e-8);
    }
}
