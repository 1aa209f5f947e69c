//! One axis' drive: the orders that every motion is made of. Each waits for the drive's confirmation and for nothing
//! longer than a limit on the drive's own clock.

mod sampling;

use std::sync::Arc;
use std::time::Duration;

use epos4_link::canopen::pdo;
use epos4_link::cia402::{Command, Mode, State, Statusword, profile_position, towards_enabled};
use epos4_link::network::Node;
use epos4_link::objects;

use super::board::Board;
use super::process_data::{CONTROL_PDO, ProcessData};
use crate::axis::{Axis, AxisSpec};
use crate::config::{AxisSettings, Cell};
use crate::error::Failure;
use crate::positioning::{self, Sample};

/// How long an order of the state machine may take, on the clock of the bus.
const TRANSITION_LIMIT: Duration = Duration::from_secs(1);
/// The drive's own definition of standing (object 0x30E0), rpm.
const STANDSTILL_RPM: u32 = 30;

/// The way to the drive of one axis. Cheap to clone.
#[derive(Clone)]
pub(super) struct Link {
    axis: Axis,
    cell: Arc<Cell>,
    node: Node,
    board: Board,
    process_data: ProcessData,
}

/// A move with profile: what differs from one to the next.
#[derive(Clone, Copy, Debug)]
pub(super) struct Profile {
    /// Where to, in the axis' unit.
    pub(super) target: f64,
    /// Unit/s.
    pub(super) speed: f64,
    /// What the drive may draw.
    pub(super) current_limit_ma: f64,
    /// How far the motor may lag, in the axis' unit.
    pub(super) following_error: f64,
}

impl Link {
    pub(super) fn new(
        axis: Axis,
        cell: Arc<Cell>,
        node: Node,
        board: Board,
        process_data: ProcessData,
    ) -> Self {
        Self {
            axis,
            cell,
            node,
            board,
            process_data,
        }
    }

    pub(super) fn axis(&self) -> Axis {
        self.axis
    }

    pub(super) fn node(&self) -> &Node {
        &self.node
    }

    pub(super) fn cell(&self) -> &Cell {
        &self.cell
    }

    pub(super) fn settings(&self) -> &AxisSettings {
        &self.cell.axes[self.axis.index()]
    }

    pub(super) fn spec(&self) -> &AxisSpec {
        &self.settings().spec
    }

    pub(super) fn process_data(&self) -> &ProcessData {
        &self.process_data
    }

    pub(super) fn board(&self) -> &Board {
        &self.board
    }

    /// Brings the drive into a mode and into OPERATION_ENABLED. A drive in fault stays there.
    pub(super) async fn enable(&self, mode: Mode) -> Result<(), Failure> {
        self.node
            .write(objects::MODES_OF_OPERATION, mode.code())
            .await?;
        let mut limit = Limit::new(TRANSITION_LIMIT);
        loop {
            let Sample {
                statusword, stamp, ..
            } = self.ask().await?;
            let Some(state) = statusword.state() else {
                return Err(Failure::UnknownStatusword(statusword));
            };
            let in_mode = self.node.read(objects::MODES_OF_OPERATION_DISPLAY).await? == mode.code();
            match (state, towards_enabled(state)) {
                (State::OperationEnabled, _) if in_mode => return Ok(()),
                (State::Fault, _) => return Err(self.drive_fault().await),
                // The mode must be right before the motor obeys.
                (_, Some(command)) if in_mode => {
                    self.node
                        .write(objects::CONTROLWORD, command.controlword())
                        .await?;
                }
                _ => {}
            }
            limit.check(stamp, state, "OPERATION_ENABLED")?;
        }
    }

