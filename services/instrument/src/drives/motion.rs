//! The commands, step by step. A motion is a future that the owner polls; dropping it ends it.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use epos4_link::canopen::object::Address;
use epos4_link::canopen::object::Object;
use epos4_link::cia402::{self, Command as Order, Mode};
use epos4_link::objects;
use tokio::sync::watch;

use super::commands::{Command, Report};
use super::link::{Link, Profile};
use crate::axis::Axis;
use crate::bite::{self, BiteEnd, Jaw};
use crate::config::Cell;
use crate::error::Failure;
use crate::homing::{self, HomingSpec};
use crate::positioning::Sample;

/// How far the drive's own position limits stand beyond the travel, as a share of it: the service refuses first.
const LIMIT_MARGIN: f64 = 0.01;
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
) -> Pin<Box<dyn Future<Output = Ended> + Send>> {
    Box::pin(async move {
        let mut done = Done::default();
        for link in &links {
            let at_fault = |failure| (link.axis(), failure);
            match &command {
                Command::Home(_) => {
                    let sample = home(link).await.map_err(at_fault)?;
                    add_detail(&mut done, link, &sample);
                    if link.axis() == Axis::ForcepsFeed {
                        done.jaw = Some(jaw_at(&cell, sample.position));
                    }
                }
                Command::Move { target, .. } => {
                    let sample = move_to(link, *target).await.map_err(at_fault)?;
                    add_detail(&mut done, link, &sample);
                    done.jaw = Some(jaw_at(&cell, sample.position));
                }
                Command::OpenJaw => {
                    let sample = move_to(link, cell.bite.open_mm).await.map_err(at_fault)?;
                    add_detail(&mut done, link, &sample);
                    done.jaw = Some(Jaw::Open);
                }
                Command::Bite { current_limit_ma } => {
                    let end = bite(link, *current_limit_ma).await.map_err(at_fault)?;
                    let BiteEnd {
                        position_mm,
                        peak_current_ma,
                        jaw,
                    } = end;
                    done.detail = format!(
                        "closed at {position_mm:.3} mm with a peak of {peak_current_ma:.0} mA"
                    );
                    done.jaw = Some(jaw);
                    done.bite = Some(end);
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

async fn move_to(link: &Link, target: f64) -> Result<Sample, Failure> {
    let spec = link.spec();
    let profile = Profile {
        target,
        speed: spec.speed,
        current_limit_ma: spec.current_limit_ma,
        following_error: spec.following_error,
    };
    let watch = link.begin_profile(profile).await?;
    loop {
        if let Some(ended) = watch.observe(&link.sample().await?) {
            ended?;
            break;
        }
    }
    let window = spec.drivetrain.to_quadcount_distance(spec.following_error);
    link.node()
        .write(objects::FOLLOWING_ERROR_WINDOW, window)
        .await?;
    link.sample().await
}

/// The drive keeps closing with the current of the bite after the end, so that the jaw does not lose what it holds.
async fn bite(link: &Link, current_limit_ma: f64) -> Result<BiteEnd, Failure> {
    let (bite, tolerance_mm) = (link.cell().bite, link.spec().tolerance);
    let profile = Profile {
        target: bite.closed_mm,
        speed: bite.speed_mm_s,
        current_limit_ma,
        // Tissue may hold the jaw anywhere on its way; the current is what is limited.
        following_error: link.spec().travel.span(),
    };
    link.begin_profile(profile).await?;
    let mut watch = bite::Watch::new(bite, current_limit_ma, tolerance_mm, &link.sample().await?);
    loop {
        if let Some(ended) = watch.observe(&link.sample().await?) {
            return Ok(ended?);
        }
    }
}

async fn home(link: &Link) -> Result<Sample, Failure> {
    let (node, spec, homing) = (link.node(), link.spec(), link.settings().homing);
    check_switch(link, &homing).await?;
    let drivetrain = &spec.drivetrain;
    // The old limits refer to the old reference.
    node.write(objects::MIN_POSITION_LIMIT, 0).await?;
    node.write(objects::MAX_POSITION_LIMIT, 0).await?;
    node.write(objects::HOMING_METHOD, homing.method.code())
        .await?;
    node.write(
        objects::HOME_POSITION,
        drivetrain.to_quadcounts(homing.position),
    )
    .await?;
    node.write(objects::HOME_OFFSET_MOVE_DISTANCE, 0).await?;
    node.write(
        objects::HOMING_CURRENT_THRESHOLD,
        homing.current_threshold_ma,
    )
    .await?;
    node.write(
        objects::HOMING_SPEED_SWITCH,
        drivetrain.to_rpm(homing.search_speed),
    )
    .await?;
    node.write(
        objects::HOMING_SPEED_ZERO,
        drivetrain.to_rpm(homing.approach_speed),
    )
    .await?;
    node.write(
        objects::HOMING_ACCELERATION,
        drivetrain.to_rpm(spec.acceleration),
    )
    .await?;
    node.write(
        objects::OUTPUT_CURRENT_LIMIT,
        spec.current_limit_ma.round() as u32,
    )
    .await?;
    let window = drivetrain.to_quadcount_distance(spec.following_error);
    node.write(objects::FOLLOWING_ERROR_WINDOW, window).await?;

    link.enable(Mode::Homing).await?;
    let enabled = Order::EnableOperation.controlword();
    node.write(objects::CONTROLWORD, enabled).await?;
    let started = node
        .write(objects::CONTROLWORD, enabled | cia402::homing::START)
        .await?;
    let mut watch = homing::Watch::new(started, homing.time_limit(spec));
    loop {
        let sample = link.sample().await?;
        if sample.statusword.state() == Some(cia402::State::Fault) {
            return Err(link.drive_fault().await);
        }
        if let Some(ended) = watch.observe(sample.statusword, sample.stamp) {
            ended?;
            break;
        }
    }
    node.write(objects::CONTROLWORD, enabled).await?;
    let margin = LIMIT_MARGIN * spec.travel.span();
    let ends = [spec.travel.lowest - margin, spec.travel.highest + margin]
        .map(|end| drivetrain.to_quadcounts(end));
    node.write(objects::MIN_POSITION_LIMIT, ends[0].min(ends[1]))
        .await?;
    node.write(objects::MAX_POSITION_LIMIT, ends[0].max(ends[1]))
        .await?;
    link.sample().await
}

/// A search for a switch that no input has would end at the axis' end.
async fn check_switch(link: &Link, homing: &HomingSpec) -> Result<(), Failure> {
    let Some(function) = homing.method.needed_input_function() else {
        return Ok(());
    };
    for input in 1..=objects::INPUT_COUNT {
        let object: Object<u8> = objects::digital_input_function(input);
        if link.node().read(object).await? == function {
            return Ok(());
        }
    }
    Err(Failure::SwitchNotMapped {
        method: homing.method.code(),
        function,
    })
}

/// Objects that the service writes itself, because they move the drive or guard it.
pub(crate) fn is_reserved(address: Address) -> bool {
    const COMMANDS: [u16; 5] = [0x6040, 0x6060, 0x6071, 0x607A, 0x60FF];
    const GUARDS: [u16; 5] = [0x1016, 0x1017, 0x6007, 0x6065, 0x607D];
    COMMANDS.contains(&address.index)
        || GUARDS.contains(&address.index)
        || address == objects::OUTPUT_CURRENT_LIMIT.address
}
