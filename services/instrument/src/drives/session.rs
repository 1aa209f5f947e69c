//! The connection to the bus and what goes on over it: setting the drives up, looking at them, stopping them. It is made
//! again whenever it is lost, and nothing moves by that. Only a controller that went bus-off waits for a person.

mod live;
mod set_up;
mod way;

use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use epos4_link::bus;
use epos4_link::canopen::{nmt, pdo};
use epos4_link::frame::error::{ControllerState, Report};
use epos4_link::network::{Event, Network, Options};
use tokio::sync::watch;
use tokio::time::{Instant, sleep_until, timeout};

use super::board::{Board, BusCondition, Readiness};
use super::link::Link;
use super::motion::{Ended, Running};
use crate::axis::Axis;
use crate::config::Cell;
use crate::error::{Failure, Refusal};

use self::live::{Live, leave_all, stop_all};
#[cfg(test)]
pub(crate) use self::way::Connected;
pub(crate) use self::way::{ByAddress, Way};

/// Between two tries to reach the bus, real time.
const RETRY_PAUSE: Duration = Duration::from_secs(1);
/// A drive that is recovered must be ready within this, real time.
const RECOVERY_LIMIT: Duration = Duration::from_secs(15);

type Work<T> = Pin<Box<dyn Future<Output = T> + Send>>;

/// The connection, or the tries to make it.
pub(super) struct Session {
    cell: Arc<Cell>,
    board: Board,
    way: Box<dyn Way>,
    links: Links,
    state: State,
}

/// Something for the owner to act on.
pub(super) enum Step {
    /// A report of a node, at this time of the bus.
    Bus(Event, Duration),
    /// The connection broke: a stable word, and what happened.
    BusLost(&'static str, String),
    /// The drive of an axis is set up, at this time of the bus.
    Ready(Axis, Duration),
    /// The drive of an axis could not be looked at, or is not what it was.
    Fault(Axis, Failure),
    /// The operation at this place has ended.
    Ended(usize, Ended),
    /// The quick stop of all drives has ended.
    Stopped(Result<(), Refusal>),
}

enum State {
    Connecting(Work<way::Connected>),
    Waiting {
        until: Instant,
        why: String,
    },
    /// Nothing is tried until a person recovers an axis.
    Held {
        why: String,
    },
    Live(Box<Live>),
}

impl Session {
    pub(super) fn new(cell: Arc<Cell>, board: Board, way: Box<dyn Way>) -> Self {
        board.update(|state| state.bus.bit_rate = cell.bit_rate);
        Self {
            state: State::Connecting(way.connect()),
            cell,
            board,
            way,
            links: Links(watch::Sender::default()),
        }
    }

    /// Goes on until there is something for the owner. Nothing is lost when the future is dropped.
    pub(super) async fn step(&mut self, running: &mut [Running]) -> Step {
        loop {
            match &mut self.state {
                State::Connecting(connecting) => match connecting.await {
                    Ok(bus) => self.go_live(bus),
                    Err(error) => self.disconnect("BUS_LOST", &error.to_string()),
                },
                State::Waiting { until, .. } => {
                    sleep_until(*until).await;
                    self.state = State::Connecting(self.way.connect());
                }
                State::Held { .. } => std::future::pending().await,
                State::Live(live) => return live.step(running).await,
            }
        }
    }

    fn go_live(&mut self, bus: Box<dyn bus::CanBus>) {
        tracing::info!(bus = %self.cell.bus, "bus connected");
        let heartbeat = Duration::from_millis(self.cell.heartbeat_ms.into());
        let options = Options {
            sdo_timeout: self.cell.sdo_timeout,
            heartbeat: Some((self.cell.host_node_id, heartbeat)),
            node_heartbeat: Some(heartbeat),
            bit_rate: self.cell.bit_rate,
            ..Options::default()
        };
        let (network, nodes) = Network::new(bus, options);
        self.board.update(|state| {
            state.bus.condition = BusCondition::Active;
            state.bus.detail.clear();
            state.bus.counters = None;
        });
        let live = Live::new(network, &nodes, &self.cell, &self.board);
        self.links.set(live.links());
        self.state = State::Live(Box::new(live));
    }

    /// The way to the drive of an axis, or why there is none.
    pub(super) fn link(&self, axis: Axis) -> Result<Link, String> {
        match &self.board.snapshot().axes[axis.index()].readiness {
            Readiness::Ready => self.links.get(axis).ok_or_else(|| self.why_not_connected()),
            Readiness::NotReady { detail, .. } => Err(detail.clone()),
        }
    }

    /// The ways to the drives, for who waits for them.
    pub(super) fn links(&self) -> Links {
        self.links.clone()
    }

    pub(super) fn why_not_connected(&self) -> String {
        match &self.state {
            State::Connecting(_) => format!("{} is not connected yet", self.cell.bus),
            State::Waiting { why, .. } | State::Held { why } => why.clone(),
            State::Live(_) => "no drive has been reached".to_owned(),
        }
    }

    /// Closes the connection and begins to make a new one.
    pub(super) fn disconnect(&mut self, reason: &'static str, why: &str) {
        if !matches!(&self.state, State::Waiting { why: before, .. } if before == why) {
            tracing::warn!(bus = %self.cell.bus, reason, why, "bus not connected");
        }
        self.close(reason, why, BusCondition::Down);
        self.state = State::Waiting {
            until: Instant::now() + RETRY_PAUSE,
            why: why.to_owned(),
        };
    }

