//! PLY: the format that most scans come in.
//!
//! `header` reads the table of contents, `values` single numbers in the three
//! encodings, and `body` turns records into batches. This module decides what each
//! element and property is for; what has no use is passed over and named in the
//! report.

mod body;
mod header;
mod paint;
mod values;

use crate::error::{Place, ScanError, Spot};
use crate::input::Input;
use crate::paged::Room;
use crate::report::ScanReport;
use crate::texture::{ColourSource, ColourTaken};
use crate::{KEEP_MAX, Opened};

use body::PlyReader;
use header::{Element, PropertyType, ScalarType};
use paint::Pass;

/// What a number of a vertex means: its place in a vertex's array of numbers.
const SLOT_NAMES: [&[&str]; NAMED_COUNT] = [
    &["x"],
    &["y"],
    &["z"],
    &["nx"],
    &["ny"],
    &["nz"],
    &["red", "diffuse_red"],
    &["green", "diffuse_green"],
    &["blue", "diffuse_blue"],
    &["alpha", "diffuse_alpha"],
];
const NAMED_COUNT: usize = 10;
/// Behind the slots with a meaning are those that are kept for their own sake.
const SLOT_COUNT: usize = NAMED_COUNT + KEEP_MAX;
const POSITION: std::ops::Range<usize> = 0..3;
const NORMAL: std::ops::Range<usize> = 3..6;
const COLOUR: std::ops::Range<usize> = 6..9;
const ALPHA: usize = 9;

/// Reads the header and plans the rest.
pub(crate) fn open(
    mut input: Input,
    room: &Room,
    (colour, keep): (ColourSource, &[String]),
    report: &mut ScanReport,
    progress: &mut dyn FnMut(u64) -> bool,
) -> Result<Opened, ScanError> {
    let header = header::read(&mut input)?;
    report.format = header.format;
    let at = Spot::new(input.path(), Place::File);

    let mut plans = Vec::new();
    let mut faces = None;
    for element in header.elements {
        let plan = plan(element, &at, (colour, keep))?;
        report_skipped(&plan, report);
        if matches!(plan.role, Role::Faces(_)) {
            faces = Some(plan.element.count);
        }
        plans.push(plan);
    }

    let vertex = plans.iter().find_map(|plan| match &plan.role {
        Role::Vertices(columns) => Some((plan.element.count, columns.clone())),
        _ => None,
    });
    let (vertices, columns) = vertex.unwrap_or_default();
    let vertex_count = u32::try_from(vertices)
        .map_err(|_| ScanError::TooManyVertices { at: at.clone(), vertices })?;
    let is_surface = |plan: &Plan| {
        plan.element.count > 0 && matches!(plan.role, Role::Faces(_) | Role::Strips(_))
    };
    let is_point_cloud = vertices > 0 && !plans.iter().any(is_surface);
    let layout = paint::Layout::find(&plans).filter(|_| !header.texture_files.is_empty());
    account_colours(&plans, colour, columns.has_colours, layout.is_some(), report);
    let takes_textures = colour.takes_textures(columns.has_colours);
    let painter = match layout.filter(|_| takes_textures) {
        Some(layout) => {
            let pass =
                Pass { at: at.clone(), plans: &plans, layout, vertex_count, room, source: colour };
            pass.paint(header.texture_files, report, progress)?
        }
        None => None,
    };
    if colour == ColourSource::Texture && painter.is_none() {
        return Err(ScanError::NoTexture { at });
    }
    let has_colours = columns.has_colours || painter.is_some();
    let room = if painter.is_some() { room.part(4) } else { room.clone() };
    let body = PlyReader::new(input, header.format, plans, vertex_count, room, painter);
    Ok(Opened {
        vertices: Some(vertices),
        faces,
        has_normals: columns.has_normals,
        has_colours,
        is_triangle_soup: false,
        scalars: columns.scalars,
        is_point_cloud,
        body: Box::new(body),
    })
}

/// An element and what to do with it.
struct Plan {
    element: Element,
    role: Role,
}

enum Role {
    Vertices(Columns),
    /// Polygons.
    Faces(CornerList),
    /// Triangle strips.
    Strips(CornerList),
    Skipped,
}

/// The list property that names vertices: its number and types.
#[derive(Clone, Copy)]
struct CornerList {
    property: usize,
    count: ScalarType,
    item: ScalarType,
}

/// Where a vertex's numbers are.
#[derive(Clone, Default)]
struct Columns {
    /// Slot of each property, in file order.
    slots: Vec<Option<usize>>,
    /// Properties that are numbers without a meaning here.
    scalars: Vec<String>,
    /// Of each property to be kept, whether it is there.
    kept: Vec<bool>,
    has_normals: bool,
    has_colours: bool,
    has_alpha: bool,
    /// Brings red, green, blue and alpha to 0..=1.
    colour_scales: [f64; 4],
}

