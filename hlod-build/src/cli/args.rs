//! The command line as typed, and as validated options.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use hlod_build::{BuildOptions, KeptScalar, Selection};
use hlod_compress::{Primitives, RepresentationKind, SignedAxis, Unit};
use hlod_scan::{ColourSource, Transform};

/// Turn a scan into one .hlod file: an octree of levels of detail with known error.
#[derive(Parser)]
#[command(name = "hlod-build", version, max_term_width = 100)]
#[command(
    after_help = "Exit status: 0 good, 1 the work failed, 2 wrong usage, 3 checked and refuted."
)]
pub struct Cli {
    /// No progress bars and no remarks.
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// How to tell on stderr how far the work is: bars, on a terminal; or a line of JSON at a time, for
    /// other programs.
    #[arg(long, global = true, value_enum, value_name = "KIND", default_value = "bars")]
    pub progress: ProgressArg,
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum ProgressArg {
    Bars,
    Json,
}

#[derive(Subcommand)]
pub enum Command {
    /// Build an .hlod file from one or several scans (PLY, OBJ, STL, GLB, glTF, LAS, LAZ, E57).
    Build(BuildArgs),
    /// List or do the steps of a build that was begun with --prepare, on one machine or on several.
    Step(StepArgs),
    /// Say what is in an .hlod file, level by level.
    Info(InfoArgs),
    /// Check an .hlod file, and try to refute the errors it states.
    Verify(VerifyArgs),
    /// Write one level of detail as a PLY or GLB file.
    Export(ExportArgs),
    /// Measure how far a mesh is from a reference: distances and normals, by samples.
    Compare(CompareArgs),
    /// Make a sample: a carved bust on a plinth with an inscription of known depths.
    Synth(SynthArgs),
    /// Check what build --meta is given, or print an example to start from.
    Meta(MetaArgs),
}

#[derive(Args)]
#[group(id = "what", required = true, multiple = false, args = ["file", "template", "schema"])]
pub struct MetaArgs {
    /// A file of metadata to check.
    pub file: Option<PathBuf>,
    /// Print an example with every key.
    #[arg(long)]
    pub template: bool,
    /// Print the JSON Schema, for editors and other programs.
    #[arg(long)]
    pub schema: bool,
    #[command(flatten)]
    pub json: JsonArgs,
}

/// Where machine-readable results go.
#[derive(Args)]
pub struct JsonArgs {
    /// Print the result as JSON, or write it to FILE.
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true)]
    pub json: Option<Option<PathBuf>>,
}

#[derive(Args)]
pub struct CompareArgs {
    /// What is right: a scan (PLY, OBJ, STL, GLB, glTF, LAS, LAZ, E57).
    pub reference: PathBuf,
    /// What is measured against it.
    pub mesh: PathBuf,
    /// Samples on faces; all vertices and middles of edges are sampled as well.
    #[arg(long, default_value_t = 300_000, value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    pub samples: u32,
    #[command(flatten)]
    pub json: JsonArgs,
}

