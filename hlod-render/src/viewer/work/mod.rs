//! What is being worked out on the statue: the session, the tool in hand, and what reads leaves for it.
//!
//! ```text
//! tool      clicks → points of a task
//!   │ clerk     rays, measurements and sections on the scan's own geometry, on a thread
//!   ▼ session   history of steps, saved within seconds
//! overlay   what of it is drawn over the picture; desk: the panel's part
//! ```

mod clerk;
pub mod desk;
pub mod overlay;
pub mod tool;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::{DVec2, DVec3};
use hlod_compress::{Header, Metadata};

use self::clerk::{Answer, Clerk, Question};
use self::tool::{Standing, Task, Tool};
use crate::error::RenderError;
use crate::figure::scale::size_in_words;
use crate::files::write_whole;
use crate::framing::Framing;
use crate::lens::Lens;
use crate::measure::{Measured, Measurement, MeasurementKind, SurfacePoint};
use crate::model::Model;
use crate::pick::Hit;
use crate::section::{Measures, Plane, Section, Sheet};
use crate::session::{
    History, ModelIdentity, Note, NoteShape, ObjectFrame, SECTIONS_MAX, SavedView, Saver,
    ScaleCorrection, ScannerUncertainty, SectionPlane, Session, SessionFile, Viewpoint,
    free_beside, load, place_of,
};

/// A step that changes the session, as the panel asks for it.
pub struct Change {
    /// Its name, as in "undo *what*".
    pub what: &'static str,
    /// Part of one motion, as a slider's: steps of the same name that follow closely are one.
    pub gradual: bool,
    /// What it does.
    pub edit: Box<dyn FnOnce(&mut Session)>,
}

/// A plane and what it cuts, as far as that is known.
struct Outline {
    plane: Plane,
    section: Option<(Box<Section>, Measures)>,
}

/// The session and what is being added to it.
pub struct Work {
    /// What the tool in hand is for, and the points picked for it.
    pub tool: Option<Tool>,
    history: History,
    saver: Option<Saver>,
    clerk: Clerk,
    /// As the session's planes.
    outlines: Vec<Option<Outline>>,
    /// Picks under way: for which task, or for a raking light, and through which lens.
    picks: VecDeque<(Option<Task>, Lens)>,
    /// What a light is to rake.
    rake: Option<Hit>,
    /// Where drawings were written.
    saved: Option<String>,
    /// How far the statue reaches along axes that someone gave it, once that was read.
    reached: Option<([DVec3; 3], [[f64; 2]; 3])>,
    /// Axes that this was asked about.
    asked_reach: Option<[DVec3; 3]>,
    /// The tool is to end when these have come.
    finish_wanted: bool,
    file: PathBuf,
    header: Header,
    metadata: Option<Metadata>,
    bounds: (DVec3, DVec3),
    is_closed: bool,
    unit: String,
    problems: Vec<String>,
}

impl Drop for Work {
    /// Where a window ends by an error, nobody closes it.
    fn drop(&mut self) {
        // The error that ends it is said already.
        drop(self.close());
    }
}

impl Work {
    /// Goes on with the session of a file, or begins one. `session` is where it is kept; where that is
    /// not said, it is found. What goes wrong becomes a problem to be shown, and nothing is
    /// overwritten that could not be read. `wake` is called when something has been found out.
    pub fn open(
        file: &Path,
        session: Option<&Path>,
        model: &Model,
        wake: impl Fn() + Send + 'static,
    ) -> Work {
        let mut problems = Vec::new();
        let header = model.header();
        let metadata = model.metadata().unwrap_or_else(|error| {
            problems.push(error.to_string());
            None
        });
        let untouched = Session::new(file, header);
        let place = match session {
            Some(path) => Ok(SessionFile { path: path.to_owned(), exists: path.exists() }),
            None => place_of(file),
        };
        let (begun, saver) = match place {
            Ok(SessionFile { path, exists: false }) => {
                (untouched.clone(), Some(Saver::new(path, untouched)))
            }
            Ok(SessionFile { path, exists: true }) => match load(&path) {
                Ok(session) => {
                    let now = ModelIdentity::new(file, header);
                    problems.extend(session.model.mismatch(&now));
                    (session.clone(), Some(Saver::new(path, session)))
                }
                Err(error) => {
                    let other = free_beside(&path);
                    problems.push(format!(
                        "{error}. It stays as it is; what you do now is kept in {}",
                        other.display()
                    ));
                    (untouched.clone(), Some(Saver::new(other, untouched)))
                }
            },
            Err(error) => {
                problems.push(format!("{error}. What you do is not kept"));
                (untouched, None)
            }
        };
        let mut work = Work {
            tool: None,
            history: History::new(begun),
            saver,
            clerk: Clerk::new(file.to_owned(), wake),
            outlines: Vec::new(),
            picks: VecDeque::new(),
            rake: None,
            saved: None,
            reached: None,
            asked_reach: None,
            finish_wanted: false,
            file: file.to_owned(),
            header: header.clone(),
            metadata,
            bounds: model.bounds(),
            is_closed: model.is_closed(),
            unit: header.unit.name().to_owned(),
            problems,
        };
        work.catch_up();
        work
    }

