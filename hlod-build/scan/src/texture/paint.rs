//! Colours of vertices from the textures of the faces round them.
//!
//! A vertex stands for a third of each triangle round it (in polygons: for the part between the
//! middles of its two edges and the centre). Its colour is the mean, in linear light, of the means of
//! the textures over these parts, each weighted by the angle that the face spans there in its
//! texture, as normals are weighted by the angle in space (G. Thürmer & C. Wüthrich 1998): it does not
//! depend on how a flat part is cut into triangles. Sums are of whole steps, so that no order of
//! faces changes them.
//!
//! At a seam of the texture the parts lie in different places of it, and nothing else is special:
//! vertices in equal places share one colour, so that the surface stays joined.

use std::io;

use bytemuck::{Pod, Zeroable};
use glam::{DVec2, DVec3};

use super::filter::{self, Texture, Wrap};
use crate::paged::{Paged, Room};
use crate::polygon::CORNERS_MAX;

/// What a face is painted with.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Surface {
    /// Number of its texture among those of the file.
    pub(crate) texture: Option<usize>,
    /// Linear light: what the texture is multiplied with, or the colour where there is none.
    pub(crate) factor: [f64; 3],
    /// From coordinates as the file has them to the texture, whose corners are 0 and 1, from the
    /// upper left.
    pub(crate) texture_from_file: [[f64; 3]; 2],
    pub(crate) wrap: [Wrap; 2],
}

impl Surface {
    /// Where v runs upwards from the lower border, as in OBJ and PLY.
    pub(crate) const FROM_LOWER_LEFT: [[f64; 3]; 2] = [[1.0, 0.0, 0.0], [0.0, -1.0, 1.0]];
    /// Where it runs downwards from the upper one, as in glTF.
    pub(crate) const FROM_UPPER_LEFT: [[f64; 3]; 2] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
}

/// Coordinates of a corner where the file has none that can be used.
pub(crate) const NOWHERE: [f32; 2] = [f32::NAN; 2];

/// Light times weight, and weight, in steps.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
struct Sum {
    light: [u64; 3],
    weight: u64,
}

/// Steps of a weight of 1 (radian): at vertices of a million corners nothing overflows.
const STEPS: f64 = (1u64 << 40) as f64;
/// Counts only where nothing else does: a corner whose face has no area in the texture.
const STEPS_MIN: f64 = 65536.0;
/// Weight of a corner without coordinates: that of an equilateral triangle.
const PLAIN_WEIGHT: f64 = std::f64::consts::FRAC_PI_3;

/// What was done, for the report.
#[derive(Clone, Copy, Default, Debug)]
pub(crate) struct Painted {
    /// Corners of faces that have a place in a texture.
    pub(crate) corners: u64,
    /// Corners of textured faces without coordinates, or with such as are no numbers.
    pub(crate) corners_nowhere: u64,
    /// Corners outside the texture, where it is repeated, mirrored or goes on as its border.
    pub(crate) corners_outside: u64,
    /// Area of all faces in their textures.
    pub(crate) texels: f64,
    /// Vertices that no face paints.
    pub(crate) vertices_bare: u64,
}

/// Collects the colours of all vertices of a file.
pub(crate) struct Painter {
    textures: Vec<Texture>,
    /// One for each place.
    sums: Paged<Sum>,
    place_of_vertex: Paged<u32>,
    places: Places,
    pub(crate) painted: Painted,
}

impl Painter {
    /// Of `vertices` vertices, which are to be added first; within four times the room.
    pub(crate) fn new(textures: Vec<Texture>, vertices: u64, room: &Room) -> io::Result<Painter> {
        Ok(Painter {
            textures,
            sums: Paged::new(room),
            place_of_vertex: Paged::new(room),
            places: Places::new(vertices, room)?,
            painted: Painted::default(),
        })
    }

    /// Adds the next vertex.
    pub(crate) fn add_vertex(&mut self, position: DVec3) -> io::Result<()> {
        let place = self.places.place(position)?;
        if place as usize == self.sums.len() {
            self.sums.push(Sum::default())?;
        }
        self.place_of_vertex.push(place)
    }

