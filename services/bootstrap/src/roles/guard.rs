//! The first layer around every call: who calls, and whether they may.
//!
//! With TLS the caller is whom the connection's certificate names, for as long as it is valid: a certificate that ends while
//! its connection is open ends the connection's calls and streams. Without TLS there is only loopback, and everybody there is
//! [`Caller::Local`].

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::{Duration, SystemTime};

use http::{Request, Response};
use http_body_util::{BodyExt as _, Full, Limited};
use tokio::time::Instant;
use tonic::body::Body;
use tonic::transport::server::TcpConnectInfo;
use tonic::{Code, Status};
use tower::{Layer, Service};

use super::stops::{Stops, Verdict};
use super::{Effect, Rule};
use crate::calls::EndingBody;
use crate::host::{RefusedCall, Reports, StopCall};
use crate::identity::Caller;
use crate::status;
use crate::tls::Certified;
use crate::tls::incoming::Peer;

/// No stop needs more words than this.
const STOP_BYTES_MAX: usize = 64 * 1024;
/// The words of a stop are there within this time or not at all.
const STOP_WORDS_LIMIT: Duration = Duration::from_secs(5);

/// Makes [`Guarded`] services.
#[derive(Clone, Debug)]
pub(crate) struct GuardLayer {
    /// Whether connections are certified.
    pub certified: bool,
    pub reports: Reports,
    pub stops: Arc<Stops>,
}

/// A service behind the [`GuardLayer`].
#[derive(Clone, Debug)]
pub(crate) struct Guarded<S> {
    inner: S,
    guard: GuardLayer,
}

/// A call that may go on.
struct Passed {
    caller: Caller,
    peer: Option<TcpConnectInfo>,
    certified: Option<Arc<Certified>>,
    rule: Option<&'static Rule>,
}

impl<S> Layer<S> for GuardLayer {
    type Service = Guarded<S>;
    fn layer(&self, inner: S) -> Guarded<S> {
        Guarded {
            inner,
            guard: self.clone(),
        }
    }
}

// === impl GuardLayer ===

impl GuardLayer {
    fn check(&self, request: &Request<Body>) -> Result<Passed, Box<Status>> {
        let method = request.uri().path();
        let peer = self.peer(request);
        let certified = self.certified(request)?;
        let rule = Rule::of(method);
        let Some(holder) = &certified else {
            return Ok(Passed {
                caller: Caller::Local,
                peer,
                certified,
                rule,
            });
        };
        if !holder.is_valid_at(SystemTime::now()) {
            return Err(expired(holder).into());
        }
        let Some(rule) = rule else {
            return Err(unknown(method).into());
        };
        if !rule.allows(holder.role) {
            return Err(not_allowed(method, holder, rule).into());
        }
        Ok(Passed {
            caller: caller(holder),
            peer,
            certified,
            rule: Some(rule),
        })
    }

    /// The holder of the connection's certificate; `None` without TLS.
    fn certified(&self, request: &Request<Body>) -> Result<Option<Arc<Certified>>, Box<Status>> {
        let shown = request.extensions().get::<Peer>();
        match (self.certified, shown) {
            (true, Some(peer)) => Ok(Some(peer.certified.clone())),
            (false, _) => Ok(None),
            (true, None) => Err(nobody().into()),
        }
    }

    fn peer(&self, request: &Request<Body>) -> Option<TcpConnectInfo> {
        let extensions = request.extensions();
        match extensions.get::<Peer>() {
            Some(peer) => Some(peer.address.clone()),
            None => extensions.get::<TcpConnectInfo>().cloned(),
        }
    }

    fn refuse(
        &self,
        caller: Option<Caller>,
        peer: Option<&TcpConnectInfo>,
        method: &str,
        status: Status,
    ) -> Response<Body> {
        self.reports.refused(RefusedCall {
            caller,
            peer: peer.and_then(TcpConnectInfo::remote_addr),
            method: method.to_owned(),
            reason: status::reason(&status).unwrap_or_default(),
            message: status.message().to_owned(),
        });
        status.into_http()
    }
}

fn caller(holder: &Certified) -> Caller {
    Caller::Certified {
        name: holder.name.clone(),
        role: holder.role,
    }
}

// === impl Guarded ===

type GuardFuture<E> = Pin<Box<dyn Future<Output = Result<Response<Body>, E>> + Send>>;

