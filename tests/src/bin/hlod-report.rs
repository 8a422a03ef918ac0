//! `hlod-report report [--quick] [--resume] [--data DIR] [--statue SIZE]... [--output DIR]`,
//! `hlod-report bench [--against FILE] [--margin PERCENT] [--record FILE]` and `hlod-report pictures`: what
//! `cargo xtask report`, `bench` and `pictures` run.
//!
//! Exit status: 0 good, 1 a ratio is worse than was kept, 2 nothing could be measured.

use std::path::PathBuf;
use std::process::ExitCode;

use hlod_tests::report::pictures::pictures;
use hlod_tests::report::ratios::{Ratios, measure};
use hlod_tests::report::{Programs, ReportOptions, enter_workspace, report};

/// Where models are kept from run to run, from the workspace's root.
const FOLDER: &str = "out/report";

fn main() -> ExitCode {
    match run() {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(why) => {
            eprintln!("hlod-report: {why}");
            ExitCode::from(2)
        }
    }
}

fn run() -> Result<bool, Box<dyn std::error::Error>> {
    enter_workspace()?;
    let mut arguments = std::env::args().skip(1);
    match arguments.next().as_deref() {
        Some("report") => run_report(arguments),
        Some("bench") => run_bench(arguments),
        Some("pictures") => run_pictures(arguments),
        _ => Err("report, bench or pictures?".into()),
    }
}

fn say(what: &str) {
    eprintln!("{what}");
}

fn run_report(
    mut arguments: impl Iterator<Item = String>,
) -> Result<bool, Box<dyn std::error::Error>> {
    let data = hlod_tests::workspace().join("../shared/data");
    let mut options = ReportOptions {
        quick: false,
        resume: false,
        data: data.exists().then_some(data),
        folder: PathBuf::from(FOLDER),
        statues: Vec::new(),
        output: PathBuf::from("bench-paths"),
    };
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or(format!("{argument} takes a value"));
        match argument.as_str() {
            "--quick" => options.quick = true,
            "--resume" => options.resume = true,
            "--data" => options.data = Some(value()?.into()),
            "--statue" => options.statues.push(value()?),
            "--output" => options.output = value()?.into(),
            _ => return Err(format!("report: {argument} is not known").into()),
        }
    }
    let path = report(&Programs::beside_this_one()?, &options, &mut say)?;
    println!("{}", path.display());
    Ok(true)
}

fn run_pictures(
    mut arguments: impl Iterator<Item = String>,
) -> Result<bool, Box<dyn std::error::Error>> {
    if let Some(argument) = arguments.next() {
        return Err(format!("pictures: {argument} is not known").into());
    }
    let readme = hlod_tests::workspace().join("README.md");
    pictures(&Programs::beside_this_one()?, FOLDER.as_ref(), None, &readme, &mut say)?;
    Ok(true)
}

fn run_bench(
    mut arguments: impl Iterator<Item = String>,
) -> Result<bool, Box<dyn std::error::Error>> {
    let (mut against, mut record, mut margin) = (None, None, 0.2);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or(format!("{argument} takes a value"));
        match argument.as_str() {
            "--against" => against = Some(PathBuf::from(value()?)),
            "--record" => record = Some(PathBuf::from(value()?)),
            "--margin" => margin = value()?.parse::<f64>()? / 100.0,
            _ => return Err(format!("bench: {argument} is not known").into()),
        }
    }
    // Before minutes of work.
    let stored = against.as_deref().map(Ratios::read).transpose()?;
    let now = measure(&Programs::beside_this_one()?, FOLDER.as_ref(), &mut say)?;
    print!("{} · {}\n{}", now.adapter, now.machine, now.table(stored.as_ref()));
    if let Some(record) = record {
        now.write(&record)?;
    }
    let worse = stored.map_or(Vec::new(), |stored| now.worse_than(&stored, margin));
    for name in &worse {
        println!("worse by more than {:.0} %: {name}", margin * 100.0);
    }
    Ok(worse.is_empty())
}
