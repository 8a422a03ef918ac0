//! Building a scan by the program that stands beside this one.

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::sync::{Arc, mpsc};

use hlod_compress::{SignedAxis, Unit};
use serde::Deserialize;

use crate::error::RenderError;
use crate::system::interrupt;

/// Longer lines are cut: they are remarks, not progress.
const LINE_BYTES_MAX: u64 = 4096;
/// Only the last words of a program that failed are kept.
const WORDS_MAX: usize = 12;

/// What is to be built.
#[derive(Debug, Clone, PartialEq)]
pub struct Order {
    /// The scan.
    pub scan: PathBuf,
    /// The file to write, which must not be there.
    pub output: PathBuf,
    /// Of the scan's coordinates.
    pub unit: Unit,
    /// Which way is up.
    pub up: SignedAxis,
    /// Which way the statue faces.
    pub front: SignedAxis,
}

impl Order {
    /// For a scan whose writer said nothing: beside it.
    pub fn new(scan: PathBuf) -> Order {
        let output = scan.with_extension("hlod");
        let (up, front) = (SignedAxis::PLUS_Y, SignedAxis::PLUS_Z);
        Order { scan, output, unit: Unit::Unknown, up, front }
    }

    /// Why it cannot be carried out, if that is known before.
    pub fn problem(&self) -> Option<String> {
        let name = |path: &Path| path.file_name().unwrap_or_default().display().to_string();
        if self.output.exists() {
            return Some(format!("{} is there already", name(&self.output)));
        }
        (self.up.axis == self.front.axis)
            .then(|| format!("up {} and front {} lie along one axis", self.up, self.front))
    }

    fn arguments(&self) -> Vec<std::ffi::OsString> {
        let mut out: Vec<std::ffi::OsString> = vec!["build".into(), "--progress=json".into()];
        out.push(format!("--unit={}", self.unit.name()).into());
        out.push(format!("--up={}", self.up).into());
        out.push(format!("--front={}", self.front).into());
        out.push("--output".into());
        out.push(self.output.clone().into());
        // Names may begin with a dash.
        out.push("--".into());
        out.push(self.scan.clone().into());
        out
    }
}

/// Where a build is.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Reached {
    /// The stage's name.
    pub stage: String,
    /// What it counts.
    pub unit: String,
    /// Of them.
    pub done: u64,
    /// In this stage.
    pub total: u64,
}

/// A line that the program wrote.
#[derive(Deserialize)]
#[serde(untagged)]
enum Line {
    At { stage: String, unit: String, done: u64, total: u64 },
    Remark { remark: String },
}

/// What came of a build.
#[derive(Debug)]
pub enum Outcome {
    /// The file is there.
    Built(PathBuf),
    /// It was asked to stop.
    Stopped,
    /// It did not succeed, and said this.
    Failed(String),
}

/// A build under way.
pub struct Build {
    /// What was asked for.
    pub order: Order,
    /// Where it is.
    pub reached: Reached,
    child: Child,
    lines: mpsc::Receiver<String>,
    words: Vec<String>,
    is_stopping: bool,
}

impl Build {
    /// Starts `command`, the program that builds, with an order; `wake` is called whenever it has said
    /// something.
    ///
    /// # Errors
    /// When it is not there.
    pub fn start(
        order: Order,
        mut command: Command,
        wake: Arc<dyn Fn() + Send + Sync>,
    ) -> Result<Build, RenderError> {
        command.args(order.arguments()).stdin(Stdio::null()).stdout(Stdio::null());
        let mut child = command.stderr(Stdio::piped()).spawn().map_err(|error| {
            let program = command.get_program().display();
            RenderError::Usage(format!(
                "cannot start {program} ({error}): it belongs beside hlod-render"
            ))
        })?;
        let (said, lines) = mpsc::channel();
        if let Some(stderr) = child.stderr.take() {
            std::thread::spawn(move || listen(stderr, &said, &*wake));
        }
        let reached = Reached { stage: "starting".into(), ..Reached::default() };
        Ok(Build { order, reached, child, lines, words: Vec::new(), is_stopping: false })
    }

    /// Takes in what it has said; the outcome when it has ended.
    pub fn advance(&mut self) -> Option<Outcome> {
        loop {
            match self.lines.try_recv() {
                Ok(line) => self.take(line),
                Err(mpsc::TryRecvError::Empty) => return None,
                // It has closed its stderr, and so has ended or is about to.
                Err(mpsc::TryRecvError::Disconnected) => break,
            }
        }
        let status = match self.child.wait() {
            Ok(status) => status,
            Err(error) => return Some(Outcome::Failed(error.to_string())),
        };
        Some(if status.success() {
            Outcome::Built(self.order.output.clone())
        } else if self.is_stopping {
            Outcome::Stopped
        } else if self.words.is_empty() {
            Outcome::Failed(format!("hlod-build ended with {status}"))
        } else {
            Outcome::Failed(self.words.join("\n"))
        })
    }

