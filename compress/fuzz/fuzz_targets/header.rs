//! Any bytes are a header or an error: as they are, and as the body behind a valid checksum.
#![no_main]

use hlod_compress::{FORMAT_VERSION, Header};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let _ = Header::parse(bytes);
    for version in 1..=FORMAT_VERSION {
        let _ = Header::parse(&Header::with_prefix(version, bytes));
    }
});
