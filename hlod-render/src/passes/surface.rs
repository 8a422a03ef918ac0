//! The surface in fixed function: every range into identity and depth, or, where small triangles are rasterised in
//! compute, what they leave.

use super::resources::{
    Constants, attachment, buffer, nearest, pipeline_layout, render_pipeline, write_growing,
};
use super::small::{self, SmallTriangles};
use super::targets::IDENTITY_FORMAT;
use super::{Range, RangePipeline, Rectangle, Targets};
use crate::gpu::Gpu;

/// Bytes of one draw's arguments.
const DRAW_BYTES: u64 = 16;

/// Its pipelines, and the draws of a frame.
pub(super) struct Surface {
    culled: wgpu::RenderPipeline,
    two_sided: wgpu::RenderPipeline,
    splats: wgpu::RenderPipeline,
    indirect: wgpu::Buffer,
}

impl Surface {
    pub(super) fn new(
        gpu: &Gpu,
        geometry_layout: &wgpu::BindGroupLayout,
        constants: &Constants,
    ) -> Surface {
        let layout = pipeline_layout(gpu, "surface", &[Some(geometry_layout)]);
        let pipeline = |pass, cull| {
            render_pipeline(gpu, &layout, pass, cull, IDENTITY_FORMAT, nearest(), constants)
        };
        Surface {
            culled: pipeline(hlod_shaders::SURFACE, Some(wgpu::Face::Back)),
            two_sided: pipeline(hlod_shaders::SURFACE, None),
            splats: pipeline(hlod_shaders::SPLATS, None),
            indirect: buffer(gpu, "draws", 1024 * DRAW_BYTES, wgpu::BufferUsages::INDIRECT),
        }
    }

    /// Uploads the draws of a frame's ranges.
    pub(super) fn prepare(&mut self, gpu: &Gpu, ranges: &[&Range]) {
        let draws: Vec<[u32; 4]> = ranges
            .iter()
            .map(|r| [3 * (r.triangles.end - r.triangles.start), 1, 3 * r.triangles.start, 0])
            .collect();
        write_growing(gpu, &mut self.indirect, bytemuck::cast_slice(&draws));
    }

    /// The render pass that clears and fills identity and depth. `ranges` are those prepared, the same pipelines next
    /// to one another; `small` has rasterised them where there is one, and draws what it left and found.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        small: Option<(&SmallTriangles, &small::Work)>,
        ranges: &[&Range],
        geometry: &[(&wgpu::BindGroup, u32)],
        (depth, area, targets): (&wgpu::TextureView, Rectangle, &Targets),
    ) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("surface"),
            color_attachments: &[attachment(targets.identity_view(), wgpu::Color::TRANSPARENT)],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_scissor_rect(area.x, area.y, area.width, area.height);
        match small {
            Some((small, work)) => small.draw(&mut pass, work, geometry, targets),
            None => self.draw(&mut pass, ranges, geometry),
        }
    }

    /// One indirect draw for all ranges next to one another that have an arena and a pipeline in common.
    fn draw(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        ranges: &[&Range],
        geometry: &[(&wgpu::BindGroup, u32)],
    ) {
        let mut first = 0;
        for group in ranges.chunk_by(|a, b| (a.uniform, a.pipeline()) == (b.uniform, b.pipeline()))
        {
            pass.set_pipeline(match group[0].pipeline() {
                RangePipeline::TwoSided => &self.two_sided,
                RangePipeline::Culled => &self.culled,
                RangePipeline::Splats => &self.splats,
            });
            let (bind_group, offset) = geometry[group[0].uniform];
            pass.set_bind_group(0, bind_group, &[offset]);
            pass.multi_draw_indirect(&self.indirect, first * DRAW_BYTES, group.len() as u32);
            first += group.len() as u64;
        }
    }
}
