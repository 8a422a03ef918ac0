//! Passes of whole statues and of those that are cut open.

use super::Passes;
use crate::gpu::Gpu;
use crate::scene::Shot;

/// Both, the second once it was needed.
pub(crate) struct PassSets {
    whole: Passes,
    clipped: Option<Passes>,
    output: wgpu::TextureFormat,
}

impl PassSets {
    /// Compiles the first; `output` is the format of the pictures.
    pub(crate) fn new(gpu: &Gpu, output: wgpu::TextureFormat) -> PassSets {
        PassSets { whole: Passes::new(gpu, output, false), clipped: None, output }
    }

    /// Those that draw a shot.
    pub(crate) fn of(&mut self, gpu: &Gpu, shot: &Shot) -> &mut Passes {
        if shot.clip.is_none() {
            return &mut self.whole;
        }
        let output = self.output;
        self.clipped.get_or_insert_with(|| Passes::new(gpu, output, true))
    }

    /// What both can do, they can do alike.
    pub(crate) fn whole(&self) -> &Passes {
        &self.whole
    }
}
