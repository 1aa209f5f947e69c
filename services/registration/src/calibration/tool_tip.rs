//! Where the tip of the tool is in the flange: the arm turns about the tip while that rests in a divot (pivot
//! calibration). The divot's place in the base comes with it.
//!
//! The start is the linear least squares of `R_i tip + t_i = divot`; the refinement weighs each pose by the noise of
//! the arm, whose rotation swings a long tool sideways but not along itself.

use arthro_geometry::frame::{Base, Flange};
use arthro_geometry::nalgebra::{Matrix3, Matrix6, SMatrix, SVector, Vector6};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};

use super::gate::{self, Gates, Reason};
use super::input::Checked;
use super::noise::{self, PoseNoise};
use super::robust::{Fit, Problem, fit};
use super::span::Span;
use crate::error::Error;

/// How far the tip may move in its divot, mm.
const PLAY_MM: std::ops::RangeInclusive<f64> = 0.0..=10.0;

/// What is known beforehand and what is demanded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Noise of the arm's poses; estimated from the residuals when not stated.
    pub arm_noise: Option<PoseNoise>,
    /// Standard deviation of the tip in its divot, each axis, mm. Counts only beside a stated `arm_noise`.
    pub divot_play_mm: f64,
    /// Largest root mean square distance of the tip to the divot, mm.
    pub residual_limit_mm: f64,
    /// Largest expected error of the tip, mm.
    pub uncertainty_limit_mm: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            arm_noise: None,
            divot_play_mm: 0.1,
            residual_limit_mm: 2.0,
            uncertainty_limit_mm: 0.5,
        }
    }
}

/// Where the tip is.
#[derive(Clone, Debug, PartialEq)]
pub struct ToolTip {
    /// In the flange, mm.
    pub tip_in_flange: Point3,
    /// Its covariance, mm2.
    pub tip_covariance_mm2: Matrix3<f64>,
    /// The divot, in the base, mm.
    pub divot_in_base: Point3,
    /// Its covariance, mm2.
    pub divot_covariance_mm2: Matrix3<f64>,
    /// How far the poses turn, without the rejected ones.
    pub span: Span,
    /// Distance of the tip to the divot in each pose.
    pub residuals: Vec<Residual>,
    /// Root mean square of the kept ones, mm. Does not fall with more poses; the tip's error does.
    pub residual_rms_mm: f64,
    /// The kept residuals over the stated noise; 1 when the noise was estimated. The covariances include it above 1.
    pub noise_ratio: f64,
    /// Expected error of the tip by the covariance, root mean square, mm.
    pub tip_deviation_mm: f64,
    /// Each kept pose against the answer without it, root mean square, mm. The noise of that one pose is in it.
    pub held_out_rms_mm: f64,
}

/// How far one pose is from the answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residual {
    /// Distance of the tip to the divot, mm.
    pub distance_mm: f64,
    /// The same in standard deviations of the noise.
    pub deviations: f64,
    /// Whether the pose was rejected as contradicting the rest.
    pub is_rejected: bool,
}

