//! The state machine that every CiA 402 drive has: reading the statusword 0x6041, composing the controlword 0x6040.

use std::fmt;

/// The states of the drive.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum State {
    /// Starting up.
    NotReadyToSwitchOn,
    /// The power stage is off and locked.
    SwitchOnDisabled,
    /// Waits for switch on.
    ReadyToSwitchOn,
    /// Power is there, the motor is free.
    SwitchedOn,
    /// The motor obeys.
    OperationEnabled,
    /// Braking, or standing after a quick stop.
    QuickStopActive,
    /// An error appeared and the drive brakes.
    FaultReactionActive,
    /// An error stands; the power stage is off.
    Fault,
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotReadyToSwitchOn => "NOT_READY_TO_SWITCH_ON",
            Self::SwitchOnDisabled => "SWITCH_ON_DISABLED",
            Self::ReadyToSwitchOn => "READY_TO_SWITCH_ON",
            Self::SwitchedOn => "SWITCHED_ON",
            Self::OperationEnabled => "OPERATION_ENABLED",
            Self::QuickStopActive => "QUICK_STOP_ACTIVE",
            Self::FaultReactionActive => "FAULT_REACTION_ACTIVE",
            Self::Fault => "FAULT",
        })
    }
}

/// Object 0x6041.
#[derive(Clone, Copy, PartialEq, Eq, Default)]
pub struct Statusword(pub u16);

impl Statusword {
    /// Bit 10: the profile has ended, or the drive stands.
    pub const TARGET_REACHED: u16 = 1 << 10;
    /// Bit 11: current, speed or I2t is limited.
    pub const INTERNAL_LIMIT: u16 = 1 << 11;
    /// Bit 12 in profile position mode: the set point was taken.
    pub const SETPOINT_ACKNOWLEDGED: u16 = 1 << 12;
    /// Bit 12 in homing mode.
    pub const HOMING_ATTAINED: u16 = 1 << 12;
    /// Bit 13 in profile position mode.
    pub const FOLLOWING_ERROR: u16 = 1 << 13;
    /// Bit 13 in homing mode.
    pub const HOMING_ERROR: u16 = 1 << 13;
    /// Bit 15: the position refers to the home point.
    pub const REFERENCED: u16 = 1 << 15;

    /// The state; `None` for a pattern that CiA 402 does not know.
    pub const fn state(self) -> Option<State> {
        match self.0 & 0x6F {
            0x00 => Some(State::NotReadyToSwitchOn),
            0x40 => Some(State::SwitchOnDisabled),
            0x21 => Some(State::ReadyToSwitchOn),
            0x23 => Some(State::SwitchedOn),
            0x27 => Some(State::OperationEnabled),
            0x07 => Some(State::QuickStopActive),
            0x0F => Some(State::FaultReactionActive),
            0x08 => Some(State::Fault),
            _ => None,
        }
    }

    /// Whether all of the given bits are set.
    pub const fn has(self, bits: u16) -> bool {
        self.0 & bits == bits
    }
}

impl fmt::Debug for Statusword {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X}", self.0)
    }
}

impl fmt::Display for Statusword {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self, f)
    }
}

/// The orders of the state machine.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Command {
    /// To READY_TO_SWITCH_ON.
    Shutdown,
    /// To SWITCHED_ON.
    SwitchOn,
    /// To OPERATION_ENABLED.
    EnableOperation,
    /// Back to SWITCHED_ON.
    DisableOperation,
    /// Power off at once.
    DisableVoltage,
    /// Brake on the quick stop ramp and hold.
    QuickStop,
    /// Acknowledges an error. Acts on the rising edge of its bit.
    FaultReset,
}

impl Command {
    /// Object 0x6040 of the order.
    pub const fn controlword(self) -> u16 {
        match self {
            Self::Shutdown => 0x0006,
            Self::SwitchOn | Self::DisableOperation => 0x0007,
            Self::EnableOperation => 0x000F,
            Self::DisableVoltage => 0x0000,
            Self::QuickStop => 0x0002,
            Self::FaultReset => 0x0080,
        }
    }

    /// What a drive makes of a controlword, looked at with the previous one because a fault reset is an edge.
    pub const fn from_controlword(previous: u16, now: u16) -> Self {
        if now & 0x80 != 0 && previous & 0x80 == 0 {
            return Self::FaultReset;
        }
        match now & 0x0F {
            word if word & 0x02 == 0 => Self::DisableVoltage,
            word if word & 0x04 == 0 => Self::QuickStop,
            word if word & 0x01 == 0 => Self::Shutdown,
            word if word & 0x08 == 0 => Self::SwitchOn,
            _ => Self::EnableOperation,
        }
    }
}

/// The order that brings a drive one state nearer to OPERATION_ENABLED; `None` when it is there or must not be
/// brought there: a fault is acknowledged by a person, and a drive in transition is waited for.
pub const fn towards_enabled(state: State) -> Option<Command> {
    match state {
        State::SwitchOnDisabled => Some(Command::Shutdown),
        State::ReadyToSwitchOn => Some(Command::SwitchOn),
        State::SwitchedOn | State::QuickStopActive => Some(Command::EnableOperation),
        State::NotReadyToSwitchOn
        | State::OperationEnabled
        | State::FaultReactionActive
        | State::Fault => None,
    }
}

/// Bits of the controlword in profile position mode.
pub mod profile_position {
    /// Bit 4: take the target, on the rising edge.
    pub const NEW_SETPOINT: u16 = 1 << 4;
    /// Bit 5: leave the present profile at once.
    pub const CHANGE_IMMEDIATELY: u16 = 1 << 5;
    /// Bit 6: the target is a distance.
    pub const RELATIVE: u16 = 1 << 6;
}

/// Bits of the controlword in homing mode.
pub mod homing {
    /// Bit 4: begin, on the rising edge.
    pub const START: u16 = 1 << 4;
}

/// Bit 8 of the controlword: brake and hold, while set.
pub const HALT: u16 = 1 << 8;

/// Object 0x6060, those in use.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Mode {
    /// Positions with a trapezoidal profile.
    ProfilePosition,
    /// Finding the home point.
    Homing,
}

impl Mode {
    /// The number of the mode.
    pub const fn code(self) -> i8 {
        match self {
            Self::ProfilePosition => 1,
            Self::Homing => 6,
        }
    }
}

#[cfg(test)]
mod tests;
