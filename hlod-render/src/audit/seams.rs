//! Seams alone: whether anything shows through between nodes, and whether what closes them sticks out, for fronts of
//! all kinds.
//!
//! For each view the scan is drawn once, and compared with what the file gives at several τ, each time as the view asks
//! for it, with artificially mixed depths, and with a cache that lacks one node in eight ([`Mixing`]). What closes seams is also told
//! from what coarse levels do to outlines: the same front is drawn without skirts, and pixels that only skirts cover, more
//! than one from what is covered without them, are counted.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::pixels::{self, Layer, Reduced, SAMPLES, find_seams, pushed_out};
use super::reference::Reference;
use super::{Source, cameras, draw_layer, save_pictures};
use crate::camera::Projection;
use crate::error::RenderError;
use crate::frame::Renderer;
use crate::framing::Framing;
use crate::gpu::Gpu;
use crate::model::{Model, ModelLimits};
use crate::path::CameraPath;
use crate::picture::PICTURE_FORMAT;
use crate::scene::{Mixing, Shadow, Shot, light_from_angles};

/// However coarse a front is, its outlines may be off by no more than a pixel and this: what stands in for leaves that are
/// seen from very near is off by more than 12.
const MARGIN_MAX_PX: f64 = 64.0;

/// Where two nodes are drawn within so many pixels of a hole, it may be their seam.
const SEAM_PX: usize = 2;

/// So many holes at seams are listed, as many of others, and of pixels outside.
const LISTED_MAX: usize = 200;

/// What is compared.
#[derive(Debug, Clone)]
pub struct SeamOptions {
    /// Picture size in pixels.
    pub size: (u32, u32),
    /// Number of views.
    pub views: u32,
    /// Views at equal times along this path; else round the statue at several distances.
    pub path: Option<CameraPath>,
    /// Each τ.
    pub thresholds_px: Vec<f64>,
    /// Decides which nodes mixed fronts divide or lack, together with the number of the view.
    pub seed: u64,
    /// Where pictures of the worst view go.
    pub pictures: Option<PathBuf>,
}

/// Result of an audit of seams; the keys are stable.
#[derive(Debug, Clone, Serialize)]
pub struct SeamReport {
    /// The file.
    pub file: PathBuf,
    /// Name of the representation.
    pub representation: &'static str,
    /// Adapter, backend and driver.
    pub adapter: String,
    /// Views compared.
    pub views: u32,
    /// Decides what mixed fronts are made of.
    pub seed: u64,
    /// Sum of the fronts' hole pixels.
    pub hole_pixels: u64,
    /// Sum of their overdraw pixels.
    pub overdraw_pixels: u64,
    /// Sum of their pixels that skirts push out.
    pub pushed_out_pixels: u64,
    /// One row for each τ and kind of front.
    pub fronts: Vec<SeamRow>,
    /// The first holes at seams, then the first others.
    pub holes: Vec<HolePlace>,
    /// The first pixels that are drawn where they must not be.
    pub outside: Vec<OutsidePlace>,
}

/// One pixel outside of what may be covered, and from where it is seen.
#[derive(Debug, Clone, Serialize)]
pub struct OutsidePlace {
    /// Number of the view.
    pub view: u32,
    /// Its camera as `--camera` takes it.
    pub camera: String,
    /// τ.
    pub tau_px: f64,
    /// As [`SeamRow::front`].
    pub front: &'static str,
    /// Pixel from the left and from the top.
    pub pixel: [usize; 2],
    /// `overdraw`, or `pushed-out` where only a skirt is.
    pub kind: &'static str,
}

/// One hole pixel, and from where it is seen.
#[derive(Debug, Clone, Serialize)]
pub struct HolePlace {
    /// Number of the view.
    pub view: u32,
    /// Its camera as `--camera` takes it.
    pub camera: String,
    /// τ.
    pub tau_px: f64,
    /// As [`SeamRow::front`].
    pub front: &'static str,
    /// Pixel from the left and from the top.
    pub pixel: [usize; 2],
    /// `nothing`, `back`, or `behind`, a front that is too far away.
    pub shows: &'static str,
    /// Whether two nodes are drawn near.
    pub at_seam: bool,
}

