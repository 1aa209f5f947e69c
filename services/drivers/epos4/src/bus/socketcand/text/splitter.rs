//! Messages out of a byte stream.

use super::ParseError;

/// Cuts a byte stream into messages, however the segments fall. Bytes are read into its own buffer, and messages are
/// slices of that.
#[derive(Debug)]
pub struct Splitter {
    buffer: Box<[u8]>,
    begin: usize,
    end: usize,
}

/// Many frames are taken by one read: at 40 bytes each, some 400.
const BUFFER_LEN: usize = 16 * 1024;

impl Default for Splitter {
    fn default() -> Self {
        Self {
            buffer: vec![0; BUFFER_LEN].into(),
            begin: 0,
            end: 0,
        }
    }
}

impl Splitter {
    /// The longest message accepted; the protocol's own are below 100 bytes.
    pub const MAX_MESSAGE_LEN: usize = 200;

    /// Where received bytes are to be put. Never empty once [`Splitter::next_message`] has said that there is no whole
    /// message left.
    pub fn space(&mut self) -> &mut [u8] {
        self.buffer.copy_within(self.begin..self.end, 0);
        self.end -= self.begin;
        self.begin = 0;
        &mut self.buffer[self.end..]
    }

    /// So many bytes were put at the beginning of the space.
    pub fn filled(&mut self, len: usize) {
        self.end = self.buffer.len().min(self.end + len);
    }

    /// The next whole message, without its brackets. Bytes between messages are ignored, and so is a message within
    /// which another begins.
    pub fn next_message(&mut self) -> Result<Option<&[u8]>, ParseError> {
        let mut opened = None;
        for at in self.begin..self.end {
            match (self.buffer[at], opened) {
                (b'<', _) => opened = Some(at),
                (b'>', Some(begin)) => {
                    self.begin = at + 1;
                    return Ok(Some(&self.buffer[begin + 1..at]));
                }
                (_, Some(begin)) if at - begin > Self::MAX_MESSAGE_LEN => {
                    return Err(ParseError::TooLong);
                }
                _ => {}
            }
        }
        self.begin = opened.unwrap_or(self.end);
        Ok(None)
    }
}
