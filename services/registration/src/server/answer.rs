//! Domain results as messages.

use std::time::Duration;

use arthro_proto::common::v1::{Point, Quaternion, Similarity};
use arthro_proto::registration::v1 as api;

use crate::pipeline::{Event, Registration};
use crate::verdict::Verdict;

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
        } => Message::Candidate(api::CoarseCandidate {
            rank,
            inlier_share,
            mse_mm2,
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
    let pose = &registration.camera_from_ct;
    let rotation = pose.rotation.quaternion();
    let result = api::RegistrationResult {
        camera_from_ct: Some(Similarity {
            scale: pose.scale,
            rotation: Some(Quaternion {
                w: rotation.w,
                x: rotation.i,
                y: rotation.j,
                z: rotation.k,
            }),
            translation: Some(Point {
                x_mm: pose.translation_mm.x,
                y_mm: pose.translation_mm.y,
                z_mm: pose.translation_mm.z,
            }),
        }),
        coarse_mse_mm2: registration.coarse_mse_mm2,
        mse_mm2: registration.mse_mm2,
        inlier_share: registration.evidence.inlier_share,
        overlap: registration.evidence.overlap,
        verdict: match registration.verdict {
            Verdict::Accept => api::Verdict::Accept,
            Verdict::Review => api::Verdict::Review,
            Verdict::Reject => api::Verdict::Reject,
        }
        .into(),
        reasons: registration.reasons.clone(),
        seconds: elapsed.as_secs_f64(),
        rival_margin: registration.evidence.rival_margin,
        residuals_mm: registration
            .residuals_mm
            .iter()
            .flat_map(|residual| residual.to_le_bytes())
            .collect::<Vec<u8>>()
            .into(),
    };
    api::RegisterResponse {
        event: Some(api::register_response::Event::Result(result)),
    }
}
