//! Shading: what is seen of the surface, lit where the light is not hidden, or painted with what explains it.

use super::explain::{Explain, explains};
use super::relief::{Relief, ReliefLayout};
use super::resources::{
    Constants, attachment, buffer, entry, nearest, pipeline_layout, render_pipeline, storage_entry,
};
use super::targets::relief_texture;
use super::{Drawn, DrawnShadow, Targets};
use crate::gpu::Gpu;
use crate::scene::Shot;

/// Pipelines that paint the picture, and what stands in for what a frame does without.
pub(super) struct Shade {
    pipeline: wgpu::RenderPipeline,
    /// Made when it is first needed.
    relief: Option<Relief>,
    explain: Explain,
    /// Stands in for occlusion where there are no shadows.
    unoccluded: wgpu::Buffer,
    /// Stands in for directions where relief is not looked at.
    no_relief: wgpu::TextureView,
    layout: wgpu::PipelineLayout,
    identity_layout: wgpu::BindGroupLayout,
    where_drawn: wgpu::DepthStencilState,
    output: wgpu::TextureFormat,
    constants: Constants,
}

impl Shade {
    /// `output` is the format of the pictures.
    pub(super) fn new(
        gpu: &Gpu,
        geometry_layout: &wgpu::BindGroupLayout,
        output: wgpu::TextureFormat,
        constants: Constants,
    ) -> Shade {
        let identity_layout = identity_layout(gpu);
        let layout =
            pipeline_layout(gpu, "shade", &[Some(geometry_layout), Some(&identity_layout)]);
        // Draws at infinity and passes only where something is nearer, so that no shader runs for the
        // background.
        let where_drawn = wgpu::DepthStencilState {
            depth_write_enabled: Some(false),
            depth_compare: Some(wgpu::CompareFunction::Less),
            ..nearest()
        };
        let depth = where_drawn.clone();
        let pass = hlod_shaders::SHADE;
        Shade {
            explain: Explain::new(gpu, geometry_layout, output, where_drawn.clone()),
            pipeline: render_pipeline(gpu, &layout, pass, None, output, depth, &constants),
            relief: None,
            no_relief: relief_texture(gpu, (1, 1)),
            unoccluded: buffer(gpu, "unoccluded", 4, wgpu::BufferUsages::STORAGE),
            layout,
            identity_layout,
            where_drawn,
            output,
            constants,
        }
    }

    /// The render pass that fills the picture, one draw an arena; before it, where relief is looked at, the one that
    /// writes directions. Identity, `depth` and occlusion are known.
    pub(super) fn encode(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        geometry: &[(&wgpu::BindGroup, u32)],
        drawn: &Drawn<'_>,
        shot: &Shot,
        (depth, targets): (&wgpu::TextureView, &Targets),
    ) {
        let area = drawn.area;
        if shot.sees_relief() && self.relief.is_none() {
            self.relief = Some(self.compile_relief(gpu));
        }
        let relief = self.relief.as_ref().filter(|_| shot.sees_relief());
        let occlusion = match drawn.shadow {
            DrawnShadow::None => &self.unoccluded,
            _ => targets.occlusion(gpu),
        };
        let seen = |directions| self.seen(gpu, targets, occlusion, directions);
        let unread = seen(&self.no_relief);
        let shaded = relief.map_or_else(|| unread.clone(), |_| seen(targets.relief(gpu)));
        if let Some(relief) = relief {
            relief.encode(gpu, encoder, &unread, geometry, (depth, area, targets));
        }
        let is_explained = explains(shot.paint) && !drawn.parts.is_empty();
        let explained =
            is_explained.then(|| self.explain.parts(gpu, drawn.parts, targets.identity_view()));
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("shade"),
            color_attachments: &[attachment(&targets.colour, background(shot, targets))],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: depth,
                depth_ops: None,
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_scissor_rect(area.x, area.y, area.width, area.height);
        match &explained {
            None => {
                pass.set_pipeline(relief.map_or(&self.pipeline, |relief| &relief.shade));
                pass.set_bind_group(1, &shaded, &[]);
            }
            Some(parts) => self.explain.begin(&mut pass, parts, shot.paint),
        }
        for &(bind_group, offset) in geometry {
            pass.set_bind_group(0, bind_group, &[offset]);
            pass.draw(0..3, 0..1);
        }
    }

    fn compile_relief(&self, gpu: &Gpu) -> Relief {
        let made_with = ReliefLayout {
            layout: &self.layout,
            depth: self.where_drawn.clone(),
            output: self.output,
            constants: &self.constants,
        };
        Relief::new(gpu, &made_with)
    }

    /// What is known of each pixel.
    fn seen(
        &self,
        gpu: &Gpu,
        targets: &Targets,
        occlusion: &wgpu::Buffer,
        directions: &wgpu::TextureView,
    ) -> wgpu::BindGroup {
        let texture = |view| wgpu::BindingResource::TextureView(view);
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("identity"),
            layout: &self.identity_layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: texture(targets.identity_view()) },
                entry(1, occlusion),
                wgpu::BindGroupEntry { binding: 2, resource: texture(directions) },
            ],
        })
    }
}

/// Of identities, occlusion, and directions for relief.
fn identity_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    let texture = |binding, sample_type| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::FRAGMENT,
        ty: wgpu::BindingType::Texture {
            sample_type,
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        },
        count: None,
    };
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("identity"),
        entries: &[
            texture(0, wgpu::TextureSampleType::Uint),
            storage_entry(1, wgpu::ShaderStages::FRAGMENT, true),
            texture(2, wgpu::TextureSampleType::Float { filterable: false }),
        ],
    })
}

/// What is where nothing is drawn.
fn background(shot: &Shot, targets: &Targets) -> wgpu::Color {
    if targets.window().transparent {
        return wgpu::Color::TRANSPARENT;
    }
    let [r, g, b] = shot.background.to_array().map(f64::from);
    wgpu::Color { r, g, b, a: 1.0 }
}
