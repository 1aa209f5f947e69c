//! Emergency messages: what a drive sends when an error appears or goes (CiA 301, 7.2.7), with the EPOS4's texts.

use crate::frame::Frame;

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

/// What an EPOS4 error code means.
pub const fn text(code: u16) -> &'static str {
    match code {
        0x0000 => "no error",
        0x1000 => "generic error",
        0x1080..=0x1083 => "generic initialization error",
        0x1090 => "firmware incompatibility",
        0x2310 => "overcurrent",
        0x2320 => "power stage protection",
        0x3210 => "overvoltage",
        0x3220 => "undervoltage",
        0x4210 => "thermal overload of the power stage",
        0x4380 => "thermal overload of the motor",
        0x5113 => "logic supply voltage too low",
        0x5280 | 0x5281 => "hardware defect",
        0x5480..=0x5483 => "hardware error",
        0x6080 => "sign of life",
        0x6081 => "extension 1 watchdog",
        0x6180..=0x6190 => "internal software error",
        0x6320 => "software parameter error",
        0x6380 => "persistent parameter corrupt",
        0x7320 => "position sensor error",
        0x7380 => "position sensor breach",
        0x7381 => "position sensor resolution error",
        0x7382 => "position sensor index error",
        0x7388..=0x738A => "hall sensor error",
        0x738C => "ssi sensor error",
        0x7390 => "missing main sensor",
        0x7391 => "missing commutation sensor",
        0x7392 => "main sensor direction error",
        0x8110 | 0x8111 => "can overrun",
        0x8120 => "can passive mode",
        0x8130 => "can heartbeat error",
        0x8150 => "can pdo cob-id collision",
        0x81FD => "can bus turned off",
        0x81FE => "can receive queue overflow",
        0x81FF => "can transmit queue overflow",
        0x8210 => "can pdo length error",
        0x8250 => "rpdo timeout",
        0x8611 => "following error",
        0x8A80 => "negative limit switch",
        0x8A81 => "positive limit switch",
        0x8A82 => "software position limit",
        0x8A88 => "safe torque off",
        0xFF01 => "system overload",
        0xFF02 => "watchdog",
        0xFF0B => "system peak overload",
        0xFF10 => "controller gain error",
        0xFF12..=0xFF21 => "auto tuning error",
        _ => "unknown error",
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
}
