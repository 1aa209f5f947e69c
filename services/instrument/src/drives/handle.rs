//! What everybody but the owner holds: asks the owner and waits for its answer.

use std::sync::Arc;
use std::time::Duration;

use arthro_authority::Lease;
use epos4_link::canopen::object::Address;
use epos4_link::network::Node;
use tokio::sync::{mpsc, oneshot, watch};

use super::board::{Board, Snapshot};
use super::commands::{Authorization, Command, Ticket};
use crate::axis::Axis;
use crate::config::Cell;
use crate::error::Refusal;

/// The way to the owner. Cheap to clone.
#[derive(Clone)]
pub struct Handle {
    cell: Arc<Cell>,
    board: Board,
    requests: mpsc::Sender<Request>,
    stops: mpsc::UnboundedSender<StopRequest>,
}

impl Handle {
    pub(super) fn new(
        cell: Arc<Cell>,
        board: Board,
        requests: mpsc::Sender<Request>,
        stops: mpsc::UnboundedSender<StopRequest>,
    ) -> Self {
        Self {
            cell,
            board,
            requests,
            stops,
        }
    }

    /// The cell as configured.
    pub fn cell(&self) -> &Cell {
        &self.cell
    }

    /// The newest state of everything.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot {
            jaw: self.board.jaw(&self.cell),
            ..self.board.snapshot()
        }
    }

    /// The state of everything, whenever it changes.
    pub fn states(&self) -> watch::Receiver<Snapshot> {
        self.board.subscribe()
    }

    /// Takes command.
    pub async fn acquire(&self, holder: String, ttl: Duration) -> Result<Lease, Refusal> {
        self.ask(|reply| Request::Acquire { holder, ttl, reply })
            .await?
    }

    /// Keeps command.
    pub async fn renew(&self, token: u64) -> Result<Lease, Refusal> {
        self.ask(|reply| Request::Renew { token, reply }).await?
    }

    /// Gives command back.
    pub async fn release(&self, token: u64) -> Result<(), Refusal> {
        self.ask(|reply| Request::Release { token, reply }).await?
    }

    /// The lease in force.
    pub async fn lease(&self) -> Result<Option<Lease>, Refusal> {
        self.ask(|reply| Request::Lease { reply }).await
    }

    /// Gives a command. The operation goes on whether or not anybody watches the ticket.
    pub async fn command(
        &self,
        authorization: Authorization,
        command: Command,
    ) -> Result<Ticket, Refusal> {
        self.ask(|reply| Request::Command {
            authorization,
            command,
            reply,
        })
        .await?
    }

    /// Quick-stops all drives; returns when they have confirmed.
    pub async fn stop(&self, why: String) -> Result<(), Refusal> {
        let (reply, answer) = oneshot::channel();
        self.stops
            .send(StopRequest { why, reply })
            .map_err(|_| Refusal::ShuttingDown)?;
        answer.await.map_err(|_| Refusal::ShuttingDown)?
    }

    /// Reads an object of a drive.
    pub async fn read(&self, axis: Axis, address: Address) -> Result<Vec<u8>, Refusal> {
        let node = self.ask(|reply| Request::Node { axis, reply }).await??;
        Ok(node.read_bytes(address).await?.value)
    }

    async fn ask<T>(
        &self,
        request: impl FnOnce(oneshot::Sender<T>) -> Request,
    ) -> Result<T, Refusal> {
        let (reply, answer) = oneshot::channel();
        self.requests
            .send(request(reply))
            .await
            .map_err(|_| Refusal::ShuttingDown)?;
        answer.await.map_err(|_| Refusal::ShuttingDown)
    }
}

/// What the owner is asked.
pub(super) enum Request {
    Acquire {
        holder: String,
        ttl: Duration,
        reply: oneshot::Sender<Result<Lease, Refusal>>,
    },
    Renew {
        token: u64,
        reply: oneshot::Sender<Result<Lease, Refusal>>,
    },
    Release {
        token: u64,
        reply: oneshot::Sender<Result<(), Refusal>>,
    },
    Lease {
        reply: oneshot::Sender<Option<Lease>>,
    },
    Command {
        authorization: Authorization,
        command: Command,
        reply: oneshot::Sender<Result<Ticket, Refusal>>,
    },
    Node {
        axis: Axis,
        reply: oneshot::Sender<Result<Node, Refusal>>,
    },
}

/// Goes its own way, ahead of everything.
pub(super) struct StopRequest {
    pub(super) why: String,
    pub(super) reply: oneshot::Sender<Result<(), Refusal>>,
}
