//! The layer around every call of the gateway: what changes something stands in the audit before it is worked on, and how
//! it ended after.
//!
//! What holds or stops the machine is never kept waiting for the audit: it is noted in its order and written meanwhile.
//! What only reads leaves no trace unless it is refused. A call that cannot be recorded is refused with `AUDIT_FAILED`.

use std::convert::Infallible;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use arthro_bootstrap::roles::{self, Rule};
use arthro_bootstrap::{Caller, status};
use http::{Request, Response};
use tonic::body::Body;
use tonic::transport::server::{TcpConnectInfo, TlsConnectInfo};
use tonic::{Code, Status};
use tower::{Layer, Service};

use super::body::{Answer, Heard, Prefix};
use super::entry::{Entry, Kind, Who};
use super::keeper::{Audit, Place};
use super::subject::Requests;
use crate::wall_clock::now_ms;

/// The reason of a call that could not be recorded, and was therefore not worked on.
pub const AUDIT_FAILED: &str = "AUDIT_FAILED";

/// Puts the audit around a service.
#[derive(Clone)]
pub struct AuditLayer {
    audit: Audit,
    requests: Arc<Requests>,
}

/// A service behind the [`AuditLayer`].
#[derive(Clone)]
pub struct Audited<S> {
    inner: S,
    layer: AuditLayer,
}

/// What a call may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Effect {
    /// Nothing.
    Read,
    /// It changes something, and waits for the audit.
    Change(Kind),
    /// It takes motion away, and waits for nothing.
    Halt(Kind),
}

/// A call that has not ended. One that is dropped was given up by the client.
pub(super) struct Open {
    audit: Audit,
    effect: Effect,
    end: Entry,
    /// Where its beginning stands; nowhere for a call that only reads, or could not be recorded.
    place: Option<Place>,
    heard: Heard,
    ended: bool,
}

// === impl AuditLayer ===

impl AuditLayer {
    /// Records in this audit.
    pub fn new(audit: Audit) -> Self {
        Self {
            audit,
            requests: Arc::new(Requests::of_the_contract()),
        }
    }

    async fn call<S>(
        &self,
        mut inner: S,
        request: Request<Body>,
    ) -> Result<Response<Body>, Infallible>
    where
        S: Service<Request<Body>, Response = Response<Body>, Error = Infallible>,
    {
        let path = request.uri().path().to_owned();
        let effect = Effect::of(&path);
        let mut entry = Entry::new(now_ms(), Kind::Outcome, who(&request));
        entry.method.clone_from(&path);
        if effect == Effect::Read {
            let open = self.open(effect, entry, Heard::default());
            return inner
                .call(request)
                .await
                .map(|response| open.watch(response));
        }

        let (parts, body) = request.into_parts();
        let prefix = Prefix::of(body, self.requests.streams(&path)).await;
        let subject = self.requests.subject(&path, prefix.bytes());
        entry.stated = subject.stated;
        entry.case_id = subject.case_id;
        entry.procedure_id = subject.procedure_id;
        entry.plan = subject.plan;
        let mut beginning = entry.clone();
        beginning.detail = subject.reason;
        let (body, heard) = prefix.into_body();
        beginning.request = heard.digest();
        let mut open = self.open(effect, entry, heard);
        match self.begin(effect, beginning).await {
            Ok(place) => open.place = Some(place),
            Err(refusal) => {
                open.end(&refusal);
                return Ok(refusal.into_http());
            }
        }
        let response = inner.call(Request::from_parts(parts, body)).await;
        response.map(|response| open.watch(response))
    }

    async fn begin(&self, effect: Effect, mut beginning: Entry) -> Result<Place, Status> {
        match effect {
            Effect::Change(kind) => {
                beginning.kind = kind;
                let recorded = self.audit.record(beginning).await;
                recorded.map_err(|error| status::unavailable(AUDIT_FAILED, error.to_string(), &[]))
            }
            Effect::Halt(kind) => {
                beginning.kind = kind;
                Ok(self.audit.note(beginning))
            }
            Effect::Read => Ok(Place::default()),
        }
    }

    fn open(&self, effect: Effect, end: Entry, heard: Heard) -> Open {
        Open {
            audit: self.audit.clone(),
            effect,
            end,
            place: None,
            heard,
            ended: false,
        }
    }
}

