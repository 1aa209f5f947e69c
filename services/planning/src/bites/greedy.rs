//! A first set of bites: always the one that can be made now and brings most.

use super::order::Gone;
use super::problem::Problem;
use super::selection::Selection;

/// What a voxel outside the region costs, in mean prices.
const OUTSIDE_WEIGHT: f64 = 1.0;
/// What a voxel brings beside its price, in mean prices.
const EVERY_VOXEL: f64 = 0.2;
/// What a place of the lesion brings, in mean prices.
const PLACE_WEIGHT: f64 = 0.3;

/// Bites until nothing is missing or nothing helps.
pub(super) fn choose<'a>(problem: &'a Problem, prices: &[f64]) -> Selection<'a> {
    let mut selection = Selection::empty(problem);
    let mut gone = Gone::nothing(problem);
    while selection.shortage() > 0.0 {
        let Some(candidate) = best(problem, prices, &selection, &gone) else {
            break;
        };
        gone.add(&problem.candidates[candidate].cut_bits);
        selection.add(candidate);
    }
    selection
}

/// What brings most after the bites of `selection`, if anything brings something.
pub(super) fn best(
    problem: &Problem,
    prices: &[f64],
    selection: &Selection<'_>,
    gone: &Gone,
) -> Option<usize> {
    let mean = prices.iter().sum::<f64>() / prices.len().max(1) as f64;
    let worth = |index: usize| {
        let cut = problem.candidates[index].cut.iter();
        let fresh = cut.filter(|voxel| !selection.is_bitten(**voxel));
        let voxels: f64 = fresh
            .map(|voxel| match prices.get(*voxel as usize) {
                Some(price) => price + EVERY_VOXEL * mean,
                None => -OUTSIDE_WEIGHT * mean,
            })
            .sum();
        voxels + PLACE_WEIGHT * mean * selection.new_places(index) as f64
    };
    let worths = (0..problem.candidates.len()).map(|index| (worth(index), index));
    let possible = worths.filter(|&(worth, index)| {
        worth > mean && gone.blocked(problem, index) <= problem.throat_limit
    });
    let best = possible.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
    best.map(|(_, index)| index)
}
