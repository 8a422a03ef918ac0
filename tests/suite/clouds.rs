//! Point clouds of scanners' own formats, with normals estimated where they have none.

use std::path::{Path, PathBuf};

use glam::DVec3;
use hlod_build::progress::Silent;
use hlod_build::{
    BuildError, BuildOptions, BuildReport, Selection, VerifyOptions, build, export, verify,
};
use hlod_compress::{HlodFile, RepresentationKind};
use hlod_scan::{Batch, ColourSource, ReadOptions, ScanError, ScanReader};

/// Where national grids have their statues.
const FAR: DVec3 = DVec3::new(654_321.25, 5_412_345.5, 312.125);

/// Points of a ball of radius 1, on a golden spiral.
fn ball(count: usize) -> Vec<DVec3> {
    let at = |i: usize| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
        let (turn, r) = (2.399_963_229_728_653 * i as f64, (1.0 - z * z).sqrt());
        DVec3::new(r * turn.cos(), r * turn.sin(), z)
    };
    (0..count).map(at).collect()
}

/// Red grows with x, in 16 bits.
fn red(p: DVec3) -> u16 {
    (32767.5 * (p.x + 1.0)) as u16
}

/// Writes a LAS file, or LAZ by the name's end; every hundredth point is withheld.
fn write_las(path: &Path, points: &[DVec3], colour_max: u16) {
    let mut header = las::Builder::from((1, 4));
    header.point_format = las::point::Format::new(7).unwrap();
    header.point_format.is_compressed = path.extension().is_some_and(|e| e == "laz");
    let along = |offset: f64| las::Transform { scale: 0.0001, offset };
    header.transforms = las::Vector { x: along(FAR.x), y: along(FAR.y), z: along(FAR.z) };
    let mut writer = las::Writer::from_path(path, header.into_header().unwrap()).unwrap();
    for (i, p) in points.iter().enumerate() {
        let at = *p + FAR;
        let scaled = (u32::from(red(*p)) * u32::from(colour_max) / 65535) as u16;
        writer
            .write_point(las::Point {
                x: at.x,
                y: at.y,
                z: at.z,
                color: Some(las::Color::new(scaled, colour_max, 0)),
                intensity: red(*p),
                gps_time: Some(0.0),
                is_withheld: i % 100 == 0,
                ..las::Point::default()
            })
            .unwrap();
    }
    writer.close().unwrap();
}

/// Two scans, each of the half of the ball that its scanner sees, in the scanner's own
/// coordinates; every hundredth point is marked as invalid.
fn write_e57(path: &Path, points: &[DVec3], has_poses: bool) {
    use e57::{Record, RecordDataType, RecordName, RecordValue};
    let mut writer = e57::E57Writer::from_file(path, "file").unwrap();
    for side in [1.0, -1.0] {
        let invalid = Record {
            name: RecordName::CartesianInvalidState,
            data_type: RecordDataType::Integer { min: 0, max: 2 },
        };
        let prototype = vec![
            Record::CARTESIAN_X_F64,
            Record::CARTESIAN_Y_F64,
            Record::CARTESIAN_Z_F64,
            invalid,
            Record::COLOR_RED_U8,
            Record::COLOR_GREEN_U8,
            Record::COLOR_BLUE_U8,
            Record::INTENSITY_U16,
        ];
        let mut scan = writer.add_pointcloud(&format!("scan {side}"), prototype).unwrap();
        // A scanner 5 away on the x axis, turned half round z.
        let station = FAR + DVec3::X * 5.0 * side;
        if has_poses {
            scan.set_transform(Some(e57::Transform {
                rotation: e57::Quaternion { w: 0.0, x: 0.0, y: 0.0, z: 1.0 },
                translation: e57::Translation { x: station.x, y: station.y, z: station.z },
            }));
        }
        for (i, p) in points.iter().enumerate().filter(|(_, p)| p.x * side >= 0.0) {
            let off = *p + FAR - station;
            let own = if has_poses { DVec3::new(-off.x, -off.y, off.z) } else { *p + FAR };
            let colour = |value: i64| RecordValue::Integer(value);
            scan.add_point(vec![
                RecordValue::Double(own.x),
                RecordValue::Double(own.y),
                RecordValue::Double(own.z),
                RecordValue::Integer(if i % 100 == 0 { 2 } else { 0 }),
                colour(i64::from(red(*p) >> 8)),
                colour(255),
                colour(0),
                RecordValue::Integer(red(*p).into()),
            ])
            .unwrap();
        }
        scan.finalize().unwrap();
    }
    writer.finalize().unwrap();
}

struct Files(tempfile::TempDir);

impl Files {
    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
}

fn files() -> Files {
    Files(tempfile::tempdir().unwrap())
}

/// Positions and colours, and how many points were passed over.
type Cloud = (Vec<DVec3>, Vec<[u8; 4]>, u64);

