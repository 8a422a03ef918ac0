//! Running one target on many inputs.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use super::memory::measured;
use super::mutate::Mutator;
use super::targets::Target;

/// A case that takes longer counts as one that hangs. On an idle machine each takes less than a tenth.
pub const PATIENCE: Duration = Duration::from_secs(10);

/// Inputs that were made and taken for good, from which others are made.
const ACCEPTED_MAX: usize = 64;

/// How long a campaign goes on.
#[derive(Debug, Clone, Copy)]
pub enum Extent {
    /// So many inputs.
    Executions(u64),
    /// So long.
    Time(Duration),
}

/// Many inputs for one target.
pub struct Campaign {
    target: &'static Target,
    /// Where an input that ends the whole process is kept, so that it is not lost.
    folder: PathBuf,
    seed: u64,
}

/// What a campaign came to.
#[derive(Debug, Clone, Default)]
pub struct Tally {
    /// Inputs tried.
    pub executions: u64,
    /// Of these, inputs that were taken for good.
    pub accepted: u64,
    /// The longest that one took.
    pub longest: Duration,
    /// The most memory that one held, in bytes; 0 where it is not counted.
    pub most_bytes: usize,
    /// The first input that failed.
    pub finding: Option<Finding>,
}

/// An input on which a target fails.
#[derive(Debug, Clone)]
pub struct Finding {
    /// The input.
    pub bytes: Vec<u8>,
    /// How it fails.
    pub why: String,
}

impl Campaign {
    /// A campaign of a target. The same seed makes the same inputs.
    pub fn new(target: &'static Target, folder: PathBuf, seed: u64) -> Campaign {
        Campaign { target, folder, seed }
    }

    /// Runs it until it is over or something fails.
    pub fn run(&self, extent: Extent) -> Tally {
        let mut seeds = (self.target.seeds)();
        assert!(!seeds.is_empty(), "{} has no seeds", self.target.name);
        let given = seeds.len();
        let mut mutator = Mutator::new(self.seed);
        let mut tally = Tally::default();
        let watch = Watch::start(self.target.name, self.folder.clone());
        let begin = Instant::now();
        loop {
            let is_over = match extent {
                Extent::Executions(count) => tally.executions >= count,
                Extent::Time(time) => begin.elapsed() >= time,
            };
            if is_over {
                return tally;
            }
            // First what they are as they are.
            let done = tally.executions as usize;
            let bytes = if done < given {
                seeds[done].clone()
            } else {
                let [one, other] = [(); 2].map(|()| mutator.below(seeds.len()));
                mutator.changed(&seeds[one], &seeds[other])
            };
            match self.try_one(&bytes, &watch, &mut tally) {
                Err(why) => {
                    tally.finding = Some(Finding { bytes, why });
                    return tally;
                }
                Ok(true) if done >= given && mutator.below(8) == 0 => {
                    if seeds.len() < given + ACCEPTED_MAX {
                        seeds.push(bytes);
                    } else {
                        let place = given + mutator.below(ACCEPTED_MAX);
                        seeds[place] = bytes;
                    }
                }
                Ok(_) => {}
            }
        }
    }

    /// Runs the target on one input; says whether it was accepted, or how it failed.
    ///
    /// # Errors
    /// When the target panics, takes longer than [`PATIENCE`], or more than
    /// [`Target::bytes_max`].
    pub fn check(&self, bytes: &[u8]) -> Result<bool, String> {
        let watch = Watch::start(self.target.name, self.folder.clone());
        self.try_one(bytes, &watch, &mut Tally::default())
    }

    fn try_one(&self, bytes: &[u8], watch: &Watch, tally: &mut Tally) -> Result<bool, String> {
        let begin = Instant::now();
        watch.begin(bytes);
        let run = || catch_unwind(AssertUnwindSafe(|| (self.target.run)(bytes)));
        let (result, most_bytes) = measured(run);
        watch.end();
        let took = begin.elapsed();
        tally.executions += 1;
        tally.longest = tally.longest.max(took);
        tally.most_bytes = tally.most_bytes.max(most_bytes);
        let accepted = result.map_err(|payload| {
            let text = payload.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| payload.downcast_ref::<&str>().copied());
            format!("it panics: {}", text.unwrap_or("without a text"))
        })?;
        tally.accepted += u64::from(accepted);
        if took > PATIENCE {
            return Err(format!("it takes {took:?}"));
        }
        if most_bytes > self.target.bytes_max {
            return Err(format!("it holds {} MiB", most_bytes >> 20));
        }
        Ok(accepted)
    }
}

/// Keeps the input of a case that does not end, and ends the process.
struct Watch {
    /// Milliseconds since the start, of the case under way; 0 between cases.
    since: Arc<AtomicU64>,
    bytes: Arc<Mutex<Vec<u8>>>,
    is_over: Arc<AtomicBool>,
    start: Instant,
}

impl Watch {
    fn start(name: &'static str, folder: PathBuf) -> Watch {
        let watch = Watch {
            since: Arc::default(),
            bytes: Arc::default(),
            is_over: Arc::default(),
            start: Instant::now(),
        };
        let (since, bytes) = (watch.since.clone(), watch.bytes.clone());
        let (is_over, start) = (watch.is_over.clone(), watch.start);
        std::thread::spawn(move || {
            while !is_over.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(500));
                let begun = since.load(Ordering::Relaxed);
                let now = start.elapsed().as_millis() as u64;
                if begun > 0 && now > begun + 6 * PATIENCE.as_millis() as u64 {
                    let path = folder.join(format!("{name}-hangs"));
                    let bytes = bytes.lock().map(|bytes| bytes.clone()).unwrap_or_default();
                    let kept = std::fs::create_dir_all(&folder)
                        .and_then(|()| std::fs::write(&path, bytes));
                    eprintln!("{name}: hangs; its input is in {}: {kept:?}", path.display());
                    std::process::abort();
                }
            }
        });
        watch
    }

    fn begin(&self, bytes: &[u8]) {
        if let Ok(mut kept) = self.bytes.lock() {
            kept.clear();
            kept.extend_from_slice(bytes);
        }
        self.since.store(self.start.elapsed().as_millis() as u64 + 1, Ordering::Relaxed);
    }

    fn end(&self) {
        self.since.store(0, Ordering::Relaxed);
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
    }
}
