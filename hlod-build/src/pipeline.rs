//! The build, as an outline: scan → lattice → leaves → hierarchy → file.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use hlod_compress::{
    AttributeDeclaration, AttributeDomain, AttributeType, BlockRef, Header, Metadata, Primitives,
    SignedAxis,
};
use hlod_scan::{ColourSource, PlacedScan, ScanReport, Transform, place_scans};
use rayon::prelude::*;
use serde::Serialize;

use crate::error::BuildError;
use crate::gate::Gate;
use crate::hierarchy::Setting;
use crate::ingest::Precision;
use crate::kept::{self, KeptScalar};
use crate::memory::{Memory, SUBTREES_AT_A_TIME};
use crate::oddities::Oddities;
use crate::output::check_output;
use crate::points::cover::Choice;
use crate::progress::{Progress, Unit};
use crate::resources::{Costs, Meter};
use crate::steps::assemble::assemble;
use crate::steps::ingest::{self, Account, ingest};
use crate::steps::nodes::{build_subtree_step, build_upper_step};
use crate::steps::plan::Plan;
use crate::steps::scatter::{Subtree, scatter};
use crate::steps::survey::{self, Survey, survey};
use crate::steps::work_folder::{Identity, InputStamp, PROGRAM, StepOptions, WorkFolder};

/// What a build is asked for.
#[derive(Debug, Clone)]
pub struct BuildOptions {
    /// R: a node may be wrong by its cell's edge divided by this.
    pub resolution: u32,
    /// T: cells with more triangles are split.
    pub leaf_triangles: u32,
    /// Step of the leaves' lattice in the scan's unit; detected or estimated where `None`.
    pub precision: Option<f64>,
    /// Where the colours of vertices are taken from.
    pub colour: ColourSource,
    /// Where each input stands, in the order of these; empty where all stand where they say themselves.
    pub transforms: Vec<Option<Transform>>,
    /// Differences of normals below this many times their noise in a node do not count as shading
    /// (α_tol); one step of an 8-bit shade never does.
    pub normal_noise: f32,
    /// What levels above the leaves are drawn with, where the scan has triangles.
    pub primitives: Primitives,
    /// What drawing a point costs, in triangles: decides where [`Primitives::Hybrid`] has points.
    pub point_cost: f32,
    /// The unit of the scan's coordinates.
    pub unit: hlod_compress::Unit,
    /// Which way is up.
    pub up: SignedAxis,
    /// Which way the statue faces.
    pub front: SignedAxis,
    /// Numbers of the scan's vertices that are kept, [`hlod_compress::SCALARS_MAX`] at most.
    pub keep: Vec<KeptScalar>,
    /// What is known of the scan besides its shape.
    pub metadata: Option<Metadata>,
    /// Whether an existing output is replaced.
    pub force: bool,
    /// How much memory the build may use.
    pub memory_bytes: u64,
    /// Where it keeps what it has done until it is finished; beside the output where `None`.
    pub work_folder: Option<PathBuf>,
    /// Whether to go on with a build that was stopped.
    pub resume: bool,
}

impl Default for BuildOptions {
    /// R = 256, T = 16,384, twice the noise of normals, unit unknown, +y up, front towards +z; 4 GiB of memory.
    fn default() -> Self {
        BuildOptions {
            resolution: 256,
            leaf_triangles: 16_384,
            precision: None,
            colour: ColourSource::Auto,
            transforms: Vec::new(),
            normal_noise: NORMAL_NOISE,
            primitives: Primitives::Triangles,
            point_cost: POINT_COST,
            unit: hlod_compress::Unit::Unknown,
            up: SignedAxis::PLUS_Y,
            front: SignedAxis::PLUS_Z,
            keep: Vec::new(),
            metadata: None,
            force: false,
            memory_bytes: 4 << 30,
            work_folder: None,
            resume: false,
        }
    }
}

/// As coarse as pictures of statues allow that are to differ from full resolution by less than a
/// pixel; see bench-paths/NOTES.md.
const NORMAL_NOISE: f32 = 2.0;

/// As measured with the software rasteriser; see bench-paths/NOTES.md.
const POINT_COST: f32 = 0.5;

