//! `hlod-soak [--frames N] [--cache MIB] [--seed N] [FILE]`: what `cargo xtask soak` runs. Without a file
//! it makes a sample statue of 300,000 triangles.
//!
//! Exit status: 0 where the process' memory, a software rasteriser's in it, stayed within 2 % after the second
//! tenth of the frames, descriptors and threads did not become more, and nothing went wrong; 1 otherwise.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use hlod_build::synth::{StatueOptions, write_statue};
use hlod_render::{AdapterChoice, Gpu};
use hlod_tests::fuzz::memory::Counting;
use hlod_tests::soak::{SoakOptions, soak};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// What memory may grow by.
const GROWTH_MAX: f64 = 0.02;

fn main() -> ExitCode {
    match run() {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(why) => {
            eprintln!("hlod-soak: {why}");
            ExitCode::from(2)
        }
    }
}

fn run() -> Result<bool, String> {
    let mut options = SoakOptions {
        frames: 36_000,
        size: (320, 200),
        cache_bytes: 16 << 20,
        frames_a_model: 3_000,
        warm_up_places: 60,
        seed: 1,
    };
    let mut file = None;
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut number = || {
            let text = arguments.next().and_then(|text| text.parse::<u32>().ok());
            text.filter(|n| *n > 0).ok_or_else(|| format!("{argument} takes a number above 0"))
        };
        match argument.as_str() {
            "--frames" => options.frames = number()?,
            "--cache" => options.cache_bytes = u64::from(number()?) << 20,
            "--seed" => options.seed = number()?.into(),
            name if !name.starts_with('-') => file = Some(PathBuf::from(name)),
            _ => return Err("options are --frames N, --cache MIB, --seed N; then a file".into()),
        }
    }
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let file = match file {
        Some(file) => file,
        None => {
            let [scan, file] = ["statue.ply", "statue.hlod"].map(|name| folder.path().join(name));
            let statue = StatueOptions { triangles: 300_000, seed: 1 };
            write_statue(&statue, &scan, false, &mut |_, _| ()).map_err(|e| e.to_string())?;
            hlod_tests::built(&scan, &file, |o| o.leaf_triangles = 4_000);
            file
        }
    };
    let gpu = Gpu::headless(AdapterChoice::Best).map_err(|error| error.to_string())?;
    println!("{} frames of {} by {}", options.frames, file.display(), gpu.describe());
    let begin = Instant::now();
    let mut say = |frame: u32, bytes: Option<u64>| {
        let mib = bytes.map_or("?".into(), |bytes| format!("{:.1}", bytes as f64 / 1048576.0));
        println!("{frame:>7} frames, {:>5.0} s, {mib} MiB", begin.elapsed().as_secs_f64());
    };
    let report = soak(&gpu, &file, &options, &mut say).map_err(|error| error.to_string())?;
    let tenths = |bytes: &[f64]| {
        let mib: Vec<String> = bytes.iter().map(|b| format!("{:.1}", b / 1048576.0)).collect();
        mib.join(" ")
    };
    println!("resident MiB: {}", tenths(&report.resident_bytes));
    println!("held MiB: {}", tenths(&report.held_bytes));
    println!(
        "descriptors {:?}, threads {:?}, {} bytes read, {} nodes drawn, problems {:?}",
        report.descriptors, report.threads, report.bytes_read, report.nodes, report.problems
    );
    let percent = |growth: Option<f64>| 100.0 * growth.unwrap_or(f64::NAN);
    println!("resident memory grew by {:.2} %", percent(report.resident_growth()));
    println!("what the program holds grew by {:.2} %", percent(report.held_growth()));
    Ok(report.problems.is_empty()
        && report.resident_growth().is_none_or(|growth| growth < GROWTH_MAX)
        && report.descriptors[1] <= report.descriptors[0]
        && report.threads[1] <= report.threads[0])
}
