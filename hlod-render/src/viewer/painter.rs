//! Draws the panel's triangles.
//!
//! The toolkit's own renderer would do, but its shader branches on a uniform, for which lavapipe
//! (Mesa 22) compiles it anew in every frame: a frame of 1280 × 800 took 140 ms, and takes 35 so.

use std::collections::HashMap;

use egui::TextureId;
use egui::epaint::{ClippedPrimitive, ImageData, ImageDelta, Primitive, Vertex};

use crate::gpu::Gpu;
use crate::passes::{buffer, write_growing};

/// Textures, buffers and the pipeline.
pub struct Painter {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    textures: HashMap<TextureId, (wgpu::Texture, wgpu::BindGroup)>,
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
}

/// A vertex as the shader takes it.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Corner {
    clip: [f32; 2],
    uv: [f32; 2],
    colour: [u8; 4],
}

impl Painter {
    /// For targets of this format.
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Painter {
        let device = &gpu.device;
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty,
            count: None,
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("panel"),
            entries: &[
                entry(
                    0,
                    wgpu::BindingType::Texture {
                        sample_type: wgpu::TextureSampleType::Float { filterable: true },
                        view_dimension: wgpu::TextureViewDimension::D2,
                        multisampled: false,
                    },
                ),
                entry(1, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
            ],
        });
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(hlod_shaders::PANEL.name),
            source: wgpu::ShaderSource::Wgsl(hlod_shaders::PANEL.source.into()),
        });
        let entry_point = if format.is_srgb() { "panel_fragment_linear" } else { "panel_fragment" };
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(hlod_shaders::PANEL.name),
            layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("panel"),
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            })),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("panel_vertex"),
                compilation_options: Default::default(),
                buffers: &[Some(wgpu::VertexBufferLayout {
                    array_stride: size_of::<Corner>() as u64,
                    step_mode: wgpu::VertexStepMode::Vertex,
                    attributes: &wgpu::vertex_attr_array![0 => Float32x2, 1 => Float32x2, 2 => Unorm8x4],
                })],
            },
            primitive: Default::default(),
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some(entry_point),
                compilation_options: Default::default(),
                targets: &[Some(wgpu::ColorTargetState {
                    format,
                    blend: Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
                    write_mask: wgpu::ColorWrites::ALL,
                })],
            }),
            multiview_mask: None,
            cache: None,
        });
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("panel"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        Painter {
            pipeline,
            layout,
            sampler,
            textures: HashMap::new(),
            vertices: buffer(gpu, "panel vertices", 1 << 16, wgpu::BufferUsages::VERTEX),
            indices: buffer(gpu, "panel indices", 1 << 16, wgpu::BufferUsages::INDEX),
        }
    }

    /// Makes a texture, or changes part of one.
    pub fn update_texture(&mut self, gpu: &Gpu, id: TextureId, delta: &ImageDelta) {
        let ImageData::Color(image) = &delta.image;
        let [width, height] = image.size.map(|side| side as u32);
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        if delta.pos.is_none() {
            let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
            let format = wgpu::TextureFormat::Rgba8Unorm;
            let texture = gpu.texture("panel", (width, height), format, usage, &[]);
            let view = texture.create_view(&Default::default());
            let bind_group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("panel"),
                layout: &self.layout,
                entries: &[
                    wgpu::BindGroupEntry {
                        binding: 0,
                        resource: wgpu::BindingResource::TextureView(&view),
                    },
                    wgpu::BindGroupEntry {
                        binding: 1,
                        resource: wgpu::BindingResource::Sampler(&self.sampler),
                    },
                ],
            });
            self.textures.insert(id, (texture, bind_group));
        }
        let Some((texture, _)) = self.textures.get(&id) else { return };
        let [x, y] = delta.pos.unwrap_or_default().map(|v| v as u32);
        let mut to = texture.as_image_copy();
        to.origin = wgpu::Origin3d { x, y, z: 0 };
        let bytes: Vec<u8> = image.pixels.iter().flat_map(|colour| colour.to_array()).collect();
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(4 * width),
            rows_per_image: None,
        };
        gpu.queue.write_texture(to, &bytes, layout, size);
    }

    /// Drops a texture.
    pub fn free_texture(&mut self, id: TextureId) {
        self.textures.remove(&id);
    }

    /// Draws on top of what `target` shows.
    pub fn paint(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        primitives: &[ClippedPrimitive],
        pixels_per_point: f32,
        target: &wgpu::Texture,
    ) {
        // Upload every mesh, one after another.
        let pixels = egui::vec2(target.width() as f32, target.height() as f32);
        let points = pixels / pixels_per_point;
        let meshes = primitives.iter().filter_map(|p| match &p.primitive {
            Primitive::Mesh(mesh) => Some((p.clip_rect, mesh)),
            // We register none.
            Primitive::Callback(_) => None,
        });
        let (mut corners, mut indices) = (Vec::new(), Vec::new());
        let mut draws = Vec::new();
        for (clip, mesh) in meshes {
            let scissor = scissor(clip, pixels_per_point, pixels);
            let Some((_, bind_group)) = self.textures.get(&mesh.texture_id) else { continue };
            let (first, base) = (indices.len() as u32, corners.len() as i32);
            corners.extend(mesh.vertices.iter().map(|v| corner(v, points)));
            indices.extend_from_slice(&mesh.indices);
            draws.push((scissor, bind_group, first..indices.len() as u32, base));
        }
        write_growing(gpu, &mut self.vertices, bytemuck::cast_slice(&corners));
        write_growing(gpu, &mut self.indices, bytemuck::cast_slice(&indices));

        // Draw them in this order.
        let view = target.create_view(&Default::default());
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("panel"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        for ([x, y, width, height], bind_group, range, base) in draws {
            if width > 0 && height > 0 {
                pass.set_scissor_rect(x, y, width, height);
                pass.set_bind_group(0, bind_group, &[]);
                pass.draw_indexed(range, base, 0..1);
            }
        }
    }
}

