//! `hlod-build`: see `hlod-build --help`.

mod cli;

use std::io::Write;
use std::process::ExitCode;

use clap::Parser;

use cli::{Failure, args::Cli, run};

fn main() -> ExitCode {
    let cli = Cli::parse();
    let (message, code) = match run(&cli) {
        Ok(()) => return ExitCode::SUCCESS,
        Err(Failure::Work(message)) => (Some(message), 1),
        Err(Failure::Usage(message)) => (Some(message), 2),
        Err(Failure::Refuted) => (None, 3),
    };
    if let Some(message) = message {
        // Where nobody can be told, the status still says it.
        let _ = writeln!(std::io::stderr(), "hlod-build: {message}");
    }
    ExitCode::from(code)
}
