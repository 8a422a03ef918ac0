//! `./x scale`: how the build fares with models of growing size.

use std::fs;
use std::path::Path;
use std::process::ExitCode;

use crate::options::ScaleOptions;
use crate::system::{self, Need};
use crate::{Failure, run};

/// Where everything goes, from the repository's root.
const FOLDER: &str = "out/scale";

/// A column of the table: its head, the file of results, the key there, and what to divide by.
const COLUMNS: [(&str, &str, &str, f64); 8] = [
    ("triangles", "build", "triangles_input", 1.0),
    ("build s", "build", "wall_secs", 1.0),
    ("CPU s", "build", "cpu_secs", 1.0),
    ("memory MB", "build", "peak_anonymous_bytes", 1e6),
    ("file MB", "build", "bytes_total", 1e6),
    ("sampled", "verify", "representations_sampled", 1.0),
    ("over bound", "verify", "nodes_over_bound", 1.0),
    ("fps", "bench", "fps_mean", 1.0),
];

pub fn scale(options: &ScaleOptions) -> Result<ExitCode, Failure> {
    run::announce_first_build("release", "8 to 12 minutes")?;
    system::provide(&[Need::VulkanLoader, Need::VulkanDriver], options.may_install)?;
    let mut build = run::cargo();
    build.args(["build", "--release", "--package", "hlod-build", "--package", "hlod-render"]);
    run::run(&mut build)?;

    let folder = Path::new(FOLDER);
    fs::create_dir_all(run::root().join(folder))
        .map_err(|error| Failure::Work(format!("cannot create {FOLDER}: {error}")))?;
    let mut rows = Vec::new();
    for triangles in &options.triangles {
        let scan = folder.join(format!("statue-{triangles}.ply"));
        let model = folder.join(format!("statue-{triangles}.hlod"));
        let json = |what: &str| folder.join(format!("statue-{triangles}.{what}.json"));
        let results = |what: &str| format!("--json={}", json(what).display());
        if !run::root().join(&scan).exists() {
            let mut synth = run::program("hlod-build")?;
            synth.args(["synth", "statue", "--triangles", triangles, "-o"]).arg(&scan);
            run::run(&mut synth)?;
        }
        // Of an earlier run that was stopped: what is measured is a whole build.
        let unfinished = run::root().join(folder).join(format!("statue-{triangles}.hlod.work"));
        if unfinished.exists() {
            fs::remove_dir_all(&unfinished).map_err(|error| {
                Failure::Work(format!("cannot remove {}: {error}", unfinished.display()))
            })?;
        }
        let mut build = run::program("hlod-build")?;
        build.arg("build").arg(&scan).arg("-o").arg(&model).args(["--unit", "mm", "--force"]);
        run::run(build.args(["--memory", &options.memory]).arg(results("build")))?;
        let mut verify = run::program("hlod-build")?;
        run::run(
            verify.arg("verify").arg(&model).args(["--share", "0.02"]).arg(results("verify")),
        )?;
        let mut bench = run::program("hlod-render")?;
        bench.arg("bench").arg(&model).args(["--path", "bench-paths/orbit.json"]);
        run::run(bench.args(["--frames", "40"]).arg(results("bench")))?;

        let mut row = Vec::new();
        for (_, file, key, divisor) in COLUMNS {
            let path = run::root().join(json(file));
            let text = fs::read_to_string(&path)
                .map_err(|error| Failure::Work(format!("{}: {error}", path.display())))?;
            let value = number(&text, key)
                .ok_or_else(|| Failure::Work(format!("{}: has no number {key}", path.display())))?;
            row.push(value / divisor);
        }
        rows.push(row);
    }
    println!("\n--memory {}, 2 % of the nodes of each depth verified:\n", options.memory);
    println!("{}", COLUMNS.map(|(head, ..)| format!("{head:>12}")).join(""));
    for row in rows {
        let cells = row.iter().map(|value| match value {
            value if value.fract() == 0.0 => format!("{value:>12.0}"),
            value => format!("{value:>12.1}"),
        });
        println!("{}", cells.collect::<Vec<_>>().join(""));
    }
    Ok(ExitCode::SUCCESS)
}

/// The first number under a key of a JSON text as our programs write it.
fn number(text: &str, key: &str) -> Option<f64> {
    let (_, rest) = text.split_once(&format!("\"{key}\":"))?;
    let end = rest.find([',', '\n', '}'])?;
    rest[..end].trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_found_under_their_keys() {
        let text = "{\n  \"wall_secs\": 1.5,\n  \"nodes\": 12\n}";
        assert_eq!(number(text, "wall_secs"), Some(1.5));
        assert_eq!(number(text, "nodes"), Some(12.0));
        assert_eq!(number(text, "secs"), None);
        assert_eq!(number("{\"output\": \"x\",", "output"), None);
    }
}
