//! The casters' front: which nodes cast shadows on what is seen, and how fine they must be (Guthe et
//! al. 2004, section 6.1, made conservative).
//!
//! Visible nodes are grouped by their depth in the octree. Round each group lies the smallest box
//! along the camera's axes, and round that, seen from the light, the smallest frustum: what is outside
//! all frusta hides nothing that is seen. A caster that is wrong by ε moves its shadow's edge by at most
//! ε · (distance from the light to the receiver) ÷ (distance from the light to the caster), so it may
//! be wrong by
//!
//! ```text
//! ε_c = a · d_l,min ÷ D_max        parallel light: ε_c = a
//! ```
//!
//! with a the length that τ_c pixels show at the nearest point of the group's box, d_l,min the least
//! distance from the light to the caster's box, D_max the largest to a corner of the group's. A light
//! of diameter s blurs what is far from what it falls on, and where nothing may be lit otherwise than
//! by γ, another γ · s · d_p ÷ (d_l,max + d_p) is allowed, with d_p the least distance from the caster's
//! box to the group's (of parallel light, s its angle in radians, γ · s · d_p). The
//! paper has the receivers' *stored* error in place of a, which would ask for leaves wherever leaves
//! are seen.

use glam::{DMat4, DVec2, DVec3};
use hlod_compress::RepresentationKind;

use crate::camera::Projection;
use crate::scene::{Light, Shot};
use crate::select::{Front, Measure, corners, find_front};
use crate::skeleton::{Node, Skeleton};

/// Visible nodes of one depth.
#[derive(Debug, Clone)]
struct Receivers {
    /// Lowest and highest corner of the box along the camera's axes, view space.
    low: DVec3,
    high: DVec3,
}

/// Which parts of one model may cast on what is seen.
#[derive(Debug, Clone)]
pub struct CasterView {
    world_from_model: DMat4,
    scale: f64,
    light: Light,
    /// As [`Shot::light_radius`] has it.
    light_radius: f64,
    frusta: Vec<Frustum>,
    /// τ_c.
    threshold_px: f64,
    /// γ.
    intensity_step: f64,
    /// Nothing else is relevant than what may cast on these, too: those of a part of the picture.
    near: Option<Vec<Frustum>>,
}

/// What may hide one group's box from the light.
#[derive(Debug, Clone)]
struct Frustum {
    /// `dot(normal, p) <= offset` for every relevant p in world space; of lights within the box none.
    planes: Vec<(DVec3, f64)>,
    /// Pixels that a unit of length shows at its nearest point.
    pixels: f64,
    /// Largest distance from the light to the box; parallel light: 1.
    reach: f64,
    /// Bounds of the box, world space.
    bounds: [DVec3; 2],
}

impl CasterView {
    /// For the nodes drawn of any model, by depth, given by corners of their boxes in world space;
    /// `threshold_px` is τ_c.
    pub fn new(
        shot: &Shot,
        (width, height): (u32, u32),
        receivers: &[(u8, [DVec3; 8])],
        threshold_px: f64,
        world_from_model: DMat4,
    ) -> CasterView {
        let Shot { camera, light, .. } = shot;
        let (light, radius) = (*light, shot.light_radius());
        let aspect = f64::from(width) / f64::from(height);
        let half = camera.half_extent(aspect);
        let view_from_world = camera.view_from_world();
        let perspective = matches!(camera.projection, Projection::Perspective { .. });
        let mut groups: std::collections::BTreeMap<u8, Receivers> = Default::default();
        for (depth, corners) in receivers {
            let group = groups
                .entry(*depth)
                .or_insert(Receivers { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY });
            for &corner in corners {
                let p = view_from_world.transform_point3(corner);
                group.low = group.low.min(p);
                group.high = group.high.max(p);
            }
        }
        let frusta = groups.into_values().filter_map(|Receivers { mut low, mut high }| {
            // Only what is within the picture is seen; −z is ahead.
            let mut sides = half;
            if perspective {
                high.z = high.z.min(-camera.near);
                sides *= -low.z;
            }
            let sides = sides.extend(f64::INFINITY);
            low = low.max(-sides);
            high = high.min(sides);
            if low.cmpgt(high).any() {
                return None;
            }
            let depth = if perspective { -high.z } else { 1.0 };
            let pixels = f64::from(height) / (2.0 * half.y * depth);
            let world_from_view = view_from_world.inverse();
            let box_corners = corners(low, high).map(|p| world_from_view.transform_point3(p));
            Some(Frustum::new(light, radius, &box_corners, camera.axes()[0], pixels))
        });
        CasterView {
            world_from_model,
            scale: world_from_model.x_axis.truncate().length(),
            light,
            light_radius: radius,
            frusta: frusta.collect(),
            threshold_px,
            intensity_step: shot.intensity_step,
            near: None,
        }
    }

