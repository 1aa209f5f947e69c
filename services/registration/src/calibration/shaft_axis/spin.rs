//! The shaft's line from poses that turn about it: the shaft lies in a bushing, in which it turns and slides while
//! the line itself stands still in the base (spin calibration).

use arthro_geometry::frame::{Base, Flange};
use arthro_geometry::nalgebra::{
    Matrix2, Matrix3, Matrix3x2, Matrix4, SMatrix, SVector, SymmetricEigen, Unit, Vector4,
};
use arthro_geometry::{Rigid, Rotation, Vector3};

use super::ShaftAxis;
use crate::calibration::gate::{self, Gates, Reason};
use crate::calibration::input::Checked;
use crate::calibration::noise::{self, PoseNoise};
use crate::calibration::robust::{Fit, Problem, fit};
use crate::calibration::span::Span;
use crate::error::Error;

/// Millimetres that a radian of the direction stands for when starts are compared: a shaft's length.
const SHAFT_MM: f64 = 300.0;

/// What is known beforehand and what is demanded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Roughly along the shaft and out of the tip, in the flange: tells the two ends of the line apart.
    pub towards_tip: Vector3,
    /// Noise of the arm's poses; estimated from the residuals when not stated.
    pub arm_noise: Option<PoseNoise>,
    /// Largest root mean square distance of the line from where it stands, mm.
    pub residual_limit_mm: f64,
    /// Largest root mean square turn of the line against where it stands, rad.
    pub residual_limit_rad: f64,
    /// Largest expected error of the direction, rad.
    pub uncertainty_limit_rad: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            towards_tip: Vector3::z(),
            arm_noise: None,
            residual_limit_mm: 2.0,
            residual_limit_rad: 0.5_f64.to_radians(),
            uncertainty_limit_rad: 0.2_f64.to_radians(),
        }
    }
}

/// The line and its evidence.
#[derive(Clone, Debug, PartialEq)]
pub struct Spin {
    /// The shaft in the flange.
    pub axis: ShaftAxis,
    /// How far the poses turn, without the rejected ones.
    pub span: Span,
    /// One a pose.
    pub residuals: Vec<Residual>,
    /// Root mean square of the kept turns and distances.
    pub residual_rms: PoseNoise,
    /// The kept residuals over the stated noise; 1 when the noise was estimated. The covariances include it above 1.
    pub noise_ratio: f64,
}

/// How far one pose is from the answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residual {
    /// Turn of the shaft against its line in the base, rad.
    pub rotation_rad: f64,
    /// Distance between both, mm.
    pub distance_mm: f64,
    /// Both in standard deviations of the noise.
    pub deviations: f64,
    /// Whether the pose was rejected as contradicting the rest.
    pub is_rejected: bool,
}

/// The shaft's line, from poses base_from_flange that turn about it.
///
/// # Errors
/// Names every violation of the input, or every gate that was not passed.
pub fn solve(poses: &[Rigid<Base, Flange>], options: &Options) -> Result<Spin, Error> {
    check(poses, options)?;
    let turns: Vec<Rotation> = poses.iter().map(Rigid::rotation).collect();
    let mut gates = Gates::default();
    gates.poses(poses.len(), "are given");
    gates.span(&Span::of(&turns), "given");
    gates.passed()?;

    let problem = Bushing { poses, options };
    let fit = fit(&problem).ok_or_else(|| gate::undetermined(poses.len()))?;
    let found = answer(&problem, &fit, &turns);

    let mut gates = Gates::default();
    gates.outliers(&fit.rejected(), poses.len());
    gates.poses(fit.kept_count(), "are left");
    gates.span(&found.span, "left");
    let rms = found.residual_rms;
    gates.at_most(
        Reason::ResidualTooLarge,
        rms.translation_mm,
        options.residual_limit_mm,
        format!(
            "the shaft is {:.2} mm root mean square beside one line",
            rms.translation_mm
        ),
    );
    let turn_deg = rms.rotation_rad.to_degrees();
    gates.at_most(
        Reason::ResidualTooLarge,
        turn_deg,
        options.residual_limit_rad.to_degrees(),
        format!("the shaft leans {turn_deg:.2} degrees root mean square from one line"),
    );
    gates.direction(
        found.axis.direction_deviation_rad(),
        options.uncertainty_limit_rad,
    );
    gates.passed()?;
    Ok(found)
}

