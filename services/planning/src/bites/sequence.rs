//! The order of execution: of those in which every bite can be made the one that turns the shaft least.
//!
//! Every bite ends over the tray, so that its trip does not depend on its neighbours; what does is a
//! change of the portal, which the operator makes by hand, and the turn of the shaft about it.

use arthro_geometry::Point3;

use super::order::Gone;
use super::problem::Problem;
use crate::jaw::Bite;

/// The bites of a set in order, each with its portal: always the nearest that can be made, through the
/// same portal as long as there is one. What nothing frees comes last.
pub(super) fn of(chosen: &[usize], problem: &Problem, portals: &[Point3]) -> Vec<(usize, Bite)> {
    let mut gone = Gone::nothing(problem);
    let mut left = chosen.to_vec();
    left.sort_unstable();
    let mut order: Vec<(usize, Bite)> = Vec::new();
    while !left.is_empty() {
        let last = order.last();
        let effort = |candidate: usize| {
            let candidate = &problem.candidates[candidate];
            let (portal, before) = match last {
                Some((portal, bite)) => (*portal, bite.approach),
                None => (
                    0,
                    (middle(chosen, problem) - portals[candidate.portal]).normalize(),
                ),
            };
            let turn_rad = candidate.bite.approach.angle(&before);
            (candidate.portal != portal, turn_rad)
        };
        let stuck = |candidate: usize| gone.blocked(problem, candidate) > problem.throat_limit;
        let next = (0..left.len()).min_by(|a, b| {
            let key = |slot: usize| {
                let (changes, turn_rad) = effort(left[slot]);
                (stuck(left[slot]), changes, turn_rad)
            };
            let (a, b) = (key(*a), key(*b));
            (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2))
        });
        let Some(slot) = next else {
            break;
        };
        let candidate = &problem.candidates[left.remove(slot)];
        gone.add(&candidate.cut_bits);
        order.push((candidate.portal, candidate.bite));
    }
    order
}

fn middle(chosen: &[usize], problem: &Problem) -> Point3 {
    let centers = chosen
        .iter()
        .map(|candidate| problem.candidates[*candidate].bite.center.coords);
    Point3::from(centers.sum::<arthro_geometry::Vector3>() / chosen.len().max(1) as f64)
}
