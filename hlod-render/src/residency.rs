//! Which parts are asked for, and which pages make room: one policy for what is drawn
//! ([`crate::Model`]) and for what is only simulated ([`crate::simulate`]).

use std::collections::{HashMap, HashSet};

use crate::arena::ArenaSize;
use crate::loader::{Part, Ticket};
use crate::need::Plan;
use crate::select::{Wanted, block_ticket, page_ticket};
use crate::skeleton::{Node, Skeleton};

/// A node and one of its representations.
pub type Page = (u32, usize);

/// Pages that are due within this time are asked for. Due times are the earliest possible, several times
/// shorter than what usually passes: a tenth of a second is enough for links of 20 ms and 10 MB/s, and
/// more only reads more that is never drawn (`hlod-render simulate`).
pub const HORIZON_SECS: f64 = 0.1;

/// The same where frames take so long. What is asked for in one frame is drawn in the next at the earliest, and plans
/// are as old as a frame by then: what frames take longer than a thirtieth of a second counts twice.
pub(crate) fn horizon_secs(frame_secs: f64) -> f64 {
    let slower = (frame_secs - 1.0 / 30.0).clamp(0.0, 0.2);
    HORIZON_SECS + 2.0 * slower
}

/// Casters are asked for as if they were due so much later than they are, and make room sooner: shadows that are
/// too coarse show less than surfaces that are. Where a link has to choose between the two, asking for both
/// alike leaves surfaces coarse, and does not even help shadows, which fall on these
/// (`bench-paths/NOTES.md`, "Streaming").
pub const CASTERS_LATER_SECS: f64 = 0.05;

/// When pages will be wanted, no two at the same time; what is not there is not expected.
pub type DueTimes = HashMap<Page, f64>;

/// Due times of a plan's pages. Of what is due at once the first of the plan comes first, by a billionth of a second.
pub fn due_times(plan: &Plan) -> DueTimes {
    let ranked = plan.pages.iter().enumerate();
    ranked.map(|(rank, due)| (due.what, due.secs + rank as f64 * 1e-9)).collect()
}

/// Bytes on the GPU that a page takes, about.
pub(crate) fn page_bytes(node: &Node, representation: usize) -> u64 {
    let r = &node.representations[representation];
    ArenaSize::bytes_of(r.vertices.into(), r.triangles.into(), r.points.into())
}

/// Pages that were read ahead and found no room. At the edge of a budget they would be read again at once, and
/// dropped again: they are not read ahead for a while, each time for twice as long, unless they become due much sooner,
/// when they may find room. What frames want is asked for all the same.
#[derive(Debug, Default)]
pub(crate) struct Refused {
    pages: HashMap<Page, Refusal>,
}

#[derive(Debug)]
struct Refusal {
    times: u32,
    until_frame: u64,
    /// When the page was due.
    due_secs: f64,
}

/// About a second.
const REFUSED_FRAMES: u64 = 32;
/// A page is due much sooner than before where it is due in so much of that time.
const SOONER: f64 = 0.75;

impl Refused {
    /// A page that is due in so many seconds found no room in a frame.
    pub(crate) fn note(&mut self, page: Page, due_secs: f64, frame: u64) {
        let before = self.pages.remove(&page);
        let times = before.filter(|r| !r.is_past(due_secs)).map_or(0, |r| r.times);
        let until_frame = frame + (REFUSED_FRAMES << times.min(5));
        self.pages.insert(page, Refusal { times: times + 1, until_frame, due_secs });
    }

    /// It found room.
    pub(crate) fn forget(&mut self, page: Page) {
        self.pages.remove(&page);
    }

    /// Whether it may be read ahead, being due in so many seconds.
    pub(crate) fn allows(&self, page: Page, due_secs: f64, frame: u64) -> bool {
        let refusal = self.pages.get(&page);
        refusal.is_none_or(|r| frame >= r.until_frame || r.is_past(due_secs))
    }
}

impl Refusal {
    /// Whether it says nothing of a page that is due in so many seconds.
    fn is_past(&self, due_secs: f64) -> bool {
        due_secs < SOONER * self.due_secs
    }
}

