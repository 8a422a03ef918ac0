//! Shading that looks at how the surface bends: the directions of all visible points first, into a texture, so that
//! each pixel can ask those round it, whichever model and arena they are of.

use super::resources::{Constants, attachment};
use super::targets::{RELIEF_FORMAT, Targets};
use crate::gpu::Gpu;
use crate::passes::Rectangle;

/// What both passes are made with.
pub(super) struct ReliefLayout<'a> {
    pub(super) layout: &'a wgpu::PipelineLayout,
    /// Passes where something was drawn.
    pub(super) depth: wgpu::DepthStencilState,
    /// Format of the pictures.
    pub(super) output: wgpu::TextureFormat,
    pub(super) constants: &'a Constants,
}

/// The pass that writes directions, and the shading that reads them.
pub(super) struct Relief {
    directions: wgpu::RenderPipeline,
    pub(super) shade: wgpu::RenderPipeline,
}

impl Relief {
    pub(super) fn new(gpu: &Gpu, of: &ReliefLayout<'_>) -> Relief {
        let pass = hlod_shaders::SHADE;
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("relief"),
            source: wgpu::ShaderSource::Wgsl(pass.source.into()),
        });
        let constants = [of.constants[0], ("RELIEF", 1.0)];
        let options =
            wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
        let pipeline = |fragment, format: wgpu::TextureFormat| {
            gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(fragment),
                layout: Some(of.layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("shade_vertex"),
                    compilation_options: options.clone(),
                    buffers: &[],
                },
                primitive: Default::default(),
                depth_stencil: Some(of.depth.clone()),
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(fragment),
                    compilation_options: options.clone(),
                    targets: &[Some(format.into())],
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        Relief {
            directions: pipeline("relief_fragment", RELIEF_FORMAT),
            shade: pipeline("shade_fragment", of.output),
        }
    }

    /// Writes the directions of what is visible.
    pub(super) fn encode(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        seen: &wgpu::BindGroup,
        geometry: &[(&wgpu::BindGroup, u32)],
        (depth, area, targets): (&wgpu::TextureView, Rectangle, &Targets),
    ) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("relief"),
            color_attachments: &[attachment(targets.relief(gpu), wgpu::Color::TRANSPARENT)],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: depth,
                depth_ops: None,
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_scissor_rect(area.x, area.y, area.width, area.height);
        pass.set_pipeline(&self.directions);
        pass.set_bind_group(1, seen, &[]);
        for &(bind_group, offset) in geometry {
            pass.set_bind_group(0, bind_group, &[offset]);
            pass.draw(0..3, 0..1);
        }
    }
}
