//! The gRPC side: requests into the domain, results and refusals out. Nothing is decided here.
//!
//! A computation runs on a blocking thread. It hears that the client went when the answer's channel
//! closes, and ends with what it has when the deadline comes near.

mod answer;
mod intake;
pub(crate) mod joint;
mod options;
mod packed;
mod reach;
pub(crate) mod view;

use std::sync::Arc;
use std::time::Instant;

use arthro_bootstrap::calls::Deadline;
use arthro_bootstrap::status;
use arthro_proto::planning::v1::planning_service_server::PlanningService;
use arthro_proto::planning::v1::{
    CheckReachabilityRequest, CheckReachabilityResponse, EvaluateResectionRequest,
    EvaluateResectionResponse, FitContourRequest, FitContourResponse, PlanResectionRequest,
    PlanResectionResponse, plan_resection_response,
};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status, Streaming};

use crate::bites::Patience;
use crate::config::Config;
use crate::contour::Spline;
use crate::plan::{self, Progress};

/// Events that may wait for a slow client.
const EVENTS: usize = 16;
/// Most samples that `FitContour` answers.
const MAX_SAMPLES: f64 = 50_000.0;

/// Share of a call's time that is kept for the answer: the search ends with what it has.
const ANSWERING_SHARE: f64 = 0.1;

type Event = Result<PlanResectionResponse, Status>;

/// Serves `arthro.planning.v1.PlanningService`.
#[derive(Clone, Debug)]
pub struct Planning {
    computations: Arc<Semaphore>,
}

impl Planning {
    /// A service with the limits of `config`.
    pub fn new(config: &Config) -> Self {
        Self {
            computations: Arc::new(Semaphore::new(config.max_computations)),
        }
    }

    /// Waits for a computation's turn, before the input is read: what waits holds no memory.
    async fn turn(&self) -> Result<OwnedSemaphorePermit, Status> {
        let turn = self.computations.clone().acquire_owned().await;
        turn.map_err(|_| Status::unavailable("the server is shutting down"))
    }
}

#[tonic::async_trait]
impl PlanningService for Planning {
    type PlanResectionStream = ReceiverStream<Event>;

    async fn fit_contour(
        &self,
        request: Request<FitContourRequest>,
    ) -> Result<Response<FitContourResponse>, Status> {
        let wanted = options::Contour::read(request.into_inner())?;
        let turn = self.turn().await?;
        let answer = tokio::task::spawn_blocking(move || {
            let _turn = turn;
            fit_contour(&wanted)
        });
        answer.await.map_err(crashed)?.map(Response::new)
    }

    async fn plan_resection(
        &self,
        request: Request<Streaming<PlanResectionRequest>>,
    ) -> Result<Response<Self::PlanResectionStream>, Status> {
        let deadline = request.extensions().get::<Deadline>().copied();
        let turn = self.turn().await?;
        let request = intake::plan(request.into_inner()).await?;
        let (events, answer) = mpsc::channel(EVENTS);
        let last = events.clone();
        tokio::spawn(async move {
            let work = tokio::task::spawn_blocking(move || {
                let _turn = turn;
                plan_resection(&request, deadline, &events)
            });
            let result = work.await.map_err(crashed).and_then(|result| result);
            if let Err(status) = &result {
                tracing::info!(code = ?status.code(), message = status.message(), "no plan");
            }
            // A client that went away needs no answer.
            let _ = last.send(result).await;
        });
        Ok(Response::new(ReceiverStream::new(answer)))
    }

    async fn evaluate_resection(
        &self,
        request: Request<Streaming<EvaluateResectionRequest>>,
    ) -> Result<Response<EvaluateResectionResponse>, Status> {
        let turn = self.turn().await?;
        let wanted = intake::evaluation(request.into_inner()).await?;
        let answer = tokio::task::spawn_blocking(move || {
            let _turn = turn;
            plan::evaluate(&wanted)
        });
        let evaluation = answer.await.map_err(crashed)??;
        Ok(Response::new(EvaluateResectionResponse {
            evaluation: Some(answer::evaluation(&evaluation)),
        }))
    }

    async fn check_reachability(
        &self,
        request: Request<Streaming<CheckReachabilityRequest>>,
    ) -> Result<Response<CheckReachabilityResponse>, Status> {
        let turn = self.turn().await?;
        let wanted = reach::intake(request.into_inner()).await?;
        // This future, and with it `waiting`, is dropped when the client goes.
        let waiting = Arc::new(());
        let heard = Arc::downgrade(&waiting);
        let answer = tokio::task::spawn_blocking(move || {
            let _turn = turn;
            reach::check(&wanted, &|| heard.strong_count() > 0)
        });
        let answer = answer.await;
        drop(waiting);
        answer.map_err(crashed)?.map(Response::new)
    }
}

fn fit_contour(wanted: &options::Contour) -> Result<FitContourResponse, Status> {
    let spline = Spline::fit(&wanted.points, wanted.control_points).map_err(crate::Error::from)?;
    let samples = spline.length_mm() / wanted.spacing_mm;
    if !samples.is_finite() || samples > MAX_SAMPLES {
        return Err(status::invalid(
            "spacing_mm",
            format!(
                "is {} mm on a contour of {:.1} mm; at most {MAX_SAMPLES} samples are answered",
                wanted.spacing_mm,
                spline.length_mm()
            ),
        ));
    }
    Ok(answer::contour(&spline, wanted))
}

fn plan_resection(
    request: &plan::Request,
    deadline: Option<Deadline>,
    events: &mpsc::Sender<Event>,
) -> Result<PlanResectionResponse, Status> {
    let began = Instant::now();
    let hurry_at = deadline.map(|deadline| {
        let deadline = deadline.0.into_std();
        let left = deadline.saturating_duration_since(began);
        deadline - left.mul_f64(ANSWERING_SHARE)
    });
    let patience = || {
        if events.is_closed() {
            return Patience::Stop;
        }
        match hurry_at {
            Some(hurry_at) if Instant::now() >= hurry_at => Patience::Hurry,
            _ => Patience::GoOn,
        }
    };
    let mut stage = "";
    let mut watch = |progress: Progress| {
        let event = Ok(answer::progress(&progress));
        if progress.stage == stage {
            // Within a stage a slow client misses some reports rather than slowing the work.
            let _ = events.try_send(event);
        } else {
            stage = progress.stage;
            let _ = events.blocking_send(event);
        }
    };
    let plan = plan::plan(request, &patience, &mut watch)?;
    let seconds = began.elapsed().as_secs_f64();
    tracing::info!(
        bites = plan.bites.len(),
        lesion_covered_percent = plan.evaluation.lesion_covered_percent,
        rim_min_mm = plan.evaluation.rim_min_mm,
        seconds,
        "resection planned"
    );
    Ok(PlanResectionResponse {
        event: Some(plan_resection_response::Event::Plan(answer::plan(
            &plan, seconds,
        ))),
    })
}

fn crashed(error: tokio::task::JoinError) -> Status {
    tracing::error!(%error, "a computation crashed");
    Status::internal("the computation crashed")
}
