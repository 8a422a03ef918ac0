//! Random meshes, written as PLY in each encoding with properties of any type in any
//! order, read back equal.

use glam::DVec3;
use proptest::prelude::*;

use crate::{Files, read_path};

#[derive(Clone, Copy, Debug, PartialEq)]
enum Encoding {
    Ascii,
    Little,
    Big,
}

/// Types by their PLY names; sizes follow from them.
const SCALARS: [&str; 12] = [
    "char", "uchar", "short", "ushort", "int", "uint", "float", "double", "int16", "uint32",
    "float32", "float64",
];
const INDICES: [&str; 7] = ["uchar", "char", "short", "uint16", "int", "uint32", "int32"];

/// Appends one number.
fn put(out: &mut Vec<u8>, encoding: Encoding, of: &str, value: f64) {
    if encoding == Encoding::Ascii {
        // The shortest text that reads back as the same number of the declared type.
        let text = match of {
            "float" | "float32" => format!("{} ", value as f32),
            _ => format!("{value} "),
        };
        out.extend(text.bytes());
        return;
    }
    let little = match of {
        "char" => (value as i8).to_le_bytes().to_vec(),
        "uchar" => (value as u8).to_le_bytes().to_vec(),
        "short" | "int16" => (value as i16).to_le_bytes().to_vec(),
        "ushort" | "uint16" => (value as u16).to_le_bytes().to_vec(),
        "int" | "int32" => (value as i32).to_le_bytes().to_vec(),
        "uint" | "uint32" => (value as u32).to_le_bytes().to_vec(),
        "float" | "float32" => (value as f32).to_le_bytes().to_vec(),
        _ => value.to_le_bytes().to_vec(),
    };
    match encoding {
        Encoding::Big => out.extend(little.iter().rev()),
        _ => out.extend(little),
    }
}

/// The number as its type holds it.
fn rounded(of: &str, value: f64) -> f64 {
    match of {
        "char" => f64::from(value as i8),
        "uchar" => f64::from(value as u8),
        "short" | "int16" => f64::from(value as i16),
        "ushort" | "uint16" => f64::from(value as u16),
        "int" | "int32" => f64::from(value as i32),
        "uint" | "uint32" => f64::from(value as u32),
        "float" | "float32" => f64::from(value as f32),
        _ => value,
    }
}

#[derive(Clone, Debug)]
struct Mesh {
    positions: Vec<[f64; 3]>,
    colours: Vec<[u8; 3]>,
    triangles: Vec<[u32; 3]>,
    /// Type and name of each vertex property, in file order.
    properties: Vec<(&'static str, &'static str)>,
    index_types: (&'static str, &'static str),
    faces_first: bool,
}

fn meshes() -> impl Strategy<Value = Mesh> {
    let scalar = || prop::sample::select(SCALARS.to_vec());
    let index = || prop::sample::select(INDICES.to_vec());
    let types = (scalar(), scalar(), scalar(), scalar());
    (3..100usize, types, (index(), index()), any::<bool>())
        .prop_flat_map(|(count, types, index_types, faces_first)| {
            let (x, y, z, other) = types;
            let properties = vec![
                (x, "x"),
                (y, "y"),
                (z, "z"),
                (other, "confidence"),
                ("uchar", "red"),
                ("uint8", "green"),
                ("uchar", "blue"),
            ];
            let corner = 0..count as u32;
            let triangle = [corner.clone(), corner.clone(), corner];
            (
                prop::collection::vec(prop::array::uniform3(-1e6..1e6f64), count),
                prop::collection::vec(any::<[u8; 3]>(), count),
                prop::collection::vec(triangle, 1..200),
                Just(properties).prop_shuffle(),
                Just((index_types, faces_first)),
            )
        })
        .prop_map(|(positions, colours, mut triangles, properties, rest)| {
            triangles.retain(|[a, b, c]| a != b && b != c && c != a);
            triangles.push([2, 0, 1]);
            Mesh {
                positions,
                colours,
                triangles,
                properties,
                index_types: rest.0,
                faces_first: rest.1,
            }
        })
}

impl Mesh {
    fn write(&self, encoding: Encoding) -> Vec<u8> {
        let name = match encoding {
            Encoding::Ascii => "ascii",
            Encoding::Little => "binary_little_endian",
            Encoding::Big => "binary_big_endian",
        };
        let mut vertex = format!("element vertex {}\n", self.positions.len());
        for (of, name) in &self.properties {
            vertex += &format!("property {of} {name}\n");
        }
        let (count, index) = self.index_types;
        let face = format!(
            "element face {}\nproperty list {count} {index} vertex_indices\n",
            self.triangles.len()
        );
        let (mut vertices, mut faces) = (Vec::new(), Vec::new());
        for (position, colour) in self.positions.iter().zip(&self.colours) {
            for (of, name) in &self.properties {
                let value = match *name {
                    "x" => rounded(of, position[0]),
                    "y" => rounded(of, position[1]),
                    "z" => rounded(of, position[2]),
                    "red" => colour[0].into(),
                    "green" => colour[1].into(),
                    "blue" => colour[2].into(),
                    _ => 1.0,
                };
                let of = if *of == "uint8" { "uchar" } else { of };
                put(&mut vertices, encoding, of, value);
            }
        }
        for triangle in &self.triangles {
            put(&mut faces, encoding, count, 3.0);
            for corner in triangle {
                put(&mut faces, encoding, index, (*corner).into());
            }
        }
        let begin = format!("ply\nformat {name} 1.0\n");
        let parts = match self.faces_first {
            true => [
                begin.as_bytes(),
                face.as_bytes(),
                vertex.as_bytes(),
                b"end_header\n",
                &faces,
                &vertices,
            ],
            false => [
                begin.as_bytes(),
                vertex.as_bytes(),
                face.as_bytes(),
                b"end_header\n",
                &vertices,
                &faces,
            ],
        };
        parts.concat()
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 120, failure_persistence: None, ..Default::default() })]

    #[test]
    fn reads_back_equal(mesh in meshes()) {
        let types = mesh.properties.iter().copied();
        let type_of = |axis: &str| types.clone().find(|(_, name)| *name == axis).map_or("", |p| p.0);
        let expected: Vec<DVec3> = mesh
            .positions
            .iter()
            .map(|[x, y, z]| DVec3::new(
                rounded(type_of("x"), *x),
                rounded(type_of("y"), *y),
                rounded(type_of("z"), *z),
            ))
            .collect();
        let files = Files::new();
        for encoding in [Encoding::Ascii, Encoding::Little, Encoding::Big] {
            let whole = read_path(&files.write("a.ply", mesh.write(encoding)))
                .map_err(|error| TestCaseError::fail(error.to_string()))?;
            prop_assert_eq!(&whole.positions, &expected);
            let colours: Vec<[u8; 4]> =
                mesh.colours.iter().map(|[r, g, b]| [*r, *g, *b, 255]).collect();
            prop_assert_eq!(&whole.colours, &colours);
            prop_assert_eq!(&whole.triangles, &mesh.triangles);
            prop_assert_eq!(&whole.report.skipped, &["property vertex.confidence"]);
        }
    }
}
