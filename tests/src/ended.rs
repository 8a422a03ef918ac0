//! Programs that must come to an end.

use std::io::{Read, Seek};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// What a program may take of the processor to refuse a small hostile file, by all of its threads.
pub const REFUSAL_MAX: Duration = Duration::from_secs(2);

/// After this a program counts as one that hangs, on however busy a machine.
pub const PATIENCE: Duration = Duration::from_secs(20);

/// How a program ended.
#[derive(Debug)]
pub struct Ended {
    /// Its exit status; none where a signal ended it.
    pub status: Option<i32>,
    /// What it said on standard error.
    pub said: String,
    /// What it said on standard output.
    pub told: String,
    /// How long it took.
    pub took: Duration,
    /// What it took of the processor; none where the system does not tell.
    pub worked: Option<Duration>,
}

impl Ended {
    /// Why this is no orderly end at all, whatever came of it.
    pub fn disorder(&self) -> Option<String> {
        let is_orderly = matches!(self.status, Some(0..=3)) && !self.said.contains("panicked");
        (!is_orderly).then(|| format!("{:?}: {}", self.status, self.said.trim()))
    }

    /// Why this is not the orderly refusal that hostile input must meet: status 1, 2 or 3, with a
    /// message and without a panic, within [`REFUSAL_MAX`].
    pub fn objection(&self) -> Option<String> {
        let why = match self.status {
            _ if self.worked.is_some_and(|worked| worked > REFUSAL_MAX) => "it took its time",
            None => "a signal ended it",
            Some(1..=3) if self.said.contains("panicked") => "it panicked",
            Some(1..=3) if self.said.trim().is_empty() && self.told.trim().is_empty() => {
                "it said nothing"
            }
            Some(1..=3) => return None,
            Some(0) => "it took the file for good",
            Some(_) => "its status means nothing",
        };
        Some(format!("{why} ({:?}, {:?}): {}", self.status, self.worked, self.said.trim()))
    }
}

/// Runs a program to its end, or kills it after [`PATIENCE`], which is then what it said.
///
/// # Panics
/// When it cannot be started.
pub fn ended(command: &mut Command) -> Ended {
    // Files instead of pipes, which a program that says much would wait for.
    let files = [(); 2].map(|()| tempfile::tempfile().expect("there is room for messages"));
    let [out, err] = files.each_ref().map(|f| Stdio::from(f.try_clone().expect("a second handle")));
    let begin = Instant::now();
    let mut child =
        command.stdin(Stdio::null()).stdout(out).stderr(err).spawn().expect("a program starts");
    let mut worked = None;
    let status = loop {
        worked = worked.max(processor_time(child.id()));
        if let Some(status) = child.try_wait().expect("a child can be waited for") {
            break status;
        }
        if begin.elapsed() > PATIENCE {
            let _ = child.kill();
            let _ = child.wait();
            let said = "it hangs".to_owned();
            return Ended {
                status: None,
                said,
                told: String::new(),
                took: begin.elapsed(),
                worked,
            };
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    let took = begin.elapsed();
    let [told, said] = files.map(|mut file| {
        let mut bytes = Vec::new();
        file.rewind().and_then(|()| file.read_to_end(&mut bytes)).expect("messages are read back");
        String::from_utf8_lossy(&bytes).into_owned()
    });
    Ended { status: status.code(), said, told, took, worked }
}

/// What a running process has taken of the processor so far, by Linux's `/proc/PID/stat` (proc(5), fields 14 and
/// 15).
fn processor_time(process: u32) -> Option<Duration> {
    /// Ticks a second in what Linux tells programs, whatever it counts itself.
    const USER_HZ: u64 = 100;
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // The name before may have anything in it.
    let (_, rest) = stat.rsplit_once(')')?;
    let ticks: u64 =
        rest.split_whitespace().skip(11).take(2).map(|n| n.parse::<u64>().unwrap_or(0)).sum();
    Some(Duration::from_millis(1000 / USER_HZ * ticks))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_of_the_processor_is_told_from_waiting() {
        if !cfg!(target_os = "linux") {
            eprintln!("skipped: this system does not tell");
            return;
        }
        let shell = |script: &str| ended(Command::new("sh").args(["-c", script]));
        let slept = shell("sleep 0.5; echo no >&2; exit 2");
        assert!(slept.worked < Some(Duration::from_millis(200)), "{slept:?}");
        assert_eq!(slept.objection(), None);
        // The built-in loop of a shell; not a child's work.
        let busy = shell("i=0; while [ $i -lt 300000 ]; do i=$((i+1)); done; echo no >&2; exit 2");
        assert!(busy.worked > Some(Duration::from_millis(100)), "{busy:?}");
        let slow = Ended { worked: Some(REFUSAL_MAX + Duration::from_millis(10)), ..slept };
        assert!(slow.objection().is_some_and(|why| why.contains("took its time")));
    }
}
