//! Progress on a terminal.

use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use hlod_build::progress::{Progress, Unit};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::args::ProgressArg;
use super::progress_lines::Lines;

/// One bar a stage on stderr, nothing where stderr is not a terminal; or lines for another program.
pub struct Bars {
    visible: bool,
    lines: Option<Lines>,
    stopped: Arc<AtomicBool>,
    current: Mutex<ProgressBar>,
}

impl Bars {
    pub fn new(quiet: bool, kind: ProgressArg) -> Bars {
        let lines = matches!(kind, ProgressArg::Json).then(Lines::default);
        Bars {
            visible: !quiet && lines.is_none(),
            lines: lines.filter(|_| !quiet),
            stopped: Arc::default(),
            current: Mutex::new(ProgressBar::hidden()),
        }
    }

    /// From now on Ctrl-C asks the work to stop where it can go on later; a second one ends it there
    /// and then.
    pub fn stop_on_interrupt(&self) -> Result<(), ctrlc::Error> {
        let stopped = self.stopped.clone();
        ctrlc::set_handler(move || {
            if stopped.swap(true, Ordering::Relaxed) {
                std::process::exit(130);
            }
            let _ = writeln!(std::io::stderr(), "stopping; once more to stop at once");
        })
    }

    fn bar(&self) -> ProgressBar {
        self.current.lock().map_or_else(|_| ProgressBar::hidden(), |bar| bar.clone())
    }
}

impl Progress for Bars {
    fn begin(&self, stage: &'static str, total: u64, unit: Unit) {
        if let Some(lines) = &self.lines {
            return lines.begin(stage, total, unit);
        }
        // indicatif hides itself where stderr is not a terminal, and obeys NO_COLOR.
        let target =
            if self.visible { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let counts = match unit {
            Unit::Bytes => "{bytes}/{total_bytes} {bytes_per_sec}",
            Unit::Triangles => "{human_pos}/{human_len} triangles {per_sec}",
            Unit::Points => "{human_pos}/{human_len} points {per_sec}",
            Unit::Nodes => "{human_pos}/{human_len} nodes {per_sec}",
            Unit::Steps => "{human_pos}/{human_len} steps",
        };
        let template = format!("{{msg:>10}} {{bar:32.cyan/dim}} {counts}  {{eta}} left");
        let style = ProgressStyle::with_template(&template)
            .unwrap_or_else(|_| ProgressStyle::default_bar());
        let bar = ProgressBar::with_draw_target(Some(total), target).with_style(style);
        bar.set_message(stage);
        bar.enable_steady_tick(Duration::from_millis(100));
        if let Ok(mut current) = self.current.lock() {
            *current = bar;
        }
    }

    fn advance(&self, count: u64) {
        match &self.lines {
            Some(lines) => lines.advance(count),
            None => self.bar().inc(count),
        }
    }

    fn end(&self) {
        match &self.lines {
            Some(lines) => lines.end(),
            None => self.bar().finish(),
        }
    }

    fn remark(&self, text: &str) {
        if let Some(lines) = &self.lines {
            lines.remark(text);
        }
        if self.visible {
            self.bar().suspend(|| {
                let _ = writeln!(std::io::stderr(), "{text}");
            });
        }
    }

    fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }
}
