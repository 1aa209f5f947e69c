//! Calibrations over gRPC: messages to poses, the work off the async runtime, answers to messages.

pub mod answer;
mod request;

use arthro_proto::registration::v1 as api;
use tokio::sync::OwnedSemaphorePermit;
use tonic::{Response, Status};

use crate::calibration::{hand_eye, tool};
use crate::error::Error;

pub(super) async fn hand_eye(
    permit: OwnedSemaphorePermit,
    message: api::SolveHandEyeRequest,
) -> Result<Response<api::SolveHandEyeResponse>, Status> {
    let asked = request::hand_eye(&message)?;
    compute(permit, move || match asked.mounting {
        request::Mounting::BesideArm => hand_eye::eye_on_base(&asked.stations, &asked.options)
            .map(|found| answer::hand_eye(&found)),
        request::Mounting::OnFlange => hand_eye::eye_in_hand(&asked.stations, &asked.options)
            .map(|found| answer::hand_eye(&found)),
    })
    .await
}

pub(super) async fn tool_tip(
    permit: OwnedSemaphorePermit,
    message: api::SolveToolTipRequest,
) -> Result<Response<api::SolveToolTipResponse>, Status> {
    let asked = request::tool(&message)?;
    compute(permit, move || {
        tool::solve(&asked.poses, &asked.shaft, &asked.options).map(|found| answer::tool(&found))
    })
    .await
}

async fn compute<T: Send + 'static>(
    permit: OwnedSemaphorePermit,
    work: impl FnOnce() -> Result<T, Error> + Send + 'static,
) -> Result<Response<T>, Status> {
    let computed = tokio::task::spawn_blocking(move || {
        let _permit = permit;
        work()
    });
    let answer = computed
        .await
        .map_err(|error| Status::internal(format!("the calibration failed: {error}")))??;
    Ok(Response::new(answer))
}
