//! Annealings of one set, several side by side.

use std::sync::atomic::{AtomicUsize, Ordering};

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::anneal::{self, Aim, Moves, Schedule};
use super::selection::Selection;
use super::{Effort, Patience};
use crate::error::Error;

/// How many annealings seek a set of one number of bites.
const ATTEMPTS: usize = 2;
/// Exchanges of one annealing for each bite of the set, from a high temperature and from a low one.
const STEPS_A_BITE: [usize; 2] = [4_000, 2_000];

/// Of many bites each gets fewer.
const MAX_STEPS: usize = 80_000;

/// Who anneals, how long and as long as what.
#[derive(Clone, Copy)]
pub(super) struct Attempts<'a> {
    pub(super) effort: Effort,
    pub(super) patience: &'a (dyn Fn() -> Patience + Sync),
}

/// Where an annealing starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Start {
    /// What is sought may be anywhere.
    Anywhere,
    /// It is near.
    Near,
}

impl Start {
    /// First and last temperature, in voxels.
    fn temperatures(self) -> [f64; 2] {
        match self {
            Self::Anywhere => [12.0, 0.2],
            Self::Near => [3.0, 0.2],
        }
    }
}

/// What came of several annealings.
pub(super) enum Outcome<'a> {
    /// A set from which nothing is missing.
    Complete(Selection<'a>),
    /// The set from which least is missing.
    Closest(Selection<'a>),
}

impl Attempts<'_> {
    /// Seeks a complete set of as many bites. `round` tells this search from others of the same seed.
    pub(super) fn complete<'a>(
        &self,
        set: &Selection<'a>,
        moves: &Moves,
        start: Start,
        round: u64,
    ) -> Result<Outcome<'a>, Error> {
        let first = AtomicUsize::new(usize::MAX);
        let attempt = |attempt: usize| {
            // Once an attempt succeeds, those after it do not count.
            let go_on = || first.load(Ordering::Relaxed) > attempt && self.go_on();
            let mut set = set.clone();
            let schedule = Schedule {
                aim: Aim::Complete,
                temperatures: start.temperatures(),
                steps: self.steps(&set, start),
            };
            let mut random = self.random(round * ATTEMPTS as u64 + attempt as u64);
            anneal::run(&mut set, schedule, moves, &mut random, &go_on);
            let energy = set.energy(Aim::Complete, f64::INFINITY);
            if energy <= 0.0 {
                first.fetch_min(attempt, Ordering::Relaxed);
            }
            (energy, set)
        };
        let mut tried: Vec<_> = (0..ATTEMPTS).into_par_iter().map(attempt).collect();
        self.not_stopped()?;
        if let Some(complete) = tried.iter().position(|(energy, _)| *energy <= 0.0) {
            return Ok(Outcome::Complete(tried.swap_remove(complete).1));
        }
        let closest = tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        Ok(Outcome::Closest(
            closest.map_or_else(|| set.clone(), |(_, set)| set),
        ))
    }

    /// Makes the best of a complete set.
    pub(super) fn best(&self, set: &mut Selection<'_>, moves: &Moves) -> Result<(), Error> {
        let schedule = Schedule {
            aim: Aim::Best,
            temperatures: Start::Near.temperatures(),
            steps: self.steps(set, Start::Near),
        };
        let mut random = self.random(0);
        anneal::run(set, schedule, moves, &mut random, &|| self.go_on());
        self.not_stopped()
    }

    pub(super) fn go_on(&self) -> bool {
        (self.patience)() == Patience::GoOn
    }

    pub(super) fn not_stopped(&self) -> Result<(), Error> {
        match (self.patience)() {
            Patience::Stop => Err(Error::Cancelled),
            Patience::Hurry | Patience::GoOn => Ok(()),
        }
    }

    fn steps(&self, set: &Selection<'_>, start: Start) -> usize {
        let steps_a_bite = match start {
            Start::Anywhere => STEPS_A_BITE[0],
            Start::Near => STEPS_A_BITE[1],
        };
        let steps = (steps_a_bite * set.chosen.len()).min(MAX_STEPS);
        steps * self.effort.factor.max(1) as usize
    }

    fn random(&self, stream: u64) -> ChaCha8Rng {
        let mut random = ChaCha8Rng::seed_from_u64(self.effort.seed);
        random.set_stream(stream);
        random
    }
}
