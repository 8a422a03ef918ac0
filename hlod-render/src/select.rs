//! The receivers' front: which nodes are drawn (Guthe et al. 2004, section 4).
//!
//! A node is drawn where its error covers at most τ pixels; otherwise its children are. Where a
//! child that is wanted is not resident, the nearest resident ancestor is drawn in its place and
//! in that of everything below that ancestor, so that every visible surface point is drawn once.

use std::sync::Arc;

use glam::{DMat4, DVec2, DVec3, DVec4};
use hlod_compress::RepresentationKind;

use crate::camera::{Camera, Projection};
use crate::clip::ClipPlanes;
use crate::loader::{Part, Ticket};
use crate::ring::Ring;
use crate::scene::{Mixing, Shot};
use crate::skeleton::{ChildLink, Node, NodeRepresentation, Skeleton};
use crate::skirts::{ALL_FACES, Faces};

/// What is asked of the front.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Selection {
    /// Which hierarchy.
    pub kind: RepresentationKind,
    /// τ, the error in pixels that is allowed; 0 asks for the leaves.
    pub error_threshold_px: f64,
}

impl Selection {
    /// Of what is so many times coarser.
    pub(crate) fn coarser(&self, factor: f64) -> Selection {
        Selection { error_threshold_px: self.error_threshold_px * factor, ..*self }
    }
}

/// A camera, prepared for tests of boxes in one model's space.
#[derive(Debug, Clone)]
pub struct View {
    pub(crate) view_from_model: DMat4,
    clip_from_model: DMat4,
    /// Eye in model space; for parallel projection the direction towards the viewer.
    pub(crate) eye: DVec3,
    pub(crate) perspective: bool,
    /// Pixels per unit at depth 1, or per unit at any depth.
    pub(crate) pixels: f64,
    pub(crate) near: f64,
    pub(crate) half_extent: DVec2,
    /// Scale of model lengths in world space.
    pub(crate) scale: f64,
    /// The part of clip space that is drawn, over w.
    low: DVec2,
    high: DVec2,
    /// What else is drawn, of what is in the picture.
    ring: Option<Arc<Ring>>,
    /// Model space: what is not drawn.
    clip: ClipPlanes,
    mixing: Mixing,
}

impl View {
    /// `world_from_model` may rotate, move and scale uniformly.
    pub fn new(camera: &Camera, world_from_model: DMat4, width: u32, height: u32) -> View {
        let aspect = f64::from(width) / f64::from(height);
        let half_extent = camera.half_extent(aspect);
        let model_from_world = world_from_model.inverse();
        let perspective = matches!(camera.projection, Projection::Perspective { .. });
        let eye = if perspective {
            model_from_world.transform_point3(camera.eye)
        } else {
            model_from_world.transform_vector3(camera.axes()[2]).normalize()
        };
        View {
            view_from_model: camera.view_from_world() * world_from_model,
            clip_from_model: camera.clip_from_view(aspect)
                * camera.view_from_world()
                * world_from_model,
            eye,
            perspective,
            pixels: f64::from(height) / (2.0 * half_extent.y),
            near: camera.near,
            half_extent,
            scale: world_from_model.x_axis.truncate().length(),
            low: DVec2::NEG_ONE,
            high: DVec2::ONE,
            ring: None,
            clip: ClipPlanes::default(),
            mixing: Mixing::None,
        }
    }

    /// Of a picture.
    pub fn of_shot(shot: &Shot, world_from_model: DMat4, (width, height): (u32, u32)) -> View {
        let view = View::new(&shot.camera, world_from_model, width, height);
        View { clip: shot.clip.in_model(&world_from_model), mixing: shot.mixing, ..view }
    }

    /// The same, but sees boxes only in a part of the picture, which begins and ends so far from its
    /// middle; 1 is its side. What errors cover is as in the whole picture.
    pub(crate) fn narrowed(self, low: DVec2, high: DVec2) -> View {
        View { low: low.max(DVec2::NEG_ONE), high: high.min(DVec2::ONE), ..self }
    }

