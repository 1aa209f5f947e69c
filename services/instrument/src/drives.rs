//! The owner of the drives: one task that has the bus, the leases, the operations and every motion.
//!
//! Motions are futures that this task polls itself. To stop one is to drop it: from then on it sends nothing, and the
//! quick stop that follows overtakes whatever of it has not reached the bus.

mod admission;
mod board;
mod commands;
mod handle;
mod link;
mod motion;
mod process_data;
mod session;
mod watching;

use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use arthro_authority::{Leases, Operations, Outcome, REMEMBERED_OPERATIONS};
use arthro_bootstrap::Drain;
use tokio::sync::{mpsc, oneshot};
use tokio::time::{Instant, MissedTickBehavior, interval};

pub use self::board::{AxisState, BusCondition, BusState, I2t, Identity, Readiness, Snapshot};
pub use self::commands::{Authorization, Command, Report, Ticket};
pub use self::handle::Handle;

use self::board::Board;
use self::handle::{Request, StopRequest};
use self::motion::{Ended, Running};
use self::session::{ByAddress, Session, Step, Way};
use crate::axis::Axis;
use crate::bite::Jaw;
use crate::config::Cell;
use crate::error::Refusal;
use crate::supervisor::Supervisor;

/// How often leases are looked at.
const TICK: Duration = Duration::from_millis(20);
/// Commands that wait for the owner.
const REQUEST_QUEUE_LEN: usize = 64;
/// How long a shutdown waits for the drives to confirm.
const SHUTDOWN_STOP_LIMIT: Duration = Duration::from_secs(2);

/// An operation as the owner polls it.
type Work = std::pin::Pin<Box<dyn Future<Output = Ended> + Send>>;

/// The owner.
pub struct Drives {
    cell: Arc<Cell>,
    board: Board,
    requests: mpsc::Receiver<Request>,
    stops: mpsc::UnboundedReceiver<StopRequest>,
    session: Session,
    supervisor: Supervisor,
    leases: Leases,
    operations: Operations,
    /// The last reports of operations that have ended, for as long as they are remembered.
    ended: HashMap<String, Report>,
    running: Vec<Running>,
    stop_waiters: Vec<oneshot::Sender<Result<(), Refusal>>>,
    started: Instant,
}

impl Drives {
    /// The owner of a cell's drives, and the way to it. Nothing is connected before [`run`](Self::run).
    pub fn new(cell: Cell) -> (Self, Handle) {
        let way = ByAddress(cell.bus.clone());
        Self::with_way(cell, Box::new(way))
    }

    /// The same over another way to the bus.
    pub(crate) fn with_way(cell: Cell, way: Box<dyn Way>) -> (Self, Handle) {
        let cell = Arc::new(cell);
        let board = Board::default();
        let (request_sender, requests) = mpsc::channel(REQUEST_QUEUE_LEN);
        let (stop_sender, stops) = mpsc::unbounded_channel();
        let handle = Handle::new(cell.clone(), board.clone(), request_sender, stop_sender);
        let since_1970 = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .unwrap_or_default();
        let drives = Self {
            session: Session::new(cell.clone(), board.clone(), way),
            supervisor: Supervisor::new(cell.heartbeat_timeout),
            leases: Leases::new(u64::try_from(since_1970.as_millis()).unwrap_or(u64::MAX)),
            operations: Operations::new(REMEMBERED_OPERATIONS),
            ended: HashMap::new(),
            running: Vec::new(),
            stop_waiters: Vec::new(),
            started: Instant::now(),
            cell,
            board,
            requests,
            stops,
        };
        (drives, handle)
    }

    /// Owns the drives until the drain starts; then stops them.
    pub async fn run(self, drain: Drain) {
        self.run_until(drain.started()).await;
    }

    async fn run_until(mut self, draining: impl Future<Output = ()>) {
        let mut tick = interval(TICK);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        tokio::pin!(draining);
        loop {
            tokio::select! {
                biased;
                Some(StopRequest { why, reply }) = self.stops.recv() => self.on_stop(&why, reply),
                () = &mut draining => break,
                step = self.session.step(&mut self.running) => self.on_step(step),
                _ = tick.tick() => self.on_tick(),
                Some(request) = self.requests.recv() => self.on_request(request),
            }
        }
        self.stop_motions("SHUTDOWN", "the service shuts down");
        self.session.begin_leaving();
        let stopping = async {
            while self.session.is_stopping() {
                let step = self.session.step(&mut self.running).await;
                self.on_step(step);
            }
        };
        if tokio::time::timeout(SHUTDOWN_STOP_LIMIT, stopping)
            .await
            .is_err()
        {
            tracing::error!("the drives did not confirm the quick stop before the shutdown");
        }
    }

    fn now(&self) -> Duration {
        self.started.elapsed()
    }

    fn on_tick(&mut self) {
        if let Some(lease) = self.leases.expired(self.now()) {
            tracing::warn!(
                holder = lease.holder,
                token = lease.fencing_token,
                "lease lost: stopping the drives"
            );
            let detail = format!(
                "the lease of {:?} was not renewed within {} s",
                lease.holder,
                lease.ttl.as_secs_f64()
            );
            self.stop_motions("LEASE_LOST", &detail);
        }
        // What was known of the jaw is held against its axis; once given up it does not come back.
        let seen = self.board.snapshot().jaw;
        if self.board.jaw(&self.cell) != seen {
            tracing::warn!(?seen, "the jaw does not stand where it was left");
            self.doubt_jaw();
        }
    }

