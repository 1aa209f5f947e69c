//! Block transfer (CiA 301, 7.2.4.3.9 to 7.2.4.3.17): up to 127 segments of seven bytes for one confirmation, and a
//! checksum over all. For objects of some size, such as data recordings.

use super::{Failure, Step, Transfer};
use crate::canopen::object::Address;
use crate::canopen::sdo::{AbortCode, with_address};

/// Bytes of a segment.
const SEGMENT_LEN: usize = 7;
/// Segments of a block that the client takes, the most that the protocol has.
const BLOCK_LEN: u8 = 127;
/// A block that brings nothing new is asked for again this many times.
const MAX_REPEATS: u8 = 3;

// Command specifiers of the client, and what the server's first byte must be.
const UPLOAD: u8 = 0xA0;
const UPLOAD_START: u8 = 0xA3;
const UPLOAD_BLOCK_TAKEN: u8 = 0xA2;
const UPLOAD_ENDED: u8 = 0xA1;
const DOWNLOAD: u8 = 0xC0;
const DOWNLOAD_END: u8 = 0xC1;
const SERVER_UPLOAD: u8 = 0xC0;
const SERVER_UPLOAD_END: u8 = 0xC1;
const SERVER_DOWNLOAD: u8 = 0xA0;
const SERVER_BLOCK_TAKEN: u8 = 0xA2;
const SERVER_DOWNLOAD_ENDED: u8 = 0xA1;
const CS_MASK: u8 = 0xE0;
/// In an initiate service: a checksum is spoken, the size is said.
const CHECKSUM: u8 = 0x04;
const SIZED: u8 = 0x02;
/// In a segment: nothing follows.
const LAST: u8 = 0x80;

/// A block transfer under way.
#[derive(Debug)]
pub(super) enum Block {
    UploadBegun,
    Uploading(Uploading),
    DownloadBegun(Vec<u8>),
    Downloading(Downloading),
}

#[derive(Debug, Default)]
pub(super) struct Uploading {
    data: Vec<u8>,
    size: Option<u32>,
    checksum: bool,
    /// The last segment of this block that came in order.
    taken: u8,
    complete: bool,
    repeats: u8,
}

#[derive(Debug)]
pub(super) struct Downloading {
    data: Vec<u8>,
    checksum: bool,
    /// Bytes that the server has.
    confirmed: usize,
    /// Segments under way.
    sent: u8,
    ending: bool,
    repeats: u8,
}

pub(super) fn begin_upload(address: Address) -> [u8; 8] {
    with_address(UPLOAD | CHECKSUM, address, [BLOCK_LEN, 0, 0, 0])
}

pub(super) fn begin_download(address: Address, data: &[u8]) -> [u8; 8] {
    let size = u32::try_from(data.len()).unwrap_or(u32::MAX);
    with_address(DOWNLOAD | CHECKSUM | SIZED, address, size.to_le_bytes())
}

/// Takes a response of the server that is no abort and no answer of another service.
pub(super) fn on_response(
    block: &mut Block,
    address: Address,
    response: [u8; 8],
) -> Result<Step, Failure> {
    let names_own = response[1..4] == with_address(0, address, [0; 4])[1..4];
    match block {
        Block::UploadBegun if response[0] & CS_MASK == SERVER_UPLOAD && names_own => {
            let [command, _, _, _, a, b, c, d] = response;
            let size = u32::from_le_bytes([a, b, c, d]);
            let size = (command & SIZED != 0).then_some(size);
            if size.is_some_and(|size| size as usize > Transfer::MAX_UPLOAD_LEN) {
                return Err(Failure::Protocol(AbortCode::OUT_OF_MEMORY));
            }
            *block = Block::Uploading(Uploading {
                size,
                checksum: command & CHECKSUM != 0,
                ..Uploading::default()
            });
            Ok(Step::Send(bare(UPLOAD_START)))
        }
        Block::Uploading(upload) if upload.complete => upload.end(response),
        Block::Uploading(upload) => upload.on_segment(response),
        Block::DownloadBegun(data) if response[0] & CS_MASK == SERVER_DOWNLOAD && names_own => {
            let mut download = Downloading {
                data: std::mem::take(data),
                checksum: response[0] & CHECKSUM != 0,
                confirmed: 0,
                sent: 0,
                ending: false,
                repeats: 0,
            };
            let step = download.next_block(response[4]);
            *block = Block::Downloading(download);
            step
        }
        Block::Downloading(download) => download.on_response(response),
        // A late answer to a transfer that was given up.
        Block::UploadBegun | Block::DownloadBegun(_) => Ok(Step::Ignored),
    }
}

impl Block {
    /// The same transfer in segments, if the drive has refused it at its beginning.
    pub(super) fn without_block(&mut self, address: Address) -> Option<(Transfer, [u8; 8])> {
        match self {
            Self::UploadBegun => Some(Transfer::upload(address)),
            Self::DownloadBegun(data) => Some(Transfer::download(address, data)),
            Self::Uploading(_) | Self::Downloading(_) => None,
        }
    }
}

