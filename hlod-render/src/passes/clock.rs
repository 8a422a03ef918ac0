//! When the stages of a frame were done, by the GPU's own clock.

use std::sync::Mutex;

use crate::error::RenderError;
use crate::gpu::Gpu;

/// More stages of a frame than these are not told apart: six faces of a lamp have fewer than 30.
const MARKS_MAX: u32 = 64;

/// Takes the time between stages, where the device was opened for it; else does nothing.
pub(super) struct StageClock(Option<Queries>);

struct Queries {
    set: wgpu::QuerySet,
    ticks: wgpu::Buffer,
    /// What ended at each tick of the frame: nothing at the first.
    marks: Mutex<Vec<&'static str>>,
}

impl StageClock {
    pub(super) fn new(gpu: &Gpu) -> StageClock {
        StageClock(gpu.is_timed.then(|| Queries {
            set: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("stages"),
                ty: wgpu::QueryType::Timestamp,
                count: MARKS_MAX,
            }),
            ticks: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("stages"),
                size: 8 * u64::from(MARKS_MAX),
                usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
            marks: Mutex::default(),
        }))
    }

    /// A frame begins.
    pub(super) fn begin(&self, encoder: &mut wgpu::CommandEncoder) {
        if let Some(queries) = &self.0 {
            queries.marks().clear();
        }
        self.mark(encoder, "");
    }

    /// `stage` ends, between passes.
    pub(super) fn mark(&self, encoder: &mut wgpu::CommandEncoder, stage: &'static str) {
        if let Some((set, index)) = self.next(stage) {
            encoder.write_timestamp(set, index);
        }
    }

    /// `stage` ends, within a pass.
    pub(super) fn mark_within(&self, pass: &mut wgpu::ComputePass<'_>, stage: &'static str) {
        if let Some((set, index)) = self.next(stage) {
            pass.write_timestamp(set, index);
        }
    }

    /// The frame ends.
    pub(super) fn end(&self, encoder: &mut wgpu::CommandEncoder) {
        if let Some(queries) = &self.0 {
            let count = queries.marks().len() as u32;
            encoder.resolve_query_set(&queries.set, 0..count, &queries.ticks, 0);
        }
    }

    /// Milliseconds of each stage of the last frame, in the order in which they first were; none where no time is
    /// taken. Waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub(super) fn read(&self, gpu: &Gpu) -> Result<Vec<(&'static str, f64)>, RenderError> {
        let Some(queries) = &self.0 else { return Ok(Vec::new()) };
        let marks = queries.marks().clone();
        let bytes = gpu.read_buffer(&queries.ticks, 8 * marks.len().max(1) as u64)?;
        let ticks: Vec<u64> = bytemuck::pod_collect_to_vec(&bytes);
        Ok(between(&marks, &ticks, f64::from(gpu.queue.get_timestamp_period()) / 1e6))
    }

    fn next(&self, stage: &'static str) -> Option<(&wgpu::QuerySet, u32)> {
        let queries = self.0.as_ref()?;
        let mut marks = queries.marks();
        let index = marks.len() as u32;
        (index < MARKS_MAX).then(|| {
            marks.push(stage);
            (&queries.set, index)
        })
    }
}

impl Queries {
    fn marks(&self) -> std::sync::MutexGuard<'_, Vec<&'static str>> {
        self.marks.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

/// Milliseconds from each tick to the next, summed by what ended then.
fn between(marks: &[&'static str], ticks: &[u64], tick_ms: f64) -> Vec<(&'static str, f64)> {
    let mut stages: Vec<(&'static str, f64)> = Vec::new();
    for (stage, pair) in marks.iter().skip(1).zip(ticks.windows(2)) {
        // Clocks of some drivers step back a little.
        let ms = pair[1].saturating_sub(pair[0]) as f64 * tick_ms;
        match stages.iter_mut().find(|(name, _)| name == stage) {
            Some((_, sum)) => *sum += ms,
            None => stages.push((stage, ms)),
        }
    }
    stages
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_of_a_lamp_add_up() {
        let marks = ["", "surface", "casters", "look-up", "casters", "look-up"];
        let ticks = [100, 103, 110, 111, 131, 130, 7];
        let stages = between(&marks, &ticks, 0.5);
        assert_eq!(stages, [("surface", 1.5), ("casters", 13.5), ("look-up", 0.5)]);
        assert!(between(&[], &[0], 1.0).is_empty());
    }
}
