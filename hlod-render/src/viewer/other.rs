//! A second statue beside the first: the same camera and light, on the right of a line.

use std::path::Path;

use glam::{DVec2, DVec3};

use super::gui::Scene;
use crate::camera::Camera;
use crate::error::RenderError;
use crate::frame::{Renderer, check_models};
use crate::framing::Framing;
use crate::gpu::Gpu;
use crate::model::{Model, ModelLimits};
use crate::scene::{Representation, Shadow, Shot};

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
    /// From the first statue's middle to its own, where they do not meet.
    offset: DVec3,
    drawn: Option<(Shot, DVec2)>,
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
        let offset = apart(&Framing::of(first), &Framing::of(&model));
        let units = [first, &model].map(|m| m.header().unit);
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let differ = units[0] != units[1];
        let problem = differ.then(|| {
            let [here, there] = units.map(hlod_compress::Unit::name);
            format!(
                "{name} is in {there}, the first statue in {here}: lengths are taken as they are"
            )
        });
        Ok(Other {
            name,
            problems: problem.into_iter().collect(),
            is_moved: offset != DVec3::ZERO,
            models: [model],
            renderer: Renderer::new(gpu, format.add_srgb_suffix()),
            format,
            scene: Scene::new(gpu, format, 1, 1),
            offset,
            drawn: None,
        })
    }

    /// Draws it as the first is drawn, if it looks different from the last time or parts of it have
    /// been on their way. Returns whether it did.
    ///
    /// # Errors
    /// When the GPU fails.
    pub fn draw(&mut self, gpu: &Gpu, shot: &Shot, size: DVec2) -> Result<bool, RenderError> {
        let camera = Camera {
            eye: shot.camera.eye + self.offset,
            target: shot.camera.target + self.offset,
            ..shot.camera
        };
        let clip = shot.clip.moved(self.offset);
        let mut shot = Shot { camera, clip, ..*shot };
        if check_models(&self.models, shot.shadow).is_err() {
            shot.shadow = Shadow::Hard;
        }
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

/// From one statue's middle to the other's; nothing where they meet, as scans of one statue in one
/// coordinate system do.
fn apart(first: &Framing, second: &Framing) -> DVec3 {
    let ((low, high), (other_low, other_high)) = (first.bounds, second.bounds);
    let meet = low.cmple(other_high).all() && other_low.cmple(high).all();
    if meet { DVec3::ZERO } else { second.centre - first.centre }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statues_that_meet_stay_and_others_are_seen_about_their_own_middle() {
        let of = |low: f64, high: f64| {
            Framing::new((DVec3::splat(low), DVec3::splat(high)), DVec3::Y, DVec3::Z)
        };
        assert_eq!(apart(&of(0.0, 2.0), &of(1.0, 5.0)), DVec3::ZERO);
        assert_eq!(apart(&of(0.0, 2.0), &of(9.0, 11.0)), DVec3::splat(9.0));
    }
}