impl Uploading {
    fn on_segment(&mut self, segment: [u8; 8]) -> Result<Step, Failure> {
        let (sequence, last) = (segment[0] & !LAST, segment[0] & LAST != 0);
        if !(1..=BLOCK_LEN).contains(&sequence) {
            return Err(Failure::Protocol(AbortCode::UNKNOWN_COMMAND));
        }
        if sequence == self.taken + 1 {
            self.taken = sequence;
            self.complete = last;
            self.repeats = 0;
            self.data.extend_from_slice(&segment[1..]);
            // The last segment is filled up; what does not count is cut off at the end.
            if self.data.len() > Transfer::MAX_UPLOAD_LEN + SEGMENT_LEN {
                return Err(Failure::Protocol(AbortCode::OUT_OF_MEMORY));
            }
        }
        if sequence < BLOCK_LEN && !last {
            return Ok(Step::Wait);
        }
        // A segment that was lost is sent again with the next block.
        self.repeats += 1;
        if self.repeats > MAX_REPEATS {
            return Err(Failure::Protocol(AbortCode::TIMED_OUT));
        }
        let taken = std::mem::take(&mut self.taken);
        let mut answer = bare(UPLOAD_BLOCK_TAKEN);
        answer[1..3].copy_from_slice(&[taken, BLOCK_LEN]);
        Ok(Step::Send(answer))
    }

    fn end(&mut self, response: [u8; 8]) -> Result<Step, Failure> {
        if response[0] & 0xE3 != SERVER_UPLOAD_END {
            return Err(Failure::Protocol(AbortCode::UNKNOWN_COMMAND));
        }
        let unused = usize::from(response[0] >> 2 & 7);
        let len = self.data.len().saturating_sub(unused);
        self.data.truncate(len);
        if self.size.is_some_and(|size| size as usize != len) {
            return Err(Failure::Protocol(AbortCode::LENGTH));
        }
        let told = u16::from_le_bytes([response[1], response[2]]);
        if self.checksum && told != checksum(&self.data) {
            return Err(Failure::Protocol(AbortCode::CRC));
        }
        Ok(Step::SendAndDone(
            bare(UPLOAD_ENDED),
            std::mem::take(&mut self.data),
        ))
    }
}

impl Downloading {
    fn on_response(&mut self, response: [u8; 8]) -> Result<Step, Failure> {
        match (self.ending, response[0]) {
            (true, SERVER_DOWNLOAD_ENDED) => Ok(Step::Done(Vec::new())),
            (false, SERVER_BLOCK_TAKEN) => {
                let [_, taken, next_len, ..] = response;
                if taken > self.sent {
                    return Err(Failure::Protocol(AbortCode::GENERAL));
                }
                self.repeats = if taken == 0 { self.repeats + 1 } else { 0 };
                if self.repeats > MAX_REPEATS {
                    return Err(Failure::Protocol(AbortCode::TIMED_OUT));
                }
                let taken = SEGMENT_LEN * usize::from(taken);
                self.confirmed = self.data.len().min(self.confirmed + taken);
                if self.confirmed < self.data.len() || taken == 0 {
                    return self.next_block(next_len);
                }
                self.ending = true;
                Ok(Step::Send(self.end()))
            }
            _ => Err(Failure::Protocol(AbortCode::UNKNOWN_COMMAND)),
        }
    }

    fn next_block(&mut self, len: u8) -> Result<Step, Failure> {
        if !(1..=BLOCK_LEN).contains(&len) {
            return Err(Failure::Protocol(AbortCode::BLOCK_SIZE));
        }
        let rest = &self.data[self.confirmed..];
        // Nothing to write is one empty segment.
        let segments = rest.len().div_ceil(SEGMENT_LEN).max(1);
        let sent = segments.min(usize::from(len));
        self.sent = sent as u8;
        let frames = (1..=sent).map(|sequence| {
            let start = SEGMENT_LEN * (sequence - 1);
            let end = rest.len().min(start + SEGMENT_LEN);
            let mut frame = [0; 8];
            frame[0] = sequence as u8 | if sequence == segments { LAST } else { 0 };
            frame[1..=end - start].copy_from_slice(&rest[start..end]);
            frame
        });
        Ok(Step::SendAll(frames.collect()))
    }

    fn end(&self) -> [u8; 8] {
        let segments = self.data.len().div_ceil(SEGMENT_LEN).max(1);
        let unused = (SEGMENT_LEN * segments - self.data.len()) as u8;
        let mut end = bare(DOWNLOAD_END | unused << 2);
        if self.checksum {
            end[1..3].copy_from_slice(&checksum(&self.data).to_le_bytes());
        }
        end
    }
}

const fn bare(command: u8) -> [u8; 8] {
    [command, 0, 0, 0, 0, 0, 0, 0]
}

/// CRC-16 with polynomial 0x1021 that begins with 0 (CiA 301, 7.2.4.3.16).
fn checksum(data: &[u8]) -> u16 {
    data.iter().fold(0, |crc: u16, byte| {
        (0..8).fold(crc ^ u16::from(*byte) << 8, |crc, _| {
            if crc & 0x8000 == 0 {
                crc << 1
            } else {
                crc << 1 ^ 0x1021
            }
        })
    })
}

#[cfg(test)]
mod tests;