    /// Adds a face: its vertices, which were added before, and for each its coordinates.
    pub(crate) fn add_face(
        &mut self,
        surface: &Surface,
        corners: &[u32],
        coordinates: &[[f32; 2]],
    ) -> io::Result<()> {
        debug_assert!(corners.len() == coordinates.len() && corners.len() <= CORNERS_MAX);
        let texture = surface.texture.and_then(|number| self.textures.get(number));
        let is_somewhere = |at: &[f32; 2]| at.iter().all(|x| x.is_finite());
        let is_placed = coordinates.iter().all(is_somewhere) && corners.len() >= 3;
        let (true, Some(texture)) = (is_placed, texture) else {
            self.painted.corners_nowhere +=
                if surface.texture.is_some() { corners.len() as u64 } else { 0 };
            if surface.texture.is_none() {
                for vertex in corners {
                    self.add(*vertex, surface.factor, PLAIN_WEIGHT)?;
                }
            }
            return Ok(());
        };
        let size = texture.size();
        let places: Vec<DVec2> = coordinates.iter().map(|at| surface.place(*at)).collect();
        let is_outside = |at: &&DVec2| at.min_element() < 0.0 || at.max_element() > 1.0;
        self.painted.corners_outside += places.iter().filter(is_outside).count() as u64;
        self.painted.corners += places.len() as u64;
        let texels: Vec<DVec2> = places.iter().map(|at| *at * size).collect();
        let count = texels.len();
        let centre = texels.iter().sum::<DVec2>() / count as f64;
        let mut means = Vec::with_capacity(count);
        let mut area = 0.0;
        for (i, at) in texels.iter().enumerate() {
            let (next, last) = (texels[(i + 1) % count], texels[(i + count - 1) % count]);
            let part = [*at, at.midpoint(next), centre, at.midpoint(last)];
            let light = texture.mean(part, surface.wrap);
            let (to_next, to_last) = (next - *at, last - *at);
            area += (*at - texels[0]).perp_dot(to_next) / 2.0;
            let angle = to_next.perp_dot(to_last).abs().atan2(to_next.dot(to_last));
            means.push((light, angle));
        }
        self.painted.texels += area.abs();
        for (vertex, (light, angle)) in corners.iter().zip(means) {
            let light: [f64; 3] = std::array::from_fn(|i| light[i] * surface.factor[i]);
            self.add(*vertex, light, angle)?;
        }
        Ok(())
    }

    fn add(&mut self, vertex: u32, light: [f64; 3], weight: f64) -> io::Result<()> {
        // NaN, of coordinates near the largest number, counts as no angle.
        let steps = (weight * STEPS).max(STEPS_MIN).round();
        let place = self.place_of_vertex.get(vertex as usize)?;
        let sum = self.sums.at(place as usize)?;
        for (sum, light) in sum.light.iter_mut().zip(light) {
            *sum = sum.saturating_add((light.clamp(0.0, 1.0) * steps).round() as u64);
        }
        sum.weight = sum.weight.saturating_add(steps as u64);
        Ok(())
    }

    /// The colour of a vertex; opaque white where no face has painted it.
    pub(crate) fn colour(&mut self, vertex: usize) -> io::Result<[u8; 4]> {
        let place = self.place_of_vertex.get(vertex)?;
        let Sum { light, weight } = self.sums.get(place as usize)?;
        if weight == 0 {
            self.painted.vertices_bare += 1;
            return Ok([255; 4]);
        }
        let [r, g, b] = light.map(|light| filter::byte_from_light(light as f64 / weight as f64));
        Ok([r, g, b, 255])
    }

    /// How many texels a vertex stands for in the mean.
    pub(crate) fn texels_a_vertex(&self) -> f64 {
        self.painted.texels / (self.sums.len().max(1) as f64)
    }

    /// All faces were added: textures are needed no more.
    pub(crate) fn finish(&mut self) {
        self.textures = Vec::new();
        self.places = Places::none();
    }
}

impl Surface {
    fn place(&self, at: [f32; 2]) -> DVec2 {
        let [u, v] = at.map(f64::from);
        let row = |[a, b, c]: [f64; 3]| a * u + b * v + c;
        DVec2::new(row(self.texture_from_file[0]), row(self.texture_from_file[1]))
    }
}

/// Numbers different positions in the order in which they first occur: a table of open addresses.
///
/// Positions count as equal where 64 bits computed from them are: among 10⁹ vertices some two would
/// be by chance in one scan of 40, and share a colour.
struct Places {
    /// Number of a place and 1; 0 where there is none. A power of two of them.
    slots: Paged<u32>,
    keys: Paged<u64>,
}

impl Places {
    fn new(vertices: u64, room: &Room) -> io::Result<Places> {
        let mut places = Places { slots: Paged::new(room), keys: Paged::new(room) };
        for _ in 0..(vertices.max(1) * 2).next_power_of_two() {
            places.slots.push(0)?;
        }
        Ok(places)
    }

    fn none() -> Places {
        Places { slots: Paged::new(&Room::UNBOUNDED), keys: Paged::new(&Room::UNBOUNDED) }
    }

    fn place(&mut self, position: DVec3) -> io::Result<u32> {
        let key = key_of(position);
        let mask = self.slots.len() - 1;
        let mut slot = key as usize & mask;
        loop {
            match self.slots.get(slot)? {
                0 => {
                    let place = self.keys.len() as u32;
                    self.keys.push(key)?;
                    *self.slots.at(slot)? = place + 1;
                    return Ok(place);
                }
                place if self.keys.get(place as usize - 1)? == key => return Ok(place - 1),
                _ => slot = (slot + 1) & mask,
            }
        }
    }
}

/// Mixes the bits of the coordinates (based on: S. Vigna's splitmix64, 2015); −0 is 0.
fn key_of(position: DVec3) -> u64 {
    position.to_array().iter().fold(0, |key: u64, x| {
        let mixed = (key ^ (x + 0.0).to_bits()).wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (mixed ^ mixed >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ mixed >> 31
    })
}
