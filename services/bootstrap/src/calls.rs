//! The layer around every call: its deadline, the limits of calls and open streams at the same time, and a log line.
//!
//! A deadline that passes is answered DEADLINE_EXCEEDED, before the answer and in the middle of a
//! stream, and drops the handler, so that its work stops. Over a limit a call is refused at once
//! with RESOURCE_EXHAUSTED instead of waiting. Stopping is never refused: the stops of the table of roles pass.

use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use http::{HeaderMap, Request, Response};
use http_body::Frame;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::Instant;
use tonic::body::Body;
use tonic::transport::server::TcpConnectInfo;
use tonic::{Code, Extensions, Status};
use tower::{Layer, Service};

use crate::host::{RefusedCall, Reports};
use crate::identity::Caller;
use crate::roles::{Effect, Rule};
use crate::status;

mod ending;

pub(crate) use ending::EndingBody;

/// When the caller stops waiting; found in the request's extensions.
#[derive(Clone, Copy, Debug)]
pub struct Deadline(pub Instant);

/// Limits of the calls to one server.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Calls that wait for their answer, or for the head of it.
    pub max_calls: usize,
    /// Calls whose answer has not ended, however idle it is.
    pub max_streams: usize,
    /// For calls that bring none.
    pub default_deadline: Duration,
}

/// Keeps the [`Limits`].
#[derive(Clone, Debug)]
pub struct CallLayer {
    limits: Limits,
    calls: Arc<Semaphore>,
    streams: Arc<Semaphore>,
    reports: Reports,
}

/// The right to be worked on and to be answered.
struct Admitted {
    call: OwnedSemaphorePermit,
    stream: OwnedSemaphorePermit,
}

/// A service behind the [`CallLayer`].
#[derive(Clone, Debug)]
pub struct Calls<S> {
    inner: S,
    layer: CallLayer,
}

// === impl CallLayer ===

impl CallLayer {
    /// For one server.
    pub(crate) fn new(limits: Limits, reports: Reports) -> Self {
        Self {
            limits,
            calls: Arc::new(Semaphore::new(limits.max_calls)),
            streams: Arc::new(Semaphore::new(limits.max_streams)),
            reports,
        }
    }

    fn admit(&self) -> Result<Admitted, Status> {
        let Limits {
            max_calls,
            max_streams,
            ..
        } = self.limits;
        let taken = |permits: &Arc<Semaphore>| permits.clone().try_acquire_owned();
        Ok(Admitted {
            call: taken(&self.calls).map_err(|_| too_many_calls(max_calls))?,
            stream: taken(&self.streams).map_err(|_| too_many_streams(max_streams))?,
        })
    }
}

impl<S> Layer<S> for CallLayer {
    type Service = Calls<S>;
    fn layer(&self, inner: S) -> Calls<S> {
        Calls {
            inner,
            layer: self.clone(),
        }
    }
}

// === impl Calls ===

type CallFuture<E> = Pin<Box<dyn Future<Output = Result<Response<Body>, E>> + Send>>;

impl<S> Service<Request<Body>> for Calls<S>
where
    S: Service<Request<Body>, Response = Response<Body>>,
    S::Future: Send + 'static,
    S::Error: Send + 'static,
{
    type Response = Response<Body>;
    type Error = S::Error;
    type Future = CallFuture<S::Error>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.inner.poll_ready(context)
    }

    fn call(&mut self, mut request: Request<Body>) -> Self::Future {
        let began = Instant::now();
        let path = request.uri().path().to_owned();
        let admitted = if is_stop(&path) {
            None
        } else {
            match self.layer.admit() {
                Ok(admitted) => Some(admitted),
                Err(refusal) => {
                    self.layer.reports.refused(RefusedCall {
                        caller: Some(Caller::of(request.extensions())),
                        peer: peer_of(request.extensions()),
                        method: path,
                        reason: status::reason(&refusal).unwrap_or_default(),
                        message: refusal.message().to_owned(),
                    });
                    return Box::pin(async move { Ok(refusal.into_http()) });
                }
            }
        };
        let asked = grpc_timeout(request.headers());
        let deadline = began + asked.unwrap_or(self.layer.limits.default_deadline);
        request.extensions_mut().insert(Deadline(deadline));
        let answer = self.inner.call(request);
        Box::pin(async move {
            let (call, stream) = match admitted {
                Some(Admitted { call, stream }) => (Some(call), Some(stream)),
                None => (None, None),
            };
            let outcome = tokio::time::timeout_at(deadline, answer).await;
            drop(call);
            let elapsed_ms = began.elapsed().as_secs_f64() * 1e3;
            match outcome {
                Ok(response) => {
                    tracing::debug!(path, elapsed_ms, "call answered");
                    // Only a deadline that the caller set bounds a stream: watching may go on for ever.
                    response.map(|response| {
                        response.map(|body| {
                            let body = match asked {
                                Some(_) => {
                                    let status = deadline_exceeded();
                                    Body::new(EndingBody::new(body, deadline, status))
                                }
                                None => body,
                            };
                            Body::new(AnswerBody::new(body, stream))
                        })
                    })
                }
                Err(_) => {
                    tracing::debug!(path, elapsed_ms, "call ended by its deadline");
                    Ok(deadline_exceeded().into_http())
                }
            }
        })
    }
}

