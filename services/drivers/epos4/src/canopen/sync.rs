//! SYNC, on which nodes send and take process data together (CiA 301, 7.2.5). Without the counter, which the EPOS4 lacks.

use crate::frame::Frame;

/// COB-ID of SYNC.
pub const COB_ID: u16 = 0x080;

/// The frame.
pub const fn encode() -> Frame {
    Frame::standard(COB_ID, [])
}

/// Whether a frame is one.
pub fn is_sync(frame: &Frame) -> bool {
    frame.cob_id() == Some(COB_ID)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sync_has_no_data_and_is_no_emergency() {
        assert!(encode().data().is_empty());
        assert!(is_sync(&encode()));
        assert!(!is_sync(&Frame::standard(0x081, [])));
    }
}
