//! The program as it is built without its window.

#![cfg(not(feature = "viewer"))]

use std::process::Command;

#[test]
fn who_asks_for_the_window_is_told_how_to_have_it() {
    let view = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hlod-render"));
        command.arg("view").args(arguments).output().expect("the program runs")
    };
    for arguments in [&[][..], &["statue.hlod", "--size", "800x600", "--", "-x"], &["--help"]] {
        let output = view(arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains("--features viewer"), "{arguments:?}: {said}");
    }
}
