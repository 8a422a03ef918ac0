//! Statues cut open on the screen: analytic truth on a ball.

use glam::{DVec2, DVec3};
use hlod_render::camera::{Camera, Projection};
use hlod_render::clip::{ClipPlanes, PLANE_COLOURS};
use hlod_render::framing::Framing;
use hlod_render::lens::Lens;
use hlod_render::picture::{Picture, take};
use hlod_render::scene::{Representation, Shadow, Shot};
use hlod_render::section::Plane;
use hlod_render::{Gpu, Model, ModelLimits};
use hlod_tests::{ball, built, gpu};

use crate::pictures::shot;

const SIZE: u32 = 250;
/// Height of the pictures: a pixel is a hundredth.
const HEIGHT: f64 = 2.5;

struct Cut {
    gpu: Gpu,
    models: [Model; 1],
    framing: Framing,
    _folder: tempfile::TempDir,
}

/// A smooth ball of radius 1, without faces beyond `keep` if it is to be open.
fn cut(keep: impl Fn(&str) -> bool) -> Cut {
    let folder = tempfile::tempdir().unwrap();
    let [ply, hlod] = ["ball.ply", "ball.hlod"].map(|f| folder.path().join(f));
    let text: String =
        ball(120, 0.0).lines().filter(|l| keep(l)).map(|l| l.to_owned() + "\n").collect();
    let faces = text.lines().filter(|line| line.starts_with("3 ")).count();
    let declared = text.lines().find(|line| line.starts_with("element face")).unwrap().to_owned();
    std::fs::write(&ply, text.replace(&declared, &format!("element face {faces}"))).unwrap();
    built(&ply, &hlod, |o| o.leaf_triangles = 1500);
    let gpu = gpu();
    let model = Model::open(&gpu, &hlod, ModelLimits::default()).unwrap();
    let framing = Framing::of(&model);
    Cut { gpu, models: [model], framing, _folder: folder }
}

/// From far along `towards`, in parallel rays.
fn view(c: &Cut, towards: DVec3, clip: ClipPlanes) -> Shot {
    let shot = shot(&c.framing, Representation::Hybrid);
    let camera = Camera {
        eye: towards.normalize() * 10.0,
        target: DVec3::ZERO,
        up: DVec3::Y,
        projection: Projection::Orthographic { height: HEIGHT },
        near: 0.0,
    };
    Shot { camera, clip, ..shot }
}

fn picture(c: &mut Cut, shot: &Shot) -> Picture {
    take(&c.gpu, &mut c.models, shot, SIZE, SIZE, 1).unwrap().0
}

/// Which plane's cut face a pixel shows.
fn face_at(picture: &Picture, x: u32, y: u32) -> Option<usize> {
    let at = 4 * (y * picture.width + x) as usize;
    let seen = &picture.rgba[at..at + 3];
    PLANE_COLOURS.iter().position(|c| c.iter().zip(seen).all(|(a, b)| a.abs_diff(*b) <= 2))
}

fn faces(picture: &Picture) -> usize {
    let pixels = (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| (x, y)));
    pixels.filter(|&(x, y)| face_at(picture, x, y).is_some()).count()
}

/// Pixels that do not show what a ball cut at `z` = `offset` shows from the front: its face, then what is
/// left of its side, then nothing. Those at the edges between do not count.
fn wrong(picture: &Picture, offset: f64) -> usize {
    let background = picture.rgba[..4].to_owned();
    let rim = (1.0 - offset * offset).sqrt();
    let outer = if offset > 0.0 { 1.0 } else { rim };
    let mut wrong = 0;
    for y in 0..SIZE {
        for x in 0..SIZE {
            let place = (DVec2::new(x.into(), y.into()) + 0.5) / f64::from(SIZE) - 0.5;
            let from_middle = place.length() * HEIGHT;
            let at = 4 * (y * SIZE + x) as usize;
            let is_background = picture.rgba[at..at + 4] == background[..];
            let is_face = face_at(picture, x, y) == Some(0);
            let edge = 0.015;
            if from_middle < rim - edge {
                wrong += usize::from(!is_face);
            } else if from_middle > outer + edge {
                wrong += usize::from(!is_background);
            } else if from_middle > rim + edge && from_middle < outer - edge {
                wrong += usize::from(is_face || is_background);
            }
        }
    }
    wrong
}

