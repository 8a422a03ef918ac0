//! Reads the scan's own geometry for the tools, on a thread of its own: no frame waits for it.

use std::path::PathBuf;
use std::sync::mpsc;

use glam::DVec3;

use crate::clip::ClipPlanes;
use crate::error::RenderError;
use crate::extents::extents;
use crate::leaves::Leaves;
use crate::measure::{Measured, MeasurementKind, SurfacePoint, measure};
use crate::pick::{Hit, first_hit};
use crate::section::{Plane, Section, cut};

/// What is asked for.
#[derive(Debug, Clone)]
pub enum Question {
    /// What a ray meets, and what a pixel stands for at a depth along it.
    Pick {
        /// Source coordinates.
        origin: DVec3,
        /// Of length 1.
        direction: DVec3,
        /// What is not drawn is not picked.
        clip: ClipPlanes,
    },
    /// A measurement between points.
    Measure {
        /// Of what.
        kind: MeasurementKind,
        /// Between which points.
        points: Vec<SurfacePoint>,
        /// A region that a note marks, not a measurement.
        of_note: bool,
    },
    /// Where a plane meets the scan.
    Section {
        /// Which of the session's planes it is.
        number: usize,
        /// The plane.
        plane: Plane,
    },
    /// How far the statue reaches along these directions.
    Extents([DVec3; 3]),
}

/// What came of it.
pub enum Answer {
    /// Of [`Question::Pick`].
    Picked(Result<Option<Hit>, RenderError>),
    /// Of [`Question::Measure`].
    Measured {
        /// Of what.
        kind: MeasurementKind,
        /// Between which points.
        points: Vec<SurfacePoint>,
        /// Whether a note asked.
        of_note: bool,
        /// The result.
        result: Result<Measured, RenderError>,
    },
    /// Of [`Question::Section`].
    Cut {
        /// Which plane it was.
        number: usize,
        /// The plane.
        plane: Plane,
        /// The lines.
        section: Result<Box<Section>, RenderError>,
    },
    /// Of [`Question::Extents`]: the least and the most along each.
    Reached([DVec3; 3], Result<[[f64; 2]; 3], RenderError>),
}

/// The thread, seen from the window.
pub struct Clerk {
    questions: mpsc::Sender<Question>,
    answers: mpsc::Receiver<Option<Answer>>,
    /// Asked and not yet answered.
    open: usize,
}

impl Clerk {
    /// For one file; `wake` is called when there is an answer.
    pub fn new(file: PathBuf, wake: impl Fn() + Send + 'static) -> Clerk {
        let (questions, asked) = mpsc::channel::<Question>();
        let (answer, answers) = mpsc::channel();
        // It ends when the window does: nobody asks any more. Nothing is lost with it.
        std::thread::spawn(move || {
            let mut leaves = None;
            let mut waiting = std::collections::VecDeque::new();
            while let Some(question) = waiting.pop_front().or_else(|| asked.recv().ok()) {
                waiting.extend(asked.try_iter());
                let answered = respond(&file, &mut leaves, question, &waiting);
                if answer.send(answered).is_err() {
                    return;
                }
                wake();
            }
        });
        Clerk { questions, answers, open: 0 }
    }

    /// Asks something.
    pub fn ask(&mut self, question: Question) {
        if self.questions.send(question).is_ok() {
            self.open += 1;
        }
    }

    /// The next answer that has come, if any has.
    pub fn answer(&mut self) -> Option<Answer> {
        loop {
            let answer = self.answers.try_recv().ok()?;
            self.open = self.open.saturating_sub(1);
            if let Some(answer) = answer {
                return Some(answer);
            }
        }
    }

    /// Whether something is being read.
    pub fn is_busy(&self) -> bool {
        self.open > 0
    }
}

/// What a ray meets of what is drawn.
fn pick(
    leaves: &Leaves,
    origin: DVec3,
    direction: DVec3,
    clip: &ClipPlanes,
) -> Result<Option<Hit>, RenderError> {
    let Some((from, to)) = clip.interval(origin, direction) else { return Ok(None) };
    let hit = first_hit(leaves, origin + direction * from, direction)?;
    Ok(hit.filter(|hit| from + hit.distance <= to))
}

/// Answers one question, unless a later one makes it needless.
fn respond(
    file: &std::path::Path,
    known: &mut Option<Leaves>,
    question: Question,
    later: &std::collections::VecDeque<Question>,
) -> Option<Answer> {
    if let Question::Section { number, .. } = question {
        // A plane that is being dragged: only its last place counts.
        let again = |q: &Question| matches!(q, Question::Section { number: n, .. } if *n == number);
        if later.iter().any(again) {
            return None;
        }
    }
    let opened = match known.take() {
        Some(leaves) => Ok(leaves),
        None => Leaves::open(file),
    };
    let leaves = opened.map(|leaves| &*known.insert(leaves));
    Some(match question {
        Question::Pick { origin, direction, clip } => {
            Answer::Picked(leaves.and_then(|l| pick(l, origin, direction, &clip)))
        }
        Question::Measure { kind, points, of_note } => {
            let result = leaves.and_then(|l| measure(l, kind, &points));
            Answer::Measured { kind, points, of_note, result }
        }
        Question::Section { number, plane } => {
            let section = leaves.and_then(|l| cut(l, &plane, None)).map(Box::new);
            Answer::Cut { number, plane, section }
        }
        Question::Extents(axes) => Answer::Reached(axes, leaves.and_then(|l| extents(l, axes))),
    })
}
