//! The order of bites: each needs the throat of its jaw free when it is made.
//!
//! Tissue only goes, so that a bite that can be made now can be made later too. Making whatever can
//! be made until nothing more can therefore finds an order if there is one, and otherwise names the
//! bites that no order frees.

use super::problem::Problem;

/// The voxels that are gone, as bits.
#[derive(Clone, Debug)]
pub(super) struct Gone {
    words: Vec<u64>,
}

impl Gone {
    pub(super) fn nothing(problem: &Problem) -> Self {
        Self {
            words: vec![0; problem.voxels.div_ceil(64)],
        }
    }

    pub(super) fn clear(&mut self) {
        self.words.fill(0);
    }

    pub(super) fn holds(&self, voxel: u32) -> bool {
        self.words[voxel as usize / 64] >> (voxel % 64) & 1 != 0
    }

    pub(super) fn add(&mut self, voxels: &[u32]) {
        for voxel in voxels {
            self.words[*voxel as usize / 64] |= 1 << (voxel % 64);
        }
    }

    /// How much of a candidate's throat is blocked.
    pub(super) fn blocked(&self, problem: &Problem, candidate: usize) -> u32 {
        let candidate = &problem.candidates[candidate];
        let left = candidate.throat.iter();
        let left = left.filter(|(voxel, _)| !self.holds(*voxel));
        candidate.blocked + left.map(|(_, part)| part).sum::<u32>()
    }
}

/// Bites sorted into those that can be made one after the other and those that cannot.
#[derive(Debug, Default)]
pub(super) struct Order {
    /// In an order in which each can be made.
    pub(super) made: Vec<usize>,
    /// What no order frees.
    pub(super) stuck: Vec<usize>,
    /// How much of the throats of these is blocked beyond the limit, in all.
    pub(super) excess: u32,
}

/// Orders a set of candidates.
pub(super) fn of(chosen: &[usize], problem: &Problem, gone: &mut Gone) -> Order {
    gone.clear();
    let mut order = Order {
        stuck: chosen.to_vec(),
        ..Order::default()
    };
    loop {
        let before = order.made.len();
        order.excess = 0;
        let made = &mut order.made;
        let excess = &mut order.excess;
        order.stuck.retain(|&candidate| {
            let blocked = gone.blocked(problem, candidate);
            if blocked <= problem.throat_limit {
                gone.add(&problem.candidates[candidate].cut);
                made.push(candidate);
                return false;
            }
            *excess += blocked - problem.throat_limit;
            true
        });
        if order.stuck.is_empty() || made.len() == before {
            return order;
        }
    }
}
