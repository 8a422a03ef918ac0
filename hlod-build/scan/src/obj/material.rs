//! Material libraries (MTL): what their textures are, and nothing else of them.
//!
//! A material's texture (`map_Kd`) is taken as it is: `Kd`, by which it should be multiplied, is left
//! at some grey by many exporters of scans. Faces of materials without one are painted with `Kd`,
//! taken as sRGB.

use std::collections::{BTreeSet, HashMap};
use std::path::Path;

use super::statement::{Statement, each_statement};
use crate::error::{ScanError, Spot};
use crate::input::Input;
use crate::paged::Room;
use crate::report::ScanReport;
use crate::sibling;
use crate::texture::{self, ColourSource, Surface, Texture, Wrap, linear_from_srgb};

/// Most libraries of a file, and materials of all.
const LIBRARIES_MAX: usize = 64;
const MATERIALS_MAX: usize = 65_536;

/// Names that the first pass collects.
#[derive(Default)]
pub(super) struct Names {
    pub(super) libraries: Vec<String>,
    pub(super) materials: BTreeSet<String>,
}

impl Names {
    /// Takes `mtllib` and `usemtl`.
    pub(super) fn read(&mut self, statement: &Statement<'_>) {
        let name = rest_of(statement);
        match statement.keyword {
            "mtllib" if self.libraries.len() < LIBRARIES_MAX && !self.libraries.contains(&name) => {
                self.libraries.push(name);
            }
            "usemtl" if self.materials.len() < MATERIALS_MAX => {
                self.materials.insert(name);
            }
            _ => {}
        }
    }
}

/// What stands behind a keyword: names may have spaces.
pub(super) fn rest_of(statement: &Statement<'_>) -> String {
    statement.words.clone().collect::<Vec<_>>().join(" ")
}

/// A material as its library has it.
#[derive(Clone, Debug, PartialEq)]
struct Material {
    /// sRGB, 0..1.
    colour: [f64; 3],
    map: Option<Map>,
}

/// A `map_Kd`.
#[derive(Clone, Debug, PartialEq)]
struct Map {
    /// Relative to the folder of the scan.
    name: String,
    offset: [f64; 2],
    scale: [f64; 2],
    is_clamped: bool,
}

/// Textures of a file and which material has which.
pub(super) struct Materials {
    pub(super) textures: Vec<Texture>,
    pub(super) surfaces: HashMap<String, Surface>,
}

/// Loads the textures of the materials named. `None` if there are none, or if they cannot be used
/// and need not be.
pub(super) fn load(
    names: &Names,
    source: ColourSource,
    room: &Room,
    at: &Spot,
    report: &mut ScanReport,
) -> Result<Option<Materials>, ScanError> {
    let mut known = HashMap::new();
    for library in &names.libraries {
        if let Err(what) = read_library(&at.path, library, &mut known) {
            if source == ColourSource::Texture {
                return Err(ScanError::Texture { at: at.clone(), name: library.clone(), what });
            }
            report.warnings.push(format!("no colours: material library `{library}` {what}"));
            return Ok(None);
        }
    }
    let mut named: Vec<String> = Vec::new();
    let mut surfaces = HashMap::new();
    for name in &names.materials {
        let Some(material) = known.get(name) else {
            report.warnings.push(format!("material `{name}` is in no library: it is white"));
            continue;
        };
        let texture = material.map.as_ref().map(|map| {
            let same = named.iter().position(|other| *other == map.name);
            same.unwrap_or_else(|| {
                named.push(map.name.clone());
                named.len() - 1
            })
        });
        surfaces.insert(name.clone(), material.surface(texture));
    }
    if named.is_empty() {
        return Ok(None);
    }
    let mut fetch = |_, name: &str, allowed| texture::fetch_sibling(&at.path, name, allowed);
    let textures = texture::load(named, &mut fetch, source, room, at, report)?;
    Ok(textures.map(|textures| Materials { textures, surfaces }))
}

impl Material {
    fn surface(&self, texture: Option<usize>) -> Surface {
        let mut surface = Surface {
            texture,
            factor: [1.0; 3],
            texture_from_file: Surface::FROM_LOWER_LEFT,
            wrap: [Wrap::Repeat; 2],
        };
        match &self.map {
            Some(map) => {
                let ([u, v], [s, t]) = (map.offset, map.scale);
                // v is scaled and moved before it is turned upside down.
                surface.texture_from_file = [[s, 0.0, u], [0.0, -t, 1.0 - v]];
                if map.is_clamped {
                    surface.wrap = [Wrap::Clamp; 2];
                }
            }
            None => surface.factor = self.colour.map(linear_from_srgb),
        }
        surface
    }
}

