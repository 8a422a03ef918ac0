//! Long sessions: frames along paths that never repeat, with little memory, and what they leave behind.

use std::path::Path;

use glam::DVec3;
use hlod_render::clip::ClipPlanes;
use hlod_render::framing::{FOV_Y_DEG, Framing};
use hlod_render::picture::{Canvas, PICTURE_FORMAT};
use hlod_render::scene::{
    BACKGROUND, CASTER_THRESHOLD_PX, INTENSITY_STEP, Material, Paint, Representation, Shadow, Shot,
    light_from_angles,
};
use hlod_render::section::Plane;
use hlod_render::{Gpu, Model, ModelLimits, RenderError, frame::Renderer};

use crate::fuzz::Mutator;
use crate::fuzz::memory::held;

/// What a session is like.
#[derive(Debug, Clone, Copy)]
pub struct SoakOptions {
    /// Frames drawn.
    pub frames: u32,
    /// Width and height of the picture in pixels.
    pub size: (u32, u32),
    /// Bytes of geometry on the GPU, and of the file in memory.
    pub cache_bytes: u64,
    /// The statue is closed and opened again after so many frames.
    pub frames_a_model: u32,
    /// Before the session begins the statue is opened for each kind of picture, which is drawn from so many places, so
    /// that drivers have made what they keep, at its largest.
    pub warm_up_places: u32,
    /// Seed of the path.
    pub seed: u64,
}

/// What a session came to.
#[derive(Debug, Clone)]
pub struct SoakReport {
    /// Means of the process' resident memory in bytes, of tenths of the session; none where the system
    /// does not say.
    pub resident_bytes: Vec<f64>,
    /// The same of what this program's own code holds, drivers left out; 0 where it is not counted.
    pub held_bytes: Vec<f64>,
    /// Open descriptors after the first tenth and at the end; 0 where the system does not say.
    pub descriptors: [usize; 2],
    /// Threads of the process, the same.
    pub threads: [usize; 2],
    /// Bytes read from the file.
    pub bytes_read: u64,
    /// Nodes drawn in all frames.
    pub nodes: u64,
    /// What went wrong in the background.
    pub problems: Vec<String>,
}

impl SoakReport {
    /// By what share the process' resident memory grew from its second tenth, when the statue was opened again once,
    /// to the last.
    pub fn resident_growth(&self) -> Option<f64> {
        growth(&self.resident_bytes)
    }

    /// The same of what the program itself holds.
    pub fn held_growth(&self) -> Option<f64> {
        growth(&self.held_bytes)
    }
}

/// Means of a fifth of what there is, because what is seen varies.
fn growth(means: &[f64]) -> Option<f64> {
    let tenth = means.len().div_ceil(10);
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let begin = mean(means.get(tenth..3 * tenth)?);
    let end = mean(means.get(means.len().checked_sub(2 * tenth)?..)?);
    (begin > 0.0).then_some(end / begin - 1.0)
}

/// Draws a session.
///
/// # Errors
/// When a frame cannot be drawn.
pub fn soak(
    gpu: &Gpu,
    file: &Path,
    options: &SoakOptions,
    progress: &mut dyn FnMut(u32, Option<u64>),
) -> Result<SoakReport, RenderError> {
    let limits = ModelLimits {
        gpu_bytes: options.cache_bytes,
        host_bytes: options.cache_bytes,
        ..ModelLimits::default()
    };
    let canvas = Canvas::new(gpu, options.size.0, options.size.1)?;
    let mut renderer = Renderer::new(gpu, PICTURE_FORMAT);
    let mut models = [Model::open(gpu, file, limits)?];
    let mut path = Wandering::new(Framing::of(&models[0]), options);
    for shots in path.warm_up(options.warm_up_places) {
        models = [Model::open(gpu, file, limits)?];
        for shot in shots {
            renderer.render(gpu, &mut models, &shot, &canvas.targets)?;
            gpu.wait()?;
        }
    }
    let tenth = (options.frames / 10).max(1);
    let mut report = SoakReport {
        resident_bytes: Vec::new(),
        held_bytes: Vec::new(),
        descriptors: [0; 2],
        threads: [0; 2],
        bytes_read: 0,
        nodes: 0,
        problems: Vec::new(),
    };
    let (mut in_tenth, mut held_in_tenth) = (Vec::with_capacity(tenth as usize), 0.0);
    for frame in 0..options.frames {
        if frame > 0 && frame % options.frames_a_model == 0 {
            report.bytes_read += models[0].bytes_read();
            models = [Model::open(gpu, file, limits)?];
        }
        let shot = path.next_shot();
        let stats = renderer.render(gpu, &mut models, &shot, &canvas.targets)?;
        report.nodes += stats.nodes as u64;
        report.problems.extend(models[0].take_problems());
        // As a window does, which shows each frame before the next.
        gpu.wait()?;
        in_tenth.extend(resident_bytes().map(|bytes| bytes as f64));
        held_in_tenth += held() as f64;
        if (frame + 1) % tenth == 0 {
            if !in_tenth.is_empty() {
                let mean = in_tenth.iter().sum::<f64>() / in_tenth.len() as f64;
                report.resident_bytes.push(mean);
                in_tenth.clear();
            }
            report.held_bytes.push(held_in_tenth / f64::from(tenth));
            held_in_tenth = 0.0;
            let place = usize::from(frame + 1 > tenth);
            report.descriptors[place] = entries("/proc/self/fd");
            report.threads[place] = entries("/proc/self/task");
            progress(frame + 1, resident_bytes());
        }
    }
    report.bytes_read += models[0].bytes_read();
    Ok(report)
}

