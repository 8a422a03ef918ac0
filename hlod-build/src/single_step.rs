//! One step of a build at a time, for whoever divides the work among processes or machines.
//!
//! After [`prepare`](crate::prepare) a work folder holds a file for each subtree. Each remaining
//! step reads some files of the folder and writes two more; [`list_steps`] says which, and
//! [`run_step`] does one. Processes may do so at the same time. On another machine a folder with
//! the journal and the files that a step needs is enough; what it makes is copied back together
//! with the line that it adds to the journal. `build` with `resume` checks all of it, does what is
//! left and writes the output: the same bytes, whoever did what.

use std::path::Path;

use serde::Serialize;

use crate::error::BuildError;
use crate::gate::Gate;
use crate::hierarchy::Setting;
use crate::memory::Memory;
use crate::points::cover::Choice;
use crate::progress::Progress;
use crate::steps::ingest;
use crate::steps::nodes::{Names, build_subtree_step, build_upper_step};
use crate::steps::plan::Plan;
use crate::steps::scatter::{self, Subtree};
use crate::steps::survey;
use crate::steps::work_folder::{PROGRAM, WorkFolder};

/// A step of a build that was prepared; the keys are stable.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StepDescription {
    /// Its name.
    pub name: String,
    /// Files of the work folder that it reads, besides the journal.
    pub needs: Vec<String>,
    /// Files of the work folder that it writes.
    pub makes: Vec<String>,
    /// Triangles (of a point cloud, points) of the scan that it begins with, in a subtree.
    pub triangles: Option<u64>,
    /// Whether the journal says that it is done.
    pub done: bool,
    /// Whether what it needs has been made.
    pub ready: bool,
}

/// A step with what it is about.
struct Step<'a> {
    description: StepDescription,
    work: Work<'a>,
}

enum Work<'a> {
    Subtree(&'a Subtree),
    Node(hlod_compress::CellKey),
}

/// All steps of a prepared build, subtrees first, then nodes from the deepest to the root.
///
/// # Errors
/// When the folder holds no prepared build of this version, or a build goes on in it.
pub fn list_steps(work_folder: &Path) -> Result<Vec<StepDescription>, BuildError> {
    let folder = attend(work_folder)?;
    let plan = Plan::new(scatter::read_plan(&folder)?);
    Ok(steps(&folder, &plan).into_iter().map(|step| step.description).collect())
}

/// Does one step unless it is done.
///
/// # Errors
/// When there is no such step, when what it needs is not there as it was written, and as the build
/// does.
pub fn run_step(
    work_folder: &Path,
    name: &str,
    memory_bytes: u64,
    progress: &dyn Progress,
) -> Result<(), BuildError> {
    let mut folder = attend(work_folder)?;
    let plan = Plan::new(scatter::read_plan(&folder)?);
    let usage = |why: String| Err(BuildError::Usage(format!("{}: {why}", work_folder.display())));
    let Some(step) = steps(&folder, &plan).into_iter().find(|s| s.description.name == name) else {
        return usage(format!("has no step {name}"));
    };
    let StepDescription { needs, makes, done, .. } = step.description;
    if done && makes.iter().all(|file| folder.holds(file)) {
        return Ok(());
    }
    folder.forget(name);
    if let Some(missing) = needs.iter().find(|file| !folder.holds(file)) {
        return usage(format!(
            "{name} needs {missing}, which is not there, or not as the step before it left it"
        ));
    }
    let (account, survey) = (ingest::read_account(&folder)?, survey::read_survey(&folder)?);
    let options = folder.identity().options.clone();
    let gate =
        Gate::new(Memory::share(memory_bytes, options.leaf_triangles, work_folder)?.nodes_bytes);
    let setting = Setting {
        lattice: survey.lattice(),
        resolution: options.resolution,
        normal_noise: options.normal_noise,
        closed_oriented: survey.closed_oriented,
        is_cloud: account.is_cloud,
        choice: Choice {
            primitives: options.primitives.parse().map_err(BuildError::Usage)?,
            point_cost: options.point_cost.into(),
        },
        has_colours: account.has_colours,
        has_scalars: !account.scalars.is_empty(),
        gate: &gate,
        progress,
    };
    match step.work {
        Work::Subtree(subtree) => {
            build_subtree_step(&folder, subtree, options.leaf_triangles as usize, &setting)
        }
        Work::Node(cell) => build_upper_step(&folder, cell, &plan.below(cell), &setting),
    }
}

fn attend(work_folder: &Path) -> Result<WorkFolder, BuildError> {
    let usage = |why: String| BuildError::Usage(format!("{}: {why}", work_folder.display()));
    if !work_folder.join("journal").exists() {
        return Err(usage("holds no build; begin one with build --prepare".into()));
    }
    let folder = WorkFolder::attend(work_folder)?;
    let begun_by = &folder.identity().program;
    if begun_by != PROGRAM {
        return Err(usage(format!("was begun by {begun_by}, this is {PROGRAM}")));
    }
    if !folder.is_done("scatter") {
        return Err(usage("is not prepared; finish that with build --prepare --resume".into()));
    }
    Ok(folder)
}

fn steps<'a>(folder: &WorkFolder, plan: &'a Plan) -> Vec<Step<'a>> {
    let common = [ingest::ACCOUNT, survey::SURVEY, scatter::PLAN].map(String::from);
    let step = |cell, needs: Vec<String>, made_by: Vec<String>, triangles, work| {
        let names = Names::of(cell);
        let description = StepDescription {
            done: folder.is_done(&names.step),
            ready: made_by.iter().all(|step| folder.is_done(step)),
            name: names.step,
            needs: common.iter().cloned().chain(needs).collect(),
            makes: vec![names.nodes, names.pages],
            triangles,
        };
        Step { description, work }
    };
    let subtrees = plan.subtrees.iter().map(|subtree| {
        let work = Work::Subtree(subtree);
        step(subtree.cell(), vec![subtree.file()], Vec::new(), Some(subtree.triangles), work)
    });
    let upper = plan.upper_levels().into_iter().flatten().map(|cell| {
        let below: Vec<Names> = plan.below(cell).into_iter().map(Names::of).collect();
        let (files, made_by) = below.into_iter().map(|names| (names.nodes, names.step)).unzip();
        step(cell, files, made_by, None, Work::Node(cell))
    });
    subtrees.chain(upper).collect()
}
