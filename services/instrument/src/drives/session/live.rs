//! A connection that stands.

use std::future::poll_fn;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use epos4_link::bus;
use epos4_link::cia402::State as DriveState;
use epos4_link::network::{Network, Nodes};
use tokio::sync::watch;
use tokio::time::{Instant, sleep, sleep_until};

use super::super::board::Board;
use super::super::link::Link;
use super::super::motion::{self, Running};
use super::super::process_data::ProcessData;
use super::set_up::{not_ready, set_up};
use super::{Step, Work};
use crate::axis::Axis;
use crate::config::Cell;
use crate::error::{Failure, Refusal};

/// Between two looks at a drive, real time: a cell that runs faster than real time is not asked more often than this.
const LOOK_PAUSE: Duration = Duration::from_millis(50);

pub(super) struct Live {
    network: Network,
    clock: watch::Sender<Duration>,
    axes: [LiveAxis; 4],
    pub(super) stopping: Option<Work<Result<(), Refusal>>>,
    silence: Duration,
}

struct LiveAxis {
    link: Link,
    upkeep: Upkeep,
}

/// What is done with a drive when nobody commands it.
enum Upkeep {
    SettingUp(Work<Result<(), Failure>>),
    Looking(Work<Failure>),
}

impl Live {
    pub(super) fn new(network: Network, nodes: &Nodes, cell: &Arc<Cell>, board: &Board) -> Self {
        let clock = watch::Sender::new(network.now());
        let axes = Axis::ALL.map(|axis| {
            let node = nodes.node(cell.axes[axis.index()].spec.node_id);
            let process_data = ProcessData::new(clock.clone());
            LiveAxis::new(Link::new(
                axis,
                cell.clone(),
                node,
                board.clone(),
                process_data,
            ))
        });
        Self {
            network,
            clock,
            axes,
            stopping: None,
            silence: cell.bus_silence,
        }
    }

    pub(super) async fn step(&mut self, running: &mut [Running]) -> Step {
        loop {
            let Self {
                network,
                axes,
                stopping,
                silence,
                ..
            } = self;
            let silent_at = network.heard_at() + *silence;
            let any_ready = axes.iter().any(LiveAxis::is_ready);
            tokio::select! {
                biased;
                event = network.next_event() => return match event {
                    Ok(event) => Step::Bus(event, network.now()),
                    Err(error) => Step::BusLost(lost_reason(&error), error.to_string()),
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
                        let detail = format!("nothing was heard for {} s", silence.as_secs_f64());
                        return Step::BusLost("BUS_LOST", detail);
                    }
                }
            }
        }
    }

    pub(super) fn links(&self) -> [Option<Link>; 4] {
        self.axes.each_ref().map(|axis| Some(axis.link.clone()))
    }

    pub(super) fn on_time(&mut self, now: Duration) {
        self.clock.send_replace(now);
    }

    pub(super) fn load(&self) -> f64 {
        self.network.load().share()
    }

    pub(super) fn set_up_anew(&mut self, axis: Axis, reason: &'static str, why: &str) {
        self.axes[axis.index()].set_up_anew(reason, why);
    }
}

fn lost_reason(error: &bus::Error) -> &'static str {
    match error {
        bus::Error::QueueFull => "BUS_QUEUE_FULL",
        _ => "BUS_LOST",
    }
}

impl LiveAxis {
    fn new(link: Link) -> Self {
        let upkeep = Upkeep::SettingUp(Box::pin(set_up(link.clone())));
        let mut axis = Self { link, upkeep };
        axis.set_up_anew("SDO_NO_ANSWER", "the drive has not answered yet");
        axis
    }

    fn is_ready(&self) -> bool {
        matches!(self.upkeep, Upkeep::Looking(_))
    }

    fn set_up_anew(&mut self, reason: &'static str, why: &str) {
        not_ready(&self.link, reason, why);
        self.upkeep = Upkeep::SettingUp(Box::pin(set_up(self.link.clone())));
    }

    fn look(&mut self) {
        self.upkeep = Upkeep::Looking(Box::pin(look(self.link.clone())));
    }
}

/// `None` when the drive of the axis has been set up, else why it could not be looked at.
fn poll_upkeep(
    axes: &mut [LiveAxis; 4],
    context: &mut Context<'_>,
) -> Poll<(Axis, Option<Failure>)> {
    for axis in axes {
        match &mut axis.upkeep {
            Upkeep::SettingUp(work) => match work.as_mut().poll(context) {
                Poll::Pending => {}
                Poll::Ready(Ok(())) => {
                    axis.look();
                    return Poll::Ready((axis.link.axis(), None));
                }
                Poll::Ready(Err(failure)) => {
                    axis.set_up_anew(failure.reason(), &failure.to_string());
                    return Poll::Ready((axis.link.axis(), Some(failure)));
                }
            },
            Upkeep::Looking(work) => {
                if let Poll::Ready(failure) = work.as_mut().poll(context) {
                    match failure {
                        // The drive answers and has its settings.
                        Failure::DriveFault { .. } => axis.look(),
                        _ => axis.set_up_anew(failure.reason(), &failure.to_string()),
                    }
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

/// Looks at a drive again and again, while no command does so itself. A drive in fault is one failure, however it was
/// noticed.
async fn look(link: Link) -> Failure {
    loop {
        if link.board().is_commanded(link.axis()) {
            sleep(LOOK_PAUSE).await;
            continue;
        }
        if let Err(failure) = notice_fault(&link).await {
            return failure;
        }
        let looked = tokio::select! {
            looked = async {
                sleep(LOOK_PAUSE).await;
                link.look().await
            } => looked.map(|_| ()),
            // Commands and faults are noticed at once.
            () = link.until_shown_otherwise() => Ok(()),
        };
        if let Err(failure) = looked {
            return failure;
        }
    }
}

/// An emergency may be lost; the statusword tells all the same.
async fn notice_fault(link: &Link) -> Result<(), Failure> {
    let is_faulted = link.board().drive_state(link.axis()) == Some(DriveState::Fault);
    if is_faulted && link.board().fault(link.axis()).is_none() {
        return Err(link.drive_fault().await);
    }
    Ok(())
}

/// All at the same time; with the names of those that did not confirm.
pub(super) async fn stop_all(links: [Option<Link>; 4]) -> Result<(), Refusal> {
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

/// Stops all; when they have confirmed, they are left without power and do not wait for this host any more. Otherwise it is
/// this host's silence that stops them.
pub(super) async fn leave_all(links: [Option<Link>; 4]) -> Result<(), Refusal> {
    stop_all(links.clone()).await?;
    for link in links.into_iter().flatten() {
        if let Err(failure) = link.let_go().await {
            tracing::warn!(axis = %link.axis(), %failure, "the drive was not let go");
        }
    }
    Ok(())
}