    /// The same, but leaves out what cannot cast on what the other view is of.
    pub(crate) fn near(self, part: CasterView) -> CasterView {
        CasterView { near: Some(part.frusta), ..self }
    }
}

impl Frustum {
    fn new(
        light: Light,
        radius: f64,
        receivers: &[DVec3; 8],
        right: DVec3,
        pixels: f64,
    ) -> Frustum {
        let of = |axis: fn(DVec3, DVec3) -> DVec3, start: DVec3| {
            receivers.iter().fold(start, |all, p| axis(all, *p))
        };
        let bounds = [of(DVec3::min, DVec3::INFINITY), of(DVec3::max, DVec3::NEG_INFINITY)];
        match light {
            Light::Directional(towards) => {
                let towards = towards.normalize_or(DVec3::Y);
                let u = (right - towards * right.dot(towards))
                    .try_normalize()
                    .unwrap_or_else(|| towards.any_orthonormal_vector());
                let v = towards.cross(u);
                let most = |n: DVec3| receivers.iter().map(|p| n.dot(*p)).fold(f64::MIN, f64::max);
                // Beyond the farthest receiver nothing casts; towards the light there is no end.
                // Rays from a receiver spread by the light's angle.
                let sides = [u, -u, v, -v].map(|n| n - towards * radius);
                let planes: Vec<_> =
                    sides.iter().chain(&[-towards]).map(|n| (*n, most(*n))).collect();
                Frustum { planes, pixels, reach: 1.0, bounds }
            }
            Light::Point(light) => {
                let reach = receivers.iter().map(|p| p.distance(light)).fold(0.0, f64::max);
                let middle = receivers.iter().sum::<DVec3>() / 8.0;
                let axis = (middle - light).normalize_or(DVec3::Y);
                let farthest = receivers.iter().map(|p| axis.dot(*p)).fold(f64::MIN, f64::max);
                let ahead = |p: &DVec3| axis.dot(*p - light);
                // Where the box surrounds the light, whatever is nearer than its corners may cast.
                if receivers.iter().any(|p| ahead(p) <= 1e-3 * reach) {
                    let balls = [DVec3::X, DVec3::Y, DVec3::Z].into_iter();
                    let planes =
                        balls.flat_map(|n| [n, -n]).map(|n| (n, n.dot(light) + reach)).collect();
                    return Frustum { planes, pixels, reach, bounds };
                }
                let u = (right - axis * right.dot(axis))
                    .try_normalize()
                    .unwrap_or_else(|| axis.any_orthonormal_vector());
                let v = axis.cross(u);
                let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
                for p in receivers {
                    let tangent = DVec2::new(u.dot(*p - light), v.dot(*p - light)) / ahead(p);
                    low = low.min(tangent);
                    high = high.max(tangent);
                }
                // Through the light; (u − high·axis)·(p − light) ≤ 0 and so on.
                let sides =
                    [u - axis * high.x, axis * low.x - u, v - axis * high.y, axis * low.y - v];
                let mut planes: Vec<_> = sides.iter().map(|n| (*n, n.dot(light))).collect();
                planes.push((-axis, -axis.dot(light)));
                planes.push((axis, farthest));
                // No ray to any part of the light is farther than its radius from one to the middle.
                planes.iter_mut().for_each(|(n, offset)| *offset += radius * n.length());
                Frustum { planes, pixels, reach, bounds }
            }
        }
    }

