//! What a build costs: time, processor time, memory.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use serde::Serialize;

use crate::system::cpu_secs;

/// Time and processor time of one stage.
#[derive(Debug, Clone, Serialize)]
pub struct StageCost {
    /// The stage's name, as in progress bars.
    pub name: &'static str,
    /// Wall-clock time.
    pub wall_secs: f64,
    /// Processor time of all threads.
    pub cpu_secs: f64,
    /// Largest anonymous memory seen during the stage.
    pub peak_anonymous_bytes: u64,
    /// Bytes read from files, cached or not; 0 where the system does not tell.
    pub bytes_read: u64,
    /// Bytes written to files.
    pub bytes_written: u64,
}

/// Measures from its creation on.
pub struct Meter {
    start: Instant,
    stage_start: (Instant, f64, [u64; 2]),
    /// The largest since the last stage ended.
    stage_peak: Arc<AtomicU64>,
    stages: Vec<StageCost>,
    peak_anonymous: Arc<AtomicU64>,
    stop: Arc<AtomicBool>,
}

impl Meter {
    /// Starts measuring, with a thread that watches anonymous memory every 20 ms.
    pub fn start() -> Meter {
        let peak_anonymous = Arc::new(AtomicU64::new(0));
        let stop = Arc::new(AtomicBool::new(false));
        let stage_peak = Arc::new(AtomicU64::new(0));
        let peaks = [peak_anonymous.clone(), stage_peak.clone()];
        let stopped = stop.clone();
        std::thread::spawn(move || {
            while !stopped.load(Ordering::Relaxed) {
                let now = status_bytes("RssAnon:");
                for peak in &peaks {
                    peak.fetch_max(now, Ordering::Relaxed);
                }
                std::thread::sleep(Duration::from_millis(20));
            }
        });
        let start = Instant::now();
        let stage_start = (start, cpu_secs(), transferred_bytes());
        Meter { start, stage_start, stage_peak, stages: Vec::new(), peak_anonymous, stop }
    }

    /// Books everything since the last call as `name`.
    pub fn finish_stage(&mut self, name: &'static str) {
        let now = (Instant::now(), cpu_secs(), transferred_bytes());
        let (wall, cpu, before) = std::mem::replace(&mut self.stage_start, now);
        let [bytes_read, bytes_written] = std::array::from_fn(|i| now.2[i] - before[i]);
        let at_end = status_bytes("RssAnon:");
        self.stages.push(StageCost {
            name,
            wall_secs: wall.elapsed().as_secs_f64(),
            cpu_secs: now.1 - cpu,
            peak_anonymous_bytes: self.stage_peak.swap(at_end, Ordering::Relaxed).max(at_end),
            bytes_read,
            bytes_written,
        });
    }

    /// Everything measured.
    pub fn finish(self) -> Costs {
        self.peak_anonymous.fetch_max(status_bytes("RssAnon:"), Ordering::Relaxed);
        Costs {
            wall_secs: self.start.elapsed().as_secs_f64(),
            cpu_secs: self.stages.iter().map(|s| s.cpu_secs).sum(),
            peak_rss_bytes: status_bytes("VmHWM:"),
            peak_anonymous_bytes: self.peak_anonymous.load(Ordering::Relaxed),
            stages: self.stages.clone(),
        }
    }
}

impl Drop for Meter {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

/// What a build cost.
#[derive(Debug, Clone, Serialize)]
pub struct Costs {
    /// Wall-clock time.
    pub wall_secs: f64,
    /// Processor time of all threads.
    pub cpu_secs: f64,
    /// Largest resident set of the process so far; 0 where the system does not tell.
    pub peak_rss_bytes: u64,
    /// Largest anonymous memory seen, sampled every 20 ms; 0 where the system does not tell.
    pub peak_anonymous_bytes: u64,
    /// The same for each stage.
    pub stages: Vec<StageCost>,
}

/// What the process has read and written so far; 0 where the system does not tell.
fn transferred_bytes() -> [u64; 2] {
    let text = std::fs::read_to_string("/proc/self/io").unwrap_or_default();
    ["rchar: ", "wchar: "].map(|field| {
        let line = text.lines().find_map(|line| line.strip_prefix(field));
        line.and_then(|value| value.parse().ok()).unwrap_or(0)
    })
}

/// A field of /proc/self/status in bytes; 0 where there is no such file.
fn status_bytes(field: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix(field));
    let kib = line.and_then(|rest| rest.split_whitespace().next()?.parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}
