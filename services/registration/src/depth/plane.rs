//! Takes away what a thing lies on: the largest plane (a plateau, a table, flat skin) and all that is behind it, seen
//! from the camera. What stands out of the plane towards the camera stays.
//!
//! The plane is found from triples of points drawn by a seed (RANSAC) and then fitted to its points by least squares
//! with the weights of their noise.

use std::cmp::Reverse;

use arthro_geometry::nalgebra::{Matrix3, SymmetricEigen};
use arthro_geometry::{Point3, Vector3};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::deproject::SeenPoint;
use crate::error::{Error, Violation};

#[cfg(test)]
mod tests;

/// What of a plane is taken away, and what is plane enough.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneRemoval {
    /// How far a point must stand out of the plane to stay, mm. Four standard deviations of the point if that is more.
    pub margin_mm: f64,
    /// Least share of the points that the plane holds, [`SHARES`].
    pub min_share: f64,
    /// How many planes are taken away, each from what the one before left; 1 to [`MAX_PLANES`]. All but the first may
    /// be missing.
    pub planes: u32,
    /// The same seed draws the same triples.
    pub seed: u64,
}

/// A plane that was taken away: `normal` · p = `offset_mm`.
#[derive(Clone, Debug, PartialEq)]
pub struct RemovedPlane {
    /// Unit normal, towards the camera.
    pub normal: Vector3,
    /// Distance of the frame's origin below the plane, mm.
    pub offset_mm: f64,
    /// Share of the points that lie in the plane.
    pub share: f64,
    /// Root mean square distance of those points to the plane, mm.
    pub rms_mm: f64,
    /// How many points went: on the plane and behind it.
    pub removed: usize,
}

/// Shares of the points that a plane may be asked to hold. A smaller one is not reliably drawn.
pub const SHARES: std::ops::RangeInclusive<f64> = 0.15..=1.0;
/// Largest margin, mm.
pub const MAX_MARGIN_MM: f64 = 100.0;
/// Most planes.
pub const MAX_PLANES: u32 = 4;
/// Fewest points that a plane is looked for in.
pub const MIN_POINTS: usize = 100;
/// A smaller share than this left of the points is noise of the plane itself.
pub const LEAST_LEFT: f64 = 0.001;
/// Noise that is no height, in standard deviations.
const SIGNIFICANT: f64 = 4.0;
/// Chance that no triple of a plane of the least share is drawn.
const MISSED: f64 = 1e-6;
/// Points that a drawn plane is tried on.
const SAMPLE: usize = 2000;
/// Drawn planes that are fitted.
const FITTED: usize = 10;
/// Rounds of fitting to the points near the last fit.
const ROUNDS: usize = 8;

impl PlaneRemoval {
    /// The largest plane of `points`, and the ascending indices of those that it takes away, as seen from `viewpoints`;
    /// all in one frame.
    ///
    /// # Errors
    /// [`Error::Invalid`] if there are too few points, no plane holds its share, the plane takes everything, or the
    /// viewpoints do not stand clear on one side of it.
    pub fn largest(
        &self,
        points: &[SeenPoint],
        viewpoints: &[Point3],
    ) -> Result<(RemovedPlane, Vec<usize>), Error> {
        if points.len() < MIN_POINTS {
            return refused(format!(
                "finds {} points, needs at least {MIN_POINTS}",
                points.len()
            ));
        }
        let plane = self.find(points);
        let (inside, squares_mm2) = points
            .iter()
            .filter(|point| self.is_near(&plane, point))
            .fold((0, 0.0), |(count, sum), point| {
                (count + 1, sum + plane.height_mm(&point.position).powi(2))
            });
        let share = f64::from(inside) / points.len() as f64;
        if share < self.min_share {
            return refused(format!(
                "finds no plane: the largest holds {share:.3} of the points, must hold at least {}",
                self.min_share
            ));
        }
        let plane = self.facing(plane, viewpoints)?;
        let indices: Vec<usize> = (0..points.len())
            .filter(|index| {
                let point = &points[*index];
                plane.height_mm(&point.position) <= self.reach_mm(point)
            })
            .collect();
        let left = points.len() - indices.len();
        if (left as f64) < LEAST_LEFT * points.len() as f64 || left == 0 {
            return refused(format!(
                "takes {} of {} points: nothing stands more than {} mm out of the plane",
                indices.len(),
                points.len(),
                self.margin_mm
            ));
        }
        let removed = RemovedPlane {
            normal: plane.normal,
            offset_mm: plane.offset_mm,
            share,
            rms_mm: (squares_mm2 / f64::from(inside)).sqrt(),
            removed: indices.len(),
        };
        Ok((removed, indices))
    }

    /// What is wrong with the parameters.
    pub fn violations(&self) -> Vec<Violation> {
        let mut violations = Vec::new();
        if !(self.margin_mm > 0.0 && self.margin_mm <= MAX_MARGIN_MM) {
            violations.push(Violation::new(
                "header.plane.margin_mm",
                format!(
                    "is {}, must be greater than 0 and at most {MAX_MARGIN_MM}",
                    self.margin_mm
                ),
            ));
        }
        if !SHARES.contains(&self.min_share) {
            violations.push(Violation::new(
                "header.plane.min_share",
                format!(
                    "is {}, must be {} to {}",
                    self.min_share,
                    SHARES.start(),
                    SHARES.end()
                ),
            ));
        }
        if self.planes == 0 || self.planes > MAX_PLANES {
            violations.push(Violation::new(
                "header.plane.planes",
                format!("is {}, must be 1 to {MAX_PLANES}", self.planes),
            ));
        }
        violations
    }

