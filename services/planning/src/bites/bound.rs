//! How few bites could do: a lower bound that no order, rim or portal can undercut.
//!
//! Every voxel of the region gets a price, and every candidate costs one bite. A set that covers
//! enough is worth at least the cheapest voxels that make up enough; what candidates bring beyond
//! their cost must be taken off. So for any prices `p`
//!
//!   bites >= (sum of the cheapest needed p) - sum over candidates of max(0, p(candidate) - 1)
//!
//! which is the Lagrangian dual of the partial set cover (Fisher 1981); prices are improved by
//! subgradient steps, whose length goes by the distance to where
//! the best plan may be (Polyak 1969).

use rayon::prelude::*;

use super::problem::{Candidate, Problem};

/// About how far the best plan is above the bound of equal prices.
const GUESS: f64 = 1.7;
const ROUNDS: usize = 300;
/// Candidates that one thread takes at least.
const SHARE: usize = 256;
/// Rounds without a better bound after which the steps are halved.
const PATIENCE: usize = 12;

/// The least number of bites that the bound allows, and the price of each voxel of the region.
#[derive(Clone, Debug)]
pub(super) struct Bound {
    pub(super) bites: f64,
    pub(super) prices: Vec<f64>,
}

impl Bound {
    /// The least whole number of bites.
    pub(super) fn whole(&self) -> usize {
        // What is above a whole number by less is the rounding of the sums.
        (self.bites - 1e-6).ceil().max(0.0) as usize
    }
}

/// The best bound that the rounds find; `go_on` is asked before each.
pub(super) fn of(problem: &Problem, go_on: &dyn Fn() -> bool) -> Bound {
    let needed = problem.region_needed.min(problem.region);
    let largest = problem.candidates.iter().map(|c| c.inside).max();
    let start = 1.0 / largest.unwrap_or(1).max(1) as f64;
    let mut prices = vec![start; problem.region];
    let mut best = Bound {
        bites: 0.0,
        prices: prices.clone(),
    };
    let target = GUESS * Round::of(&prices, needed, problem).value + 1.0;
    let (mut relaxation, mut since) = (1.0, 0);
    for _ in 0..ROUNDS {
        if !go_on() {
            break;
        }
        let round = Round::of(&prices, needed, problem);
        if round.value > best.bites + 1e-4 {
            best = Bound {
                bites: round.value,
                prices: prices.clone(),
            };
            since = 0;
        } else {
            since += 1;
        }
        if since == PATIENCE {
            relaxation *= 0.6;
            since = 0;
            prices.copy_from_slice(&best.prices);
            continue;
        }
        let squares: f64 = round.slope.iter().map(|slope| slope * slope).sum();
        if squares < 1e-9 {
            break;
        }
        let step = relaxation * (target - round.value).max(0.05) / squares;
        for (price, slope) in prices.iter_mut().zip(&round.slope) {
            *price = (*price + step * slope).max(0.0);
        }
    }
    best
}

/// The dual at some prices.
struct Round {
    value: f64,
    /// Its subgradient by the prices.
    slope: Vec<f64>,
}

impl Round {
    fn of(prices: &[f64], needed: usize, problem: &Problem) -> Self {
        let mut cheapest: Vec<u32> = (0..prices.len() as u32).collect();
        if needed < cheapest.len() {
            let by_price = |a: &u32, b: &u32| {
                let of = |voxel: &u32| prices[*voxel as usize];
                of(a).total_cmp(&of(b)).then(a.cmp(b))
            };
            cheapest.select_nth_unstable_by(needed, by_price);
            cheapest.truncate(needed);
        }
        let (mut value, mut slope) = (0.0, vec![0.0; prices.len()]);
        for voxel in cheapest {
            value += prices[voxel as usize];
            slope[voxel as usize] += 1.0;
        }
        let worth = |candidate: &Candidate| -> f64 {
            let inside = candidate.inside().iter();
            inside.map(|voxel| prices[*voxel as usize]).sum()
        };
        let candidates = problem.candidates.par_iter();
        let worths: Vec<f64> = candidates.with_min_len(SHARE).map(worth).collect();
        let overpriced = problem.candidates.iter().zip(worths);
        for (candidate, worth) in overpriced.filter(|(_, worth)| *worth > 1.0) {
            value -= worth - 1.0;
            for voxel in candidate.inside() {
                slope[*voxel as usize] -= 1.0;
            }
        }
        Self { value, slope }
    }
}
