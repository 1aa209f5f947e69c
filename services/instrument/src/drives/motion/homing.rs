//! Finding the reference of an axis, and setting the drive's own position limits around it.

use epos4_link::cia402::{self, Command as Order, Mode, State};
use epos4_link::objects;

use crate::check::position_limits;
use crate::drives::link::Link;
use crate::error::Failure;
use crate::homing::{HomingSpec, Watch};
use crate::positioning::Sample;

pub(super) async fn home(link: &Link) -> Result<Sample, Failure> {
    let (node, spec, homing) = (link.node(), link.spec(), &link.settings().homing);
    check_switch(link, homing).await?;
    prepare(link, homing).await?;
    link.enable(Mode::Homing).await?;
    let enabled = Order::EnableOperation.controlword();
    node.write(objects::CONTROLWORD, enabled).await?;
    let started = node
        .write(objects::CONTROLWORD, enabled | cia402::homing::START)
        .await?;
    let mut watch = Watch::new(started, homing.time_limit(spec));
    loop {
        let sample = link.sample().await?;
        let state = sample.statusword.state();
        if matches!(state, Some(State::Fault | State::FaultReactionActive)) {
            return Err(link.drive_fault().await);
        }
        if let Some(ended) = watch.observe(sample.statusword, sample.stamp) {
            ended?;
            break;
        }
    }
    node.write(objects::CONTROLWORD, enabled).await?;
    limit_positions(link).await?;
    link.ask().await
}

async fn prepare(link: &Link, homing: &HomingSpec) -> Result<(), Failure> {
    let (node, spec) = (link.node(), link.spec());
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
    node.write(
        objects::HOME_OFFSET_MOVE_DISTANCE,
        drivetrain.to_quadcounts(homing.offset),
    )
    .await?;
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
    Ok(node
        .write(objects::FOLLOWING_ERROR_WINDOW, window)
        .await
        .map(drop)?)
}

/// The drive itself shall stop at the ends, also when this service does not.
async fn limit_positions(link: &Link) -> Result<(), Failure> {
    let (node, expected) = (link.node(), position_limits(link.spec()));
    node.write(objects::MIN_POSITION_LIMIT, expected[0]).await?;
    node.write(objects::MAX_POSITION_LIMIT, expected[1]).await?;
    let found = [
        node.read(objects::MIN_POSITION_LIMIT).await?,
        node.read(objects::MAX_POSITION_LIMIT).await?,
    ];
    if found == expected {
        Ok(())
    } else {
        Err(Failure::LimitsNotKept { found, expected })
    }
}

/// A search for a switch that no input has would end at the axis' end.
async fn check_switch(link: &Link, homing: &HomingSpec) -> Result<(), Failure> {
    let Some(function) = homing.method.needed_function() else {
        return Ok(());
    };
    for input in 1..=objects::INPUT_COUNT {
        let object = objects::digital_input_function(input);
        if link.node().read(object).await? == function.code() {
            return Ok(());
        }
    }
    Err(Failure::SwitchNotMapped {
        method: homing.method.code(),
        function,
    })
}