    /// The plane with most points near it.
    fn find(&self, points: &[SeenPoint]) -> Plane {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let sample: Vec<SeenPoint> = if points.len() <= SAMPLE {
            points.to_vec()
        } else {
            (0..SAMPLE)
                .map(|_| points[rng.random_range(0..points.len())])
                .collect()
        };
        let draws =
            (MISSED.ln() / (1.0 - self.min_share.powi(3)).max(f64::MIN_POSITIVE).ln()).ceil();
        let triples: Vec<[usize; 3]> = (0..draws.max(1.0) as usize)
            .map(|_| [0; 3].map(|_| rng.random_range(0..sample.len())))
            .collect();
        let mut drawn: Vec<(usize, Plane)> = triples
            .par_iter()
            .filter_map(|triple| Plane::through(triple.map(|index| sample[index].position)))
            .map(|plane| (self.count(&plane, &sample), plane))
            .collect();
        drawn.sort_by_key(|(count, _)| Reverse(*count));
        drawn.truncate(FITTED);
        let best = drawn
            .into_iter()
            .map(|(_, plane)| self.fitted(plane, &sample))
            .max_by_key(|plane| self.count(plane, &sample));
        // Points of which no three make a triangle lie on a line, which least squares tells as well.
        self.fitted(best.unwrap_or_else(|| Plane::fit(points.iter())), points)
    }

    /// Least squares on the points near the plane, until they no longer change.
    fn fitted(&self, mut plane: Plane, points: &[SeenPoint]) -> Plane {
        let mut held = 0;
        for _ in 0..ROUNDS {
            let near = points.iter().filter(|point| self.is_near(&plane, point));
            let count = near.clone().count();
            if count < 3 || count == held {
                break;
            }
            held = count;
            plane = Plane::fit(near);
        }
        plane
    }

    fn count(&self, plane: &Plane, points: &[SeenPoint]) -> usize {
        points
            .iter()
            .filter(|point| self.is_near(plane, point))
            .count()
    }

    fn is_near(&self, plane: &Plane, point: &SeenPoint) -> bool {
        plane.height_mm(&point.position).abs() <= self.reach_mm(point)
    }

    fn reach_mm(&self, point: &SeenPoint) -> f64 {
        self.margin_mm.max(SIGNIFICANT * point.sigma_mm)
    }

    /// The plane with its normal towards the viewpoints.
    fn facing(&self, plane: Plane, viewpoints: &[Point3]) -> Result<Plane, Error> {
        if viewpoints.is_empty() {
            return refused("has no viewpoint, needs at least 1".to_owned());
        }
        let heights = viewpoints
            .iter()
            .map(|viewpoint| plane.height_mm(viewpoint));
        let (low, high) = heights
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), height| {
                (low.min(height), high.max(height))
            });
        if low > self.margin_mm {
            Ok(plane)
        } else if high < -self.margin_mm {
            Ok(Plane {
                normal: -plane.normal,
                offset_mm: -plane.offset_mm,
            })
        } else {
            refused(format!(
                "finds a plane that the viewpoints are {low:.1} to {high:.1} mm above, all must be more than {} mm \
                 to one side of it",
                self.margin_mm
            ))
        }
    }
}

fn refused<T>(description: String) -> Result<T, Error> {
    Err(Error::Invalid(vec![Violation::new(
        "header.plane",
        description,
    )]))
}

/// `normal` · p = `offset_mm`.
#[derive(Clone, Copy, Debug)]
struct Plane {
    normal: Vector3,
    offset_mm: f64,
}

impl Plane {
    /// `None` if the three lie on a line.
    fn through([a, b, c]: [Point3; 3]) -> Option<Self> {
        let normal = (b - a).cross(&(c - a)).try_normalize(1e-9)?;
        Some(Self {
            normal,
            offset_mm: normal.dot(&a.coords),
        })
    }

    /// Least squares, each point weighted by its noise.
    fn fit<'a>(points: impl Iterator<Item = &'a SeenPoint> + Clone) -> Self {
        let weighted = points.map(|point| (point.sigma_mm.powi(-2), point.position.coords));
        let (weight, sum) = weighted
            .clone()
            .fold((0.0, Vector3::zeros()), |(weight, sum), (w, p)| {
                (weight + w, sum + p * w)
            });
        let middle = sum / weight;
        let spread: Matrix3<f64> = weighted
            .map(|(w, p)| (p - middle) * (p - middle).transpose() * w)
            .sum();
        let eigen = SymmetricEigen::new(spread / weight);
        let normal: Vector3 = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into();
        Self {
            normal,
            offset_mm: normal.dot(&middle),
        }
    }

    fn height_mm(&self, point: &Point3) -> f64 {
        self.normal.dot(&point.coords) - self.offset_mm
    }
}
