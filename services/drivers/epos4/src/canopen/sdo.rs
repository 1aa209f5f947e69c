//! SDO, the confirmed read and write of one object (CiA 301, 7.2.4): the eight bytes of every expedited and segmented
//! service, and on top of them a [`client`] and a [`server`] that do no I/O.
//!
//! Uploads read from the drive, downloads write to it. The client speaks block transfer too, for drives that have it; the
//! server answers it with [`AbortCode::UNKNOWN_COMMAND`], at which a client goes on in segments.

pub mod abort;
pub mod client;
pub mod server;

pub use abort::AbortCode;

use crate::canopen::object::Address;

/// COB-ID of the requests to a node.
pub const fn request_cob_id(node_id: u8) -> u16 {
    0x600 + node_id as u16
}

/// COB-ID of a node's responses.
pub const fn response_cob_id(node_id: u8) -> u16 {
    0x580 + node_id as u16
}

/// The node whose responses have this COB-ID.
pub const fn responding_node(cob_id: u16) -> Option<u8> {
    match cob_id {
        0x581..=0x5FF => Some((cob_id - 0x580) as u8),
        _ => None,
    }
}

/// The node whose requests have this COB-ID.
pub const fn requested_node(cob_id: u16) -> Option<u8> {
    match cob_id {
        0x601..=0x67F => Some((cob_id - 0x600) as u8),
        _ => None,
    }
}

/// What a client asks.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Request {
    /// Begins to read an object.
    Upload(Address),
    /// Asks for the next segment.
    UploadSegment {
        /// Alternates, beginning with false.
        toggle: bool,
    },
    /// Begins to write an object.
    Download(Address, Initiate),
    /// Carries the next segment.
    DownloadSegment(Segment),
    /// Ends the transfer.
    Abort(Address, AbortCode),
    /// A service that is not spoken here, e.g. block transfer.
    Other(u8),
}

/// What a server answers.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Response {
    /// The object, or that it follows in segments.
    Upload(Address, Initiate),
    /// The next segment.
    UploadSegment(Segment),
    /// The write is done, or its segments may come.
    Download(Address),
    /// The segment has arrived.
    DownloadSegment {
        /// As in the request.
        toggle: bool,
    },
    /// Ends the transfer.
    Abort(Address, AbortCode),
    /// A service that is not spoken here.
    Other(u8),
}

/// How a transfer begins.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Initiate {
    /// All the data, 1 to 4 bytes.
    Expedited(Payload<4>),
    /// One to four bytes whose number is not said.
    ExpeditedUnsized([u8; 4]),
    /// The data follow in segments.
    Segmented {
        /// Bytes in total, when said.
        size: Option<u32>,
    },
}

/// Up to seven bytes of a segmented transfer.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Segment {
    /// Alternates, beginning with false.
    pub toggle: bool,
    /// Nothing follows.
    pub last: bool,
    /// The bytes.
    pub payload: Payload<7>,
}

/// Up to `N` bytes in place.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Payload<const N: usize> {
    bytes: [u8; N],
    len: usize,
}

impl<const N: usize> Payload<N> {
    /// The given bytes; `None` when there are more than `N`.
    pub fn new(data: &[u8]) -> Option<Self> {
        let mut bytes = [0; N];
        bytes.get_mut(..data.len())?.copy_from_slice(data);
        Some(Self {
            bytes,
            len: data.len(),
        })
    }

    /// The bytes.
    pub fn as_slice(&self) -> &[u8] {
        &self.bytes[..self.len]
    }
}

// Command specifiers, upper three bits of the first byte.
const CCS_DOWNLOAD_SEGMENT: u8 = 0 << 5;
const CCS_DOWNLOAD: u8 = 1 << 5;
const CCS_UPLOAD: u8 = 2 << 5;
const CCS_UPLOAD_SEGMENT: u8 = 3 << 5;
const SCS_UPLOAD_SEGMENT: u8 = 0 << 5;
const SCS_DOWNLOAD_SEGMENT: u8 = 1 << 5;
const SCS_UPLOAD: u8 = 2 << 5;
const SCS_DOWNLOAD: u8 = 3 << 5;
const CS_ABORT: u8 = 4 << 5;
const CS_MASK: u8 = 0xE0;
// Bits of an initiate service: expedited, size indicated.
const EXPEDITED: u8 = 0x02;
const SIZED: u8 = 0x01;
// Bits of a segment.
const TOGGLE: u8 = 0x10;
const LAST: u8 = 0x01;

// === impl Request ===

impl Request {
    /// The eight bytes on the bus.
    pub fn encode(&self) -> [u8; 8] {
        match self {
            Self::Upload(address) => with_address(CCS_UPLOAD, *address, [0; 4]),
            Self::UploadSegment { toggle } => [
                CCS_UPLOAD_SEGMENT | toggle_bit(*toggle),
                0,
                0,
                0,
                0,
                0,
                0,
                0,
            ],
            Self::Download(address, initiate) => initiate.encode(CCS_DOWNLOAD, *address),
            Self::DownloadSegment(segment) => segment.encode(CCS_DOWNLOAD_SEGMENT),
            Self::Abort(address, code) => with_address(CS_ABORT, *address, code.0.to_le_bytes()),
            Self::Other(command) => [*command, 0, 0, 0, 0, 0, 0, 0],
        }
    }

