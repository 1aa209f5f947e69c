//! The connection to the bus and what goes on over it: setting the drives up, looking at them, stopping them. It is made
//! again whenever it is lost, and nothing moves by that.

use std::future::poll_fn;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use epos4_link::canopen::nmt;
use epos4_link::network::{Event, Network, Options};
use epos4_link::objects;
use tokio::sync::watch;
use tokio::time::{Instant, sleep, sleep_until, timeout};

use super::Connected;
use super::board::{Board, Identity, Readiness};
use super::link::Link;
use super::motion::{self, Ended, Running};
use crate::axis::Axis;
use crate::config::Cell;
use crate::error::{Failure, Refusal};

/// Between two tries to reach the bus or a drive, real time.
const RETRY_PAUSE: Duration = Duration::from_secs(1);
/// Between two looks at a drive that is not commanded, real time.
const IDLE_LOOK_PAUSE: Duration = Duration::from_millis(50);
/// A drive that was started must be OPERATIONAL within this, real time.
const OPERATIONAL_LIMIT: Duration = Duration::from_secs(3);

type Work<T> = Pin<Box<dyn Future<Output = T> + Send>>;

/// Makes a connection to the bus.
pub(crate) type Connector = Box<dyn Fn() -> Work<Connected> + Send>;

/// The connection, or the tries to make it.
pub(super) struct Session {
    cell: Arc<Cell>,
    board: Board,
    connector: Connector,
    state: State,
}

/// Something for the owner to act on.
pub(super) enum Step {
    /// A report of a node, at this time of the bus.
    Bus(Event, Duration),
    /// The connection broke.
    BusLost(String),
    /// The drive of an axis is set up, at this time of the bus.
    Ready(Axis, Duration),
    /// The drive of an axis could not be looked at.
    Fault(Axis, Failure),
    /// The operation at this place has ended.
    Ended(usize, Ended),
    /// The quick stop of all drives has ended.
    Stopped(Result<(), Refusal>),
}

enum State {
    Connecting(Work<Connected>),
    Waiting { until: Instant, why: String },
    Live(Box<Live>),
}

struct Live {
    network: Network,
    axes: [LiveAxis; 4],
    stopping: Option<Work<Result<(), Refusal>>>,
    silence: Duration,
}

struct LiveAxis {
    link: Link,
    nmt_state: watch::Sender<Option<nmt::State>>,
    upkeep: Upkeep,
}

/// What is done with a drive when nobody commands it.
enum Upkeep {
    SettingUp(Work<()>),
    Looking(Work<Failure>),
}

impl Session {
    pub(super) fn new(cell: Arc<Cell>, board: Board, connector: Connector) -> Self {
        let state = State::Connecting(connector());
        Self {
            cell,
            board,
            connector,
            state,
        }
    }

    /// Goes on until there is something for the owner. Nothing is lost when the future is dropped.
    pub(super) async fn step(&mut self, running: &mut [Running]) -> Step {
        loop {
            match &mut self.state {
                State::Connecting(connecting) => match connecting.await {
                    Ok(bus) => {
                        tracing::info!(bus = %self.cell.bus, "bus connected");
                        let (network, nodes) = Network::new(
                            bus,
                            Options {
                                sdo_timeout: self.cell.sdo_timeout,
                                ..Options::default()
                            },
                        );
                        let axes = Axis::ALL.map(|axis| {
                            let node = nodes.node(self.cell.axes[axis.index()].spec.node_id);
                            LiveAxis::new(Link::new(
                                axis,
                                self.cell.clone(),
                                node,
                                self.board.clone(),
                            ))
                        });
                        let silence = self.cell.bus_silence;
                        self.state = State::Live(Box::new(Live {
                            network,
                            axes,
                            stopping: None,
                            silence,
                        }));
                    }
                    Err(error) => self.disconnect(&error.to_string()),
                },
                State::Waiting { until, .. } => {
                    sleep_until(*until).await;
                    self.state = State::Connecting((self.connector)());
                }
                State::Live(live) => return live.step(running).await,
            }
        }
    }

    /// The way to the drive of an axis, or why there is none.
    pub(super) fn link(&self, axis: Axis) -> Result<Link, String> {
        let State::Live(live) = &self.state else {
            return Err(self.why_not_connected());
        };
        match &self.board.snapshot().axes[axis.index()].readiness {
            Readiness::Ready => Ok(live.axes[axis.index()].link.clone()),
            Readiness::NotReady(why) => Err(why.clone()),
        }
    }

