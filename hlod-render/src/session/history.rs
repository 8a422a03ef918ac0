//! Undo and redo: the states that a session has been in.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::Session;

/// Older steps are forgotten.
const STEPS_MAX: usize = 1000;
/// Changes of one thing that follow each other faster are one step, as those of a slider.
const ONE_GESTURE: Duration = Duration::from_millis(800);

/// A session and the steps that led to it.
#[derive(Debug, Clone)]
pub struct History {
    now: Session,
    past: VecDeque<Step>,
    future: Vec<Step>,
    adjusted: Option<(&'static str, Instant)>,
}

/// What was done, and the session on the other side of it.
#[derive(Debug, Clone)]
struct Step {
    what: &'static str,
    session: Session,
}

impl History {
    /// Begins with a session and nothing to undo.
    pub fn new(session: Session) -> History {
        History { now: session, past: VecDeque::new(), future: Vec::new(), adjusted: None }
    }

    /// The session as it is.
    pub fn session(&self) -> &Session {
        &self.now
    }

    /// Changes the session; `what` is the name of the step, as in "undo *what*". A change that changes
    /// nothing is no step. Returns whether it was one.
    pub fn edit(&mut self, what: &'static str, edit: impl FnOnce(&mut Session)) -> bool {
        self.adjusted = None;
        self.change(what, false, edit)
    }

    /// The same for what changes a little at a time, as a slider does: adjustments of the same thing
    /// that follow one another closely are one step.
    pub fn adjust(
        &mut self,
        what: &'static str,
        at: Instant,
        edit: impl FnOnce(&mut Session),
    ) -> bool {
        let continues = self
            .adjusted
            .is_some_and(|(last, when)| last == what && at.duration_since(when) < ONE_GESTURE);
        let changed = self.change(what, continues, edit);
        if changed {
            self.adjusted = Some((what, at));
        }
        changed
    }

    fn change(
        &mut self,
        what: &'static str,
        continues: bool,
        edit: impl FnOnce(&mut Session),
    ) -> bool {
        let mut session = self.now.clone();
        edit(&mut session);
        if session == self.now {
            return false;
        }
        let before = std::mem::replace(&mut self.now, session);
        if !continues {
            self.past.push_back(Step { what, session: before });
            if self.past.len() > STEPS_MAX {
                self.past.pop_front();
            }
        }
        self.future.clear();
        true
    }

    /// What would be undone.
    pub fn undoable(&self) -> Option<&'static str> {
        self.past.back().map(|step| step.what)
    }

    /// What would be done again.
    pub fn redoable(&self) -> Option<&'static str> {
        self.future.last().map(|step| step.what)
    }

    /// Takes the last step back. Returns whether there was one.
    pub fn undo(&mut self) -> bool {
        self.adjusted = None;
        let Some(step) = self.past.pop_back() else { return false };
        let after = std::mem::replace(&mut self.now, step.session);
        self.future.push(Step { what: step.what, session: after });
        true
    }

    /// Does again what was undone last. Returns whether there was anything.
    pub fn redo(&mut self) -> bool {
        self.adjusted = None;
        let Some(step) = self.future.pop() else { return false };
        let before = std::mem::replace(&mut self.now, step.session);
        self.past.push_back(Step { what: step.what, session: before });
        true
    }
}
