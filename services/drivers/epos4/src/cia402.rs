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
    towards(state, State::OperationEnabled)
}

/// The order that brings a drive one state nearer to another; `None` when it is there, when it is in transition and has
/// to be waited for, or when no order leads there: a fault is left by [`Command::FaultReset`] alone, which is a person's.
pub const fn towards(state: State, wanted: State) -> Option<Command> {
    use State::{
        Fault, FaultReactionActive, NotReadyToSwitchOn, OperationEnabled, QuickStopActive,
        ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn,
    };
    match (state, wanted) {
        (NotReadyToSwitchOn | FaultReactionActive | Fault, _)
        | (_, NotReadyToSwitchOn | FaultReactionActive | Fault) => None,
        (SwitchOnDisabled, SwitchOnDisabled)
        | (ReadyToSwitchOn, ReadyToSwitchOn)
        | (SwitchedOn, SwitchedOn)
        | (OperationEnabled, OperationEnabled)
        | (QuickStopActive, QuickStopActive) => None,
        (_, SwitchOnDisabled) => Some(Command::DisableVoltage),
        (OperationEnabled, QuickStopActive) => Some(Command::QuickStop),
        // From a quick stop the way down leads over the switched off power stage.
        (QuickStopActive, ReadyToSwitchOn | SwitchedOn) => Some(Command::DisableVoltage),
        (SwitchOnDisabled, _) | (_, ReadyToSwitchOn) => Some(Command::Shutdown),
        (ReadyToSwitchOn, _) => Some(Command::SwitchOn),
        (OperationEnabled, SwitchedOn) => Some(Command::DisableOperation),
        (SwitchedOn | QuickStopActive, _) => Some(Command::EnableOperation),
    }
}

/// Profile position mode: bits of its controlword and of its statusword.
pub mod profile_position {
    use super::{Command, Statusword};

    /// Bit 4: take the target, on the rising edge.
    pub const NEW_SETPOINT: u16 = 1 << 4;
    /// Bit 5: leave the present profile at once.
    pub const CHANGE_IMMEDIATELY: u16 = 1 << 5;
    /// Bit 6: the target is a distance.
    pub const RELATIVE: u16 = 1 << 6;
    /// Bit 15: go on in the direction of the target without end.
    pub const ENDLESS: u16 = 1 << 15;

    /// The controlword that has an enabled drive take its target, with the bits that say how. Bit 4 must have been 0
    /// before: [`ready`] is written first.
    pub const fn start(how: u16) -> u16 {
        Command::EnableOperation.controlword() | NEW_SETPOINT | how
    }

    /// The controlword of an enabled drive between two targets.
    pub const fn ready() -> u16 {
        Command::EnableOperation.controlword()
    }

    /// What the statusword says in this mode.
    #[derive(Clone, Copy, PartialEq, Eq, Debug)]
    pub struct View {
        /// Bit 10: the profile has ended.
        pub target_reached: bool,
        /// Bit 12: the set point was taken.
        pub setpoint_acknowledged: bool,
        /// Bit 13: the motor lags too far behind.
        pub following_error: bool,
    }

    impl From<Statusword> for View {
        fn from(word: Statusword) -> Self {
            Self {
                target_reached: word.has(Statusword::TARGET_REACHED),
                setpoint_acknowledged: word.has(Statusword::SETPOINT_ACKNOWLEDGED),
                following_error: word.has(Statusword::FOLLOWING_ERROR),
            }
        }
    }
}

/// Profile velocity mode: what its statusword says. Writing the target velocity is its only order.
pub mod profile_velocity {
    use super::Statusword;

    /// Bit 12: the speed is zero.
    pub const SPEED_ZERO: u16 = 1 << 12;

    /// What the statusword says in this mode.
    #[derive(Clone, Copy, PartialEq, Eq, Debug)]
    pub struct View {
        /// Bit 10: the velocity is the target.
        pub target_reached: bool,
        /// Bit 12.
        pub speed_zero: bool,
    }