fn read(path: &Path) -> Result<Cloud, ScanError> {
    let mut reader = ScanReader::open(path)?;
    assert!(reader.header().is_point_cloud);
    let (mut positions, mut colours) = (Vec::new(), Vec::new());
    while let Some(batch) = reader.next_batch()? {
        let Batch::Vertices(batch) = batch else { panic!("a cloud has no triangles") };
        positions.extend(batch.positions);
        colours.extend(batch.colours);
    }
    Ok((positions, colours, reader.report().points_invalid))
}

#[test]
fn every_format_gives_the_points_that_were_written() {
    let files = files();
    let points = ball(70_000);
    write_las(&files.path("a.las"), &points, 65535);
    write_las(&files.path("a.laz"), &points, 65535);
    write_las(&files.path("small.las"), &points, 255);
    write_e57(&files.path("a.e57"), &points, true);
    for name in ["a.las", "a.laz", "small.las", "a.e57"] {
        let (positions, colours, invalid) = read(&files.path(name)).unwrap();
        assert_eq!((positions.len(), invalid), (69_300, 700), "{name}");
        // E57 has one half after the other.
        let mut expected: Vec<(DVec3, u16)> = points
            .iter()
            .enumerate()
            .filter(|(i, _)| i % 100 != 0)
            .map(|(_, p)| (*p + FAR, red(*p)))
            .collect();
        if name.ends_with("e57") {
            expected.sort_by_key(|(p, _)| p.x < FAR.x);
        }
        for ((found, colour), (wanted, red)) in positions.iter().zip(&colours).zip(&expected) {
            assert!(found.distance(*wanted) < 1e-4, "{name}: {found} for {wanted}");
            let off = i32::from(colour[0]) - i32::from(red >> 8);
            assert!(off.abs() <= 1 && colour[1..] == [255, 0, 255], "{name}: {colour:?}");
        }
    }
}

/// What is kept of a cloud's points, besides their positions.
fn kept(path: &Path, keep: &[&str]) -> Vec<(DVec3, Vec<f64>)> {
    let names: Vec<String> = keep.iter().map(|name| (*name).to_owned()).collect();
    let options = ReadOptions {
        memory_bytes: 1 << 30,
        scratch: path.parent().unwrap(),
        colour: ColourSource::Auto,
        transform: None,
        progress: &mut |_| true,
        keep: &names,
    };
    let mut reader = ScanReader::open_within(path, options).unwrap();
    let mut out = Vec::new();
    while let Some(Batch::Vertices(batch)) = reader.next_batch().unwrap() {
        assert_eq!(batch.scalars.len(), keep.len());
        let numbers = |i: usize| batch.scalars.iter().map(|column| column[i]).collect();
        out.extend(batch.positions.iter().enumerate().map(|(i, p)| (*p - FAR, numbers(i))));
    }
    let left_out = reader.report().skipped.join("\n");
    assert!(!left_out.contains("intensity"), "{left_out}");
    out
}

#[test]
fn intensities_are_kept_and_what_is_not_is_named() {
    let files = files();
    let points = ball(5_000);
    write_las(&files.path("a.laz"), &points, 65535);
    write_e57(&files.path("a.e57"), &points, true);
    for (name, others) in [("a.laz", "gps_time"), ("a.e57", "intensity")] {
        let found = kept(&files.path(name), &["colophon", "intensity"]);
        assert_eq!(found.len(), 4_950);
        for (p, numbers) in &found {
            // Rounded as positions are, a point's own intensity changes by ten of 65,536.
            let off = (numbers[1] - f64::from(red(*p))).abs();
            assert!(numbers[0].is_nan() && off < 10.0, "{name}: {p} {numbers:?}");
        }
        let reader = ScanReader::open(&files.path(name)).unwrap();
        let (skipped, there) = (reader.report().skipped.join("\n"), &reader.header().scalars);
        assert!(skipped.contains(others), "{name}: {skipped}");
        assert!(there.iter().any(|name| name == "intensity"), "{there:?}");
    }
    // Through the whole build; what the file has not is refused by name.
    let with = |name: &str| {
        let keep = vec![name.parse().unwrap()];
        let options = BuildOptions { keep, force: true, ..BuildOptions::default() };
        build(&[files.path("a.e57")], &files.path("a.hlod"), &options, &Silent)
    };
    let error = with("gps_time").unwrap_err().to_string();
    assert!(error.contains("has intensity"), "{error}");
    with("intensity").unwrap();
    let header = HlodFile::open(&files.path("a.hlod")).unwrap().header().clone();
    let (name, range) = header.scalars().next().unwrap();
    assert!(name == "intensity" && range.value(1).is_some_and(|low| low < 400.0), "{range:?}");
}

/// Dark scans in 16 bits begin like scans in 8.
#[test]
fn colours_of_16_bits_are_told_wherever_they_begin() {
    let files = files();
    let mut points = vec![DVec3::NEG_X; 70_000];
    points.extend([DVec3::X; 2]);
    write_las(&files.path("late.las"), &points, 65535);
    let (_, colours, _) = read(&files.path("late.las")).unwrap();
    assert_eq!((colours[0][0], colours.last().unwrap()[0]), (0, 255));
}

