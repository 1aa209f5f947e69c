//! The shaft's line in the flange, from poses in which it passes one fixed point that nobody knows.
//!
//! Seven unknowns: the line (two angles and two shifts across it, at the configured tip) and the point
//! (three). Pose i brings the point to `q_i = R_i^T (p - t_i)` in the flange; across the line it is off
//! by `E^T (q_i - c)`, with `c` on the line and `E` two directions across it. Turning the line by `alpha`
//! about `c` moves it at the point by `alpha h_i`, `h_i` from `c` along the line: only where `h_i` changes,
//! as the shaft slides through the point, does the direction show apart from a shift.

use arthro_geometry::frame::{Base, Flange, Tool};
use arthro_geometry::nalgebra::{Matrix3, Matrix3x2, SMatrix, SVector, Unit, Vector2};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};

use super::least_squares::{Fit, Problem, agree, minimise, weakest};
use super::{Agreement, Demands, Refusal, deviation};
use crate::rcm::Turn;

/// Angles are counted in these, mm at this lever, so that all unknowns are of one size.
const LEVER_MM: f64 = 100.0;
/// Every unknown must show in the residuals by this share of itself, root mean square: a slide of 5 mm, or
/// turns of some 3 degrees.
const SHARE_MIN: f64 = 0.03;

/// Where a shaft is in the flange.
#[derive(Clone, Debug, PartialEq)]
pub struct Shaft {
    /// Out of the tip.
    pub direction_in_flange: Unit<Vector3>,
    /// Its covariance, rad2; nothing along it.
    pub direction_covariance_rad2: Matrix3<f64>,
    /// The point of the line nearest to the configured tip, mm.
    pub point_in_flange: Point3,
    /// Its covariance across the line, mm2.
    pub point_covariance_mm2: Matrix3<f64>,
    /// The fixed point, in base, mm.
    pub portal: Point3,
    /// Its covariance, mm2.
    pub portal_covariance_mm2: Matrix3<f64>,
    /// Of all unknowns: turns across the line (rad), shifts across it (mm), the portal (mm).
    pub covariance: SMatrix<f64, 7, 7>,
    /// One for each pose, in order.
    pub agreements: Vec<Agreement>,
    /// Root mean square distance of the line to the point, mm.
    pub residual_rms_mm: f64,
    /// Standard deviation of the line's place by the residuals, each axis, mm.
    pub estimated_noise_mm: f64,
    /// The configured tool with this shaft: its tip moved across onto the line, its roll kept.
    pub flange_from_tool: Rigid<Flange, Tool>,
}

impl Shaft {
    /// Expected error of the direction, root mean square, rad.
    pub fn direction_deviation_rad(&self) -> f64 {
        deviation(&self.direction_covariance_rad2)
    }
}

/// What is demanded when nothing else is stated.
pub const DEMANDS: Demands = Demands {
    line_noise_mm: None,
    residual_limit_mm: 2.0,
    // A quarter of a degree: 1 mm at 240 mm.
    uncertainty_limit: 0.00436,
};

/// The shaft, from poses base_from_flange, and the tool as it is configured: the start of the search.
///
/// # Errors
/// The poses leave an unknown open, do not agree, one contradicts the rest, or the direction is too uncertain.
pub fn solve(
    poses: &[Rigid<Base, Flange>],
    configured: &Rigid<Flange, Tool>,
    demands: &Demands,
) -> Result<Shaft, Refusal> {
    let through = Through { poses };
    let start = Unknowns::configured(poses, configured);
    sees_all(&through, &start)?;
    let fit =
        minimise(&through, start, |_| true).ok_or_else(|| undetermined(0.0, &SVector::zeros()))?;
    sees_all(&through, &fit.state)?;
    agree(&through, &fit, demands.line_noise_mm)?;
    let found = answer(&through, &fit, configured, demands.line_noise_mm);
    if !(..=demands.residual_limit_mm).contains(&found.residual_rms_mm) {
        return Err(Refusal::ResidualTooLarge {
            rms_mm: found.residual_rms_mm,
            limit_mm: demands.residual_limit_mm,
        });
    }
    let value = found.direction_deviation_rad();
    if !(..=demands.uncertainty_limit).contains(&value) {
        return Err(Refusal::UncertaintyTooLarge {
            of: "the shaft's direction",
            value,
            limit: demands.uncertainty_limit,
            unit: "rad",
        });
    }
    Ok(found)
}

/// Root mean square distance of the configured shaft to a point in base over the poses, mm.
pub fn residual_rms_mm(
    poses: &[Rigid<Base, Flange>],
    flange_from_tool: &Rigid<Flange, Tool>,
    portal: &Point3,
) -> f64 {
    let squares: f64 = poses
        .iter()
        .map(|pose| {
            let placement = crate::rcm::Placement::of(&(*pose * *flange_from_tool), portal);
            placement.deviation_mm().powi(2)
        })
        .sum();
    (squares / poses.len().max(1) as f64).sqrt()
}

fn sees_all(through: &Through<'_>, state: &Unknowns) -> Result<(), Refusal> {
    let weakest = weakest(through, state);
    if (SHARE_MIN..).contains(&weakest.share) {
        return Ok(());
    }
    Err(undetermined(weakest.share, &weakest.direction))
}

fn undetermined(share: f64, direction: &SVector<f64, 7>) -> Refusal {
    // A turn of the line and a shift of it look alike where nothing slides; so do line and point where nothing turns.
    let line = direction.fixed_rows::<4>(0).norm();
    let turn = direction.fixed_rows::<2>(0).norm();
    let (unknown, remedy) = if turn > 0.3 * line && line > 0.3 {
        (
            "the shaft's direction",
            "let the shaft slide through the point, by 40 mm or more",
        )
    } else {
        (
            "the fixed point",
            "turn the shaft about the point, by 20 degrees or more in every direction",
        )
    };
    Refusal::Undetermined {
        unknown,
        share,
        limit: SHARE_MIN,
        remedy,
    }
}

