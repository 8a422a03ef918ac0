//! What a frame does on the processor: `HLOD=FILE.hlod cargo bench -p hlod-render`; without a file of a statue of 300
//! thousand triangles that is made for it. Encoding and decoding are in `compress/benches`.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use divan::Bencher;
use glam::{DMat4, DVec3};
use hlod_compress::{HlodFile, RepresentationKind};
use hlod_render::camera::Camera;
use hlod_render::casters::ahead::{CastersAhead, Outlook, SLICE_ENDS, receivers_of};
use hlod_render::casters::{CasterView, Casting, Receiver, select_casters};
use hlod_render::framing::Framing;
use hlod_render::need::{Need, Pace, Plan};
use hlod_render::path::CameraPath;
use hlod_render::scene::{CASTER_THRESHOLD_PX, INTENSITY_STEP, Light};
use hlod_render::select::{Selection, View, select};
use hlod_render::skeleton::{ChildLink, Skeleton};

const SIZE: (u32, u32) = (640, 480);
const SELECTION: Selection =
    Selection { kind: RepresentationKind::Appearance, error_threshold_px: 0.5 };

/// A statue's nodes and cameras along a path round it.
struct Scene {
    skeleton: Skeleton,
    world_from_model: DMat4,
    cameras: Vec<Camera>,
}

static SCENE: LazyLock<Scene> = LazyLock::new(|| match std::env::var_os("HLOD") {
    Some(file) => Scene::of(&PathBuf::from(file)),
    None => {
        let folder = tempfile::tempdir().expect("a folder");
        let [scan, file] = ["statue.ply", "statue.hlod"].map(|name| folder.path().join(name));
        let statue = hlod_build::synth::StatueOptions { triangles: 300_000, seed: 1 };
        hlod_build::synth::write_statue(&statue, &scan, true, &mut |_, _| {}).expect("a statue");
        let silent = hlod_build::progress::Silent;
        hlod_build::build(&[scan], &file, &Default::default(), &silent).expect("a build");
        Scene::of(&file)
    }
});

impl Scene {
    fn of(path: &Path) -> Scene {
        let file = HlodFile::open(path).expect("a .hlod file");
        let header = file.header();
        let root = file.read_block(header.root_block).expect("its first block");
        let mut skeleton = Skeleton::new(header.lattice, &root);
        let mut at = 0;
        while let Some(node) = skeleton.nodes().get(at) {
            if let ChildLink::Unloaded(block) = node.children {
                let block = file.read_block(block).expect("its blocks");
                skeleton.add_children(at as u32, &block);
            }
            at += 1;
        }
        let framing = Framing::of_header(header);
        let orbit = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../bench-paths/orbit.json"));
        let path = CameraPath::load(orbit).expect("a path");
        let placed = path.place(framing, orbit).expect("a path round it");
        let secs = path.duration_secs;
        let cameras = (0..120).map(|i| placed.camera_at(secs * f64::from(i) / 120.0)).collect();
        let origin = hlod_render::loader::model_origin(&header.lattice);
        Scene { skeleton, world_from_model: DMat4::from_translation(origin), cameras }
    }
}

fn main() {
    divan::main();
}

/// The receivers' front, everything resident; from the next of 120 cameras each time.
#[divan::bench]
fn select_receivers(bencher: Bencher<'_, '_>) {
    let scene = &*SCENE;
    let cameras = std::cell::Cell::new(0);
    bencher.bench_local(|| {
        cameras.set((cameras.get() + 1) % scene.cameras.len());
        let camera = &scene.cameras[cameras.get()];
        let view = View::new(camera, scene.world_from_model, SIZE.0, SIZE.1);
        select(&scene.skeleton, &view, SELECTION, &|_, _| true)
    });
}

/// What may be planned for.
const PLANNED_BYTES: u64 = 100 << 20;
/// Parallel light from the upper left.
const CASTING: Casting = Casting {
    light: Light::Directional(DVec3::new(-1.0, 1.0, 1.0)),
    light_radius: 0.0,
    threshold_px: CASTER_THRESHOLD_PX,
    intensity_step: INTENSITY_STEP,
};

/// What the receivers' plan costs, from the next of 120 cameras each time.
#[divan::bench]
fn plan_receivers(bencher: Bencher<'_, '_>) {
    let scene = &*SCENE;
    let cameras = std::cell::Cell::new(0);
    bencher.bench_local(|| {
        cameras.set((cameras.get() + 1) % scene.cameras.len());
        planned(scene, &scene.cameras[cameras.get()])
    });
}

/// What that of casters costs besides.
#[divan::bench]
fn plan_casters(bencher: Bencher<'_, '_>) {
    let scene = &*SCENE;
    let plans: Vec<Plan> = scene.cameras.iter().map(|camera| planned(scene, camera)).collect();
    let cameras = std::cell::Cell::new(0);
    bencher.bench_local(|| {
        let next = (cameras.get() + 1) % scene.cameras.len();
        cameras.set(next);
        let camera = &scene.cameras[next];
        let placed = scene.world_from_model;
        let boxes = receivers_of(&plans[next], &scene.skeleton, &placed);
        let (pace, light_speed) = (pace(scene), 0.5);
        let outlook = Outlook { casting: CASTING, camera, size: SIZE, pace, light_speed };
        let ahead = CastersAhead::new(&outlook, &boxes, placed, &SLICE_ENDS);
        ahead.plan(&scene.skeleton, PLANNED_BYTES, &|_, _| 1 << 14)
    });
}

/// The casters' front, everything resident.
#[divan::bench]
fn select_casters_of_a_front(bencher: Bencher<'_, '_>) {
    let scene = &*SCENE;
    let camera = &scene.cameras[0];
    let view = View::new(camera, scene.world_from_model, SIZE.0, SIZE.1);
    let front = select(&scene.skeleton, &view, SELECTION, &|_, _| true);
    let placed = scene.world_from_model;
    let drawn = front.draws.iter().map(|draw| &scene.skeleton.nodes()[draw.node as usize]);
    let boxes: Vec<_> = drawn.map(|node| Receiver::of(node, &placed)).collect();
    bencher.bench_local(|| {
        let view = CasterView::new(&CASTING, camera, SIZE, &boxes, placed);
        select_casters(&scene.skeleton, &view, &|_, _| true)
    });
}

/// An eye that moves by a statue's height a second.
fn pace(scene: &Scene) -> Pace {
    let root = &scene.skeleton.nodes()[0];
    let height = (root.max - root.min).length();
    Pace { velocity: DVec3::X * height, spread: height / 4.0, turn: 0.5 }
}

fn planned(scene: &Scene, camera: &Camera) -> Plan {
    let view = View::new(camera, scene.world_from_model, SIZE.0, SIZE.1);
    let need = Need::new(&view, SELECTION, pace(scene));
    need.plan(&scene.skeleton, SLICE_ENDS[SLICE_ENDS.len() - 1], PLANNED_BYTES, &|_, _| 1 << 14)
}
