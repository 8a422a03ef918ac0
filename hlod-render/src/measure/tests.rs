use super::*;

fn at(position: [f64; 3], file_bound: f64) -> SurfacePoint {
    SurfacePoint { position, normal: [0.0, 0.0, 1.0], file_bound, pixel_length: None }
}

#[test]
fn lengths_and_their_bounds_add_up_leg_by_leg() {
    let points = [at([0.0; 3], 0.1), at([3.0, 4.0, 0.0], 0.2), at([3.0, 4.0, 12.0], 0.4)];
    let (length, bound) = polyline(&points);
    assert_eq!(length, 17.0);
    assert!((bound - 0.9).abs() < 1e-12);
}

#[test]
fn angles_are_exact_and_their_bounds_hold_for_every_place_within_the_points_own() {
    let arms = |degrees: f64, e: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        angle(at([2.0, 0.0, 0.0], e), at([0.0; 3], e), at([3.0 * cos, 3.0 * sin, 0.0], e)).unwrap()
    };
    for degrees in [1e-6, 30.0, 90.0, 179.0, 180.0] {
        let measured = arms(degrees, 0.0);
        assert!((measured.value - degrees).abs() < 1e-10, "{degrees}: {}", measured.value);
        assert_eq!(measured.file_bound, Some(0.0));
    }
    // The worst places: ends off to the side, the vertex off along it.
    let e: f64 = 0.1;
    let bound = arms(90.0, e).file_bound.unwrap();
    let worst = (2.0 * e / 2.0).asin() + (2.0 * e / 3.0).asin();
    assert!((bound - worst.to_degrees()).abs() < 1e-9);
    for k in 0..1000 {
        let off = |i: u32| {
            let phase = f64::from(k * 7 + i * 331);
            e * DVec3::new(phase.sin(), (1.3 * phase).cos(), (0.7 * phase).sin()).normalize()
        };
        let place = |p: DVec3, i| at((p + off(i)).to_array(), 0.0);
        let moved =
            angle(place(DVec3::X * 2.0, 0), place(DVec3::ZERO, 1), place(DVec3::Y * 3.0, 2));
        assert!((moved.unwrap().value - 90.0).abs() <= bound);
    }
    assert_eq!(arms(90.0, 1.5).file_bound, Some(180.0));
    assert!(angle(at([0.0; 3], 0.0), at([0.0; 3], 0.0), at([1.0; 3], 0.0)).is_err());
}

#[test]
fn the_nearest_place_of_a_triangle_is_no_farther_than_any_other() {
    let corners = [DVec3::ZERO, DVec3::new(3.0, 0.0, 0.5), DVec3::new(1.0, 2.0, -0.5)];
    for k in 0..200 {
        let phase = f64::from(k);
        let p = 3.0 * DVec3::new(phase.sin(), (1.7 * phase).cos(), (0.3 * phase).sin());
        let nearest = nearest::closest_on_triangle(p, corners);
        let best = nearest.distance(p);
        let mut sampled = f64::MAX;
        for i in 0..=60 {
            for j in 0..=60 - i {
                let (u, v) = (f64::from(i) / 60.0, f64::from(j) / 60.0);
                let [a, b, c] = corners;
                sampled = sampled.min((a + (b - a) * u + (c - a) * v).distance(p));
            }
        }
        assert!(best <= sampled + 1e-12 && sampled <= best + 0.06, "{k}: {best} {sampled}");
    }
    // Triangles without area are lines or points.
    let flat = nearest::closest_on_triangle(DVec3::Y, [DVec3::ZERO, DVec3::X, DVec3::X * 2.0]);
    assert_eq!(flat, DVec3::ZERO);
}
