//! Programs that must come to an end.

use std::io::{Read, Seek};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A program takes no longer over a small hostile file. On an idle machine it is 2 s; machines that
/// are busy get ten times as long before it counts as one that hangs.
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
}

impl Ended {
    /// Why this is no orderly end at all, whatever came of it.
    pub fn disorder(&self) -> Option<String> {
        let is_orderly = matches!(self.status, Some(0..=3)) && !self.said.contains("panicked");
        (!is_orderly).then(|| format!("{:?}: {}", self.status, self.said.trim()))
    }

    /// Why this is not the orderly refusal that hostile input must meet: status 1, 2 or 3, with a
    /// message and without a panic.
    pub fn objection(&self) -> Option<String> {
        let why = match self.status {
            None => "a signal ended it",
            Some(1..=3) if self.said.contains("panicked") => "it panicked",
            Some(1..=3) if self.said.trim().is_empty() && self.told.trim().is_empty() => {
                "it said nothing"
            }
            Some(1..=3) => return None,
            Some(0) => "it took the file for good",
            Some(_) => "its status means nothing",
        };
        Some(format!("{why} ({:?}): {}", self.status, self.said.trim()))
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
    let status = loop {
        if let Some(status) = child.try_wait().expect("a child can be waited for") {
            break status;
        }
        if begin.elapsed() > PATIENCE {
            let _ = child.kill();
            let _ = child.wait();
            let said = "it hangs".to_owned();
            return Ended { status: None, said, told: String::new(), took: begin.elapsed() };
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    let took = begin.elapsed();
    let [told, said] = files.map(|mut file| {
        let mut bytes = Vec::new();
        file.rewind().and_then(|()| file.read_to_end(&mut bytes)).expect("messages are read back");
        String::from_utf8_lossy(&bytes).into_owned()
    });
    Ended { status: status.code(), said, told, took }
}
