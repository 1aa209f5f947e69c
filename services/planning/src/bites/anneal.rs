//! Simulated annealing over sets of a given number of bites (Kirkpatrick, Gelatt, Vecchi 1983): a bite
//! is moved a little or to where something is missing, and a worse set is kept with a probability that
//! falls from move to move.

use std::collections::BTreeMap;

use rand::Rng as _;
use rand_chacha::ChaCha8Rng;

use super::problem::Problem;
use super::selection::Selection;

/// How far a bite is moved, in cells of the fine grid of poses.
const NEAR_CELLS: i32 = 6;
/// Share of the moves that go to where something is missing.
const TO_THE_MISSING: f64 = 0.25;
/// Draws of a voxel before nothing is taken to be missing.
const DRAWS: usize = 24;

/// Which candidates a bite can be moved to.
pub(super) struct Moves {
    near: Vec<Vec<u32>>,
    /// Candidates that cut each voxel of the region.
    cutting: Vec<Vec<u32>>,
}

impl Moves {
    pub(super) fn of(problem: &Problem) -> Self {
        let mut at: BTreeMap<[i32; 2], Vec<u32>> = BTreeMap::new();
        let mut cutting = vec![Vec::new(); problem.region];
        for (index, candidate) in (0u32..).zip(&problem.candidates) {
            at.entry(candidate.cell).or_default().push(index);
            for voxel in candidate.inside() {
                cutting[*voxel as usize].push(index);
            }
        }
        let around = |[i, j]: [i32; 2]| {
            let rows = at.range([i - NEAR_CELLS, i32::MIN]..=[i + NEAR_CELLS, i32::MAX]);
            let near = rows.filter(|([_, other], _)| (other - j).abs() <= NEAR_CELLS);
            near.flat_map(|(_, candidates)| candidates)
                .copied()
                .collect()
        };
        let candidates = problem.candidates.iter();
        Self {
            near: candidates.map(|candidate| around(candidate.cell)).collect(),
            cutting,
        }
    }

    fn draw(&self, selection: &Selection<'_>, slot: usize, random: &mut ChaCha8Rng) -> usize {
        if random.random_bool(TO_THE_MISSING) {
            for _ in 0..DRAWS {
                let voxel = random.random_range(0..self.cutting.len());
                let cutting = &self.cutting[voxel];
                if !cutting.is_empty() && !selection.is_bitten(voxel as u32) {
                    return cutting[random.random_range(0..cutting.len())] as usize;
                }
            }
        }
        let near = &self.near[selection.chosen[slot]];
        near[random.random_range(0..near.len())] as usize
    }
}

/// What is sought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Aim {
    /// A set from which nothing is missing; the first one will do.
    Complete,
    /// Among such sets the one that takes least outside the region and most of it.
    Best,
}

/// How an annealing goes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Schedule {
    pub(super) aim: Aim,
    /// First and last temperature, in voxels.
    pub(super) temperatures: [f64; 2],
    /// How many exchanges.
    pub(super) steps: usize,
}

/// Exchanges bites, until the first complete set if that will do. `go_on` is asked now and then. Ends
/// at the best set that was met.
pub(super) fn run(
    selection: &mut Selection<'_>,
    schedule: Schedule,
    moves: &Moves,
    random: &mut ChaCha8Rng,
    go_on: &dyn Fn() -> bool,
) {
    /// Steps between two questions.
    const ASK_EVERY: usize = 256;
    if selection.chosen.is_empty() || moves.cutting.is_empty() {
        return;
    }
    let Schedule {
        aim,
        temperatures: [hot, cold],
        steps,
    } = schedule;
    let mut energy = selection.energy(aim, f64::INFINITY);
    let mut best = (energy, selection.chosen.clone());
    for step in 0..steps {
        let done = aim == Aim::Complete && energy <= 0.0;
        if done || (step % ASK_EVERY == 0 && !go_on()) {
            break;
        }
        let slot = random.random_range(0..selection.chosen.len());
        let candidate = moves.draw(selection, slot, random);
        let temperature = hot * (cold / hot).powf(step as f64 / steps as f64);
        let allowed = energy - temperature * random.random::<f64>().max(1e-12).ln();
        let before = selection.exchange(slot, candidate);
        let next = selection.energy(aim, allowed);
        if next > allowed {
            selection.exchange(slot, before);
            continue;
        }
        energy = next;
        if energy < best.0 {
            best = (energy, selection.chosen.clone());
        }
    }
    if energy > best.0 {
        selection.replace(&best.1);
    }
}
