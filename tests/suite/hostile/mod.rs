//! Files made to break programs: what ends other viewers and converters in a crash or an endless
//! loop ends here in a message, through the programs themselves.

mod builds;
mod containers;
#[cfg(target_os = "linux")]
mod faults;
mod links;
mod pictures;
mod scans;
mod sessions;
