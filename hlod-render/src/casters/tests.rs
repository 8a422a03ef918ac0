use hlod_compress::NormalCone;
use proptest::prelude::*;

use super::*;
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

pub(crate) fn casting(light: Light, light_size: f64, threshold_px: f64) -> Casting {
    let light_radius = crate::scene::light_radius(light, light_size);
    Casting { light, light_radius, threshold_px, intensity_step: crate::scene::INTENSITY_STEP }
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
        let boxes: Vec<Receiver> = front.draws.iter().map(|draw| {
            Receiver::of(&receivers.nodes()[draw.node as usize], &DMat4::IDENTITY)
        }).collect();
        // Points that are drawn and in the picture.
        let clip = camera.clip_from_view(640.0 / 480.0) * camera.view_from_world() * seen.extend(1.0);
        prop_assume!(clip.x.abs() < clip.w && clip.y.abs() < clip.w && clip.z < clip.w);
        let caster_view =
            CasterView::new(&casting(light, 0.0, threshold_px), &camera, SIZE, &boxes, DMat4::IDENTITY);
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

proptest! {
    /// Every point of a box, on its way to any point of the light, is met by whatever holds it.
    #[test]
    fn boxes_on_the_way_are_met(
        from in any_point(2.0), size in any_point(1.0), light in any_point(3.0), width in 0.0..0.5f64,
        parallel in any::<bool>(), inside in any_point(1.0), lit in any_point(1.0),
        share in 0.0..1.0f64, around in any_point(0.1),
    ) {
        let receivers = [from - size.abs(), from + size.abs()];
        let source = [light - width, light + width];
        let (start, end) = (from + inside * size.abs(), light + lit * width);
        let point = if parallel { start + end * 4.0 * share } else { start.lerp(end, share) };
        let holds = [point - around.abs(), point + around.abs()];
        prop_assert!(meets_on_the_way(&receivers, &source, parallel, &holds));
    }
}

/// No box round the way would tell: what lies beside it, next to a corner, is not met.
#[test]
fn boxes_beside_the_way_are_not_met() {
    let cube = |p: DVec3, half: f64| [p - half, p + half];
    let receivers = cube(DVec3::ZERO, 1.0);
    let meets = |to: DVec3, parallel: bool, other: DVec3| {
        meets_on_the_way(&receivers, &[to, to], parallel, &cube(other, 0.25))
    };
    let diagonal = DVec3::new(1.0, 1.0, 0.0);
    // Halfway to a lamp the box is half as large.
    let lamp = diagonal * 8.0;
    assert!(meets(lamp, false, diagonal * 4.0) && meets(lamp, false, DVec3::new(4.7, 3.3, 0.0)));
    assert!(!meets(lamp, false, DVec3::new(5.0, 3.0, 0.0)) && !meets(lamp, false, diagonal * 9.0));
    assert!(
        meets(diagonal, true, DVec3::new(5.0, 3.0, 0.0)) && meets(diagonal, true, diagonal * 9.0)
    );
    assert!(!meets(diagonal, true, DVec3::new(5.4, 2.6, 0.0)));
    assert!(!meets(diagonal, true, diagonal * -2.0) && !meets(lamp, false, diagonal * -2.0));
    // A lamp within the box has nothing beyond it.
    assert!(meets(DVec3::ZERO, false, diagonal) && !meets(DVec3::ZERO, false, diagonal * 1.5));
}

#[test]
fn steps_of_brightness_are_allowed_where_penumbrae_are_wide_alone() {
    let casters = tree_of(4, NormalCone::ALL, RepresentationKind::Geometric);
    let corners = corners(DVec3::new(-1.0, -9.0, -1.0), DVec3::new(1.0, -8.0, 1.0));
    let floor = Receiver { cluster: CellKey::ROOT, corners };
    let camera = camera(DVec3::new(0.0, -5.0, 12.0), DVec3::new(0.0, -8.0, 0.0));
    let root_px = |light_size: f64, intensity_step: f64| {
        let casting =
            Casting { intensity_step, ..casting(Light::Directional(DVec3::Y), light_size, 0.5) };
        let view = CasterView::new(&casting, &camera, SIZE, &[floor], DMat4::IDENTITY);
        view.error_px(0.1, &casters.nodes()[0])
    };
    assert_eq!(root_px(0.0, 0.5), root_px(0.0, 0.0), "hard edges have no penumbra");
    assert_eq!(root_px(3.0, 0.0), root_px(0.0, 0.0), "no step is allowed");
    // A caster that is wrong by e moves an edge by e, and a point in a penumbra that is w wide sees up to 4 e / w
    // more or less of the light: as much as γ allows when e = γ w / 4, besides what τ_c allows.
    let [gap, gamma] = [7.0, 1.0 / 64.0];
    let width = 2.0 * 1.5f64.to_radians().tan() * gap / 4.0;
    let allowed = |px: f64| 0.5 * 0.1 / px;
    let more = allowed(root_px(3.0, gamma)) - allowed(root_px(3.0, 0.0));
    assert!((more / (gamma * width) - 1.0).abs() < 1e-9, "{more} {}", gamma * width);
}

#[test]
fn lamps_close_to_what_casts_ask_for_more_than_distant_ones() {
    let casters = tree_of(4, NormalCone::ALL, RepresentationKind::Geometric);
    // A floor far below the model.
    let corners = corners(DVec3::new(-1.0, -9.0, -1.0), DVec3::new(1.0, -8.0, 1.0));
    let floor = Receiver { cluster: CellKey::ROOT, corners };
    let camera = camera(DVec3::new(0.0, -5.0, 12.0), DVec3::new(0.0, -8.0, 0.0));
    let view = |light: Light, boxes: &[Receiver]| {
        CasterView::new(&casting(light, 0.0, 0.5), &camera, SIZE, boxes, DMat4::IDENTITY)
    };
    let nodes = |light: Light, boxes: &[Receiver]| {
        select_casters(&casters, &view(light, boxes), &|_, _| true).draws.len()
    };
    let root_px = |light: Light| view(light, &[floor]).error_px(0.1, &casters.nodes()[0]);
    let parallel = root_px(Light::Directional(DVec3::Y));
    let high = root_px(Light::Point(DVec3::Y * 400.0));
    let close = root_px(Light::Point(DVec3::Y * 1.5));
    assert!(high > parallel && high < 1.1 * parallel, "{parallel} {high}");
    // From a lamp half a unit above the model to the floor's corners it is twenty times as far.
    assert!((20.0..23.0).contains(&(close / parallel)), "{parallel} {close}");
    // Light from below meets nothing on its way, and neither does what nobody sees.
    assert_eq!(nodes(Light::Directional(-DVec3::Y), &[floor]), 0);
    assert_eq!(nodes(Light::Directional(DVec3::Y), &[]), 0);
}

/// What hides a distant floor alone may be as coarse as distance allows, whatever else is seen from near by.
#[test]
fn what_casts_on_distant_ground_is_measured_there() {
    let casters = tree_of(4, NormalCone::ALL, RepresentationKind::Geometric);
    let camera = camera(DVec3::new(0.0, -8.0, 12.0), DVec3::new(0.0, -8.0, 0.0));
    let floor = |z: f64| {
        let corners = corners(DVec3::new(-1.0, -9.0, z - 1.0), DVec3::new(1.0, -8.5, z + 1.0));
        Receiver { cluster: CellKey::ROOT, corners }
    };
    let (near, far) = (floor(10.0), floor(0.0));
    let root_px = |seen: &[Receiver]| {
        let casting = casting(Light::Directional(DVec3::Y), 0.0, 0.5);
        CasterView::new(&casting, &camera, SIZE, seen, DMat4::IDENTITY)
            .error_px(0.1, &casters.nodes()[0])
    };
    assert_eq!(root_px(&[near]), 0.0, "it hides nothing of what is near");
    assert!(root_px(&[far]) > 0.0);
    assert_eq!(root_px(&[near, far]), root_px(&[far]));
}
