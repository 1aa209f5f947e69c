//! What can be broken about one drive, its wires and its mechanism, beyond what it can know.

use epos4_link::canopen::object::Address;
use epos4_link::dictionary;

use super::mechanics::{INPUT_COUNT, Mechanics};

/// All that is wrong at this moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Defects {
    /// Of shaft, encoder and belt.
    pub drivetrain: Drivetrain,
    /// Of the wires of digital inputs 1 to 8.
    pub wires: [Option<WireDefect>; INPUT_COUNT],
    /// The inputs of safe torque off carry no voltage.
    pub sto_open: bool,
    /// The supply where it is not the usual 24 V.
    pub supply_v: Option<f64>,
    /// The power stage where it has not the usual 30 C.
    pub power_stage_c: Option<f64>,
    /// Objects that read as another value than they have.
    pub claims: Vec<(Address, i64)>,
}

/// Defects between the power stage and the mechanism.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drivetrain {
    /// The encoder counts no more.
    pub encoder_frozen: bool,
    /// The share of the shaft's turns that does not arrive at the mechanism, 0 to 1.
    pub slip_share: f64,
    /// The shaft cannot turn.
    pub jammed: bool,
}

/// What is wrong with a wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WireDefect {
    /// It is cut: the pin is low.
    Cut,
    /// Somebody holds the switch pressed.
    Pressed,
}

const USUAL_SUPPLY_V: f64 = 24.0;
const USUAL_POWER_STAGE_C: f64 = 30.0;

impl Defects {
    /// What arrives at the pins.
    #[must_use]
    pub fn wired(&self, mechanics: &Mechanics) -> Mechanics {
        let mut arriving = *mechanics;
        for (input, defect) in arriving.inputs.iter_mut().zip(self.wires) {
            match defect {
                Some(WireDefect::Cut) => input.cut = true,
                Some(WireDefect::Pressed) => input.actuated = true,
                None => {}
            }
        }
        arriving
    }

    /// The supply, V.
    #[must_use]
    pub fn supply_v(&self) -> f64 {
        self.supply_v.unwrap_or(USUAL_SUPPLY_V)
    }

    /// The power stage's temperature, degrees Celsius.
    #[must_use]
    pub fn power_stage_c(&self) -> f64 {
        self.power_stage_c.unwrap_or(USUAL_POWER_STAGE_C)
    }

    /// The bytes of an object that reads as another value.
    #[must_use]
    pub fn claimed(&self, address: Address) -> Option<Vec<u8>> {
        let (_, value) = self
            .claims
            .iter()
            .find(|(claimed, _)| *claimed == address)?;
        dictionary::entry(address).map(|entry| entry.kind.encode(*value))
    }
}