fn plan(
    element: Element,
    at: &Spot,
    (colour, keep): (ColourSource, &[String]),
) -> Result<Plan, ScanError> {
    let role = match (element.name.as_str(), corner_list(&element)) {
        ("vertex", _) => {
            let mut columns = vertex_columns(&element, at, colour)?;
            columns.keep(&element, keep);
            Role::Vertices(columns)
        }
        ("face", Some(list)) => Role::Faces(list),
        ("tristrips", Some(list)) => Role::Strips(list),
        // Without its corners a surface would pass for a cloud.
        ("face" | "tristrips", None) if element.count > 0 => {
            let what = format!("element {} has no list vertex_indices", element.name);
            return Err(ScanError::malformed(at.clone(), what));
        }
        _ => Role::Skipped,
    };
    Ok(Plan { element, role })
}

fn corner_list(element: &Element) -> Option<CornerList> {
    let properties = element.properties.iter().enumerate();
    let mut named = properties.filter(|(_, property)| {
        matches!(property.name.as_str(), "vertex_indices" | "vertex_index")
    });
    named.find_map(|(index, property)| match property.of {
        PropertyType::List { count, item } => Some(CornerList { property: index, count, item }),
        PropertyType::Scalar(_) => None,
    })
}

impl Columns {
    /// Finds slots for properties that have none yet.
    fn keep(&mut self, element: &Element, keep: &[String]) {
        let keep = &keep[..keep.len().min(KEEP_MAX)];
        self.kept = vec![false; keep.len()];
        for (slot, property) in self.slots.iter_mut().zip(&element.properties) {
            if slot.is_some() || !matches!(property.of, PropertyType::Scalar(_)) {
                continue;
            }
            self.scalars.push(property.name.clone());
            if let Some(k) = keep.iter().position(|name| *name == property.name) {
                *slot = Some(NAMED_COUNT + k);
                self.kept[k] = true;
            }
        }
    }
}

fn vertex_columns(
    element: &Element,
    at: &Spot,
    colour: ColourSource,
) -> Result<Columns, ScanError> {
    // Find each slot's property; the first of its names wins.
    let found = SLOT_NAMES.map(|names| {
        names.iter().find_map(|name| {
            let mut properties = element.properties.iter().enumerate();
            properties.find_map(|(index, property)| match property.of {
                PropertyType::Scalar(scalar) if property.name == *name => Some((index, scalar)),
                _ => None,
            })
        })
    });
    for axis in POSITION {
        if found[axis].is_none() {
            let name = SLOT_NAMES[axis][0];
            let what = format!("element `vertex` has no number property `{name}`");
            return Err(ScanError::malformed(at.clone(), what));
        }
    }

    // A normal or a colour that lacks a component is of no use.
    let has = |mut slots: std::ops::Range<usize>| slots.all(|slot| found[slot].is_some());
    let has_normals = has(NORMAL);
    let has_colours = has(COLOUR) && colour.takes_vertex_colours();
    let has_alpha = has_colours && found[ALPHA].is_some();
    let is_used = |slot: usize| {
        POSITION.contains(&slot)
            || NORMAL.contains(&slot) && has_normals
            || COLOUR.contains(&slot) && has_colours
            || slot == ALPHA && has_alpha
    };

    let mut columns = Columns {
        slots: vec![None; element.properties.len()],
        scalars: Vec::new(),
        kept: Vec::new(),
        has_normals,
        has_colours,
        has_alpha,
        colour_scales: [1.0; 4],
    };
    for (slot, property) in found.iter().enumerate() {
        let Some((index, scalar)) = property.filter(|_| is_used(slot)) else {
            continue;
        };
        columns.slots[index] = Some(slot);
        if slot >= COLOUR.start {
            columns.colour_scales[slot - COLOUR.start] = match scalar {
                ScalarType::F32 | ScalarType::F64 => 1.0,
                ScalarType::U16 => 1.0 / 65535.0,
                // Wider integers hold 0..=255 where they are met.
                _ => 1.0 / 255.0,
            };
        }
    }
    Ok(columns)
}

/// Says where colours come from, and which are left out.
fn account_colours(
    plans: &[Plan],
    source: ColourSource,
    has_vertex_colours: bool,
    has_textures: bool,
    report: &mut ScanReport,
) {
    if has_vertex_colours {
        report.colours.taken = ColourTaken::Vertex;
    }
    let is_vertices = |plan: &&Plan| plan.element.name == "vertex";
    let names = || plans.iter().filter(is_vertices).flat_map(|plan| &plan.element.properties);
    let is_red = |name: &str| SLOT_NAMES[COLOUR.start].contains(&name);
    if !source.takes_vertex_colours() && names().any(|property| is_red(&property.name)) {
        report.colours.left_out.push("colours of vertices".to_owned());
    }
    if has_textures && !source.takes_textures(has_vertex_colours) {
        report.colours.left_out.push("textures".to_owned());
    }
}

fn report_skipped(plan: &Plan, report: &mut ScanReport) {
    let element = &plan.element;
    let is_used = |index: usize| match &plan.role {
        Role::Vertices(columns) => columns.slots[index].is_some(),
        Role::Faces(list) | Role::Strips(list) => list.property == index,
        Role::Skipped => false,
    };
    if let Role::Skipped = plan.role {
        report.skipped.push(format!("element {}", element.name));
        return;
    }
    for (index, property) in element.properties.iter().enumerate() {
        if !is_used(index) {
            let name = format!("property {}.{}", element.name, property.name);
            report.skipped.push(name);
        }
    }
}
