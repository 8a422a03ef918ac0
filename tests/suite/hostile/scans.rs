//! Hostile scans of every format, read by every command that reads scans.

use std::path::Path;

use hlod_tests::ended::{Ended, ended};
use hlod_tests::program;
use hlod_tests::samples::{Sample, SampleFormat, glb};

/// A file and what is wrong with it.
struct Case {
    what: String,
    extension: &'static str,
    bytes: Vec<u8>,
}

fn case(format: SampleFormat, what: &str, bytes: Vec<u8>) -> Case {
    Case { what: format!("{format:?}, {what}"), extension: format.extension(), bytes }
}

/// Numbers that are none, in places and in indices.
fn bad_values(format: SampleFormat) -> Vec<Case> {
    let mut cases = Vec::new();
    for (name, value) in [("NaN", f32::NAN), ("∞", f32::INFINITY), ("-∞", f32::NEG_INFINITY)] {
        for axis in 0..3 {
            let mut sample = Sample::tetrahedron();
            sample.positions[2][axis] = value;
            cases.push(case(format, &format!("{name} on axis {axis}"), sample.file(format)));
        }
        let mut sample = Sample::tetrahedron();
        sample.positions = vec![[value; 3]; 4];
        cases.push(case(format, &format!("nothing but {name}"), sample.file(format)));
    }
    if format.has_indices() {
        for index in [4, 1000, 0x7fff_ffff, 0x8000_0000, u32::MAX] {
            let mut sample = Sample::tetrahedron();
            sample.triangles[1][2] = index;
            cases.push(case(format, &format!("vertex {index}"), sample.file(format)));
        }
    }
    cases
}

/// Cut at twenty places, the last bytes among them.
fn truncations(format: SampleFormat) -> Vec<Case> {
    let whole = Sample::tetrahedron().file(format);
    // What ends a text is a line end, or a word that readers do without.
    let least = match format {
        SampleFormat::PlyAscii => 3,
        SampleFormat::Obj => whole.len() - whole.iter().position(|&b| b == b'f').unwrap(),
        // A text that ends between facets may be whole: `endsolid` is often left out.
        SampleFormat::StlAscii => "endfacet\nendsolid sample\n".len(),
        _ => 1,
    };
    let longest = whole.len() - least;
    let lengths = (0..20).map(|i| longest * i / 19);
    lengths.map(|n| case(format, &format!("cut to {n} bytes"), whole[..n].to_vec())).collect()
}

/// Headers in which a word was exchanged for another.
fn bad_headers(format: SampleFormat) -> Vec<Case> {
    let whole = Sample::tetrahedron().file(format);
    let exchanged = |from: &str, to: &str| {
        let at = whole.windows(from.len()).position(|w| w == from.as_bytes());
        let at = at.unwrap_or_else(|| panic!("{format:?} has no {from}"));
        let bytes = [&whole[..at], to.as_bytes(), &whole[at + from.len()..]].concat();
        case(format, &format!("{to:?} for {from:?}"), bytes)
    };
    let patched = |at: usize, value: u32| {
        let mut bytes = whole.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        case(format, &format!("{value:#x} at byte {at}"), bytes)
    };
    let exchanges: &[(&str, &str)] = match format {
        SampleFormat::PlyAscii | SampleFormat::PlyLittle | SampleFormat::PlyBig => &PLY_EXCHANGES,
        SampleFormat::Obj => &OBJ_EXCHANGES,
        SampleFormat::StlAscii => &STL_EXCHANGES,
        SampleFormat::Gltf | SampleFormat::Glb => &GLTF_EXCHANGES,
        SampleFormat::StlBinary => &[],
    };
    let mut cases: Vec<Case> = exchanges.iter().map(|(from, to)| exchanged(from, to)).collect();
    if format == SampleFormat::StlBinary {
        cases.extend([0, 5, 0x7fff_ffff, u32::MAX].map(|count| patched(80, count)));
    }
    if format == SampleFormat::Glb {
        // Version, length of the file, length and kind of the first chunk.
        for at in [4, 8, 12, 16] {
            cases.extend([0, 1, 0x7fff_ffff, u32::MAX].map(|value| patched(at, value)));
        }
    }
    cases
}

const PLY_EXCHANGES: [(&str, &str); 18] = [
    ("ply\n", "plx\n"),
    ("format", "formal"),
    ("1.0", "9.0"),
    ("element vertex 4", "element vertex"),
    ("element vertex 4", "element vertex -4"),
    ("element vertex 4", "element vertex 4000000000"),
    ("element vertex 4", "element vertex 18446744073709551616"),
    ("element vertex 4", "element vertex 4\nelement vertex 4"),
    ("property float x", "property float w"),
    ("property float x", "property real x"),
    ("property float x", "property list float float x"),
    ("property float x", "property list uchar uchar x"),
    ("element face 4", "element face 2147483647"),
    ("element face 4", "element face 4e0"),
    ("list uchar int", "list double int"),
    ("list uchar int", "list"),
    ("vertex_indices", "\u{0}"),
    ("end_header\n", ""),
];

const OBJ_EXCHANGES: [(&str, &str); 8] = [
    ("f 1", "f 0"),
    ("f 1", "f 99999999999999999999"),
    ("f 1", "f -9223372036854775808"),
    ("f 1", "f x"),
    ("v 1 0 0", "v 1 0"),
    ("v 1 0 0", "v 1 0 1e999"),
    ("v 1 0 0", "v 1 0 \u{fffd}"),
    ("v 1 0 0", "v 1 0 0 0 NaN x"),
];

