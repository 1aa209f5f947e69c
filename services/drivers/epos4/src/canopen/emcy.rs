//! Emergency messages: what a drive sends when an error appears or goes (CiA 301, 7.2.7), with the EPOS4's texts.

mod facts;

use crate::frame::Frame;

pub use self::facts::FACTS;

/// COB-ID of a node's emergencies.
pub const fn cob_id(node_id: u8) -> u16 {
    0x080 + node_id as u16
}

/// An error of a drive, or with code 0 that the errors are gone.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Emergency {
    /// What happened, see [`text`].
    pub code: u16,
    /// Object 0x1001 at that moment.
    pub error_register: u8,
    /// The manufacturer's bytes.
    pub manufacturer: [u8; 5],
}

impl Emergency {
    /// The code that says that the errors are gone.
    pub const RESET: u16 = 0x0000;

    /// An emergency without manufacturer bytes.
    pub const fn new(code: u16, error_register: u8) -> Self {
        Self {
            code,
            error_register,
            manufacturer: [0; 5],
        }
    }

    /// The frame of a node.
    pub const fn encode(&self, node_id: u8) -> Frame {
        let [low, high] = self.code.to_le_bytes();
        let [a, b, c, d, e] = self.manufacturer;
        Frame::standard(
            cob_id(node_id),
            [low, high, self.error_register, a, b, c, d, e],
        )
    }

    /// Node and emergency in a frame; `None` when it is none.
    pub fn decode(frame: &Frame) -> Option<(u8, Self)> {
        let cob_id = frame
            .cob_id()
            .filter(|cob_id| (0x081..=0x0FF).contains(cob_id))?;
        let &[low, high, error_register, a, b, c, d, e] = frame.data() else {
            return None;
        };
        let emergency = Self {
            code: u16::from_le_bytes([low, high]),
            error_register,
            manufacturer: [a, b, c, d, e],
        };
        Some(((cob_id - 0x080) as u8, emergency))
    }
}

/// What is known of one error code, or of a run of codes that mean the same.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Fact {
    /// The first code.
    pub first: u16,
    /// The last code; the same as the first for a single one.
    pub last: u16,
    /// What it means, lowercase.
    pub text: &'static str,
    /// The bit that it sets in the error register, object 0x1001.
    pub register: u8,
    /// What the drive does.
    pub reaction: Reaction,
    /// Whether the position does not refer to the home point any more once the error has been acknowledged.
    pub clears_reference: bool,
    /// What a person does about it, before the fault is recovered.
    pub response: &'static str,
}

/// What a drive does when an error appears.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Reaction {
    /// Power off at once.
    Disable,
    /// By the fault reaction option code, object 0x605E.
    FaultOption,
    /// By the abort connection option code, object 0x6007.
    AbortConnection,
}

/// What a person does about an error that no table has.
const UNKNOWN_RESPONSE: &str = "Write the code down, switch the drive off and on, home the axis again; if the error returns, have the drive checked.";

/// What is known of a code; `None` for a code that no table has.
pub fn fact(code: u16) -> Option<&'static Fact> {
    FACTS
        .iter()
        .find(|fact| (fact.first..=fact.last).contains(&code))
}

/// What an EPOS4 error code means.
pub fn text(code: u16) -> &'static str {
    match code {
        Emergency::RESET => "no error",
        code => fact(code).map_or("unknown error", |fact| fact.text),
    }
}

/// What a person does about an error.
pub fn response(code: u16) -> &'static str {
    match code {
        Emergency::RESET => "Nothing is to be done.",
        code => fact(code).map_or(UNKNOWN_RESPONSE, |fact| fact.response),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_emergency_survives_the_wire() {
        let following_error = Emergency {
            code: 0x8611,
            error_register: 0x80,
            manufacturer: [1, 2, 3, 4, 5],
        };
        let frame = following_error.encode(2);
        assert_eq!(
            frame,
            Frame::standard(0x082, [0x11, 0x86, 0x80, 1, 2, 3, 4, 5])
        );
        assert_eq!(Emergency::decode(&frame), Some((2, following_error)));
    }

    #[test]
    fn a_sync_is_no_emergency() {
        assert_eq!(Emergency::decode(&Frame::standard(0x080, [0; 8])), None);
    }

    #[test]
    fn codes_stand_in_one_row_each_and_tell_a_person_what_to_do() {
        for pair in FACTS.windows(2) {
            assert!(pair[0].last < pair[1].first, "{:04X}", pair[1].first);
        }
        for fact in FACTS {
            assert!(fact.first <= fact.last && fact.register.count_ones() == 1);
            assert!(fact.response.ends_with('.'), "{:04X}", fact.first);
        }
        assert_eq!(text(0x8611), "following error");
        assert_eq!(text(0x1234), "unknown error");
        assert_eq!(response(0x1234), UNKNOWN_RESPONSE);
        assert_eq!(
            fact(0x8130).map(|fact| fact.reaction),
            Some(Reaction::AbortConnection)
        );
    }

    #[test]
    fn a_sensor_that_cannot_be_trusted_costs_the_reference() {
        let clearing = [
            0x7380, 0x7381, 0x7382, 0x7388, 0x7389, 0x738A, 0x7392, 0xFF02,
        ];
        for code in 1..=u16::MAX {
            let clears = fact(code).is_some_and(|fact| fact.clears_reference);
            assert_eq!(clears, clearing.contains(&code), "{code:04X}");
        }
    }
}
