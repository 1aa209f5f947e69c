//! The layer that keeps a gateway from commanding while another one is in command of their journal: it serves what
//! only reads, and every stop. Whatever is not known to read is refused.

use std::pin::Pin;
use std::task::{Context, Poll};

use arthro_bootstrap::roles::Rule;
use http::{Request, Response};
use tokio::sync::watch;
use tonic::server::NamedService;
use tower::{Layer, Service};

use crate::error::Error;
use crate::journal::{Duty, JournalError};

/// Lets through what this gateway may do on its duty.
#[derive(Clone, Debug)]
pub struct OnDuty(pub watch::Receiver<Duty>);

/// A service behind [`OnDuty`].
#[derive(Clone, Debug)]
pub struct Guarded<S> {
    inner: S,
    duty: watch::Receiver<Duty>,
}

impl<S> Layer<S> for OnDuty {
    type Service = Guarded<S>;

    fn layer(&self, inner: S) -> Guarded<S> {
        Guarded {
            inner,
            duty: self.0.clone(),
        }
    }
}

// === impl Guarded ===

type Answer<B, E> = Pin<Box<dyn Future<Output = Result<Response<B>, E>> + Send>>;

impl<S, A, B> Service<Request<A>> for Guarded<S>
where
    S: Service<Request<A>, Response = Response<B>>,
    S::Future: Send + 'static,
    B: Default + Send + 'static,
    S::Error: Send + 'static,
{
    type Response = Response<B>;
    type Error = S::Error;
    type Future = Answer<B, S::Error>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.inner.poll_ready(context)
    }

    fn call(&mut self, request: Request<A>) -> Self::Future {
        let holder = match &*self.duty.borrow() {
            Duty::Standby { holder } if !is_served_on_standby(request.uri().path()) => {
                Some(holder.clone())
            }
            _ => None,
        };
        let Some(holder) = holder else {
            return Box::pin(self.inner.call(request));
        };
        let refusal = super::refuse(Error::Journal(JournalError::NotInCommand { holder }));
        Box::pin(async move { Ok(refusal.into_http()) })
    }
}

impl<S: NamedService> NamedService for Guarded<S> {
    const NAME: &'static str = S::NAME;
}

fn is_served_on_standby(path: &str) -> bool {
    Rule::of(path).is_some_and(|rule| !rule.effect.changes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_standby_reads_and_stops_and_does_nothing_else() {
        for method in [
            "CaseService/GetCase",
            "ProcedureService/ListProcedures",
            "ProcedureService/WatchProcedure",
            "ProcedureService/StopProcedure",
            "AuditService/VerifyChain",
        ] {
            assert!(
                is_served_on_standby(&format!("/arthro.gateway.v1.{method}")),
                "{method}"
            );
        }
        for method in [
            "ProcedureService/StartProcedure",
            "ProcedureService/AbortProcedure",
            "CaseService/CreateCase",
            "CaseService/VerifyTarget",
            "CaseService/GetWhatNobodyKnows",
        ] {
            assert!(
                !is_served_on_standby(&format!("/arthro.gateway.v1.{method}")),
                "{method}"
            );
        }
    }
}