const STL_EXCHANGES: [(&str, &str); 6] = [
    ("facet", "faced"),
    ("outer", "inner"),
    ("vertex 0", "vertex"),
    ("vertex 0", "vertex 1e999"),
    ("endloop", "vertex 1 1 1\nendloop"),
    ("endfacet", "facet"),
];

const GLTF_EXCHANGES: [(&str, &str); 20] = [
    ("\"2.0\"", "\"7.0\""),
    ("\"asset\"", "\"essat\""),
    ("\"count\": 4", "\"count\": 4294967295"),
    ("\"count\": 4", "\"count\": -1"),
    ("\"count\": 4", "\"count\": 18446744073709551615"),
    ("\"count\": 12", "\"count\": 13"),
    ("\"count\": 12", "\"count\": 1e300"),
    ("\"byteOffset\": 48", "\"byteOffset\": 18446744073709551615"),
    ("\"byteOffset\": 48", "\"byteOffset\": 52"),
    ("\"byteLength\": 96", "\"byteLength\": 9007199254740993"),
    ("\"buffer\": 0", "\"buffer\": 7"),
    ("\"bufferView\": 1", "\"bufferView\": 9"),
    ("\"POSITION\": 0", "\"POSITION\": 99"),
    ("\"POSITION\": 0", "\"POSITION\": 1"),
    ("5126", "5129"),
    ("\"mesh\": 0", "\"mesh\": 3"),
    ("\"mesh\": 0", "\"mesh\": 0, \"children\": [0]"),
    ("\"mesh\": 0", "\"mesh\": 0, \"matrix\": [1, 0, 0]"),
    ("\"mesh\": 0", "\"mesh\": 0, \"scale\": [1e300, 1e300, 1e300]"),
    ("\"nodes\": [0]", "\"nodes\": [12]"),
];

/// What no exchange makes: texts that nest without end, lines without end, lists of long lists.
fn oversized() -> Vec<Case> {
    let deep = format!(r#"{{"asset": {}{}}}"#, "[".repeat(200_000), "]".repeat(200_000));
    let long = format!("v 0 0 0\n{}\n", "v".repeat(1 << 20));
    let fan = "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uint int vertex_indices\nend_header\n";
    let mut fan = fan.as_bytes().to_vec();
    fan.extend([0; 12]);
    fan.extend(u32::MAX.to_le_bytes());
    fan.extend([0; 64]);
    vec![
        case(SampleFormat::Gltf, "deep", deep.clone().into_bytes()),
        case(SampleFormat::Glb, "deep", glb(&deep, &[])),
        case(SampleFormat::Obj, "a line of a megabyte", long.into_bytes()),
        case(SampleFormat::PlyLittle, "a face of 4 billion corners", fan),
        case(SampleFormat::PlyAscii, "nothing", Vec::new()),
        case(SampleFormat::Glb, "zeros", vec![0; 1 << 16]),
    ]
}

/// Each through each command; what took them in, or did not end well.
fn objections(cases: &[Case]) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let good = folder.path().join("good.ply");
    std::fs::write(&good, Sample::tetrahedron().file(SampleFormat::PlyAscii)).unwrap();
    let mut out = Vec::new();
    for case in cases {
        let scan = folder.path().join(format!("case.{}", case.extension));
        std::fs::write(&scan, &case.bytes).unwrap();
        for (command, ended) in runs(folder.path(), &scan, &good) {
            let objection = ended.objection();
            out.extend(objection.map(|why| format!("{}: {command}: {why}", case.what)));
        }
        std::fs::remove_file(&scan).unwrap();
        let left = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().path());
        let left: Vec<_> = left.filter(|path| *path != good).collect();
        assert!(left.is_empty(), "{} left {left:?}", case.what);
    }
    out
}

fn runs(folder: &Path, scan: &Path, good: &Path) -> [(&'static str, Ended); 2] {
    let output = folder.join("out.hlod");
    [
        ("build", ended(program("hlod-build").arg("build").arg(scan).arg("-o").arg(&output))),
        ("compare", ended(program("hlod-build").arg("compare").arg(good).arg(scan))),
    ]
}

fn refused(cases: &[Case]) {
    let objections = objections(cases);
    assert!(objections.is_empty(), "of {}:\n{}", cases.len(), objections.join("\n"));
}

fn of_all_formats(cases: fn(SampleFormat) -> Vec<Case>) -> Vec<Case> {
    SampleFormat::ALL.into_iter().flat_map(cases).collect()
}

/// What the others are measured against: unharmed, each is taken by each command.
#[test]
fn samples_are_good() {
    let whole = |f| vec![case(f, "unharmed", Sample::tetrahedron().file(f))];
    for format in SampleFormat::ALL {
        let folder = tempfile::tempdir().unwrap();
        let scan = folder.path().join(format!("good.{}", format.extension()));
        std::fs::write(&scan, &whole(format)[0].bytes).unwrap();
        for (command, ended) in runs(folder.path(), &scan, &scan) {
            assert_eq!(ended.status, Some(0), "{format:?}: {command}: {}", ended.said);
            assert!(ended.objection().is_some(), "a good file is no refusal");
        }
    }
}

#[test]
fn numbers_that_are_none_and_indices_out_of_range_are_refused() {
    refused(&of_all_formats(bad_values));
}

#[test]
fn scans_that_end_early_are_refused() {
    refused(&of_all_formats(truncations));
}

#[test]
fn scans_with_damaged_headers_are_refused() {
    refused(&of_all_formats(bad_headers));
}

#[test]
fn scans_without_measure_are_refused() {
    refused(&oversized());
}
