//! Digital outputs and the holding brake.

use epos4_link::objects;

use super::objects::{Objects, Power};

/// The holding brake as the drive believes it: there is no feedback of one.
#[derive(Clone, Copy, Debug)]
pub struct Brake {
    closed: bool,
    /// How long the power stage has been as it is, s.
    since_s: f64,
    power: Power,
}

/// Functions of object 0x3151.
const HOLDING_BRAKE: i64 = 24;
const READY_OR_FAULT: i64 = 25;

impl Default for Brake {
    fn default() -> Self {
        Self {
            closed: true,
            since_s: 0.0,
            power: Power::Off,
        }
    }
}

impl Brake {
    /// Opens the rise time after power came and closes the fall time after it went.
    pub fn step(&mut self, power: Power, objects: &Objects, dt_s: f64) {
        self.since_s = if power == self.power {
            self.since_s + dt_s
        } else {
            0.0
        };
        self.power = power;
        let (takes, closed) = match power {
            Power::On => (objects::BRAKE_RISE_TIME.address, false),
            Power::Off => (objects::BRAKE_FALL_TIME.address, true),
        };
        if self.since_s >= objects.get(takes) as f64 / 1000.0 {
            self.closed = closed;
        }
    }

    /// Object 0x3158:03.
    #[must_use]
    pub fn is_closed(self) -> bool {
        self.closed
    }
}

/// Object 0x3150:01: levels of the pins after their polarity.
#[must_use]
pub fn levels(objects: &Objects, brake: Brake, fault: bool) -> u16 {
    let general = objects.get(objects::DIGITAL_OUTPUTS.address);
    let functions = [
        objects.get(objects::OUTPUT_FUNCTION_1.address),
        objects.get(objects::OUTPUT_FUNCTION_2.address),
    ];
    let active = |function: i64| match function {
        16 | 17 => general >> function & 1 == 1,
        // The brake opens under current.
        HOLDING_BRAKE => !brake.is_closed(),
        READY_OR_FAULT => !fault,
        _ => false,
    };
    let levels = (0..).zip(functions).fold(0, |levels, (pin, function)| {
        levels | u16::from(active(function)) << pin
    });
    levels ^ objects.get(objects::OUTPUT_POLARITY.address) as u16
}