fn check(poses: &[Rigid<Base, Flange>], options: &Options) -> Result<(), Error> {
    let mut checked = Checked::default();
    checked.count("poses", poses.len());
    for (index, pose) in poses.iter().enumerate() {
        checked.pose(|| format!("poses[{index}]"), pose.isometry());
    }
    checked.noise("arm_noise", options.arm_noise);
    checked.within("towards_tip", options.towards_tip.norm(), &(1e-6..=1e6));
    checked.limit("residual_limit_mm", options.residual_limit_mm);
    checked.limit("residual_limit_rad", options.residual_limit_rad);
    checked.limit("uncertainty_limit_rad", options.uncertainty_limit_rad);
    checked.passed()
}

fn answer(bushing: &Bushing<'_>, fit: &Fit<Lines, 8, 4>, turns: &[Rotation]) -> Spin {
    let Lines { along, point, .. } = fit.state;
    let plane = across(&along);
    let in_flange = |first: usize| -> Matrix3<f64> {
        let block: Matrix2<f64> = fit.covariance.fixed_view::<2, 2>(first, first).into_owned();
        plane * block * plane.transpose()
    };
    let kept: Vec<usize> = fit.kept_indices().collect();
    let residuals: Vec<Residual> = (0..bushing.len())
        .map(|index| {
            let residual = bushing.residual(index, &fit.state);
            Residual {
                rotation_rad: residual.fixed_rows::<2>(0).norm(),
                distance_mm: residual.fixed_rows::<2>(2).norm(),
                deviations: fit.distances[index],
                is_rejected: !fit.kept[index],
            }
        })
        .collect();
    Spin {
        axis: ShaftAxis {
            direction_in_flange: along,
            direction_covariance_rad2: in_flange(0),
            point_in_flange: (point - along.into_inner() * along.dot(&point)).into(),
            point_covariance_mm2: in_flange(2),
        },
        span: Span::of(&kept.iter().map(|index| turns[*index]).collect::<Vec<_>>()),
        residual_rms: PoseNoise {
            rotation_rad: noise::rms(kept.iter().map(|index| residuals[*index].rotation_rad)),
            translation_mm: noise::rms(kept.iter().map(|index| residuals[*index].distance_mm)),
        },
        residuals,
        noise_ratio: fit.noise_ratio,
    }
}

/// Poses with one line at rest.
struct Bushing<'a> {
    poses: &'a [Rigid<Base, Flange>],
    options: &'a Options,
}

/// The same line twice. The unknowns are turns of `along` and moves of `point` across it, then those of the other pair.
#[derive(Clone, Copy, Debug)]
struct Lines {
    /// Direction in the flange.
    along: Unit<Vector3>,
    /// A point of the line in the flange.
    point: Vector3,
    /// Direction in the base.
    rest: Unit<Vector3>,
    /// A point of the line in the base.
    rest_point: Vector3,
}

/// Two unit vectors across a direction, the same for the same direction.
fn across(direction: &Unit<Vector3>) -> Matrix3x2<f64> {
    let least = Vector3::ith(direction.map(f64::abs).imin(), 1.0);
    let first = direction.cross(&least).normalize();
    Matrix3x2::from_columns(&[first, direction.cross(&first)])
}

impl Bushing<'_> {
    fn turn(&self, index: usize) -> Matrix3<f64> {
        self.poses[index]
            .rotation()
            .to_rotation_matrix()
            .into_inner()
    }

    /// Direction: the one that the mean rotation shortens least. Point: linear least squares across it.
    fn closed_form(&self, poses: &[usize]) -> Option<Lines> {
        let count = poses.len() as f64;
        let mean: Matrix3<f64> = poses
            .iter()
            .map(|index| self.turn(*index))
            .sum::<Matrix3<f64>>()
            / count;
        let eigen = SymmetricEigen::new(mean.transpose() * mean);
        let axis: Vector3 = eigen
            .eigenvectors
            .column(eigen.eigenvalues.imax())
            .into_owned();
        let along = Unit::new_normalize(axis * axis.dot(&self.options.towards_tip).signum());
        let rest = Unit::try_new(mean * along.into_inner(), 1e-6)?;
        let middle = poses
            .iter()
            .map(|index| self.poses[*index].translation_mm())
            .sum::<Vector3>()
            / count;
        let (plane, rest_plane) = (across(&along), across(&rest));
        let (mut information, mut moment) = (Matrix4::zeros(), Vector4::zeros());
        for index in poses {
            let mut by = SMatrix::<f64, 2, 4>::zeros();
            by.fixed_view_mut::<2, 2>(0, 0)
                .copy_from(&(rest_plane.transpose() * self.turn(*index) * plane));
            by.fixed_view_mut::<2, 2>(0, 2)
                .copy_from(&-Matrix2::identity());
            let offset = rest_plane.transpose() * (self.poses[*index].translation_mm() - middle);
            information += by.transpose() * by;
            moment -= by.transpose() * offset;
        }
        let solved = information.cholesky()?.solve(&moment);
        Some(Lines {
            along,
            point: plane * solved.fixed_rows::<2>(0),
            rest,
            rest_point: middle + rest_plane * solved.fixed_rows::<2>(2),
        })
    }
}