#[derive(Args)]
pub struct BuildArgs {
    /// Scans, or MeshLab projects of aligned ones (.mlp); several make one model.
    #[arg(required = true)]
    pub input: Vec<PathBuf>,
    /// The file to write.
    #[arg(long, short)]
    pub output: PathBuf,
    /// A node may be wrong by its cell's edge divided by this.
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(8..=65536))]
    pub resolution: u32,
    /// Cells with more triangles are split.
    #[arg(long, default_value_t = 16_384, value_parser = clap::value_parser!(u32).range(64..=131_072))]
    pub leaf_triangles: u32,
    /// Precision of the leaves in the scan's unit [default: the scan's own, where it is
    /// quantised, else a sixteenth of its short edges].
    #[arg(long, value_parser = positive)]
    pub precision: Option<f64>,
    /// A text of 16 numbers, row by row, that moves an input to where it stands, as MeshLab and
    /// CloudCompare write them; one for each input, in their order, `none` for one that stays.
    #[arg(long, value_name = "FILE")]
    pub transform: Vec<PathBuf>,
    /// Where colours come from: auto (vertices where the scan has colours there, else its textures),
    /// vertex, texture, or none. A vertex gets the mean of the texels that it stands for.
    #[arg(long, default_value = "auto", value_name = "SOURCE")]
    pub colour: ColourSource,
    /// Differences of normals below this many times their noise are not shading; more gives fewer
    /// triangles.
    #[arg(long, default_value_t = 2.0, value_name = "FACTOR", value_parser = not_negative)]
    pub normal_noise: f32,
    /// What levels above the leaves are drawn with: triangles, points, or hybrid, which is points
    /// where triangles are smaller than a pixel and points cost less. Point clouds are points
    /// whatever this says.
    #[arg(long, default_value = "triangles", value_name = "PRIMITIVES")]
    pub representation: Primitives,
    /// What drawing a point costs, in triangles, as measured where the file will be shown.
    #[arg(long, default_value_t = 0.5, value_name = "RATIO", value_parser = point_cost)]
    pub point_cost: f32,
    /// Memory the build may use, as in 512MiB or 4GiB; what does not fit goes to the work folder.
    #[arg(long, default_value = "4GiB", value_parser = byte_count)]
    pub memory: u64,
    /// Where to keep what is done until the build is finished [default: OUTPUT.work].
    #[arg(long, value_name = "DIR")]
    pub work_dir: Option<PathBuf>,
    /// Go on with a build that was stopped.
    #[arg(long)]
    pub resume: bool,
    /// Worker threads [default: one a core].
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
    /// Unit of the scan's coordinates: mm, cm, m, um, in.
    #[arg(long, default_value = "unknown")]
    pub unit: Unit,
    /// Which way is up: +x -x +y -y +z -z.
    #[arg(long, default_value = "+y", allow_hyphen_values = true)]
    pub up: SignedAxis,
    /// Only divide the scan, in the work folder: `step` does the rest in parts, and --resume
    /// finishes.
    #[arg(long)]
    pub prepare: bool,
    /// Which way the statue faces [default: +z, or -y where up is along z].
    #[arg(long, allow_hyphen_values = true)]
    pub front: Option<SignedAxis>,
    /// Keep a number that vertices of a PLY file have, as in `quality`, `quality=0.01` (kept to
    /// hundredths) or `depth=0.01 mm`; may be given several times.
    #[arg(long, value_name = "NAME[=STEP][UNIT]")]
    pub keep: Vec<KeptScalar>,
    /// What is known of the scan besides its shape, kept in the file: title, holder, rights, device,
    /// accuracy … (JSON; `hlod-build meta --template` prints an example).
    #[arg(long, value_name = "FILE")]
    pub meta: Option<PathBuf>,
    /// Replace an existing output.
    #[arg(long)]
    pub force: bool,
    /// Also write the report, with time and memory of each stage, to this file.
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    #[command(flatten)]
    pub json: JsonArgs,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("expected a positive number".into()),
    }
}

fn not_negative(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(value) if value >= 0.0 && value.is_finite() => Ok(value),
        _ => Err("expected a number, 0 or more".into()),
    }
}

fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value <= 1.0 => Ok(value),
        _ => Err("expected a number above 0 and up to 1".into()),
    }
}

/// A number of bytes with a unit.
fn byte_count(text: &str) -> Result<u64, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit: u64 = match &text[digits.len()..] {
        "KiB" => 1 << 10,
        "MiB" => 1 << 20,
        "GiB" => 1 << 30,
        "kB" | "KB" => 1_000,
        "MB" => 1_000_000,
        "GB" => 1_000_000_000,
        _ => return Err("expected a number with a unit, as in 512MiB or 4GiB".into()),
    };
    match digits.trim_end().parse::<f64>() {
        Ok(count) if count > 0.0 && count * (unit as f64) < 1e15 => {
            Ok((count * unit as f64) as u64)
        }
        _ => Err("expected a positive number before the unit".into()),
    }
}

fn point_cost(text: &str) -> Result<f32, String> {
    let cost: f32 = text.parse().map_err(|_| "expected a number".to_owned())?;
    match cost {
        0.001..=1000.0 => Ok(cost),
        _ => Err("expected a number from 0.001 to 1000".into()),
    }
}

/// The matrices of files; `none` is no file.
pub fn transforms(files: &[PathBuf]) -> Result<Vec<Option<Transform>>, String> {
    let read = |file: &PathBuf| match file.to_str() {
        Some("none") => Ok(None),
        _ => Transform::read(file).map(Some).map_err(|error| error.to_string()),
    };
    files.iter().map(read).collect()
}

impl BuildArgs {
    pub fn options(&self) -> Result<BuildOptions, String> {
        let z_up = self.up.axis == 2;
        let usual = SignedAxis { axis: if z_up { 1 } else { 2 }, negative: z_up };
        let front = self.front.unwrap_or(usual);
        if front.axis == self.up.axis {
            return Err(format!("--front {front} is along --up {}", self.up));
        }
        Ok(BuildOptions {
            resolution: self.resolution,
            leaf_triangles: self.leaf_triangles,
            normal_noise: self.normal_noise,
            primitives: self.representation,
            point_cost: self.point_cost,
            precision: self.precision,
            colour: self.colour,
            transforms: transforms(&self.transform)?,
            unit: self.unit,
            up: self.up,
            front,
            keep: self.keep.clone(),
            // Read where errors can be said.
            metadata: None,
            force: self.force,
            memory_bytes: self.memory,
            work_folder: self.work_dir.clone(),
            resume: self.resume,
        })
    }
}

