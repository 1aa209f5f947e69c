//! All sets of a few bites, one after the other: for small plans the last word on how few will do.
//!
//! Depth first. Where a place of the lesion is left, one of the candidates that cover it must be
//! taken; branches whose best further bites could not clear enough, or that take too much outside, are
//! cut off. The number of nodes is limited: what is not exhausted then stays open.

use super::problem::Problem;
use super::selection::Selection;

/// Nodes that are looked at before it is given up.
const MAX_NODES: usize = 6_000;
/// Larger sets are not tried: their number is beyond all bounds.
const MAX_BITES: usize = 6;

/// What came of it.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Exhaustion {
    /// This set clears all and can be made.
    Found(Vec<usize>),
    /// No set of so many bites does.
    None,
    /// There are too many sets to tell.
    TooMany,
}

/// Looks at all sets of `bites` candidates; `go_on` is asked at every node.
pub(super) fn of(problem: &Problem, bites: usize, go_on: &dyn Fn() -> bool) -> Exhaustion {
    // Without a lesion nothing narrows the first branches.
    if !(1..=MAX_BITES).contains(&bites)
        || problem.lesion_needed[0] < problem.lesion
        || problem.lesion == 0
    {
        return Exhaustion::TooMany;
    }
    let bits = Bits::of(problem);
    let nothing = vec![0; bits.words];
    let mut tree = Tree {
        problem,
        bits,
        path: Vec::new(),
        nodes: 0,
        go_on,
    };
    tree.below(&nothing, bites)
}

/// The candidates as bits: the region, then what lies outside it, then the lesion where it is, each
/// from a new word on.
struct Bits {
    of: Vec<Vec<u64>>,
    /// Words of the region, and those up to the end of the outside.
    region: usize,
    outside: usize,
    words: usize,
}

impl Bits {
    fn of(problem: &Problem) -> Self {
        let region = problem.region.div_ceil(64);
        let outside = region + (problem.voxels - problem.region).div_ceil(64);
        let words = outside + problem.lesion.div_ceil(64);
        let bits = problem.candidates.iter().map(|candidate| {
            let mut bits = vec![0u64; words];
            let mut set = |bit: usize| bits[bit / 64] |= 1 << (bit % 64);
            for voxel in &candidate.cut {
                let voxel = *voxel as usize;
                set(match voxel.checked_sub(problem.region) {
                    Some(other) => 64 * region + other,
                    None => voxel,
                });
            }
            let undisplaced = candidate.places.iter().map(|place| *place as usize);
            for place in undisplaced.filter(|place| *place < problem.lesion) {
                set(64 * outside + place);
            }
            bits
        });
        Self {
            of: bits.collect(),
            region,
            outside,
            words,
        }
    }

    /// Voxels of the region that a candidate would add.
    fn gain(&self, candidate: usize, bitten: &[u64]) -> usize {
        let words = self.of[candidate][..self.region].iter().zip(bitten);
        words
            .map(|(cut, bitten)| (cut & !bitten).count_ones() as usize)
            .sum()
    }

    fn with(&self, candidate: usize, bitten: &[u64]) -> Vec<u64> {
        let words = self.of[candidate].iter().zip(bitten);
        words.map(|(cut, bitten)| cut | bitten).collect()
    }

    fn covers(&self, candidate: usize, place: usize) -> bool {
        self.of[candidate][self.outside + place / 64] >> (place % 64) & 1 != 0
    }
}

fn count(words: &[u64]) -> usize {
    words.iter().map(|word| word.count_ones() as usize).sum()
}

/// The tree of sets.
struct Tree<'a> {
    problem: &'a Problem,
    bits: Bits,
    path: Vec<usize>,
    nodes: usize,
    go_on: &'a dyn Fn() -> bool,
}

impl Tree<'_> {
    /// Everything below a node: sets with `left` more bites.
    fn below(&mut self, bitten: &[u64], left: usize) -> Exhaustion {
        self.nodes += 1;
        if self.nodes > MAX_NODES || !(self.go_on)() {
            return Exhaustion::TooMany;
        }
        let missing = self
            .problem
            .region_needed
            .saturating_sub(count(&bitten[..self.bits.region]));
        let gains: Vec<usize> = (0..self.problem.candidates.len())
            .map(|candidate| self.bits.gain(candidate, bitten))
            .collect();
        let others = most(&gains, left - 1);
        let branches = self.branches(bitten);
        for candidate in branches
            .filter(|candidate| gains[*candidate] + others >= missing)
            .collect::<Vec<_>>()
        {
            let next = self.bits.with(candidate, bitten);
            if count(&next[self.bits.region..self.bits.outside]) > self.problem.outside_limit {
                continue;
            }
            self.path.push(candidate);
            let found = match left {
                1 => self.leaf(),
                _ => self.below(&next, left - 1),
            };
            if found != Exhaustion::None {
                return found;
            }
            self.path.pop();
        }
        Exhaustion::None
    }

    fn leaf(&self) -> Exhaustion {
        let mut selection = Selection::empty(self.problem);
        selection.replace(&self.path);
        if selection.is_complete() {
            return Exhaustion::Found(self.path.clone());
        }
        Exhaustion::None
    }

    /// The candidates of which one must be among the next: those that cover the place of the lesion
    /// that fewest do, or all once none is left.
    fn branches(&self, bitten: &[u64]) -> impl Iterator<Item = usize> + use<> {
        let is_left =
            |place: &usize| bitten[self.bits.outside + place / 64] >> (place % 64) & 1 == 0;
        let all = 0..self.problem.candidates.len();
        let covering = (0..self.problem.lesion).filter(is_left).map(|place| {
            let covering = all
                .clone()
                .filter(|candidate| self.bits.covers(*candidate, place));
            covering.collect::<Vec<_>>()
        });
        let fewest = covering.min_by_key(Vec::len);
        fewest.unwrap_or_else(|| all.collect()).into_iter()
    }
}

/// Sum of the greatest so many.
fn most(gains: &[usize], count: usize) -> usize {
    let mut gains = gains.to_vec();
    gains.sort_unstable_by(|a, b| b.cmp(a));
    gains.iter().take(count).sum()
}
