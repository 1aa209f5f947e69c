//! The layer that keeps a gateway from commanding while another one is in command of their journal: it serves what
//! only reads, and every stop. Whatever is not known to read is refused.

use std::pin::Pin;
use std::task::{Context, Poll};

use http::{Request, Response};
use tokio::sync::watch;
use tonic::server::NamedService;
use tower::{Layer, Service};

use crate::error::Error;
use crate::journal::{Duty, JournalError};

/// Methods whose names begin so change nothing.
const READ: [&str; 3] = ["Get", "List", "Watch"];
/// Methods whose names begin so are served by every gateway that reaches the devices.
const STOP: &str = "Stop";

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
    let method = path.rsplit('/').next().unwrap_or_default();
    method.starts_with(STOP) || READ.iter().any(|word| method.starts_with(word))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_standby_reads_and_stops_and_does_nothing_else() {
        for method in [
            "GetCase",
            "ListProcedures",
            "WatchProcedure",
            "StopProcedure",
            "Stop",
        ] {
            assert!(
                is_served_on_standby(&format!("/arthro.gateway.v1.ProcedureService/{method}")),
                "{method}"
            );
        }
        for method in [
            "StartProcedure",
            "CreateCase",
            "AbortProcedure",
            "VerifyTarget",
            "",
        ] {
            assert!(
                !is_served_on_standby(&format!("/arthro.gateway.v1.ProcedureService/{method}")),
                "{method}"
            );
        }
    }
}