/// A camera that wanders, and jumps now and then; with it the light, shadows and a cut.
struct Wandering {
    framing: Framing,
    random: Mutator,
    frame: u32,
    eye: DVec3,
    target: DVec3,
    towards: [DVec3; 2],
    shadow: Shadow,
    cut: Option<f64>,
}

impl Wandering {
    fn new(framing: Framing, options: &SoakOptions) -> Wandering {
        let mut path = Wandering {
            framing,
            random: Mutator::new(options.seed),
            frame: 0,
            eye: DVec3::ZERO,
            target: DVec3::ZERO,
            towards: [DVec3::ZERO; 2],
            shadow: Shadow::None,
            cut: None,
        };
        path.towards = path.place();
        [path.eye, path.target] = path.place();
        path
    }

    /// From -1 to 1.
    fn unit(&mut self) -> f64 {
        self.random.below(20_001) as f64 / 1e4 - 1.0
    }

    /// An eye and a target, from near the surface to far away.
    fn place(&mut self) -> [DVec3; 2] {
        let mut vector = || DVec3::new(self.unit(), self.unit(), self.unit());
        let (direction, target) = (vector().normalize_or(DVec3::Z), vector() * 0.3);
        let distance = 0.55 + 1.5 * self.unit().abs().powi(2);
        let height = self.framing.height;
        let target = self.framing.centre + target * height;
        [self.framing.centre + direction * distance * height, target]
    }

    /// Every kind of picture from so many places, a few frames each, in which parts arrive.
    fn warm_up(&mut self, places: u32) -> Vec<Vec<Shot>> {
        const FRAMES: u32 = 4;
        let kinds = [
            (Shadow::None, None),
            (Shadow::None, Some(0.0)),
            (Shadow::Hard, None),
            (Shadow::Soft, None),
        ];
        let mut of_kind = |(shadow, cut)| {
            let mut shots = Vec::new();
            for _ in 0..places {
                let [eye, target] = self.place();
                let shot = Moment { eye, target, shadow, cut, light_turn_deg: self.unit() * 180.0 };
                shots.extend((0..FRAMES).map(|_| shot.shot(&self.framing)));
            }
            shots
        };
        kinds.map(&mut of_kind).into()
    }

    fn next_shot(&mut self) -> Shot {
        if self.frame.is_multiple_of(90) {
            self.towards = self.place();
            self.shadow =
                [Shadow::None, Shadow::None, Shadow::Hard, Shadow::Soft][self.random.below(4)];
            let cut = self.unit() * 0.3;
            // Nothing casts shadows that is cut open.
            self.cut = (self.shadow == Shadow::None && self.random.below(3) == 0).then_some(cut);
        }
        if self.frame % 700 == 699 {
            [self.eye, self.target] = self.place();
        }
        self.frame += 1;
        self.eye = self.eye.lerp(self.towards[0], 0.03);
        self.target = self.target.lerp(self.towards[1], 0.03);
        let light_turn_deg = f64::from(self.frame % 360);
        let Wandering { eye, target, shadow, cut, .. } = *self;
        Moment { eye, target, shadow, cut, light_turn_deg }.shot(&self.framing)
    }
}

/// What differs from frame to frame.
#[derive(Clone, Copy)]
struct Moment {
    eye: DVec3,
    target: DVec3,
    shadow: Shadow,
    /// A plane across the statue, at a share of its height from its middle.
    cut: Option<f64>,
    light_turn_deg: f64,
}

impl Moment {
    fn shot(&self, framing: &Framing) -> Shot {
        let camera = framing.camera(self.eye, self.target, FOV_Y_DEG);
        let planes = self.cut.map(|cut| {
            let offset = framing.centre.y + cut * framing.height;
            Some(Plane { normal: DVec3::Y, offset })
        });
        let is_soft = self.shadow == Shadow::Soft;
        Shot {
            camera,
            light: light_from_angles(&camera, -45.0 + self.light_turn_deg, 30.0),
            spot: None,
            material: Material::default(),
            enhance: Default::default(),
            background: BACKGROUND,
            representation: Representation::Hybrid,
            paint: Paint::Shaded,
            error_threshold_px: 0.5,
            shadow: self.shadow,
            light_size: if is_soft { 3.0 } else { 0.0 },
            caster_threshold_px: CASTER_THRESHOLD_PX,
            intensity_step: INTENSITY_STEP,
            sample_offset_px: glam::DVec2::ZERO,
            draw_backs: false,
            backs_magenta: false,
            draw_skirts: true,
            mixing: hlod_render::scene::Mixing::None,
            clip: ClipPlanes::new(planes),
        }
    }
}

/// What this process has of memory, in bytes.
fn resident_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/statm").ok()?;
    let pages: u64 = text.split_whitespace().nth(1)?.parse().ok()?;
    Some(pages * 4096)
}

fn entries(folder: &str) -> usize {
    std::fs::read_dir(folder).map_or(0, |entries| entries.count())
}
