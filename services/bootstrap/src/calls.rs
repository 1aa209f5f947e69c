//! The layer around every call: its deadline, the limit of calls at the same time, and a log line.
//!
//! A deadline that passes is answered DEADLINE_EXCEEDED, before the answer and in the middle of a
//! stream, and drops the handler, so that its work stops. Over the limit a call is refused at once
//! with RESOURCE_EXHAUSTED instead of waiting. Stopping is never refused: calls named `Stop…` pass.

use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use http::{HeaderMap, Request, Response};
use http_body::Frame;
use tokio::sync::Semaphore;
use tokio::time::{Instant, Sleep};
use tonic::body::Body;
use tonic::transport::server::TcpConnectInfo;
use tonic::{Code, Extensions, Status};
use tower::{Layer, Service};

use crate::host::{RefusedCall, Reports};
use crate::identity::Caller;
use crate::status;

const TOO_MANY_CALLS: &str = "TOO_MANY_CALLS";

/// When the caller stops waiting; found in the request's extensions.
#[derive(Clone, Copy, Debug)]
pub struct Deadline(pub Instant);

/// Limits of the calls to one server.
#[derive(Clone, Debug)]
pub struct CallLayer {
    permits: Arc<Semaphore>,
    max_calls: usize,
    default_deadline: Duration,
    reports: Reports,
}

impl CallLayer {
    /// At most `max_calls` at the same time, `default_deadline` for calls that bring none.
    pub(crate) fn new(max_calls: usize, default_deadline: Duration, reports: Reports) -> Self {
        Self {
            permits: Arc::new(Semaphore::new(max_calls)),
            max_calls,
            default_deadline,
            reports,
        }
    }
}

impl<S> Layer<S> for CallLayer {
    type Service = Calls<S>;
    fn layer(&self, inner: S) -> Calls<S> {
        Calls {
            inner,
            limits: self.clone(),
        }
    }
}

/// A service behind the [`CallLayer`].
#[derive(Clone, Debug)]
pub struct Calls<S> {
    inner: S,
    limits: CallLayer,
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
        let permit = if is_stop(&path) {
            None
        } else {
            match self.limits.permits.clone().try_acquire_owned() {
                Ok(permit) => Some(permit),
                Err(_) => {
                    let refusal = overloaded(self.limits.max_calls);
                    self.limits.reports.refused(RefusedCall {
                        caller: Some(Caller::of(request.extensions())),
                        peer: peer_of(request.extensions()),
                        method: path,
                        reason: TOO_MANY_CALLS.to_owned(),
                        message: refusal.message().to_owned(),
                    });
                    return Box::pin(async move { Ok(refusal.into_http()) });
                }
            }
        };
        let asked = grpc_timeout(request.headers());
        let deadline = began + asked.unwrap_or(self.limits.default_deadline);
        request.extensions_mut().insert(Deadline(deadline));
        let answer = self.inner.call(request);
        Box::pin(async move {
            let outcome = tokio::time::timeout_at(deadline, answer).await;
            drop(permit);
            let elapsed_ms = began.elapsed().as_secs_f64() * 1e3;
            match outcome {
                Ok(response) => {
                    tracing::debug!(path, elapsed_ms, "call answered");
                    // Only a deadline that the caller set bounds a stream: watching may go on for ever.
                    response.map(|response| match asked {
                        Some(_) => {
                            response.map(|body| Body::new(DeadlineBody::new(body, deadline)))
                        }
                        None => response,
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

/// Where a call comes from.
fn peer_of(extensions: &Extensions) -> Option<SocketAddr> {
    extensions.get::<TcpConnectInfo>()?.remote_addr()
}

/// Stopping must get through when everything else is refused.
fn is_stop(path: &str) -> bool {
    path.rsplit('/')
        .next()
        .is_some_and(|method| method.starts_with("Stop"))
}

fn overloaded(max_calls: usize) -> Status {
    status::exhausted(
        TOO_MANY_CALLS,
        format!("{max_calls} calls are being worked on, which is the limit; try again"),
        &[("max_calls", max_calls.to_string())],
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

/// A response body that ends with DEADLINE_EXCEEDED when the deadline passes.
struct DeadlineBody {
    inner: Option<Body>,
    sleep: Pin<Box<Sleep>>,
}

impl DeadlineBody {
    fn new(inner: Body, deadline: Instant) -> Self {
        Self {
            inner: Some(inner),
            sleep: Box::pin(tokio::time::sleep_until(deadline)),
        }
    }
}

impl http_body::Body for DeadlineBody {
    type Data = <Body as http_body::Body>::Data;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Self::Data>, Status>>> {
        let Some(inner) = self.inner.as_mut() else {
            return Poll::Ready(None);
        };
        if let Poll::Ready(frame) = Pin::new(inner).poll_frame(context) {
            return Poll::Ready(frame);
        }
        ready!(self.sleep.as_mut().poll(context));
        // Dropping the handler's stream is what stops its work.
        self.inner = None;
        let mut trailers = HeaderMap::new();
        match deadline_exceeded().add_header(&mut trailers) {
            Ok(()) => Poll::Ready(Some(Ok(Frame::trailers(trailers)))),
            Err(status) => Poll::Ready(Some(Err(status))),
        }
    }

    fn is_end_stream(&self) -> bool {
        self.inner
            .as_ref()
            .is_none_or(http_body::Body::is_end_stream)
    }
}

#[cfg(test)]
mod tests;