    /// Starts a move, in profile position mode; returns when the drive has taken it, with what watches it.
    pub(super) async fn begin_profile(
        &self,
        profile: Profile,
    ) -> Result<positioning::Watch, Failure> {
        self.enable(Mode::ProfilePosition).await?;
        let Profile {
            target,
            speed,
            current_limit_ma,
            following_error,
        } = profile;
        let (node, spec) = (&self.node, self.spec());
        let drivetrain = &spec.drivetrain;
        let acceleration = drivetrain.to_rpm(spec.acceleration);
        node.write(objects::PROFILE_VELOCITY, drivetrain.to_rpm(speed))
            .await?;
        node.write(objects::PROFILE_ACCELERATION, acceleration)
            .await?;
        node.write(objects::PROFILE_DECELERATION, acceleration)
            .await?;
        // A jaw that was stopped by tissue stands away from where its profile ended; that lag is not an error.
        let actual = node.read(objects::POSITION_ACTUAL).await?;
        let lag = node.read(objects::POSITION_DEMAND).await?.abs_diff(actual);
        let window = drivetrain
            .to_quadcount_distance(following_error)
            .saturating_add(lag);
        node.write(objects::FOLLOWING_ERROR_WINDOW, window).await?;
        node.write(
            objects::OUTPUT_CURRENT_LIMIT,
            current_limit_ma.round() as u32,
        )
        .await?;
        node.write(objects::TARGET_POSITION, drivetrain.to_quadcounts(target))
            .await?;
        let started = self.take_set_point().await?;
        Ok(positioning::Watch::new(
            spec,
            drivetrain.to_position(actual),
            target,
            speed,
            started,
        ))
    }

    /// Has the move under way go on to its target at another speed, unit/s; when that began. It is reached on the ramp of
    /// a quick stop.
    pub(super) async fn change_speed(&self, speed: f64) -> Result<Duration, Failure> {
        let (node, spec) = (&self.node, self.spec());
        let deceleration = spec.drivetrain.to_rpm(spec.quick_stop_deceleration);
        node.write(objects::PROFILE_DECELERATION, deceleration)
            .await?;
        node.write(objects::PROFILE_VELOCITY, spec.drivetrain.to_rpm(speed))
            .await?;
        self.take_set_point().await
    }

    /// Has the drive take target and profile at once; when it began.
    async fn take_set_point(&self) -> Result<Duration, Failure> {
        let node = &self.node;
        let enabled = Command::EnableOperation.controlword();
        let start = enabled | profile_position::NEW_SETPOINT | profile_position::CHANGE_IMMEDIATELY;
        node.write(objects::CONTROLWORD, enabled).await?;
        let started = node.write(objects::CONTROLWORD, start).await?;
        let mut limit = Limit::new(TRANSITION_LIMIT);
        loop {
            let Sample {
                statusword,
                stamp,
                position,
                ..
            } = self.ask().await?;
            match statusword.state() {
                Some(State::OperationEnabled) => {}
                Some(State::Fault) => return Err(self.drive_fault().await),
                _ => {
                    return Err(positioning::MoveError::LeftOperation {
                        position,
                        statusword,
                    }
                    .into());
                }
            }
            if statusword.has(Statusword::SETPOINT_ACKNOWLEDGED) {
                break;
            }
            limit.check(
                stamp,
                State::OperationEnabled,
                "the acknowledge of the set point",
            )?;
        }
        node.write(objects::CONTROLWORD, enabled).await?;
        Ok(started)
    }

    /// Brakes on the quick stop ramp; returns when the drive stands and no longer obeys targets.
    pub(super) async fn quick_stop(&self) -> Result<(), Failure> {
        let quick_stop = Command::QuickStop.controlword();
        // Process data go at once, whatever the drive's SDO server is busy with; the SDO confirms.
        if let Some(data) = pdo::Data::new(&quick_stop.to_le_bytes()) {
            self.node.send_receive_pdo(CONTROL_PDO, &data).await?;
        }
        self.node
            .write_urgently(objects::CONTROLWORD, quick_stop)
            .await?;
        let mut limit = Limit::new(TRANSITION_LIMIT);
        loop {
            let Sample {
                statusword, stamp, ..
            } = self.ask().await?;
            let velocity_rpm = self.node.read(objects::VELOCITY_ACTUAL).await?;
            let Some(state) = statusword.state() else {
                return Err(Failure::UnknownStatusword(statusword));
            };
            if state != State::OperationEnabled && velocity_rpm.unsigned_abs() <= STANDSTILL_RPM {
                return Ok(());
            }
            limit.check(stamp, state, "standstill after quick stop")?;
        }
    }

