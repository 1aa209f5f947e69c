//! What the camera saw, made ready for matching: strays taken out, thinned to three densities, with lines of sight
//! where the viewpoint is known and with the noise that the points carry.

use arthro_geometry::{Cloud, Point3, Vector3};
use nalgebra::{Matrix3, SymmetricEigen};

use crate::cells::Cells;
use crate::model::root_mean_square;
use crate::moments::Moments;
use crate::sampling;

/// Points of the three densities: many hypotheses, the best of them, the finalists.
const SPARSE: usize = 110;
const MEDIUM: usize = 500;
const DENSE: usize = 3000;
/// A point with less than this share of the usual number of neighbours is a stray.
const STRAY_SHARE: f64 = 0.3;
/// How far neighbours are counted, spacings.
const STRAY_REACH: f64 = 3.0;
/// Fewer points than this tell no noise.
const LEAST_NEIGHBOURS: f64 = 8.0;
/// Radius over which noise is told from shape, spacings.
const NOISE_REACH: f64 = 3.0;

/// A view, mm, about its own centre.
#[derive(Clone, Debug)]
pub struct View {
    /// Middle of the view, in the frame of the cloud it came from.
    pub center: Point3,
    /// Evenly spread, each the average of several points.
    pub sparse: Seen,
    /// Likewise.
    pub medium: Seen,
    /// All points but the strays, or most of them.
    pub dense: Seen,
    /// Where the camera stood, about `center`.
    pub viewpoint: Option<Point3>,
    /// Median distance between neighbouring points.
    pub spacing_mm: f64,
    /// Deviation of the points from the smooth surface they lie on.
    pub noise_mm: f64,
    /// Share of the points that stand alone and were taken out, 0..1.
    pub stray_share: f64,
    /// Length of the diagonal of the box along the view's own main directions, a few strays left out.
    pub extent_mm: f64,
}

/// Points and the unit directions in which the camera saw them.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    /// Positions about the view's centre.
    pub points: Vec<Point3>,
    /// One direction a point, away from the camera; empty if the viewpoint is unknown.
    pub sight: Vec<Vector3>,
    /// Median distance between neighbouring points.
    pub spacing_mm: f64,
}

impl View {
    /// Prepares `cloud`, seen from `viewpoint`. Not for fewer than a handful of points.
    pub fn new(cloud: &Cloud, viewpoint: Option<Point3>) -> Self {
        let most = sampling::spread(&cloud.points, 2 * DENSE);
        let spacing_mm = sampling::spacing_mm(&most);
        let kept = without_strays(&most, spacing_mm);
        let stray_share = 1.0 - kept.len() as f64 / most.len() as f64;
        let center =
            Point3::from(kept.iter().map(|p| p.coords).sum::<Vector3>() / kept.len() as f64);
        let kept: Vec<Point3> = kept.into_iter().map(|p| p - center.coords).collect();
        let viewpoint = viewpoint.map(|p| p - center.coords);
        let seen = |points: Vec<Point3>| Seen {
            sight: viewpoint.map_or(Vec::new(), |eye| {
                let toward = |p: &Point3| (p - eye).try_normalize(1e-9).unwrap_or_else(Vector3::z);
                points.iter().map(toward).collect()
            }),
            spacing_mm: sampling::spacing_mm(&points),
            points,
        };
        Self {
            center,
            sparse: seen(sampling::spread(&kept, SPARSE)),
            medium: seen(sampling::spread(&kept, MEDIUM)),
            noise_mm: noise_mm(&kept, spacing_mm),
            extent_mm: extent_mm(&kept),
            dense: seen(if kept.len() > DENSE {
                sampling::spread(&kept, DENSE)
            } else {
                kept
            }),
            viewpoint,
            spacing_mm,
            stray_share,
        }
    }

    /// The view as a mirror at its own centre shows it.
    pub fn mirrored(&self) -> Self {
        let seen = |seen: &Seen| Seen {
            points: seen
                .points
                .iter()
                .map(|p| Point3::new(-p.x, p.y, p.z))
                .collect(),
            sight: seen
                .sight
                .iter()
                .map(|s| Vector3::new(-s.x, s.y, s.z))
                .collect(),
            spacing_mm: seen.spacing_mm,
        };
        Self {
            sparse: seen(&self.sparse),
            medium: seen(&self.medium),
            dense: seen(&self.dense),
            viewpoint: self.viewpoint.map(|p| Point3::new(-p.x, p.y, p.z)),
            ..*self
        }
    }
}

/// The points that have neighbours.
fn without_strays(points: &[Point3], spacing_mm: f64) -> Vec<Point3> {
    let reach_mm = STRAY_REACH * spacing_mm;
    let cells = Cells::new(points, reach_mm);
    let counts: Vec<f64> = points
        .iter()
        .map(|point| (cells.count_within(point, reach_mm) - 1) as f64)
        .collect();
    let usual = sampling::median(&mut counts.clone());
    let kept: Vec<Point3> = points
        .iter()
        .zip(&counts)
        .filter(|(_, count)| **count >= STRAY_SHARE * usual)
        .map(|(point, _)| *point)
        .collect();
    kept
}

/// Median over places of the deviation from the plane that fits there best.
fn noise_mm(points: &[Point3], spacing_mm: f64) -> f64 {
    let reach_mm = NOISE_REACH * spacing_mm;
    let cells = Cells::new(points, reach_mm);
    let mut deviations: Vec<f64> = points
        .iter()
        .step_by(points.len() / 200 + 1)
        .filter_map(|point| {
            let moments = Moments::around(point, points, &cells, reach_mm)?;
            // A plane takes three of the points for itself.
            let freedom = (moments.count / (moments.count - 3.0)).sqrt();
            (moments.count >= LEAST_NEIGHBOURS).then(|| moments.plane().deviation_mm * freedom)
        })
        .collect();
    sampling::median(&mut deviations)
}

/// Diagonal of the box along the main directions that holds all but a hundredth of the points at each side.
pub(crate) fn extent_mm(points: &[Point3]) -> f64 {
    let count = points.len().max(1) as f64;
    let mean = points.iter().map(|p| p.coords).sum::<Vector3>() / count;
    let covariance: Matrix3<f64> = points
        .iter()
        .map(|p| p.coords - mean)
        .map(|d| d * d.transpose())
        .sum();
    let axes = SymmetricEigen::new(covariance).eigenvectors;
    let sides = (0..3).map(|axis| {
        let mut along: Vec<f64> = points
            .iter()
            .map(|p| axes.column(axis).dot(&p.coords))
            .collect();
        along.sort_by(f64::total_cmp);
        let cut = along.len() / 100;
        match (
            along.get(cut),
            along
                .len()
                .checked_sub(cut + 1)
                .and_then(|last| along.get(last)),
        ) {
            (Some(low), Some(high)) => high - low,
            _ => 0.0,
        }
    });
    root_mean_square(sides) * 3f64.sqrt()
}
