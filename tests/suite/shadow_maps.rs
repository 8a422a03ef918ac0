//! Shadow maps, which exact shadows are compared with: analytic truth under a ball, every place that a light can be
//! in, and where they are uniform instead.

use glam::DVec3;
use hlod_render::camera::{Camera, Projection};
use hlod_render::frame::Renderer;
use hlod_render::picture::{Canvas, PICTURE_FORMAT};
use hlod_render::scene::{Light, Shadow, Shot};
use hlod_render::shadow_map::{MapCount, MapProjection, ShadowMap};

use super::shadows::{EYE, MIDDLE, SIZE, Scene, ball, shot, wrong_on_floor};

fn mapped(shot: &Shot, projection: MapProjection, size: u32) -> Shot {
    Shot { shadow: Shadow::Mapped(ShadowMap { projection, size }), ..*shot }
}

fn count(scene: &mut Scene, shot: &Shot) -> MapCount {
    let canvas = Canvas::new(&scene.gpu, SIZE.0, SIZE.1).unwrap();
    let mut renderer = Renderer::new(&scene.gpu, PICTURE_FORMAT);
    renderer.render_complete(&scene.gpu, &mut scene.models, shot, &canvas.targets).unwrap();
    renderer.map_count(&scene.gpu).unwrap()
}

#[test]
fn maps_show_the_ball_s_shadow_wherever_the_light_is() {
    let mut scene = Scene::new(ball());
    let back = (EYE - DVec3::new(0.0, 0.3, 0.0)).normalize();
    let right = DVec3::Y.cross(back).normalize();
    // Between the camera's plane and the ball, low enough for its shadow to fall on the floor.
    let beside = EYE + right * 2.5 + DVec3::Y;
    let lights = [
        ("parallel", Light::Directional(DVec3::new(0.2, 1.0, 0.1))),
        ("parallel, from behind the camera", Light::Directional(back + DVec3::Y * 0.3)),
        ("parallel, towards the camera", Light::Directional(DVec3::new(-0.2, 0.8, -0.9))),
        ("a lamp in front of the camera", Light::Point(DVec3::new(0.4, 4.0, -0.3))),
        ("a lamp behind the camera", Light::Point(EYE + back * 2.0 + DVec3::Y * 2.0)),
        ("a lamp in the camera's plane", Light::Point(beside - back * (beside - EYE).dot(back))),
        ("a lamp inside of the frustum", Light::Point(MIDDLE + DVec3::new(0.05, 0.6, 0.1))),
    ];
    for (what, light) in lights {
        let shot = shot(EYE, light);
        for projection in MapProjection::ALL {
            let fine = mapped(&shot, projection, 2048);
            let [wrong, hidden] = wrong_on_floor(&scene.floor(&fine), &fine, light, 2.0);
            assert!(hidden > 500, "{what}, {projection:?}: {hidden} pixels in shadow");
            assert_eq!(wrong, 0, "{what}, {projection:?}: of {hidden} in shadow");
            // Texels of many pixels show, or the comparison does not see them.
            let coarse = mapped(&shot, projection, 10);
            let [wrong, _] = wrong_on_floor(&scene.floor(&coarse), &coarse, light, 2.0);
            assert!(wrong > 5, "{what}, {projection:?}: {wrong} with 10 texels");
        }
    }
}

#[test]
fn what_cannot_be_perspective_is_uniform_and_counted() {
    let mut scene = Scene::new(ball());
    let above = Light::Directional(DVec3::new(0.2, 1.0, 0.1));
    let seen = shot(EYE, above);
    for projection in MapProjection::ALL {
        let found = count(&mut scene, &mapped(&seen, projection, 512));
        assert_eq!((found.maps, found.fallbacks), (1, 0), "{projection:?}");
        assert!(found.judged > 10_000, "{found:?}");
    }
    let parallel = Camera { projection: Projection::Orthographic { height: 4.0 }, ..seen.camera };
    let flat = Shot { camera: parallel, ..seen };
    let uniform = mapped(&flat, MapProjection::Uniform, 512);
    assert_eq!(count(&mut scene, &uniform).fallbacks, 0);
    for projection in [MapProjection::LightSpace, MapProjection::Perspective] {
        let found = count(&mut scene, &mapped(&flat, projection, 512));
        assert_eq!((found.maps, found.fallbacks), (1, 1), "{projection:?}");
        let both = [uniform, mapped(&flat, projection, 512)].map(|shot| scene.occlusion(&shot).0);
        assert!(both[0] == both[1], "{projection:?}");
    }
    // A light amid what it lights sees all round, and no one perspective holds.
    let amid = shot(EYE, Light::Point(DVec3::new(0.9, 0.2, 0.9)));
    let found = count(&mut scene, &mapped(&amid, MapProjection::Perspective, 512));
    assert!(found.maps > 1 && found.fallbacks > 0, "{found:?}");
}

#[test]
fn perspective_denies_fewer_pixels_of_a_floor_seen_from_near() {
    let mut scene = Scene::new(ball());
    let mut seen =
        shot(DVec3::new(0.0, 0.25, 1.95), Light::Directional(DVec3::new(0.1, 1.0, 0.05)));
    seen.camera.target = DVec3::new(0.0, 0.0, 0.0);
    let share = |scene: &mut Scene, projection, size| {
        let found = count(scene, &mapped(&seen, projection, size));
        assert_eq!(found.fallbacks, 0, "{projection:?}");
        found.denied_share()
    };
    let [_, uniform, light_space, perspective] =
        MapProjection::ALL.map(|projection| share(&mut scene, projection, 2048));
    assert!(
        uniform > light_space && uniform > perspective,
        "{uniform} {light_space} {perspective}"
    );
    assert!(uniform > 0.05, "{uniform}");
    // Four times as many texels help any of them.
    for projection in MapProjection::ALL {
        let [few, many] = [512, 4096].map(|size| share(&mut scene, projection, size));
        assert!(few > many, "{projection:?}: {few} {many}");
    }
}
