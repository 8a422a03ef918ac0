//! What systems do in their own ways: the one place of this crate that tells them apart.

use std::fs::File;
use std::io;

/// Processor time of all of this process' threads, in seconds; 0 where the system does not tell.
#[cfg(unix)]
pub(crate) fn cpu_secs() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

#[cfg(not(unix))]
pub(crate) fn cpu_secs() -> f64 {
    0.0
}

/// Gives memory that was freed back to the system: what allocations of many threads leave behind
/// would otherwise count against the next step.
pub(crate) fn give_back_memory() {
    // SAFETY: malloc_trim may be called at any time from any thread and takes no pointers.
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    unsafe {
        libc::malloc_trim(0);
    }
}

/// Temporary files are private; results are as readable as the user's other new files.
#[cfg(unix)]
pub(crate) fn set_usual_permissions(file: &File) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    let mask = rustix::process::umask(rustix::fs::Mode::empty());
    rustix::process::umask(mask);
    // 16 bits on macOS, 32 on Linux.
    #[allow(clippy::unnecessary_cast)]
    let mask = mask.bits() as u32;
    file.set_permissions(std::fs::Permissions::from_mode(0o666 & !mask))
}

#[cfg(not(unix))]
pub(crate) fn set_usual_permissions(_file: &File) -> io::Result<()> {
    Ok(())
}

/// The usual rights of a new file for a temporary one that will be renamed, not the narrow ones of temporary files.
#[cfg(unix)]
pub(crate) fn with_usual_rights(builder: &mut tempfile::Builder<'_, '_>) {
    use std::os::unix::fs::PermissionsExt;
    builder.permissions(std::fs::Permissions::from_mode(0o666));
}

#[cfg(not(unix))]
pub(crate) fn with_usual_rights(_builder: &mut tempfile::Builder<'_, '_>) {}
