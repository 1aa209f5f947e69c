//! The paper's pipeline as printed: scale by the bounding boxes (Eq. 1-4), Super4PCS, then iterative closest points
//! with a clamped scale (Eq. 5-7). For comparison, and fast where most of the model is seen.
//!
//! Pairs go from the model to the view, source to target, as the paper states them; a partial view then draws the
//! scale down to the clamp. What it finds is held to the same evidence as everything else.

use arthro_geometry::Point3;
use arthro_geometry::cloud::bounds;
use rayon::prelude::*;

use crate::budget::Budget;
use crate::error::Error;
use crate::evidence;
use crate::pipeline::{Event, Iteration};
use crate::problem::{Candidate, Likeness, Problem};
use crate::scale::ScaleRange;
use crate::scaled_icp;
use crate::super4pcs::{self, Thinned};

/// How far the fine stage's scale may be from the bounding boxes', as factors (section 2.3 of the paper).
const CLAMP: [f64; 2] = [0.8, 1.2];
/// Poses of the coarse stage that are told apart, and those that are refined: the paper keeps one.
const REFINED: usize = 1;
const DISTINCT: Likeness = Likeness {
    degrees: 10.0,
    units: 3.0,
    log_scale: 0.1,
};

/// Model samples searched for congruent sets, and view samples that bases are drawn from.
const MODEL_POINTS: usize = 450;
const VIEW_POINTS: usize = 120;
/// Super4PCS: bases drawn, poses kept of each, how exact a congruence must be, units.
const BASES: usize = 24;
const KEPT_PER_BASE: usize = 4;
const TOLERANCE_UNITS: f64 = 1.3;

/// Distinct candidates, best first.
///
/// # Errors
/// [`Error::Cancelled`]; [`Error::NothingFound`] if no congruent set exists.
pub fn candidates(
    problem: &Problem,
    seed: u64,
    progress: &mut (dyn FnMut(Event) + Send),
    budget: &Budget,
) -> Result<Vec<Candidate>, Error> {
    progress(Event::CoarseStarted);
    let scale = aabb_scale(problem);
    let coarse = coarse(problem, scale, seed, budget)?;
    for (rank, candidate) in coarse.iter().enumerate() {
        progress(evidence::of_coarse(problem, rank, candidate));
    }
    progress(Event::FineStarted);
    let clamp = problem.allowed.intersection(&ScaleRange {
        low: scale * CLAMP[0],
        high: scale * CLAMP[1],
    });
    let mut refined = Vec::with_capacity(coarse.len());
    for (rank, candidate) in coarse.into_iter().enumerate() {
        budget.check()?;
        if rank >= REFINED {
            refined.push(candidate);
            continue;
        }
        let mut state = |iteration: u32, state: Iteration| {
            progress(Event::Iteration {
                candidate: rank as u32,
                iteration,
                state,
            });
        };
        let pose = scaled_icp::refine(problem, candidate.coarse, clamp, &mut state);
        refined.push(problem.candidate(candidate.coarse, pose, &problem.view.dense));
    }
    Ok(refined)
}

/// Eq. 1-4: the ratio of the bounding boxes' diagonals, within what the sensors allow.
///
/// A view's box is that of a part in a turned pose, tens of percent off; the limit is what carries the answer.
fn aabb_scale(problem: &Problem) -> f64 {
    let diagonal =
        |points: &[Point3]| bounds(points).map_or(0.0, |(low, high)| (high - low).norm());
    let ratio = diagonal(&problem.view.dense.points) / diagonal(&problem.model.points);
    problem.allowed.clamp(ratio)
}

fn coarse(
    problem: &Problem,
    scale: f64,
    seed: u64,
    budget: &Budget,
) -> Result<Vec<Candidate>, Error> {
    let Problem { model, view, .. } = problem;
    let settings = super4pcs::Settings {
        bases: BASES,
        tolerance_mm: TOLERANCE_UNITS * model.unit_mm,
        scale,
        kept_per_base: KEPT_PER_BASE,
    };
    let thin_model = Thinned::new(&model.points, MODEL_POINTS);
    let thin_view = Thinned::new(&view.dense.points, VIEW_POINTS);
    let found = super4pcs::search(&thin_model, model, &thin_view, &settings, seed);
    budget.check()?;
    let candidates: Vec<Candidate> = found
        .into_par_iter()
        .map(|found| problem.candidate(found.pose, found.pose, &view.medium))
        .collect();
    if candidates.is_empty() {
        return Err(Error::NothingFound);
    }
    Ok(problem.distinct(candidates, 8, &DISTINCT))
}
