//! The commands of this repository: `./x demo`, `./x test`, `./x bless`,
//! `./x scale`, `./x report`, `./x bench`, `./x pictures`, `./x fuzz`, `./x soak`,
//! `./x sanitize`.
//!
//! Depends on the standard library only, so that it compiles in seconds and can say what the
//! system lacks, and how long the rest takes, before anything heavy begins.

mod bless;
mod demo;
mod fuzz;
mod options;
mod report;
mod run;
mod sanitize;
mod scale;
mod soak;
mod system;
mod targets;
mod test;

use std::process::ExitCode;

use options::Command;

/// Also what `./x help` prints, without a compiler.
const USAGE: &str = include_str!("usage.txt");

/// Why a command ended early.
enum Failure {
    /// The command line makes no sense.
    Usage(String),
    /// Something is missing here and must not, or could not, be installed.
    Missing(String),
    /// Something was tried and did not work.
    Work(String),
}

fn main() -> ExitCode {
    let result = options::parse(std::env::args().skip(1)).and_then(|command| match command {
        Command::Help => {
            print!("{USAGE}");
            Ok(ExitCode::SUCCESS)
        }
        Command::Demo(options) => demo::demo(&options),
        Command::Test(options) => test::test(&options),
        Command::Bless { name } => bless::bless(&name),
        Command::Scale(options) => scale::scale(&options),
        Command::Report { arguments } => report::report("report", &arguments),
        Command::Bench { arguments } => report::report("bench", &arguments),
        Command::Pictures { arguments } => report::report("pictures", &arguments),
        Command::Targets => targets::targets(),
        Command::Fuzz { arguments } => fuzz::fuzz(&arguments),
        Command::Soak { arguments } => soak::soak(&arguments),
        Command::Sanitize { with_miri } => sanitize::sanitize(with_miri),
    });
    let (message, status) = match result {
        Ok(status) => return status,
        Err(Failure::Usage(message)) => (format!("{message}\n\n{USAGE}"), 2),
        Err(Failure::Missing(message)) => (message, 2),
        Err(Failure::Work(message)) => (message, 1),
    };
    eprintln!("{}", message.trim_end());
    ExitCode::from(status)
}
