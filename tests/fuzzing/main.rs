//! A short run of every fuzz target with fixed seeds, and every input that ever made one fail.
//!
//! `cargo xtask fuzz` runs them for longer. A case may take 10 s and 1 GiB; each takes milliseconds.

use std::path::PathBuf;

use hlod_tests::fuzz::memory::{CEILING_BYTES, Counting};
use hlod_tests::fuzz::{Campaign, Extent, Mutator, TARGETS, Target, target};
use hlod_tests::workspace;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// One test, so that nothing else takes memory meanwhile.
#[test]
fn no_input_breaks_a_reader() {
    every_input_that_broke_one();
    short_runs();
    failures_are_noticed();
}

fn campaign(target: &'static Target, seed: u64) -> Campaign {
    Campaign::new(target, PathBuf::from(env!("CARGO_TARGET_TMPDIR")), seed)
}

fn short_runs() {
    for target in &TARGETS {
        let executions = if target.is_decoder { 4_000 } else { 1_000 };
        let tally = campaign(target, 2004).run(Extent::Executions(executions));
        if let Some(finding) = tally.finding {
            panic!("{}: {}\n{:?}", target.name, finding.why, finding.bytes);
        }
        // Seeds are good, and not everything made of them is.
        let seeds = (target.seeds)();
        let refused = seeds.iter().position(|seed| !(target.run)(seed));
        let is_alone = ["sniff", "project"].contains(&target.name);
        assert!(refused.is_none() || is_alone, "{}: seed {refused:?} is refused", target.name);
        assert!(tally.accepted < tally.executions, "{} takes everything", target.name);
    }
}

/// Files of `found` are named `TARGET--WHAT`.
fn every_input_that_broke_one() {
    let folder = workspace().join("tests/fuzzing/found");
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let Some((of, what)) = name.split_once("--") else { continue };
        let bytes = std::fs::read(&path).unwrap();
        if let Err(why) = campaign(target(of), 1).check(&bytes) {
            panic!("{of}, {what}: {why}");
        }
    }
}

/// What a failure looks like: a panic, and memory beyond the ceiling.
fn failures_are_noticed() {
    static PANICS: Target = Target {
        name: "panics",
        run: |bytes| {
            assert!(!bytes.contains(&b'x'), "an x");
            true
        },
        seeds: || vec![b"abc w".to_vec()],
        is_decoder: true,
        bytes_max: CEILING_BYTES,
    };
    static TAKES: Target = Target {
        name: "takes",
        run: |bytes| std::hint::black_box(vec![1u8; bytes.len() << 28]).len() > 1,
        seeds: || vec![vec![0; 8]],
        is_decoder: true,
        bytes_max: CEILING_BYTES,
    };
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| ()));
    let found = campaign(&PANICS, 1).run(Extent::Executions(100_000)).finding.unwrap();
    std::panic::set_hook(hook);
    assert!(found.why.contains("an x") && found.bytes.contains(&b'x'), "{found:?}");
    let found = campaign(&TAKES, 1).run(Extent::Executions(1)).finding.unwrap();
    assert!(found.why.contains("2048 MiB"), "{found:?}");
    // The same seed makes the same inputs, another one others.
    let made = |seed| {
        let mut mutator = Mutator::new(seed);
        (0..50).map(|_| mutator.changed(b"element vertex 12", b"other")).collect::<Vec<_>>()
    };
    assert!(made(1) == made(1) && made(1) != made(2));
}