/// The tip, from poses base_from_flange that turn about it.
///
/// # Errors
/// Names every violation of the input, or every gate that was not passed.
pub fn solve(poses: &[Rigid<Base, Flange>], options: &Options) -> Result<ToolTip, Error> {
    check(poses, options)?;
    let turns: Vec<Rotation> = poses.iter().map(Rigid::rotation).collect();
    let mut gates = Gates::default();
    gates.poses(poses.len(), "are given");
    gates.span(&Span::of(&turns), "given");
    gates.axes(&Span::of(&turns), "given");
    gates.passed()?;

    let problem = Pivot { poses, options };
    let fit = fit(&problem).ok_or_else(|| gate::undetermined(poses.len()))?;
    let found = answer(&problem, &fit, &turns);

    let mut gates = Gates::default();
    gates.outliers(&fit.rejected(), poses.len());
    gates.poses(fit.kept_count(), "are left");
    gates.span(&found.span, "left");
    gates.axes(&found.span, "left");
    gates.at_most(
        Reason::ResidualTooLarge,
        found.residual_rms_mm,
        options.residual_limit_mm,
        format!(
            "the tip is {:.2} mm root mean square from the divot",
            found.residual_rms_mm
        ),
    );
    gates.at_most(
        Reason::UncertaintyTooLarge,
        found.tip_deviation_mm,
        options.uncertainty_limit_mm,
        format!(
            "the expected error of the tip is {:.2} mm",
            found.tip_deviation_mm
        ),
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
    checked.within("divot_play_mm", options.divot_play_mm, &PLAY_MM);
    checked.limit("residual_limit_mm", options.residual_limit_mm);
    checked.limit("uncertainty_limit_mm", options.uncertainty_limit_mm);
    checked.passed()
}

fn answer(pivot: &Pivot<'_>, fit: &Fit<Vector6<f64>, 6, 3>, turns: &[Rotation]) -> ToolTip {
    let tip_covariance_mm2 = fit.covariance.fixed_view::<3, 3>(0, 0).into_owned();
    let kept: Vec<usize> = fit.kept_indices().collect();
    let residuals: Vec<Residual> = (0..pivot.len())
        .map(|index| Residual {
            distance_mm: pivot.residual(index, &fit.state).norm(),
            deviations: fit.distances[index],
            is_rejected: !fit.kept[index],
        })
        .collect();
    let held_out_mm = kept.iter().map(|index| {
        fit.without(pivot, *index)
            .map_or(f64::INFINITY, |state| pivot.residual(*index, &state).norm())
    });
    ToolTip {
        tip_in_flange: tip(&fit.state).into(),
        tip_deviation_mm: noise::deviation(&tip_covariance_mm2),
        tip_covariance_mm2,
        divot_in_base: divot(&fit.state).into(),
        divot_covariance_mm2: fit.covariance.fixed_view::<3, 3>(3, 3).into_owned(),
        span: Span::of(&kept.iter().map(|index| turns[*index]).collect::<Vec<_>>()),
        residual_rms_mm: noise::rms(kept.iter().map(|index| residuals[*index].distance_mm)),
        held_out_rms_mm: noise::rms(held_out_mm),
        residuals,
        noise_ratio: fit.noise_ratio,
    }
}

/// Poses about one point. The unknowns are the tip in the flange, then the divot in the base.
struct Pivot<'a> {
    poses: &'a [Rigid<Base, Flange>],
    options: &'a Options,
}

fn tip(state: &Vector6<f64>) -> Vector3 {
    state.fixed_rows::<3>(0).into_owned()
}

fn divot(state: &Vector6<f64>) -> Vector3 {
    state.fixed_rows::<3>(3).into_owned()
}

impl Problem<6, 3> for Pivot<'_> {
    type State = Vector6<f64>;
    const GROUP: usize = 3;
    const SUBSET: usize = 4;

    fn len(&self) -> usize {
        self.poses.len()
    }

    fn starts(&self, poses: &[usize]) -> Vec<Vector6<f64>> {
        let (mut information, mut moment) = (Matrix6::zeros(), Vector6::zeros());
        for index in poses {
            let by = self.jacobian(*index, &Vector6::zeros());
            information += by.transpose() * by;
            moment -= by.transpose() * self.poses[*index].translation_mm();
        }
        let solved = information.cholesky().map(|factor| factor.solve(&moment));
        solved.into_iter().collect()
    }

    fn lever_mm(&self, _group: usize) -> f64 {
        1.0
    }

    fn residual(&self, index: usize, state: &Vector6<f64>) -> Vector3 {
        let pose = &self.poses[index];
        pose.direction(&tip(state)) + pose.translation_mm() - divot(state)
    }

    fn jacobian(&self, index: usize, _state: &Vector6<f64>) -> SMatrix<f64, 3, 6> {
        let mut jacobian = SMatrix::<f64, 3, 6>::zeros();
        let turn = self.poses[index]
            .rotation()
            .to_rotation_matrix()
            .into_inner();
        jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn);
        jacobian
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&-Matrix3::identity());
        jacobian
    }

    fn covariance(&self, index: usize, state: &Vector6<f64>) -> Option<Matrix3<f64>> {
        let arm = self.options.arm_noise?.covariance();
        let pose = self.poses[index].isometry();
        let by_arm = noise::point_covariance(pose, &arm, &tip(state).into());
        Some(by_arm + Matrix3::identity() * self.options.divot_play_mm.powi(2))
    }

    fn moved(&self, state: &Vector6<f64>, step: &SVector<f64, 6>) -> Vector6<f64> {
        state + step
    }
}