/// What a build did; the keys are stable.
#[derive(Debug, Serialize)]
pub struct BuildReport {
    /// The file written.
    pub output: PathBuf,
    /// Its length.
    pub bytes_total: u64,
    /// Triangles read.
    pub triangles_input: u64,
    /// Points read, of point clouds.
    pub points_input: u64,
    /// Triangles without an area on the lattice, left out.
    pub triangles_degenerate: u64,
    /// Octree nodes.
    pub nodes: u64,
    /// Step of the leaves' lattice in the scan's unit.
    pub precision_step: f64,
    /// Where that step comes from.
    pub precision: Precision,
    /// Whether the surface bounds a volume and faces outwards.
    pub closed_oriented: bool,
    /// Vertices of no triangle, left out.
    pub vertices_unused: u64,
    /// Normals of points that were estimated because the input has none.
    pub normals_estimated: u64,
    /// What is odd about the triangles.
    #[serde(flatten)]
    pub oddities: Oddities,
    /// Time and memory.
    #[serde(flatten)]
    pub costs: Costs,
    /// What was read, skipped and repaired in each input.
    pub inputs: Vec<ScanReport>,
}

/// Builds `output` from `inputs`.
///
/// Nothing appears under the output's name before it is complete.
///
/// # Errors
/// When an input is not usable, or the output exists, is an input, or cannot be written.
pub fn build(
    inputs: &[PathBuf],
    output: &Path,
    options: &BuildOptions,
    progress: &dyn Progress,
) -> Result<BuildReport, BuildError> {
    let mut meter = Meter::start();
    let (folder, memory, scans) = begin(inputs, output, options, progress)?;
    let result = run_steps(&folder, &scans, output, options, &memory, &mut meter, progress);
    match result {
        Ok(built) => {
            remove(folder, progress);
            Ok(built.report(output, meter.finish()))
        }
        Err(error) => Err(give_up(folder, error, progress)),
    }
}

/// Begins a build and divides the scan, so that the remaining steps can be done one by one, several
/// at a time, or elsewhere (`step`); `build` with `resume` then does what is left. Gives the
/// work folder.
///
/// # Errors
/// As [`build`].
pub fn prepare(
    inputs: &[PathBuf],
    output: &Path,
    options: &BuildOptions,
    progress: &dyn Progress,
) -> Result<PathBuf, BuildError> {
    let (folder, memory, scans) = begin(inputs, output, options, progress)?;
    match divide(&folder, &scans, options, &memory, &mut Meter::start(), progress) {
        Ok(_) => Ok(work_folder_of(output, options)),
        Err(error) => Err(give_up(folder, error, progress)),
    }
}

/// Checks what is asked for and opens the work folder.
fn begin(
    inputs: &[PathBuf],
    output: &Path,
    options: &BuildOptions,
    progress: &dyn Progress,
) -> Result<(WorkFolder, Memory, Vec<PlacedScan>), BuildError> {
    if inputs.is_empty() {
        return Err(BuildError::Usage("no input was given".into()));
    }
    let scans = place_scans(inputs, &options.transforms)?;
    let meshes = scans.iter().map(|scan| &scan.path);
    let read: Vec<PathBuf> = inputs.iter().chain(meshes).cloned().collect();
    check_output(&read, output, options.force)?;
    kept::check(&options.keep)?;
    let memory = Memory::share(options.memory_bytes, options.leaf_triangles, output)?;
    let folder = open_folder(&work_folder_of(output, options), &scans, options, progress)?;
    Ok((folder, memory, scans))
}

/// Nothing is left where nothing was done, or going on would end as this did.
fn give_up(folder: WorkFolder, error: BuildError, progress: &dyn Progress) -> BuildError {
    if !folder.has_steps() || !error.is_passing() {
        remove(folder, progress);
    }
    error
}

/// What stays of the work folder decides neither whether the output is good nor why a build failed.
fn remove(folder: WorkFolder, progress: &dyn Progress) {
    if let Err(error) = folder.remove() {
        progress.remark(&format!("{error}; it is needed no more"));
    }
}

/// What the steps come to.
struct Built {
    account: Account,
    survey: Survey,
    header: Header,
    oddities: Oddities,
}

/// A scan divided into subtrees, each in a file of its own.
struct Divided {
    account: Account,
    survey: Survey,
    plan: Plan,
}

