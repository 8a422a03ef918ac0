//! Counting what passed, failed and was skipped.

use std::fmt;

/// What has been seen so far.
#[derive(Default)]
pub struct Tally {
    passed: u64,
    failed: u64,
    /// What was skipped and why.
    skips: Vec<String>,
    /// What failed, as far as it has a name.
    failures: Vec<String>,
}

impl Tally {
    /// Counts a check that passes or fails as a whole.
    pub fn check(&mut self, name: &str, good: bool) {
        if good {
            self.passed += 1;
        } else {
            self.failed += 1;
            self.failures.push(name.to_owned());
        }
    }

    /// Counts something that could not be run.
    pub fn skip(&mut self, reason: &str) {
        self.skips.push(reason.to_owned());
    }

    /// Counts a test that returned early, which the test harness took for passed.
    pub fn skip_counted_as_passed(&mut self, reason: &str) {
        self.passed = self.passed.saturating_sub(1);
        self.skip(reason);
    }

    /// Looks at a line of `cargo test` and counts, if it is one that tells something.
    pub fn observe(&mut self, line: &str) {
        if let Some((passed, failed)) = passed_and_failed(line) {
            self.passed += passed;
            self.failed += failed;
        } else if let Some((name, outcome)) = test_and_outcome(line) {
            // `FAILED`, `ignored` or `ignored, why`; `ok` needs no more words.
            if outcome == "FAILED" {
                self.failures.push(name.to_owned());
            } else if outcome.starts_with("ignored") {
                self.skip(&format!("{name}: {outcome}"));
            }
        }
    }

    pub fn failed(&self) -> u64 {
        self.failed
    }

    /// Whether nothing failed, and something ran at all: a filter that matches no test is
    /// a mistake.
    pub fn is_good(&self) -> bool {
        self.failed == 0 && self.passed > 0
    }

    /// Prints the names of what did not pass, then the counts on a line of their own.
    pub fn print(&self) {
        for (title, names) in [("Skipped:", &self.skips), ("Failed:", &self.failures)] {
            if !names.is_empty() {
                println!("\n{title}");
                names.iter().for_each(|name| println!("  {name}"));
            }
        }
        println!("\n{self}");
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let skipped = self.skips.len();
        write!(f, "{} passed, {} failed, {skipped} skipped", self.passed, self.failed)
    }
}

/// Reads `test result: ok. 12 passed; 0 failed; 1 ignored; …`, which ends each program's tests.
fn passed_and_failed(line: &str) -> Option<(u64, u64)> {
    let (_, counts) = line.strip_prefix("test result: ")?.split_once(". ")?;
    let count = |word: &str| {
        counts.split("; ").find_map(|part| part.strip_suffix(word)?.trim().parse().ok())
    };
    Some((count("passed")?, count("failed")?))
}

/// Reads `test name ... outcome`.
fn test_and_outcome(line: &str) -> Option<(&str, &str)> {
    line.strip_prefix("test ")?.rsplit_once(" ... ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_counted() {
        let mut tally = Tally::default();
        for line in "\
running 4 tests
test select::a_front_is_a_cut ... ok
test shadow::a_cube_has_one ... FAILED
test pages::ten_thousand ... ignored, takes an hour
test crates/x.rs - f (line 3) ... ok

---- shadow::a_cube_has_one stdout ----
test result: as a test might say
test result: FAILED. 2 passed; 1 failed; 1 ignored; 0 measured; 3 filtered out; finished in 0.01s
test result: ok. 40 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out; finished in 2.00s
"
        .lines()
        {
            tally.observe(line);
        }
        assert_eq!(tally.to_string(), "42 passed, 1 failed, 1 skipped");
        assert_eq!(tally.failures, ["shadow::a_cube_has_one"]);
        assert_eq!(tally.skips, ["pages::ten_thousand: ignored, takes an hour"]);
        assert!(!tally.is_good());
    }

    #[test]
    fn a_test_that_skips_itself_has_not_passed() {
        let mut tally = Tally::default();
        tally.observe("test result: ok. 3 passed; 0 failed; 0 ignored; 0 measured");
        tally.skip_counted_as_passed("window::opens: no Xvfb");
        tally.check("cargo fmt", true);
        tally.skip("Lints: no clippy");
        assert_eq!(tally.to_string(), "3 passed, 0 failed, 2 skipped");
        assert!(tally.is_good());
    }

    #[test]
    fn nothing_run_is_not_good() {
        assert!(!Tally::default().is_good());
    }
}