impl Problem<8, 4> for Bushing<'_> {
    type State = Lines;
    const GROUP: usize = 2;
    const SUBSET: usize = 5;

    fn len(&self) -> usize {
        self.poses.len()
    }

    fn starts(&self, poses: &[usize]) -> Vec<Lines> {
        self.closed_form(poses).into_iter().collect()
    }

    fn lever_mm(&self, group: usize) -> f64 {
        [SHAFT_MM, 1.0][group.min(1)]
    }

    /// The shaft against its line at rest, across that line: turn (rad), then offset (mm).
    fn residual(&self, index: usize, state: &Lines) -> Vector4<f64> {
        let pose = &self.poses[index];
        let plane = across(&state.rest).transpose();
        let turn = plane * pose.direction(&state.along);
        let offset =
            plane * (pose.direction(&state.point) + pose.translation_mm() - state.rest_point);
        Vector4::new(turn.x, turn.y, offset.x, offset.y)
    }

    fn jacobian(&self, index: usize, state: &Lines) -> SMatrix<f64, 4, 8> {
        let pose = &self.poses[index];
        let by_flange = across(&state.rest).transpose() * self.turn(index) * across(&state.along);
        // How far the pose slid along the line: a turn of the line at rest moves it sideways there.
        let slid_mm = (pose.direction(&state.point) + pose.translation_mm() - state.rest_point)
            .dot(&state.rest);
        let eye = Matrix2::identity();
        let mut jacobian = SMatrix::<f64, 4, 8>::zeros();
        jacobian.fixed_view_mut::<2, 2>(0, 0).copy_from(&by_flange);
        jacobian.fixed_view_mut::<2, 2>(0, 4).copy_from(&-eye);
        jacobian.fixed_view_mut::<2, 2>(2, 2).copy_from(&by_flange);
        jacobian
            .fixed_view_mut::<2, 2>(2, 4)
            .copy_from(&(eye * -slid_mm));
        jacobian.fixed_view_mut::<2, 2>(2, 6).copy_from(&-eye);
        jacobian
    }

    fn covariance(&self, index: usize, state: &Lines) -> Option<Matrix4<f64>> {
        let arm = self.options.arm_noise?.covariance();
        let pose = &self.poses[index];
        let plane = across(&state.rest).transpose();
        let mut by = SMatrix::<f64, 4, 6>::zeros();
        by.fixed_view_mut::<2, 3>(0, 0)
            .copy_from(&(-plane * pose.direction(&state.along).cross_matrix()));
        by.fixed_view_mut::<2, 3>(2, 0)
            .copy_from(&(-plane * pose.direction(&state.point).cross_matrix()));
        by.fixed_view_mut::<2, 3>(2, 3).copy_from(&plane);
        Some(by * arm * by.transpose())
    }

    fn moved(&self, state: &Lines, step: &SVector<f64, 8>) -> Lines {
        let (plane, rest_plane) = (across(&state.along), across(&state.rest));
        let turned = |direction: &Unit<Vector3>, by: Vector3| {
            Unit::new_normalize(direction.into_inner() + by)
        };
        Lines {
            along: turned(&state.along, plane * step.fixed_rows::<2>(0)),
            point: state.point + plane * step.fixed_rows::<2>(2),
            rest: turned(&state.rest, rest_plane * step.fixed_rows::<2>(4)),
            rest_point: state.rest_point + rest_plane * step.fixed_rows::<2>(6),
        }
    }
}
