//! What clicks on the surface are for: a pure state machine.

use crate::measure::{MeasurementKind, SurfacePoint};
use crate::session::NoteShape;

/// What is being made of points on the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    /// A measurement.
    Measure(MeasurementKind),
    /// A note.
    Note(NoteShape),
    /// A plane through three points that cuts the statue.
    Section,
    /// How the statue stands.
    Stand(Standing),
    /// A length that is known.
    Scale,
}

/// How it is said how the statue stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standing {
    /// By an origin, a point above and one to the front.
    Points,
    /// By a plane that it stands on.
    Ground,
    /// By a plane that is its front.
    Face,
}

impl Task {
    /// All of them, in the panel's order.
    pub const ALL: [Task; 14] = [
        Task::Measure(MeasurementKind::Point),
        Task::Measure(MeasurementKind::Distance),
        Task::Measure(MeasurementKind::Polyline),
        Task::Measure(MeasurementKind::Angle),
        Task::Measure(MeasurementKind::SurfaceLength),
        Task::Measure(MeasurementKind::SurfaceArea),
        Task::Note(NoteShape::Point),
        Task::Note(NoteShape::Polyline),
        Task::Note(NoteShape::Region),
        Task::Section,
        Task::Stand(Standing::Points),
        Task::Stand(Standing::Ground),
        Task::Stand(Standing::Face),
        Task::Scale,
    ];

    /// Its name in the panel.
    pub fn name(self) -> &'static str {
        match self {
            Task::Measure(MeasurementKind::Point) => "point",
            Task::Measure(MeasurementKind::Distance) => "distance",
            Task::Measure(MeasurementKind::Polyline) => "polyline",
            Task::Measure(MeasurementKind::Angle) => "angle",
            Task::Measure(MeasurementKind::SurfaceLength) => "along the surface",
            Task::Measure(MeasurementKind::SurfaceArea) => "area",
            Task::Note(NoteShape::Point) => "place",
            Task::Note(NoteShape::Polyline) => "line",
            Task::Note(NoteShape::Region) => "region",
            Task::Section => "through three points",
            Task::Stand(Standing::Points) => "foot, above, front",
            Task::Stand(Standing::Ground) => "stands on",
            Task::Stand(Standing::Face) => "its face",
            Task::Scale => "a known length",
        }
    }

    /// What it is for, where that takes more words than its name.
    pub fn explained(self) -> &'static str {
        match self {
            Task::Stand(Standing::Points) => {
                "three points: where its axis begins, one straight above, one to its front"
            }
            Task::Stand(Standing::Ground) => "three or more points of a plane that it stands on",
            Task::Stand(Standing::Face) => "three or more points of a plane that is its front",
            Task::Scale => "two points whose distance was measured on the statue itself",
            Task::Section => "three points of a plane",
            _ => "",
        }
    }

    /// The fewest and the most points that it takes.
    pub fn points(self) -> (usize, usize) {
        match self {
            Task::Measure(kind) => kind.points(),
            Task::Note(NoteShape::Point) => (1, 1),
            Task::Note(shape) => (shape.points_min(), usize::MAX),
            Task::Section | Task::Stand(Standing::Points) => (3, 3),
            Task::Stand(_) => (3, usize::MAX),
            Task::Scale => (2, 2),
        }
    }

    /// Whether the last point is joined to the first.
    pub fn is_closed(self) -> bool {
        matches!(
            self,
            Task::Measure(MeasurementKind::SurfaceArea)
                | Task::Note(NoteShape::Region)
                | Task::Section
                | Task::Stand(Standing::Ground | Standing::Face)
        )
    }
}

/// A task and the points that were picked for it.
#[derive(Debug, Clone, PartialEq)]
pub struct Tool {
    /// What it is for.
    pub task: Task,
    /// In the order in which they were picked.
    pub points: Vec<SurfacePoint>,
}

impl Tool {
    /// With nothing picked.
    pub fn new(task: Task) -> Tool {
        Tool { task, points: Vec::new() }
    }

    /// Adds a point. Returns all of them when there are as many as the task takes, and begins anew.
    pub fn add(&mut self, point: SurfacePoint) -> Option<Vec<SurfacePoint>> {
        self.points.push(point);
        (self.points.len() >= self.task.points().1).then(|| std::mem::take(&mut self.points))
    }

    /// Ends with the points there are, if they are enough, and begins anew.
    pub fn finish(&mut self) -> Option<Vec<SurfacePoint>> {
        (self.points.len() >= self.task.points().0).then(|| std::mem::take(&mut self.points))
    }

    /// What to do next.
    pub fn hint(&self) -> String {
        let (least, most) = self.task.points();
        let picked = self.points.len();
        let name = self.task.name();
        let more = match (picked < least, picked + 1 >= most) {
            (true, _) => format!("click point {} of {}", picked + 1, least),
            (false, false) => "click more points, Enter ends".to_owned(),
            (false, true) => "click the last point".to_owned(),
        };
        let back = if picked > 0 { ", Backspace takes one back" } else { "" };
        format!("{name}: {more}{back}, Esc leaves")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f64) -> SurfacePoint {
        SurfacePoint {
            position: [x, 0.0, 0.0],
            normal: [0.0, 0.0, 1.0],
            file_bound: 0.0,
            pixel_length: None,
        }
    }

    #[test]
    fn tools_end_by_themselves_or_when_asked_and_never_with_too_few_points() {
        let mut distance = Tool::new(Task::Measure(MeasurementKind::Distance));
        assert!(distance.add(point(0.0)).is_none() && distance.finish().is_none());
        assert_eq!(distance.add(point(1.0)).map(|p| p.len()), Some(2));
        assert!(distance.points.is_empty(), "the next one begins anew");

        let mut line = Tool::new(Task::Note(NoteShape::Polyline));
        for i in 0..5 {
            assert!(line.add(point(f64::from(i))).is_none());
        }
        assert_eq!(line.finish().map(|p| p.len()), Some(5));
        for task in Task::ALL {
            assert!(task.points().0 <= task.points().1);
            assert!(Tool::new(task).hint().contains("point 1"), "{}", Tool::new(task).hint());
        }
    }
}