    fn take(&mut self, line: String) {
        match serde_json::from_str(&line) {
            Ok(Line::At { stage, unit, done, total }) => {
                self.reached = Reached { stage, unit, done, total };
            }
            Ok(Line::Remark { remark }) => self.say(remark),
            Err(_) => self.say(line),
        }
    }

    fn say(&mut self, words: String) {
        if self.words.len() == WORDS_MAX {
            self.words.remove(0);
        }
        self.words.push(words);
    }

    /// What it remarked last.
    pub fn remark(&self) -> Option<&str> {
        self.words.last().map(String::as_str)
    }

    /// Whether it was asked to stop.
    pub fn is_stopping(&self) -> bool {
        self.is_stopping
    }

    /// Asks it to stop where it can go on later, as Ctrl-C does.
    pub fn stop(&mut self) {
        self.is_stopping = true;
        interrupt(&mut self.child);
    }
}

impl Drop for Build {
    fn drop(&mut self) {
        // Nobody sees what becomes of it: it stops where it can go on, and leaves no file.
        if matches!(self.child.try_wait(), Ok(None)) {
            interrupt(&mut self.child);
        }
    }
}

fn listen(stderr: ChildStderr, said: &mpsc::Sender<String>, wake: &dyn Fn()) {
    let mut reader = BufReader::new(stderr);
    loop {
        let mut line = Vec::new();
        match reader.by_ref().take(LINE_BYTES_MAX).read_until(b'\n', &mut line) {
            Ok(0) | Err(_) => break,
            Ok(_) => {}
        }
        let line = String::from_utf8_lossy(&line).trim_end().to_owned();
        if !line.is_empty() && said.send(line).is_err() {
            return;
        }
        wake();
    }
    // The window learns of the end by the channel's.
}

/// The program that builds: beside this one, or where the system looks for programs.
pub fn builder() -> Command {
    let name = format!("hlod-build{}", std::env::consts::EXE_SUFFIX);
    let beside = std::env::current_exe().ok().map(|exe| exe.with_file_name(&name));
    Command::new(beside.filter(|path| path.is_file()).unwrap_or_else(|| name.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_refused_before_they_are_given() {
        let folder = tempfile::tempdir().unwrap();
        let mut order = Order::new(folder.path().join("-statue.ply"));
        assert_eq!(order.output, folder.path().join("-statue.hlod"));
        assert_eq!(order.problem(), None);
        let last = order.arguments();
        assert_eq!(last[last.len() - 2..], ["--".into(), order.scan.clone().into_os_string()]);
        order.front = "-y".parse().unwrap();
        assert!(order.problem().unwrap().contains("one axis"));
        order.front = SignedAxis::PLUS_Z;
        std::fs::write(&order.output, "").unwrap();
        assert!(order.problem().unwrap().contains("there already"));
    }

    #[cfg(unix)]
    fn run(script: &str) -> (Build, Outcome) {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        let order = Order::new("/nowhere/a.ply".into());
        let mut build = Build::start(order, command, Arc::new(|| {})).unwrap();
        if script.contains("sleep") {
            build.stop();
        }
        loop {
            if let Some(outcome) = build.advance() {
                return (build, outcome);
            }
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
    }

    #[test]
    #[cfg(unix)]
    fn what_the_program_says_is_taken_in() {
        let line = r#"{"stage":"simplify","unit":"triangles","done":7,"total":9}"#;
        let (build, outcome) =
            run(&format!("echo '{line}' >&2; echo '{{\"remark\":\"two bodies\"}}' >&2"));
        let reached =
            Reached { stage: "simplify".into(), unit: "triangles".into(), done: 7, total: 9 };
        assert_eq!(build.reached, reached);
        assert_eq!(build.remark(), Some("two bodies"));
        assert!(matches!(outcome, Outcome::Built(path) if path == build.order.output));
        let (_, outcome) = run("echo 'hlod-build: no vertices' >&2; exit 1");
        assert!(matches!(outcome, Outcome::Failed(why) if why == "hlod-build: no vertices"));
        let (_, outcome) = run("exec sleep 60");
        assert!(matches!(outcome, Outcome::Stopped));
    }

    #[test]
    fn a_program_that_is_not_there_is_named() {
        let order = Order::new("a.ply".into());
        let Err(error) = Build::start(order, Command::new("/nowhere/hlod-build"), Arc::new(|| {}))
        else {
            panic!("started");
        };
        assert!(error.to_string().contains("/nowhere/hlod-build"), "{error}");
    }
}
