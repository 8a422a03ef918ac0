//! `./x demo`: a sample statue, its `.hlod`, and the viewer or pictures of it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use crate::options::DemoOptions;
use crate::system::{self, Machine, Need};
use crate::{Failure, run};

/// Where everything goes, from the repository's root.
const FOLDER: &str = "out/demo";

/// The pictures: a name and what `shot` is given. Points are in heights of the model, counted
/// from its centre.
const VIEWS: [(&str, &[&str]); 3] = [
    ("statue", &["--camera", "three-quarter"]),
    ("head", &["--camera", "0.12,0.3,0.95:0.02,0.23,0"]),
    // Light from the side shows what was carved, and asks for more precision.
    ("inscription", &["--camera=-0.04,-0.33,0.66:0,-0.355,0.2", "--light=-78,12", "--tau", "0.1"]),
];

pub fn demo(options: &DemoOptions) -> Result<ExitCode, Failure> {
    let with_window = !options.headless && Machine::this().has_display();

    // See to what the programs need.
    run::announce_first_build("release", "8 to 12 minutes")?;
    let mut needs = vec![Need::VulkanLoader, Need::VulkanDriver];
    if with_window {
        needs.push(Need::WindowLibraries);
    }
    system::provide(&needs, options.may_install)?;

    // Build the programs.
    let mut build = run::cargo();
    build.args(["build", "--release", "--package", "hlod-build", "--package", "hlod-render"]);
    run::run(build.args(["--features", "hlod-render/viewer"]))?;

    // Make the statue, unless an earlier demo did, and build its levels of detail.
    let folder = Path::new(FOLDER);
    fs::create_dir_all(run::root().join(folder))
        .map_err(|error| Failure::Work(format!("cannot create {FOLDER}: {error}")))?;
    let scan = folder.join(format!("statue-{}.ply", options.triangles));
    let model = folder.join(format!("statue-{}.hlod", options.triangles));
    if !run::root().join(&scan).exists() {
        let mut synth = run::program("hlod-build")?;
        synth.args(["synth", "statue", "--triangles", &options.triangles, "-o"]).arg(&scan);
        run::run(&mut synth)?;
    }
    let mut build = run::program("hlod-build")?;
    run::run(
        build.arg("build").arg(&scan).arg("-o").arg(&model).args(["--unit", "mm", "--force"]),
    )?;

    // Show it.
    if with_window {
        run::run(run::program("hlod-render")?.arg("view").arg(&model))?;
        println!("\nThe sample is {}, its levels of detail {}.", scan.display(), model.display());
        return Ok(ExitCode::SUCCESS);
    }
    let results = draw(&model)?;
    println!("\nWritten, without a window:");
    for path in [scan, model].iter().chain(&results) {
        println!("  {}", path.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// Draws pictures and runs a short benchmark without a window. Returns the files written.
fn draw(model: &Path) -> Result<Vec<PathBuf>, Failure> {
    let folder = Path::new(FOLDER);
    let mut written = Vec::new();
    for (name, arguments) in VIEWS {
        let picture = folder.join(format!("{name}.png"));
        let mut shot = run::program("hlod-render")?;
        shot.arg("shot").arg(model).arg("-o").arg(&picture).args(arguments);
        shot.args(["--size", "1000x1000", "--supersampling", "2"]);
        run::run(&mut shot)?;
        written.push(picture);
    }
    let plot = folder.join("orbit.svg");
    let mut bench = run::program("hlod-render")?;
    bench.arg("bench").arg(model).args(["--path", "bench-paths/orbit.json", "--plot"]).arg(&plot);
    run::run(&mut bench)?;
    written.push(plot);
    Ok(written)
}