    pub(super) fn why_not_connected(&self) -> String {
        match &self.state {
            State::Connecting(_) => format!("{} is not connected yet", self.cell.bus),
            State::Waiting { why, .. } => why.clone(),
            State::Live(_) => "no drive has been reached".to_owned(),
        }
    }

    /// Closes the connection and begins to make a new one.
    pub(super) fn disconnect(&mut self, why: &str) {
        if !matches!(&self.state, State::Waiting { why: before, .. } if before == why) {
            tracing::warn!(bus = %self.cell.bus, why, "bus not connected");
        }
        self.board.update(|state| {
            for axis in &mut state.axes {
                axis.readiness = Readiness::NotReady(why.to_owned());
                axis.nmt_state = None;
            }
        });
        self.state = State::Waiting {
            until: Instant::now() + RETRY_PAUSE,
            why: why.to_owned(),
        };
    }

    /// Begins to quick-stop every drive that has been reached.
    pub(super) fn begin_stop(&mut self) {
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
                .axes
                .each_ref()
                .map(|axis| known[axis.link.axis().index()].then(|| axis.link.clone()));
            live.stopping = Some(Box::pin(stop_all(links)));
        }
    }

    pub(super) fn is_stopping(&self) -> bool {
        matches!(&self.state, State::Live(live) if live.stopping.is_some())
    }

    pub(super) fn on_heartbeat(&mut self, axis: Axis, nmt_state: nmt::State) {
        self.board
            .update_axis(axis, |state| state.nmt_state = Some(nmt_state));
        if let State::Live(live) = &self.state {
            live.axes[axis.index()]
                .nmt_state
                .send_replace(Some(nmt_state));
        }
    }

    /// The drive may have lost its settings: it cannot be commanded until they are made again.
    pub(super) fn set_up_anew(&mut self, axis: Axis, why: &str) {
        if let State::Live(live) = &mut self.state {
            live.axes[axis.index()].set_up_anew(why);
        }
    }
}

impl Live {
    async fn step(&mut self, running: &mut [Running]) -> Step {
        loop {
            let Self {
                network,
                axes,
                stopping,
                silence,
            } = self;
            let silent_at = network.heard_at() + *silence;
            let any_ready = axes.iter().any(LiveAxis::is_ready);
            tokio::select! {
                biased;
                event = network.next_event() => return match event {
                    Ok(event) => Step::Bus(event, network.now()),
                    Err(error) => Step::BusLost(error.to_string()),
                },
                outcome = poll_fn(|context| poll_option(stopping, context)) => return Step::Stopped(outcome),
                (place, ended) = poll_fn(|context| motion::poll_ended(running, context)) => {
                    return Step::Ended(place, ended);
                }
                (axis, failure) = poll_fn(|context| poll_upkeep(axes, context)) => return match failure {
                    Some(failure) => Step::Fault(axis, failure),
                    None => Step::Ready(axis, network.now()),
                },
                () = sleep_until(silent_at), if any_ready => {
                    if network.heard_at() + *silence <= Instant::now() {
                        return Step::BusLost(format!("nothing was heard for {} s", silence.as_secs_f64()));
                    }
                }
            }
        }
    }
}

impl LiveAxis {
    fn new(link: Link) -> Self {
        let nmt_state = watch::Sender::new(None);
        let upkeep = Upkeep::SettingUp(Box::pin(set_up(link.clone(), nmt_state.subscribe())));
        let mut axis = Self {
            link,
            nmt_state,
            upkeep,
        };
        axis.set_up_anew("the drive has not answered yet");
        axis
    }

    fn is_ready(&self) -> bool {
        matches!(self.upkeep, Upkeep::Looking(_))
    }

    fn set_up_anew(&mut self, why: &str) {
        not_ready(&self.link, why);
        self.nmt_state.send_replace(None);
        self.upkeep = Upkeep::SettingUp(Box::pin(set_up(
            self.link.clone(),
            self.nmt_state.subscribe(),
        )));
    }
}

fn not_ready(link: &Link, why: &str) {
    link.board().update_axis(link.axis(), |state| {
        state.readiness = Readiness::NotReady(why.to_owned())
    });
}

/// `None` when the drive of the axis has been set up, else why it could not be looked at.
fn poll_upkeep(
    axes: &mut [LiveAxis; 4],
    context: &mut Context<'_>,
) -> Poll<(Axis, Option<Failure>)> {
    for axis in axes {
        match &mut axis.upkeep {
            Upkeep::SettingUp(work) => {
                if work.as_mut().poll(context).is_ready() {
                    axis.upkeep = Upkeep::Looking(Box::pin(look(axis.link.clone())));
                    return Poll::Ready((axis.link.axis(), None));
                }
            }
            Upkeep::Looking(work) => {
                if let Poll::Ready(failure) = work.as_mut().poll(context) {
                    axis.set_up_anew(&failure.to_string());
                    return Poll::Ready((axis.link.axis(), Some(failure)));
                }
            }
        }
    }
    Poll::Pending
}

