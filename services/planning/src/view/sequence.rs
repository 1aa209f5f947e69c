//! One pose for each bite, so that the arthroscope shows every bite well and moves little between
//! them: the shortest path through the layers of poses.

use super::View;
use super::poses::Pose;

/// A move of the tip so long costs as much as a view at the limit of its field or distance, mm.
const MOVE_MM: f64 = 10.0;
/// A turn of the optics so far costs as much.
const ROLL_RAD: f64 = 1.0;

/// The views along the cheapest path through `layers`, one of each; every layer holds some. Of equal
/// paths the one through the earliest poses.
pub(super) fn shortest(layers: &[Vec<Pose>]) -> Vec<View> {
    let mut costs: Vec<f64> = Vec::new();
    let mut origins: Vec<Vec<usize>> = Vec::with_capacity(layers.len());
    for (index, layer) in layers.iter().enumerate() {
        let reached: Vec<(usize, f64)> = layer
            .iter()
            .map(|pose| {
                let before = index.checked_sub(1).map(|before| &layers[before]);
                let (origin, so_far) = before.map_or((0, 0.0), |before| {
                    cheapest(
                        before
                            .iter()
                            .zip(&costs)
                            .map(|(from, cost)| cost + motion_cost(&from.view, &pose.view)),
                    )
                });
                (origin, so_far + pose.cost)
            })
            .collect();
        costs = reached.iter().map(|(_, cost)| *cost).collect();
        origins.push(reached.into_iter().map(|(origin, _)| origin).collect());
    }
    let (mut at, _) = cheapest(costs.into_iter());
    let mut views: Vec<View> = Vec::with_capacity(layers.len());
    for (layer, origins) in layers.iter().zip(&origins).rev() {
        views.push(layer[at].view);
        at = origins[at];
    }
    views.reverse();
    views
}

fn cheapest(costs: impl Iterator<Item = f64>) -> (usize, f64) {
    costs
        .enumerate()
        .fold((0, f64::INFINITY), |least, (index, cost)| {
            if cost < least.1 { (index, cost) } else { least }
        })
}

fn motion_cost(from: &View, to: &View) -> f64 {
    (to.tip - from.tip).norm() / MOVE_MM + (to.roll_rad - from.roll_rad).abs() / ROLL_RAD
}

#[cfg(test)]
mod tests {
    use super::*;
    use arthro_geometry::{Point3, Vector3};
    use proptest::prelude::*;

    fn pose(x: f64, roll_rad: f64, cost: f64) -> Pose {
        let view = View {
            tip: Point3::new(x, 0.0, 0.0),
            approach: Vector3::x(),
            optical_axis: Vector3::x(),
            roll_rad,
            depth_mm: 0.0,
            bite_offset_rad: 0.0,
            distance_mm: 0.0,
            forceps_clearance_mm: 0.0,
            occluded_percent: 0.0,
        };
        Pose { view, cost }
    }

    fn tips(layers: &[Vec<Pose>]) -> Vec<f64> {
        shortest(layers).iter().map(|view| view.tip.x).collect()
    }

    #[test]
    fn a_slightly_better_view_is_not_worth_the_way_and_a_much_better_one_is() {
        let stay = |better: f64| {
            vec![
                vec![pose(0.0, 0.0, 0.5)],
                vec![pose(30.0, 0.0, 0.5 - better), pose(0.0, 0.0, 0.5)],
                vec![pose(0.0, 0.0, 0.5)],
            ]
        };
        assert_eq!(tips(&stay(0.4)), [0.0, 0.0, 0.0]);
        assert_eq!(tips(&stay(7.0)), [0.0, 30.0, 0.0]);
    }

    fn cost_of(path: &[Pose]) -> f64 {
        let moves = path.windows(2);
        let moved: f64 = moves
            .map(|pair| motion_cost(&pair[0].view, &pair[1].view))
            .sum();
        moved + path.iter().map(|pose| pose.cost).sum::<f64>()
    }

    proptest! {
        #[test]
        fn no_other_choice_of_poses_costs_less(
            numbers in proptest::collection::vec((-20.0..20.0f64, -1.0..3.0f64, 0.0..3.0f64), 12)
        ) {
            let poses: Vec<Pose> = numbers.iter().map(|&(x, roll, cost)| pose(x, roll, cost)).collect();
            let layers: Vec<Vec<Pose>> = poses.chunks(3).map(<[Pose]>::to_vec).collect();
            let views = shortest(&layers);
            let chosen: Vec<Pose> = layers
                .iter()
                .zip(&views)
                .filter_map(|(layer, view)| layer.iter().find(|pose| pose.view == *view).copied())
                .collect();
            prop_assert_eq!(chosen.len(), layers.len());
            for choice in 0..81usize {
                let other: Vec<Pose> = (0..4)
                    .map(|layer| layers[layer][choice / 3usize.pow(layer as u32) % 3])
                    .collect();
                prop_assert!(cost_of(&chosen) <= cost_of(&other) + 1e-9);
            }
        }
    }

    #[test]
    fn the_first_pose_is_chosen_with_the_later_ones_in_mind() {
        let layers = [
            vec![pose(0.0, 0.0, 0.1), pose(20.0, 0.0, 0.3)],
            vec![pose(20.0, 0.0, 0.1)],
        ];
        assert_eq!(tips(&layers), [20.0, 20.0]);
        assert_eq!(tips(&[]), [0.0; 0]);
    }

    #[test]
    fn a_turn_of_the_optics_counts_as_motion() {
        let layers = [
            vec![pose(0.0, 0.0, 0.0)],
            vec![pose(1.0, 2.0, 0.0), pose(2.0, 0.0, 0.0)],
        ];
        assert_eq!(tips(&layers), [0.0, 2.0]);
    }
}