#[derive(Args)]
pub struct InfoArgs {
    /// The .hlod file.
    pub file: PathBuf,
    #[command(flatten)]
    pub json: JsonArgs,
}

#[derive(Args)]
#[command(
    after_help = "A step needs the journal and the files listed, and makes files and a line of the journal; \
processes may do steps of one folder at the same time. When all are done, `build --resume` writes the output."
)]
pub struct StepArgs {
    /// The work folder.
    pub work_dir: PathBuf,
    /// Steps to do, in this order; without any, steps are listed.
    pub name: Vec<String>,
    /// Memory that a step may use, as in 512MiB or 4GiB.
    #[arg(long, default_value = "4GiB", value_parser = byte_count)]
    pub memory: u64,
    /// Worker threads [default: one a core].
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
    #[command(flatten)]
    pub json: JsonArgs,
}

#[derive(Args)]
pub struct VerifyArgs {
    /// The .hlod file.
    pub file: PathBuf,
    /// The scans it was built from: leaves are compared with them too.
    #[arg(long, num_args = 1.., value_name = "INPUT")]
    pub against: Vec<PathBuf>,
    /// Where each of them stands, as for `build`.
    #[arg(long, value_name = "FILE")]
    pub transform: Vec<PathBuf>,
    /// Sample this share of the inner nodes of each depth.
    #[arg(long, default_value_t = 1.0, value_parser = share)]
    pub share: f64,
    /// Memory for comparing leaves, at least 12 bytes a vertex; with less, inputs are read more
    /// often.
    #[arg(long, default_value = "4GiB", value_parser = byte_count)]
    pub memory: u64,
    #[command(flatten)]
    pub json: JsonArgs,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum Kind {
    Appearance,
    Geometric,
}

#[derive(Args)]
#[group(id = "selection", required = true, multiple = false, args = ["depth", "error", "max_triangles", "leaves"])]
pub struct ExportArgs {
    /// The .hlod file.
    pub file: PathBuf,
    /// The file to write: .ply, which is exact, or .glb (glTF) for viewers and web pages.
    #[arg(long, short)]
    pub output: PathBuf,
    /// Nodes of this depth (0 = the coarsest), and leaves above it.
    #[arg(long)]
    pub depth: Option<u8>,
    /// The coarsest nodes with at most this error, in the scan's unit.
    #[arg(long, value_parser = positive)]
    pub error: Option<f64>,
    /// As fine as so many triangles allow.
    #[arg(long)]
    pub max_triangles: Option<u64>,
    /// The scan's own geometry.
    #[arg(long)]
    pub leaves: bool,
    /// Which hierarchy.
    #[arg(long, value_enum, default_value = "appearance")]
    pub representation: Kind,
    /// Replace an existing output.
    #[arg(long)]
    pub force: bool,
    #[command(flatten)]
    pub json: JsonArgs,
}

impl ExportArgs {
    pub fn selection(&self) -> Selection {
        // The argument group makes sure that exactly one is there.
        match (self.depth, self.error, self.max_triangles) {
            (Some(depth), ..) => Selection::Depth(depth),
            (_, Some(error), _) => Selection::Error(error),
            (.., Some(count)) => Selection::MaxTriangles(count),
            _ => Selection::Leaves,
        }
    }

    pub fn kind(&self) -> RepresentationKind {
        match self.representation {
            Kind::Appearance => RepresentationKind::Appearance,
            Kind::Geometric => RepresentationKind::Geometric,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
pub enum Subject {
    Statue,
}

#[derive(Args)]
pub struct SynthArgs {
    /// What to make.
    #[arg(value_enum)]
    pub subject: Subject,
    /// How many triangles, as in 300K, 8M, 1G; the count comes out within a few per cent.
    #[arg(long, default_value = "1M", value_parser = count)]
    pub triangles: u64,
    /// Seed of noise and chisel marks.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// The PLY file to write.
    #[arg(long, short, required_unless_present = "describe")]
    pub output: Option<PathBuf>,
    /// Print the statue's known lengths, depths and angles as JSON instead.
    #[arg(long, conflicts_with = "output")]
    pub describe: bool,
    /// Replace an existing output.
    #[arg(long)]
    pub force: bool,
    #[command(flatten)]
    pub json: JsonArgs,
}

/// A count with an optional K, M or G.
fn count(text: &str) -> Result<u64, String> {
    let (digits, factor) = match text.char_indices().last() {
        Some((i, 'k' | 'K')) => (&text[..i], 1e3),
        Some((i, 'M')) => (&text[..i], 1e6),
        Some((i, 'G')) => (&text[..i], 1e9),
        _ => (text, 1.0),
    };
    match digits.parse::<f64>() {
        Ok(value) if value > 0.0 && value * factor < 1e18 => Ok((value * factor).round() as u64),
        _ => Err("expected a count such as 300K, 8M or 1G".into()),
    }
}
