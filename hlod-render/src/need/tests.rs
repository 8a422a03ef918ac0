use glam::{DMat4, DQuat};
use hlod_compress::{NormalCone, OctNormal, RepresentationKind};
use proptest::prelude::*;

use super::*;
use crate::camera::Projection;
use crate::select::select;
use crate::select::tests::tree_of;

const APPEARANCE: RepresentationKind = RepresentationKind::Appearance;

fn camera(eye: DVec3, rotation: DQuat) -> Camera {
    let projection = Projection::Perspective { fov_y: 0.8 };
    Camera {
        eye,
        target: eye + rotation * DVec3::NEG_Z,
        up: rotation * DVec3::Y,
        projection,
        near: 0.01,
    }
}

fn view(camera: &Camera) -> View {
    View::new(camera, DMat4::IDENTITY, 640, 480)
}

fn selection(error_threshold_px: f64) -> Selection {
    Selection { kind: APPEARANCE, error_threshold_px }
}

fn whole_plan(need: &Need<'_>, skeleton: &Skeleton) -> Plan {
    need.plan(skeleton, f64::INFINITY, u64::MAX, &|_, _| 1)
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

proptest! {
    /// Whatever path the eye takes within its pace: what it wants at the end was due by then.
    #[test]
    fn nothing_is_wanted_before_it_is_due(
        eye in direction(), distance in 0.5..20.0f64,
        looks in direction(), turned in 0.0..6.0f64,
        goes in direction(), moves in direction(), turns in direction(),
        speed in 0.0..3.0f64, spread in 0.0..2.0f64, turn in 0.0..2.0f64, secs in 0.0..2.0f64,
        tau in 0.2..20.0f64, axis in direction(), cosine in -0.2..1.0f32,
    ) {
        let axis = OctNormal::encode(axis.as_vec3().to_array());
        let skeleton = tree_of(3, NormalCone { axis, cosine }, APPEARANCE);
        let eye = eye * distance;
        let rotation = DQuat::from_axis_angle(looks, turned);
        let before = view(&camera(eye, rotation));
        let velocity = rotation.inverse() * goes * speed;
        let need = Need::new(&before, selection(tau), Pace { velocity, spread, turn });
        let plan = whole_plan(&need, &skeleton);
        let eye = eye + (goes * speed + moves * spread) * secs;
        let rotation = DQuat::from_axis_angle(turns, turn * secs) * rotation;
        let after = view(&camera(eye, rotation));
        for draw in select(&skeleton, &after, selection(tau), &|_, _| true).draws {
            let due = secs_of(&plan, draw.node);
            prop_assert!(due <= secs + 1e-9, "node {} after {secs} s, due after {due}", draw.node);
        }
    }

    #[test]
    fn plans_are_in_order_and_within_limits(
        eye in direction(), distance in 0.5..20.0f64, bytes in 0u64..300, horizon in 0.0..5.0f64,
    ) {
        let skeleton = tree_of(3, NormalCone::ALL, APPEARANCE);
        let view = view(&camera(eye * distance, DQuat::IDENTITY));
        let need = Need::new(&view, selection(1.0), Pace { velocity: DVec3::X, spread: 1.0, turn: 1.0 });
        let plan = need.plan(&skeleton, horizon, bytes, &|_, _| 10);
        prop_assert!(plan.pages.len() as u64 * 10 <= bytes);
        prop_assert!(plan.pages.windows(2).all(|w| w[0].secs <= w[1].secs));
        prop_assert!(plan.pages.iter().all(|due| due.secs <= horizon));
        let all = whole_plan(&need, &skeleton);
        prop_assert_eq!(&all.pages[..plan.pages.len()], &plan.pages[..]);
    }

    /// What stands in for a page is there before it.
    #[test]
    fn what_is_planned_follows_its_ancestors(
        eye in direction(), distance in 0.5..20.0f64, bytes in 0u64..600, tau in 0.2..20.0f64,
    ) {
        let skeleton = tree_of(3, NormalCone::ALL, APPEARANCE);
        let view = view(&camera(eye * distance, DQuat::IDENTITY));
        let need = Need::new(&view, selection(tau), Pace { velocity: DVec3::X, spread: 1.0, turn: 1.0 });
        let alone = whole_plan(&need, &skeleton);
        let within = |bytes| {
            let budget = Budget { bytes, bytes_of: &|_, _| 10 };
            alone.clone().with_ancestors(APPEARANCE, &skeleton, budget)
        };
        let plan = within(bytes);
        prop_assert!(plan.pages.len() as u64 * 10 <= bytes);
        prop_assert!(plan.pages.windows(2).all(|w| w[0].secs <= w[1].secs));
        let mut planned = HashSet::new();
        for due in &plan.pages {
            let (node, parent) = (due.what.0, skeleton.nodes()[due.what.0 as usize].parent);
            prop_assert!(node == 0 || planned.contains(&parent), "{node} before {parent}");
            prop_assert!(planned.insert(node), "{node} twice");
        }
        // Nothing is lost or comes later where there is room.
        let all = within(u64::MAX);
        prop_assert!(alone.pages.iter().all(|due| secs_of(&all, due.what.0) <= due.secs));
    }
}

/// Straight towards a node, without turning: due when the parent's error covers τ pixels.
#[test]
fn an_approach_is_due_when_it_is() {
    let skeleton = tree_of(1, NormalCone::ALL, APPEARANCE);
    let eye = DVec3::new(0.0, 0.0, 9.0);
    let view = view(&camera(eye, DQuat::IDENTITY));
    let need = Need::new(
        &view,
        selection(12.0),
        Pace { velocity: DVec3::Z * -1.5, spread: 0.5, turn: 0.0 },
    );
    let root = &skeleton.nodes()[0];
    let error = root.representations[0].error;
    let mut due = 0.0;
    // The nearest corner is at a depth of 8, and moves by 2 a second.
    let secs = secs_of(&whole_plan(&need, &skeleton), 1);
    for step in 0..4_000 {
        due = f64::from(step) * 1e-3;
        let later = View::new(
            &camera(eye - DVec3::Z * 2.0 * due, DQuat::IDENTITY),
            DMat4::IDENTITY,
            640,
            480,
        );
        if later.error_px(error, root.min, root.max) > 12.0 {
            break;
        }
    }
    assert!(due > 1.0 && secs <= due, "{secs} {due}");
    // What is given away is the picture's corner: 12 % of the depth.
    assert!(secs > due - 0.5, "{secs} {due}");
}

#[test]
fn what_is_behind_is_due_later_the_farther_it_is_round() {
    let skeleton = tree_of(2, NormalCone::ALL, APPEARANCE);
    let due = |angle: f64| {
        let rotation = DQuat::from_rotation_y(angle);
        let view = view(&camera(DVec3::new(0.0, 0.0, 8.0), rotation));
        let need = Need::new(
            &view,
            selection(1.0),
            Pace { velocity: DVec3::ZERO, spread: 0.0, turn: 1.0 },
        );
        // The first of the leaves.
        secs_of(&whole_plan(&need, &skeleton), 9)
    };
    assert_eq!(due(0.0), 0.0);
    let times = [0.8, 1.2, 1.6].map(due);
    assert!(times[0] > 0.1 && times[0] < times[1] && times[1] < times[2], "{times:?}");
    // The statue's edge and the picture's are nearer to each other than their middles.
    assert!(times[2] > 0.9 && times[2] < 1.6, "{times:?}");
    // Who never moves will never want more.
    let ahead = view(&camera(DVec3::Z * 8.0, DQuat::from_rotation_y(1.6)));
    let still =
        Need::new(&ahead, selection(1.0), Pace { velocity: DVec3::ZERO, spread: 0.0, turn: 0.0 });
    assert!(whole_plan(&still, &skeleton).pages.iter().all(|due| due.secs == f64::INFINITY));
}

/// Who moves away does not come near.
#[test]
fn directions_count() {
    let skeleton = tree_of(1, NormalCone::ALL, APPEARANCE);
    let view = view(&camera(DVec3::new(0.0, 0.0, 9.0), DQuat::IDENTITY));
    let due = |velocity| {
        let pace = Pace { velocity, spread: 0.1, turn: 0.0 };
        secs_of(&whole_plan(&Need::new(&view, selection(12.0), pace), &skeleton), 1)
    };
    let (towards, across, away) = (due(DVec3::NEG_Z), due(DVec3::X), due(DVec3::Z));
    assert!(towards < 3.0 && across > 7.0 && away == f64::INFINITY, "{towards} {across} {away}");
}

/// Who goes on for long passes what comes into view on the way: it is due when it comes.
#[test]
fn what_is_passed_is_due() {
    let skeleton = tree_of(3, NormalCone::ALL, APPEARANCE);
    let (eye, velocity) = (DVec3::new(0.0, 0.0, 0.5), DVec3::Y * 2.5);
    let before = view(&camera(eye, DQuat::IDENTITY));
    let pace = Pace { velocity, spread: 0.0, turn: 0.0 };
    let plan = whole_plan(&Need::new(&before, selection(0.2), pace), &skeleton);
    let after = view(&camera(eye + velocity / 6.0, DQuat::IDENTITY));
    let draws = select(&skeleton, &after, selection(0.2), &|_, _| true).draws;
    assert!(!draws.is_empty());
    for draw in draws {
        let due = secs_of(&plan, draw.node);
        assert!(due <= 1.0 / 6.0, "node {}: {due}", draw.node);
    }
}

#[test]
fn paces_follow_the_eye() {
    let mut tracker = PaceTracker::default();
    let still = Pace { velocity: DVec3::ZERO, spread: SPREAD_LEAST_HEIGHTS, turn: TURN_LEAST };
    let mut pace = still;
    for i in 0..30 {
        let secs = f64::from(i) / 20.0;
        // Along world x, which is to the side at first and ahead later.
        let at = camera(DVec3::new(4.0 * secs, 0.0, 9.0), DQuat::from_rotation_y(2.0 * secs));
        pace = tracker.note(secs, &at, 1.0);
    }
    let expected = DQuat::from_rotation_y(2.9).inverse() * DVec3::X * 4.0;
    assert!(pace.velocity.distance(expected) < 1e-6, "{pace:?}");
    assert!((pace.spread - 1.0).abs() < 1e-6 && (pace.turn - 3.0).abs() < 1e-6, "{pace:?}");
    // Who stopped just now may go on; after a second only as hands do.
    for i in 30..70 {
        let secs = f64::from(i) / 20.0;
        pace = tracker.note(secs, &camera(DVec3::new(6.0, 0.0, 9.0), DQuat::IDENTITY), 1.0);
        if i == 40 {
            assert!(pace.velocity == DVec3::ZERO && pace.spread > 3.0, "{pace:?}");
        }
    }
    assert_eq!(pace, still);
}

#[test]
fn paces_follow_the_light() {
    let mut tracker = LightTracker::default();
    let turned = |angle: f64| Light::Directional(DQuat::from_rotation_y(angle) * DVec3::X);
    let mut speed = 0.0;
    for i in 0..30 {
        let secs = f64::from(i) / 20.0;
        speed = tracker.note(secs, &turned(2.0 * secs), 4.0);
    }
    assert!((speed - 3.0).abs() < 1e-6, "{speed}");
    // Within a second it may go on as it did; later only as hands begin.
    for i in 30..70 {
        speed = tracker.note(f64::from(i) / 20.0, &turned(2.9), 4.0);
        assert!(i > 40 || speed > 2.0, "{i}: {speed}");
    }
    assert_eq!(speed, TURN_LEAST);
    // A lamp's speed is a length a second, and has nothing to do with how parallel light turned.
    for i in 70..90 {
        let secs = f64::from(i) / 20.0;
        speed = tracker.note(secs, &Light::Point(DVec3::Z * (9.0 + 8.0 * (secs - 3.5))), 4.0);
        assert!(i > 71 || speed == TURN_LEAST * 4.0, "{i}: {speed}");
    }
    assert!((speed - 12.0).abs() < 1e-6, "{speed}");
}