    /// Whether a box may be in it: not all of it is beyond one plane.
    fn may_hold(&self, corners: &[DVec3; 8]) -> bool {
        self.planes.iter().all(|(n, offset)| {
            // What rounding may do to the products.
            let slack = 1e-12 * (offset.abs() + n.length());
            corners.iter().any(|p| n.dot(*p) <= offset + slack)
        })
    }
}

/// The least distance from a point to a box in another space; boxes stay boxes in all that models
/// are placed by, so the nearest point is found in model space.
fn distance_to_box(world_from_model: &DMat4, scale: f64, light: DVec3, node: &Node) -> f64 {
    let local = world_from_model.inverse().transform_point3(light);
    local.distance(local.clamp(node.min, node.max)) * scale
}

impl Measure for CasterView {
    fn kind(&self) -> RepresentationKind {
        RepresentationKind::Geometric
    }

    fn is_relevant(&self, node: &Node) -> bool {
        let corners =
            corners(node.min, node.max).map(|p| self.world_from_model.transform_point3(p));
        let may_hold = |frusta: &[Frustum]| frusta.iter().any(|f| f.may_hold(&corners));
        may_hold(&self.frusta) && self.near.as_deref().is_none_or(may_hold)
    }

    /// Pixels by which a shadow's edge moves at most.
    fn error_px(&self, error: f64, node: &Node) -> f64 {
        if error == 0.0 {
            return 0.0;
        }
        let corners =
            corners(node.min, node.max).map(|p| self.world_from_model.transform_point3(p));
        let (nearest, farthest) = match self.light {
            Light::Directional(_) => (1.0, 1.0),
            Light::Point(light) => {
                let farthest = corners.iter().map(|p| p.distance(light)).fold(0.0, f64::max);
                let nearest = distance_to_box(&self.world_from_model, self.scale, light, node);
                (nearest, farthest)
            }
        };
        let (low, high) = corners
            .iter()
            .fold((corners[0], corners[0]), |(low, high), p| (low.min(*p), high.max(*p)));
        let relevant = self.frusta.iter().filter(|f| f.may_hold(&corners));
        let of_group = |f: &Frustum| {
            let apart = (f.bounds[0] - high).max(low - f.bounds[1]).max(DVec3::ZERO).length();
            let blur = match self.light {
                Light::Directional(_) => 2.0 * self.light_radius * apart,
                Light::Point(_) if apart > 0.0 => {
                    2.0 * self.light_radius * apart / (farthest + apart)
                }
                Light::Point(_) => 0.0,
            };
            // In pixels of shift, as if there were no blur: τ_c is what remains.
            let allowed =
                self.threshold_px * nearest / (f.pixels * f.reach) + self.intensity_step * blur;
            match self.threshold_px > 0.0 {
                true => self.threshold_px * error * self.scale / allowed,
                false => f64::INFINITY,
            }
        };
        relevant.map(of_group).fold(0.0, f64::max)
    }

    fn threshold_px(&self) -> f64 {
        self.threshold_px
    }

    fn area_px(&self, node: &Node) -> f64 {
        let pixels = self.frusta.iter().map(|f| f.pixels).fold(0.0, f64::max);
        ((node.max - node.min).length() / 2.0 * self.scale * pixels).powi(2)
    }
}

/// Finds what of one model casts on what is seen.
pub fn select_casters(
    skeleton: &Skeleton,
    view: &CasterView,
    is_resident: &dyn Fn(u32, usize) -> bool,
) -> Front {
    find_front(skeleton, view, is_resident)
}

#[cfg(test)]
mod tests {
    use hlod_compress::NormalCone;
    use proptest::prelude::*;