    /// Switches the power off and has the drive not wait for this host's heartbeat any more: its silence is meant.
    pub(super) async fn let_go(&self) -> Result<(), Failure> {
        let off = Command::DisableVoltage.controlword();
        self.node.write(objects::CONTROLWORD, off).await?;
        self.node.write(objects::CONSUMER_HEARTBEAT_1, 0).await?;
        Ok(())
    }

    /// Acknowledges the drive's error, if it has one. The motor stays without power.
    pub(super) async fn reset_fault(&self) -> Result<(), Failure> {
        let mut limit = Limit::new(TRANSITION_LIMIT);
        loop {
            let Sample {
                statusword, stamp, ..
            } = self.ask().await?;
            let Some(state) = statusword.state() else {
                return Err(Failure::UnknownStatusword(statusword));
            };
            match state {
                State::Fault => {
                    // The reset is a rising edge.
                    self.node
                        .write(objects::CONTROLWORD, Command::DisableVoltage.controlword())
                        .await?;
                    self.node
                        .write(objects::CONTROLWORD, Command::FaultReset.controlword())
                        .await?;
                    self.node
                        .write(objects::CONTROLWORD, Command::DisableVoltage.controlword())
                        .await?;
                }
                State::FaultReactionActive | State::NotReadyToSwitchOn => {}
                _ => return Ok(()),
            }
            if limit.check(stamp, state, "a state without fault").is_err() {
                return Err(self.drive_fault().await);
            }
        }
    }

    /// The drive's own word for its fault.
    pub(super) async fn drive_fault(&self) -> Failure {
        match self.node.read(objects::ERROR_CODE).await {
            Ok(code) => Failure::DriveFault { code },
            Err(error) => error.into(),
        }
    }
}

/// A limit on the clock of the bus for each state on the way, which begins with the first look at it: between two looks of
/// a busy host much time of the bus may pass, and a drive that goes on is not late.
pub(super) struct Limit {
    since: Option<(State, Duration)>,
    changes: u32,
    limit: Duration,
}

impl Limit {
    /// A drive that is in its wanted state after so many changes has not got lost among them.
    const CHANGES: u32 = 8;

    pub(super) fn new(limit: Duration) -> Self {
        Self {
            since: None,
            changes: 0,
            limit,
        }
    }

    pub(super) fn check(
        &mut self,
        stamp: Duration,
        state: State,
        wanted: &'static str,
    ) -> Result<(), Failure> {
        let began = match self.since {
            Some((last, began)) if last == state || self.changes >= Self::CHANGES => began,
            _ => {
                self.since = Some((state, stamp));
                self.changes += 1;
                stamp
            }
        };
        if stamp.saturating_sub(began) <= self.limit {
            return Ok(());
        }
        Err(Failure::NoTransition {
            state,
            wanted,
            limit_s: self.limit.as_secs_f64(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn s(s: u64) -> Duration {
        Duration::from_secs(s)
    }

    #[test]
    fn a_drive_that_goes_on_is_not_late_and_one_that_stays_is() {
        let mut limit = Limit::new(s(1));
        for (stamp, state) in [
            (s(1), State::SwitchOnDisabled),
            (s(3), State::ReadyToSwitchOn),
            (s(6), State::SwitchedOn),
        ] {
            assert!(limit.check(stamp, state, "OPERATION_ENABLED").is_ok());
        }
        let late = limit.check(s(8), State::SwitchedOn, "OPERATION_ENABLED");
        assert!(matches!(late, Err(Failure::NoTransition { .. })));
    }

    #[test]
    fn a_drive_that_goes_round_in_circles_is_late() {
        let mut limit = Limit::new(s(1));
        let round = [State::ReadyToSwitchOn, State::SwitchedOn];
        let late = (0..40).find(|turn| {
            let state = round[*turn as usize % 2];
            limit.check(s(*turn), state, "OPERATION_ENABLED").is_err()
        });
        assert!(late.is_some());
    }
}