    /// Closes the connection and leaves it closed until a person recovers an axis.
    pub(super) fn hold(&mut self, reason: &'static str, why: &str) {
        self.close(reason, why, BusCondition::Off);
        self.state = State::Held {
            why: why.to_owned(),
        };
    }

    fn close(&mut self, reason: &'static str, why: &str, condition: BusCondition) {
        self.links.set([const { None }; 4]);
        self.board.update(|state| {
            state.bus.condition = condition;
            state.bus.detail = why.to_owned();
            state.bus.load = 0.0;
            for axis in &mut state.axes {
                axis.readiness = Readiness::NotReady {
                    reason,
                    detail: why.to_owned(),
                };
                axis.nmt_state = None;
            }
        });
    }

    /// A person recovers: a bus that is not connected is tried at once, after its controller was brought back.
    pub(super) fn recover(&mut self) {
        if let State::Held { .. } = self.state
            && let Err(error) = self.way.restart()
        {
            tracing::warn!(%error, "the controller could not be restarted");
            self.hold("BUS_OFF", &error.to_string());
            return;
        }
        if let State::Held { .. } | State::Waiting { .. } = self.state {
            self.state = State::Connecting(self.way.connect());
        }
    }

    /// Begins to quick-stop every drive that has been reached.
    pub(super) fn begin_stop(&mut self) {
        self.begin(|links| Box::pin(stop_all(links)));
    }

    /// Begins to stop every drive that has been reached and to leave it.
    pub(super) fn begin_leaving(&mut self) {
        self.begin(|links| Box::pin(leave_all(links)));
    }

    fn begin(&mut self, stopping: impl FnOnce([Option<Link>; 4]) -> Work<Result<(), Refusal>>) {
        let State::Live(live) = &mut self.state else {
            return;
        };
        let known = self
            .board
            .snapshot()
            .axes
            .map(|axis| axis.identity.is_some());
        if known.contains(&true) {
            let links = live
                .links()
                .map(|link| link.filter(|link| known[link.axis().index()]));
            live.stopping = Some(stopping(links));
        }
    }

    pub(super) fn is_stopping(&self) -> bool {
        matches!(&self.state, State::Live(live) if live.stopping.is_some())
    }

    pub(super) fn on_heartbeat(&mut self, axis: Axis, nmt_state: nmt::State) {
        self.board
            .update_axis(axis, |state| state.nmt_state = Some(nmt_state));
    }

    /// Takes process data of an axis; a failure when they say what no standard knows.
    pub(super) fn on_pdo(
        &mut self,
        axis: Axis,
        number: u8,
        data: &pdo::Data,
        stamp: Duration,
    ) -> Result<(), Failure> {
        let Some(link) = self.links.get(axis) else {
            return Ok(());
        };
        if !link.process_data().take(number, data, stamp) {
            // What does not fit the mapping does not count as news; when none follow, that is noticed.
            tracing::warn!(%axis, number, data = ?data.as_slice(), "process data not as mapped");
            return Ok(());
        }
        if self.board.is_ready(axis) {
            return link.show_image();
        }
        Ok(())
    }

    /// The bus is at this time.
    pub(super) fn on_time(&mut self, now: Duration) {
        let State::Live(live) = &mut self.state else {
            return;
        };
        live.on_time(now);
        let load = live.load();
        self.board.update(|state| {
            state.now = now;
            state.bus.load = load;
        });
    }

    /// Shows what the controller reports.
    pub(super) fn on_report(&mut self, report: &Report) {
        self.board.update(|state| {
            state.bus.detail = report.to_string();
            state.bus.counters = report.counters().or(state.bus.counters);
            match report.state() {
                Some(ControllerState::ErrorPassive) => {
                    state.bus.condition = BusCondition::ErrorPassive;
                }
                Some(ControllerState::ErrorActive | ControllerState::ErrorWarning) => {
                    state.bus.condition = BusCondition::Active;
                }
                _ => {}
            }
        });
    }

    /// The drive may have lost its settings: it cannot be commanded until they are made again.
    pub(super) fn set_up_anew(&mut self, axis: Axis, reason: &'static str, why: &str) {
        if let State::Live(live) = &mut self.state {
            live.set_up_anew(axis, reason, why);
        }
    }
}

/// The ways to the drives while there is a connection. Clones are the same.
#[derive(Clone)]
pub(super) struct Links(watch::Sender<[Option<Link>; 4]>);

impl Links {
    fn set(&self, links: [Option<Link>; 4]) {
        self.0.send_replace(links);
    }

    fn get(&self, axis: Axis) -> Option<Link> {
        self.0.borrow()[axis.index()].clone()
    }

    /// Waits until the drives of these axes can be commanded.
    pub(super) async fn ready(
        &self,
        board: &Board,
        axes: &[Axis],
    ) -> Result<Vec<Link>, (Axis, Failure)> {
        let mut links = Vec::new();
        for axis in axes {
            let mut states = board.subscribe();
            let ready = states.wait_for(|state| {
                state.axes[axis.index()].readiness == Readiness::Ready && self.get(*axis).is_some()
            });
            let is_ready = matches!(timeout(RECOVERY_LIMIT, ready).await, Ok(Ok(_)));
            match self.get(*axis).filter(|_| is_ready) {
                Some(link) => links.push(link),
                None => {
                    let readiness = board.snapshot().axes[axis.index()].readiness.clone();
                    let why = match readiness {
                        Readiness::NotReady { reason, detail } => format!("{reason}: {detail}"),
                        Readiness::Ready => "it came and went".to_owned(),
                    };
                    return Err((*axis, Failure::NotReady(why)));
                }
            }
        }
        Ok(links)
    }
}
