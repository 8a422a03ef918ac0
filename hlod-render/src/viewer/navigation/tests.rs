use super::*;

const SIZE: DVec2 = DVec2::new(1000.0, 700.0);

/// A statue of 2 × 8 × 3, ten kilometres from the origin.
fn framing() -> Framing {
    let at = DVec3::new(10_000.0, -3_000.0, 500.0);
    let half = DVec3::new(1.0, 4.0, 1.5);
    Framing::new((at - half, at + half), DVec3::Y, DVec3::Z)
}

fn navigation(parallel: bool) -> Navigation {
    let mut n = Navigation::new(framing(), SIZE);
    if parallel {
        n.toggle_parallel();
    }
    n
}

fn settle(n: &mut Navigation) {
    for _ in 0..100 {
        n.advance(0.02);
    }
    assert!(!n.is_moving());
}

/// A point of the statue near the picture's middle, and the pixel at which it is seen.
fn anchor(n: &Navigation) -> (DVec3, DVec2) {
    let point = n.framing().point([0.05, 0.2, 0.15]);
    (point, n.lens().pixel_of(point).unwrap())
}

fn assert_seen_at(n: &Navigation, point: DVec3, pixel: DVec2) {
    let seen = n.lens().pixel_of(point);
    assert!(seen.is_some_and(|p| p.distance(pixel) < 0.01), "{seen:?} instead of {pixel}");
}

fn assert_upright(n: &Navigation) {
    let [right, up, _] = n.camera().axes();
    assert!(right.dot(n.framing().axes[1]).abs() < 1e-9);
    assert!(up.dot(n.framing().axes[1]) > -1e-9);
}

fn assert_all_seen(n: &Navigation) {
    let mut widest: f64 = 0.0;
    for corner in n.framing().corners {
        let p = n.lens().pixel_of(corner).unwrap() / SIZE * 2.0 - 1.0;
        widest = widest.max(p.x.abs()).max(p.y.abs());
    }
    assert!((0.8..=1.0).contains(&widest), "{widest}");
}

#[test]
fn orbit_keeps_its_pivot_at_the_same_pixel_and_the_view_upright() {
    for parallel in [false, true] {
        let mut n = navigation(parallel);
        let (point, pixel) = anchor(&n);
        let before = n.camera();
        n.begin(Drag::Orbit, pixel, Some(point));
        for i in 1..30 {
            n.drag_to(pixel + DVec2::new(f64::from(i) * 37.0, f64::from(i % 7) * 60.0));
            assert_seen_at(&n, point, pixel);
            assert_upright(&n);
        }
        assert_ne!(n.camera(), before);
    }
}

#[test]
fn orbit_follows_the_cursor() {
    let mut n = navigation(false);
    n.named_view(0);
    settle(&mut n);
    n.begin(Drag::Orbit, SIZE / 2.0, None);
    n.drag_to(SIZE / 2.0 + DVec2::new(100.0, 50.0));
    // The front turns to the right: the eye goes to the left, and up.
    let eye = n.framing().relative(n.camera().eye);
    assert!(eye[0] < -0.1 && eye[1] > 0.1 && eye[2] > 0.1, "{eye:?}");
}

#[test]
fn pan_keeps_the_grabbed_point_under_the_cursor() {
    for parallel in [false, true] {
        let mut n = navigation(parallel);
        let (point, pixel) = anchor(&n);
        n.begin(Drag::Pan, pixel, Some(point));
        for offset in [DVec2::new(10.0, -3.0), DVec2::new(-200.0, 100.0), DVec2::new(300.0, 250.0)]
        {
            n.drag_to(pixel + offset);
            assert_seen_at(&n, point, pixel + offset);
        }
    }
}

#[test]
fn a_depth_that_arrives_late_takes_over_without_a_jump() {
    let mut n = navigation(false);
    let (point, pixel) = anchor(&n);
    n.begin(Drag::Pan, pixel, None);
    n.drag_to(pixel + DVec2::new(40.0, 0.0));
    let before = n.camera();
    // What is under the cursor now.
    let lens = n.lens();
    let point = lens.point_at(pixel + DVec2::new(40.0, 0.0), lens.depth_of(point));
    n.set_anchor(point);
    assert!(n.camera().eye.distance(before.eye) < 1e-6);
    n.drag_to(pixel + DVec2::new(140.0, 20.0));
    assert_seen_at(&n, point, pixel + DVec2::new(140.0, 20.0));
}

#[test]
fn zoom_keeps_the_point_under_the_cursor_and_has_limits() {
    for parallel in [false, true] {
        let mut n = navigation(parallel);
        let (point, pixel) = anchor(&n);
        let length = |n: &Navigation| n.lens().pixel_length(n.lens().depth_of(point));
        let before = length(&n);
        n.zoom(pixel, Some(point), 3.0);
        assert_seen_at(&n, point, pixel);
        assert!((length(&n) / before - 0.85f64.powi(3)).abs() < 1e-6);
        n.zoom(pixel, Some(point), -5.0);
        assert_seen_at(&n, point, pixel);

        for _ in 0..200 {
            n.zoom(pixel, Some(point), 5.0);
        }
        assert_seen_at(&n, point, pixel);
        let nearest = n.lens().depth_of(point);
        assert!(nearest > 2.0 * n.camera().near, "{nearest}");
        for _ in 0..200 {
            n.zoom(DVec2::new(3.0, 5.0), None, -20.0);
        }
        let away = n.camera().eye.distance(n.framing().centre);
        assert!(away < 25.0 * 8.8, "{away}");
    }
}

