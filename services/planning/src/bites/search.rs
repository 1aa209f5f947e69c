//! Fewer and fewer bites, until no set of them is found or the bound is met.

use std::sync::atomic::{AtomicUsize, Ordering};

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::anneal::{self, Aim, Moves};
use super::exhaustion::{self, Exhaustion};
use super::order::{self, Gone};
use super::problem::Problem;
use super::selection::Selection;
use super::{Effort, Ended, Patience, bound, greedy};
use crate::error::Error;

/// Annealings of one number of bites before it is given up; they run side by side.
const ATTEMPTS: usize = 4;
/// Exchanges of one annealing for each bite of the set.
const STEPS_A_BITE: usize = 4_000;
/// How many bites more than the greedy choice are tried where that misses something.
const MORE_BITES: usize = 6;

/// A search under way.
pub(super) struct Search<'a> {
    problem: &'a Problem,
    moves: Moves,
    /// What each voxel of the region is worth.
    prices: Vec<f64>,
    effort: Effort,
    patience: &'a (dyn Fn() -> Patience + Sync),
    /// The best set so far.
    pub(super) best: Selection<'a>,
    /// The least number of bites possible.
    pub(super) bound: usize,
    /// So many bites, or fewer, were tried in vain.
    failed: usize,
    pub(super) ended: Ended,
}

impl<'a> Search<'a> {
    pub(super) fn of(
        problem: &'a Problem,
        effort: Effort,
        patience: &'a (dyn Fn() -> Patience + Sync),
    ) -> Self {
        let bound = bound::of(problem);
        Self {
            best: greedy::choose(problem, &bound.prices),
            prices: bound.prices.clone(),
            moves: Moves::of(problem),
            problem,
            effort,
            patience,
            bound: bound.whole().max(1),
            failed: 0,
            ended: Ended::Effort,
        }
    }

    /// Completes the greedy choice; whether that succeeds.
    pub(super) fn start(&mut self) -> Result<bool, Error> {
        for _ in 0..=MORE_BITES {
            if self.best.is_complete() {
                return Ok(true);
            }
            let tried = self.anneal(&self.best.clone())?;
            let complete = tried.iter().position(|(complete, _)| *complete);
            let by_shortage = |a: &usize, b: &usize| {
                let of = |index: usize| tried[index].1.shortage();
                of(*a).total_cmp(&of(*b))
            };
            let closest = (0..tried.len()).min_by(by_shortage);
            if let Some(index) = complete.or(closest) {
                self.best = tried[index].1.clone();
            }
            if complete.is_some() {
                return Ok(true);
            }
            if (self.patience)() != Patience::GoOn {
                return Ok(false);
            }
            let Some(candidate) = self.helpful() else {
                return Ok(false);
            };
            self.best.add(candidate);
        }
        Ok(false)
    }

    /// The bite that brings most after all that can be made.
    fn helpful(&self) -> Option<usize> {
        let mut gone = Gone::nothing(self.problem);
        order::of(&self.best.chosen, self.problem, &mut gone);
        greedy::best(self.problem, &self.prices, &self.best, &gone)
    }

    /// Seeks a set of fewer bites; whether there is more to try.
    pub(super) fn improve(&mut self) -> Result<bool, Error> {
        self.drop_idle();
        let bites = self.best.chosen.len();
        if bites <= self.bound {
            self.ended = Ended::Optimal;
            return Ok(false);
        }
        match exhaustion::of(self.problem, bites - 1, &self.go_on()) {
            Exhaustion::Found(chosen) => {
                self.best.replace(&chosen);
                return Ok(true);
            }
            Exhaustion::None => {
                self.bound = bites;
                self.ended = Ended::Optimal;
                return Ok(false);
            }
            Exhaustion::TooMany => self.not_stopped()?,
        }
        // Half way between what is known and what failed, or the bound.
        let failed = self.failed.max(self.bound - 1);
        let step = (bites - failed) / 2;
        if step == 0 {
            return Ok(false);
        }
        let mut fewer = self.best.clone();
        for _ in 0..step {
            fewer.remove(fewer.least_useful());
        }
        let mut tried = self.anneal(&fewer)?.into_iter();
        match tried.find(|(complete, _)| *complete) {
            Some((_, set)) => self.best = set,
            None => self.failed = bites - step,
        }
        if (self.patience)() != Patience::GoOn {
            self.ended = Ended::Deadline;
            return Ok(false);
        }
        Ok(true)
    }

    /// Takes out bites that nothing needs.
    fn drop_idle(&mut self) {
        while !self.best.chosen.is_empty() {
            let mut fewer = self.best.clone();
            fewer.remove(fewer.least_useful());
            if !fewer.is_complete() {
                return;
            }
            self.best = fewer;
        }
    }

    /// Makes the best of the number found.
    pub(super) fn polish(&mut self) -> Result<(), Error> {
        let mut random = self.random(0);
        let go_on = self.go_on();
        let steps = self.steps(self.best.chosen.len());
        anneal::run(
            &mut self.best,
            Aim::Best,
            &self.moves,
            steps,
            &mut random,
            &go_on,
        );
        self.not_stopped()
    }

    /// Anneals a set several times; in the order of the attempts, whether each completes it.
    fn anneal(&self, set: &Selection<'a>) -> Result<Vec<(bool, Selection<'a>)>, Error> {
        let first = AtomicUsize::new(usize::MAX);
        let attempt = |attempt: usize| {
            // Once an attempt succeeds, those after it do not count.
            let go_on =
                || first.load(Ordering::Relaxed) > attempt && (self.patience)() == Patience::GoOn;
            let mut set = set.clone();
            let mut random = self.random(1 + attempt as u64 + (ATTEMPTS * set.chosen.len()) as u64);
            let steps = self.steps(set.chosen.len());
            anneal::run(
                &mut set,
                Aim::Complete,
                &self.moves,
                steps,
                &mut random,
                &go_on,
            );
            let complete = set.is_complete();
            if complete {
                first.fetch_min(attempt, Ordering::Relaxed);
            }
            (complete, set)
        };
        let tried = (0..ATTEMPTS).into_par_iter().map(attempt).collect();
        self.not_stopped()?;
        Ok(tried)
    }

    fn steps(&self, bites: usize) -> usize {
        STEPS_A_BITE * bites * self.effort.factor.max(1) as usize
    }

    fn go_on(&self) -> impl Fn() -> bool + Sync + 'a {
        let patience = self.patience;
        move || patience() == Patience::GoOn
    }

    fn not_stopped(&self) -> Result<(), Error> {
        match (self.patience)() {
            Patience::Stop => Err(Error::Cancelled),
            _ => Ok(()),
        }
    }

    fn random(&self, stream: u64) -> ChaCha8Rng {
        let mut random = ChaCha8Rng::seed_from_u64(self.effort.seed);
        random.set_stream(stream);
        random
    }
}