    /// Reads the eight bytes. Every first byte has a meaning, so it cannot fail.
    pub fn decode(bytes: [u8; 8]) -> Self {
        let command = bytes[0];
        match command & CS_MASK {
            CCS_UPLOAD => Self::Upload(address(bytes)),
            CCS_UPLOAD_SEGMENT => Self::UploadSegment {
                toggle: command & TOGGLE != 0,
            },
            CCS_DOWNLOAD => Self::Download(address(bytes), Initiate::decode(bytes)),
            CCS_DOWNLOAD_SEGMENT => Self::DownloadSegment(Segment::decode(bytes)),
            CS_ABORT => Self::Abort(address(bytes), abort_code(bytes)),
            _ => Self::Other(command),
        }
    }
}

// === impl Response ===

impl Response {
    /// The eight bytes on the bus.
    pub fn encode(&self) -> [u8; 8] {
        match self {
            Self::Upload(address, initiate) => initiate.encode(SCS_UPLOAD, *address),
            Self::UploadSegment(segment) => segment.encode(SCS_UPLOAD_SEGMENT),
            Self::Download(address) => with_address(SCS_DOWNLOAD, *address, [0; 4]),
            Self::DownloadSegment { toggle } => [
                SCS_DOWNLOAD_SEGMENT | toggle_bit(*toggle),
                0,
                0,
                0,
                0,
                0,
                0,
                0,
            ],
            Self::Abort(address, code) => with_address(CS_ABORT, *address, code.0.to_le_bytes()),
            Self::Other(command) => [*command, 0, 0, 0, 0, 0, 0, 0],
        }
    }

    /// Reads the eight bytes. Every first byte has a meaning, so it cannot fail.
    pub fn decode(bytes: [u8; 8]) -> Self {
        let command = bytes[0];
        match command & CS_MASK {
            SCS_UPLOAD => Self::Upload(address(bytes), Initiate::decode(bytes)),
            SCS_UPLOAD_SEGMENT => Self::UploadSegment(Segment::decode(bytes)),
            SCS_DOWNLOAD => Self::Download(address(bytes)),
            SCS_DOWNLOAD_SEGMENT => Self::DownloadSegment {
                toggle: command & TOGGLE != 0,
            },
            CS_ABORT => Self::Abort(address(bytes), abort_code(bytes)),
            _ => Self::Other(command),
        }
    }
}

// === impl Initiate ===

impl Initiate {
    /// Expedited when the data fit in four bytes and there are any, else segmented.
    pub fn of(data: &[u8]) -> Self {
        match Payload::new(data) {
            Some(payload) if !data.is_empty() => Self::Expedited(payload),
            _ => Self::Segmented {
                size: u32::try_from(data.len()).ok(),
            },
        }
    }

    fn encode(&self, specifier: u8, address: Address) -> [u8; 8] {
        match self {
            Self::Expedited(payload) => {
                let unused = 4 - payload.as_slice().len().clamp(1, 4) as u8;
                with_address(
                    specifier | unused << 2 | EXPEDITED | SIZED,
                    address,
                    payload.bytes,
                )
            }
            Self::ExpeditedUnsized(data) => with_address(specifier | EXPEDITED, address, *data),
            Self::Segmented { size: Some(size) } => {
                with_address(specifier | SIZED, address, size.to_le_bytes())
            }
            Self::Segmented { size: None } => with_address(specifier, address, [0; 4]),
        }
    }

    fn decode(bytes: [u8; 8]) -> Self {
        let [command, _, _, _, a, b, c, d] = bytes;
        let data = [a, b, c, d];
        match (command & EXPEDITED != 0, command & SIZED != 0) {
            (true, true) => {
                let len = 4 - usize::from(command >> 2 & 3);
                let mut used = [0; 4];
                used[..len].copy_from_slice(&data[..len]);
                Self::Expedited(Payload { bytes: used, len })
            }
            (true, false) => Self::ExpeditedUnsized(data),
            (false, true) => Self::Segmented {
                size: Some(u32::from_le_bytes(data)),
            },
            (false, false) => Self::Segmented { size: None },
        }
    }
}

// === impl Segment ===

impl Segment {
    fn encode(&self, specifier: u8) -> [u8; 8] {
        let unused = (7 - self.payload.len) as u8;
        let [a, b, c, d, e, f, g] = self.payload.bytes;
        let last = if self.last { LAST } else { 0 };
        [
            specifier | toggle_bit(self.toggle) | unused << 1 | last,
            a,
            b,
            c,
            d,
            e,
            f,
            g,
        ]
    }

    fn decode(bytes: [u8; 8]) -> Self {
        let command = bytes[0];
        let len = 7 - usize::from(command >> 1 & 7);
        let mut used = [0; 7];
        used[..len].copy_from_slice(&bytes[1..=len]);
        Self {
            toggle: command & TOGGLE != 0,
            last: command & LAST != 0,
            payload: Payload { bytes: used, len },
        }
    }
}

fn toggle_bit(toggle: bool) -> u8 {
    if toggle { TOGGLE } else { 0 }
}

fn with_address(command: u8, address: Address, data: [u8; 4]) -> [u8; 8] {
    let [low, high] = address.index.to_le_bytes();
    let [a, b, c, d] = data;
    [command, low, high, address.subindex, a, b, c, d]
}

fn address(bytes: [u8; 8]) -> Address {
    Address::new(u16::from_le_bytes([bytes[1], bytes[2]]), bytes[3])
}

fn abort_code(bytes: [u8; 8]) -> AbortCode {
    AbortCode(u32::from_le_bytes([bytes[4], bytes[5], bytes[6], bytes[7]]))
}

#[cfg(test)]
mod tests;
