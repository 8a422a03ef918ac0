//! No see-through pixel between drawn nodes, whatever their depths, and nothing that sticks out.

use std::path::{Path, PathBuf};

use hlod_render::audit::seams::{SeamOptions, SeamReport, audit_seams};
use hlod_render::frame::Renderer;
use hlod_render::framing::Framing;
use hlod_render::picture::{Canvas, PICTURE_FORMAT};
use hlod_render::scene::Representation;
use hlod_render::{Model, ModelLimits};
use hlod_tests::{built, gpu, scan};

use crate::pictures::{coarse_ball, shot};

/// Twenty views at three errors, of fronts of three kinds.
fn report(hlod: &Path, against: &[PathBuf], size: (u32, u32)) -> SeamReport {
    let gpu = gpu();
    let framing = Framing::of(&Model::open(&gpu, hlod, ModelLimits::default()).unwrap());
    let options = SeamOptions {
        size,
        views: 20,
        path: None,
        thresholds_px: vec![0.5, 1.0, 4.0],
        seed: 1,
        pictures: None,
    };
    let shot = shot(&framing, Representation::Hybrid);
    audit_seams(&gpu, hlod, against, &shot, &options, &mut |_| {}).unwrap()
}

/// Nodes of all depths side by side, at errors of half a pixel and of several: no light gets
/// through, and nothing stands out.
#[test]
fn seams_between_depths_are_closed() {
    let folder = tempfile::tempdir().unwrap();
    let [ply, hlod] = coarse_ball(folder.path(), 24);
    let report = report(&hlod, &[ply], (160, 120));
    for row in &report.fronts {
        assert_eq!(
            (row.hole_pixels, row.overdraw_pixels, row.pushed_out_pixels),
            (0, 0, 0),
            "{row:?}"
        );
    }
    // Fronts are as different as they say; at the least error all are of leaves.
    for of_tau in report.fronts.chunks(3).skip(1) {
        let [asked, finer, half_loaded] = of_tau else { panic!("three kinds") };
        assert!(finer.nodes_mean > asked.nodes_mean, "{of_tau:?}");
        assert!(half_loaded.nodes_mean < asked.nodes_mean, "{of_tau:?}");
        assert!(finer.depths_mean > 1.5, "{of_tau:?}");
    }
}

/// The same of real scans. Where levels are coarser than a pixel, or stand in for what is not loaded, an open range map's own
/// borders move, and what closes seams can be seen beside it; both stay below a pixel in ten thousand, and holes below a tenth
/// of that.
#[test]
fn seams_of_scans_are_closed() {
    let test = "seams_of_scans_are_closed";
    let lato = ["000", "180", "270", "315"].map(|n| format!("lato/lato{n}.ply"));
    let single = [
        "bunny/bun_zipper.ply",
        "dragon/dragon_vrip_res2.ply",
        "happy_buddha/happy_buddha.ply",
        "igea/igea_tristrips.ply",
        "laurana/laurana50k.ply",
    ];
    for name in single.into_iter().chain(lato.iter().map(String::as_str)) {
        let Some(ply) = scan(test, name) else { continue };
        let folder = tempfile::tempdir().unwrap();
        let hlod = folder.path().join("scan.hlod");
        built(&ply, &hlod, |_| {});
        let report = report(&hlod, &[ply], (160, 120));
        for row in &report.fronts {
            println!("{name}: {row:?}");
            let found = [row.hole_pixels, row.overdraw_pixels, row.pushed_out_pixels];
            assert_eq!(row.holes_at_seams, 0, "{name}: {row:?}");
            if !name.starts_with("lato") {
                assert_eq!(found, [0, 0, 0], "{name}: {row:?}");
            }
            assert!(found[0] <= 2, "{name}: {row:?}");
            if row.tau_px <= 1.0 && row.front != "half-loaded" {
                assert!(found[1] == 0 && found[2] <= 8, "{name}: {row:?}");
            }
            assert!(found[1] + found[2] <= 20 * 160 * 120 / 10_000, "{name}: {row:?}");
        }
    }
}

/// The same while nodes arrive, so that the finest lie beside the coarsest.
#[test]
fn seams_are_closed_while_nodes_arrive() {
    let folder = tempfile::tempdir().unwrap();
    let [_, hlod] = coarse_ball(folder.path(), 10);
    let gpu = gpu();
    let limits = ModelLimits { read_bytes_per_sec: Some(2e5), ..ModelLimits::default() };
    let mut models = [Model::open(&gpu, &hlod, limits).unwrap()];
    let framing = Framing::of(&models[0]);
    let shot = shot(&framing, Representation::Full);
    let size = 256;
    let canvas = Canvas::new(&gpu, size, size).unwrap();
    let mut renderer = Renderer::new(&gpu, PICTURE_FORMAT);
    let (mut covered, mut nodes_drawn) = (Vec::new(), std::collections::BTreeSet::new());
    for _ in 0..5000 {
        let stats = renderer.render(&gpu, &mut models, &shot, &canvas.targets).unwrap();
        if nodes_drawn.insert(stats.nodes) {
            let frame = canvas.identities(&gpu).unwrap();
            covered.push(frame.into_iter().map(|id| id != 0).collect::<Vec<bool>>());
        }
        if stats.missing_parts == 0 {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    assert!(covered.len() > 5, "drawn with {nodes_drawn:?} nodes");
    // Backs are culled: a crack would show what is behind the ball. Its outline may move by the
    // coarsest node's error.
    let (whole, w) = (covered.last().unwrap(), size as usize);
    let error_px = 2.0 / 10.0 * f64::from(size) / 2.0;
    let margin = error_px.ceil() as usize + 1;
    let inside = |p: usize| {
        let (x, y) = (p % w, p / w);
        let square = |c: usize| c.saturating_sub(margin)..=(c + margin).min(w - 1);
        square(y).all(|y| square(x).all(|x| whole[y * w + x]))
    };
    let inside: Vec<usize> = (0..w * w).filter(|&p| inside(p)).collect();
    assert!(inside.len() > 3000);
    for (frame, covered) in covered.iter().enumerate() {
        let holes = inside.iter().filter(|&&p| !covered[p]).count();
        assert_eq!(holes, 0, "in frame {frame}");
    }
}
