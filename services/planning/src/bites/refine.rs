//! The last tenths of a millimetre: the bites chosen from the coarse grid, moved on the fine one.
//!
//! A set of one bite fewer that only just misses something may be complete there; whatever the number,
//! the finer places take less outside and more of the region.

use super::anneal::Moves;
use super::attempts::{Attempts, Outcome, Start};
use super::poses::{self, Ground, Place};
use super::problem::Problem;
use super::selection::Selection;
use super::sequence;
use crate::error::Error;
use crate::jaw::Bite;

/// How often an incomplete set is followed to where it misses less.
const ROUNDS: u64 = 3;

/// What an incomplete set may miss to be followed, as a share of what has to go.
const NEARLY: f64 = 0.01;

/// What is refined, and within what.
pub(super) struct Refinement<'a> {
    pub(super) ground: &'a Ground<'a>,
    /// The limits that hold on the fine grid too.
    pub(super) coarse: &'a Problem,
    /// Makes the problem of some poses.
    pub(super) problem: &'a dyn Fn(Vec<poses::Pose>) -> Problem,
    pub(super) attempts: Attempts<'a>,
}

impl Refinement<'_> {
    /// A complete set of as many bites as `closest` and fewer still, but not fewer than `bound`; `None`
    /// if none is found.
    pub(super) fn fewer(
        &self,
        closest: &Selection<'_>,
        bound: usize,
    ) -> Result<Option<Vec<Place>>, Error> {
        let (mut best, mut near, mut round) = (None, closest.places(), 0);
        while round < ROUNDS && near.len() >= bound && self.attempts.go_on() {
            let problem = self.around(&near);
            let set = Selection::of(&near, &problem);
            let moves = Moves::of(&problem);
            round += 1;
            let stream = 2_000 + 10 * near.len() as u64 + round;
            match self.attempts.complete(&set, &moves, Start::Near, stream)? {
                Outcome::Complete(set) => {
                    best = Some(set.places());
                    let mut fewer = set;
                    fewer.remove(fewer.least_useful());
                    (near, round) = (fewer.places(), 0);
                }
                Outcome::Closest(set)
                    if set.shortage() > NEARLY * self.coarse.region_needed as f64 =>
                {
                    break;
                }
                Outcome::Closest(set) => near = set.places(),
            }
        }
        Ok(best)
    }

    /// The best set near a complete one, in the order of execution.
    pub(super) fn best(&self, places: &[Place]) -> Result<Vec<(usize, Bite)>, Error> {
        let problem = self.around(places);
        let mut set = Selection::of(places, &problem);
        self.attempts.best(&mut set, &Moves::of(&problem))?;
        Ok(sequence::of(&set.chosen, &problem, self.ground.portals()))
    }

    fn around(&self, places: &[Place]) -> Problem {
        let problem = (self.problem)(poses::around(self.ground, places));
        problem.with_limits_of(self.coarse)
    }
}
