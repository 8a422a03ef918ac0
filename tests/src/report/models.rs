//! What is measured: scans as far as they are there, and sample statues of growing size.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::error::ReportError;
use super::programs::{Line, Programs, number};

/// Scans below the folder of data.
const SCANS: [(&str, &str); 4] = [
    ("Bunny", "bunny/bun_zipper.ply"),
    ("Igea", "igea/igea_tristrips.ply"),
    ("Dragon, 2nd level", "dragon/dragon_vrip_res2.ply"),
    ("Happy Buddha", "happy_buddha/happy_buddha.ply"),
];

/// Key, in what is kept of a build's report, of the builder's checksum.
const BUILDER: &str = "builder_crc32";

/// Checksum of the builder that a record is of.
fn recorded_builder(record: &Path) -> Option<u32> {
    let record: Value = serde_json::from_slice(&std::fs::read(record).ok()?).ok()?;
    u32::try_from(record.get(BUILDER)?.as_u64()?).ok()
}

/// What upper levels are built of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Levels {
    Triangles,
    Hybrid,
    Points,
}

impl Levels {
    pub(super) fn name(self) -> &'static str {
        match self {
            Levels::Triangles => "triangles",
            Levels::Hybrid => "hybrid",
            Levels::Points => "points",
        }
    }
}

/// A scan or statue that is built.
#[derive(Debug, Clone)]
pub(super) struct Model {
    pub(super) name: String,
    /// What it was built from; a statue's is made again when it is needed.
    pub(super) scan: PathBuf,
    /// Built with levels of triangles, as without options.
    pub(super) file: PathBuf,
    pub(super) is_statue: bool,
    pub(super) triangles: f64,
    /// What the build reported.
    pub(super) build: Value,
    /// What `info` says.
    pub(super) info: Value,
}

/// Where models are kept, and how they come to be there.
pub(super) struct Stock<'a> {
    pub(super) programs: &'a Programs,
    /// For files.
    pub(super) folder: &'a Path,
    /// The folder of scans, if there is one.
    pub(super) data: Option<&'a Path>,
}

impl Stock<'_> {
    /// Scans that are there, then statues, built where they are not yet.
    pub(super) fn models(
        &self,
        scans: &[&str],
        statues: &[String],
        say: &mut dyn FnMut(&str),
    ) -> Result<Vec<Model>, ReportError> {
        let mut out = Vec::new();
        for (name, path) in SCANS.iter().filter(|(name, _)| scans.contains(name)) {
            let scan = self.data.map(|data| data.join(path)).filter(|scan| scan.exists());
            match scan {
                Some(scan) => out.push(self.built(name, scan, false, say)?),
                None => say(&format!("left out: {name}, whose scan is not there")),
            }
        }
        for size in statues {
            let scan = self.folder.join(format!("statue-{size}.ply"));
            out.push(self.built(&format!("statue, {size}"), scan, true, say)?);
        }
        Ok(out)
    }

    fn built(
        &self,
        name: &str,
        scan: PathBuf,
        is_statue: bool,
        say: &mut dyn FnMut(&str),
    ) -> Result<Model, ReportError> {
        let (file, build) = self.file(&scan, (name, is_statue), Levels::Triangles, say)?;
        let info = self.programs.json(&Line::new("hlod-build").words("info").with(&file))?;
        let triangles = number(&info, "triangles_input")?;
        Ok(Model { name: name.to_owned(), scan, file, is_statue, triangles, build, info })
    }

    /// The same model with other levels.
    pub(super) fn with_levels(
        &self,
        model: &Model,
        levels: Levels,
        say: &mut dyn FnMut(&str),
    ) -> Result<PathBuf, ReportError> {
        Ok(self.file(&model.scan, (&model.name, model.is_statue), levels, say)?.0)
    }

    /// The file, built unless it is there from an earlier run of the same builder.
    fn file(
        &self,
        scan: &Path,
        (name, is_statue): (&str, bool),
        levels: Levels,
        say: &mut dyn FnMut(&str),
    ) -> Result<(PathBuf, Value), ReportError> {
        let stem = scan.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let file = self.folder.join(format!("{stem}-{}.hlod", levels.name()));
        let record = self.folder.join(format!("{stem}-{}.build.json", levels.name()));
        let builder = self.programs.checksum("hlod-build")?;
        if !file.exists() || recorded_builder(&record) != Some(builder) {
            self.make_scan(scan, (name, is_statue), say)?;
            say(&format!("building {name}, levels of {}", levels.name()));
            let mut line =
                Line::new("hlod-build").words("build").with(scan).words("-o").with(&file);
            if is_statue {
                line = line.words("--unit mm");
            }
            let line = line.words("--force --representation").words(levels.name());
            let mut printed = self.programs.json(&line)?;
            printed[BUILDER] = builder.into();
            let text = format!("{printed:#}\n");
            std::fs::write(&record, text).map_err(ReportError::io(&record, "write"))?;
        }
        let text = std::fs::read(&record).map_err(ReportError::io(&record, "read"))?;
        let build = serde_json::from_slice(&text)
            .map_err(|error| ReportError::unexpected(record.display(), error))?;
        Ok((file, build))
    }

    /// Makes a statue's scan if it is not there.
    pub(super) fn make_scan(
        &self,
        scan: &Path,
        (name, is_statue): (&str, bool),
        say: &mut dyn FnMut(&str),
    ) -> Result<(), ReportError> {
        if scan.exists() || !is_statue {
            return Ok(());
        }
        say(&format!("making {name}"));
        let size = name.rsplit(' ').next().unwrap_or(name);
        let line = Line::new("hlod-build").words("synth statue --triangles").words(size);
        self.programs.json(&line.words("-o").with(scan)).map(drop)
    }

    /// Removes a statue's scan, which is large and can be made again.
    pub(super) fn forget_scan(&self, model: &Model) -> Result<(), ReportError> {
        if model.is_statue && model.scan.exists() {
            std::fs::remove_file(&model.scan).map_err(ReportError::io(&model.scan, "remove"))?;
        }
        Ok(())
    }
}
