//! What is linked in may be given away: every dependency's licence is one that `deny.toml` allows.

use std::collections::BTreeSet;
use std::process::Command;

use hlod_tests::workspace;
use serde_json::Value;
use spdx::{Expression, ParseMode};

/// The list in `deny.toml`.
fn allowed() -> BTreeSet<String> {
    let text = std::fs::read_to_string(workspace().join("deny.toml")).unwrap();
    let (_, rest) = text.split_once("allow = [").expect("a list of licences");
    let (list, _) = rest.split_once(']').expect("its end");
    list.split('"').skip(1).step_by(2).map(str::to_owned).collect()
}

/// Whether an expression leaves a choice that is allowed.
fn may_be_used(expression: &str, allowed: &BTreeSet<String>) -> bool {
    // Older manifests have `MIT/Apache-2.0`.
    Expression::parse_mode(expression, ParseMode::LAX)
        .is_ok_and(|e| e.evaluate(|needed| allowed.contains(&needed.to_string())))
}

#[test]
fn every_dependency_may_be_given_away() {
    let rustc = Command::new("rustc").arg("-vV").output().unwrap();
    let said = String::from_utf8(rustc.stdout).unwrap();
    let host = said.lines().find_map(|line| line.strip_prefix("host: ")).unwrap();
    // Of other systems not everything has been downloaded.
    let metadata = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--offline", "--locked", "--all-features"])
        .args(["--filter-platform", host])
        .current_dir(workspace())
        .output()
        .unwrap();
    assert!(metadata.status.success(), "{}", String::from_utf8_lossy(&metadata.stderr));
    let metadata: Value = serde_json::from_slice(&metadata.stdout).unwrap();
    let allowed = allowed();
    let mut refused = Vec::new();
    let packages = metadata["packages"].as_array().unwrap();
    for package in packages {
        let licence = package["license"].as_str().unwrap_or("none");
        if !may_be_used(licence, &allowed) {
            refused.push(format!("{}: {licence}", package["name"].as_str().unwrap_or("?")));
        }
    }
    assert!(refused.is_empty(), "not in deny.toml: {refused:?}");
    assert!(packages.len() > 100, "{} packages", packages.len());
}

#[test]
fn what_is_not_allowed_is_told() {
    let allowed = allowed();
    for good in ["MIT", "MIT/Apache-2.0", "GPL-3.0-only OR MIT", "(MIT OR GPL-2.0-only) AND ISC"] {
        assert!(may_be_used(good, &allowed), "{good}");
    }
    for bad in ["GPL-3.0-only", "MIT AND GPL-3.0-only", "none", "", "LGPL-2.1-or-later"] {
        assert!(!may_be_used(bad, &allowed), "{bad}");
    }
}