fn poll_option<T>(work: &mut Option<Work<T>>, context: &mut Context<'_>) -> Poll<T> {
    let Some(future) = work else {
        return Poll::Pending;
    };
    let polled = future.as_mut().poll(context);
    if polled.is_ready() {
        *work = None;
    }
    polled
}

/// Tries until the drive is what it should be and has its settings.
async fn set_up(link: Link, mut nmt_state: watch::Receiver<Option<nmt::State>>) {
    let mut last = String::new();
    loop {
        match try_set_up(&link, &mut nmt_state).await {
            Ok(()) => {
                tracing::info!(axis = %link.axis(), "drive ready");
                return link
                    .board()
                    .update_axis(link.axis(), |state| state.readiness = Readiness::Ready);
            }
            Err(why) => {
                if why != last {
                    tracing::warn!(axis = %link.axis(), why, "drive not ready");
                }
                not_ready(&link, &why);
                last = why;
            }
        }
        sleep(RETRY_PAUSE).await;
    }
}

async fn try_set_up(
    link: &Link,
    nmt_state: &mut watch::Receiver<Option<nmt::State>>,
) -> Result<(), String> {
    let (node, cell, spec) = (link.node(), link.cell(), link.spec());
    let told = |error: epos4_link::network::Error| error.to_string();
    let identity = Identity {
        vendor_id: node.read(objects::VENDOR_ID).await.map_err(told)?,
        product_code: node.read(objects::PRODUCT_CODE).await.map_err(told)?,
        revision: node.read(objects::REVISION_NUMBER).await.map_err(told)?,
        serial_number: node.read(objects::SERIAL_NUMBER).await.map_err(told)?,
    };
    check("vendor (0x1018:01)", identity.vendor_id, cell.vendor_id)?;
    check(
        "product code (0x1018:02)",
        identity.product_code,
        cell.product_code,
    )?;
    let resolution = node
        .read(objects::MAIN_SENSOR_RESOLUTION)
        .await
        .map_err(told)?;
    check(
        "encoder resolution (0x3000:05)",
        resolution,
        spec.drivetrain.quadcounts_per_motor_turn,
    )?;
    link.board()
        .update_axis(link.axis(), |state| state.identity = Some(identity));

    let deceleration = spec.drivetrain.to_rpm(spec.quick_stop_deceleration);
    node.write(objects::QUICK_STOP_DECELERATION, deceleration)
        .await
        .map_err(told)?;
    node.write(objects::PRODUCER_HEARTBEAT, cell.heartbeat_ms)
        .await
        .map_err(told)?;
    node.command(nmt::Command::Start).await.map_err(told)?;
    let operational = nmt_state.wait_for(|state| *state == Some(nmt::State::Operational));
    if timeout(OPERATIONAL_LIMIT, operational).await.is_err() {
        return Err(format!(
            "not OPERATIONAL within {} s",
            OPERATIONAL_LIMIT.as_secs()
        ));
    }
    link.sample()
        .await
        .map(|_| ())
        .map_err(|failure| failure.to_string())
}

fn check(what: &str, found: u32, expected: u32) -> Result<(), String> {
    if found == expected {
        return Ok(());
    }
    Err(format!(
        "{what} is 0x{found:08X}, configured is 0x{expected:08X}"
    ))
}

/// Looks at a drive again and again, while no command does so itself.
async fn look(link: Link) -> Failure {
    loop {
        if !link.board().is_commanded(link.axis())
            && let Err(failure) = link.sample().await
        {
            return failure;
        }
        sleep(IDLE_LOOK_PAUSE).await;
    }
}

/// All at the same time; with the names of those that did not confirm.
async fn stop_all(links: [Option<Link>; 4]) -> Result<(), Refusal> {
    let [a, b, c, d] = links.map(|link| async move {
        let link = link?;
        let failure = link.quick_stop().await.err()?;
        tracing::error!(axis = %link.axis(), %failure, "quick stop not confirmed");
        Some(format!("{}: {failure}", link.axis()))
    });
    let (a, b, c, d) = tokio::join!(a, b, c, d);
    let failures: Vec<String> = [a, b, c, d].into_iter().flatten().collect();
    if failures.is_empty() {
        Ok(())
    } else {
        Err(Refusal::StopNotConfirmed(failures.join("; ")))
    }
}
