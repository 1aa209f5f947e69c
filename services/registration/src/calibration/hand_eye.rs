//! Where the camera is: on a stand beside the arm with the board on the flange, or on the flange with the board
//! standing still.
//!
//! Both are `A X = Z B` (see `robot_world`). The answer is the joint refinement of both mountings; the closed forms
//! it began from are given beside it.

mod answer;

use arthro_geometry::frame::{Base, Board, Camera, Flange, Frame};
use arthro_geometry::{Point3, Rigid, Rotation};

use super::gate::{self, Gates, Reason};
use super::input::Checked;
use super::noise::{self, PoseCovariance, PoseNoise};
use super::robot_world::{Equation, RobotWorld, Wanted};
use super::robust::fit;
use super::span::Span;
use crate::error::Error;

/// The arm at rest in one pose, and what the camera saw of the board then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Station {
    /// By the arm, at its flange.
    pub base_from_flange: Rigid<Base, Flange>,
    /// By the camera.
    pub camera_from_board: Rigid<Camera, Board>,
    /// Covariance of `camera_from_board`, as the solver of the board's pose gives it; before `Options::camera_noise`.
    pub camera_covariance: Option<PoseCovariance>,
}

/// What is known beforehand and what is demanded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Where the answer is to be used, in the camera's frame.
    pub work_point: Point3,
    /// Noise of `base_from_flange`. Stated together with the camera's, or both are estimated from the residuals.
    pub arm_noise: Option<PoseNoise>,
    /// Noise of `camera_from_board` where a station has no covariance.
    pub camera_noise: Option<PoseNoise>,
    /// Largest root mean square displacement between arm and camera, mm.
    pub residual_limit_mm: f64,
    /// Largest expected error at the work point, mm.
    pub uncertainty_limit_mm: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            work_point: Point3::new(0.0, 0.0, 350.0),
            arm_noise: None,
            camera_noise: None,
            residual_limit_mm: 3.0,
            uncertainty_limit_mm: 2.0,
        }
    }
}

/// Where the camera is on the body `M`, and the board on the body `C` that carries it.
#[derive(Clone, Debug, PartialEq)]
pub struct HandEye<M: Frame, C: Frame> {
    /// The hand-eye transform.
    pub mount_from_camera: Rigid<M, Camera>,
    /// Its covariance, axes of `M`.
    pub mount_from_camera_covariance: PoseCovariance,
    /// Where the board is mounted: the robot-world transform.
    pub carrier_from_board: Rigid<C, Board>,
    /// Its covariance, axes of `C`.
    pub carrier_from_board_covariance: PoseCovariance,
    /// How far the poses turn, without the rejected ones.
    pub span: Span,
    /// One a pose.
    pub residuals: Vec<Residual>,
    /// Root mean square of the kept residuals.
    pub residual_rms: PoseNoise,
    /// The kept residuals over the stated noise; 1 when the noise was estimated. The covariances include it above 1.
    pub noise_ratio: f64,
    /// Expected error at the work point by the covariance, root mean square, mm.
    pub work_point_deviation_mm: f64,
    /// The same by leaving out one pose at a time (jackknife), mm: asks no model of the noise.
    pub work_point_jackknife_mm: f64,
    /// Each kept pose against the answer without it: root mean square displacement of the board's origin, mm. The
    /// noise of that one measurement is in it.
    pub held_out_rms_mm: f64,
    /// The hand-eye transform by the closed forms, from the poses kept.
    pub closed_forms: ClosedForms<M>,
}

/// The classical answers, for comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosedForms<M: Frame> {
    /// Park and Martin 1994.
    pub park: Option<Rigid<M, Camera>>,
    /// Daniilidis 1999.
    pub daniilidis: Option<Rigid<M, Camera>>,
    /// Shah 2013.
    pub shah: Option<Rigid<M, Camera>>,
}

/// How far one pose is from the answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residual {
    /// Turn between what arm and camera say of the board, rad.
    pub rotation_rad: f64,
    /// Displacement of the board's origin, mm.
    pub translation_mm: f64,
    /// Both in standard deviations of the noise.
    pub deviations: f64,
    /// Whether the pose was rejected as contradicting the rest.
    pub is_rejected: bool,
}

/// The camera stands beside the arm, the board is on the flange.
///
/// # Errors
/// Names every violation of the input, or every gate that was not passed.
pub fn eye_on_base(
    stations: &[Station],
    options: &Options,
) -> Result<HandEye<Base, Flange>, Error> {
    let equation = |station: &Station, noise| Equation {
        a: *station.base_from_flange.isometry(),
        b: *station.camera_from_board.isometry(),
        noise,
    };
    solve(stations, options, equation, Wanted::Z)
}