fn built(input: &Path, output: &Path) -> Result<BuildReport, BuildError> {
    let options = BuildOptions { force: true, ..BuildOptions::default() };
    build(&[input.to_owned()], output, &options, &Silent)
}

/// The cosine between a point's normal and the ball's, at worst and best.
fn facing(files: &Files, hlod: &Path) -> (f64, f64) {
    let out = files.path("leaves.ply");
    let kind = RepresentationKind::Appearance;
    export(hlod, &out, Selection::Leaves, kind, true).unwrap();
    let mut reader = ScanReader::open(&out).unwrap();
    let (mut least, mut most) = (1.0f64, -1.0f64);
    while let Some(Batch::Vertices(batch)) = reader.next_batch().unwrap() {
        for (p, n) in batch.positions.iter().zip(&batch.normals) {
            // From 5 away the horizon of the ball is at a fifth: what lies behind it was not seen, and
            // nothing tells its sides apart.
            if (p.x - FAR.x).abs() < 0.22 {
                continue;
            }
            let cosine = (*p - FAR).normalize().dot(n.as_dvec3());
            (least, most) = (least.min(cosine), most.max(cosine));
        }
    }
    (least, most)
}

#[test]
fn normals_are_estimated_and_face_outwards() {
    let files = files();
    let points = ball(20_000);
    write_las(&files.path("a.laz"), &points, 65535);
    write_e57(&files.path("a.e57"), &points, true);
    write_e57(&files.path("merged.e57"), &points, false);
    let hlod = files.path("a.hlod");
    for (name, said) in
        [("a.laz", "outwards"), ("a.e57", "towards the scanners"), ("merged.e57", "outwards")]
    {
        let report = built(&files.path(name), &hlod).unwrap();
        assert_eq!((report.normals_estimated, report.points_input), (19_800, 19_800), "{name}");
        let warnings = report.inputs[0].warnings.join("\n");
        assert!(warnings.contains("estimated") && warnings.contains(said), "{name}: {warnings}");
        let (least, _) = facing(&files, &hlod);
        assert!(least > 0.99, "{name}: {least}");
        let against = |name: &str| {
            let against = vec![files.path(name)];
            let options = VerifyOptions { against, ..VerifyOptions::default() };
            verify(&hlod, &options, &Silent).unwrap()
        };
        assert!(!against(name).is_refuted(), "{name}: {:?}", against(name).problems);
        write_las(&files.path("other.las"), &ball(19_999), 65535);
        assert!(against("other.las").is_refuted());
    }
}

#[test]
fn estimated_normals_do_not_depend_on_memory_or_threads() {
    let files = files();
    write_las(&files.path("a.las"), &ball(20_000), 65535);
    let bytes = |memory: u64, threads: usize| {
        let options = BuildOptions {
            memory_bytes: memory,
            leaf_triangles: 1000,
            force: true,
            ..BuildOptions::default()
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let hlod = files.path("a.hlod");
        pool.install(|| build(&[files.path("a.las")], &hlod, &options, &Silent))?;
        Ok::<_, BuildError>(std::fs::read(&hlod).unwrap())
    };
    let usual = bytes(4 << 30, 2).unwrap();
    assert!(bytes(200 << 20, 1).unwrap() == usual);
}

#[test]
fn what_cannot_be_read_is_refused_by_name() {
    let files = files();
    for name in ["a.ptx", "a.pts"] {
        std::fs::write(files.path(name), "3\n1\n0 0 0\n1 0 0\n").unwrap();
        let error = ScanReader::open(&files.path(name)).unwrap_err().to_string();
        assert!(error.contains("E57 or PLY"), "{error}");
    }
    write_las(&files.path("a.las"), &ball(1000), 65535);
    write_las(&files.path("a.laz"), &ball(1000), 65535);
    write_e57(&files.path("a.e57"), &ball(1000), true);
    for name in ["a.las", "a.laz", "a.e57"] {
        let whole = std::fs::read(files.path(name)).unwrap();
        for cut in [8, 100, 300, whole.len() / 2, whole.len() - 1] {
            std::fs::write(files.path(name), &whole[..cut]).unwrap();
            // Without the last byte of a LAZ file every point may still be there.
            let found = read(&files.path(name));
            assert!(found.is_err() || cut == whole.len() - 1, "{name} cut at {cut}");
        }
        // Wrong bytes anywhere end in an error or in points, never in a panic or without an end.
        let mut state = 7u64;
        for _ in 0..60 {
            let mut wrong = whole.clone();
            for _ in 0..4 {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                let at = (state >> 33) as usize % wrong.len();
                wrong[at] = (state >> 20) as u8;
            }
            std::fs::write(files.path(name), &wrong).unwrap();
            let _ = read(&files.path(name));
        }
    }
}
