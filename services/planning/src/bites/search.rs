//! Fewer and fewer bites, until no set of them is found or the bound is met.

use super::anneal::Moves;
use super::attempts::{Attempts, Outcome, Start};
use super::exhaustion::{self, Exhaustion};
use super::order::{self, Gone};
use super::poses::Place;
use super::problem::Problem;
use super::selection::Selection;
use super::{Ended, bound, greedy};
use crate::error::Error;

/// How many bites more than the greedy choice are tried where that misses something.
pub(super) const MORE_BITES: u64 = 3;
/// Likewise where another choice will do as well.
pub(super) const FEW_MORE_BITES: u64 = 1;
/// So far from what failed, the next number tried is one less instead of half way.
const CLOSE: usize = 9;

/// A search under way.
pub(super) struct Search<'a> {
    problem: &'a Problem,
    moves: Moves,
    /// What each voxel of the region is worth.
    prices: Vec<f64>,
    attempts: Attempts<'a>,
    /// The best set so far.
    pub(super) best: Selection<'a>,
    /// The set of one bite fewer from which least is missing, once it was sought in vain.
    pub(super) closest: Option<Selection<'a>>,
    /// The least number of bites possible.
    pub(super) bound: usize,
    /// So many bites, or fewer, were tried in vain.
    failed: usize,
    pub(super) ended: Ended,
}

impl<'a> Search<'a> {
    pub(super) fn of(problem: &'a Problem, attempts: Attempts<'a>) -> Self {
        let bound = bound::of(problem, &|| attempts.go_on());
        Self {
            best: greedy::choose(problem, &bound.prices),
            closest: None,
            bound: bound.whole().max(1),
            prices: bound.prices,
            moves: Moves::of(problem),
            problem,
            attempts,
            failed: 0,
            ended: Ended::Effort,
        }
    }

    /// Begins with a set that is known, if it is complete.
    pub(super) fn adopt(&mut self, places: &[Place]) {
        let mut set = Selection::of(places, self.problem);
        if set.is_complete() {
            self.best = set;
        }
    }

    /// Completes what it begins with, with so many bites more if need be; whether that succeeds.
    pub(super) fn start(&mut self, more_bites: u64) -> Result<bool, Error> {
        for more in 0..=more_bites {
            if self.best.is_complete() {
                return Ok(true);
            }
            match self.sought(&self.best, 1_000 + more)? {
                Outcome::Complete(set) => {
                    self.best = set;
                    return Ok(true);
                }
                Outcome::Closest(set) => self.best = set,
            }
            if !self.attempts.go_on() {
                return Ok(false);
            }
            let Some(candidate) = self.helpful() else {
                return Ok(false);
            };
            self.best.add(candidate);
        }
        Ok(false)
    }

    /// Seeks a set of fewer bites; whether there is more to try.
    pub(super) fn improve(&mut self) -> Result<bool, Error> {
        self.drop_idle();
        let bites = self.best.chosen.len();
        if bites <= self.bound {
            self.ended = Ended::Optimal;
            return Ok(false);
        }
        match exhaustion::of(self.problem, bites - 1, &|| self.attempts.go_on()) {
            Exhaustion::Found(chosen) => {
                self.best.replace(&chosen);
                return Ok(true);
            }
            Exhaustion::None => {
                self.bound = bites;
                self.ended = Ended::Optimal;
                return Ok(false);
            }
            Exhaustion::TooMany => self.attempts.not_stopped()?,
        }
        let failed = self.failed.max(self.bound - 1);
        let fewer = match bites - failed {
            ..=1 => return Ok(false),
            2..=CLOSE => bites - 1,
            apart => bites - apart / 2,
        };
        let mut set = self.best.clone();
        while set.chosen.len() > fewer {
            set.remove(set.least_useful());
        }
        match self.sought(&set, fewer as u64)? {
            Outcome::Complete(set) => {
                self.best = set;
                self.closest = None;
            }
            Outcome::Closest(set) => {
                self.failed = fewer;
                self.closest = Some(set);
            }
        }
        if !self.attempts.go_on() {
            self.ended = Ended::Deadline;
            return Ok(false);
        }
        Ok(true)
    }

    fn sought(&self, set: &Selection<'a>, round: u64) -> Result<Outcome<'a>, Error> {
        self.attempts
            .complete(set, &self.moves, Start::Anywhere, round)
    }

    /// The bite that brings most after all that can be made.
    fn helpful(&self) -> Option<usize> {
        let mut gone = Gone::nothing(self.problem);
        order::of(&self.best.chosen, self.problem, &mut gone);
        greedy::best(self.problem, &self.prices, &self.best, &gone)
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
}
