//! Calibrations as messages.

use arthro_geometry::frame::Frame;
use arthro_geometry::nalgebra::SMatrix;
use arthro_geometry::{Point3, Rigid};
use arthro_proto::common::v1 as common;
use arthro_proto::registration::v1 as api;

use crate::calibration::hand_eye::HandEye;
use crate::calibration::noise::PoseNoise;
use crate::calibration::span::Span;
use crate::calibration::tool::{Calibrated, Shaft};

/// A hand-eye calibration.
pub fn hand_eye<M: Frame, C: Frame>(found: &HandEye<M, C>) -> api::SolveHandEyeResponse {
    let residuals = found
        .residuals
        .iter()
        .map(|residual| api::CalibrationResidual {
            rotation_rad: residual.rotation_rad,
            translation_mm: residual.translation_mm,
            deviations: residual.deviations,
            rejected: residual.is_rejected,
        });
    let closed = &found.closed_forms;
    api::SolveHandEyeResponse {
        mount_from_camera: Some(pose(&found.mount_from_camera)),
        mount_from_camera_covariance: rows(&found.mount_from_camera_covariance),
        carrier_from_board: Some(pose(&found.carrier_from_board)),
        carrier_from_board_covariance: rows(&found.carrier_from_board_covariance),
        residuals: residuals.collect(),
        residual_rms: Some(noise(&found.residual_rms)),
        noise_ratio: found.noise_ratio,
        span: Some(span(&found.span)),
        work_point_deviation_mm: found.work_point_deviation_mm,
        work_point_jackknife_mm: found.work_point_jackknife_mm,
        held_out_rms_mm: found.held_out_rms_mm,
        park: closed.park.as_ref().map(pose),
        daniilidis: closed.daniilidis.as_ref().map(pose),
        shah: closed.shah.as_ref().map(pose),
    }
}

/// The calibration of a tool.
pub fn tool(found: &Calibrated) -> api::SolveToolTipResponse {
    let tip = &found.tip;
    let residuals = tip
        .residuals
        .iter()
        .map(|residual| api::CalibrationResidual {
            rotation_rad: 0.0,
            translation_mm: residual.distance_mm,
            deviations: residual.deviations,
            rejected: residual.is_rejected,
        });
    api::SolveToolTipResponse {
        tip: Some(point(&tip.tip_in_flange)),
        tip_covariance_mm2: rows(&tip.tip_covariance_mm2),
        divot: Some(point(&tip.divot_in_base)),
        divot_covariance_mm2: rows(&tip.divot_covariance_mm2),
        residuals: residuals.collect(),
        residual_rms_mm: tip.residual_rms_mm,
        noise_ratio: tip.noise_ratio,
        span: Some(span(&tip.span)),
        tip_deviation_mm: tip.tip_deviation_mm,
        held_out_rms_mm: tip.held_out_rms_mm,
        shaft: found.shaft.as_ref().map(shaft),
    }
}

fn shaft(shaft: &Shaft) -> api::ShaftLine {
    let along = shaft.axis.direction_in_flange;
    let residuals = shaft
        .residuals
        .iter()
        .map(|residual| api::CalibrationResidual {
            rotation_rad: residual.rotation_rad,
            translation_mm: residual.distance_mm,
            deviations: residual.deviations,
            rejected: residual.is_rejected,
        });
    api::ShaftLine {
        direction: Some(common::Direction {
            x: along.x,
            y: along.y,
            z: along.z,
        }),
        direction_covariance_rad2: rows(&shaft.axis.direction_covariance_rad2),
        point: Some(point(&shaft.axis.point_in_flange)),
        point_covariance_mm2: rows(&shaft.axis.point_covariance_mm2),
        direction_deviation_rad: shaft.axis.direction_deviation_rad(),
        tip_off_line_mm: shaft.tip_off_line_mm,
        flange_from_tool: Some(pose(&shaft.flange_from_tool)),
        residuals: residuals.collect(),
    }
}

fn rows<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Vec<f64> {
    matrix.transpose().iter().copied().collect()
}

fn noise(noise: &PoseNoise) -> api::PoseNoise {
    api::PoseNoise {
        rotation_rad: noise.rotation_rad,
        translation_mm: noise.translation_mm,
    }
}

fn span(span: &Span) -> api::CalibrationSpan {
    api::CalibrationSpan {
        widest_rad: span.widest_rad,
        across_rad: span.across_rad,
    }
}

fn point(point: &Point3) -> common::Point {
    common::Point {
        x_mm: point.x,
        y_mm: point.y,
        z_mm: point.z,
    }
}

fn pose<A: Frame, B: Frame>(pose: &Rigid<A, B>) -> common::Pose {
    let rotation = pose.rotation().into_inner();
    common::Pose {
        rotation: Some(common::Quaternion {
            w: rotation.w,
            x: rotation.i,
            y: rotation.j,
            z: rotation.k,
        }),
        translation: Some(point(&pose.origin())),
    }
}
