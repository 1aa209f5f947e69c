//! Points that belong to no surface: strays, told by how lonely they are.
//!
//! Both filters look at distances to the nearest others only. The statistical one does not take the rim of a surface
//! for strays: there a point misses half of its neighbours, at a corner three quarters, which lengthens its distances
//! by up to 2; and where a surface turns away from the camera all points are far from each other. So a stray must be
//! lonely among the points around it, too, or farther from them than any slant explains.

use arthro_geometry::Point3;
use rayon::prelude::*;

use crate::budget::Budget;
use crate::error::{Error, Violation};
use crate::neighbours::{Neighbour, Neighbours};

/// How strays are told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OutlierFilter {
    /// A point whose mean distance to its nearest others is longer than that of the median point by `deviations` robust
    /// standard deviations (1.4826 median absolute deviations), and 2.5 times as long as that of the median one of those
    /// others, or 6 times as long as that of the median point.
    Statistical {
        /// Nearest others looked at.
        neighbours: u32,
        /// Standard deviations above the median.
        deviations: f64,
    },
    /// A point that has fewer than `neighbours` others within `radius_mm`.
    Radius {
        /// How far, mm.
        radius_mm: f64,
        /// Others needed.
        neighbours: u32,
    },
}

/// What a filter found.
#[derive(Clone, Debug, PartialEq)]
pub struct Strays {
    /// Their indices, ascending.
    pub indices: Vec<usize>,
    /// The distance beyond which a point is one, mm; with [`OutlierFilter::Statistical`] if it is lonely around, too.
    pub limit_mm: f64,
}

/// Most neighbours that a filter looks at.
pub const MAX_NEIGHBOURS: u32 = 64;
/// Longest radius, mm.
pub const MAX_RADIUS_MM: f64 = 1000.0;
/// Most standard deviations.
pub const MAX_DEVIATIONS: f64 = 1000.0;
/// A corner lengthens the mean distance by 2 against the points around it, noise by some more.
const LEAST_RATIO: f64 = 2.5;
/// A slant of 81 degrees, the flattest that still gives depth, lengthens the mean distance by 2.5, an edge there by up
/// to twice that.
const SLANT_RATIO: f64 = 6.0;
/// Standard deviation of a normal distribution by its median absolute deviation.
const SIGMA_BY_MAD: f64 = 1.4826;

impl OutlierFilter {
    /// The strays among `points`, all finite; the same on any number of threads.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if `budget` is raised meanwhile.
    pub fn strays(&self, points: &[Point3], budget: &Budget) -> Result<Strays, Error> {
        let tree = Neighbours::new(points);
        match *self {
            Self::Statistical {
                neighbours,
                deviations,
            } => statistical(&tree, points, neighbours as usize, deviations, budget),
            Self::Radius {
                radius_mm,
                neighbours,
            } => radius(&tree, points, neighbours as usize, radius_mm, budget),
        }
    }

    /// What is wrong with the parameters.
    pub fn violations(&self) -> Vec<Violation> {
        let (method, neighbours, (field, value, most)) = match self {
            Self::Statistical {
                neighbours,
                deviations,
            } => (
                "statistical",
                *neighbours,
                ("deviations", *deviations, MAX_DEVIATIONS),
            ),
            Self::Radius {
                radius_mm,
                neighbours,
            } => (
                "radius",
                *neighbours,
                ("radius_mm", *radius_mm, MAX_RADIUS_MM),
            ),
        };
        let mut violations = Vec::new();
        if neighbours == 0 || neighbours > MAX_NEIGHBOURS {
            violations.push(Violation::new(
                format!("header.outliers.{method}.neighbours"),
                format!("is {neighbours}, must be 1 to {MAX_NEIGHBOURS}"),
            ));
        }
        if !(value > 0.0 && value <= most) {
            violations.push(Violation::new(
                format!("header.outliers.{method}.{field}"),
                format!("is {value}, must be greater than 0 and at most {most}"),
            ));
        }
        violations
    }
}

fn statistical(
    tree: &Neighbours,
    points: &[Point3],
    count: usize,
    deviations: f64,
    budget: &Budget,
) -> Result<Strays, Error> {
    let distances_mm: Vec<f64> = points
        .par_iter()
        .enumerate()
        .map(|(index, point)| {
            budget.check()?;
            let others = others(tree, index, point, count);
            // Infinite for a point alone.
            let sum_mm: f64 = others.iter().map(|other| other.distance2.sqrt()).sum();
            Ok(if others.is_empty() {
                f64::INFINITY
            } else {
                sum_mm / others.len() as f64
            })
        })
        .collect::<Result<_, Error>>()?;
    let middle_mm = median(distances_mm.clone());
    let spread_mm = distances_mm.iter().map(|d| (d - middle_mm).abs());
    let limit_mm = middle_mm + deviations * SIGMA_BY_MAD * median(spread_mm.collect());
    let indices = (0..points.len())
        .into_par_iter()
        .filter(|index| distances_mm[*index] > limit_mm)
        .filter(|index| {
            let others = others(tree, *index, &points[*index], count);
            let around_mm = others.iter().map(|other| distances_mm[other.index]);
            let allowed_mm = LEAST_RATIO * median(around_mm.collect());
            distances_mm[*index] > allowed_mm.min(SLANT_RATIO * middle_mm)
        })
        .collect();
    Ok(Strays { indices, limit_mm })
}