    use super::*;
    use crate::camera::Camera;
    use crate::scene::{BACKGROUND, Material, Paint, Shadow};
    use crate::select::tests::tree_of;
    use crate::select::{Selection, View, select};

    const SIZE: (u32, u32) = (640, 480);

    fn any_point(reach: f64) -> impl Strategy<Value = DVec3> {
        (-reach..reach, -reach..reach, -reach..reach).prop_map(DVec3::from)
    }

    fn any_light() -> impl Strategy<Value = Light> {
        prop_oneof![
            any_point(1.0).prop_map(Light::Directional),
            any_point(1.5).prop_map(Light::Point),
            any_point(40.0).prop_map(Light::Point),
        ]
    }

    fn camera(eye: DVec3, target: DVec3) -> Camera {
        let projection = Projection::Perspective { fov_y: 0.7 };
        Camera { eye, target, up: DVec3::Y, projection, near: 0.02 }
    }

    fn shot(camera: Camera, light: Light, light_size: f64) -> Shot {
        Shot {
            camera,
            light,
            spot: None,
            material: Material::default(),
            enhance: Default::default(),
            background: BACKGROUND,
            representation: Default::default(),
            paint: Paint::Shaded,
            error_threshold_px: 0.5,
            shadow: Shadow::Soft,
            light_size,
            caster_threshold_px: 0.5,
            intensity_step: crate::scene::INTENSITY_STEP,
            sample_offset_px: DVec2::ZERO,
            draw_backs: false,
            backs_magenta: false,
            draw_skirts: true,
            mixing: crate::scene::Mixing::None,
            clip: crate::clip::ClipPlanes::default(),
        }
    }

    proptest! {
        /// On the way from any visible point to the light: whatever casts is drawn, and so fine that
        /// the shadow's edge moves by no more than τ_c where the point is seen.
        #[test]
        fn what_may_cast_is_drawn_and_fine_enough(
            eye in any_point(3.0),
            target in any_point(0.5),
            light in any_light(),
            threshold_px in 0.2..8.0f64,
            seen in any_point(1.0),
            along in 0.0..1.0f64,
        ) {
            prop_assume!(eye.distance(target) > 0.1);
            let cone = NormalCone::ALL;
            let receivers = tree_of(3, cone, RepresentationKind::Appearance);
            let casters = tree_of(4, cone, RepresentationKind::Geometric);
            let camera = camera(eye, target);
            let view = View::new(&camera, DMat4::IDENTITY, SIZE.0, SIZE.1);
            let kind = RepresentationKind::Appearance;
            let selection = Selection { kind, error_threshold_px: 2.0 };
            let front = select(&receivers, &view, selection, &|_, _| true);
            let boxes: Vec<(u8, [DVec3; 8])> = front.draws.iter().map(|draw| {
                let node = &receivers.nodes()[draw.node as usize];
                (node.depth, corners(node.min, node.max))
            }).collect();
            // Points that are drawn and in the picture.
            let clip = camera.clip_from_view(640.0 / 480.0) * camera.view_from_world() * seen.extend(1.0);
            prop_assume!(clip.x.abs() < clip.w && clip.y.abs() < clip.w && clip.z < clip.w);
            let caster_view =
                CasterView::new(&shot(camera, light, 0.0), SIZE, &boxes, threshold_px, DMat4::IDENTITY);
            let front = select_casters(&casters, &caster_view, &|_, _| true);
            let (way, leverage) = match light {
                // Until it leaves the model's box.
                Light::Directional(d) => (d.normalize() * 4.0, 1.0),
                Light::Point(l) => (l - seen, 1.0 / (1.0 - along)),
            };
            let point = seen + way * along;
            prop_assume!(point.abs().max_element() < 1.0);
            let holds = |node: &Node| {
                point.cmpge(node.min).all() && point.cmple(node.max).all()
            };
            let node = front.draws.iter().map(|d| &casters.nodes()[d.node as usize]).find(|n| holds(n));
            let Some(node) = node else {
                return Err(TestCaseError::fail(format!("nothing is drawn at {point}")));
            };
            let error = node.representations[0].error;
            let depth = (eye - seen).dot(camera.axes()[2]);
            let pixel = 2.0 * camera.half_extent(1.0).y * depth / f64::from(SIZE.1);
            let shift_px = error * leverage / pixel;
            prop_assert!(shift_px <= threshold_px * (1.0 + 1e-9), "{shift_px} px at {point}");
        }
    }

