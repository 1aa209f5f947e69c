//! The order of bites: each needs the throat of its jaw free when it is made.
//!
//! Tissue only goes, so that a bite that can be made now can be made later too. Making whatever can
//! be made until nothing more can therefore finds an order if there is one, and otherwise names the
//! bites that no order frees.

use super::bits::Bits;
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

    pub(super) fn add(&mut self, voxels: &Bits) {
        for &(word, bits) in voxels.words() {
            self.words[word as usize] |= bits;
        }
    }

    /// How much of a candidate's throat is blocked.
    pub(super) fn blocked(&self, problem: &Problem, candidate: usize) -> u32 {
        let candidate = &problem.candidates[candidate];
        if candidate.blocked_at_first <= problem.throat_limit {
            // Free before the first bite, free for ever.
            return candidate.blocked_at_first;
        }
        let words = candidate.throat.words().iter();
        let left = words.map(|part| part.without(self.words[part.word as usize]));
        candidate.blocked + left.sum::<u32>()
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
    of_slots((0..chosen.len()).collect(), chosen, problem, gone).map(|slot| chosen[slot])
}

/// Orders the slots of a set; soonest if they come about in the right order already.
pub(super) fn of_slots(
    slots: Vec<usize>,
    chosen: &[usize],
    problem: &Problem,
    gone: &mut Gone,
) -> Order {
    gone.clear();
    let mut order = Order {
        stuck: slots,
        ..Order::default()
    };
    loop {
        let before = order.made.len();
        order.excess = 0;
        let made = &mut order.made;
        let excess = &mut order.excess;
        order.stuck.retain(|&slot| {
            let candidate = chosen[slot];
            let blocked = gone.blocked(problem, candidate);
            if blocked <= problem.throat_limit {
                gone.add(&problem.candidates[candidate].cut_bits);
                made.push(slot);
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

impl Order {
    fn map(mut self, to: impl Fn(usize) -> usize) -> Self {
        for item in self.made.iter_mut().chain(&mut self.stuck) {
            *item = to(*item);
        }
        self
    }
}
