//! Hostile `.hlod` files, opened by every command that opens one.
//!
//! Checksums are no protection: whoever makes a file to do harm makes these right, too.

use std::path::{Path, PathBuf};
use std::process::Command;

use hlod_compress::{
    FileWriter, FormatError, Header, HlodFile, NodeRecord, PageRef, RepresentationKind, Unit,
};
use hlod_tests::ended::{Ended, ended};
use hlod_tests::{bumpy_ball, program, workspace};

/// A good file, the scan that it was made of, and a folder for others.
struct Setting {
    folder: tempfile::TempDir,
    scan: PathBuf,
    good: PathBuf,
    bytes: Vec<u8>,
}

impl Setting {
    fn new() -> Setting {
        let folder = tempfile::tempdir().unwrap();
        let [scan, good] = ["ball.ply", "good.hlod"].map(|name| folder.path().join(name));
        std::fs::write(&scan, bumpy_ball(24)).unwrap();
        hlod_tests::built(&scan, &good, |o| {
            o.leaf_triangles = 300;
            o.unit = Unit::Millimetre;
        });
        let bytes = std::fs::read(&good).unwrap();
        Setting { folder, scan, good, bytes }
    }

    /// The file with nodes and pages changed, all lengths and checksums right.
    fn rewritten(
        &self,
        nodes: impl FnOnce(&mut Vec<NodeRecord>),
        page: impl Fn(usize, Vec<u8>) -> Vec<u8>,
    ) -> Vec<u8> {
        let file = HlodFile::open(&self.good).unwrap();
        let mut records = file.read_skeleton().unwrap();
        let mut pages = std::collections::HashMap::new();
        for record in &mut records {
            for r in &mut record.representations {
                let bytes = page(pages.len(), file.read_page(r.page).unwrap());
                r.page = PageRef::of_bytes(&bytes);
                pages.insert((record.cell, r.kind), bytes);
            }
        }
        nodes(&mut records);
        let writer = FileWriter::new(file.header().clone(), records, None).unwrap();
        let mut out = Vec::new();
        let page = |cell, kind: RepresentationKind| Ok(pages[&(cell, kind)].clone());
        writer.write::<FormatError>(&mut out, page).unwrap();
        out
    }

    /// The file with bytes of its header's body exchanged, its checksum right.
    fn with_header(&self, at: usize, value: &[u8]) -> Vec<u8> {
        let length = u32::from_le_bytes(self.bytes[12..16].try_into().unwrap()) as usize;
        let mut body = self.bytes[20..20 + length].to_vec();
        body[at..at + value.len()].copy_from_slice(value);
        let version = u32::from_le_bytes(self.bytes[8..12].try_into().unwrap());
        [&Header::with_prefix(version, &body)[..], &self.bytes[20 + length..]].concat()
    }

