//! The robust pipeline: every pose is tried on a sparse view, the best are refined on ever more points, and where the
//! answer does not convince, the search begins again with more effort. Deterministic on any number of threads.

use rayon::prelude::*;

use crate::budget::Budget;
use crate::error::Error;
use crate::evidence::{self, RIVAL, is_convincing};
use crate::pipeline::{Event, Iteration};
use crate::problem::{Candidate, Likeness, Pose, Problem};
use crate::robust::kernel::Kernel;
use crate::robust::search::Effort;
use crate::scale::ScaleRange;
use crate::view::{Seen, View};

mod equations;
mod kernel;
pub mod refine;
mod search;

/// One round of the search.
#[derive(Clone, Copy, Debug)]
struct Round {
    effort: Effort,
    /// Scales tried around the estimate by size, as factors of it.
    around_estimate: ScaleRange,
    /// Step between scales, as a logarithm; the refinement bridges what lies between.
    scale_step: f64,
    /// Distinct candidates refined on the medium view, and those of them finished on the dense one.
    refined: usize,
    finished: usize,
}

/// A part of the whole looks smaller, strays make it look larger.
const QUICK: Round = Round {
    effort: Effort {
        patches: 2,
        places: 130,
        turns: 14,
        drawn: 200,
        settled: 48,
    },
    around_estimate: ScaleRange {
        low: 0.75,
        high: 1.6,
    },
    scale_step: 0.14,
    refined: 28,
    finished: 5,
};
const THOROUGH: Round = Round {
    effort: Effort {
        patches: 4,
        places: 300,
        turns: 20,
        drawn: 800,
        settled: 200,
    },
    around_estimate: ScaleRange {
        low: 0.3,
        high: 3.3,
    },
    scale_step: 0.1,
    refined: 80,
    finished: 10,
};

/// Candidates nearer than this are one, after the search, after the medium view and at the end.
const SEARCHED: Likeness = Likeness {
    degrees: 5.0,
    units: 1.2,
    log_scale: 0.05,
};
const REFINED: Likeness = Likeness {
    degrees: 4.0,
    units: 1.0,
    log_scale: 0.03,
};

/// Clearly other poses that are finished beside the best ones.
const RIVALS: usize = 2;

/// One refinement of the fine stage.
#[derive(Clone, Copy, Debug)]
struct Stage {
    steps: u32,
    /// Residuals' deviation is taken as no less than this in the first step, units.
    first_deviation_units: f64,
}

/// On the medium view, from where the search left off; on the dense one, from there.
const MEDIUM: Stage = Stage {
    steps: 14,
    first_deviation_units: 0.5,
};
const DENSE: Stage = Stage {
    steps: 25,
    first_deviation_units: 0.1,
};

/// Distinct finished candidates, best first.
///
/// # Errors
/// [`Error::Cancelled`]; [`Error::NothingFound`] if the view has no patch to begin from.
pub fn candidates(
    problem: &Problem,
    progress: &mut (dyn FnMut(Event) + Send),
    budget: &Budget,
) -> Result<Vec<Candidate>, Error> {
    let quick = round(problem, &QUICK, progress, budget)?;
    if budget.is_hurried() || is_convincing(problem, &quick) {
        return Ok(quick);
    }
    let mut all = round(problem, &THOROUGH, progress, budget)?;
    all.extend(quick);
    Ok(problem.distinct(all, usize::MAX, &REFINED))
}

/// The best pose of the quick round, without events: for asking whether something else fits as well. `None` if nothing
/// fits at all.
pub fn best_quickly(problem: &Problem, budget: &Budget) -> Result<Option<Candidate>, Error> {
    let quick = Round {
        finished: 2,
        ..QUICK
    };
    match round(problem, &quick, &mut |_| {}, budget) {
        Ok(found) => Ok(found.into_iter().next()),
        Err(Error::NothingFound) => Ok(None),
        Err(error) => Err(error),
    }
}

/// The fine stage alone, from a pose that is known roughly.
pub fn refined_from(problem: &Problem, start: Pose, budget: &Budget) -> Result<Candidate, Error> {
    let mut candidates = vec![Candidate {
        coarse: start,
        pose: start,
        score: f64::INFINITY,
    }];
    for (stage, seen) in [
        (&MEDIUM, &problem.view.medium),
        (&DENSE, &problem.view.dense),
    ] {
        candidates = refine_all(problem, candidates, seen, stage, &mut |_| {}, budget)?;
    }
    candidates.into_iter().next().ok_or(Error::NothingFound)
}

