use glam::{DQuat, DVec3};
use hlod_compress::NormalCone;
use proptest::prelude::*;

use super::*;
use crate::camera::Projection;
use crate::casters::select_casters;
use crate::casters::tests::casting;
use crate::need::Need;
use crate::select::tests::tree_of;
use crate::select::{Selection, View, select};

const SIZE: (u32, u32) = (640, 480);
const RECEIVERS: Selection =
    Selection { kind: RepresentationKind::Appearance, error_threshold_px: 2.0 };
const ENDS: [f64; 5] = [0.0, 0.1, 0.3, 0.6, 1.0];

fn camera(eye: DVec3, rotation: DQuat, projection: Projection) -> Camera {
    let (target, up) = (eye + rotation * DVec3::NEG_Z, rotation * DVec3::Y);
    Camera { eye, target, up, projection, near: 0.01 }
}

fn view(camera: &Camera) -> View {
    View::new(camera, DMat4::IDENTITY, SIZE.0, SIZE.1)
}

/// What may be wanted of `casters` where all of `receivers` is there.
fn planned(outlook: &Outlook<'_>, receivers: &Skeleton, casters: &Skeleton, ends: &[f64]) -> Plan {
    let view = view(outlook.camera);
    let need = Need::new(&view, RECEIVERS, outlook.pace);
    let plan = need.plan(receivers, f64::INFINITY, u64::MAX, &|_, _| 1);
    let boxes = receivers_of(&plan, receivers, &DMat4::IDENTITY);
    CastersAhead::new(outlook, &boxes, DMat4::IDENTITY, ends).plan(casters, u64::MAX, &|_, _| 1)
}

/// Nodes that cast where all of both is there.
fn drawn(casting: &Casting, camera: &Camera, receivers: &Skeleton, casters: &Skeleton) -> Vec<u32> {
    let boxes: Vec<Receiver> = select(receivers, &view(camera), RECEIVERS, &|_, _| true)
        .draws
        .iter()
        .map(|draw| Receiver::of(&receivers.nodes()[draw.node as usize], &DMat4::IDENTITY))
        .collect();
    let view = CasterView::new(casting, camera, SIZE, &boxes, DMat4::IDENTITY);
    let front = select_casters(casters, &view, &|_, _| true);
    front.draws.iter().map(|draw| draw.node).collect()
}

fn secs_of(plan: &Plan, node: u32) -> f64 {
    let due = plan.pages.iter().find(|due| due.what.0 == node);
    due.map_or(f64::INFINITY, |due| due.secs)
}

fn direction() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-1.0..1.0f64)
        .prop_map(DVec3::from_array)
        .prop_filter("a direction", |v| v.length() > 0.1)
        .prop_map(DVec3::normalize)
}

fn any_light() -> impl Strategy<Value = Light> {
    prop_oneof![
        direction().prop_map(Light::Directional),
        (direction(), 0.1..6.0f64).prop_map(|(d, distance)| Light::Point(d * distance)),
        (direction(), 6.0..40.0f64).prop_map(|(d, distance)| Light::Point(d * distance)),
    ]
}

/// An eye and where it looks: at the model, roughly.
fn any_eye() -> impl Strategy<Value = (DVec3, DQuat)> {
    (direction(), 0.3..8.0f64, direction(), 0.0..0.7f64).prop_map(
        |(from, distance, axis, angle)| {
            let towards = DQuat::from_rotation_arc(DVec3::Z, from);
            (from * distance, DQuat::from_axis_angle(axis, angle) * towards)
        },
    )
}

fn any_projection() -> impl Strategy<Value = Projection> {
    prop_oneof![
        (0.05..1.2f64).prop_map(|fov_y| Projection::Perspective { fov_y }),
        (0.05..3.0f64).prop_map(|height| Projection::Orthographic { height }),
    ]
}

proptest! {
    /// Whatever path eye and light take within their pace: what casts at the end was due by then.
    #[test]
    fn nothing_is_wanted_before_it_is_due(
        (eye, rotation) in any_eye(), projection in any_projection(),
        (goes, moves, turns) in (direction(), direction(), direction()),
        (speed, spread, turn) in (0.0..1.0f64, 0.0..0.5f64, 0.0..1.0f64),
        light in any_light(), light_size in prop_oneof![Just(0.0), 0.0..0.2f64],
        light_goes in direction(), light_speed in 0.0..1.0f64,
        tau in 0.2..20.0f64, secs in 0.0..1.0f64,
    ) {
        let receivers = tree_of(3, NormalCone::ALL, RepresentationKind::Appearance);
        let casters = tree_of(4, NormalCone::ALL, RepresentationKind::Geometric);
        let before = camera(eye, rotation, projection);
        let velocity = rotation.inverse() * goes * speed;
        let pace = Pace { velocity, spread, turn };
        let casting = casting(light, light_size, tau);
        let outlook = Outlook { casting, camera: &before, size: SIZE, pace, light_speed };
        let plan = planned(&outlook, &receivers, &casters, &ENDS);

        let eye = eye + (goes * speed + moves * spread) * secs;
        let after = camera(eye, DQuat::from_axis_angle(turns, turn * secs) * rotation, projection);
        let light = match light {
            Light::Point(light) => Light::Point(light + light_goes * light_speed * secs),
            Light::Directional(towards) => {
                let turned = DQuat::from_axis_angle(light_goes, light_speed * secs) * towards;
                Light::Directional(turned)
            }
        };
        for node in drawn(&Casting { light, ..casting }, &after, &receivers, &casters) {
            let due = secs_of(&plan, node);
            prop_assert!(due <= secs, "node {node} after {secs} s, due after {due}");
        }
    }
}

