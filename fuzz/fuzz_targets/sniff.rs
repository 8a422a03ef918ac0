//! `sniff` of `hlod_tests::fuzz`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    (hlod_tests::fuzz::target("sniff").run)(bytes);
});
