//! The asking side of SDO: one transfer as a value that is fed with responses and says what to send next.

mod block;

use self::block::Block;
use super::{AbortCode, Initiate, Payload, Request, Response, Segment};
use crate::canopen::object::Address;

/// One read or write under way.
#[derive(Debug)]
pub struct Transfer {
    address: Address,
    stage: Stage,
}

#[derive(Debug)]
enum Stage {
    UploadBegun,
    Uploading {
        data: Vec<u8>,
        size: Option<u32>,
        toggle: bool,
    },
    DownloadBegun {
        data: Vec<u8>,
    },
    Downloading {
        data: Vec<u8>,
        sent: usize,
        toggle: bool,
    },
    Block(Block),
}

/// What follows a response.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Step {
    /// Send this and wait for the next response.
    Send([u8; 8]),
    /// Send all of these, as fast as the bus takes them, and wait for the next response.
    SendAll(Vec<[u8; 8]>),
    /// More of the response follows.
    Wait,
    /// The data of a read; this confirms them to the drive.
    SendAndDone([u8; 8], Vec<u8>),
    /// The transfer is done. Data of a read; empty after a write.
    Done(Vec<u8>),
    /// The response belongs to another transfer: keep waiting.
    Ignored,
}

/// Why a transfer ended without success.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum Failure {
    /// The drive refused.
    #[error("the drive aborted: {0}")]
    Aborted(AbortCode),
    /// The drive broke the protocol; this abort is to be sent to it.
    #[error("the drive broke the sdo protocol: {0}")]
    Protocol(AbortCode),
}

impl Transfer {
    /// The longest object read, bytes.
    pub const MAX_UPLOAD_LEN: usize = 4096;

    /// Reads an object; with what to send first.
    pub fn upload(address: Address) -> (Self, [u8; 8]) {
        (
            Self {
                address,
                stage: Stage::UploadBegun,
            },
            Request::Upload(address).encode(),
        )
    }

    /// Writes an object; with what to send first.
    pub fn download(address: Address, data: &[u8]) -> (Self, [u8; 8]) {
        let first = Request::Download(address, Initiate::of(data)).encode();
        (
            Self {
                address,
                stage: Stage::DownloadBegun {
                    data: data.to_vec(),
                },
            },
            first,
        )
    }

    /// Reads an object by block transfer, or in segments when the drive does not know that; with what to send first.
    pub fn block_upload(address: Address) -> (Self, [u8; 8]) {
        let stage = Stage::Block(Block::UploadBegun);
        (Self { address, stage }, block::begin_upload(address))
    }

    /// Writes an object by block transfer, or in segments when the drive does not know that; with what to send first.
    pub fn block_download(address: Address, data: &[u8]) -> (Self, [u8; 8]) {
        let stage = Stage::Block(Block::DownloadBegun(data.to_vec()));
        (
            Self { address, stage },
            block::begin_download(address, data),
        )
    }

    /// Whether more than one answer may still come when the transfer is given up.
    pub fn is_block(&self) -> bool {
        matches!(self.stage, Stage::Block(_))
    }

    /// What to send when the transfer is given up.
    pub fn abort(&self, code: AbortCode) -> [u8; 8] {
        Request::Abort(self.address, code).encode()
    }

    /// Takes a response of the drive.
    pub fn on_response(&mut self, response: [u8; 8]) -> Result<Step, Failure> {
        let address = self.address;
        let own = |named: Address| named == address;
        match (&mut self.stage, Response::decode(response)) {
            // An abort of a transfer that was lost track of names no object.
            (stage, Response::Abort(named, code)) if own(named) || named == Address::new(0, 0) => {
                if code == AbortCode::UNKNOWN_COMMAND
                    && let Stage::Block(block) = stage
                    && let Some((without_block, first)) = block.without_block(address)
                {
                    *self = without_block;
                    return Ok(Step::Send(first));
                }
                Err(Failure::Aborted(code))
            }
            (Stage::Block(Block::UploadBegun), Response::Upload(named, initiate)) if own(named) => {
                // The drive finds the object too small for blocks.
                Ok(self.upload_begun(initiate))
            }
            (Stage::Block(block), _) => block::on_response(block, address, response),
            (Stage::UploadBegun, Response::Upload(address, initiate)) if own(address) => {
                Ok(self.upload_begun(initiate))
            }
            (Stage::Uploading { data, size, toggle }, Response::UploadSegment(segment)) => {
                upload_segment(data, *size, toggle, segment)
            }
            (Stage::DownloadBegun { data }, Response::Download(address)) if own(address) => {
                if let Initiate::Expedited(_) = Initiate::of(data) {
                    return Ok(Step::Done(Vec::new()));
                }
                let data = std::mem::take(data);
                let (first, sent) = next_segment(&data, 0, false)?;
                self.stage = Stage::Downloading {
                    data,
                    sent,
                    toggle: false,
                };
                Ok(Step::Send(first))
            }
            (
                Stage::Downloading { data, sent, toggle },
                Response::DownloadSegment { toggle: answered },
            ) => {
                if answered != *toggle {
                    return Err(Failure::Protocol(AbortCode::TOGGLE_BIT));
                }
                if *sent == data.len() {
                    return Ok(Step::Done(Vec::new()));
                }
                *toggle = !*toggle;
                let (next, now_sent) = next_segment(data, *sent, *toggle)?;
                *sent = now_sent;
                Ok(Step::Send(next))
            }
            // A late answer to a transfer that was given up.
            _ => Ok(Step::Ignored),
        }
    }

    fn upload_begun(&mut self, initiate: Initiate) -> Step {
        match initiate {
            Initiate::Expedited(payload) => Step::Done(payload.as_slice().to_vec()),
            Initiate::ExpeditedUnsized(data) => Step::Done(data.to_vec()),
            Initiate::Segmented { size } => {
                self.stage = Stage::Uploading {
                    data: Vec::new(),
                    size,
                    toggle: false,
                };
                Step::Send(Request::UploadSegment { toggle: false }.encode())
            }
        }
    }
}

fn upload_segment(
    data: &mut Vec<u8>,
    size: Option<u32>,
    toggle: &mut bool,
    segment: Segment,
) -> Result<Step, Failure> {
    if segment.toggle != *toggle {
        return Err(Failure::Protocol(AbortCode::TOGGLE_BIT));
    }
    data.extend_from_slice(segment.payload.as_slice());
    if data.len() > Transfer::MAX_UPLOAD_LEN {
        return Err(Failure::Protocol(AbortCode::OUT_OF_MEMORY));
    }
    if !segment.last {
        *toggle = !*toggle;
        return Ok(Step::Send(
            Request::UploadSegment { toggle: *toggle }.encode(),
        ));
    }
    if size.is_some_and(|size| size as usize != data.len()) {
        return Err(Failure::Protocol(AbortCode::LENGTH));
    }
    Ok(Step::Done(std::mem::take(data)))
}

fn next_segment(data: &[u8], sent: usize, toggle: bool) -> Result<([u8; 8], usize), Failure> {
    let end = data.len().min(sent + 7);
    let payload = Payload::new(&data[sent..end]).ok_or(Failure::Protocol(AbortCode::GENERAL))?;
    let segment = Segment {
        toggle,
        last: end == data.len(),
        payload,
    };
    Ok((Request::DownloadSegment(segment).encode(), end))
}
