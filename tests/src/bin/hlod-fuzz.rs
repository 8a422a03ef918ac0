//! `hlod-fuzz [--seconds N | --executions N] [--seed N] [--corpus FOLDER] [TARGET…]`: what `cargo xtask fuzz` runs.
//!
//! Targets are run one after the other. An input on which one fails is written to `out/fuzz`; put into
//! `tests/fuzzing/found` it is tried by every `cargo test`. With `--corpus` nothing is run: what each would begin with is
//! written to a folder of its name, for libFuzzer.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use hlod_tests::fuzz::memory::Counting;
use hlod_tests::fuzz::{Campaign, Extent, TARGETS, Target};
use hlod_tests::workspace;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Of targets that decode in memory; of those that read files a tenth.
const EXECUTIONS: u64 = 10_000_000;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let (mut extent, mut seed, mut corpus, mut names) = (None, 1, None, Vec::new());
    while let Some(argument) = arguments.next() {
        let understood = match argument.as_str() {
            "--corpus" => arguments.next().map(|folder| corpus = Some(PathBuf::from(folder))),
            "--seconds" => {
                number(&mut arguments).map(|n| extent = Some(Extent::Time(Duration::from_secs(n))))
            }
            "--executions" => number(&mut arguments).map(|n| extent = Some(Extent::Executions(n))),
            "--seed" => number(&mut arguments).map(|n| seed = n),
            name if TARGETS.iter().any(|target| target.name == name) => {
                names.push(argument.clone());
                Some(())
            }
            _ => None,
        };
        if understood.is_none() {
            let targets = TARGETS.iter().map(|target| target.name).collect::<Vec<_>>().join(" ");
            eprintln!(
                "hlod-fuzz: what is {argument}? Options are --seconds N, --executions N, --seed N, --corpus FOLDER; targets {targets}"
            );
            return ExitCode::from(2);
        }
    }
    let chosen = |target: &&Target| names.is_empty() || names.iter().any(|n| n == target.name);
    if let Some(corpus) = corpus {
        for target in TARGETS.iter().filter(chosen) {
            let folder = corpus.join(target.name);
            match write_seeds(target, &folder) {
                Ok(count) => println!("{:16} {count:>4} inputs", target.name),
                Err(error) => {
                    eprintln!("hlod-fuzz: {}: {error}", folder.display());
                    return ExitCode::FAILURE;
                }
            }
        }
        return ExitCode::SUCCESS;
    }
    // What panics is caught and said.
    std::panic::set_hook(Box::new(|_| ()));
    let mut is_good = true;
    for target in TARGETS.iter().filter(chosen) {
        let usual = if target.is_decoder { EXECUTIONS } else { EXECUTIONS / 10 };
        is_good &= run(target, extent.unwrap_or(Extent::Executions(usual)), seed);
    }
    if is_good { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn number(arguments: &mut impl Iterator<Item = String>) -> Option<u64> {
    arguments.next().and_then(|text| text.parse().ok())
}

fn write_seeds(target: &Target, folder: &Path) -> std::io::Result<usize> {
    std::fs::create_dir_all(folder)?;
    let seeds = (target.seeds)();
    for (i, seed) in seeds.iter().enumerate() {
        std::fs::write(folder.join(format!("seed-{i}")), seed)?;
    }
    Ok(seeds.len())
}

/// Runs a target and prints a line; says whether nothing was found.
fn run(target: &'static Target, extent: Extent, seed: u64) -> bool {
    let folder = workspace().join("out/fuzz");
    let begin = Instant::now();
    let tally = Campaign::new(target, folder.clone(), seed).run(extent);
    println!(
        "{:16} {:>10} executions, {:>9} accepted, {:>6.0} s, longest {:>6.1} ms, most {:>4} MiB",
        target.name,
        tally.executions,
        tally.accepted,
        begin.elapsed().as_secs_f64(),
        tally.longest.as_secs_f64() * 1e3,
        tally.most_bytes >> 20
    );
    let Some(finding) = tally.finding else { return true };
    let path = folder.join(format!("{}-{:08x}", target.name, crc32fast::hash(&finding.bytes)));
    let kept =
        std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(&path, &finding.bytes));
    println!("  {}", finding.why);
    println!(
        "  its input: {} {}",
        path.display(),
        kept.err().map_or(String::new(), |e| e.to_string())
    );
    false
}