fn answer(
    through: &Through<'_>,
    fit: &Fit<Unknowns, 7>,
    configured: &Rigid<Flange, Tool>,
    stated_mm: Option<f64>,
) -> Shaft {
    let Unknowns {
        line,
        point,
        portal,
    } = &fit.state;
    let poses = through.poses;
    let variance_mm2 = fit.variance_mm2(stated_mm).unwrap_or(0.0);
    let noise_mm = variance_mm2.sqrt();
    // Back from lever lengths to angles.
    let mut units = SVector::<f64, 7>::repeat(1.0);
    units.fixed_rows_mut::<2>(0).fill(1.0 / LEVER_MM);
    let units = SMatrix::<f64, 7, 7>::from_diagonal(&units);
    let covariance = units * fit.unit_covariance * units * variance_mm2;
    let across = across(line);
    let spread = |block: usize| {
        let part = covariance.fixed_view::<2, 2>(block, block).into_owned();
        across * part * across.transpose()
    };
    let direction = Unit::new_normalize(line * Vector3::x());
    let point = point + direction.into_inner() * direction.dot(&(configured.origin() - point));
    let agreements = poses.iter().enumerate().map(|(index, pose)| {
        let distance_mm = through.residual(index, &fit.state).norm();
        let in_flange = pose.inverse() * *portal;
        Agreement {
            distance_mm,
            deviations: distance_mm / noise_mm.max(f64::MIN_POSITIVE),
            depth_mm: (point - in_flange).dot(&direction),
        }
    });
    let turned = Turn::between(&configured.direction(&Vector3::x()), &direction).part(1.0);
    Shaft {
        direction_in_flange: direction,
        direction_covariance_rad2: spread(0),
        point_in_flange: point,
        point_covariance_mm2: spread(2),
        portal: *portal,
        portal_covariance_mm2: covariance.fixed_view::<3, 3>(4, 4).into_owned(),
        covariance,
        agreements: agreements.collect(),
        residual_rms_mm: (fit.cost_mm2 / poses.len() as f64).sqrt(),
        estimated_noise_mm: (fit.cost_mm2 / fit.freedom.max(1) as f64).sqrt(),
        flange_from_tool: Rigid::new(turned * configured.rotation(), point.coords),
    }
}

/// The unknowns.
#[derive(Clone, Copy, Debug)]
struct Unknowns {
    /// x along the shaft, y and z across it, in the flange.
    line: Rotation,
    /// Of the line, in the flange, mm.
    point: Point3,
    /// In base, mm.
    portal: Point3,
}

impl Unknowns {
    /// The configured line, and the point that it comes nearest to.
    fn configured(poses: &[Rigid<Base, Flange>], configured: &Rigid<Flange, Tool>) -> Self {
        let (mut sum, mut moment) = (Matrix3::identity() * 1e-6, Vector3::zeros());
        for pose in poses {
            let tool = *pose * *configured;
            let along = tool.direction(&Vector3::x());
            let across = Matrix3::identity() - along * along.transpose();
            sum += across;
            moment += across * tool.translation_mm();
        }
        // Where nothing turns the tip of the first pose is as good a point as any; that is refused next.
        let portal = sum
            .try_inverse()
            .map_or(Vector3::zeros(), |inverse| inverse * moment);
        Self {
            line: configured.rotation(),
            point: configured.origin(),
            portal: portal.into(),
        }
    }
}

fn across(line: &Rotation) -> Matrix3x2<f64> {
    Matrix3x2::from_columns(&[line * Vector3::y(), line * Vector3::z()])
}

/// Poses whose shaft passes one point.
struct Through<'a> {
    poses: &'a [Rigid<Base, Flange>],
}

impl Problem<7> for Through<'_> {
    type State = Unknowns;

    fn len(&self) -> usize {
        self.poses.len()
    }

    fn residual(&self, index: usize, state: &Unknowns) -> Vector2<f64> {
        let in_flange = self.poses[index].inverse() * state.portal;
        across(&state.line).tr_mul(&(in_flange - state.point))
    }

    fn jacobian(&self, index: usize, state: &Unknowns) -> SMatrix<f64, 2, 7> {
        let pose = &self.poses[index];
        let in_flange = pose.inverse() * state.portal;
        let height_mm = (state.line * Vector3::x()).dot(&(in_flange - state.point));
        let turn = pose.rotation().to_rotation_matrix().into_inner();
        let mut jacobian = SMatrix::<f64, 2, 7>::zeros();
        for axis in 0..2 {
            jacobian[(axis, axis)] = -height_mm / LEVER_MM;
            jacobian[(axis, 2 + axis)] = -1.0;
        }
        let by_portal = across(&state.line).transpose() * turn.transpose();
        jacobian.fixed_view_mut::<2, 3>(0, 4).copy_from(&by_portal);
        jacobian
    }

    /// Turning the line by `alpha` towards its own y and z, and shifting it along them.
    fn moved(&self, state: &Unknowns, step: &SVector<f64, 7>) -> Unknowns {
        let across = across(&state.line);
        let alpha = step.fixed_rows::<2>(0) / LEVER_MM;
        // A turn about z takes x towards y, one about y takes it away from z.
        let turn = Rotation::from_scaled_axis(Vector3::new(0.0, -alpha.y, alpha.x));
        Unknowns {
            line: state.line * turn,
            point: state.point + across * step.fixed_rows::<2>(2),
            portal: state.portal + step.fixed_rows::<3>(4),
        }
    }
}