/// Everything to ask for, the most urgent first: what frames lack, in their order, then what will be
/// wanted, the earliest first. `has` says what is here already or must not be asked for again, `allows` what
/// may be read ahead.
pub fn requests(
    wanted: &mut [&Wanted],
    plan: &Plan,
    skeleton: &Skeleton,
    has: &dyn Fn(Ticket) -> bool,
    allows: &dyn Fn(Page) -> bool,
) -> Vec<(Ticket, Part)> {
    wanted.sort_by(|a, b| b.urgency.total_cmp(&a.urgency).then(a.ticket.cmp(&b.ticket)));
    let pages = plan.pages.iter().filter(|due| allows(due.what)).map(|due| {
        let (node, representation) = due.what;
        let of = &skeleton.nodes()[node as usize];
        let r = of.representations[representation];
        (due.secs, page_ticket(node, representation), Part::Page(r.page, of.cell, r.kind))
    });
    let blocks = plan.blocks.iter().map(|due| {
        let (node, block) = due.what;
        (due.secs, block_ticket(node), Part::Block(block))
    });
    let mut planned: Vec<(f64, Ticket, Part)> = pages.chain(blocks).collect();
    planned.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut asked = HashSet::new();
    let wanted = wanted.iter().map(|w| (w.ticket, w.part));
    wanted
        .chain(planned.into_iter().map(|(_, ticket, part)| (ticket, part)))
        .filter(|(ticket, _)| !has(*ticket) && asked.insert(*ticket))
        .collect()
}

/// The page that makes room for one that is wanted in `for_secs`: of those that the last frame did not
/// draw the one that will be wanted last, or was drawn the longest ago. `None` where all are wanted
/// sooner. The root stays: there is always something to draw.
pub fn victim(
    resident: impl Iterator<Item = (Page, u64)>,
    frame: u64,
    due: &DueTimes,
    for_secs: f64,
) -> Option<Page> {
    let due_of = |page: &Page| due.get(page).copied().unwrap_or(f64::INFINITY);
    resident
        .filter(|(page, last_used)| page.0 != 0 && last_used + 1 < frame)
        .filter(|(page, _)| due_of(page) > for_secs)
        .min_by(|(a, used_a), (b, used_b)| {
            due_of(b).total_cmp(&due_of(a)).then(used_a.cmp(used_b)).then(a.cmp(b))
        })
        .map(|(page, _)| page)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_found_no_room_is_not_read_ahead_for_longer_and_longer() {
        let mut refused = Refused::default();
        assert!(refused.allows((1, 0), 0.1, 0));
        let mut frame = 100;
        let mut waits = Vec::new();
        for _ in 0..8 {
            refused.note((1, 0), 0.1, frame);
            let begin = frame;
            while !refused.allows((1, 0), 0.1, frame) {
                frame += 1;
            }
            waits.push(frame - begin);
        }
        assert_eq!(waits, [32, 64, 128, 256, 512, 1024, 1024, 1024]);
        assert!(refused.allows((2, 0), 0.1, 101), "others are");
        refused.note((1, 0), 0.1, frame);
        refused.forget((1, 0));
        assert!(refused.allows((1, 0), 0.1, frame));
    }

    #[test]
    fn what_becomes_due_much_sooner_may_find_room() {
        let mut refused = Refused::default();
        (0..5).for_each(|_| refused.note((1, 0), 0.1, 0));
        assert!(!refused.allows((1, 0), 0.1, 1) && !refused.allows((1, 0), 0.08, 1));
        assert!(refused.allows((1, 0), 0.07, 1));
        // Refused again, it waits for as long as one that was never refused.
        refused.note((1, 0), 0.07, 1);
        assert!(!refused.allows((1, 0), 0.07, 32) && refused.allows((1, 0), 0.07, 33));
    }

    #[test]
    fn what_is_due_at_once_keeps_the_plans_order() {
        let page = |node| crate::need::Due { secs: 0.0, what: (node, 0) };
        let plan = Plan { pages: vec![page(3), page(1), page(2)], ..Plan::default() };
        let due = due_times(&plan);
        assert!(due[&(3, 0)] < due[&(1, 0)] && due[&(1, 0)] < due[&(2, 0)]);
        let resident = [((1, 0), 5), ((2, 0), 5)].into_iter();
        assert_eq!(victim(resident, 10, &due, due[&(3, 0)]), Some((2, 0)));
    }

    #[test]
    fn what_is_wanted_last_makes_room() {
        let due = DueTimes::from([((1, 0), 0.5), ((2, 0), 2.0), ((3, 0), 0.0)]);
        let resident =
            [((0, 0), 1), ((1, 0), 5), ((2, 0), 5), ((3, 0), 9), ((4, 0), 6), ((5, 0), 4)];
        let choose = |without: &[u32], for_secs| {
            let left = resident.into_iter().filter(|(page, _)| !without.contains(&page.0));
            victim(left, 10, &due, for_secs).map(|page| page.0)
        };
        // Unexpected ones first, the oldest of them before the others; then the latest due.
        assert_eq!(choose(&[], -1.0), Some(5));
        assert_eq!(choose(&[5], -1.0), Some(4));
        assert_eq!(choose(&[5, 4], -1.0), Some(2));
        assert_eq!(choose(&[5, 4, 2], -1.0), Some(1));
        // Not for a page that is wanted later; never what was just drawn, nor the root.
        assert_eq!(choose(&[5, 4, 2], 0.7), None);
        assert_eq!(choose(&[5, 4, 2, 1], -1.0), None);
    }
}