    /// Where the statue stands, and how large it is.
    pub fn framing(&self) -> Framing {
        let axes = self.session().frame.as_ref().map(ObjectFrame::axes);
        let known = self.reached.filter(|(of, _)| axes == Some(*of));
        self.session().framing(&self.header, known.map(|(_, extents)| extents))
    }

    /// What the file says of up and front.
    fn file_axes(&self) -> String {
        let Header { up, front, .. } = &self.header;
        format!("up {up}, front {front}, as the file says")
    }

    /// Which frame coordinates are shown in, where there is more than one: words to follow them.
    fn frame_name(&self) -> &'static str {
        match &self.session().frame {
            None => "",
            Some(frame) if frame.shown => ", statue's frame",
            Some(_) => ", scan's frame",
        }
    }

    /// Asks for what the session needs from the leaves and does not have.
    fn catch_up(&mut self) {
        self.cut_again();
        let axes = self.session().frame.as_ref().map(ObjectFrame::axes);
        if let Some(axes) = axes.filter(|axes| self.asked_reach != Some(*axes)) {
            self.asked_reach = Some(axes);
            self.clerk.ask(Question::Extents(axes));
        }
    }

    /// What is known of the scan besides its shape.
    pub fn metadata(&self) -> Option<&Metadata> {
        self.metadata.as_ref()
    }

    /// How well the scanner measured, as the session declares it, else the file.
    fn scanner(&self) -> Option<ScannerUncertainty> {
        let of_file = || ScannerUncertainty::of_file(self.metadata.as_ref()?, self.header.unit);
        self.session().scanner.clone().or_else(of_file)
    }

    /// The session as it is.
    pub fn session(&self) -> &Session {
        self.history.session()
    }

    /// What went wrong since it was asked last.
    pub fn take_problems(&mut self) -> Vec<String> {
        std::mem::take(&mut self.problems)
    }

    /// Takes a tool in hand, or puts it away if it was.
    pub fn take_tool(&mut self, task: Task) {
        let same = self.tool.as_ref().is_some_and(|tool| tool.task == task);
        self.tool = (!same).then(|| Tool::new(task));
    }

    /// A pixel was clicked with a tool in hand: asks what is there.
    pub fn pick(&mut self, lens: Lens, pixel: DVec2) {
        if let Some(tool) = &self.tool {
            let task = tool.task;
            self.ask_pick(Some(task), lens, pixel);
        }
    }

    /// Asks which way the surface faces at a pixel: see [`Work::take_rake`].
    pub fn ask_rake(&mut self, lens: Lens, pixel: DVec2) {
        self.ask_pick(None, lens, pixel);
    }

    /// The place that a light is to rake, once it is known.
    pub fn take_rake(&mut self) -> Option<Hit> {
        self.rake.take()
    }

    fn ask_pick(&mut self, task: Option<Task>, lens: Lens, pixel: DVec2) {
        let (origin, direction) = lens.ray(pixel);
        self.picks.push_back((task, lens));
        let clip = self.session().clip_planes();
        self.clerk.ask(Question::Pick { origin, direction, clip });
    }

    /// Ends what the tool was making, if there are points enough.
    pub fn finish_tool(&mut self) {
        self.finish_wanted = !self.picks.is_empty();
        if self.finish_wanted {
            return;
        }
        if let Some(tool) = &mut self.tool {
            let task = tool.task;
            if let Some(points) = tool.finish() {
                self.complete(task, points);
            }
        }
    }

    /// Changes the session.
    pub fn change(&mut self, change: Change, now: Instant) {
        if change.gradual {
            self.history.adjust(change.what, now, change.edit);
        } else {
            self.history.edit(change.what, change.edit);
        }
        self.catch_up();
    }

    /// Takes the last step back, or does it again. Returns whether there was one.
    pub fn step(&mut self, forward: bool) -> bool {
        let stepped = if forward { self.history.redo() } else { self.history.undo() };
        self.catch_up();
        stepped
    }

    /// Bookmarks a view.
    pub fn save_view(&mut self, viewpoint: Viewpoint) {
        self.history.edit("save view", |session| {
            let (name, looks) = (session.free_view_name(), session.looks);
            Arc::make_mut(&mut session.views).push(SavedView { name, viewpoint, looks });
        });
    }

    /// Takes in what has been found out, and saves what has not been for a while. Returns whether
    /// anything looks different.
    pub fn advance(&mut self, now: Instant) -> bool {
        let mut changed = false;
        while let Some(answer) = self.clerk.answer() {
            changed = true;
            match answer {
                Answer::Picked(result) => self.picked(result),
                Answer::Measured { points, of_note: true, result, .. } => {
                    self.region_measured(points, result);
                }
                Answer::Measured { kind, points, result, .. } => {
                    self.measured(kind, points, result);
                }
                Answer::Cut { number, plane, section } => self.cut(number, plane, section),
                Answer::Reached(axes, Ok(extents)) => self.reached = Some((axes, extents)),
                Answer::Reached(_, Err(error)) => self.problems.push(error.to_string()),
            }
        }
        if let Some(saver) = &mut self.saver
            && let Some(error) = saver.note(self.history.session(), now)
        {
            self.problems.push(error.to_string());
        }
        changed
    }

    /// When [`Work::advance`] has something to do even if nothing happens.
    pub fn due(&self) -> Option<Instant> {
        self.saver.as_ref().and_then(Saver::due)
    }

    /// Saves what has not been saved.
    ///
    /// # Errors
    /// When it cannot be.
    pub fn close(&mut self) -> Result<(), RenderError> {
        self.saver.take().map_or(Ok(()), |saver| saver.finish(self.history.session()))
    }

    /// Whether leaves are being read.
    pub fn is_busy(&self) -> bool {
        self.clerk.is_busy()
    }

    /// How large the statue is, to the right, upwards and to the front.
    fn size_text(&self) -> String {
        size_in_words(self.framing().size(), self.header.unit)
    }

    fn session_path(&self) -> Option<PathBuf> {
        self.saver.as_ref().map(|saver| saver.path().to_owned())
    }

    fn picked(&mut self, result: Result<Option<Hit>, RenderError>) {
        let Some((wanted, lens)) = self.picks.pop_front() else { return };
        match (result, wanted) {
            (Ok(Some(hit)), _) if hit.is_back && self.is_closed => {
                self.problems.push("what is there is a cut face, not the scan's surface".into());
            }
            (Ok(Some(hit)), None) => self.rake = Some(hit),
            (Ok(Some(hit)), Some(wanted)) => {
                let pixel_length = lens.pixel_length(lens.depth_of(hit.position));
                let point = SurfacePoint::of_hit(&hit, Some(pixel_length));
                // Another tool may be in hand by now.
                let tool = self.tool.as_mut().filter(|tool| tool.task == wanted);
                if let Some(points) = tool.and_then(|tool| tool.add(point)) {
                    self.complete(wanted, points);
                }
            }
            (Ok(None), _) => self.problems.push("nothing of the statue is there to pick".into()),
            (Err(error), _) => self.problems.push(error.to_string()),
        }
        if self.finish_wanted {
            self.finish_tool();
        }
    }

    fn complete(&mut self, task: Task, points: Vec<SurfacePoint>) {
        match task {
            Task::Measure(kind) => {
                self.clerk.ask(Question::Measure { kind, points, of_note: false });
            }
            // A region has an area: it becomes a note when that is known.
            Task::Note(NoteShape::Region) => {
                let kind = MeasurementKind::SurfaceArea;
                self.clerk.ask(Question::Measure { kind, points, of_note: true });
            }
            Task::Note(shape) => self.note(shape, points, None),
            Task::Section => {
                let places: Vec<DVec3> = points.iter().map(SurfacePoint::place).collect();
                match Plane::through([places[0], places[1], places[2]]) {
                    Ok(plane) => self.add_section(plane),
                    Err(error) => self.problems.push(error.to_string()),
                }
            }
            Task::Stand(standing) => match self.stood(standing, &points) {
                Ok(frame) => {
                    self.history.edit("statue's axes", |session| session.frame = Some(frame));
                    self.tool = None;
                    self.catch_up();
                }
                Err(why) => self.problems.push(format!("{}: {why}", task.name())),
            },
            Task::Scale => {
                let declared = ScaleCorrection::new([points[0], points[1]], self.header.unit);
                match declared {
                    Ok(scale) => {
                        self.history.edit("known length", |session| session.scale = Some(scale));
                        self.tool = None;
                    }
                    Err(why) => self.problems.push(format!("{}: {why}", task.name())),
                }
            }
        }
    }

    /// How the statue stands, by points that were picked.
    fn stood(&self, standing: Standing, points: &[SurfacePoint]) -> Result<ObjectFrame, String> {
        let places: Vec<DVec3> = points.iter().map(SurfacePoint::place).collect();
        let before = self.framing();
        match standing {
            Standing::Points => ObjectFrame::through([places[0], places[1], places[2]]),
            Standing::Ground => ObjectFrame::standing_on(&places, before.centre, before.axes),
            Standing::Face => ObjectFrame::facing(points, before.axes),
        }
    }

    fn measured(
        &mut self,
        kind: MeasurementKind,
        points: Vec<SurfacePoint>,
        result: Result<Measured, RenderError>,
    ) {
        match result {
            Ok(result) => {
                self.history.edit("measurement", |session| {
                    let name = format!("{} {}", kind.name(), session.measurements.len() + 1);
                    let result = Some(result);
                    Arc::make_mut(&mut session.measurements).push(Measurement {
                        name,
                        kind,
                        points,
                        result,
                    });
                });
            }
            Err(error) => self.problems.push(error.to_string()),
        }
    }

    /// A region that has no area, as one that crosses itself, is a note nevertheless, and the reason is told.
    fn region_measured(
        &mut self,
        points: Vec<SurfacePoint>,
        result: Result<Measured, RenderError>,
    ) {
        let area = result.map_err(|error| self.problems.push(error.to_string())).ok();
        self.note(NoteShape::Region, points, area.map(|area| area.value));
    }

    fn note(&mut self, shape: NoteShape, points: Vec<SurfacePoint>, area: Option<f64>) {
        self.history.edit("note", |session| {
            let title = format!("Note {}", session.notes.len() + 1);
            Arc::make_mut(&mut session.notes).push(Note {
                title,
                text: String::new(),
                category: String::new(),
                colour: "#d55e00".into(),
                shape,
                points,
                area,
            });
        });
    }

    /// Adds a plane that cuts the statue.
    pub fn add_section(&mut self, plane: Plane) {
        if self.session().sections.len() >= SECTIONS_MAX {
            self.problems.push(format!("at most {SECTIONS_MAX} sections: remove one first"));
            return;
        }
        self.history.edit("section", |session| {
            let name = format!("Section {}", session.sections.len() + 1);
            Arc::make_mut(&mut session.sections).push(SectionPlane {
                name,
                normal: plane.normal.to_array(),
                offset: plane.offset,
                shown: true,
                opens: false,
            });
        });
        self.cut_again();
    }

    /// Writes the sections that are shown as drawings at 1:1, for printers and for CAD, beside the
    /// session.
    pub fn draw_sections(&mut self) {
        let outlines = self.outlines.iter().flatten().filter_map(|o| o.section.as_ref());
        let families = outlines.map(|(section, _)| vec![(**section).clone()]).collect();
        let sheet = Sheet::new(&self.file, &self.header, None, families);
        let sheet = sheet.about(self.metadata.as_ref());
        let beside = self.session_path().unwrap_or_else(|| PathBuf::from("sections"));
        let stem = self.file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let names = |n: u32| {
            ["svg", "dxf"].map(|end| beside.with_file_name(format!("{stem}-sections-{n:03}.{end}")))
        };
        let written = || {
            let free = (1..1000).map(names).find(|n| n.iter().all(|name| !name.exists()));
            let [svg, dxf] = free.ok_or_else(|| {
                RenderError::Usage("999 drawings of sections are there already".into())
            })?;
            let (drawn, for_cad) = (sheet.to_svg(1.0)?, sheet.to_dxf()?);
            write_whole(&svg, &drawn)?;
            write_whole(&dxf, &for_cad)?;
            Ok(format!("saved {} and .dxf", svg.display()))
        };
        match written() {
            Ok(saved) => self.saved = Some(saved),
            Err::<_, RenderError>(error) => self.problems.push(error.to_string()),
        }
    }

    /// Asks for the lines of planes that are others than before.
    fn cut_again(&mut self) {
        let planes: Vec<Option<Plane>> =
            self.session().sections.iter().map(|s| s.shown.then(|| s.plane())).collect();
        self.outlines.resize_with(planes.len(), || None);
        for (number, plane) in planes.into_iter().enumerate() {
            let known = self.outlines[number].as_ref().map(|outline| outline.plane);
            if known == plane {
                continue;
            }
            let before = self.outlines[number].take();
            if let Some(plane) = plane {
                // The last lines stay until there are new ones.
                let section = before.and_then(|outline| outline.section);
                self.outlines[number] = Some(Outline { plane, section });
                self.clerk.ask(Question::Section { number, plane });
            }
        }
    }

    fn cut(&mut self, number: usize, plane: Plane, section: Result<Box<Section>, RenderError>) {
        let Some(Some(outline)) = self.outlines.get_mut(number) else { return };
        if outline.plane != plane {
            return;
        }
        match section {
            Ok(section) => {
                let measures = section.measures();
                outline.section = Some((section, measures));
            }
            Err(error) => {
                outline.section = None;
                self.problems.push(error.to_string());
            }
        }
    }
}
