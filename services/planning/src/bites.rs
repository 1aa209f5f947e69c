//! Chooses the bites that clear the planned region: as few as will do, in an order in which each can
//! be made.
//!
//! Each bite costs a trip of the forceps to the tray, so that their number comes first. [`poses`] are
//! the bites to choose from; in [`problem`] they are sets of voxels, of which a partial cover is
//! sought: enough of the region, all of the lesion, not too much outside, and for every bite a moment
//! at which the throat of its jaw is free ([`order`]). A [`greedy`] choice comes first; then bites are
//! taken away and [`anneal`]ing seeks a set of the others from which nothing is missing, until it
//! fails or the [`bound`] is met: the least number that the prices of the voxels allow, or, for a few
//! bites around a lesion, what the [`exhaustion`] of all sets leaves. What was found is moved by
//! tenths of a millimetre ([`refine`]), which may spare one bite more. All of it follows from the
//! seed, on any number of threads; a deadline only ends it early.

mod anneal;
mod attempts;
mod bits;
mod bound;
mod exhaustion;
mod greedy;
mod order;
mod poses;
mod problem;
mod reachable;
mod refine;
mod search;
mod selection;
mod sequence;

use arthro_geometry::Point3;

use crate::error::Error;
use crate::evaluation::Task;
use crate::jaw::Bite;

use attempts::Attempts;
use poses::Ground;
use problem::Problem;
use reachable::Reachable;
use refine::Refinement;
use search::{FEW_MORE_BITES, MORE_BITES, Search};

/// What a set of bites has to keep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// Share of the region that has to go, 0..1.
    pub region_share: f64,
    /// How much may go outside it, mm3: what is aimed at, and what is taken where that is too little.
    pub outside_limits_mm3: [f64; 2],
    /// How much of a jaw's throat tissue may block when the bite is made, 0..1.
    pub throat_limit: f64,
    /// What to do where the region cannot be cleared.
    pub partial: Partial,
}

/// How long is searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effort {
    /// Same seed, same bites.
    pub seed: u64,
    /// Multiplies the exchanges that are tried for each number of bites; 1 is the usual.
    pub factor: u32,
}

/// What to do where the region cannot be cleared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Partial {
    /// Refuse and say what is missing.
    #[default]
    Refuse,
    /// Clear as much as can be cleared.
    Allow,
}

/// Where the forceps come from and what they may touch.
pub struct Access<'a> {
    /// The portals in the axes of the crescent, mm.
    pub portals: &'a [Point3],
    /// Whether a bite may be made through the portal with this index.
    pub allowed: &'a (dyn Fn(usize, &Bite) -> bool + Sync),
    /// Rim that must be left beyond the contour, mm.
    pub rim_min_mm: f64,
    /// How far in the plane an executed bite may lie from the planned one and still the lesion must
    /// be covered, mm. `None`: the lesion needs no more care than the region.
    pub placement_error_mm: Option<f64>,
}

/// The bites chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct Chosen {
    /// In the order of execution, each with the index of its portal.
    pub bites: Vec<(usize, Bite)>,
    /// No fewer bites from the coarse grid of poses, 0.2 mm, can clear enough, in whatever order.
    pub bound: usize,
    /// Whether everything that was to go goes.
    pub complete: bool,
    /// Why the search ended.
    pub ended: Ended,
}

/// Why a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The plan has no more bites than the bound.
    Optimal,
    /// The exchanges are used up.
    Effort,
    /// The time is.
    Deadline,
}

/// How far a search is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Share of the work, an estimate.
    pub fraction: f64,
    /// Bites of the best plan so far.
    pub incumbent: Option<usize>,
    /// The least number possible.
    pub bound: Option<usize>,
}

/// Whether to go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Patience {
    /// There is time.
    GoOn,
    /// Finish with what there is.
    Hurry,
    /// Nobody waits for it any more.
    Stop,
}

