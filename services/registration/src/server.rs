//! The gRPC face: receives within limits, computes off the async runtime, streams events. Nothing clever.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Instant;

use arthro_bootstrap::calls::Deadline;
use arthro_bootstrap::status;
use arthro_proto::registration::v1 as api;
use arthro_proto::registration::v1::registration_service_server::{
    RegistrationService, RegistrationServiceServer,
};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};
use tokio_stream::Stream;
use tonic::service::Routes;
use tonic::{Request, Response, Status, Streaming};

use crate::budget::Budget;
use crate::config::Config;
use crate::input::MIN_DEADLINE_S;
use crate::pipeline::{Event, register};

mod answer;
pub mod calibration;
mod depth;
mod receive;
mod surface;

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
        let deadline = request.extensions().get::<Deadline>().copied();
        let upload = receive::registration(request.into_inner()).await?;
        let began = Instant::now();
        // Unbounded, so that a client that reads slowly holds no thread; a registration has about a thousand events.
        let (events, received) = mpsc::unbounded_channel();
        let budget = Budget::default();
        let timer = match deadline {
            Some(Deadline(until)) => Some(hurry_before(until, &budget)?),
            None => None,
        };
        let stream = CancelOnDrop {
            _timer: timer,
            received,
            budget: budget.clone(),
        };
        compute(permit, events.clone(), move || {
            let mut progress = |event: Event| {
                // The receiver is gone only when the client is, and then the budget is cancelled.
                let _ = events.send(Ok(answer::event(event, began.elapsed())));
            };
            let result = register(
                &upload.source,
                &upload.target,
                &upload.options,
                &mut progress,
                &budget,
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
        let messages = depth::deproject(self.permit()?, request.into_inner()).await?;
        Ok(Response::new(Box::pin(tokio_stream::iter(
            messages.map(Ok),
        ))))
    }

    type ReconstructSurfaceStream = Events<api::ReconstructSurfaceResponse>;

    async fn reconstruct_surface(
        &self,
        request: Request<Streaming<api::ReconstructSurfaceRequest>>,
    ) -> Result<Response<Self::ReconstructSurfaceStream>, Status> {
        surface::reconstruct(self.permit()?, request.into_inner()).await
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

/// Share of the time left that the search may use; the rest finishes and judges what it found.
const SEARCH_SHARE: f64 = 0.6;

/// Ends the search in time for an answer before the caller's deadline.
fn hurry_before(until: tokio::time::Instant, budget: &Budget) -> Result<Timer, Status> {
    let left = until.saturating_duration_since(tokio::time::Instant::now());
    if left.as_secs_f64() < MIN_DEADLINE_S {
        return Err(status::invalid(
            "deadline",
            format!(
                "leaves {:.4} s after the upload, must leave at least {MIN_DEADLINE_S} s",
                left.as_secs_f64()
            ),
        ));
    }
    let budget = budget.clone();
    Ok(Timer(tokio::spawn(async move {
        tokio::time::sleep(left.mul_f64(SEARCH_SHARE)).await;
        budget.hurry();
    })))
}

/// A task that goes with its owner.
struct Timer(tokio::task::JoinHandle<()>);

impl Drop for Timer {
    fn drop(&mut self) {
        self.0.abort();
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
    budget: Budget,
    _timer: Option<Timer>,
}

impl<T> Stream for CancelOnDrop<T> {
    type Item = T;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<T>> {
        self.received.poll_recv(context)
    }
}

impl<T> Drop for CancelOnDrop<T> {
    fn drop(&mut self) {
        self.budget.cancel();
    }
}
