//! The renderer's WGSL, one file a pass, embedded.
//!
//! Each pass is assembled from the shared declarations and its own file; tests validate every one
//! without a GPU and compare its structures with those that Rust fills in.

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

/// Shading of the visible surface.
pub const SHADE: Pass = Pass {
    name: "shade",
    source: concat!(include_str!("shared.wgsl"), include_str!("shade.wgsl")),
};

/// The viewer's panel. Stands alone.
pub const PANEL: Pass = Pass { name: "panel", source: include_str!("panel.wgsl") };

/// Every pass.
pub const ALL: [Pass; 3] = [SURFACE, SHADE, PANEL];

#[cfg(test)]
mod tests {
    use naga::valid::{Capabilities, ValidationFlags, Validator};

    use super::*;

    #[test]
    fn every_pass_is_valid_wgsl() {
        for pass in ALL {
            let module = naga::front::wgsl::parse_str(pass.source)
                .unwrap_or_else(|e| panic!("{}: {}", pass.name, e.emit_to_string(pass.source)));
            Validator::new(ValidationFlags::all(), Capabilities::empty())
                .validate(&module)
                .unwrap_or_else(|e| panic!("{}: {e:?}", pass.name));
        }
    }
}
