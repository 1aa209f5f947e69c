//! How busy the bus is, counted from the frames that were sent and received.

use std::time::Duration;

use crate::frame::{Frame, Id};

/// Parts of the window.
const PARTS: usize = 10;
/// One part.
const PART: Duration = Duration::from_millis(100);

/// Counts frames over the last second of bus time.
#[derive(Clone, Debug)]
pub struct Load {
    bit_rate: u32,
    /// Which hundred milliseconds the newest part is.
    newest: u128,
    bits: [u64; PARTS],
    sent: u64,
    received: u64,
}

/// The longest that a frame can be on the bus, in bits, with the three bits between frames.
///
/// A frame with 11-bit identifier and `n` bytes has 44 + 8 n bits, of which 34 + 8 n are stuffed: at worst one bit is
/// added to the first five and one to every four after that, which makes 55 + 10 n. With 29-bit identifier 80 + 10 n.
/// (Davis, Burns, Bril, Lukkien: Controller Area Network schedulability analysis, 2007, Eqs. 1 and 2.)
pub fn worst_case_bits(frame: &Frame) -> u32 {
    let payload = 10 * frame.data().len() as u32;
    match frame.id() {
        Id::Standard(_) => 55 + payload,
        Id::Extended(_) => 80 + payload,
        // A report of the controller was not on the bus.
        Id::Error(_) => 0,
    }
}

impl Load {
    /// Nothing counted yet, on a bus of this many bits a second.
    pub fn new(bit_rate: u32) -> Self {
        Self {
            bit_rate,
            newest: 0,
            bits: [0; PARTS],
            sent: 0,
            received: 0,
        }
    }

    pub(super) fn on_sent(&mut self, frame: &Frame, now: Duration) {
        self.sent += 1;
        self.count(frame, now);
    }

    pub(super) fn on_received(&mut self, frame: &Frame, stamp: Duration) {
        self.received += 1;
        self.count(frame, stamp);
    }

    fn count(&mut self, frame: &Frame, stamp: Duration) {
        let part = stamp.as_nanos() / PART.as_nanos();
        // A clock that went back, as after a restart of the bus, begins anew.
        if part < self.newest || part - self.newest >= PARTS as u128 {
            self.bits = [0; PARTS];
        } else {
            for passed in self.newest + 1..=part {
                self.bits[(passed % PARTS as u128) as usize] = 0;
            }
        }
        self.newest = part;
        self.bits[(part % PARTS as u128) as usize] += u64::from(worst_case_bits(frame));
    }

    /// The share of the last second of bus time, up to the newest frame, in which the bus was taken, with every frame
    /// counted as long as it can be: an upper bound, 0 to 1 and more.
    pub fn share(&self) -> f64 {
        let bits: u64 = self.bits.iter().sum();
        bits as f64 / f64::from(self.bit_rate)
    }

    /// Bits a second.
    pub fn bit_rate(&self) -> u32 {
        self.bit_rate
    }

    /// Frames sent so far.
    pub fn sent(&self) -> u64 {
        self.sent
    }

    /// Frames received so far.
    pub fn received(&self) -> u64 {
        self.received
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn a_frame_of_eight_bytes_is_at_most_135_bits() {
        assert_eq!(worst_case_bits(&Frame::standard(0x181, [0; 8])), 135);
        assert_eq!(worst_case_bits(&Frame::standard(0x080, [])), 55);
        let extended = Frame::new(Id::extended(1), &[0; 8]).unwrap();
        assert_eq!(worst_case_bits(&extended), 160);
    }

    #[test]
    fn the_load_is_that_of_the_last_second() {
        let mut load = Load::new(1_000_000);
        let frame = Frame::standard(0x181, [0; 8]);
        for at in 0..1000 {
            load.on_received(&frame, ms(5000 + at));
        }
        assert!((load.share() - 0.135).abs() < 1e-9, "{}", load.share());
        load.on_sent(&frame, ms(6499));
        assert!((load.share() - 0.0676).abs() < 1e-3, "{}", load.share());
        load.on_sent(&frame, ms(60_000));
        assert!((load.share() - 0.000_135).abs() < 1e-9);
        assert_eq!((load.sent(), load.received()), (2, 1000));
    }

    #[test]
    fn a_clock_that_goes_back_begins_anew() {
        let mut load = Load::new(1_000_000);
        let frame = Frame::standard(0x181, [0; 8]);
        load.on_received(&frame, ms(90_000));
        load.on_received(&frame, ms(0));
        assert!((load.share() - 0.000_135).abs() < 1e-9);
    }
}
