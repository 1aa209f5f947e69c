//! A portal from taught shaft lines: the point that all of them come nearest to.
//!
//! With a line through `a` along `u`, its distance to `p` is `|(I - u u^T)(p - a)|`; the sum of squares is
//! least where `sum (I - u u^T) p = sum (I - u u^T) a`.

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::nalgebra::{Matrix3, Matrix3x2, SMatrix, Unit, Vector2};
use arthro_geometry::{Point3, Rigid, Vector3};

use super::least_squares::{Fit, Problem, agree, minimise};
use super::{Agreement, Demands, Refusal, deviation};
use crate::rcm::{Placement, Turn, shaft};

/// Lines must differ by this, rad: at 10 degrees the point is six times as uncertain along the lines as
/// across them.
pub const SPREAD_MIN_RAD: f64 = 0.1745;
/// With two lines the one number left over is no measure of the noise.
const FREEDOM_MIN: usize = 3;

/// Where a portal is.
#[derive(Clone, Debug, PartialEq)]
pub struct TaughtPortal {
    /// In base, mm.
    pub portal: Point3,
    /// Its covariance, mm2; `None` when neither stated noise nor a third line tells it.
    pub covariance_mm2: Option<Matrix3<f64>>,
    /// Mean direction of the lines, out of the tip.
    pub axis: Unit<Vector3>,
    /// One for each line, in order.
    pub agreements: Vec<Agreement>,
    /// Root mean square distance of the lines, mm.
    pub residual_rms_mm: f64,
    /// Largest angle between two lines, rad.
    pub spread_rad: f64,
}

/// What is demanded when nothing else is stated.
pub const DEMANDS: Demands = Demands {
    line_noise_mm: None,
    residual_limit_mm: 2.0,
    uncertainty_limit: 1.0,
};

/// The portal that the shafts of these poses come nearest to.
///
/// # Errors
/// The lines are parallel, do not agree, one contradicts the rest, or the portal is too uncertain.
pub fn solve(poses: &[Rigid<Base, Tool>], demands: &Demands) -> Result<TaughtPortal, Refusal> {
    let spread_rad = spread_rad(poses);
    if !(SPREAD_MIN_RAD..).contains(&spread_rad) {
        return Err(Refusal::LinesParallel {
            spread_rad,
            limit_rad: SPREAD_MIN_RAD,
        });
    }
    let lines = Lines::of(poses);
    let start = poses.first().map_or(Point3::origin(), Rigid::origin);
    let fit: Fit<Point3, 3> = minimise(&lines, start, |_| true).ok_or(Refusal::LinesParallel {
        spread_rad,
        limit_rad: SPREAD_MIN_RAD,
    })?;
    let noise_mm = demands.line_noise_mm;
    agree(&lines, &fit, noise_mm)?;
    let residual_rms_mm = (fit.cost_mm2 / poses.len() as f64).sqrt();
    if !(..=demands.residual_limit_mm).contains(&residual_rms_mm) {
        return Err(Refusal::ResidualTooLarge {
            rms_mm: residual_rms_mm,
            limit_mm: demands.residual_limit_mm,
        });
    }
    let variance_mm2 = fit
        .variance_mm2(noise_mm)
        .filter(|_| noise_mm.is_some() || fit.freedom >= FREEDOM_MIN);
    let covariance_mm2 = variance_mm2.map(|variance| fit.unit_covariance * variance);
    if let Some(covariance) = &covariance_mm2 {
        let value = deviation(covariance);
        if !(..=demands.uncertainty_limit).contains(&value) {
            return Err(Refusal::UncertaintyTooLarge {
                of: "the portal",
                value,
                limit: demands.uncertainty_limit,
                unit: "mm",
            });
        }
    }
    let noise_mm = variance_mm2.map(f64::sqrt);
    let agreements = poses.iter().map(|pose| {
        let placement = Placement::of(pose, &fit.state);
        let distance_mm = placement.deviation_mm();
        Agreement {
            distance_mm,
            deviations: noise_mm.map_or(0.0, |noise_mm| {
                distance_mm / noise_mm.max(f64::MIN_POSITIVE)
            }),
            depth_mm: placement.depth_mm,
        }
    });
    let sum: Vector3 = poses.iter().map(shaft).sum();
    Ok(TaughtPortal {
        portal: fit.state,
        covariance_mm2,
        axis: Unit::try_new(sum, 1e-6).ok_or(Refusal::LinesParallel {
            spread_rad: std::f64::consts::PI - spread_rad,
            limit_rad: SPREAD_MIN_RAD,
        })?,
        agreements: agreements.collect(),
        residual_rms_mm,
        spread_rad,
    })
}

/// The largest angle between two shafts, rad. Lines that run opposite ways are parallel too.
fn spread_rad(poses: &[Rigid<Base, Tool>]) -> f64 {
    let directions: Vec<Vector3> = poses.iter().map(shaft).collect();
    let mut most = 0.0_f64;
    for (index, a) in directions.iter().enumerate() {
        for b in &directions[index + 1..] {
            let angle = Turn::between(a, b).angle_rad;
            most = most.max(angle.min(std::f64::consts::PI - angle));
        }
    }
    most
}

struct Lines(Vec<(Point3, Matrix3x2<f64>)>);

impl Lines {
    /// A point of each line and two directions across it: the tool's y and z.
    fn of(poses: &[Rigid<Base, Tool>]) -> Self {
        let line = |pose: &Rigid<Base, Tool>| {
            let across = [Vector3::y(), Vector3::z()].map(|axis| pose.direction(&axis));
            (pose.origin(), Matrix3x2::from_columns(&across))
        };
        Self(poses.iter().map(line).collect())
    }
}

impl Problem<3> for Lines {
    type State = Point3;

    fn len(&self) -> usize {
        self.0.len()
    }

    fn residual(&self, index: usize, portal: &Point3) -> Vector2<f64> {
        let (point, across) = &self.0[index];
        across.tr_mul(&(portal - point))
    }

    fn jacobian(&self, index: usize, _portal: &Point3) -> SMatrix<f64, 2, 3> {
        self.0[index].1.transpose()
    }

    fn moved(&self, portal: &Point3, step: &Vector3) -> Point3 {
        portal + step
    }
}