fn across_z(offset: f64) -> ClipPlanes {
    ClipPlanes::new([Some(Plane { normal: DVec3::Z, offset })])
}

#[test]
fn a_ball_shows_the_disc_in_which_it_is_cut() {
    let mut c = cut(|_| true);
    for small_triangles in [true, false] {
        c.gpu.small_triangles = small_triangles;
        for offset in [0.3, -0.3] {
            for representation in [Representation::Hybrid, Representation::Full] {
                let shot = Shot { representation, ..view(&c, DVec3::Z, across_z(offset)) };
                let seen = picture(&mut c, &shot);
                let wrong = wrong(&seen, offset);
                assert!(wrong <= 3, "{wrong} pixels, {offset}, compute {small_triangles}");
            }
        }
    }
    // What says so can be wrong: the other half, another place, a whole ball.
    let flipped = ClipPlanes::new([Some(Plane { normal: -DVec3::Z, offset: -0.3 })]);
    for other in [flipped, across_z(0.6), ClipPlanes::default()] {
        let shot = view(&c, DVec3::Z, other);
        assert!(wrong(&picture(&mut c, &shot), 0.3) > 1000);
    }
}

#[test]
fn each_plane_has_its_own_face_and_parts_are_those_of_the_whole() {
    let mut c = cut(|_| true);
    let planes = [DVec3::Z, DVec3::X].map(|normal| Some(Plane { normal, offset: 0.2 }));
    let shot = view(&c, DVec3::new(1.0, 0.0, 1.0), ClipPlanes::new(planes));
    let seen = picture(&mut c, &shot);
    let lens = Lens { camera: shot.camera, size: DVec2::splat(SIZE.into()) };
    let face_of = |p: DVec3| {
        let pixel = lens.pixel_of(p).unwrap();
        face_at(&seen, pixel.x as u32, pixel.y as u32)
    };
    assert_eq!(face_of(DVec3::new(-0.4, 0.1, 0.2)), Some(0));
    assert_eq!(face_of(DVec3::new(0.2, -0.1, -0.5)), Some(1));
    assert_eq!(face_of(DVec3::new(-0.1, 0.985, -0.1)), None);
    // The eye inside of what is kept sees no face, whatever it sees.
    let kept = ClipPlanes::new([Some(Plane { normal: -DVec3::X, offset: -0.2 })]);
    let shot = view(&c, DVec3::X, kept);
    assert_eq!(faces(&picture(&mut c, &shot)), 0);
}

#[test]
fn open_scans_have_no_cut_faces_and_shadows_are_refused() {
    // Without what lies round the north pole, whose vertices come first.
    let mut c = cut(|line| {
        let mut words = line.split(' ');
        words.next() != Some("3") || !words.any(|v| v.parse().is_ok_and(|v: u32| v < 1000))
    });
    let shot = view(&c, DVec3::Z, across_z(0.0));
    let seen = picture(&mut c, &shot);
    assert_eq!(faces(&seen), 0, "an open scan has no inside");
    let middle = &seen.rgba[4 * (SIZE / 2 * SIZE + SIZE / 2) as usize..][..3];
    assert!(middle != &seen.rgba[..3], "its back is seen");

    let shadowed = Shot { shadow: Shadow::Hard, ..shot };
    let refused = take(&c.gpu, &mut c.models, &shadowed, SIZE, SIZE, 1).unwrap_err().to_string();
    assert!(refused.contains("cut open") && refused.contains("--shadow none"), "{refused}");
    let whole = Shot { clip: ClipPlanes::default(), ..shadowed };
    assert_eq!(whole.cut_open(shot.clip), shot);
    assert_eq!(whole.cut_open(ClipPlanes::default()), whole);
}
