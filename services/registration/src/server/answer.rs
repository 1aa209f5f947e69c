//! Domain results as messages.

use std::time::Duration;

use arthro_geometry::Point3;
use arthro_geometry::frame::Frame;
use arthro_proto::common::v1::{Point, Quaternion, Similarity};
use arthro_proto::registration::v1 as api;

use crate::gate::Verdict;
use crate::pipeline::{Event, Registration};

pub(super) fn event(event: Event, elapsed: Duration) -> api::RegisterResponse {
    use api::register_response::Event as Message;
    let started = |stage: api::Stage| {
        Message::Stage(api::StageStarted {
            stage: stage.into(),
            seconds: elapsed.as_secs_f64(),
        })
    };
    let message = match event {
        Event::CoarseStarted => started(api::Stage::Coarse),
        Event::FineStarted => started(api::Stage::Fine),
        Event::Candidate {
            rank,
            inlier_share,
            mse_mm2,
            ..
        } => Message::Candidate(api::CoarseCandidate {
            rank,
            inlier_share,
            mse_mm2,
        }),
        Event::Searched {
            scales,
            scales_in_all,
            best,
            score_mm,
        } => Message::Progress(api::SearchProgress {
            scales,
            scales_in_all,
            camera_from_ct: Some(similarity(&best)),
            score_mm,
        }),
        Event::Iteration {
            candidate,
            iteration,
            state,
        } => Message::Iteration(api::FineIteration {
            candidate,
            iteration,
            mse_mm2: state.mse_mm2,
            scale: state.scale,
        }),
    };
    api::RegisterResponse {
        event: Some(message),
    }
}

pub(super) fn result(registration: &Registration, elapsed: Duration) -> api::RegisterResponse {
    let evidence = &registration.evidence;
    let result = api::RegistrationResult {
        camera_from_ct: Some(similarity(&registration.camera_from_ct)),
        coarse_mse_mm2: registration.coarse_mse_mm2,
        mse_mm2: registration.mse_mm2,
        inlier_share: evidence.inlier_share,
        overlap: evidence.overlap,
        verdict: match registration.verdict {
            Verdict::Accept => api::Verdict::Accept,
            Verdict::Review => api::Verdict::Review,
            Verdict::Reject => api::Verdict::Reject,
        }
        .into(),
        reasons: registration.reasons.clone(),
        seconds: elapsed.as_secs_f64(),
        rival_margin: 1.0 - evidence.ambiguity,
        residuals_mm: registration
            .residuals_mm
            .iter()
            .flat_map(|residual| residual.to_le_bytes())
            .collect::<Vec<u8>>()
            .into(),
        tre_predicted_mm: evidence.tre_predicted_mm,
        scale_deviation: evidence.scale_deviation,
        misfit: evidence.misfit,
        free_space_violation_share: evidence.violation_share,
        ambiguity: evidence.ambiguity,
        mirror: evidence.mirror,
        covariance: registration
            .covariance
            .transpose()
            .iter()
            .copied()
            .collect(),
        covariance_about: Some(point(&registration.covariance_about)),
        scale_about: Some(point(&registration.scale_about)),
    };
    api::RegisterResponse {
        event: Some(api::register_response::Event::Result(result)),
    }
}

fn similarity<A: Frame, B: Frame>(pose: &arthro_geometry::Similarity<A, B>) -> Similarity {
    let rotation = pose.rotation.quaternion();
    Similarity {
        scale: pose.scale,
        rotation: Some(Quaternion {
            w: rotation.w,
            x: rotation.i,
            y: rotation.j,
            z: rotation.k,
        }),
        translation: Some(point(&Point3::from(pose.translation_mm))),
    }
}

fn point(point: &Point3) -> Point {
    Point {
        x_mm: point.x,
        y_mm: point.y,
        z_mm: point.z,
    }
}
