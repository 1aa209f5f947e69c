//! The errors of a drive: which bit of the error register and which reaction belong to a code, and the history.

use epos4_link::canopen::emcy::{self, Emergency, Reaction};

use super::objects::Objects;
use epos4_link::objects;

/// Codes that the simulated drive raises itself.
pub mod code {
    /// The master's heartbeat stayed out.
    pub const HEARTBEAT: u16 = 0x8130;
    /// The supply is above its limit.
    pub const OVERVOLTAGE: u16 = 0x3210;
    /// The supply is below its limit.
    pub const UNDERVOLTAGE: u16 = 0x3220;
    /// The power stage is too hot.
    pub const OVERTEMPERATURE: u16 = 0x4210;
    /// Safe torque off was opened under power.
    pub const SAFE_TORQUE_OFF: u16 = 0x8A88;
    /// A PDO was shorter than its mapping.
    pub const PDO_LENGTH: u16 = 0x8210;
    /// The shaft lags too far behind the demand.
    pub const FOLLOWING: u16 = 0x8611;
    /// Negative limit switch.
    pub const NEGATIVE_LIMIT: u16 = 0x8A80;
    /// Positive limit switch.
    pub const POSITIVE_LIMIT: u16 = 0x8A81;
    /// Software position limit.
    pub const SOFTWARE_LIMIT: u16 = 0x8A82;
}

/// Errors present and past.
#[derive(Clone, Debug, Default)]
pub struct Errors {
    present: Vec<u16>,
}

impl Errors {
    /// Adds an error; the message for the bus, or none if it was present already.
    pub fn raise(&mut self, code: u16, objects: &mut Objects) -> Option<Emergency> {
        if self.present.contains(&code) {
            return None;
        }
        self.present.push(code);
        for place in (2..=objects::ERROR_HISTORY_LEN).rev() {
            objects.set(
                objects::error_history(place).address,
                objects.get(objects::error_history(place - 1).address),
            );
        }
        objects.set(objects::error_history(1).address, i64::from(code));
        let count = objects.get(objects::ERROR_HISTORY_COUNT.address);
        objects.set(
            objects::ERROR_HISTORY_COUNT.address,
            (count + 1).min(i64::from(objects::ERROR_HISTORY_LEN)),
        );
        objects.set(objects::ERROR_CODE.address, i64::from(code));
        objects.set(objects::ERROR_REGISTER.address, i64::from(self.register()));
        Some(Emergency::new(code, self.register()))
    }

    /// Whether an error is present.
    #[must_use]
    pub fn has(&self, code: u16) -> bool {
        self.present.contains(&code)
    }

    /// Acknowledges all errors; the message for the bus, or none if there were none.
    pub fn reset(&mut self, objects: &mut Objects) -> Option<Emergency> {
        if self.present.is_empty() {
            return None;
        }
        self.present.clear();
        objects.set(objects::ERROR_CODE.address, 0);
        objects.set(objects::ERROR_REGISTER.address, 0);
        Some(Emergency::new(Emergency::RESET, 0))
    }

    /// Object 0x1001.
    fn register(&self) -> u8 {
        self.present
            .iter()
            .fold(0, |register, code| register | effect(*code).0)
    }
}

/// Empties the history, as writing 0 to 0x1003 does.
pub fn clear_history(objects: &mut Objects) {
    for place in 1..=objects::ERROR_HISTORY_LEN {
        objects.set(objects::error_history(place).address, 0);
    }
}

/// Bit of the error register, and reaction, of a code. One that no table has is generic and disables.
#[must_use]
pub fn effect(code: u16) -> (u8, Reaction) {
    emcy::fact(code).map_or((GENERIC, Reaction::Disable), |fact| {
        (fact.register, fact.reaction)
    })
}

/// Bit 0 of object 0x1001.
const GENERIC: u8 = 0x01;

/// Whether an error makes the position worthless: the encoder cannot be trusted.
#[must_use]
pub fn loses_reference(code: u16) -> bool {
    emcy::fact(code).is_some_and(|fact| fact.clears_reference)
}
