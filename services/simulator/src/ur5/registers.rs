//! Registers and digital outputs: what programs and RTDE clients tell each other.

use ur_link::rtde::wire::{Type, Value};

use super::Since;

/// Registers of one kind, of which 0..23 belong to fieldbuses and 24..47 to RTDE clients.
pub const COUNT: usize = 48;
/// Bits 0..31 and 32..63 travel as words, 64..127 one by one.
pub const BITS: usize = 128;

/// First versions with the upper half of the registers.
const UPPER: Since = Since::new([3, 9, 0], [5, 3, 0]);

/// Values of one direction.
#[derive(Clone, Debug)]
pub struct Bank {
    /// `*_int_register_n`
    pub ints: [i32; COUNT],
    /// `*_double_register_n`
    pub doubles: [f64; COUNT],
    /// `*_bit_register_n`
    pub bits: u128,
}

impl Default for Bank {
    fn default() -> Self {
        Self {
            ints: [0; COUNT],
            doubles: [0.0; COUNT],
            bits: 0,
        }
    }
}

impl Bank {
    /// Sets one bit.
    pub fn set_bit(&mut self, bit: usize, on: bool) {
        let mask = 1u128 << bit;
        self.bits = if on {
            self.bits | mask
        } else {
            self.bits & !mask
        };
    }

    /// Reads one bit.
    pub fn bit(&self, bit: usize) -> bool {
        self.bits >> bit & 1 == 1
    }

    /// Bits 0..31 or 32..63.
    pub fn word(&self, word: usize) -> u32 {
        (self.bits >> (32 * word)) as u32
    }

    fn set_word(&mut self, word: usize, value: u32) {
        self.bits =
            self.bits & !(u128::from(u32::MAX) << (32 * word)) | u128::from(value) << (32 * word);
    }
}

/// One register of a [`Bank`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Register {
    /// Integer.
    Int(usize),
    /// Double.
    Double(usize),
    /// Single bit, 64..127.
    Bit(usize),
    /// 32 bits.
    Word(usize),
}

impl Register {
    /// From the part of an RTDE name after "input_" or "output_".
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "bit_registers0_to_31" => return Some(Self::Word(0)),
            "bit_registers32_to_63" => return Some(Self::Word(1)),
            _ => {}
        }
        let (kind, number) = name.rsplit_once("_register_")?;
        let number: usize = number.parse().ok()?;
        match kind {
            "int" if number < COUNT => Some(Self::Int(number)),
            "double" if number < COUNT => Some(Self::Double(number)),
            "bit" if (64..BITS).contains(&number) => Some(Self::Bit(number)),
            _ => None,
        }
    }

    /// The upper half, for RTDE clients, came later than the lower.
    pub fn since(self) -> Since {
        match self {
            Self::Int(number) | Self::Double(number) if number >= COUNT / 2 => UPPER,
            Self::Bit(_) => UPPER,
            Self::Double(_) => Since::new([3, 4, 0], [5, 0, 0]),
            Self::Int(_) | Self::Word(_) => Since::ALWAYS,
        }
    }

    /// Its RTDE type.
    pub fn kind(self) -> Type {
        match self {
            Self::Int(_) => Type::Int32,
            Self::Double(_) => Type::Double,
            Self::Bit(_) => Type::Bool,
            Self::Word(_) => Type::UInt32,
        }
    }

    /// Its value.
    pub fn read(self, bank: &Bank) -> Value {
        match self {
            Self::Int(number) => Value::Int32(bank.ints[number]),
            Self::Double(number) => Value::Double(bank.doubles[number]),
            Self::Bit(number) => Value::Bool(bank.bit(number)),
            Self::Word(word) => Value::UInt32(bank.word(word)),
        }
    }

    /// Stores a value of its type; others are left out.
    pub fn write(self, bank: &mut Bank, value: Value) {
        match (self, value) {
            (Self::Int(number), Value::Int32(value)) => bank.ints[number] = value,
            (Self::Double(number), Value::Double(value)) => bank.doubles[number] = value,
            (Self::Bit(number), Value::Bool(value)) => bank.set_bit(number, value),
            (Self::Word(word), Value::UInt32(value)) => bank.set_word(word, value),
            _ => {}
        }
    }
}

/// Inputs of an RTDE client.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Input {
    /// A general purpose register.
    Register(Register),
    /// Bit 0: the fraction that comes with it counts.
    SpeedSliderMask,
    /// 0..1
    SpeedSliderFraction,
    /// Which of the outputs are set.
    OutputMask(Outputs),
    /// Their values.
    Output(Outputs),
    /// Which analog outputs are set.
    AnalogMask,
    /// 0 mA, 1 V.
    AnalogType,
    /// Analog output 0 or 1.
    Analog(usize),
    /// Force and torque of an external sensor.
    ExternalForceTorque,
}

/// Groups of digital outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Outputs {
    /// 0..7
    Standard,
    /// 8..15
    Configurable,
    /// 16, 17
    Tool,
}

impl Outputs {
    /// First bit of the group in `actual_digital_output_bits`.
    pub fn first_bit(self) -> u32 {
        match self {
            Self::Standard => 0,
            Self::Configurable => 8,
            Self::Tool => 16,
        }
    }

    /// Outputs of the group.
    pub fn count(self) -> u32 {
        if self == Self::Tool { 2 } else { 8 }
    }
}

impl Input {
    /// From its RTDE name.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "speed_slider_mask" => Self::SpeedSliderMask,
            "speed_slider_fraction" => Self::SpeedSliderFraction,
            "standard_digital_output_mask" => Self::OutputMask(Outputs::Standard),
            "standard_digital_output" => Self::Output(Outputs::Standard),
            "configurable_digital_output_mask" => Self::OutputMask(Outputs::Configurable),
            "configurable_digital_output" => Self::Output(Outputs::Configurable),
            "tool_digital_output_mask" => Self::OutputMask(Outputs::Tool),
            "tool_digital_output" => Self::Output(Outputs::Tool),
            "standard_analog_output_mask" => Self::AnalogMask,
            "standard_analog_output_type" => Self::AnalogType,
            "standard_analog_output_0" => Self::Analog(0),
            "standard_analog_output_1" => Self::Analog(1),
            "external_force_torque" => Self::ExternalForceTorque,
            _ => Self::Register(Register::from_name(name.strip_prefix("input_")?)?),
        })
    }

    /// First versions that have it.
    pub fn since(self) -> Since {
        match self {
            Self::Register(register) => register.since(),
            _ => Since::ALWAYS,
        }
    }

    /// Its RTDE type.
    pub fn kind(self) -> Type {
        match self {
            Self::Register(register) => register.kind(),
            Self::SpeedSliderMask => Type::UInt32,
            Self::SpeedSliderFraction | Self::Analog(_) => Type::Double,
            Self::OutputMask(_) | Self::Output(_) | Self::AnalogMask | Self::AnalogType => {
                Type::UInt8
            }
            Self::ExternalForceTorque => Type::Vector6D,
        }
    }
}
