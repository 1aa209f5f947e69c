//! `WatchProcedure` for hundreds at once: a state is encoded once for all who watch it, and whoever reads slowly is given
//! the newest one, never a queue.
//!
//! The generated server encodes every message for every watcher. [`Watched`] stands before it, answers this one method
//! with bytes that all watchers share, and passes every other method on.

use std::convert::Infallible;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, ready};
use std::time::Duration;

use arthro_proto::gateway::v1::procedure_service_server::ProcedureServiceServer;
use arthro_proto::gateway::v1::{self as proto};
use bytes::{BufMut as _, Bytes};
use prost::Message as _;
use tokio::sync::watch;
use tokio::time::{Interval, MissedTickBehavior};
use tokio_stream::wrappers::WatchStream;
use tokio_stream::{Stream, StreamExt as _};
use tonic::body::Body;
use tonic::codec::{BufferSettings, Codec, EncodeBuf, Encoder};
use tonic::codegen::{BoxFuture, Service, http};
use tonic::server::{Grpc, NamedService, ServerStreamingService};
use tonic::{Request, Response, Status};
use tonic_prost::ProstDecoder;

use super::{Answers, ProcedureApi, procedure_message, refuse};
use crate::error::Violation;
use crate::procedure::Procedure;
use crate::procedure::control::Procedures;

/// The method that is answered here.
const WATCH_PROCEDURE: &str = "/arthro.gateway.v1.ProcedureService/WatchProcedure";
/// Seconds between two states.
const PERIOD_MIN_S: f64 = 0.001;
const PERIOD_MAX_S: f64 = 60.0;
/// A state is a few hundred bytes. The library's 8 KiB a stream would be 80 MB for ten thousand idle watchers.
const STREAM_BUFFER_BYTES: usize = 1024;

/// `ProcedureService` with shared watching.
#[derive(Clone)]
pub(in crate::server) struct Watched {
    others: ProcedureServiceServer<ProcedureApi>,
    watch: Watch,
}

/// Answers those who watch.
#[derive(Clone)]
pub(super) struct Watch {
    procedures: Procedures,
    newest: Newest,
}

/// The newest state as bytes, made by the first who needs it.
#[derive(Clone, Default)]
struct Newest(Arc<Mutex<Option<(Procedure, Bytes)>>>);

// === impl Watched ===

impl Watched {
    pub(in crate::server) fn new(procedures: Procedures) -> Self {
        let watch = Watch {
            procedures: procedures.clone(),
            newest: Newest::default(),
        };
        Self {
            others: ProcedureServiceServer::new(ProcedureApi::new(procedures, watch.clone())),
            watch,
        }
    }
}

impl NamedService for Watched {
    const NAME: &'static str = <ProcedureServiceServer<ProcedureApi> as NamedService>::NAME;
}

impl Service<http::Request<Body>> for Watched {
    type Response = http::Response<Body>;
    type Error = Infallible;
    type Future = BoxFuture<Self::Response, Infallible>;

    fn poll_ready(&mut self, _: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, request: http::Request<Body>) -> Self::Future {
        if request.uri().path() != WATCH_PROCEDURE {
            return self.others.call(request);
        }
        let watch = self.watch.clone();
        Box::pin(async move {
            Ok(Grpc::new(EncodedOnce)
                .server_streaming(watch, request)
                .await)
        })
    }
}

// === impl Watch ===

impl Watch {
    /// The states, encoded as [`proto::WatchProcedureResponse`].
    pub(super) async fn states(
        &self,
        request: proto::WatchProcedureRequest,
    ) -> Result<Answers<Bytes>, Status> {
        let period = period(request.period_s).map_err(refuse)?;
        let procedure_id = super::procedure_id(request.procedure_id)?;
        let procedures = self.procedures.watch(&procedure_id).await.map_err(refuse)?;
        let newest = self.newest.clone();
        Ok(match period {
            None => Box::pin(
                WatchStream::new(procedures).map(move |procedure| Ok(newest.encoded(&procedure))),
            ),
            Some(period) => Box::pin(Periodic::new(procedures, period, newest)),
        })
    }
}

impl ServerStreamingService<proto::WatchProcedureRequest> for Watch {
    type Response = Bytes;
    type ResponseStream = Answers<Bytes>;
    type Future = BoxFuture<Response<Self::ResponseStream>, Status>;

    fn call(&mut self, request: Request<proto::WatchProcedureRequest>) -> Self::Future {
        let watch = self.clone();
        Box::pin(async move { Ok(Response::new(watch.states(request.into_inner()).await?)) })
    }
}