/// The camera is on the flange, the board stands still.
///
/// # Errors
/// As [`eye_on_base`].
pub fn eye_in_hand(
    stations: &[Station],
    options: &Options,
) -> Result<HandEye<Flange, Base>, Error> {
    let equation = |station: &Station, noise: Option<(PoseCovariance, PoseCovariance)>| {
        let seen = station.camera_from_board.isometry();
        Equation {
            a: *station.base_from_flange.isometry(),
            b: seen.inverse(),
            noise: noise.map(|(arm, camera)| (arm, noise::inverted(seen, &camera))),
        }
    };
    solve(stations, options, equation, Wanted::X)
}

type Noise = Option<(PoseCovariance, PoseCovariance)>;

fn solve<M: Frame, C: Frame>(
    stations: &[Station],
    options: &Options,
    equation: impl Fn(&Station, Noise) -> Equation,
    wanted: Wanted,
) -> Result<HandEye<M, C>, Error> {
    check(stations, options)?;
    let turns: Vec<Rotation> = stations
        .iter()
        .map(|station| station.base_from_flange.rotation())
        .collect();
    let mut gates = Gates::default();
    gates.poses(stations.len(), "are given");
    gates.span(&Span::of(&turns), "given");
    gates.axes(&Span::of(&turns), "given");
    gates.passed()?;

    let equations = stations
        .iter()
        .map(|station| equation(station, stated_noise(station, options)));
    let problem = RobotWorld::new(equations.collect());
    let fit = fit(&problem).ok_or_else(|| gate::undetermined(stations.len()))?;
    let found = answer::of_fit(&problem, &fit, &turns, options.work_point, wanted);

    let mut gates = Gates::default();
    gates.outliers(&fit.rejected(), stations.len());
    gates.poses(fit.kept_count(), "are left");
    gates.span(&found.span, "left");
    gates.axes(&found.span, "left");
    gates.at_most(
        Reason::ResidualTooLarge,
        found.residual_rms.translation_mm,
        options.residual_limit_mm,
        format!(
            "arm and camera differ by {:.2} mm root mean square",
            found.residual_rms.translation_mm
        ),
    );
    gates.at_most(
        Reason::UncertaintyTooLarge,
        found.work_point_deviation_mm,
        options.uncertainty_limit_mm,
        format!(
            "the expected error at the work point is {:.2} mm",
            found.work_point_deviation_mm
        ),
    );
    gates.passed()?;
    Ok(found)
}

fn check(stations: &[Station], options: &Options) -> Result<(), Error> {
    let mut checked = Checked::default();
    checked.count("poses", stations.len());
    for (index, station) in stations.iter().enumerate() {
        checked.pose(
            || format!("poses[{index}].base_from_flange"),
            station.base_from_flange.isometry(),
        );
        checked.pose(
            || format!("poses[{index}].camera_from_board"),
            station.camera_from_board.isometry(),
        );
        checked.covariance(
            || format!("poses[{index}].camera_covariance"),
            station.camera_covariance.as_ref(),
        );
    }
    checked.point("work_point", &options.work_point);
    checked.noise("arm_noise", options.arm_noise);
    checked.noise("camera_noise", options.camera_noise);
    checked.limit("residual_limit_mm", options.residual_limit_mm);
    checked.limit("uncertainty_limit_mm", options.uncertainty_limit_mm);
    let camera_is_stated =
        |station: &Station| station.camera_covariance.is_some() || options.camera_noise.is_some();
    let stated = stations
        .iter()
        .filter(|station| camera_is_stated(station))
        .count();
    if options.arm_noise.is_some() && stated < stations.len() {
        checked.wrong(
            "camera_noise",
            format!(
                "is stated for {stated} of {} poses beside arm_noise; state it for all, or neither",
                stations.len()
            ),
        );
    }
    if options.arm_noise.is_none() && stated > 0 {
        checked.wrong(
            "arm_noise",
            "is not stated beside the camera's; state both, or neither".to_owned(),
        );
    }
    checked.passed()
}

fn stated_noise(station: &Station, options: &Options) -> Noise {
    let arm = options.arm_noise?.covariance();
    let camera = station
        .camera_covariance
        .or_else(|| options.camera_noise.map(|noise| noise.covariance()))?;
    Some((arm, camera))
}