/// Where a call comes from; the guard has put it there.
fn peer_of(extensions: &Extensions) -> Option<SocketAddr> {
    extensions.get::<TcpConnectInfo>()?.remote_addr()
}

/// Stopping must get through when everything else is refused.
fn is_stop(path: &str) -> bool {
    Rule::of(path).is_some_and(|rule| rule.effect == Effect::Stop)
}

fn too_many_calls(max_calls: usize) -> Status {
    status::exhausted(
        "TOO_MANY_CALLS",
        format!("{max_calls} calls are being worked on, which is the limit; try again"),
        &[("max_calls", max_calls.to_string())],
    )
}

fn too_many_streams(max_streams: usize) -> Status {
    status::exhausted(
        "TOO_MANY_STREAMS",
        format!("{max_streams} answers are still open, which is the limit; end some and try again"),
        &[("max_streams", max_streams.to_string())],
    )
}

fn deadline_exceeded() -> Status {
    Status::new(Code::DeadlineExceeded, "the call's deadline passed")
}

/// The `grpc-timeout` header: up to eight digits and a unit.
///
/// The transport answers an expired timeout with CANCELLED a moment later; ending a millisecond
/// early makes sure that the right code goes out.
fn grpc_timeout(headers: &HeaderMap) -> Option<Duration> {
    let value = headers.get("grpc-timeout")?.to_str().ok()?;
    let (digits, unit) = value.split_at_checked(value.len().checked_sub(1)?)?;
    if digits.is_empty() || digits.len() > 8 {
        return None;
    }
    let count: u64 = digits.parse().ok()?;
    let timeout = match unit {
        "H" => Duration::from_secs(count * 3600),
        "M" => Duration::from_secs(count * 60),
        "S" => Duration::from_secs(count),
        "m" => Duration::from_millis(count),
        "u" => Duration::from_micros(count),
        "n" => Duration::from_nanos(count),
        _ => return None,
    };
    Some(timeout.saturating_sub(Duration::from_millis(1)))
}

/// An answer on its way: counts as open until it has ended.
struct AnswerBody {
    inner: Option<Body>,
    stream: Option<OwnedSemaphorePermit>,
}

impl AnswerBody {
    fn new(inner: Body, stream: Option<OwnedSemaphorePermit>) -> Self {
        Self {
            inner: Some(inner),
            stream,
        }
    }
}

impl http_body::Body for AnswerBody {
    type Data = <Body as http_body::Body>::Data;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Self::Data>, Status>>> {
        let Some(inner) = self.inner.as_mut() else {
            return Poll::Ready(None);
        };
        let polled = Pin::new(inner).poll_frame(context);
        let more = matches!(&polled, Poll::Ready(Some(Ok(frame))) if frame.is_data());
        if !more && polled.is_ready() {
            self.inner = None;
            self.stream = None;
        }
        polled
    }

    fn is_end_stream(&self) -> bool {
        self.inner
            .as_ref()
            .is_none_or(http_body::Body::is_end_stream)
    }
}

#[cfg(test)]
mod tests;