fn round(
    problem: &Problem,
    round: &Round,
    progress: &mut (dyn FnMut(Event) + Send),
    budget: &Budget,
) -> Result<Vec<Candidate>, Error> {
    progress(Event::CoarseStarted);
    let searched = search_all_scales(problem, round, progress, budget)?;
    progress(Event::FineStarted);
    let View { medium, dense, .. } = &problem.view;
    let refined = refine_all(problem, searched, medium, &MEDIUM, progress, budget)?;
    let refined = finalists(problem, refined, round.finished);
    let finished = refine_all(problem, refined, dense, &DENSE, progress, budget)?;
    Ok(problem.distinct(finished, usize::MAX, &REFINED))
}

/// The best few, and the best of those that are clearly other poses: an answer is worth what its rivals are not.
fn finalists(problem: &Problem, refined: Vec<Candidate>, count: usize) -> Vec<Candidate> {
    let ranked = problem.distinct(refined, usize::MAX, &REFINED);
    let rivals: Vec<Candidate> = problem.distinct(ranked.clone(), RIVALS + 1, &RIVAL);
    let mut finalists: Vec<Candidate> = ranked.into_iter().take(count).collect();
    finalists.extend(rivals);
    problem.distinct(finalists, usize::MAX, &REFINED)
}

fn search_all_scales(
    problem: &Problem,
    round: &Round,
    progress: &mut (dyn FnMut(Event) + Send),
    budget: &Budget,
) -> Result<Vec<Candidate>, Error> {
    let kernel = Kernel::new(
        &problem.model,
        &problem.view.sparse,
        problem.stray_view_mm(),
    );
    let estimate = problem.scale_by_size;
    let likely = ScaleRange {
        low: estimate * round.around_estimate.low,
        high: estimate * round.around_estimate.high,
    };
    let scales = problem
        .allowed
        .intersection(&likely)
        .steps(round.scale_step, estimate);
    let mut found = Vec::new();
    for (index, scale) in scales.iter().enumerate() {
        if budget.is_hurried() && !found.is_empty() {
            break;
        }
        let candidates = search::at_scale(problem, &kernel, *scale, &round.effort, budget)?;
        found.extend(candidates);
        found = problem.distinct(found, round.refined, &SEARCHED);
        if let Some(best) = found.first() {
            progress(Event::Searched {
                scales: (index + 1) as u32,
                scales_in_all: scales.len() as u32,
                best: problem.camera_from_ct(&best.pose),
                score_mm: best.score,
            });
        }
    }
    if found.is_empty() {
        return Err(Error::NothingFound);
    }
    for (rank, candidate) in found.iter().enumerate() {
        progress(evidence::of_coarse(problem, rank, candidate));
    }
    Ok(found)
}

fn refine_all(
    problem: &Problem,
    candidates: Vec<Candidate>,
    seen: &Seen,
    stage: &Stage,
    progress: &mut (dyn FnMut(Event) + Send),
    budget: &Budget,
) -> Result<Vec<Candidate>, Error> {
    let settings = refine::Settings {
        steps: stage.steps,
        first_deviation_units: stage.first_deviation_units,
        allowed: problem.allowed,
    };
    let refined: Vec<(Candidate, Vec<Iteration>)> = candidates
        .into_par_iter()
        .with_max_len(1)
        .map(|candidate| {
            budget.check()?;
            let refined = refine::refine(&problem.model, seen, candidate.pose, &settings);
            Ok((
                problem.candidate(candidate.coarse, refined.pose, seen),
                refined.trace,
            ))
        })
        .collect::<Result<_, Error>>()?;
    let mut candidates = Vec::with_capacity(refined.len());
    for (rank, (candidate, trace)) in refined.into_iter().enumerate() {
        for (iteration, state) in trace.into_iter().enumerate() {
            progress(Event::Iteration {
                candidate: rank as u32,
                iteration: iteration as u32,
                state,
            });
        }
        candidates.push(candidate);
    }
    Ok(candidates)
}
