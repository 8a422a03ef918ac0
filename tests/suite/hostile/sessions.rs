//! A session of some frames leaves nothing behind; `cargo xtask soak` draws longer ones.

use hlod_tests::soak::{SoakOptions, soak};
use hlod_tests::{built, bumpy_ball, gpu};

#[test]
fn a_session_leaves_no_descriptors_and_little_memory() {
    let folder = tempfile::tempdir().unwrap();
    let [ply, hlod] = ["ball.ply", "ball.hlod"].map(|name| folder.path().join(name));
    std::fs::write(&ply, bumpy_ball(160)).unwrap();
    built(&ply, &hlod, |o| o.leaf_triangles = 800);
    let options = SoakOptions {
        frames: 60,
        size: (96, 64),
        cache_bytes: 1 << 20,
        frames_a_model: 15,
        warm_up_places: 2,
        seed: 3,
    };
    let report = soak(&gpu(), &hlod, &options, &mut |_, _| ()).unwrap();
    assert!(report.problems.is_empty(), "{report:?}");
    assert!(report.nodes > 300, "{report:?}");
    let bytes = std::fs::metadata(&hlod).unwrap().len();
    assert!(report.bytes_read > bytes / 4, "{report:?}");
    // Other tests of this process open files meanwhile; what each model kept would be far more.
    assert!(report.descriptors[1] < report.descriptors[0] + 40, "{report:?}");
}
