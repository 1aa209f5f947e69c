//! The gRPC face: receives within limits, computes off the async runtime, streams events. Nothing clever.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Instant;

use arthro_bootstrap::status;
use arthro_proto::common::v1::{CloudHeader, Frame};
use arthro_proto::registration::v1 as api;
use arthro_proto::registration::v1::registration_service_server::{
    RegistrationService, RegistrationServiceServer,
};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};
use tokio_stream::Stream;
use tonic::service::Routes;
use tonic::{Request, Response, Status, Streaming};

use crate::cancel::Cancel;
use crate::config::Config;
use crate::depth;
use crate::pipeline::{Event, register};

mod answer;
mod calibration;
mod receive;

/// All that is served.
pub(crate) fn routes(config: &Config) -> Routes {
    Routes::new(RegistrationServiceServer::new(Registrar {
        permits: Arc::new(Semaphore::new(config.max_computations)),
        max_computations: config.max_computations,
    }))
}

#[derive(Debug)]
struct Registrar {
    permits: Arc<Semaphore>,
    max_computations: usize,
}

type Events<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

#[tonic::async_trait]
impl RegistrationService for Registrar {
    type RegisterStream = Events<api::RegisterResponse>;

    async fn register(
        &self,
        request: Request<Streaming<api::RegisterRequest>>,
    ) -> Result<Response<Self::RegisterStream>, Status> {
        let permit = self.permit()?;
        let upload = receive::registration(request.into_inner()).await?;
        let began = Instant::now();
        // Unbounded, so that a client that reads slowly holds no thread; a registration has about a thousand events.
        let (events, received) = mpsc::unbounded_channel();
        let cancel = Cancel::default();
        let stream = CancelOnDrop {
            received,
            cancel: cancel.clone(),
        };
        compute(permit, events.clone(), move || {
            let mut progress = |event: Event| {
                // The receiver is gone only when the client is, and then `cancel` is raised.
                let _ = events.send(Ok(answer::event(event, began.elapsed())));
            };
            let result = register(
                &upload.source,
                &upload.target,
                &upload.options,
                &mut progress,
                &cancel,
            )?;
            tracing::info!(
                source_points = upload.source.points.len(),
                target_points = upload.target.points.len(),
                verdict = ?result.verdict,
                mse_mm2 = result.mse_mm2,
                seconds = began.elapsed().as_secs_f64(),
                "registered"
            );
            let _ = events.send(Ok(answer::result(&result, began.elapsed())));
            Ok(())
        });
        Ok(Response::new(Box::pin(stream)))
    }

    type DeprojectDepthStream = Events<api::DeprojectDepthResponse>;

    async fn deproject_depth(
        &self,
        request: Request<Streaming<api::DeprojectDepthRequest>>,
    ) -> Result<Response<Self::DeprojectDepthStream>, Status> {
        let permit = self.permit()?;
        let image = receive::depth(request.into_inner()).await?;
        let cloud = tokio::task::spawn_blocking(move || {
            let _permit = permit;
            depth::deproject(
                &image.intrinsics,
                image.depth_unit_mm,
                &image.depth,
                image.mask.as_deref(),
            )
        })
        .await
        .map_err(|error| Status::internal(format!("the deprojection failed: {error}")))??;
        let header = CloudHeader {
            frame: Frame::Camera.into(),
            point_count: cloud.points.len() as u32,
            has_normals: true,
        };
        let messages = answer::deprojection(header, cloud);
        Ok(Response::new(Box::pin(tokio_stream::iter(
            messages.map(Ok),
        ))))
    }

    async fn solve_hand_eye(
        &self,
        request: Request<api::SolveHandEyeRequest>,
    ) -> Result<Response<api::SolveHandEyeResponse>, Status> {
        calibration::hand_eye(self.permit()?, request.into_inner()).await
    }

    async fn solve_tool_tip(
        &self,
        request: Request<api::SolveToolTipRequest>,
    ) -> Result<Response<api::SolveToolTipResponse>, Status> {
        calibration::tool_tip(self.permit()?, request.into_inner()).await
    }
}

impl Registrar {
    /// The right to buffer and compute.
    fn permit(&self) -> Result<OwnedSemaphorePermit, Status> {
        self.permits.clone().try_acquire_owned().map_err(|_| {
            status::exhausted(
                "TOO_MANY_COMPUTATIONS",
                format!(
                    "{} computations are under way, which is the limit; try again",
                    self.max_computations
                ),
                &[("max_computations", self.max_computations.to_string())],
            )
        })
    }
}

type Sender<T> = mpsc::UnboundedSender<Result<T, Status>>;

/// Runs `work` on a blocking thread, its parallel parts on rayon; its failure, a panic too, ends the stream.
fn compute<T: Send + 'static>(
    permit: OwnedSemaphorePermit,
    events: Sender<T>,
    work: impl FnOnce() -> Result<(), crate::error::Error> + Send + 'static,
) {
    let computing = tokio::task::spawn_blocking(move || {
        let _permit = permit;
        work()
    });
    tokio::spawn(async move {
        let status = match computing.await {
            Ok(Ok(())) => return,
            Ok(Err(error)) => Status::from(error),
            Err(error) => Status::internal(format!("the computation failed: {error}")),
        };
        let _ = events.send(Err(status));
    });
}

/// The events of a computation, which stops when they are dropped: the client went, or its deadline passed.
struct CancelOnDrop<T> {
    received: mpsc::UnboundedReceiver<T>,
    cancel: Cancel,
}

impl<T> Stream for CancelOnDrop<T> {
    type Item = T;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<T>> {
        self.received.poll_recv(context)
    }
}

impl<T> Drop for CancelOnDrop<T> {
    fn drop(&mut self) {
        self.cancel.cancel();
    }
}