    /// Runs commands on a file of these bytes.
    fn run(&self, bytes: &[u8], commands: &[&'static str]) -> Vec<(&'static str, Ended)> {
        let bad = self.folder.path().join("bad.hlod");
        std::fs::write(&bad, bytes).unwrap();
        let run = |name: &&'static str| (*name, ended(&mut self.command(name, &bad)));
        commands.iter().map(run).collect()
    }

    fn command(&self, name: &str, file: &Path) -> Command {
        let out = |name: &str| self.folder.path().join(name);
        let is_of_build = ["info", "verify", "export"].contains(&name);
        let mut command = program(if is_of_build { "hlod-build" } else { "hlod-render" });
        if !is_of_build {
            command.arg("--software");
        }
        command.arg(name).arg(file);
        let path = workspace().join("bench-paths/orbit.json");
        match name {
            "info" | "verify" => &mut command,
            "export" => command.args(["--leaves", "--force", "-o"]).arg(out("out.ply")),
            "measure" => command.args(["--kind", "distance", "--at", "0,1,0", "--at", "1,0,0"]),
            "section" => command.args(["--plane", "y=0", "--svg"]).arg(out("out.svg")),
            "shot" => command.args(["--size", "64x48", "--tau", "0.1", "-o"]).arg(out("out.png")),
            "plate" => command.args(["--scale", "1:1", "--dpi", "10", "-o"]).arg(out("out.png")),
            "turntable" => {
                command.args(["--frames", "2", "--size", "32x32", "-o"]).arg(out("turn"))
            }
            "light-dome" => {
                command.args(["--lights", "2", "--size", "32x32", "-o"]).arg(out("dome"))
            }
            "bench" => command.args(["--frames", "2", "--size", "64x48", "--path"]).arg(path),
            "simulate" => {
                command.args(["--size", "64x48", "--frame-rate", "1", "--path"]).arg(path)
            }
            "audit" => {
                command.args(["--views", "1", "--size", "64x48", "--against"]).arg(&self.scan)
            }
            other => panic!("there is no command {other}"),
        };
        command
    }
}

const ALL: [&str; 12] = [
    "info",
    "verify",
    "export",
    "measure",
    "section",
    "shot",
    "plate",
    "turntable",
    "light-dome",
    "bench",
    "simulate",
    "audit",
];

/// These need no adapter, and so take next to no time.
const QUICK: [&str; 5] = ["info", "verify", "export", "measure", "section"];

/// Of damaged pages these draw what is whole, or nothing; the others need all of the file.
const READ_PAGES: [&str; 6] = ["verify", "export", "measure", "section", "shot", "audit"];

#[test]
fn files_that_end_early_are_refused_by_every_command() {
    let s = Setting::new();
    let length = s.bytes.len();
    let mut objections = Vec::new();
    for (i, cut) in
        [0, 7, 19, 20, 160, 400, length / 3, length / 2, length - 1].into_iter().enumerate()
    {
        let commands = if i % 4 == 0 { &ALL[..] } else { &QUICK };
        for (command, ended) in s.run(&s.bytes[..cut], commands) {
            objections.extend(ended.objection().map(|why| format!("{cut}: {command}: {why}")));
        }
    }
    assert!(objections.is_empty(), "{}", objections.join("\n"));
}

/// What the other tests are measured against.
#[test]
fn a_good_file_is_taken_by_every_command() {
    let s = Setting::new();
    for (command, ended) in s.run(&s.bytes, &ALL) {
        assert_eq!(ended.status, Some(0), "{command}: {}", ended.said);
    }
    let same = s.rewritten(|_| (), |_, bytes| bytes);
    assert!(same == s.bytes, "writing again changes the file");
}

#[test]
fn headers_that_lie_are_refused() {
    let s = Setting::new();
    let of_f64 = |value: f64| value.to_le_bytes().to_vec();
    let of_u64 = |value: u64| value.to_le_bytes().to_vec();
    let of_u32 = |value: u32| value.to_le_bytes().to_vec();
    // Places in the header's body, as `Header::to_bytes` lays it out.
    let cases: Vec<(&str, usize, Vec<u8>)> = vec![
        ("a unit that is none", 0, vec![200]),
        ("up along a fourth axis", 1, vec![3]),
        ("NaN as the lattice's origin", 5, of_f64(f64::NAN)),
        ("an origin at infinity", 13, of_f64(f64::INFINITY)),
        ("NaN as the lattice's step", 29, of_f64(f64::NAN)),
        ("a step of 0", 29, of_f64(0.0)),
        ("a negative step", 29, of_f64(-1.0)),
        ("an infinite step", 29, of_f64(f64::INFINITY)),
        ("a root cube of no size", 37, of_u32(0)),
        ("a root cube that is too large", 37, of_u32(u32::MAX)),
        ("cells deeper than there are", 41, vec![255]),
        ("bounds outside the root", 42, of_u32(u32::MAX)),
        ("NaN as noise", 90, f32::NAN.to_le_bytes().to_vec()),
        ("primitives that are none", 94, vec![9]),
        ("more nodes than bytes", 99, of_u64(u64::MAX)),
        ("a root block behind the end", 115, of_u64(u64::MAX)),
        ("a root block of 4 GiB", 123, of_u32(u32::MAX)),
        ("a front part behind the end", 131, of_u64(u64::MAX)),
        ("a file of 16 EiB", 139, of_u64(u64::MAX)),
        ("more attributes than bytes", 147, vec![255, 255]),
    ];
    let mut objections = Vec::new();
    for (i, (what, at, value)) in cases.iter().enumerate() {
        let commands = if i % 7 == 2 { &ALL[..] } else { &QUICK };
        for (command, ended) in s.run(&s.with_header(*at, value), commands) {
            let wrong = match (*what, command) {
                // What does not walk the tree does not count its nodes.
                ("more nodes than bytes", _) => ended.disorder(),
                _ => ended.objection(),
            };
            objections.extend(wrong.map(|why| format!("{what}: {command}: {why}")));
        }
    }
    assert!(objections.is_empty(), "{}", objections.join("\n"));
}

/// A statue may be very large or very small: what overflows is said, and nothing panics.
#[test]
fn lattices_at_the_edge_of_numbers_come_to_an_orderly_end() {
    let s = Setting::new();
    let mut disorders = Vec::new();
    for (at, value) in [(29, 1e300f64), (29, 5e-324), (29, 1e38), (5, 1e300), (5, -1.7e308)] {
        for (command, ended) in s.run(&s.with_header(at, &value.to_le_bytes()), &ALL) {
            disorders.extend(ended.disorder().map(|why| format!("{value:e}: {command}: {why}")));
        }
    }
    assert!(disorders.is_empty(), "{}", disorders.join("\n"));
}

type Change = fn(&mut NodeRecord);

#[test]
fn skeletons_that_lie_are_found_out() {
    let s = Setting::new();
    let each =
        |change: Change| move |nodes: &mut Vec<NodeRecord>| nodes.iter_mut().for_each(change);
    let cases: [(&str, Change); 8] = [
        ("bounds of all integers", |n| n.bounds = [[i32::MIN; 3], [i32::MAX; 3]]),
        ("4 billion vertices", |n| {
            n.representations.iter_mut().for_each(|r| r.vertices = u32::MAX)
        }),
        ("4 billion triangles", |n| {
            n.representations.iter_mut().for_each(|r| r.triangles = u32::MAX)
        }),
        ("4 billion points", |n| n.representations.iter_mut().for_each(|r| r.points = u32::MAX)),
        ("errors of nothing", |n| {
            n.representations.iter_mut().for_each(|r| r.errors.geometric = 0.0);
        }),
        ("errors beyond measure", |n| {
            n.representations.iter_mut().for_each(|r| r.errors.geometric = f32::MAX);
        }),
        ("a radius beyond measure", |n| {
            n.representations.iter_mut().for_each(|r| r.cover_radius = f32::MAX);
        }),
        ("closed where it is open", |n| n.flags.closed_oriented ^= true),
    ];
    let mut disorders = Vec::new();
    for (what, change) in cases {
        let bytes = s.rewritten(each(change), |_, page| page);
        for (command, ended) in s.run(&bytes, &ALL) {
            disorders.extend(ended.disorder().map(|why| format!("{what}: {command}: {why}")));
        }
    }
    assert!(disorders.is_empty(), "{}", disorders.join("\n"));
}

#[test]
fn pages_of_other_content_come_to_an_orderly_end() {
    let s = Setting::new();
    let flipped = |seed: usize| {
        move |page: usize, mut bytes: Vec<u8>| {
            let at = (page * 7919 + seed * 104_729) % bytes.len();
            bytes[at] ^= 1 << (seed % 8);
            bytes
        }
    };
    let mut files: Vec<(String, Vec<u8>)> = vec![
        ("empty pages".into(), s.rewritten(|_| (), |_, _| Vec::new())),
        ("pages of zeros".into(), s.rewritten(|_| (), |_, bytes| vec![0; bytes.len()])),
        ("pages of ones".into(), s.rewritten(|_| (), |_, bytes| vec![255; bytes.len()])),
        ("half pages".into(), s.rewritten(|_| (), |_, bytes| bytes[..bytes.len() / 2].to_vec())),
    ];
    for seed in 1..7 {
        files.push((format!("flipped bits, {seed}"), s.rewritten(|_| (), flipped(seed))));
    }
    let mut disorders = Vec::new();
    for (i, (what, bytes)) in files.iter().enumerate() {
        for (command, ended) in s.run(bytes, if i < 6 { &ALL } else { &READ_PAGES }) {
            // Three of the first four hold nothing that could be drawn: no result is right.
            let needs_pages = command != "info" && command != "simulate" && command != "bench";
            let wrong = match i < 4 && needs_pages && command != "plate" {
                true => ended.objection(),
                false => ended.disorder(),
            };
            disorders.extend(wrong.map(|why| format!("{what}: {command}: {why}")));
        }
    }
    assert!(disorders.is_empty(), "{}", disorders.join("\n"));
}
