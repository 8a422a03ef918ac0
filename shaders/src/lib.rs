//! The renderer's WGSL, one file a pass, embedded.
//!
//! Each pass is assembled from the shared declarations and its own file; tests validate every one
//! without a GPU and compare its structures with those that Rust fills in.

#[cfg(test)]
mod branches;

/// A pass' complete source.
#[derive(Debug, Clone, Copy)]
pub struct Pass {
    /// Name, as in timings and statistics.
    pub name: &'static str,
    /// Complete WGSL.
    pub source: &'static str,
}

/// Identity and depth of the visible surface.
pub const SURFACE: Pass = Pass {
    name: "surface",
    source: concat!(include_str!("shared.wgsl"), include_str!("surface.wgsl")),
};

/// Identity and depth of small triangles and points, in compute; needs 64-bit atomics.
pub const SMALL: Pass = Pass {
    name: "small",
    source: concat!(
        include_str!("shared.wgsl"),
        include_str!("points.wgsl"),
        include_str!("small.wgsl")
    ),
};

/// Identity and depth of the triangles and points that [`SMALL`] leaves.
pub const LARGE: Pass = Pass {
    name: "large",
    source: concat!(
        include_str!("shared.wgsl"),
        include_str!("points.wgsl"),
        include_str!("large.wgsl")
    ),
};

/// Identity and depth of points, where [`SMALL`] is not used.
pub const SPLATS: Pass = Pass {
    name: "splats",
    source: concat!(
        include_str!("shared.wgsl"),
        include_str!("points.wgsl"),
        include_str!("splats.wgsl")
    ),
};

/// The same in compute, where parts of a picture must agree; with [`SMALL`]'s bindings.
pub const SPREAD: Pass = Pass {
    name: "spread",
    source: concat!(
        include_str!("shared.wgsl"),
        include_str!("points.wgsl"),
        include_str!("small.wgsl"),
        include_str!("spread.wgsl")
    ),
};

/// What [`SMALL`] found, into identity and depth.
pub const RESOLVE: Pass = Pass {
    name: "resolve",
    source: concat!(include_str!("shared.wgsl"), include_str!("resolve.wgsl")),
};

/// Shading of the visible surface.
pub const SHADE: Pass = Pass {
    name: "shade",
    source: concat!(
        include_str!("shared.wgsl"),
        include_str!("points.wgsl"),
        include_str!("visible.wgsl"),
        include_str!("shade.wgsl")
    ),
};

/// Visible points, as the light sees them, into a grid: see `shadow.wgsl`.
pub const SAMPLES: Pass = Pass {
    name: "samples",
    source: concat!(
        include_str!("shared.wgsl"),
        include_str!("points.wgsl"),
        include_str!("visible.wgsl"),
        include_str!("shadow.wgsl"),
        include_str!("samples.wgsl")
    ),
};

/// Which of these points are hidden from the light: `occlude`, `occlude_tiles`.
pub const OCCLUDE: Pass = Pass {
    name: "occlude",
    source: concat!(
        include_str!("shared.wgsl"),
        include_str!("points.wgsl"),
        include_str!("visible.wgsl"),
        include_str!("shadow.wgsl"),
        include_str!("casters.wgsl"),
        include_str!("cells.wgsl"),
        include_str!("occlude.wgsl")
    ),
};

/// Which of them are hidden by what a map has: `measure_map`, `fit`, `look_up`.
pub const MAP: Pass = Pass {
    name: "map",
    source: concat!(
        include_str!("shared.wgsl"),
        include_str!("points.wgsl"),
        include_str!("visible.wgsl"),
        include_str!("shadow.wgsl"),
        include_str!("map_view.wgsl"),
        include_str!("map.wgsl")
    ),
};

/// What casts, into a map.
pub const MAP_DRAW: Pass = Pass {
    name: "map_draw",
    source: concat!(
        include_str!("shared.wgsl"),
        include_str!("points.wgsl"),
        include_str!("casters.wgsl"),
        include_str!("map_view.wgsl"),
        include_str!("map_draw.wgsl")
    ),
};

/// How much of a disc is hidden from these points: `soften`, `soften_tiles`.
pub const SOFTEN: Pass = Pass {
    name: "soften",
    source: concat!(
        include_str!("shared.wgsl"),
        include_str!("points.wgsl"),
        include_str!("visible.wgsl"),
        include_str!("shadow.wgsl"),
        include_str!("casters.wgsl"),
        include_str!("cells.wgsl"),
        include_str!("soften.wgsl")
    ),
};

/// From sums of hidden parts to occlusion: `settle`.
pub const SETTLE: Pass = Pass {
    name: "settle",
    source: concat!(include_str!("shared.wgsl"), include_str!("settle.wgsl")),
};

/// Levels of detail or borders of nodes instead of shading.
pub const EXPLAIN: Pass = Pass {
    name: "explain",
    source: concat!(include_str!("shared.wgsl"), include_str!("explain.wgsl")),
};

/// The viewer's panel. Stands alone.
pub const PANEL: Pass = Pass { name: "panel", source: include_str!("panel.wgsl") };

/// Every pass.
pub const ALL: [Pass; 15] = [
    SURFACE, SMALL, SPREAD, LARGE, SPLATS, RESOLVE, SHADE, SAMPLES, OCCLUDE, MAP, MAP_DRAW, SOFTEN,
    SETTLE, EXPLAIN, PANEL,
];

#[cfg(test)]
mod tests {
    use naga::valid::{Capabilities, ValidationFlags, Validator};

    use super::*;

    #[test]
    fn every_pass_is_valid_wgsl() {
        for pass in ALL {
            let module = naga::front::wgsl::parse_str(pass.source)
                .unwrap_or_else(|e| panic!("{}: {}", pass.name, e.emit_to_string(pass.source)));
            let int64 = Capabilities::SHADER_INT64 | Capabilities::SHADER_INT64_ATOMIC_MIN_MAX;
            Validator::new(ValidationFlags::all(), int64)
                .validate(&module)
                .unwrap_or_else(|e| panic!("{}: {e:?}", pass.name));
        }
    }

    #[test]
    fn no_pass_branches_on_what_is_the_same_for_a_whole_draw() {
        for pass in ALL {
            let module = naga::front::wgsl::parse_str(pass.source).unwrap();
            let lines = branches::uniform_branches(&module).into_iter().map(|place| {
                let begin = place.to_range().map_or(0, |range| range.start);
                pass.source[begin..].lines().next().unwrap_or_default()
            });
            assert_eq!(lines.collect::<Vec<_>>(), [""; 0], "in {}", pass.name);
        }
    }
}