const STILL: Pace = Pace { velocity: DVec3::ZERO, spread: 0.0, turn: 0.0 };

/// Of one corner of the model, close by, in light from the side.
fn close_up(light: Light) -> (Camera, Casting) {
    let eye = DVec3::new(0.8, 0.8, 1.3);
    let projection = Projection::Perspective { fov_y: 0.3 };
    (camera(eye, DQuat::IDENTITY, projection), casting(light, 0.0, 0.5))
}

/// Where nothing moves hardly more is due than what casts now, and never anything else.
#[test]
fn bounds_are_not_far_from_what_is_wanted() {
    let receivers = tree_of(3, NormalCone::ALL, RepresentationKind::Appearance);
    let casters = tree_of(4, NormalCone::ALL, RepresentationKind::Geometric);
    for light in [Light::Directional(DVec3::X), Light::Point(DVec3::new(4.0, 1.0, 0.5))] {
        let (camera, casting) = close_up(light);
        let outlook = |pace, light_speed| {
            let outlook = Outlook { casting, camera: &camera, size: SIZE, pace, light_speed };
            planned(&outlook, &receivers, &casters, &ENDS).pages.len()
        };
        let wanted = drawn(&casting, &camera, &receivers, &casters).len();
        let still = outlook(STILL, 0.0);
        println!("{wanted} cast, {still} due; all: {}", casters.nodes().len());
        assert!(wanted > 10 && still >= wanted && still < 2 * wanted, "{wanted} {still}");
        let light_moves = outlook(STILL, 1.0);
        let eye_moves = outlook(Pace { spread: 0.3, ..STILL }, 0.0);
        let eye_turns = outlook(Pace { turn: 0.3, ..STILL }, 0.0);
        println!("{light_moves} where the light moves, {eye_moves} {eye_turns} where the eye does");
        for more in [light_moves, eye_moves, eye_turns] {
            assert!(more > still && more < casters.nodes().len(), "{still} {more}");
        }
    }
}

/// Light that turns meets what is beside its way: the farther beside, the later it is due.
#[test]
fn what_is_beside_the_way_is_due_later_the_farther_it_is() {
    let receivers = tree_of(3, NormalCone::ALL, RepresentationKind::Appearance);
    let casters = tree_of(3, NormalCone::ALL, RepresentationKind::Geometric);
    let (camera, casting) = close_up(Light::Directional(DVec3::NEG_X));
    let outlook = Outlook { casting, camera: &camera, size: SIZE, pace: STILL, light_speed: 0.3 };
    let plan = planned(&outlook, &receivers, &casters, &ENDS);
    // Leaves at the far side, in rows away from what is seen.
    let due = |y: f64| {
        let point = DVec3::new(-0.9, y, 0.9);
        let holds = |node: &Node| point.cmpgt(node.min).all() && point.cmplt(node.max).all();
        let leaf = casters.nodes().iter().rposition(holds).expect("the model fills its cube");
        secs_of(&plan, leaf as u32)
    };
    let times = [0.9, 0.4, 0.1, -0.9].map(due);
    println!("{times:?}");
    assert!(times[0] == 0.0 && times.windows(2).all(|w| w[0] <= w[1]), "{times:?}");
    assert!(times[2] > 0.0 && times[3] == f64::INFINITY, "{times:?}");
}

#[test]
fn plans_are_in_order_and_within_limits() {
    let receivers = tree_of(3, NormalCone::ALL, RepresentationKind::Appearance);
    let casters = tree_of(4, NormalCone::ALL, RepresentationKind::Geometric);
    let (camera, casting) = close_up(Light::Directional(DVec3::X));
    let pace = Pace { spread: 0.3, ..STILL };
    let outlook = Outlook { casting, camera: &camera, size: SIZE, pace, light_speed: 0.3 };
    let all = planned(&outlook, &receivers, &casters, &ENDS);
    assert!(all.pages.windows(2).all(|w| w[0].secs <= w[1].secs));
    let boxes = receivers_of(&Plan::default(), &receivers, &DMat4::IDENTITY);
    let nothing = CastersAhead::new(&outlook, &boxes, DMat4::IDENTITY, &ENDS);
    assert_eq!(nothing.plan(&casters, u64::MAX, &|_, _| 1), Plan::default(), "nobody sees any");
    // Merged with itself it stays what it is; of two plans the sooner time counts.
    let one: crate::need::BytesOf<'_> = &|_, _| 10;
    let budget = |bytes| Budget { bytes, bytes_of: one };
    assert_eq!(all.clone().merged(all.clone(), &casters, budget(u64::MAX)), all);
    let few = all.clone().merged(Plan::default(), &casters, budget(205));
    assert_eq!(few.pages, all.pages[..20]);
    let later = all.clone().later_by(1.0);
    assert_eq!(later.clone().merged(all.clone(), &casters, budget(u64::MAX)), all);
    assert_eq!(later.until(1.0).pages.len(), all.clone().until(0.0).pages.len());
}
