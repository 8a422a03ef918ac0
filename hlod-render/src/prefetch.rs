//! What is read before it is wanted: of receivers and of what casts shadows on them, one plan.

use std::time::{Duration, Instant};

use glam::DMat4;
use hlod_compress::RepresentationKind;

use crate::casters::Casting;
use crate::casters::ahead::{CastersAhead, Outlook, SLICE_ENDS, receivers_of};
use crate::frame::selection;
use crate::model::Model;
use crate::need::{Budget, LightTracker, Need, PaceTracker, Plan, Timing, plan_by};
use crate::residency::{CASTERS_LATER_SECS, horizon_secs, page_bytes};
use crate::scene::Shot;
use crate::select::View;
use crate::skeleton::Skeleton;

/// Plans now and then for what is drawn.
#[derive(Debug)]
pub(crate) struct Prefetch {
    pace: PaceTracker,
    light: LightTracker,
    begun: Instant,
    planned: Option<Instant>,
    /// When the last frame began, and how long frames took lately.
    last_frame: Option<Instant>,
    frame_secs: f64,
}

/// A model of which something may be read ahead.
pub(crate) struct Shown<'a> {
    pub(crate) skeleton: &'a Skeleton,
    pub(crate) world_from_model: DMat4,
    pub(crate) need: Need<'a>,
    pub(crate) budget: Budget<'a>,
}

/// What each model may want within the horizon; of casters where there is an outlook, which is
/// that of all of them.
pub(crate) fn plans(
    models: &[Shown<'_>],
    outlook: Option<&Outlook<'_>>,
    horizon_secs: f64,
) -> Vec<Plan> {
    let within = |secs: f64| {
        models.iter().map(move |m| plan_by(&m.need, m.skeleton, secs, m.budget)).collect::<Vec<_>>()
    };
    let complete =
        |m: &Shown<'_>, plan: Plan, kind| plan.with_ancestors(kind, m.skeleton, m.budget);
    let receivers_of_all = |plans: Vec<Plan>| {
        let with_model = models.iter().zip(plans);
        with_model.map(|(m, plan)| complete(m, plan, m.need.kind())).collect::<Vec<_>>()
    };
    let Some(outlook) = outlook else { return receivers_of_all(within(horizon_secs)) };
    let receivers = within(SLICE_ENDS.into_iter().fold(horizon_secs, f64::max));
    let boxes: Vec<_> = models
        .iter()
        .zip(&receivers)
        .flat_map(|(m, plan)| receivers_of(plan, m.skeleton, &m.world_from_model))
        .collect();
    let with_casters = |(m, plan): (&Shown<'_>, Plan)| {
        let ahead = CastersAhead::new(outlook, &boxes, m.world_from_model, &SLICE_ENDS);
        let casters = ahead.plan(m.skeleton, m.budget.bytes, m.budget.bytes_of);
        let casters = complete(m, casters, RepresentationKind::Geometric);
        let casters = casters.later_by(CASTERS_LATER_SECS);
        plan.merged(casters, m.skeleton, m.budget).until(horizon_secs)
    };
    models.iter().zip(receivers_of_all(receivers)).map(with_casters).collect()
}

impl Default for Prefetch {
    fn default() -> Self {
        Prefetch {
            pace: PaceTracker::default(),
            light: LightTracker::default(),
            begun: Instant::now(),
            planned: None,
            last_frame: None,
            frame_secs: 0.0,
        }
    }
}

impl Prefetch {
    fn note_frame(&mut self, now: Instant) {
        // Who rests draws no frames.
        const PAUSE: Duration = Duration::from_millis(400);
        let before = self.last_frame.replace(now).map(|before| now.duration_since(before));
        if let Some(took) = before.filter(|took| *took < PAUSE) {
            self.frame_secs += (took.as_secs_f64() - self.frame_secs) / 8.0;
        }
    }

    /// Looks ahead, now and then: what will be wanted if eye and light go on as they did lately.
    pub(crate) fn plan(&mut self, models: &mut [Model], shot: &Shot, size: (u32, u32)) {
        const EVERY: Duration = Duration::from_millis(50);
        let now = Instant::now();
        self.note_frame(now);
        let secs = now.duration_since(self.begun).as_secs_f64();
        let heights = models.iter().map(|m| m.bounds()).map(|(low, high)| (high - low).length());
        let height = heights.fold(0.0, f64::max);
        let pace = self.pace.note(secs, &shot.camera, height);
        let light_speed = self.light.note(secs, &shot.light, height);
        if self.planned.is_some_and(|planned| now.duration_since(planned) < EVERY)
            || !models.iter().any(Model::reads_ahead)
        {
            return;
        }
        self.planned = Some(now);
        let outlook = shot.shadow.is_cast().then(|| Outlook {
            casting: Casting::of_shot(shot),
            camera: &shot.camera,
            size,
            pace,
            light_speed,
        });
        let views: Vec<View> =
            models.iter().map(|m| View::of_shot(shot, m.world_from_model(), size)).collect();
        let shown: Vec<Shown<'_>> = models
            .iter()
            .zip(&views)
            .map(|(m, view)| Shown {
                skeleton: m.skeleton(),
                world_from_model: m.world_from_model(),
                need: Need::new(view, selection(shot), pace),
                budget: Budget { bytes: m.room_bytes(), bytes_of: &page_bytes },
            })
            .collect();
        let plans = plans(&shown, outlook.as_ref(), horizon_secs(self.frame_secs));
        for (model, plan) in models.iter_mut().zip(plans) {
            if model.reads_ahead() {
                model.expect(plan);
            }
        }
    }
}
