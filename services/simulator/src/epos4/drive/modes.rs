//! The modes of operation: what each makes of its targets, cycle by cycle, and shows in the statusword.

use epos4_link::cia402::{HALT, State};

use super::Drive;
use crate::epos4::errors;
use crate::epos4::objects::Power;
use crate::epos4::parameters::{Parameters, Profile};
use crate::epos4::shaft::Order;
use crate::epos4::trajectory::Trajectory;

/// Object 0x6060.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mode {
    ProfilePosition,
    ProfileVelocity,
    Homing,
    CyclicPosition,
    CyclicVelocity,
    CyclicTorque,
}

/// In velocity mode the demanded position does not run ahead of a blocked shaft by more than this.
const VELOCITY_LEASH_QC: f64 = 1000.0;

impl Drive {
    /// What the power stage is to do in this cycle.
    pub(super) fn order(&mut self, parameters: &Parameters, dt_s: f64) -> Order {
        if self.power() == Power::Off {
            return Order::Free;
        }
        if let Some(stopping) = self.stopping {
            let ramp = Profile {
                speed_qc_s: 0.0,
                acceleration_qc_s2: stopping.deceleration_qc_s2,
                deceleration_qc_s2: stopping.deceleration_qc_s2,
            };
            self.trajectory.towards_speed(0.0, ramp, dt_s);
            return Order::Follow(self.trajectory);
        }
        let before = self.trajectory;
        let order = self.mode_order(parameters, dt_s);
        self.keep_out_of_closed_ways(order, before, parameters, dt_s)
    }

    fn mode_order(&mut self, parameters: &Parameters, dt_s: f64) -> Order {
        let halted = self.controlword & HALT != 0;
        match self.mode {
            Mode::ProfilePosition => {
                self.positioning.cycle(
                    &mut self.trajectory,
                    parameters,
                    self.shaft.position_qc,
                    dt_s,
                );
            }
            Mode::ProfileVelocity => {
                let goal_qc_s = if halted {
                    0.0
                } else {
                    parameters.target_speed_qc_s
                };
                self.trajectory
                    .towards_speed(goal_qc_s, parameters.profile, dt_s);
                self.leash();
            }
            Mode::Homing => {
                let index_spacing_qc = parameters
                    .has_index
                    .then_some(parameters.qc_s_per_rpm * 60.0);
                let (trajectory, shaft) = (&mut self.trajectory, &self.shaft);
                let found = self.homing.cycle(
                    trajectory,
                    shaft,
                    self.inputs,
                    &parameters.homing,
                    index_spacing_qc,
                    dt_s,
                );
                if let Some(origin_qc) = found {
                    self.origin_qc = origin_qc;
                    self.referenced = true;
                }
            }
            Mode::CyclicPosition => {
                self.interpolation.cycle(
                    &mut self.trajectory,
                    parameters.target_position_qc + parameters.position_offset_qc + self.origin_qc,
                    parameters.interpolation_period_s,
                    parameters.max_speed_qc_s,
                    dt_s,
                );
            }
            Mode::CyclicVelocity => {
                let profile = Profile {
                    speed_qc_s: parameters.max_speed_qc_s,
                    acceleration_qc_s2: parameters.max_acceleration_qc_s2,
                    deceleration_qc_s2: parameters.max_acceleration_qc_s2,
                };
                let goal_qc_s = (parameters.target_speed_qc_s + parameters.speed_offset_qc_s)
                    .clamp(-parameters.max_speed_qc_s, parameters.max_speed_qc_s);
                self.trajectory.towards_speed(goal_qc_s, profile, dt_s);
                self.leash();
            }
            Mode::CyclicTorque => {
                self.trajectory = Trajectory::standing_at(self.shaft.position_qc);
                let target_ma = parameters.target_current_ma;
                let too_fast = self.shaft.speed_qc_s.abs() >= parameters.max_speed_qc_s
                    && self.shaft.speed_qc_s * target_ma > 0.0;
                return Order::Current(if too_fast { 0.0 } else { target_ma });
            }
        }
        Order::Follow(self.trajectory)
    }

