//! The answering side of SDO over any object dictionary: one transfer at a time, as a drive has one SDO server.

use super::{AbortCode, Initiate, Payload, Request, Response, Segment};
use crate::canopen::object::Address;

/// What the server reads from and writes to. The values are little-endian bytes.
pub trait Dictionary {
    /// The value of an object, or why it cannot be read.
    fn read(&mut self, address: Address) -> Result<Vec<u8>, AbortCode>;

    /// Writes a value, or says why not. With [`Length::Unknown`] the object takes its own size from the front.
    fn write(&mut self, address: Address, data: &[u8], length: Length) -> Result<(), AbortCode>;
}

/// Whether the client said how many bytes it writes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Length {
    /// Exactly those of the slice.
    Given,
    /// Four bytes came, the object's own size counts.
    Unknown,
}

/// The state of the transfer under way.
#[derive(Default, Debug)]
pub struct Server {
    transfer: Transfer,
}

#[derive(Default, Debug)]
enum Transfer {
    #[default]
    Idle,
    Upload {
        address: Address,
        data: Vec<u8>,
        sent: usize,
        toggle: bool,
    },
    Download {
        address: Address,
        data: Vec<u8>,
        size: Option<u32>,
        toggle: bool,
    },
}

impl Server {
    /// The longest segmented write taken, bytes.
    pub const MAX_DOWNLOAD_LEN: usize = 4096;

    /// The answer to a request; `None` to an abort, which has none.
    pub fn answer(
        &mut self,
        request: [u8; 8],
        dictionary: &mut impl Dictionary,
    ) -> Option<[u8; 8]> {
        let transfer = std::mem::take(&mut self.transfer);
        let response = match Request::decode(request) {
            Request::Upload(address) => self.begin_upload(address, dictionary),
            Request::UploadSegment { toggle } => self.upload_segment(transfer, toggle),
            Request::Download(address, initiate) => {
                self.begin_download(address, initiate, dictionary)
            }
            Request::DownloadSegment(segment) => {
                self.download_segment(transfer, segment, dictionary)
            }
            Request::Abort(..) => return None,
            Request::Other(_) => Response::Abort(Address::new(0, 0), AbortCode::UNKNOWN_COMMAND),
        };
        Some(response.encode())
    }

    fn begin_upload(&mut self, address: Address, dictionary: &mut impl Dictionary) -> Response {
        let data = match dictionary.read(address) {
            Ok(data) => data,
            Err(code) => return Response::Abort(address, code),
        };
        let initiate = Initiate::of(&data);
        if let Initiate::Segmented { .. } = initiate {
            self.transfer = Transfer::Upload {
                address,
                data,
                sent: 0,
                toggle: false,
            };
        }
        Response::Upload(address, initiate)
    }

    fn upload_segment(&mut self, transfer: Transfer, asked: bool) -> Response {
        let Transfer::Upload {
            address,
            data,
            sent,
            toggle,
        } = transfer
        else {
            return Response::Abort(Address::new(0, 0), AbortCode::UNKNOWN_COMMAND);
        };
        if asked != toggle {
            return Response::Abort(address, AbortCode::TOGGLE_BIT);
        }
        let end = data.len().min(sent + 7);
        let Some(payload) = Payload::new(&data[sent..end]) else {
            return Response::Abort(address, AbortCode::GENERAL);
        };
        let last = end == data.len();
        if !last {
            self.transfer = Transfer::Upload {
                address,
                data,
                sent: end,
                toggle: !toggle,
            };
        }
        Response::UploadSegment(Segment {
            toggle,
            last,
            payload,
        })
    }

    fn begin_download(
        &mut self,
        address: Address,
        initiate: Initiate,
        dictionary: &mut impl Dictionary,
    ) -> Response {
        let written = match initiate {
            Initiate::Expedited(payload) => {
                dictionary.write(address, payload.as_slice(), Length::Given)
            }
            Initiate::ExpeditedUnsized(data) => dictionary.write(address, &data, Length::Unknown),
            Initiate::Segmented { size }
                if size.is_some_and(|size| size as usize > Self::MAX_DOWNLOAD_LEN) =>
            {
                Err(AbortCode::OUT_OF_MEMORY)
            }
            Initiate::Segmented { size } => {
                self.transfer = Transfer::Download {
                    address,
                    data: Vec::new(),
                    size,
                    toggle: false,
                };
                Ok(())
            }
        };
        written.map_or_else(
            |code| Response::Abort(address, code),
            |()| Response::Download(address),
        )
    }

    fn download_segment(
        &mut self,
        transfer: Transfer,
        segment: Segment,
        dictionary: &mut impl Dictionary,
    ) -> Response {
        let Transfer::Download {
            address,
            mut data,
            size,
            toggle,
        } = transfer
        else {
            return Response::Abort(Address::new(0, 0), AbortCode::UNKNOWN_COMMAND);
        };
        if segment.toggle != toggle {
            return Response::Abort(address, AbortCode::TOGGLE_BIT);
        }
        data.extend_from_slice(segment.payload.as_slice());
        if data.len() > Self::MAX_DOWNLOAD_LEN {
            return Response::Abort(address, AbortCode::OUT_OF_MEMORY);
        }
        if !segment.last {
            self.transfer = Transfer::Download {
                address,
                data,
                size,
                toggle: !toggle,
            };
            return Response::DownloadSegment { toggle };
        }
        if size.is_some_and(|size| size as usize != data.len()) {
            return Response::Abort(address, AbortCode::LENGTH);
        }
        match dictionary.write(address, &data, Length::Given) {
            Ok(()) => Response::DownloadSegment { toggle },
            Err(code) => Response::Abort(address, code),
        }
    }
}
