//! Profile position mode: the handshake of set points and the move from one to the next.

use epos4_link::cia402::{HALT, profile_position};

use super::parameters::{Parameters, Profile};
use super::trajectory::{Progress, Trajectory};

/// One set point under way and one that waits.
#[derive(Clone, Debug, Default)]
pub struct Positioning {
    active: Option<Setpoint>,
    next: Option<Setpoint>,
    acknowledged: bool,
    halted: bool,
    /// How long the shaft has been within the position window, s.
    in_window_s: f64,
}

/// Where to go and how, taken together when the set point is.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Setpoint {
    goal: Goal,
    profile: Profile,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Goal {
    /// Position of the true shaft.
    Position(f64),
    /// On and on, signed.
    Endless(f64),
}

/// What became of a new set point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// Acknowledged.
    Yes,
    /// One waits already: not acknowledged anew.
    BufferFull,
    /// Beyond a software position limit.
    BeyondLimit,
}

/// Bit 15 of the controlword: move without an end, in the direction of the target's sign.
const ENDLESS: u16 = 1 << 15;

impl Positioning {
    /// Takes a set point, on the rising edge of bit 4. `origin_qc` is where the true shaft stands at position 0.
    pub fn take(
        &mut self,
        controlword: u16,
        parameters: &Parameters,
        trajectory: &Trajectory,
        origin_qc: f64,
    ) -> Taken {
        let goal = self.goal(controlword, parameters, trajectory, origin_qc);
        if let (Goal::Position(position_qc), Some((low_qc, high_qc))) =
            (goal, parameters.position_limits_qc)
            && !(low_qc..=high_qc).contains(&(position_qc - origin_qc))
        {
            return Taken::BeyondLimit;
        }
        let setpoint = Setpoint {
            goal,
            profile: parameters.profile,
        };
        if self.active.is_none() || controlword & profile_position::CHANGE_IMMEDIATELY != 0 {
            self.active = Some(setpoint);
            self.next = None;
        } else if self.next.is_none() {
            self.next = Some(setpoint);
        } else {
            return Taken::BufferFull;
        }
        self.acknowledged = true;
        self.in_window_s = 0.0;
        Taken::Yes
    }

    /// Follows the level of bit 4 and of the halt bit.
    pub fn on_controlword(&mut self, controlword: u16) {
        self.halted = controlword & HALT != 0;
        if controlword & profile_position::NEW_SETPOINT == 0 {
            self.acknowledged = self.next.is_some();
        }
    }

    /// One cycle. `actual_qc` is where the shaft truly is.
    pub fn cycle(
        &mut self,
        trajectory: &mut Trajectory,
        parameters: &Parameters,
        actual_qc: f64,
        dt_s: f64,
    ) {
        let profile = self
            .active
            .map_or(parameters.profile, |setpoint| setpoint.profile);
        if self.halted {
            trajectory.towards_speed(0.0, profile, dt_s);
            return;
        }
        let arrived = match self.active.map(|setpoint| setpoint.goal) {
            Some(Goal::Position(target_qc)) => {
                trajectory.towards_position(target_qc, profile, dt_s) == Progress::Arrived
            }
            Some(Goal::Endless(speed_qc_s)) => {
                trajectory.towards_speed(speed_qc_s, profile, dt_s);
                false
            }
            None => {
                trajectory.towards_speed(0.0, profile, dt_s);
                false
            }
        };
        if arrived {
            self.active = self.next.take();
            self.acknowledged &= self.active.is_none();
        }
        self.in_window_s = match parameters.position_window {
            Some((window_qc, _)) if (trajectory.position_qc - actual_qc).abs() <= window_qc => {
                self.in_window_s + dt_s
            }
            _ => 0.0,
        };
    }

    /// Statusword bits 10 and 12.
    #[must_use]
    pub fn status(&self, trajectory: &Trajectory, parameters: &Parameters) -> (bool, bool) {
        let stands = trajectory.speed_qc_s == 0.0;
        let in_window = parameters
            .position_window
            .is_none_or(|(_, time_s)| self.in_window_s > time_s);
        let reached = if self.halted {
            stands
        } else {
            self.active.is_none() && stands && in_window
        };
        (reached, self.acknowledged)
    }

    fn goal(
        &self,
        controlword: u16,
        parameters: &Parameters,
        trajectory: &Trajectory,
        origin_qc: f64,
    ) -> Goal {
        let target_qc = parameters.target_position_qc;
        if controlword & ENDLESS != 0 {
            return Goal::Endless(parameters.profile.speed_qc_s.copysign(target_qc));
        }
        if controlword & profile_position::RELATIVE == 0 {
            return Goal::Position(target_qc + origin_qc);
        }
        // A distance counts from the last set point, or from the demand if there is none.
        let last = self.next.or(self.active).map(|setpoint| setpoint.goal);
        match last {
            Some(Goal::Position(position_qc)) => Goal::Position(position_qc + target_qc),
            _ => Goal::Position(trajectory.position_qc + target_qc),
        }
    }
}
