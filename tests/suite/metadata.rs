//! What is known of a scan besides its shape: from `build --meta` to everything that leaves the programs.

use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::OnceLock;

use hlod_compress::{HlodFile, METADATA_EXAMPLE, Metadata, Unit};
use hlod_tests::{ball, built, program};

const CREDIT: &str = "Scan: A. Example, by courtesy of the Museum of Casts";
const RIGHTS: &str = "http://creativecommons.org/licenses/by/4.0/";

fn scan(folder: &Path) -> PathBuf {
    let scan = folder.join("ball.ply");
    std::fs::write(&scan, ball(24, 0.0)).unwrap();
    scan
}

/// A ball with the example's metadata, in millimetres, made once.
fn described() -> &'static Path {
    static FILE: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, file) = FILE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("ball.hlod");
        built(&scan(folder.path()), &file, |o| {
            o.unit = Unit::Millimetre;
            o.metadata = Some(Metadata::parse(METADATA_EXAMPLE.as_bytes()).unwrap());
        });
        (folder, file)
    });
    file
}

fn run(name: &str, folder: &Path, arguments: &[&str]) -> Output {
    program(name).current_dir(folder).args(arguments).output().unwrap()
}

fn good(name: &str, folder: &Path, arguments: &[&str]) -> String {
    let output = run(name, folder, arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn metadata_go_into_the_file_as_they_are_and_info_shows_them() {
    let folder = tempfile::tempdir().unwrap();
    scan(folder.path());
    let text = METADATA_EXAMPLE.replacen('{', "{ \"material\":  \"marble\",", 1);
    std::fs::write(folder.path().join("meta.json"), &text).unwrap();
    let build = ["build", "ball.ply", "-o", "a.hlod", "--meta", "meta.json"];
    let output = run("hlod-build", folder.path(), &build);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.contains("material is kept"), "{said}");
    let file = HlodFile::open(&folder.path().join("a.hlod")).unwrap();
    assert_eq!(file.read_metadata().unwrap().unwrap().text(), text);

    let info = good("hlod-build", folder.path(), &["info", "a.hlod"]);
    assert!(info.contains(CREDIT) && info.contains("Inv. 1234"), "{info}");
    let info = good("hlod-build", folder.path(), &["info", "a.hlod", "--json"]);
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    assert_eq!(info["metadata"]["material"], "marble");
    assert_eq!(info["metadata"]["label"]["it"][0], "Testa femminile");
    assert_eq!((&info["format_version"], &info["bytes_metadata"]), (&2.into(), &text.len().into()));
}

/// Pages lie where they lay, and a file without metadata is what version 1 was.
#[test]
fn metadata_change_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let (scan, plain) = (scan(folder.path()), folder.path().join("plain.hlod"));
    built(&scan, &plain, |o| o.unit = Unit::Millimetre);
    let [with, without] = [described(), &plain].map(|path| HlodFile::open(path).unwrap());
    assert_eq!(with.header().format_version(), 2);
    assert_eq!(without.header().format_version(), 1);
    let pages = |file: &HlodFile| -> Vec<Vec<u8>> {
        let nodes = file.read_skeleton().unwrap();
        let all = nodes.iter().flat_map(|node| &node.representations);
        all.map(|r| file.read_page(r.page).unwrap()).collect()
    };
    assert_eq!(pages(&with), pages(&without));
}