    /// The same, but shows also what of the picture is in the ring.
    pub(crate) fn with_ring(self, ring: Ring) -> View {
        View { ring: Some(Arc::new(ring)), ..self }
    }

    /// Whether a node may be seen, or decides how what is seen is drawn.
    fn shows(&self, node: &Node) -> bool {
        self.sees_box(node.min, node.max)
            || self.ring.as_ref().is_some_and(|ring| {
                ring.has(node.cell)
                    && self.sees_box_within(node.min, node.max, [DVec2::NEG_ONE, DVec2::ONE])
            })
    }

    /// Whether a box may be seen at all: not all of it is behind one plane of the frustum, nor is
    /// it cut away.
    pub fn sees_box(&self, min: DVec3, max: DVec3) -> bool {
        self.sees_box_within(min, max, [self.low, self.high])
    }

    fn sees_box_within(&self, min: DVec3, max: DVec3, [low, high]: [DVec2; 2]) -> bool {
        if self.clip.removes_all(&corners(min, max)) {
            return false;
        }
        let clip = corners(min, max).map(|c| self.clip_from_model * c.extend(1.0));
        let outside = |f: &dyn Fn(DVec4) -> f64| clip.iter().all(|&c| f(c) < 0.0);
        // Depth is reversed: nearer than the near plane is z > w.
        !(outside(&|c| c.x - low.x * c.w)
            || outside(&|c| high.x * c.w - c.x)
            || outside(&|c| c.y - low.y * c.w)
            || outside(&|c| high.y * c.w - c.y)
            || outside(&|c| c.w - c.z))
    }

    /// Whether every surface with normals in the cone, anywhere in the box, shows its back; where planes cut
    /// the statue open, backs are worth seeing.
    pub fn sees_only_backs(&self, node: &Node) -> bool {
        if !self.clip.is_none() {
            return false;
        }
        let Some((axis, half_angle)) = node.cone else { return false };
        let (away, spread) = if self.perspective {
            let centre = (node.min + node.max) / 2.0;
            let radius = (node.max - node.min).length() / 2.0;
            let distance = self.eye.distance(centre);
            if distance <= radius {
                return false;
            }
            ((centre - self.eye) / distance, (radius / distance).asin())
        } else {
            (-self.eye, 0.0)
        };
        // 1e-6 covers the rounding of the cone's axis and of the triangles' transform.
        axis.dot(away).clamp(-1.0, 1.0).acos() + half_angle + spread
            < std::f64::consts::FRAC_PI_2 - 1e-6
    }

    /// ρ: an upper bound of the pixels that a length of `error` (model units) covers anywhere in
    /// the visible part of the box.
    pub fn error_px(&self, error: f64, min: DVec3, max: DVec3) -> f64 {
        let error = error * self.scale;
        if error == 0.0 {
            return 0.0;
        }
        if !self.perspective {
            return error * self.pixels;
        }
        let corners = corners(min, max).map(|c| self.view_from_model.transform_point3(c));
        let nearest = corners.iter().map(|c| -c.z).fold(f64::INFINITY, f64::min).max(self.near);
        if nearest <= error {
            return f64::INFINITY;
        }
        // Off the axis a length across the line of sight covers more pixels: at most those in the
        // picture's corner.
        let tangent2 = |c: &DVec3| {
            if -c.z > 0.0 { (c.x * c.x + c.y * c.y) / (c.z * c.z) } else { f64::INFINITY }
        };
        let widest = corners.iter().map(tangent2).fold(0.0, f64::max);
        let tangent2 = widest.min(self.half_extent.length_squared());
        error * self.pixels * (1.0 + tangent2).sqrt() / (nearest - error)
    }

    /// A rough measure of a box' size on screen in square pixels, for weighting statistics and
    /// requests.
    pub fn area_px(&self, min: DVec3, max: DVec3) -> f64 {
        let centre = self.view_from_model.transform_point3((min + max) / 2.0);
        let radius = (max - min).length() / 2.0 * self.scale;
        let depth = if self.perspective { (-centre.z).max(radius) } else { 1.0 };
        (radius * self.pixels / depth).powi(2)
    }
}

