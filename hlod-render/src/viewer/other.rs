//! A second statue beside the first: the same camera and light, on the right of a line.

use std::path::Path;

use glam::{DVec2, DVec3};

use super::gui::Scene;
use crate::camera::{Camera, Projection};
use crate::error::RenderError;
use crate::figure::scale::millimetres;
use crate::frame::Renderer;
use crate::framing::Framing;
use crate::gpu::Gpu;
use crate::model::{Model, ModelLimits};
use crate::scene::{Representation, Shot};

/// The second statue.
pub struct Other {
    /// What it is called on the picture.
    pub name: String,
    /// Whether it is not where the first is, so that each is seen about its own middle.
    pub is_moved: bool,
    models: [Model; 1],
    renderer: Renderer,
    format: wgpu::TextureFormat,
    scene: Scene,
    /// What is worth knowing of it, until it was told.
    problems: Vec<String>,
    placed: Placed,
    drawn: Option<(Shot, DVec2)>,
}

/// Where the second statue is seen as the first is: its coordinates are `scale` times the first one's, plus `offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Placed {
    scale: f64,
    offset: DVec3,
}

impl Other {
    /// Opens it beside the first; `format` is that of the window's pictures.
    ///
    /// # Errors
    /// When it cannot be shown.
    pub fn open(
        gpu: &Gpu,
        file: &Path,
        limits: ModelLimits,
        representation: Representation,
        format: wgpu::TextureFormat,
        first: &Model,
    ) -> Result<Other, RenderError> {
        let model = Model::open(gpu, file, limits)?;
        representation.check(model.header()).map_err(RenderError::Usage)?;
        let units = [first, &model].map(|m| m.header().unit);
        let lengths = units.map(millimetres);
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let scale = match lengths {
            [Some(here), Some(there)] => here / there,
            _ => 1.0,
        };
        let is_unsure = units[0] != units[1] && lengths.contains(&None);
        let problem = is_unsure.then(|| {
            let [here, there] = units.map(hlod_compress::Unit::name);
            format!(
                "{name} is in {there}, the first statue in {here}: lengths are taken as they are"
            )
        });
        let placed = Placed::new(&Framing::of(first), &Framing::of(&model), scale);
        Ok(Other {
            name,
            problems: problem.into_iter().collect(),
            is_moved: placed.offset != DVec3::ZERO,
            models: [model],
            renderer: Renderer::new(gpu, format.add_srgb_suffix()),
            format,
            scene: Scene::new(gpu, format, 1, 1),
            placed,
            drawn: None,
        })
    }

    /// Draws it as the first is drawn, if it looks different from the last time or parts of it have
    /// been on their way. Returns whether it did.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn draw(&mut self, gpu: &Gpu, shot: &Shot, size: DVec2) -> Result<bool, RenderError> {
        let Placed { scale, offset } = self.placed;
        let camera = self.placed.camera(&shot.camera);
        let clip = shot.clip.scaled(scale).moved(offset);
        let shot = Shot { camera, clip, ..*shot };
        if self.drawn == Some((shot, size)) && !self.is_loading() {
            return Ok(false);
        }
        let pixels = size.as_uvec2();
        let targets = &self.scene.targets;
        if (targets.width(), targets.height()) != (pixels.x, pixels.y) {
            self.scene = Scene::new(gpu, self.format, pixels.x, pixels.y);
        }
        self.renderer.render(gpu, &mut self.models, &shot, &self.scene.targets)?;
        self.drawn = Some((shot, size));
        Ok(true)
    }

    /// Its picture.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// What went wrong since it was asked last.
    pub fn take_problems(&mut self) -> Vec<String> {
        let mut problems = std::mem::take(&mut self.problems);
        problems.extend(self.models[0].take_problems());
        problems
    }

    /// Whether parts are on their way.
    pub fn is_loading(&self) -> bool {
        self.models[0].is_loading()
    }
}

impl Placed {
    /// About its own middle; as it is where they meet, as scans of one statue in one coordinate system do. The first
    /// statue's unit is `scale` of the second one's.
    fn new(first: &Framing, second: &Framing, scale: f64) -> Placed {
        let ((low, high), (other_low, other_high)) = (first.bounds, second.bounds);
        let (low, high) = (low * scale, high * scale);
        let meet = low.cmple(other_high).all() && other_low.cmple(high).all();
        let offset = if meet { DVec3::ZERO } else { second.centre - first.centre * scale };
        Placed { scale, offset }
    }

    /// What sees the second statue as this one sees the first.
    fn camera(&self, camera: &Camera) -> Camera {
        let place = |p: DVec3| p * self.scale + self.offset;
        let projection = match camera.projection {
            Projection::Orthographic { height } => {
                Projection::Orthographic { height: height * self.scale }
            }
            perspective => perspective,
        };
        Camera {
            eye: place(camera.eye),
            target: place(camera.target),
            near: camera.near * self.scale,
            projection,
            ..*camera
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statues_that_meet_stay_and_others_are_seen_about_their_own_middle() {
        let of = |low: f64, high: f64| {
            Framing::new((DVec3::splat(low), DVec3::splat(high)), DVec3::Y, DVec3::Z)
        };
        let offset =
            |first: &Framing, second: &Framing, scale| Placed::new(first, second, scale).offset;
        assert_eq!(offset(&of(0.0, 2.0), &of(1.0, 5.0), 1.0), DVec3::ZERO);
        assert_eq!(offset(&of(0.0, 2.0), &of(9.0, 11.0), 1.0), DVec3::splat(9.0));
        // The same statue in mm and in m, and once more beside itself.
        assert_eq!(offset(&of(1000.0, 2000.0), &of(1.0, 2.0), 1e-3), DVec3::ZERO);
        assert_eq!(offset(&of(0.0, 1000.0), &of(2.0, 3.0), 1e-3), DVec3::splat(2.0));
    }

    /// What is seen of a place in one unit is seen of the same place in another.
    #[test]
    fn a_statue_in_another_unit_is_seen_in_the_same_place() {
        let of = |low: f64, high: f64| {
            Framing::new((DVec3::splat(low), DVec3::splat(high)), DVec3::Y, DVec3::Z)
        };
        let placed = Placed::new(&of(0.0, 1000.0), &of(2.0, 3.0), 1e-3);
        for projection in
            [Projection::Perspective { fov_y: 0.6 }, Projection::Orthographic { height: 1500.0 }]
        {
            let (eye, target) = (DVec3::new(300.0, 900.0, 4000.0), DVec3::splat(480.0));
            let first = Camera { eye, target, up: DVec3::Y, projection, near: 100.0 };
            let second = placed.camera(&first);
            let seen = |camera: &Camera, p: DVec3| {
                let clip = camera.clip_from_view(1.5) * camera.view_from_world();
                clip.project_point3(p)
            };
            for p in [DVec3::ZERO, DVec3::new(100.0, 1000.0, 700.0)] {
                let there = p * 1e-3 + 2.0;
                let off = seen(&first, p).distance(seen(&second, there));
                assert!(off < 1e-9, "{off}");
            }
        }
    }
}