fn period(period_s: f64) -> Result<Option<Duration>, Violation> {
    if period_s == 0.0 {
        return Ok(None);
    }
    if (PERIOD_MIN_S..=PERIOD_MAX_S).contains(&period_s) {
        return Ok(Some(Duration::from_secs_f64(period_s)));
    }
    Err(Violation::new(
        "period_s",
        format!("is {period_s} s; must be 0 or within {PERIOD_MIN_S} .. {PERIOD_MAX_S} s"),
    ))
}

// === impl Newest ===

impl Newest {
    fn encoded(&self, procedure: &Procedure) -> Bytes {
        // Nothing panics while it is held, and what it guards is whole at any time.
        let mut newest = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match &*newest {
            Some((encoded, bytes)) if encoded == procedure => bytes.clone(),
            _ => {
                let message = proto::WatchProcedureResponse {
                    procedure: Some(procedure_message(procedure)),
                };
                let bytes = Bytes::from(message.encode_to_vec());
                *newest = Some((procedure.clone(), bytes.clone()));
                bytes
            }
        }
    }
}

/// The state each period, changed or not, until the procedure is over. Nothing is kept for a reader who is not there.
struct Periodic {
    procedure: watch::Receiver<Procedure>,
    ticks: Interval,
    newest: Newest,
    over: bool,
}

// === impl Periodic ===

impl Periodic {
    fn new(procedure: watch::Receiver<Procedure>, period: Duration, newest: Newest) -> Self {
        let mut ticks = tokio::time::interval(period);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        Self {
            procedure,
            ticks,
            newest,
            over: false,
        }
    }
}

impl Stream for Periodic {
    type Item = Result<Bytes, Status>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        if self.over {
            return Poll::Ready(None);
        }
        ready!(self.ticks.poll_tick(context));
        // Asked before the state is read: what is read after the sender is gone is the last.
        self.over = self.procedure.has_changed().is_err();
        let state = self.newest.encoded(&self.procedure.borrow());
        Poll::Ready(Some(Ok(state)))
    }
}

/// Sends bytes that are a message already.
struct EncodedOnce;

/// The sending half of [`EncodedOnce`].
struct Copied;

impl Codec for EncodedOnce {
    type Encode = Bytes;
    type Decode = proto::WatchProcedureRequest;
    type Encoder = Copied;
    type Decoder = ProstDecoder<proto::WatchProcedureRequest>;

    fn encoder(&mut self) -> Copied {
        Copied
    }

    fn decoder(&mut self) -> Self::Decoder {
        ProstDecoder::default()
    }
}

impl Encoder for Copied {
    type Item = Bytes;
    type Error = Status;

    fn encode(&mut self, message: Bytes, buffer: &mut EncodeBuf<'_>) -> Result<(), Status> {
        buffer.put(message);
        Ok(())
    }

    fn buffer_settings(&self) -> BufferSettings {
        BufferSettings::new(STREAM_BUFFER_BYTES, STREAM_BUFFER_BYTES)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::approval::Digest;
    use crate::procedure::State;

    fn procedure(bites_done: u32) -> Procedure {
        Procedure {
            id: "procedure".to_owned(),
            case_id: "case".to_owned(),
            operator: "operator".to_owned(),
            state: State::Running,
            plan_digest: Digest::parse(&"ab".repeat(32)).unwrap(),
            bites_planned: 9,
            next_bite: bites_done,
            bites_done,
            step: None,
            reason: String::new(),
            detail: String::new(),
            started_at_ms: 0,
            ended_at_ms: None,
            robot_seconds: 0.0,
            rcm_deviation_max_mm: 0.0,
        }
    }

    async fn bites_done(states: &mut Periodic) -> Option<u32> {
        let bytes = states.next().await?.unwrap();
        let message = proto::WatchProcedureResponse::decode(bytes).unwrap();
        Some(message.procedure.unwrap().bites_done)
    }

    #[test]
    fn a_state_is_encoded_once_for_all_who_watch() {
        let newest = Newest::default();
        let first = newest.encoded(&procedure(1));
        assert_eq!(newest.encoded(&procedure(1)).as_ptr(), first.as_ptr());
        assert_ne!(newest.encoded(&procedure(2)), first);
    }

    #[tokio::test]
    async fn whoever_reads_slowly_is_given_the_newest_state_and_no_queue() {
        let sender = watch::Sender::new(procedure(0));
        let period = Duration::from_millis(1);
        let mut states = Periodic::new(sender.subscribe(), period, Newest::default());
        assert_eq!(bites_done(&mut states).await, Some(0));
        for done in 1..=5 {
            sender.send_replace(procedure(done));
        }
        assert_eq!(bites_done(&mut states).await, Some(5));
        sender.send_replace(procedure(6));
        drop(sender);
        assert_eq!(bites_done(&mut states).await, Some(6));
        assert_eq!(bites_done(&mut states).await, None);
    }
}
