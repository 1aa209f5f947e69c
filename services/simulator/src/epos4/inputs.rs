//! Digital inputs: from the levels at the pins, through polarity, to the functions given to them.

use super::parameters::Parameters;
use super::shaft::Mechanics;

/// Which functions are active: bit n is function n of object 0x3142, as object 0x60FD shows it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Inputs(pub u32);

/// A switch function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switch {
    /// Function 0.
    NegativeLimit,
    /// Function 1.
    PositiveLimit,
    /// Function 2.
    Home,
}

/// Functions have numbers from 0 to 28; 255 is none.
const HIGHEST_FUNCTION: i64 = 28;

impl Inputs {
    /// Reads the pins.
    #[must_use]
    pub fn read(mechanics: &Mechanics, parameters: &Parameters) -> Self {
        let active = levels(mechanics) ^ parameters.input_polarity;
        let functions = parameters.input_functions.iter().enumerate();
        Self(
            functions
                .filter(|(pin, function)| {
                    active >> pin & 1 == 1 && (0..=HIGHEST_FUNCTION).contains(*function)
                })
                .fold(0, |bits, (_, function)| bits | 1 << function),
        )
    }

    /// Whether a switch is active.
    #[must_use]
    pub fn is_active(self, switch: Switch) -> bool {
        self.0 >> switch as u32 & 1 == 1
    }
}

/// Pin n is bit n-1, before polarity: object 0x3141:01.
#[must_use]
pub fn levels(mechanics: &Mechanics) -> u16 {
    u16::from(mechanics.negative_switch)
        | u16::from(mechanics.positive_switch) << 1
        | u16::from(mechanics.home_switch) << 2
}