    impl From<Statusword> for View {
        fn from(word: Statusword) -> Self {
            Self {
                target_reached: word.has(Statusword::TARGET_REACHED),
                speed_zero: word.has(SPEED_ZERO),
            }
        }
    }
}

/// Homing mode: bits of its controlword and of its statusword.
pub mod homing {
    use super::{Command, Statusword};

    /// Bit 4: begin, on the rising edge.
    pub const START: u16 = 1 << 4;

    /// The controlword that begins homing. Bit 4 must have been 0 before.
    pub const fn start() -> u16 {
        Command::EnableOperation.controlword() | START
    }

    /// What the statusword says in this mode.
    #[derive(Clone, Copy, PartialEq, Eq, Debug)]
    pub enum View {
        /// The search goes on.
        UnderWay,
        /// Not begun, or broken off.
        Interrupted,
        /// Found, and not yet standing there.
        AttainedMoving,
        /// Found, and standing.
        Attained,
        /// Failed, and not yet standing.
        ErrorMoving,
        /// Failed, and standing.
        Error,
    }

    impl From<Statusword> for View {
        fn from(word: Statusword) -> Self {
            let reached = word.has(Statusword::TARGET_REACHED);
            let attained = word.has(Statusword::HOMING_ATTAINED);
            match (word.has(Statusword::HOMING_ERROR), attained, reached) {
                (true, _, false) => Self::ErrorMoving,
                (true, _, true) => Self::Error,
                (false, true, false) => Self::AttainedMoving,
                (false, true, true) => Self::Attained,
                (false, false, false) => Self::UnderWay,
                (false, false, true) => Self::Interrupted,
            }
        }
    }
}

/// The cyclic modes, in which the master gives a new target with every SYNC: what their statusword says.
pub mod cyclic {
    use super::Statusword;

    /// Bit 12: the drive follows the target.
    pub const FOLLOWS: u16 = 1 << 12;

    /// What the statusword says in these modes.
    #[derive(Clone, Copy, PartialEq, Eq, Debug)]
    pub struct View {
        /// Bit 12.
        pub follows: bool,
        /// Bit 13, of cyclic position alone: the motor lags too far behind.
        pub following_error: bool,
    }

    impl From<Statusword> for View {
        fn from(word: Statusword) -> Self {
            Self {
                follows: word.has(FOLLOWS),
                following_error: word.has(Statusword::FOLLOWING_ERROR),
            }
        }
    }
}

/// Bit 8 of the controlword: brake and hold, while set; in the profile modes and in homing.
pub const HALT: u16 = 1 << 8;

/// Object 0x6060: the modes of the EPOS4.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Mode {
    /// Positions with a trapezoidal profile (PPM).
    ProfilePosition,
    /// Velocities with ramps (PVM).
    ProfileVelocity,
    /// Finding the home point (HMM).
    Homing,
    /// A position with every SYNC (CSP).
    CyclicPosition,
    /// A velocity with every SYNC (CSV).
    CyclicVelocity,
    /// A torque with every SYNC (CST).
    CyclicTorque,
}

impl Mode {
    /// All of them, by rising number.
    pub const ALL: [Self; 6] = [
        Self::ProfilePosition,
        Self::ProfileVelocity,
        Self::Homing,
        Self::CyclicPosition,
        Self::CyclicVelocity,
        Self::CyclicTorque,
    ];

    /// The number of the mode.
    pub const fn code(self) -> i8 {
        match self {
            Self::ProfilePosition => 1,
            Self::ProfileVelocity => 3,
            Self::Homing => 6,
            Self::CyclicPosition => 8,
            Self::CyclicVelocity => 9,
            Self::CyclicTorque => 10,
        }
    }

    /// From its number.
    pub fn from_code(code: i8) -> Option<Self> {
        Self::ALL.into_iter().find(|mode| mode.code() == code)
    }
}

#[cfg(test)]
mod tests;
