//! The answer of a hand-eye fit, and what can be said of its accuracy.

use arthro_geometry::frame::Frame;
use arthro_geometry::nalgebra::{Isometry3, Matrix6};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};

use super::{ClosedForms, HandEye, Residual};
use crate::calibration::closed_form::park;
use crate::calibration::noise::{self, PoseNoise};
use crate::calibration::robot_world::{Mountings, RobotWorld, Wanted, daniilidis_of};
use crate::calibration::robust::{Fit, Problem as _};
use crate::calibration::span::Span;

type HandEyeFit = Fit<Mountings, 12, 6>;

/// The wanted mounting with its evidence. `turns` are the flange's rotations, pose by pose.
pub(super) fn of_fit<M: Frame, C: Frame>(
    problem: &RobotWorld,
    fit: &HandEyeFit,
    turns: &[Rotation],
    work_point: Point3,
    wanted: Wanted,
) -> HandEye<M, C> {
    let kept: Vec<usize> = fit.kept_indices().collect();
    let block = |first: usize| -> Matrix6<f64> {
        fit.covariance.fixed_view::<6, 6>(first, first).into_owned()
    };
    let (camera_block, board_block) = match wanted {
        Wanted::X => (block(0), block(6)),
        Wanted::Z => (block(6), block(0)),
    };
    let camera = wanted.camera(&fit.state);
    let residuals = residuals(problem, fit);
    let work_point_covariance = noise::point_covariance(&camera, &camera_block, &work_point);
    let held_out = HeldOut::of(problem, fit, &kept, &work_point, wanted);
    HandEye {
        mount_from_camera: Rigid::from_isometry(camera),
        mount_from_camera_covariance: camera_block,
        carrier_from_board: Rigid::from_isometry(wanted.board(&fit.state)),
        carrier_from_board_covariance: board_block,
        span: Span::of(&kept.iter().map(|index| turns[*index]).collect::<Vec<_>>()),
        residual_rms: PoseNoise {
            rotation_rad: noise::rms(kept.iter().map(|index| residuals[*index].rotation_rad)),
            translation_mm: noise::rms(kept.iter().map(|index| residuals[*index].translation_mm)),
        },
        residuals,
        noise_ratio: fit.noise_ratio,
        work_point_deviation_mm: noise::deviation(&work_point_covariance),
        work_point_jackknife_mm: held_out.jackknife_mm,
        held_out_rms_mm: held_out.rms_mm,
        closed_forms: closed_forms(problem, &kept, wanted),
    }
}

impl Wanted {
    fn camera(self, mountings: &Mountings) -> Isometry3<f64> {
        match self {
            Self::X => mountings.x,
            Self::Z => mountings.z,
        }
    }

    fn board(self, mountings: &Mountings) -> Isometry3<f64> {
        match self {
            Self::X => mountings.z,
            Self::Z => mountings.x,
        }
    }
}

fn residuals(problem: &RobotWorld, fit: &HandEyeFit) -> Vec<Residual> {
    (0..problem.len())
        .map(|index| {
            let residual = problem.residual(index, &fit.state);
            Residual {
                rotation_rad: residual.fixed_rows::<3>(0).norm(),
                translation_mm: residual.fixed_rows::<3>(3).norm(),
                deviations: fit.distances[index],
                is_rejected: !fit.kept[index],
            }
        })
        .collect()
}

fn closed_forms<M: Frame>(problem: &RobotWorld, kept: &[usize], wanted: Wanted) -> ClosedForms<M> {
    let pairs = problem.pairs(kept, wanted);
    ClosedForms {
        park: park::solve(&pairs).map(Rigid::from_isometry),
        daniilidis: daniilidis_of(&pairs).map(Rigid::from_isometry),
        shah: problem
            .shah(kept)
            .map(|mountings| Rigid::from_isometry(wanted.camera(&mountings))),
    }
}

/// What leaving out each pose once says.
struct HeldOut {
    rms_mm: f64,
    jackknife_mm: f64,
}

impl HeldOut {
    fn of(
        problem: &RobotWorld,
        fit: &HandEyeFit,
        kept: &[usize],
        work_point: &Point3,
        wanted: Wanted,
    ) -> Self {
        let mut displacements_mm = Vec::with_capacity(kept.len());
        let mut work_points = Vec::with_capacity(kept.len());
        for index in kept {
            let Some(state) = fit.without(problem, *index) else {
                // The other poses do not determine the answer: neither figure exists.
                return Self {
                    rms_mm: f64::INFINITY,
                    jackknife_mm: f64::INFINITY,
                };
            };
            let residual = problem.residual(*index, &state);
            displacements_mm.push(residual.fixed_rows::<3>(3).norm());
            work_points.push((wanted.camera(&state) * work_point).coords);
        }
        let count = work_points.len() as f64;
        let mean = work_points.iter().sum::<Vector3>() / count;
        let scatter: f64 = work_points
            .iter()
            .map(|point| (point - mean).norm_squared())
            .sum();
        Self {
            rms_mm: noise::rms(displacements_mm.into_iter()),
            jackknife_mm: (scatter * (count - 1.0) / count).sqrt(),
        }
    }
}