fn radius(
    tree: &Neighbours,
    points: &[Point3],
    count: usize,
    radius_mm: f64,
    budget: &Budget,
) -> Result<Strays, Error> {
    let is_stray: Vec<bool> = points
        .par_iter()
        .enumerate()
        .map(|(index, point)| {
            budget.check()?;
            let others = others(tree, index, point, count);
            let within = |other: &Neighbour| other.distance2 <= radius_mm * radius_mm;
            Ok(others.len() < count || !others.iter().all(within))
        })
        .collect::<Result<_, Error>>()?;
    Ok(Strays {
        indices: (0..points.len()).filter(|index| is_stray[*index]).collect(),
        limit_mm: radius_mm,
    })
}

/// The `count` nearest others of a point, nearest first; fewer if there are not as many.
fn others(tree: &Neighbours, index: usize, point: &Point3, count: usize) -> Vec<Neighbour> {
    let mut near = tree.nearest_many(point, count + 1);
    // Among more equal points than are asked for, the tree may leave this one out: then any of them stands for it.
    let own = near.iter().position(|n| n.index == index).unwrap_or(0);
    near.remove(own);
    near
}

/// The lower median; infinite for none.
fn median(mut values: Vec<f64>) -> f64 {
    let Some(middle) = values.len().checked_sub(1).map(|last| last / 2) else {
        return f64::INFINITY;
    };
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    const STATISTICAL: OutlierFilter = OutlierFilter::Statistical {
        neighbours: 16,
        deviations: 6.0,
    };
    const RADIUS: OutlierFilter = OutlierFilter::Radius {
        radius_mm: 2.0,
        neighbours: 5,
    };

    /// A noisy square sheet of half-millimetre pitch with sharp corners; nine strays, three of them in one clump, planted last.
    fn sheet_and_strays() -> (Vec<Point3>, Vec<usize>) {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut points: Vec<Point3> = (0..3600)
            .map(|i| {
                let height = 0.2 * (rng.random::<f64>() - 0.5);
                Point3::new(f64::from(i % 60) * 0.5, f64::from(i / 60) * 0.5, height)
            })
            .collect();
        points.extend((0..6).map(|i| Point3::new(5.0 * f64::from(i), 9.0, 4.0 + f64::from(i))));
        points.extend((0..3).map(|i| Point3::new(15.0 + 0.2 * f64::from(i), 25.0, -6.0)));
        (points, (3600..3609).collect())
    }

    #[test]
    fn planted_strays_are_found_and_edges_and_corners_stay() {
        let (points, planted) = sheet_and_strays();
        for filter in [STATISTICAL, RADIUS] {
            let strays = filter.strays(&points, &Budget::default()).unwrap();
            assert_eq!(strays.indices, planted, "{filter:?} {}", strays.limit_mm);
        }
    }

    #[test]
    fn the_answer_is_the_same_on_any_number_of_threads() {
        let (points, _) = sheet_and_strays();
        let on = |threads: usize| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap()
                .install(|| STATISTICAL.strays(&points, &Budget::default()).unwrap())
        };
        assert_eq!(on(1), on(4));
    }

    #[test]
    fn points_without_enough_others_are_strays_and_no_points_are_none() {
        let few = vec![Point3::origin(); 3];
        let strays = RADIUS.strays(&few, &Budget::default()).unwrap();
        assert_eq!(strays.indices, [0, 1, 2]);
        let none = STATISTICAL.strays(&[], &Budget::default()).unwrap();
        assert!(none.indices.is_empty());
    }

    #[test]
    fn equal_points_are_neighbours_of_each_other() {
        let heap = vec![Point3::new(1.0, 2.0, 3.0); 40];
        let strays = STATISTICAL.strays(&heap, &Budget::default()).unwrap();
        assert!(strays.indices.is_empty());
    }

    #[test]
    fn a_filter_stops_when_asked_to() {
        let budget = Budget::default();
        budget.cancel();
        let (points, _) = sheet_and_strays();
        assert!(matches!(
            STATISTICAL.strays(&points, &budget),
            Err(Error::Cancelled)
        ));
    }

    #[test]
    fn bad_parameters_are_all_named() {
        let filter = OutlierFilter::Radius {
            radius_mm: f64::NAN,
            neighbours: 65,
        };
        let said: Vec<String> = filter.violations().into_iter().map(|v| v.field).collect();
        assert_eq!(
            said,
            [
                "header.outliers.radius.neighbours",
                "header.outliers.radius.radius_mm"
            ]
        );
        assert!(STATISTICAL.violations().is_empty());
    }
}
