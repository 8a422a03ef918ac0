//! Any bytes are a skeleton block or an error, whose checksum is right.
#![no_main]

use hlod_compress::{BlockRef, SkeletonBlock};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let crc32 = crc32fast::hash(bytes);
    let block = BlockRef { offset: 0, block_bytes: bytes.len() as u32, crc32 };
    if let Ok(block) = SkeletonBlock::parse(bytes, block) {
        block.validate().expect("what was parsed is valid");
    }
});