#[test]
fn without_a_known_depth_zoom_approaches_what_was_looked_at() {
    let mut n = navigation(false);
    let before = n.camera().eye.distance(n.framing().centre);
    n.zoom(SIZE / 2.0, None, 2.0);
    let after = n.camera().eye.distance(n.framing().centre);
    assert!((after / before - 0.85f64.powi(2)).abs() < 1e-6);
}

#[test]
fn fit_and_named_views_show_everything() {
    for parallel in [false, true] {
        let mut n = navigation(parallel);
        for (number, (_, direction)) in NAMED_VIEWS.iter().enumerate() {
            n.named_view(number);
            settle(&mut n);
            assert_all_seen(&n);
            let camera = n.framing().fitting(*direction, SIZE.x / SIZE.y, FOV_Y_DEG);
            let (expected, axes) = (camera.axes(), n.camera().axes());
            assert!((0..3).all(|i| expected[i].distance(axes[i]) < 1e-6), "{number}: {axes:?}");
        }
        n.turn(3.0, 1.0);
        n.fit();
        settle(&mut n);
        assert_all_seen(&n);
    }
}

#[test]
fn a_statue_that_fills_the_picture_still_does_when_the_window_changes() {
    let mut n = navigation(false);
    n.resize(DVec2::new(300.0, 700.0));
    n.resize(SIZE);
    assert_all_seen(&n);
    // Whoever has moved keeps their distance.
    n.turn(1.0, 0.0);
    let before = n.camera();
    n.resize(DVec2::new(300.0, 700.0));
    assert_eq!(n.camera(), before);
}

#[test]
fn fit_returns_from_everywhere() {
    for parallel in [false, true] {
        let mut n = navigation(parallel);
        let mut state = 7u64;
        let mut random = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 33) as f64 / f64::from(1u32 << 31)
        };
        for round in 0..40 {
            for _ in 0..20 {
                let cursor = DVec2::new(random(), random()) * SIZE;
                let point = n.lens().point_at(cursor, random() * 100.0);
                match (random() * 6.0) as u32 {
                    0 => n.begin(Drag::Orbit, cursor, Some(point)),
                    1 => n.begin(Drag::Pan, cursor, None),
                    2 => n.zoom(cursor, None, random() * 40.0 - 20.0),
                    3 => n.centre(point),
                    4 => n.toggle_parallel(),
                    _ => n.toggle_flying(),
                }
                n.set_fly_input(FlyInput {
                    direction: DVec3::new(random(), -1.0, 1.0),
                    fast: true,
                });
                n.drag_to(DVec2::new(random(), random()) * SIZE * 9.0);
                n.advance(random());
                assert!(n.camera().eye.is_finite());
                assert_upright(&n);
            }
            n.fit();
            settle(&mut n);
            assert_all_seen(&n);
            n.home();
            settle(&mut n);
            let home = n.fitted(n.home);
            assert_eq!(n.pose, home, "round {round}");
        }
    }
}

#[test]
fn centring_brings_a_point_to_the_middle_at_its_distance() {
    let mut n = navigation(false);
    let (point, pixel) = anchor(&n);
    let depth = n.lens().depth_of(point);
    n.centre(point);
    settle(&mut n);
    assert_ne!(pixel, SIZE / 2.0);
    assert_seen_at(&n, point, SIZE / 2.0);
    assert!((n.lens().depth_of(point) - depth).abs() < 1e-6);
}

#[test]
fn changing_the_projection_keeps_what_is_looked_at_in_place_and_size() {
    let mut n = navigation(false);
    n.turn(1.0, 1.0);
    let focus = n.camera().target;
    let before = n.lens().pixel_length(n.lens().depth_of(focus));
    n.toggle_parallel();
    assert_seen_at(&n, focus, SIZE / 2.0);
    let after = n.lens().pixel_length(n.lens().depth_of(focus));
    assert!((before - after).abs() < 1e-9);
}

#[test]
fn flying_is_as_fast_as_the_surface_is_far() {
    let mut n = navigation(false);
    n.toggle_flying();
    n.set_fly_input(FlyInput { direction: DVec3::Z, fast: false });
    let eye = n.camera().eye;
    n.surface_ahead(2.0);
    assert!(n.camera().eye.distance(eye) < 1e-9);
    n.advance(0.1);
    assert!((n.camera().eye.distance(eye) - 0.2).abs() < 1e-6);
    // Looking round leaves the eye where it is.
    let eye = n.camera().eye;
    n.set_fly_input(FlyInput::default());
    n.begin(Drag::Look, SIZE / 2.0, None);
    n.drag_to(SIZE);
    assert!(n.camera().eye.distance(eye) < 1e-6 && !n.is_moving());
}