/// Chooses the bites. `watch` hears how far it is; `patience` is asked often and from several threads.
pub fn choose(
    task: &Task<'_>,
    access: &Access<'_>,
    rules: &Rules,
    effort: &Effort,
    patience: &(dyn Fn() -> Patience + Sync),
    watch: &mut dyn FnMut(Found),
) -> Result<Chosen, Error> {
    let region = task.region();
    let mut hear = |fraction, incumbent, bound| {
        watch(Found {
            fraction,
            incumbent,
            bound,
        });
        match patience() {
            Patience::Stop => Err(Error::Cancelled),
            Patience::Hurry if incumbent.is_none() => Err(Error::Deadline),
            Patience::Hurry | Patience::GoOn => Ok(()),
        }
    };
    let ground = Ground::of(task, &region, access);
    let problem_of = |poses| Problem::of(poses, &ground, rules);
    let poses = poses::over(&ground, |share| hear(0.3 * share, None, None))?;
    let mut problem = problem_of(poses);
    let mut complete = true;
    let reachable = Reachable::of(&problem);
    if let Some(refusal) = reachable.refusal(&problem, &ground, rules) {
        if rules.partial == Partial::Refuse {
            return Err(refusal);
        }
        complete = false;
        reachable.lower(&mut problem);
    }
    reachable.settle(&mut problem);
    hear(0.35, None, None)?;
    let attempts = Attempts {
        effort: *effort,
        patience,
    };
    // A tight limit first; what it does not allow may be allowed by the wide one.
    let [tight_mm3, wide_mm3] = rules.outside_limits_mm3;
    let mut search = Search::of(&problem, attempts);
    let mut started = begin(&mut search, &problem, access, attempts)?;
    let wider;
    if !started && wide_mm3 > tight_mm3 && attempts.go_on() {
        wider = problem.with_outside_limit(wide_mm3, task);
        search = Search::of(&wider, attempts);
        started = begin(&mut search, &wider, access, attempts)?;
    }
    if !started {
        if !attempts.go_on() {
            return Err(Error::Deadline);
        }
        if rules.partial == Partial::Refuse {
            return Err(reachable::of_closest(&search.best, task));
        }
        complete = false;
    }
    while search.improve()? {
        let (bites, bound) = (search.best.chosen.len(), search.bound);
        let share = bound as f64 / bites as f64;
        hear(0.4 + 0.4 * share, Some(bites), Some(bound))?;
    }
    let refinement = Refinement {
        ground: &ground,
        coarse: search.best.problem(),
        problem: &problem_of,
        attempts,
    };
    let mut places = search.best.places();
    if let (Ended::Effort, Some(closest)) = (search.ended, &search.closest) {
        places = refinement.fewer(closest, search.bound)?.unwrap_or(places);
        hear(0.9, Some(places.len()), Some(search.bound))?;
    }
    let ended = match places.len() {
        bites if bites <= search.bound => Ended::Optimal,
        _ => search.ended,
    };
    Ok(Chosen {
        bites: refinement.best(&places)?,
        bound: search.bound,
        complete,
        ended,
    })
}

/// Starts a search; whether it has a complete set. Of several portals the best alone comes first, so
/// that one more portal is never a loss.
fn begin(
    search: &mut Search<'_>,
    problem: &Problem,
    access: &Access<'_>,
    attempts: Attempts<'_>,
) -> Result<bool, Error> {
    if access.portals.len() > 1 {
        let mut best: Option<Vec<poses::Place>> = None;
        for portal in 0..access.portals.len() {
            let alone = problem.through(portal);
            if !Reachable::of(&alone).is_enough(&alone) {
                continue;
            }
            let mut search = Search::of(&alone, attempts);
            if !search.start(FEW_MORE_BITES)? {
                continue;
            }
            while search.improve()? {}
            let fewer = best
                .as_ref()
                .is_none_or(|best| search.best.chosen.len() < best.len());
            if fewer {
                best = Some(search.best.places());
            }
        }
        if let Some(best) = best {
            search.adopt(&best);
        }
    }
    search.start(MORE_BITES)
}