fn corner(vertex: &Vertex, points: egui::Vec2) -> Corner {
    let at = vertex.pos.to_vec2() / points;
    Corner {
        clip: [2.0 * at.x - 1.0, 1.0 - 2.0 * at.y],
        uv: vertex.uv.into(),
        colour: vertex.color.to_array(),
    }
}

/// Left, top, width and height in pixels, within the target.
fn scissor(clip: egui::Rect, pixels_per_point: f32, pixels: egui::Vec2) -> [u32; 4] {
    let within = |v: egui::Pos2| {
        let v = (v.to_vec2() * pixels_per_point).round().clamp(egui::Vec2::ZERO, pixels);
        [v.x as u32, v.y as u32]
    };
    let ([left, top], [right, bottom]) = (within(clip.min), within(clip.max));
    [left, top, right.saturating_sub(left), bottom.saturating_sub(top)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scissors_stay_within_the_target() {
        let rect = |a: [f32; 2], b: [f32; 2]| egui::Rect::from_min_max(a.into(), b.into());
        let pixels = egui::vec2(300.0, 200.0);
        assert_eq!(scissor(rect([10.0, 20.0], [50.0, 60.0]), 1.5, pixels), [15, 30, 60, 60]);
        assert_eq!(scissor(rect([-5.0, -5.0], [900.0, 900.0]), 2.0, pixels), [0, 0, 300, 200]);
        assert_eq!(scissor(rect([50.0, 50.0], [10.0, 10.0]), 1.0, pixels), [50, 50, 0, 0]);
        assert_eq!(scissor(egui::Rect::EVERYTHING, 1.0, pixels), [0, 0, 300, 200]);
    }

    #[test]
    fn corners_of_the_screen_are_those_of_clip_space() {
        let vertex = |x, y| Vertex { pos: egui::pos2(x, y), ..Vertex::default() };
        let points = egui::vec2(200.0, 100.0);
        assert_eq!(corner(&vertex(0.0, 0.0), points).clip, [-1.0, 1.0]);
        assert_eq!(corner(&vertex(200.0, 100.0), points).clip, [1.0, -1.0]);
    }
}
