//! Digital inputs: from the levels at the pins, through polarity, to the functions given to them.

use super::mechanics::Mechanics;
use super::parameters::Parameters;

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

/// An input that commands the drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Permission {
    /// Function 27: the power stage may be on while it is active.
    DriveEnable,
    /// Function 28: while it is active the drive brakes.
    QuickStop,
}

/// Functions have numbers from 0 to 28; 255 is none.
const HIGHEST_FUNCTION: i64 = 28;
/// Functions that stop the way into a switch and are no error.
const NEGATIVE_LIMIT_WITHOUT_ERROR: u32 = 24;
const POSITIVE_LIMIT_WITHOUT_ERROR: u32 = 25;

impl Inputs {
    /// Reads the pins.
    #[must_use]
    pub fn read(mechanics: &Mechanics, parameters: &Parameters) -> Self {
        let active = mechanics.levels() ^ parameters.input_polarity;
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
        self.has(switch.function())
    }

    /// Whether a homing that looks for this switch has found it: a limit switch counts with and without error.
    #[must_use]
    pub fn finds(self, switch: Switch) -> bool {
        let without_error = match switch {
            Switch::NegativeLimit => self.has(NEGATIVE_LIMIT_WITHOUT_ERROR),
            Switch::PositiveLimit => self.has(POSITIVE_LIMIT_WITHOUT_ERROR),
            Switch::Home => false,
        };
        self.is_active(switch) || without_error
    }

    /// Whether the way in a direction, by its sign, is closed by a limit switch without error.
    #[must_use]
    pub fn closes(self, direction: f64) -> bool {
        direction < 0.0 && self.has(NEGATIVE_LIMIT_WITHOUT_ERROR)
            || direction > 0.0 && self.has(POSITIVE_LIMIT_WITHOUT_ERROR)
    }

    fn has(self, function: u32) -> bool {
        self.0 >> function & 1 == 1
    }

    /// Whether an input that commands is given to a pin and forbids motion now.
    #[must_use]
    pub fn forbids(self, permission: Permission, parameters: &Parameters) -> bool {
        let function = permission.function();
        let active = self.has(function);
        match permission {
            Permission::DriveEnable => {
                parameters.input_functions.contains(&i64::from(function)) && !active
            }
            Permission::QuickStop => active,
        }
    }
}

impl Switch {
    fn function(self) -> u32 {
        match self {
            Self::NegativeLimit => 0,
            Self::PositiveLimit => 1,
            Self::Home => 2,
        }
    }
}

impl Permission {
    fn function(self) -> u32 {
        match self {
            Self::DriveEnable => 27,
            Self::QuickStop => 28,
        }
    }
}
