//! A computation that streams its events and survives the replica that it began on.

use std::pin::Pin;
use std::time::Duration;

use tonic::transport::Channel;
use tonic::{Response, Status, Streaming};

use super::{Attempts, Replicas, Ticket};
use crate::clients::Failure;

type Begun<M> = Pin<Box<dyn Future<Output = Result<Response<Streaming<M>>, Status>> + Send>>;

/// One stream of events, whichever replicas they come from. Dropping it stops the computation.
pub struct Run<M> {
    attempts: Attempts,
    /// Sends the whole request to a replica, with the time that remains.
    begin: Box<dyn Fn(Channel, Duration) -> Begun<M> + Send + Sync>,
    /// Whether an event is the result, after which nothing is computed any more.
    is_result: fn(&M) -> bool,
    current: (Ticket, Streaming<M>),
    complete: bool,
}

/// What came.
#[derive(Clone, Debug, PartialEq)]
pub enum Event<M> {
    /// From the service.
    Message(M),
    /// The replica failed; another one computes from the start.
    BegunAnew(BegunAnew),
}

/// Why events start over.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BegunAnew {
    /// How often so far.
    pub times: u32,
    /// The replica that failed.
    pub lost: String,
    /// How.
    pub detail: String,
}

impl<M: 'static> Run<M> {
    /// Begins on a replica that takes it.
    pub(in crate::clients) async fn begin(
        replicas: &Replicas,
        is_result: fn(&M) -> bool,
        begin: impl Fn(Channel, Duration) -> Begun<M> + Send + Sync + 'static,
    ) -> Result<Self, Failure> {
        let mut attempts = Attempts::new(replicas);
        let current = attempts.answered(&begin).await?;
        Ok(Self {
            attempts,
            begin: Box::new(begin),
            is_result,
            current,
            complete: false,
        })
    }

    /// The next event; `None` at the end.
    pub async fn next(&mut self) -> Result<Option<Event<M>>, Failure> {
        let (ticket, messages) = &mut self.current;
        let status = match messages.message().await {
            Ok(message) => {
                ticket.answered();
                self.complete |= message.as_ref().is_some_and(self.is_result);
                return Ok(message.map(Event::Message));
            }
            // What breaks after the result is no loss.
            Err(_) if self.complete => return Ok(None),
            Err(status) => status,
        };
        let detail = status.message().to_owned();
        self.attempts.failed(ticket, status)?;
        let lost = ticket.address.clone();
        self.current = self.attempts.answered(&self.begin).await?;
        Ok(Some(Event::BegunAnew(BegunAnew {
            times: self.attempts.restarts,
            lost,
            detail,
        })))
    }
}

impl<M> std::fmt::Debug for Run<M> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Run")
            .field("attempts", &self.attempts)
            .finish_non_exhaustive()
    }
}
