//! The asking side of SDO: one transfer as a value that is fed with responses and says what to send next.

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
}

/// What follows a response.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Step {
    /// Send this and wait for the next response.
    Send([u8; 8]),
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

    /// What to send when the transfer is given up.
    pub fn abort(&self, code: AbortCode) -> [u8; 8] {
        Request::Abort(self.address, code).encode()
    }

    /// Takes a response of the drive.
    pub fn on_response(&mut self, response: [u8; 8]) -> Result<Step, Failure> {
        let own = |address: Address| address == self.address;
        match (&mut self.stage, Response::decode(response)) {
            // An abort of a transfer that was lost track of names no object.
            (_, Response::Abort(address, code))
                if own(address) || address == Address::new(0, 0) =>
            {
                Err(Failure::Aborted(code))
            }
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