impl<S> Layer<S> for AuditLayer {
    type Service = Audited<S>;
    fn layer(&self, inner: S) -> Audited<S> {
        Audited {
            inner,
            layer: self.clone(),
        }
    }
}

// === impl Audited ===

type CallFuture = Pin<Box<dyn Future<Output = Result<Response<Body>, Infallible>> + Send>>;

impl<S> Service<Request<Body>> for Audited<S>
where
    S: Service<Request<Body>, Response = Response<Body>, Error = Infallible>,
    S: Clone + Send + 'static,
    S::Future: Send,
{
    type Response = Response<Body>;
    type Error = Infallible;
    type Future = CallFuture;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        self.inner.poll_ready(context)
    }

    fn call(&mut self, request: Request<Body>) -> Self::Future {
        // The one that was made ready is the one that is called.
        let next = self.inner.clone();
        let inner = std::mem::replace(&mut self.inner, next);
        let layer = self.layer.clone();
        Box::pin(async move { layer.call(inner, request).await })
    }
}

impl<S: tonic::server::NamedService> tonic::server::NamedService for Audited<S> {
    const NAME: &'static str = S::NAME;
}

// === impl Effect ===

impl Effect {
    fn of(path: &str) -> Self {
        match Rule::of(path).map(|rule| rule.effect) {
            Some(roles::Effect::Read) => Self::Read,
            Some(roles::Effect::Stop) => Self::Halt(Kind::Stop),
            Some(roles::Effect::Halt) => Self::Halt(Kind::Command),
            Some(roles::Effect::Decision) => Self::Change(Kind::Decision),
            Some(roles::Effect::Command) | None => Self::Change(Kind::Command),
        }
    }
}

// === impl Open ===

impl Open {
    /// Follows the answer to its end, which may be in it already.
    fn watch(mut self, response: Response<Body>) -> Response<Body> {
        if let Some(status) = Status::from_header_map(response.headers()) {
            self.end(&status);
            return response;
        }
        response.map(|body| Body::new(Answer::new(body, self)))
    }

    /// Records how the call ended, once.
    pub(super) fn end(&mut self, status: &Status) {
        if std::mem::replace(&mut self.ended, true) {
            return;
        }
        let denied = matches!(
            status.code(),
            Code::PermissionDenied | Code::Unauthenticated
        );
        if self.effect == Effect::Read && !denied {
            return;
        }
        let mut entry = self.end.clone();
        entry.at_ms = now_ms();
        if refused(status.code()) {
            entry.kind = Kind::Refusal;
        }
        entry.request = self.heard.digest();
        entry.code = word(status.code());
        entry.reason = status::reason(status).unwrap_or_default();
        status.message().clone_into(&mut entry.detail);
        match self.place.take() {
            Some(place) => self.audit.note_end(entry, place),
            None => {
                self.audit.note(entry);
            }
        }
    }
}

impl Drop for Open {
    fn drop(&mut self) {
        self.end(&Status::cancelled("the client went before the answer"));
    }
}

fn refused(code: Code) -> bool {
    matches!(
        code,
        Code::InvalidArgument
            | Code::NotFound
            | Code::AlreadyExists
            | Code::PermissionDenied
            | Code::Unauthenticated
            | Code::ResourceExhausted
            | Code::FailedPrecondition
            | Code::Aborted
            | Code::OutOfRange
            | Code::Unimplemented
            | Code::Unavailable
    )
}

/// The code as the protocol spells it.
pub(super) fn word(code: Code) -> String {
    let mut word = String::new();
    for letter in format!("{code:?}").chars() {
        if letter.is_uppercase() && !word.is_empty() {
            word.push('_');
        }
        word.push(letter.to_ascii_uppercase());
    }
    word
}

fn who(request: &Request<Body>) -> Who {
    let extensions = request.extensions();
    let peer = extensions
        .get::<TcpConnectInfo>()
        .and_then(TcpConnectInfo::remote_addr)
        .or_else(|| {
            extensions
                .get::<TlsConnectInfo<TcpConnectInfo>>()
                .and_then(|info| info.get_ref().remote_addr())
        });
    let caller = extensions.get::<Caller>().cloned().unwrap_or(Caller::Local);
    Who {
        peer: peer.map_or_else(String::new, |address| address.to_string()),
        ..Who::from(&caller)
    }
}