fn divide(
    folder: &WorkFolder,
    scans: &[PlacedScan],
    options: &BuildOptions,
    memory: &Memory,
    meter: &mut Meter,
    progress: &dyn Progress,
) -> Result<Divided, BuildError> {
    let wanted = (options.colour, options.keep.as_slice());
    let account = ingest(folder, scans, wanted, memory.join_bytes, progress)?;
    meter.finish_stage("read");

    let (precision, full) = (options.precision, memory.subtree_triangles);
    let survey = survey(folder, &account, precision, full, memory.join_bytes, progress)?;
    let kept: &[&str] = if options.keep.is_empty() { &[] } else { &[ingest::SCALARS] };
    folder.discard(&[&[ingest::VERTICES], kept].concat())?;
    meter.finish_stage("survey");

    let subtrees = scatter(folder, &survey, &account, full, memory.join_bytes, progress)?;
    folder.discard(&[ingest::TRIANGLES, survey::PLACED])?;
    meter.finish_stage("partition");
    Ok(Divided { account, survey, plan: Plan::new(subtrees) })
}

/// The build: each step reads what those before have written.
fn run_steps(
    folder: &WorkFolder,
    scans: &[PlacedScan],
    output: &Path,
    options: &BuildOptions,
    memory: &Memory,
    meter: &mut Meter,
    progress: &dyn Progress,
) -> Result<Built, BuildError> {
    let Divided { account, survey, plan } =
        divide(folder, scans, options, memory, meter, progress)?;

    let gate = Gate::new(memory.nodes_bytes);
    let setting = Setting {
        lattice: survey.lattice(),
        resolution: options.resolution,
        normal_noise: options.normal_noise,
        closed_oriented: survey.closed_oriented,
        is_cloud: account.is_cloud,
        choice: Choice { primitives: options.primitives, point_cost: options.point_cost.into() },
        has_colours: account.has_colours,
        has_scalars: !account.scalars.is_empty(),
        gate: &gate,
        progress,
    };
    let leaf_triangles = options.leaf_triangles as usize;
    let unit = if account.is_cloud { Unit::Points } else { Unit::Triangles };
    progress.begin("simplify", plan.subtrees.iter().map(|s| s.triangles).sum(), unit);
    build_subtrees(folder, &plan.subtrees, leaf_triangles, &setting)?;
    progress.end();
    meter.finish_stage("simplify");

    build_upper_levels(folder, &plan, &setting)?;
    meter.finish_stage("upper levels");

    let header = header(options, &account, &survey)?;
    let about = (header, options.metadata.as_ref());
    let (header, oddities) =
        assemble(folder, &plan.parts(), about, (output, options.force), progress)?;
    meter.finish_stage("write");
    Ok(Built { account, survey, header, oddities })
}

/// Subtrees, largest first, two at a time: while one has only its last nodes left, the other keeps
/// the remaining threads busy.
fn build_subtrees(
    folder: &WorkFolder,
    subtrees: &[Subtree],
    leaf_triangles: usize,
    setting: &Setting<'_>,
) -> Result<(), BuildError> {
    let mut order: Vec<&Subtree> = subtrees.iter().collect();
    order.sort_by_key(|s| (std::cmp::Reverse(s.triangles), s.cell()));
    let next = AtomicUsize::new(0);
    let failure = Mutex::new(None);
    let is_failed = || failure.lock().is_ok_and(|failure| failure.is_some());
    let work = || {
        while let Some(subtree) = order.get(next.fetch_add(1, Ordering::Relaxed)) {
            if is_failed() {
                break;
            }
            let done = folder
                .check_stop(setting.progress)
                .and_then(|()| build_subtree_step(folder, subtree, leaf_triangles, setting));
            if let (Err(error), Ok(mut failure)) = (done, failure.lock()) {
                failure.get_or_insert(error);
            }
        }
    };
    rayon::scope(|scope| {
        for _ in 0..SUBTREES_AT_A_TIME {
            scope.spawn(|_| work());
        }
    });
    failure.into_inner().ok().flatten().map_or(Ok(()), Err)
}

/// The nodes above the subtrees, depth by depth.
fn build_upper_levels(
    folder: &WorkFolder,
    plan: &Plan,
    setting: &Setting<'_>,
) -> Result<(), BuildError> {
    let levels = plan.upper_levels();
    let progress = setting.progress;
    progress.begin("upper levels", levels.iter().map(|l| l.len() as u64).sum(), Unit::Nodes);
    for cells in levels {
        cells.par_iter().try_for_each(|&cell| {
            let done = build_upper_step(folder, cell, &plan.below(cell), setting);
            progress.advance(1);
            done
        })?;
    }
    progress.end();
    Ok(())
}

