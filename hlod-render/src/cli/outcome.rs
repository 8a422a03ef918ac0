//! Exit codes and messages, decided in one place.

use hlod_render::RenderError;

/// Why a command did not succeed.
#[derive(Debug)]
pub enum Failure {
    /// The work failed: exit status 1.
    Work(String),
    /// The command line was wrong: exit status 2.
    Usage(String),
}

pub type Outcome = Result<(), Failure>;

impl From<RenderError> for Failure {
    fn from(error: RenderError) -> Failure {
        let message = error.to_string();
        if error.is_usage() { Failure::Usage(message) } else { Failure::Work(message) }
    }
}
