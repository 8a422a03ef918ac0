//! `hlod-render`: see `hlod-render --help`.

mod cli;

use std::io::Write;
use std::process::ExitCode;

use clap::Parser;

use cli::{Failure, args::Cli, run};

fn main() -> ExitCode {
    let cli = Cli::parse();
    let (message, code) = match run(&cli) {
        Ok(()) => return ExitCode::SUCCESS,
        Err(Failure::Work(message)) => (message, 1),
        Err(Failure::Usage(message)) => (message, 2),
    };
    // Where nobody can be told, the status still says it.
    let _ = writeln!(std::io::stderr(), "hlod-render: {message}");
    ExitCode::from(code)
}