/// Where the options say, else beside the output.
fn work_folder_of(output: &Path, options: &BuildOptions) -> PathBuf {
    options.work_folder.clone().unwrap_or_else(|| {
        let mut name = output.as_os_str().to_owned();
        name.push(".work");
        name.into()
    })
}

fn open_folder(
    path: &Path,
    scans: &[PlacedScan],
    options: &BuildOptions,
    progress: &dyn Progress,
) -> Result<WorkFolder, BuildError> {
    let identity = Identity {
        program: PROGRAM.into(),
        options: StepOptions {
            resolution: options.resolution,
            leaf_triangles: options.leaf_triangles,
            precision: options.precision,
            colour: options.colour,
            normal_noise: options.normal_noise,
            primitives: options.primitives.name().into(),
            point_cost: options.point_cost,
            keep: options.keep.clone(),
        },
        inputs: scans.iter().map(InputStamp::of).collect::<Result<_, _>>()?,
    };
    if !options.resume {
        return WorkFolder::start(path, &identity);
    }
    let mut folder = WorkFolder::resume(path, &identity, &mut |remark| progress.remark(&remark))?;
    // Steps whose files were removed because a later one had used them, which now has to be done
    // again.
    let gone = |step: &str, files: &[&str]| {
        !folder.is_done(step) && files.iter().any(|file| folder.is_discarded(file))
    };
    if gone("survey", &[ingest::VERTICES]) || gone("scatter", &[ingest::TRIANGLES, survey::PLACED])
    {
        progress.remark("what it was made from is gone: the build begins again");
        folder.begin_again()?;
    }
    Ok(folder)
}

impl Built {
    fn report(self, output: &Path, costs: Costs) -> BuildReport {
        let Built { account, survey, header, oddities } = self;
        // Of equal vertices of a soup only the first is used, which is not odd.
        let welded: u64 = account.reports.iter().map(|r| r.vertices_welded).sum();
        BuildReport {
            output: output.to_owned(),
            bytes_total: header.file_bytes,
            triangles_input: header.triangles_input,
            points_input: header.points_input,
            triangles_degenerate: survey.triangles_degenerate,
            nodes: header.nodes,
            precision_step: survey.step,
            precision: survey.precision,
            closed_oriented: survey.closed_oriented,
            vertices_unused: survey.vertices_unused.saturating_sub(welded),
            normals_estimated: account.normals_estimated,
            oddities,
            costs,
            inputs: account.reports,
        }
    }
}

/// Triangles as the input counts them: faces that the reader already left out included.
fn triangles_read(report: &ScanReport) -> u64 {
    report.triangles + report.degenerate_faces
}

fn header(
    options: &BuildOptions,
    account: &Account,
    survey: &Survey,
) -> Result<Header, BuildError> {
    let domain = if account.is_cloud { AttributeDomain::Point } else { AttributeDomain::Vertex };
    let attribute = |name: &str, kind| AttributeDeclaration { name: name.into(), kind, domain };
    let mut attributes = vec![attribute("normal", AttributeType::OctNormal)];
    if account.has_colours {
        attributes.push(attribute("colour", AttributeType::Srgba8));
    }
    for (scalar, range) in account.scalars.iter().zip(account.ranges()?) {
        attributes.push(attribute(&scalar.kept.name, AttributeType::Scalar(range)));
    }
    Ok(Header {
        unit: options.unit,
        up: options.up,
        front: options.front,
        lattice: survey.lattice(),
        bounds: survey.bounds,
        sources: account.sources.iter().map(ingest::Source::to_source_file).collect(),
        triangles_input: account.reports.iter().map(triangles_read).sum(),
        points_input: if account.is_cloud { account.vertices } else { 0 },
        resolution: options.resolution,
        leaf_triangles: options.leaf_triangles,
        normal_noise: options.normal_noise,
        primitives: options.primitives,
        point_cost: options.point_cost,
        attributes,
        // Filled in when the file is laid out.
        nodes: 0,
        skeleton_bytes: 0,
        root_block: BlockRef { offset: 0, block_bytes: 0, crc32: 0 },
        front_bytes: 0,
        metadata: None,
        file_bytes: 0,
    })
}