/// Adds the materials of a library; of several with one name the first counts.
fn read_library(
    document: &Path,
    name: &str,
    known: &mut HashMap<String, Material>,
) -> Result<(), String> {
    let separated = name.replace('\\', "/");
    let path = sibling::find(document, &separated)?;
    let folder = match separated.rsplit_once('/') {
        Some((folder, _)) => format!("{folder}/"),
        None => String::new(),
    };
    let mut input = Input::open(&path).map_err(|error| format!("cannot be read: {error}"))?;
    let mut current: Option<(String, Material)> = None;
    let mut keep = |material: Option<(String, Material)>| {
        if let Some((name, material)) = material.filter(|_| known.len() < MATERIALS_MAX) {
            known.entry(name).or_insert(material);
        }
    };
    each_statement(&mut input, &mut |_| true, |mut statement| {
        match (statement.keyword, &mut current) {
            ("newmtl", _) => {
                let new = Material { colour: [1.0; 3], map: None };
                keep(current.replace((rest_of(&statement), new)));
            }
            ("Kd", Some((_, material))) => {
                // `Kd spectral` and `Kd xyz` are other things.
                if let Ok(colour) = statement.numbers::<3>() {
                    material.colour = colour.map(|x| if x >= 0.0 { x.min(1.0) } else { 0.0 });
                }
            }
            ("map_Kd" | "map_kd", Some((_, material))) => {
                material.map = Some(read_map(&mut statement, &folder)?);
            }
            _ => {}
        }
        Ok(())
    })
    .map_err(|error| format!("is no material library: {error}"))?;
    keep(current);
    Ok(())
}

/// Options, then a file name, which may have spaces.
fn read_map(statement: &mut Statement<'_>, folder: &str) -> Result<Map, ScanError> {
    let mut map = Map { name: String::new(), offset: [0.0; 2], scale: [1.0; 2], is_clamped: false };
    let mut words: Vec<&str> = statement.words.by_ref().collect();
    words.reverse();
    while let Some(option) = words.pop() {
        // Where this many words follow at most, of which the last is the name.
        let mut numbers = |most: usize| -> Vec<f64> {
            let mut numbers = Vec::new();
            while numbers.len() < most && words.len() > 1 {
                match words.last().and_then(|word| word.parse::<f64>().ok()) {
                    Some(number) if number.is_finite() => numbers.push(number),
                    _ => break,
                }
                words.pop();
            }
            numbers
        };
        match option.to_ascii_lowercase().as_str() {
            "-o" => numbers(3).iter().zip(&mut map.offset).for_each(|(n, o)| *o = *n),
            "-s" => numbers(3).iter().zip(&mut map.scale).for_each(|(n, s)| *s = *n),
            "-t" => drop(numbers(3)),
            "-mm" => drop(numbers(2)),
            "-boost" | "-texres" | "-bm" => drop(numbers(1)),
            "-clamp" => map.is_clamped = words.pop() == Some("on"),
            "-blendu" | "-blendv" | "-cc" | "-imfchan" | "-type" => drop(words.pop()),
            _ => {
                words.push(option);
                break;
            }
        }
    }
    words.reverse();
    if words.is_empty() {
        return Err(statement.malformed("`map_Kd` names no file"));
    }
    map.name = format!("{folder}{}", words.join(" ").replace('\\', "/"));
    Ok(map)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map_of(line: &str) -> Option<Map> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.mtl"), format!("newmtl m\n{line}\n")).unwrap();
        let mut known = HashMap::new();
        read_library(&folder.path().join("a.obj"), "a.mtl", &mut known).ok()?;
        known.remove("m")?.map
    }

    #[test]
    fn options_of_a_texture_are_told_from_its_name() {
        let plain =
            Map { name: "a b.png".into(), offset: [0.0; 2], scale: [1.0; 2], is_clamped: false };
        assert_eq!(map_of("map_Kd a b.png"), Some(plain.clone()));
        let all = "map_Kd -blendu on -mm 0 1 -o 0.5 -s 2 3 1 -clamp on -boost 2 -t 0 0 0 a b.png";
        let expected =
            Map { offset: [0.5, 0.0], scale: [2.0, 3.0], is_clamped: true, ..plain.clone() };
        assert_eq!(map_of(all), Some(expected));
        // A name that is a number, and a path from Windows.
        assert_eq!(map_of("map_Kd -s 2 2 7").unwrap().name, "7");
        assert_eq!(map_of("map_Kd tex\\a.png").unwrap().name, "tex/a.png");
        assert_eq!(map_of("map_Kd -s 1 1"), Some(Map { name: "1".into(), ..plain }));
        assert_eq!(map_of("map_Kd"), None);
        assert_eq!(map_of("Kd 1 1 1"), None);
    }
}