/// Corners of a box.
pub fn corners(min: DVec3, max: DVec3) -> [DVec3; 8] {
    std::array::from_fn(|i| {
        let pick = |axis: usize| if i >> axis & 1 == 1 { max[axis] } else { min[axis] };
        DVec3::new(pick(0), pick(1), pick(2))
    })
}

/// A node to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Draw {
    /// Its index.
    pub node: u32,
    /// Index of the representation.
    pub representation: usize,
    /// Pixels that its error covers at most.
    pub error_px: f64,
    /// Weight for statistics.
    pub area_px: f64,
    /// Where it may be open towards what is drawn beside it: see [`crate::skirts::find_open_faces`].
    pub open_faces: Faces,
}

/// A part that is wanted and not here.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// For whom.
    pub ticket: Ticket,
    /// What.
    pub part: Part,
    /// Larger is more urgent: how far what is drawn meanwhile exceeds τ, by its size.
    pub urgency: f64,
}

/// What one frame draws and what it misses.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Front {
    /// Nodes to draw.
    pub draws: Vec<Draw>,
    /// Parts to load.
    pub wanted: Vec<Wanted>,
    /// Nodes that are resident and must stay, though they are not drawn: those that will be once others that are beside
    /// them are here, which would be asked for again at once; and ancestors of what is drawn, which stand in for it
    /// where a part is lacking in the next frame. Without them all that is seen would be the root.
    pub held: Vec<(u32, usize)>,
    /// Nodes that would be drawn if everything were resident.
    pub ideal_nodes: usize,
    /// How many pixels the borders of drawn nodes are from their place: see [`crate::skirts`].
    pub border_px: f64,
    /// The same in the source's unit.
    pub border_error: f64,
}

/// Ticket of a node's page.
pub fn page_ticket(node: u32, representation: usize) -> Ticket {
    u64::from(node) << 3 | representation as u64
}

/// Ticket of the block with a node's children.
pub fn block_ticket(node: u32) -> Ticket {
    u64::from(node) << 3 | 7
}

/// The node a ticket is for, and the representation unless it is for its children's block.
pub fn parse_ticket(ticket: Ticket) -> (u32, Option<usize>) {
    let representation = (ticket & 7) as usize;
    ((ticket >> 3) as u32, (representation != 7).then_some(representation))
}

/// What decides which nodes are drawn.
pub(crate) trait Measure {
    /// Which hierarchy.
    fn kind(&self) -> RepresentationKind;
    /// Whether anything of the node matters.
    fn is_relevant(&self, node: &Node) -> bool;
    /// Pixels that a length (model units) within the node covers at most, of what matters.
    fn error_px(&self, error: f64, node: &Node) -> f64;
    /// How many pixels are allowed; 0 asks for the leaves.
    fn threshold_px(&self) -> f64;
    /// A rough measure of a node's size in square pixels.
    fn area_px(&self, node: &Node) -> f64;
    /// How the front differs from what is asked for.
    fn mixing(&self) -> Mixing {
        Mixing::None
    }
}

/// Receivers are measured as the camera sees them.
struct Receivers<'a> {
    view: &'a View,
    selection: Selection,
}

impl Measure for Receivers<'_> {
    fn kind(&self) -> RepresentationKind {
        self.selection.kind
    }

    fn is_relevant(&self, node: &Node) -> bool {
        self.view.shows(node) && !self.view.sees_only_backs(node)
    }

    fn error_px(&self, error: f64, node: &Node) -> f64 {
        self.view.error_px(error, node.min, node.max)
    }

    fn threshold_px(&self) -> f64 {
        self.selection.error_threshold_px
    }

    fn area_px(&self, node: &Node) -> f64 {
        self.view.area_px(node.min, node.max)
    }

    fn mixing(&self) -> Mixing {
        self.view.mixing
    }
}

/// Finds the receivers' front of one model.
pub fn select(
    skeleton: &Skeleton,
    view: &View,
    selection: Selection,
    is_resident: &dyn Fn(u32, usize) -> bool,
) -> Front {
    find_front(skeleton, &Receivers { view, selection }, is_resident)
}