    #[test]
    fn steps_of_brightness_are_allowed_where_penumbrae_are_wide_alone() {
        let casters = tree_of(4, NormalCone::ALL, RepresentationKind::Geometric);
        let floor = corners(DVec3::new(-1.0, -9.0, -1.0), DVec3::new(1.0, -8.0, 1.0));
        let camera = camera(DVec3::new(0.0, -5.0, 12.0), DVec3::new(0.0, -8.0, 0.0));
        let root_px = |light_size: f64, intensity_step: f64| {
            let shot =
                Shot { intensity_step, ..shot(camera, Light::Directional(DVec3::Y), light_size) };
            let view = CasterView::new(&shot, SIZE, &[(0, floor)], 0.5, DMat4::IDENTITY);
            view.error_px(0.1, &casters.nodes()[0])
        };
        assert_eq!(root_px(0.0, 0.5), root_px(0.0, 0.0), "hard edges have no penumbra");
        assert_eq!(root_px(3.0, 0.0), root_px(0.0, 0.0), "no step is allowed");
        // A caster that is wrong by e moves an edge by e, and a point in a penumbra that is w wide sees e / w
        // more or less of the light: as much as γ allows when e = γ w, besides what τ_c allows.
        let [gap, gamma] = [7.0, 1.0 / 64.0];
        let width = 2.0 * 1.5f64.to_radians().tan() * gap;
        let allowed = |px: f64| 0.5 * 0.1 / px;
        let more = allowed(root_px(3.0, gamma)) - allowed(root_px(3.0, 0.0));
        // The floor's box along the camera's axes is a little nearer.
        assert!((0.85..=1.0).contains(&(more / (gamma * width))), "{more} {}", gamma * width);
    }

    #[test]
    fn lamps_close_to_what_casts_ask_for_more_than_distant_ones() {
        let casters = tree_of(4, NormalCone::ALL, RepresentationKind::Geometric);
        // A floor far below the model.
        let floor = corners(DVec3::new(-1.0, -9.0, -1.0), DVec3::new(1.0, -8.0, 1.0));
        let camera = camera(DVec3::new(0.0, -5.0, 12.0), DVec3::new(0.0, -8.0, 0.0));
        let view = |light: Light, boxes: &[(u8, [DVec3; 8])]| {
            CasterView::new(&shot(camera, light, 0.0), SIZE, boxes, 0.5, DMat4::IDENTITY)
        };
        let nodes = |light: Light, boxes: &[(u8, [DVec3; 8])]| {
            select_casters(&casters, &view(light, boxes), &|_, _| true).draws.len()
        };
        let root_px = |light: Light| view(light, &[(0, floor)]).error_px(0.1, &casters.nodes()[0]);
        let parallel = root_px(Light::Directional(DVec3::Y));
        let high = root_px(Light::Point(DVec3::Y * 400.0));
        let close = root_px(Light::Point(DVec3::Y * 1.5));
        assert!(high > parallel && high < 1.1 * parallel, "{parallel} {high}");
        // From a lamp half a unit above the model to the floor it is twenty times as far, and to the
        // corners of the box along the camera's axes a little more.
        assert!((20.0..35.0).contains(&(close / parallel)), "{parallel} {close}");
        // Light from below meets nothing on its way, and neither does what nobody sees.
        assert_eq!(nodes(Light::Directional(-DVec3::Y), &[(0, floor)]), 0);
        assert_eq!(nodes(Light::Directional(DVec3::Y), &[]), 0);
    }
}