    /// A limit switch without error stops the way into it, by the quick stop ramp, and leaves the way out.
    fn keep_out_of_closed_ways(
        &mut self,
        order: Order,
        before: Trajectory,
        parameters: &Parameters,
        dt_s: f64,
    ) -> Order {
        match order {
            Order::Follow(demand)
                if self.mode != Mode::Homing
                    && (self.inputs.closes(demand.speed_qc_s)
                        || self.inputs.closes(demand.position_qc - before.position_qc)) =>
            {
                let ramp = Profile {
                    speed_qc_s: 0.0,
                    acceleration_qc_s2: parameters.quick_stop_qc_s2,
                    deceleration_qc_s2: parameters.quick_stop_qc_s2,
                };
                self.trajectory = before;
                self.trajectory.towards_speed(0.0, ramp, dt_s);
                Order::Follow(self.trajectory)
            }
            Order::Current(current_ma) if self.inputs.closes(current_ma) => Order::Current(0.0),
            open => open,
        }
    }

    /// Whether the shaft lags behind the demand by more than the following error window.
    pub(super) fn lags(&self, parameters: &Parameters) -> bool {
        let lag_qc = (self.trajectory.position_qc - self.shaft.position_qc).abs();
        let watched = matches!(
            self.mode,
            Mode::ProfilePosition | Mode::Homing | Mode::CyclicPosition
        );
        watched
            && parameters
                .following_window_qc
                .is_some_and(|window_qc| lag_qc > window_qc)
    }

    /// Whether the demand moves in this direction.
    pub(super) fn leaves(&self, direction: f64) -> bool {
        self.trajectory.speed_qc_s * direction > 0.0
    }

    /// In velocity modes nothing was checked beforehand.
    pub(super) fn software_limit_error(&self, parameters: &Parameters) -> Option<u16> {
        let (low_qc, high_qc) = parameters.position_limits_qc?;
        if !matches!(
            self.mode,
            Mode::ProfileVelocity | Mode::CyclicPosition | Mode::CyclicVelocity
        ) {
            return None;
        }
        let position_qc = self.trajectory.position_qc - self.origin_qc;
        let beyond = position_qc < low_qc && !self.leaves(1.0)
            || position_qc > high_qc && !self.leaves(-1.0);
        beyond.then_some(errors::code::SOFTWARE_LIMIT)
    }

    fn leash(&mut self) {
        let shaft_qc = self.shaft.position_qc;
        self.trajectory.position_qc = self
            .trajectory
            .position_qc
            .clamp(shaft_qc - VELOCITY_LEASH_QC, shaft_qc + VELOCITY_LEASH_QC);
    }

    /// Statusword bits 10, 12 and 13.
    pub(super) fn mode_status(&self, parameters: &Parameters) -> (bool, bool, bool) {
        let enabled = self.state == State::OperationEnabled;
        let stands = self.shaft.speed_qc_s.abs() <= parameters.standstill.window_qc_s;
        match self.mode {
            Mode::Homing => self.homing.status(),
            Mode::ProfilePosition if enabled => {
                let (reached, acknowledged) = self.positioning.status(&self.trajectory, parameters);
                (reached, acknowledged, self.following_error)
            }
            Mode::ProfilePosition => (
                self.state == State::QuickStopActive && stands,
                false,
                self.following_error,
            ),
            Mode::ProfileVelocity => {
                let halted = self.controlword & HALT != 0;
                let reached = if halted {
                    stands
                } else {
                    self.trajectory.speed_qc_s == parameters.target_speed_qc_s
                };
                (enabled && reached, stands, false)
            }
            Mode::CyclicPosition => (false, enabled, self.following_error),
            Mode::CyclicVelocity | Mode::CyclicTorque => (false, enabled, false),
        }
    }
}

impl Mode {
    /// The mode of a number in 0x6060.
    pub(super) fn of(code: i64) -> Option<Self> {
        Some(match code {
            1 => Self::ProfilePosition,
            3 => Self::ProfileVelocity,
            6 => Self::Homing,
            8 => Self::CyclicPosition,
            9 => Self::CyclicVelocity,
            10 => Self::CyclicTorque,
            _ => return None,
        })
    }

    /// Its number.
    pub(super) fn code(self) -> i64 {
        match self {
            Self::ProfilePosition => 1,
            Self::ProfileVelocity => 3,
            Self::Homing => 6,
            Self::CyclicPosition => 8,
            Self::CyclicVelocity => 9,
            Self::CyclicTorque => 10,
        }
    }
}
