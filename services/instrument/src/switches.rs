//! The switches of an axis: which input of the drive carries which, what is active, and the pure part of
//! [commissioning](commissioning) them by hand.

pub mod commissioning;

use std::fmt;

/// A switch as it is wired.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct SwitchSpec {
    /// Digital input of the drive, 1 to 8.
    pub input: u8,
    /// What it tells.
    pub function: Function,
    /// The input's level when the switch is active.
    pub active: Level,
    /// Whether the contact is closed while the switch is free, so that a cut wire shows as active.
    pub normally_closed: bool,
}

/// What a switch tells. The codes are those of object 0x3142.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Function {
    /// The end of the drive's negative direction: the axis' lower end, or the upper one of a reversed axis.
    NegativeLimit,
    /// The end of the drive's positive direction.
    PositiveLimit,
    /// The axis is at its home switch.
    Home,
}

/// The level of an input, object 0x3141:01.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Level {
    /// Bit 0.
    Low,
    /// Bit 1.
    High,
}

/// The inputs of a drive at one moment.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Inputs {
    /// Object 0x3141:01: bit n - 1 is the level of input n, before the polarity.
    pub levels: u16,
    /// Object 0x60FD: bit n is function n of object 0x3142, after the polarity.
    pub functions: u32,
}

// === impl SwitchSpec ===

impl SwitchSpec {
    /// Whether the switch is active by the level of its input.
    pub fn is_active(&self, inputs: &Inputs) -> bool {
        inputs.level(self.input) == self.active
    }

    /// The bit of this input in object 0x3141:02, which must be set for inputs that are active at low level.
    pub fn polarity_mask(&self) -> u16 {
        match self.active {
            Level::Low => 1 << (self.input - 1),
            Level::High => 0,
        }
    }
}

impl fmt::Display for SwitchSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} on input {}", self.function, self.input)
    }
}

// === impl Function ===

impl Function {
    /// Its code in object 0x3142, and its bit in object 0x60FD.
    pub const fn code(self) -> u8 {
        match self {
            Self::NegativeLimit => 0,
            Self::PositiveLimit => 1,
            Self::Home => 2,
        }
    }
}

impl fmt::Display for Function {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NegativeLimit => "negative limit switch",
            Self::PositiveLimit => "positive limit switch",
            Self::Home => "home switch",
        })
    }
}

// === impl Inputs ===

impl Inputs {
    /// The level of input 1 to 8.
    pub fn level(&self, input: u8) -> Level {
        match self.levels >> (input - 1) & 1 {
            0 => Level::Low,
            _ => Level::High,
        }
    }

    /// Whether the drive takes a function for active.
    pub fn has(&self, function: Function) -> bool {
        self.functions >> function.code() & 1 == 1
    }
}