impl<S> Service<Request<Body>> for Guarded<S>
where
    S: Service<Request<Body>, Response = Response<Body>> + Clone + Send + 'static,
    S::Future: Send + 'static,
    S::Error: Send + 'static,
{
    type Response = Response<Body>;
    type Error = S::Error;
    type Future = GuardFuture<S::Error>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.inner.poll_ready(context)
    }

    fn call(&mut self, mut request: Request<Body>) -> Self::Future {
        let passed = match self.guard.check(&request) {
            Ok(passed) => passed,
            Err(refusal) => {
                let shown = request.extensions().get::<Peer>();
                let answer = self.guard.refuse(
                    shown.map(|peer| caller(&peer.certified)),
                    self.guard.peer(&request).as_ref(),
                    request.uri().path(),
                    *refusal,
                );
                return Box::pin(async move { Ok(answer) });
            }
        };
        let extensions = request.extensions_mut();
        extensions.insert(passed.caller.clone());
        if let Some(peer) = &passed.peer {
            extensions.insert(peer.clone());
        }
        let effect = passed.rule.map(|rule| rule.effect);
        if effect.is_some_and(Effect::changes) {
            self.guard.stops.commanded();
        }
        let Some(holder) = passed.certified.clone() else {
            return Box::pin(self.inner.call(request));
        };
        if effect == Some(Effect::Stop) {
            // The clone has not been asked whether it is ready; the one that has been goes with the call.
            let unready = self.inner.clone();
            let inner = std::mem::replace(&mut self.inner, unready);
            return Box::pin(stop(inner, self.guard.clone(), passed, request));
        }
        let answer = self.inner.call(request);
        Box::pin(async move {
            let left = holder.not_after.duration_since(SystemTime::now());
            let end = Instant::now() + left.unwrap_or_default();
            let response = answer.await?;
            Ok(response.map(|body| Body::new(EndingBody::new(body, end, expired(&holder)))))
        })
    }
}

/// A stop of a certified caller: carried out, unless it says again what was just done.
async fn stop<S>(
    mut inner: S,
    guard: GuardLayer,
    passed: Passed,
    request: Request<Body>,
) -> Result<Response<Body>, S::Error>
where
    S: Service<Request<Body>, Response = Response<Body>>,
{
    let (parts, body) = request.into_parts();
    let method = parts.uri.path().to_owned();
    let words = Limited::new(body, STOP_BYTES_MAX).collect();
    let words = match tokio::time::timeout(STOP_WORDS_LIMIT, words).await {
        Ok(Ok(words)) => words.to_bytes(),
        Ok(Err(_)) | Err(_) => {
            let peer = passed.peer.as_ref();
            return Ok(guard.refuse(Some(passed.caller), peer, &method, wordy()));
        }
    };
    let name = passed.caller.name();
    let verdict = guard.stops.asked(name, &method, &words, now());
    if let Verdict::JustDone = verdict {
        let peer = passed.peer.as_ref();
        return Ok(guard.refuse(Some(passed.caller.clone()), peer, &method, just_done()));
    }
    let begun = guard.stops.mark();
    let body = Body::new(Full::new(words.clone()));
    let response = inner.call(Request::from_parts(parts, body)).await?;
    // An answer that is an error says so in its headers.
    let done = !response.headers().contains_key("grpc-status");
    if done {
        guard.stops.done(name, &method, words, begun, now());
    }
    guard.reports.stopped(StopCall {
        peer: passed.peer.as_ref().and_then(TcpConnectInfo::remote_addr),
        caller: passed.caller,
        method,
        done,
    });
    Ok(response)
}

/// Time since the first stop.
fn now() -> Duration {
    static BEGAN: std::sync::LazyLock<Instant> = std::sync::LazyLock::new(Instant::now);
    BEGAN.elapsed()
}

fn expired(holder: &Certified) -> Status {
    status::with_reason(
        Code::Unauthenticated,
        "CERTIFICATE_EXPIRED",
        format!(
            "the certificate of {:?} is not valid any more; connect with a new one",
            holder.name
        ),
        &[("name", holder.name.clone())],
    )
}

fn unknown(method: &str) -> Status {
    status::with_reason(
        Code::Unimplemented,
        "METHOD_UNKNOWN",
        format!("no role may call {method}: it does not stand in the table of roles"),
        &[("method", method.to_owned())],
    )
}

fn not_allowed(method: &str, holder: &Certified, rule: &Rule) -> Status {
    let needed = rule.needed();
    status::with_reason(
        Code::PermissionDenied,
        "ROLE_NOT_ALLOWED",
        format!(
            "{:?} is {}; {method} needs {needed}",
            holder.name, holder.role
        ),
        &[
            ("method", method.to_owned()),
            ("role", holder.role.to_string()),
            ("needed", needed.to_owned()),
        ],
    )
}

fn nobody() -> Status {
    status::with_reason(
        Code::Unauthenticated,
        "CERTIFICATE_MISSING",
        "the connection has shown no certificate",
        &[],
    )
}

fn wordy() -> Status {
    status::exhausted(
        "STOP_TOO_LARGE",
        format!(
            "a stop must be whole within {STOP_BYTES_MAX} bytes and 5 s; send a shorter reason"
        ),
        &[("max_bytes", STOP_BYTES_MAX.to_string())],
    )
}

fn just_done() -> Status {
    status::exhausted(
        "STOP_JUST_DONE",
        "this stop was carried out less than a second ago and nothing was commanded since; everything it halts is halted",
        &[],
    )
}