/// Finds a front of one model.
pub(crate) fn find_front(
    skeleton: &Skeleton,
    measure: &dyn Measure,
    is_resident: &dyn Fn(u32, usize) -> bool,
) -> Front {
    let mut search = Search { skeleton, measure, is_resident, front: Front::default() };
    if !skeleton.nodes().is_empty() {
        search.visit(0);
    }
    let mut front = search.front;
    for draw in &front.draws {
        let node = &skeleton.nodes()[draw.node as usize];
        let error = node.representations[draw.representation].border_error;
        front.border_error = front.border_error.max(error);
        front.border_px = front.border_px.max(measure.error_px(error, node));
    }
    front.wanted.sort_by(|a, b| b.urgency.total_cmp(&a.urgency).then(a.ticket.cmp(&b.ticket)));
    front
}

struct Search<'a> {
    skeleton: &'a Skeleton,
    measure: &'a dyn Measure,
    is_resident: &'a dyn Fn(u32, usize) -> bool,
    front: Front,
}

impl Search<'_> {
    /// Draws a node or what is below it; false where something visible is left undrawn, in which
    /// case nothing of the node is drawn.
    fn visit(&mut self, index: u32) -> bool {
        let node = &self.skeleton.nodes()[index as usize];
        if !self.measure.is_relevant(node) {
            return true;
        }
        let Some(representation) = node.representation(self.measure.kind()) else { return true };
        let error = node.representations[representation].error;
        let error_px = self.measure.error_px(error, node);
        let area_px = self.measure.area_px(node);
        let open_faces = ALL_FACES;
        let draw = Draw { node: index, representation, error_px, area_px, open_faces };
        let mixing = self.measure.mixing();
        let resident = (self.is_resident)(index, representation) && !mixing.lacks(node);
        let threshold = self.measure.threshold_px();
        let fine_enough = threshold > 0.0 && error_px <= threshold && !mixing.divides(node);

        if fine_enough || node.children == ChildLink::None {
            self.front.ideal_nodes += 1;
            if resident {
                self.front.draws.push(draw);
            } else {
                self.want_page(&draw);
            }
            return resident;
        }

        // Children first; what they drew is taken back if one of them is missing.
        let before = self.front.draws.len();
        let complete = match node.children {
            ChildLink::None => unreachable!("leaves were handled above"),
            ChildLink::Nodes { first, count } => {
                // All children are visited, so that all that is missing is asked for.
                let mut complete = true;
                for child in first..first + count {
                    complete &= self.visit(child);
                }
                complete
            }
            ChildLink::Unloaded(block) => {
                self.front.wanted.push(Wanted {
                    ticket: block_ticket(index),
                    part: Part::Block(block),
                    urgency: self.urgency(&draw) * 2.0,
                });
                false
            }
        };
        if complete {
            if resident {
                self.front.held.push((index, representation));
            }
            return true;
        }
        let waiting = self.front.draws.drain(before..);
        self.front.held.extend(waiting.map(|draw| (draw.node, draw.representation)));
        if resident {
            self.front.draws.push(draw);
        } else {
            // Ancestors are small and cover much: they come before what refines them.
            self.want_page(&draw);
        }
        resident
    }

    fn want_page(&mut self, draw: &Draw) {
        let node = &self.skeleton.nodes()[draw.node as usize];
        let NodeRepresentation { page, kind, .. } = node.representations[draw.representation];
        self.front.wanted.push(Wanted {
            ticket: page_ticket(draw.node, draw.representation),
            part: Part::Page(page, node.cell, kind),
            urgency: self.urgency(draw),
        });
    }

    fn urgency(&self, draw: &Draw) -> f64 {
        let node = &self.skeleton.nodes()[draw.node as usize];
        // Each level coarser covers about four times the picture.
        let level = 4f64.powi(20 - i32::from(node.depth));
        draw.area_px.min(1e12) + 1e12 * level
    }
}

#[cfg(test)]
pub(crate) mod tests;