#[test]
fn wrong_metadata_are_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    scan(folder.path());
    for (text, says) in [
        (
            METADATA_EXAMPLE.replace("\"k\": 2", "\"k\": \"two\""),
            "digitization.accuracy.k: expected",
        ),
        (METADATA_EXAMPLE.replace("http://", "by "), "rights: expected an address"),
        (METADATA_EXAMPLE.replace("\"label\"", "label"), "no JSON"),
        (format!("{{\"x\": \"{}\"}}", "y".repeat(1 << 20)), "more than the 1048576"),
        (String::new(), "no JSON"),
    ] {
        std::fs::write(folder.path().join("meta.json"), text).unwrap();
        let build = ["build", "ball.ply", "-o", "a.hlod", "--meta", "meta.json"];
        for arguments in [&build[..], &["meta", "meta.json"]] {
            let output = run("hlod-build", folder.path(), arguments);
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{said}");
            assert!(said.contains(says) && said.contains("meta.json"), "{said}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "nothing is left");
    }
}

#[test]
fn the_template_is_one_that_builds_take() {
    let folder = tempfile::tempdir().unwrap();
    let template = good("hlod-build", folder.path(), &["meta", "--template"]);
    std::fs::write(folder.path().join("meta.json"), template).unwrap();
    let said = good("hlod-build", folder.path(), &["meta", "meta.json"]);
    assert!(said.contains("every key is known") && said.contains(CREDIT), "{said}");
    let schema = good("hlod-build", folder.path(), &["meta", "--schema"]);
    let schema: serde_json::Value = serde_json::from_str(&schema).unwrap();
    assert!(schema["properties"]["requiredStatement"].is_object());
}

#[test]
fn pictures_and_drawings_say_where_the_scan_is_from() {
    let folder = tempfile::tempdir().unwrap();
    let file = described().to_str().unwrap();
    for output in ["a.png", "a.tif"] {
        let shot = ["--software", "-q", "shot", file, "--size", "60x60", "-o", output];
        good("hlod-render", folder.path(), &shot);
    }
    let png = std::fs::File::open(folder.path().join("a.png")).unwrap();
    let reader = png::Decoder::new(std::io::BufReader::new(png)).read_info().unwrap();
    let text = |keyword: &str| {
        let found = reader.info().utf8_text.iter().find(|t| t.keyword == keyword);
        found.unwrap_or_else(|| panic!("no {keyword}")).get_text().unwrap()
    };
    assert_eq!(text("Copyright").lines().collect::<Vec<_>>(), [RIGHTS, CREDIT]);
    assert!(text("About").contains("inventory number: Inv. 1234"));
    let tif = std::fs::File::open(folder.path().join("a.tif")).unwrap();
    let mut reader = tiff::decoder::Decoder::new(std::io::BufReader::new(tif)).unwrap();
    let copyright = reader.get_tag_ascii_string(tiff::tags::Tag::Copyright).unwrap();
    assert!(copyright.contains(CREDIT) && copyright.contains(RIGHTS), "{copyright}");
    let about = reader.get_tag_ascii_string(tiff::tags::Tag::ImageDescription).unwrap();
    assert!(about.contains("holder: Museum of Casts"), "{about}");

    let section = ["-q", "section", file, "--plane", "x=0", "--svg", "a.svg"];
    good("hlod-render", folder.path(), &section);
    let svg = std::fs::read_to_string(folder.path().join("a.svg")).unwrap();
    let (_, desc) = svg.split_once("<desc>").unwrap();
    let (desc, _) = desc.split_once("</desc>").unwrap();
    assert!(desc.contains(CREDIT) && desc.contains("title: Head of a woman"), "{desc}");
}

/// The accuracy that the file declares stands beside results, unless someone else declares another; in the
/// unit of lengths, and not at all where that is unknown.
#[test]
fn the_files_accuracy_is_the_scanners_uncertainty() {
    let folder = tempfile::tempdir().unwrap();
    let measured = |file: &str, more: &[&str]| -> serde_json::Value {
        let at =
            ["measure", file, "--kind", "distance", "--at", "1,0,0", "--at", "0,1,0", "--json"];
        let report = good("hlod-render", folder.path(), &[&at, more].concat());
        serde_json::from_str(&report).unwrap()
    };
    let report = measured(described().to_str().unwrap(), &[]);
    assert_eq!(
        (&report["scanner"]["expanded"], &report["scanner"]["k"]),
        (&0.05.into(), &2.0.into())
    );
    let source = report["scanner"]["source"].as_str().unwrap();
    assert!(source.starts_with("calibration certificate 12"), "{source}");
    let report = measured(described().to_str().unwrap(), &["--scanner-u", "0.2"]);
    assert_eq!(report["scanner"]["expanded"], 0.2);

    let scan = scan(folder.path());
    for (unit, expected) in [(Unit::Metre, Some(5e-5)), (Unit::Unknown, None)] {
        let file = folder.path().join(format!("{}.hlod", unit.name()));
        built(&scan, &file, |o| {
            o.unit = unit;
            o.metadata = Some(Metadata::parse(METADATA_EXAMPLE.as_bytes()).unwrap());
        });
        let report = measured(file.to_str().unwrap(), &[]);
        let found = report["scanner"]["expanded"].as_f64();
        let near = found.zip(expected).is_some_and(|(a, b)| (a / b - 1.0f64).abs() < 1e-12);
        assert!(near || found.is_none() && expected.is_none(), "{unit:?}: {report}");
        assert_eq!(report["remarks"].as_array().unwrap().len(), usize::from(expected.is_none()));
    }
}
