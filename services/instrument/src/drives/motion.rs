//! The commands, step by step. A motion is a future that the owner polls; dropping it ends it.

mod bite;
mod homing;
mod profile;
mod switches;

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use epos4_link::canopen::object::Address;
use epos4_link::cia402::Statusword;
use epos4_link::objects;
use tokio::sync::watch;

use super::commands::{Command, Report};
use super::link::Link;
use crate::axis::Axis;
use crate::bite::{BiteEnd, Jaw};
use crate::config::Cell;
use crate::error::Failure;
use crate::positioning::Sample;

/// An operation under way.
pub(super) struct Running {
    pub(super) id: String,
    pub(super) command: Command,
    pub(super) reports: watch::Sender<Report>,
    pub(super) future: Pin<Box<dyn Future<Output = Ended> + Send>>,
}

/// How an operation ended; with the axis at fault.
pub(super) type Ended = Result<Done, (Axis, Failure)>;

/// What a command that succeeded leaves.
#[derive(Default, Debug)]
pub(super) struct Done {
    /// For a person.
    pub(super) detail: String,
    /// The end of a bite.
    pub(super) bite: Option<BiteEnd>,
    /// The jaw, if it was moved.
    pub(super) jaw: Option<Jaw>,
    /// The axes whose faults are gone.
    pub(super) recovered: Vec<Axis>,
}

/// Polls all operations; the place of one that has ended.
pub(super) fn poll_ended(
    running: &mut [Running],
    context: &mut Context<'_>,
) -> Poll<(usize, Ended)> {
    for (place, operation) in running.iter_mut().enumerate() {
        if let Poll::Ready(ended) = operation.future.as_mut().poll(context) {
            return Poll::Ready((place, ended));
        }
    }
    Poll::Pending
}

/// Carries out a command over the links of its axes, in the order of [`Command::axes`].
pub(super) fn carry_out(
    cell: Arc<Cell>,
    command: Command,
    links: Vec<Link>,
    reports: watch::Sender<Report>,
) -> Pin<Box<dyn Future<Output = Ended> + Send>> {
    Box::pin(async move {
        let mut done = Done::default();
        for link in &links {
            let at_fault = |failure| (link.axis(), failure);
            match &command {
                Command::Home(_) => {
                    let sample = homing::home(link).await.map_err(at_fault)?;
                    add_detail(&mut done, link, &sample);
                    if link.axis() == Axis::ForcepsFeed {
                        done.jaw = Some(jaw_at(&cell, sample.position));
                    }
                }
                Command::Move { target, .. } => {
                    let sample = profile::move_to(link, *target).await.map_err(at_fault)?;
                    add_detail(&mut done, link, &sample);
                    done.jaw = Some(jaw_at(&cell, sample.position));
                }
                Command::OpenJaw => {
                    let sample = profile::move_to(link, cell.bite.open_mm)
                        .await
                        .map_err(at_fault)?;
                    add_detail(&mut done, link, &sample);
                    done.jaw = Some(Jaw::Open);
                }
                Command::Bite { current_limit_ma } => {
                    let end = bite::bite(link, *current_limit_ma)
                        .await
                        .map_err(at_fault)?;
                    done.detail = told(&end);
                    done.jaw = Some(end.result.jaw());
                    done.bite = Some(end);
                }
                Command::CommissionSwitches { timeout, .. } => {
                    done.detail = switches::commission(link, *timeout, &reports)
                        .await
                        .map_err(at_fault)?;
                }
                Command::Recover(_) => {
                    link.reset_fault().await.map_err(at_fault)?;
                    done.recovered.push(link.axis());
                }
                Command::Write { address, data, .. } => {
                    let written = link.node().write_bytes(*address, data).await;
                    written.map_err(|error| at_fault(error.into()))?;
                }
            }
        }
        Ok(done)
    })
}

/// Only the open position says something of the jaw.
fn jaw_at(cell: &Cell, position_mm: f64) -> Jaw {
    let tolerance_mm = cell.axes[Axis::ForcepsFeed.index()].spec.tolerance;
    if position_mm <= cell.bite.open_mm + tolerance_mm {
        Jaw::Open
    } else {
        Jaw::Unknown
    }
}

fn add_detail(done: &mut Done, link: &Link, sample: &Sample) {
    let separator = if done.detail.is_empty() { "" } else { ", " };
    let axis = link.axis();
    done.detail += &format!(
        "{separator}{axis} at {:.3} {}",
        sample.position,
        axis.unit()
    );
}

fn told(end: &BiteEnd) -> String {
    let BiteEnd {
        position_mm,
        peak_current_ma,
        ..
    } = end;
    let met = end
        .contact_mm
        .map(|mm| format!(", met something at {mm:.2} mm"))
        .unwrap_or_default();
    let force = end
        .force_n
        .map(|force_n| format!(", {force_n:.0} N"))
        .unwrap_or_default();
    format!("closed at {position_mm:.3} mm with a peak of {peak_current_ma:.0} mA{force}{met}")
}

/// Asks the drive itself, now: what was last seen of it may be old.
async fn referenced(link: &Link) -> Result<Sample, Failure> {
    let sample = link.ask().await?;
    if sample.statusword.has(Statusword::REFERENCED) {
        Ok(sample)
    } else {
        Err(Failure::NotHomed {
            axis: link.axis(),
            statusword: sample.statusword,
        })
    }
}

/// Objects that the service writes itself, because they move the drive or guard it.
pub(crate) fn is_reserved(address: Address) -> bool {
    const COMMANDS: [u16; 5] = [0x6040, 0x6060, 0x6071, 0x607A, 0x60FF];
    const GUARDS: [u16; 7] = [0x1016, 0x1017, 0x3141, 0x3142, 0x6007, 0x6065, 0x607D];
    COMMANDS.contains(&address.index)
        || GUARDS.contains(&address.index)
        || address == objects::OUTPUT_CURRENT_LIMIT.address
}
