//! Somebody who stops and aborts while a crowd is there, on connections and a thread of their own: as an operator at another
//! machine, whom the crowd's own load does not slow down.

use std::time::{Duration, Instant};

use arthro_proto::gateway::v1::procedure_service_client::ProcedureServiceClient;
use arthro_proto::gateway::v1::{AbortProcedureRequest, StopProcedureRequest};
use arthro_proto::instrument::v1 as instrument;
use arthro_proto::instrument::v1::instrument_service_client::InstrumentServiceClient;
use arthro_proto::motion::v1 as motion;
use arthro_proto::motion::v1::motion_service_client::MotionServiceClient;
use tonic::{Code, Status};

use super::Latencies;
use crate::Cell;

/// Between two stops: never the same, or all would fall into the same phase of a device's cycle.
const PAUSE_MIN_S: f64 = 0.015;
const PAUSE_SPREAD_S: f64 = 0.016;
/// The golden ratio's share spreads a sequence most evenly.
const GOLDEN_SHARE: f64 = 0.618_034;

/// Where to stop.
#[derive(Clone, Debug)]
pub struct Stopper {
    gateway: String,
    motion: String,
    instrument: String,
}

/// How long acknowledgements took.
#[derive(Debug)]
pub struct Stops {
    /// Of `StopProcedure`, which waits for both device services.
    pub gateway: Latencies,
    /// Of the motion service's `Stop` alone, called at the same time of the same load.
    pub motion: Latencies,
    /// Of the instrument service's.
    pub instrument: Latencies,
}

impl Stopper {
    /// At this cell.
    pub fn at(cell: &Cell) -> Self {
        Self {
            gateway: cell.url("gateway").to_owned(),
            motion: cell.url("motion").to_owned(),
            instrument: cell.url("instrument").to_owned(),
        }
    }

    /// Stops again and again for so long.
    pub async fn stop_for(&self, lasting: Duration) -> Result<Stops, Status> {
        let this = self.clone();
        apart(move || async move { this.stop(lasting).await }).await
    }

    /// Aborts one procedure again and again for so long, at most until it has ended or was interrupted.
    pub async fn abort_for(
        &self,
        procedure_id: &str,
        lasting: Duration,
    ) -> Result<Latencies, Status> {
        let this = self.clone();
        let procedure_id = procedure_id.to_owned();
        apart(move || async move { this.abort(procedure_id, lasting).await }).await
    }

    async fn stop(self, lasting: Duration) -> Result<Stops, Status> {
        let unreachable = |error: tonic::transport::Error| Status::unavailable(error.to_string());
        let mut gateway = ProcedureServiceClient::connect(self.gateway)
            .await
            .map_err(unreachable)?;
        let mut motion = MotionServiceClient::connect(self.motion)
            .await
            .map_err(unreachable)?;
        let mut instrument = InstrumentServiceClient::connect(self.instrument)
            .await
            .map_err(unreachable)?;
        let mut all = [Vec::new(), Vec::new(), Vec::new()];
        let began = Instant::now();
        while began.elapsed() < lasting {
            let reason = "load".to_owned();
            let asked = Instant::now();
            gateway
                .stop_procedure(StopProcedureRequest {
                    reason,
                    ..Default::default()
                })
                .await?;
            all[0].push(ms(asked));
            pause(all[0].len()).await;

            let asked = Instant::now();
            motion.stop(motion::StopRequest::default()).await?;
            all[1].push(ms(asked));
            let asked = Instant::now();
            instrument.stop(instrument::StopRequest::default()).await?;
            all[2].push(ms(asked));
            pause(2 * all[2].len()).await;
        }
        let [gateway, motion, instrument] = all.map(Latencies::of);
        Ok(Stops {
            gateway,
            motion,
            instrument,
        })
    }

    async fn abort(self, procedure_id: String, lasting: Duration) -> Result<Latencies, Status> {
        let mut gateway = ProcedureServiceClient::connect(self.gateway)
            .await
            .map_err(|error| Status::unavailable(error.to_string()))?;
        let mut all_ms = Vec::new();
        let began = Instant::now();
        while began.elapsed() < lasting {
            let request = AbortProcedureRequest {
                procedure_id: procedure_id.clone(),
            };
            let asked = Instant::now();
            match gateway.abort_procedure(request).await {
                Ok(_) => all_ms.push(ms(asked)),
                Err(refusal) if refusal.code() == Code::FailedPrecondition => break,
                Err(refusal) => return Err(refusal),
            }
            pause(all_ms.len()).await;
        }
        Ok(Latencies::of(all_ms))
    }
}

async fn pause(number: usize) {
    let share = (number as f64 * GOLDEN_SHARE).fract();
    tokio::time::sleep(Duration::from_secs_f64(
        PAUSE_MIN_S + PAUSE_SPREAD_S * share,
    ))
    .await;
}

fn ms(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

/// Runs `work` on a thread and a runtime of its own.
async fn apart<T, F>(work: impl FnOnce() -> F + Send + 'static) -> T
where
    T: Send + 'static,
    F: Future<Output = T>,
{
    let runs = tokio::task::spawn_blocking(move || {
        tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .expect("a runtime")
            .block_on(work())
    });
    runs.await.expect("who stops does not panic")
}
