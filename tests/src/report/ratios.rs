//! A few ratios that a change should not make worse: measured, kept, compared.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::error::ReportError;
use super::models::Stock;
use super::programs::{Line, Programs, text};
use super::turns::Turns;

/// Ratios of speeds; of each, more is better.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ratios {
    /// The adapter that drew.
    pub adapter: String,
    /// System and processors.
    pub machine: String,
    /// The programs' version.
    pub version: String,
    /// How this is measured.
    pub command: String,
    /// By name.
    pub ratios: BTreeMap<String, f64>,
}

/// Names, what is faster, what it is faster than: words after `bench FILE --path bench-paths/`.
const PAIRS: [(&str, &str, &str); 5] = [
    ("levels ÷ full resolution", "orbit.json", "orbit.json --representation full"),
    (
        "compute ÷ fixed function, τ = 0.25",
        "orbit.json --tau 0.25",
        "orbit.json --tau 0.25 --fixed-function",
    ),
    ("hard shadows ÷ none", "orbit.json --shadow hard", "orbit.json"),
    ("soft shadows ÷ none", "orbit.json --shadow soft", "orbit.json"),
    ("approach ÷ orbit", "approach.json", "orbit.json"),
];

/// Measures them with a sample statue of 900,000 triangles, which is kept in `folder`.
///
/// # Errors
/// As [`super::report`].
pub fn measure(
    programs: &Programs,
    folder: &Path,
    say: &mut dyn FnMut(&str),
) -> Result<Ratios, ReportError> {
    std::fs::create_dir_all(folder).map_err(ReportError::io(folder, "create"))?;
    let stock = Stock { programs, folder, data: None };
    let models = stock.models(&[], &["900K".to_owned()], say)?;
    let bench = |words: &str| {
        let line = Line::new("hlod-render").words("bench").with(&models[0].file);
        line.words("--path").words(&format!("bench-paths/{words} --frames 16"))
    };
    let mut ratios = BTreeMap::new();
    for (name, a, b) in PAIRS {
        say(name);
        let turns = Turns::take(programs, &[bench(a), bench(b)])?;
        ratios.insert(name.to_owned(), turns.ratio(0, 1));
    }
    let printed = programs.json(&bench("orbit.json"))?;
    Ok(Ratios {
        adapter: text(&printed, "adapter")?.to_owned(),
        machine: text(&printed, "machine")?.to_owned(),
        version: text(&printed, "version")?.to_owned(),
        command: "cargo xtask bench".to_owned(),
        ratios,
    })
}

impl Ratios {
    /// Reads a record.
    ///
    /// # Errors
    /// When it cannot be read or is none.
    pub fn read(path: &Path) -> Result<Ratios, ReportError> {
        let text = std::fs::read(path).map_err(ReportError::io(path, "read"))?;
        serde_json::from_slice(&text)
            .map_err(|error| ReportError::unexpected(path.display(), error))
    }

    /// Writes a record.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), ReportError> {
        let failed =
            |error: &dyn ToString| ReportError::unexpected(path.display(), error.to_string());
        let text = serde_json::to_string_pretty(self).map_err(|error| failed(&error))? + "\n";
        hlod_build::write_whole(path, text.as_bytes()).map_err(|error| failed(&error))
    }

    /// Names of what is worse than in `stored` by more than `margin`, a share, or is not there any more.
    pub fn worse_than(&self, stored: &Ratios, margin: f64) -> Vec<String> {
        let is_worse = |name: &String, before: f64| {
            // NaN is worse than anything.
            self.ratios.get(name).is_none_or(|now| now.is_nan() || *now < before * (1.0 - margin))
        };
        let worse = stored.ratios.iter().filter(|(name, before)| is_worse(name, **before));
        worse.map(|(name, _)| name.clone()).collect()
    }

    /// A table, with a stored record beside.
    pub fn table(&self, stored: Option<&Ratios>) -> String {
        let mut out = String::new();
        for (name, now) in &self.ratios {
            let before = stored.and_then(|stored| stored.ratios.get(name));
            let before = before.map_or(String::new(), |before| {
                format!("   stored {before:>7.3}   now ÷ stored {:>6.3}", now / before)
            });
            // Letters, not bytes: some are not ASCII.
            let pad = " ".repeat(38usize.saturating_sub(name.chars().count()));
            out += &format!("{name}{pad}{now:>7.3}{before}\n");
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ratios(pairs: &[(&str, f64)]) -> Ratios {
        Ratios {
            adapter: "a".into(),
            machine: "m".into(),
            version: "0".into(),
            command: "c".into(),
            ratios: pairs.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect(),
        }
    }

    #[test]
    fn what_is_worse_by_more_than_the_margin_is_named() {
        let stored = ratios(&[("x", 2.0), ("y", 1.0), ("z", 4.0)]);
        let now = ratios(&[("x", 1.85), ("y", 3.0), ("z", 3.0)]);
        assert_eq!(now.worse_than(&stored, 0.1), ["z"]);
        assert_eq!(now.worse_than(&stored, 0.05), ["x", "z"]);
        assert_eq!(ratios(&[("x", f64::NAN), ("y", 1.0)]).worse_than(&stored, 0.5), ["x", "z"]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.json");
        now.write(&path).unwrap();
        assert_eq!(Ratios::read(&path).unwrap(), now);
        assert!(now.table(Some(&stored)).contains("now ÷ stored  0.925"), "{}", now.table(None));
    }
}