/// Scores of one kind of front, summed over all views.
#[derive(Debug, Clone, Serialize)]
pub struct SeamRow {
    /// τ.
    pub tau_px: f64,
    /// `as-asked`, `finer` or `half-loaded`.
    pub front: &'static str,
    /// Nodes drawn, mean.
    pub nodes_mean: f64,
    /// Mean over views of the number of depths that are drawn side by side.
    pub depths_mean: f64,
    /// Pixels well inside the scan that show background or something behind.
    pub hole_pixels: u64,
    /// Of these, those near which two nodes or more are drawn.
    pub holes_at_seams: u64,
    /// Pixels drawn outside the scan by more than a pixel and, where the front is coarser than τ, by more than it may be off.
    pub overdraw_pixels: u64,
    /// Pixels covered by skirts alone, more than a pixel from what is covered without them.
    pub pushed_out_pixels: u64,
    /// Views with any of these.
    pub views_with_any: u32,
}

/// Kinds of fronts, and which of them each view has.
fn mixings(seed: u64, view: u32) -> [(&'static str, Mixing); 3] {
    let seed = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(u64::from(view));
    [
        ("as-asked", Mixing::None),
        ("finer", Mixing::Finer { seed }),
        ("half-loaded", Mixing::HalfLoaded { seed }),
    ]
}

/// Looks for open seams in `file`, compared with `against`, the scans it was built from; `advance` hears of each finished
/// view.
///
/// # Errors
/// When a file cannot be used or the GPU fails.
pub fn audit_seams(
    gpu: &Gpu,
    file: &Path,
    against: &[PathBuf],
    shot_template: &Shot,
    options: &SeamOptions,
    advance: &mut dyn FnMut(u32),
) -> Result<SeamReport, RenderError> {
    let mut models = [Model::open(gpu, file, ModelLimits::default())?];
    let mut reference = Reference::load(gpu, against, &models[0], false)?;
    let framing = Framing::of(&models[0]);
    let cameras = cameras(&framing, file, options.path.as_ref(), options.views, options.size)?;
    let mut renderer = Renderer::new(gpu, PICTURE_FORMAT);
    let kinds = mixings(options.seed, 0).map(|(name, _)| name);
    let mut fronts: Vec<SeamRow> = options
        .thresholds_px
        .iter()
        .flat_map(|&tau_px| kinds.map(|front| SeamRow::new(tau_px, front)))
        .collect();
    let mut worst = 0;
    // At seams, and others.
    let mut holes: [Vec<HolePlace>; 2] = Default::default();
    let mut outside = Vec::new();
    for (i, camera) in cameras.iter().enumerate() {
        let shot = Shot {
            camera: *camera,
            light: light_from_angles(camera, -45.0, 30.0),
            shadow: Shadow::None,
            draw_backs: true,
            ..*shot_template
        };
        let (width, height) = options.size;
        let mut draw_scan = |samples: u32| {
            let mut source = Source::Reference(&mut reference);
            draw_layer(gpu, &mut renderer, &mut source, &shot, options.size, samples)
        };
        let truth = draw_scan(SAMPLES)?;
        let reduced = Reduced::new(&truth.layer).with_middles(&draw_scan(1)?.layer);
        let [eye, target] = [camera.eye, camera.target].map(|p| framing.relative(p));
        let place = [eye, target].map(|[x, y, z]| format!("{x:.6},{y:.6},{z:.6}")).join(":");
        let half_extent = camera.half_extent(f64::from(width) / f64::from(height));
        let kinds = mixings(options.seed, i as u32);
        let asked =
            options.thresholds_px.iter().flat_map(|&tau| kinds.map(|(_, mixing)| (tau, mixing)));
        for (row, (error_threshold_px, mixing)) in fronts.iter_mut().zip(asked) {
            // Draw the same front with backs, as users see it, and without skirts.
            let with_backs = Shot { error_threshold_px, mixing, ..shot };
            let mut draw = |shot: &Shot| {
                let mut source = Source::Models(&mut models);
                draw_layer(gpu, &mut renderer, &mut source, shot, options.size, 1)
            };
            let drawn = draw(&with_backs)?;
            // Where no back is seen, the picture without backs is the same.
            let culled = match drawn.layer.back.contains(&true) {
                true => &draw(&Shot { draw_backs: false, ..with_backs })?,
                false => &drawn,
            };
            let open = draw(&Shot { draw_skirts: false, ..with_backs })?.layer;

            // What is coarser than τ may be off by more.
            let drawn_px = error_threshold_px * drawn.stats.tau_ratio_max.max(1.0);
            let margin_px = 1.0 + (drawn_px - error_threshold_px).ceil().min(MARGIN_MAX_PX);
            let scale = pixels::Scale {
                pixel_at_unit_depth: 2.0 * half_extent.y / f64::from(height),
                perspective: matches!(camera.projection, Projection::Perspective { .. }),
                tau_px: drawn_px,
                rounding: models[0].leaf_rounding(),
                margin_px: margin_px as usize,
                backs_are_holes: reference.closed_oriented,
            };
            let seams = find_seams(&drawn.layer, &culled.layer, &reduced, &scale);
            let pushed_out = pushed_out(&drawn.layer, &open);
            let nodes = NodeOfIdentity(models[0].node_identities());
            let holes_of_view =
                seams.holes.iter().zip(&seams.behind).map(|(&p, &behind)| HolePlace {
                    view: i as u32,
                    camera: place.clone(),
                    tau_px: row.tau_px,
                    front: row.front,
                    pixel: [p % width as usize, p / width as usize],
                    shows: match (drawn.layer.covered[p], drawn.layer.back[p]) {
                        (false, _) => "nothing",
                        (true, true) => "back",
                        (true, false) => "behind",
                    },
                    at_seam: nodes.several_near(&drawn.identities, &drawn.layer, behind, p),
                });
            for hole in holes_of_view {
                row.holes_at_seams += u64::from(hole.at_seam);
                let listed = &mut holes[usize::from(!hole.at_seam)];
                if listed.len() < LISTED_MAX {
                    listed.push(hole);
                }
            }
            let pixels = [("overdraw", &seams.overdraw), ("pushed-out", &pushed_out)];
            for (kind, &p) in
                pixels.iter().flat_map(|(kind, all)| all.iter().map(move |p| (*kind, p)))
            {
                if outside.len() < LISTED_MAX {
                    outside.push(OutsidePlace {
                        view: i as u32,
                        camera: place.clone(),
                        tau_px: row.tau_px,
                        front: row.front,
                        pixel: [p % width as usize, p / width as usize],
                        kind,
                    });
                }
            }
            let bad = row.add(&seams, pushed_out.len(), drawn.stats.nodes, drawn.stats.depths);
            if let Some(folder) = options.pictures.as_ref().filter(|_| bad > worst) {
                worst = bad;
                let mut scores = pixels::Scores {
                    holes: seams.holes,
                    overdraw: seams.overdraw,
                    distance_px: vec![0.0; (width * height) as usize],
                    ..pixels::Scores::default()
                };
                pushed_out.iter().for_each(|&p| scores.distance_px[p] = 2.0);
                save_pictures(folder, &culled.picture, &truth.picture, &scores)?;
            }
        }
        advance(i as u32);
    }
    let views = cameras.len() as u32;
    for row in &mut fronts {
        row.nodes_mean /= f64::from(views.max(1));
        row.depths_mean /= f64::from(views.max(1));
    }
    let sum = |of: fn(&SeamRow) -> u64| fronts.iter().map(of).sum();
    Ok(SeamReport {
        file: file.to_owned(),
        representation: shot_template.representation.name(),
        adapter: gpu.describe(),
        views,
        seed: options.seed,
        hole_pixels: sum(|row| row.hole_pixels),
        overdraw_pixels: sum(|row| row.overdraw_pixels),
        pushed_out_pixels: sum(|row| row.pushed_out_pixels),
        fronts,
        holes: holes.concat(),
        outside,
    })
}

/// Ranges of identities in order, and whose they are.
struct NodeOfIdentity(Vec<(std::ops::Range<u32>, u32)>);

impl NodeOfIdentity {
    /// Of the identity with or without the bit of backs; none of background.
    fn node(&self, identity: u32) -> Option<u32> {
        let identity = identity & !(1 << 31);
        let after = self.0.partition_point(|(range, _)| range.start <= identity);
        let (range, node) = self.0.get(after.checked_sub(1)?)?;
        range.contains(&identity).then_some(*node)
    }

    /// Whether several nodes, or none, are seen within [`SEAM_PX`] of pixel `p` and before `behind`.
    fn several_near(&self, identities: &[u32], layer: &Layer, behind: f32, p: usize) -> bool {
        let (width, height) = (layer.width, layer.height);
        let near = |c: usize, end: usize| c.saturating_sub(SEAM_PX)..=(c + SEAM_PX).min(end - 1);
        let mut nodes = near(p / width, height)
            .flat_map(|y| near(p % width, width).map(move |x| y * width + x))
            .filter(|&q| layer.covered[q] && layer.depth[q] <= behind)
            .filter_map(|q| self.node(identities[q]));
        let first = nodes.next();
        first.is_none() || nodes.any(|node| Some(node) != first)
    }
}

impl SeamRow {
    fn new(tau_px: f64, front: &'static str) -> SeamRow {
        SeamRow {
            tau_px,
            front,
            nodes_mean: 0.0,
            depths_mean: 0.0,
            hole_pixels: 0,
            holes_at_seams: 0,
            overdraw_pixels: 0,
            pushed_out_pixels: 0,
            views_with_any: 0,
        }
    }

    /// Adds one view; how many of its pixels are not as they should be.
    fn add(
        &mut self,
        seams: &pixels::Seams,
        pushed_out: usize,
        nodes: usize,
        depths: usize,
    ) -> usize {
        let bad = seams.holes.len() + seams.overdraw.len() + pushed_out;
        self.hole_pixels += seams.holes.len() as u64;
        self.overdraw_pixels += seams.overdraw.len() as u64;
        self.pushed_out_pixels += pushed_out as u64;
        self.views_with_any += u32::from(bad > 0);
        self.nodes_mean += nodes as f64;
        self.depths_mean += depths as f64;
        bad
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of 9 × 9 pixels, all of them at `depth` and of `identity`.
    fn flat(identity: u32, depth: f32) -> (Vec<u32>, Layer) {
        let identities = vec![identity; 81];
        let rgba = vec![128; 4 * 81];
        (identities.clone(), Layer::new(9, 9, &rgba, &identities, vec![depth; 81]))
    }

    #[test]
    fn holes_within_a_node_are_told_from_seams() {
        let nodes = NodeOfIdentity(vec![(1..10, 7), (10..20, 3), (30..40, 7)]);
        assert_eq!([1, 9, 10, 1 << 31 | 39].map(|i| nodes.node(i)), [7, 7, 3, 7].map(Some));
        assert_eq!([0, 20, 29, 40].map(|i| nodes.node(i)), [None; 4]);

        let centre = 4 * 9 + 4;
        let (mut identities, mut layer) = flat(5, 1.0);
        assert!(!nodes.several_near(&identities, &layer, 2.0, centre));
        // The same node's other range, two pixels away, is no other node.
        identities[centre + 2] = 35;
        assert!(!nodes.several_near(&identities, &layer, 2.0, centre));
        // Another node that lies behind is what the hole shows.
        identities[centre] = 12;
        layer.depth[centre] = 3.0;
        assert!(!nodes.several_near(&identities, &layer, 2.0, centre));
        // Beside the hole it is a seam, farther away it is none.
        identities[centre + 3] = 12;
        assert!(!nodes.several_near(&identities, &layer, 2.0, centre));
        identities[centre + 2] = 12;
        assert!(nodes.several_near(&identities, &layer, 2.0, centre));
        // Where nothing is near, nothing is known.
        let (_, empty) = flat(0, f32::INFINITY);
        assert!(nodes.several_near(&identities, &empty, 2.0, centre));
    }
}
