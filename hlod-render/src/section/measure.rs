//! What is measured of a section.

use glam::{DVec2, DVec3};

use super::circle::{Circle, NoCircle};
use super::{Frame, Line, Section};

/// Measures of a section's lines.
#[derive(Debug, Clone, PartialEq)]
pub struct Measures {
    /// How many lines are closed, and how many end.
    pub closed: usize,
    /// See [`Measures::closed`].
    pub open: usize,
    /// Length of all lines, in the source's unit.
    pub length: f64,
    /// What closed lines enclose, in the square of the source's unit: hollows are subtracted. The whole
    /// section of what is solid only where no line is open and none runs against its triangles
    /// ([`Measures::area_is_whole`]).
    pub area: f64,
    /// Whether the area is that of all that is solid.
    pub area_is_whole: bool,
    /// Smallest and largest coordinates in the section's frame; `None` without lines.
    pub bounds: Option<[DVec2; 2]>,
    /// The circle that all lines together fit best, in the section's frame.
    pub circle: Result<Circle, NoCircle>,
}

impl Section {
    /// Length, area, bounds and the circle of best fit.
    pub fn measures(&self) -> Measures {
        let closed = self.lines.iter().filter(|line| line.closed).count();
        let open = self.lines.len() - closed;
        let length: f64 = self.lines.iter().map(Line::length).sum();
        Measures {
            closed,
            open,
            length,
            area: self.lines.iter().map(|line| line.area(&self.frame)).sum(),
            area_is_whole: open == 0 && self.contrary == 0.0,
            bounds: self.bounds(),
            circle: Circle::fit(self.lines.iter().flat_map(|line| line.segments(&self.frame))),
        }
    }

    /// Smallest and largest coordinates in the section's frame; `None` without lines.
    pub fn bounds(&self) -> Option<[DVec2; 2]> {
        let points = self.lines.iter().flat_map(|line| &line.points);
        points.map(|p| self.frame.to_plane(*p)).fold(None, |bounds, q| match bounds {
            None => Some([q, q]),
            Some([min, max]) => Some([q.min(min), q.max(max)]),
        })
    }
}

impl Line {
    /// Its length in the source's unit.
    pub fn length(&self) -> f64 {
        self.pairs().map(|[a, b]| a.distance(b)).sum()
    }

    /// What a closed line encloses in a drawing, in the square of the source's unit: positive for
    /// outer outlines, negative for hollows, 0 for open lines.
    pub fn area(&self, frame: &Frame) -> f64 {
        let (true, Some(first)) = (self.closed, self.points.first()) else { return 0.0 };
        // From one of its own points, so that far from the origin nothing is lost.
        let first = frame.to_plane(*first);
        let twice = |[a, b]: [DVec2; 2]| (a - first).perp_dot(b - first);
        0.5 * self.segments(frame).map(twice).sum::<f64>()
    }

    /// The circle that it fits best.
    ///
    /// # Errors
    /// When it has too few points or is straight.
    pub fn circle(&self, frame: &Frame) -> Result<Circle, NoCircle> {
        Circle::fit(self.segments(frame))
    }

    /// Its segments in a drawing.
    pub(super) fn segments<'a>(
        &'a self,
        frame: &'a Frame,
    ) -> impl Iterator<Item = [DVec2; 2]> + Clone + 'a {
        self.pairs().map(|pair| pair.map(|p| frame.to_plane(p)))
    }

    /// Points that follow one another; of a closed line also the last and the first.
    fn pairs(&self) -> impl Iterator<Item = [DVec3; 2]> + Clone + '_ {
        let back = self.points.first().filter(|_| self.closed);
        self.points.iter().zip(self.points[1..].iter().chain(back)).map(|(a, b)| [*a, *b])
    }
}