    fn on_stop(&mut self, why: &str, reply: oneshot::Sender<Result<(), Refusal>>) {
        tracing::warn!(why, "stop");
        self.stop_motions("STOPPED", &format!("stopped: {why}"));
        self.stop_waiters.push(reply);
        if !self.session.is_stopping() {
            let why = self.session.why_not_connected();
            self.answer_stops(&Err(Refusal::StopNotConfirmed(why)));
        }
    }

    fn answer_stops(&mut self, outcome: &Result<(), Refusal>) {
        for waiter in self.stop_waiters.drain(..) {
            // Who asked may be gone; the drives were stopped all the same.
            waiter.send(outcome.clone()).ok();
        }
    }

    /// Ends every operation and quick-stops every drive.
    fn stop_motions(&mut self, reason: &str, detail: &str) {
        for running in std::mem::take(&mut self.running) {
            let outcome = Outcome::Stopped {
                reason: reason.to_owned(),
                detail: detail.to_owned(),
            };
            self.finish(running, outcome, None);
        }
        self.doubt_jaw();
        self.session.begin_stop();
    }

    /// After a stop or a fault nobody knows how the jaw stands, until it is opened or homed.
    fn doubt_jaw(&self) {
        self.board.update(|state| state.jaw = Jaw::Unknown);
    }

    fn on_step(&mut self, step: Step) {
        match step {
            Step::Bus(event, now) => self.on_event(event, now),
            Step::BusLost(reason, error) => self.on_bus_lost(reason, &error),
            Step::Ready(axis, now) => self.supervisor.watch(axis, now),
            Step::Fault(axis, failure) => {
                // What is set up anew leaves OPERATIONAL.
                if !self.board.is_ready(axis) {
                    self.supervisor.unwatch(axis);
                }
                if let Some(fault) = failure.fault() {
                    self.on_fault(axis, fault);
                }
            }
            Step::Ended(place, ended) => self.on_ended(place, ended),
            Step::Stopped(outcome) => self.answer_stops(&outcome),
        }
    }

    fn on_ended(&mut self, place: usize, ended: Ended) {
        let running = self.running.remove(place);
        match ended {
            Ok(done) => {
                for axis in &done.recovered {
                    self.supervisor.clear(*axis);
                    self.board
                        .update(|state| state.axes[axis.index()].fault = None);
                }
                self.finish(
                    running,
                    Outcome::Done {
                        detail: done.detail.clone(),
                    },
                    Some(done),
                );
            }
            Err((axis, failure)) => {
                match failure.fault() {
                    Some(fault) => self.on_fault(axis, fault),
                    // The drive obeys, but where the motion stands is not what was wanted.
                    None if running.command.moves() => self.session.begin_stop(),
                    None => {}
                }
                let outcome = Outcome::Failed {
                    reason: failure.reason().to_owned(),
                    detail: failure.to_string(),
                };
                let came_to = motion::Done {
                    bite: failure.bite_end(),
                    ..motion::Done::default()
                };
                self.finish(running, outcome, Some(came_to));
            }
        }
    }

    /// Records the outcome and lets go of the axes.
    fn finish(&mut self, running: Running, outcome: Outcome, done: Option<motion::Done>) {
        let Running {
            command,
            id,
            reports,
            ..
        } = running;
        let bite = done.as_ref().and_then(|done| done.bite);
        let jaw = done.and_then(|done| done.jaw);
        self.board.update(|state| {
            for axis in command.axes() {
                let axis = &mut state.axes[axis.index()];
                axis.operation_id = None;
                axis.moving = false;
            }
            if command.moves() && command.axes().contains(&Axis::ForcepsFeed) {
                state.jaw = jaw.unwrap_or_default();
            }
        });
        let Some(operation) = self.operations.finish(&id, outcome) else {
            return;
        };
        tracing::info!(operation = id, state = ?operation.state, reason = operation.reason, "operation ended");
        reports.send_modify(|report| {
            report.operation = operation;
            report.bite = bite;
        });
        let operations = &self.operations;
        self.ended.retain(|id, _| operations.get(id).is_some());
        self.ended.insert(id, reports.borrow().clone());
    }

    fn on_request(&mut self, request: Request) {
        // In every answer: who asked may be gone.
        match request {
            Request::Acquire { holder, ttl, reply } => {
                // An expired lease must have stopped the drives before the next one is given.
                self.on_tick();
                reply
                    .send(
                        self.leases
                            .acquire(&holder, ttl, self.now())
                            .map_err(Refusal::from),
                    )
                    .ok();
            }
            Request::Renew { token, reply } => {
                reply
                    .send(self.leases.renew(token, self.now()).map_err(Refusal::from))
                    .ok();
            }
            Request::Release { token, reply } => {
                reply.send(self.release(token)).ok();
            }
            Request::Lease { reply } => {
                reply.send(self.leases.current(self.now()).cloned()).ok();
            }
            Request::Command {
                authorization,
                command,
                reply,
            } => {
                reply.send(self.on_command(&authorization, command)).ok();
            }
            Request::Node { axis, reply } => {
                reply
                    .send(self.link(axis).map(|link| link.node().clone()))
                    .ok();
            }
        }
    }

    fn release(&mut self, token: u64) -> Result<(), Refusal> {
        self.leases.check(token, self.now())?;
        if let Some(running) = self.running.iter().find(|running| running.command.moves()) {
            let axis = running
                .command
                .axes()
                .first()
                .copied()
                .unwrap_or(Axis::ForcepsFeed);
            return Err(Refusal::AxisMoving {
                axis,
                operation_id: running.id.clone(),
            });
        }
        Ok(self.leases.release(token, self.now())?)
    }
}

#[cfg(test)]
mod tests;
