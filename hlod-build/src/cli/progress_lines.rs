//! Progress for programs that start this one.

use std::io::Write;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use hlod_build::progress::Unit;
use serde::Serialize;

/// Lines are no closer together than this, but for the first and the last of a stage.
const INTERVAL: Duration = Duration::from_millis(100);

/// A line of JSON on stderr for each step of the way.
#[derive(Default)]
pub struct Lines(Mutex<Option<Told>>);

/// The stage under way, and what was told of it.
struct Told {
    stage: &'static str,
    unit: Unit,
    done: u64,
    total: u64,
    when: Instant,
}

#[derive(Serialize)]
#[serde(untagged)]
enum Line<'a> {
    At { stage: &'a str, unit: &'a str, done: u64, total: u64 },
    Remark { remark: &'a str },
}

impl Lines {
    pub fn begin(&self, stage: &'static str, total: u64, unit: Unit) {
        let told = Told { stage, unit, done: 0, total, when: Instant::now() };
        told.print();
        if let Ok(mut current) = self.0.lock() {
            *current = Some(told);
        }
    }

    pub fn advance(&self, count: u64) {
        let Ok(mut current) = self.0.lock() else { return };
        let Some(told) = current.as_mut() else { return };
        told.done += count;
        if told.when.elapsed() >= INTERVAL {
            told.when = Instant::now();
            told.print();
        }
    }

    pub fn end(&self) {
        let Ok(mut current) = self.0.lock() else { return };
        if let Some(mut told) = current.take() {
            // Totals of bytes are estimates where files are compressed.
            told.done = told.total;
            told.print();
        }
    }

    pub fn remark(&self, text: &str) {
        print(&Line::Remark { remark: text });
    }
}

impl Told {
    fn print(&self) {
        let unit = match self.unit {
            Unit::Bytes => "bytes",
            Unit::Triangles => "triangles",
            Unit::Points => "points",
            Unit::Nodes => "nodes",
            Unit::Steps => "steps",
        };
        print(&Line::At { stage: self.stage, unit, done: self.done, total: self.total });
    }
}

fn print(line: &Line<'_>) {
    let Ok(mut text) = serde_json::to_vec(line) else { return };
    text.push(b'\n');
    // Who asked for it has gone: the work is done nevertheless.
    let _ = std::io::stderr().write_all(&text);
}
