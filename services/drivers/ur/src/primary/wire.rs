//! Packets of the primary and secondary interfaces, without I/O: `i32 size` (of all), `u8 type`, body; big endian.

use std::fmt;

use super::state::RobotState;
use crate::SafetyMode;

/// Bytes before the body: size and type.
pub const HEADER_BYTES: usize = 5;
/// Longest packet taken. States are 1.5 kB; messages carry text of programs.
pub const MAX_PACKET_BYTES: usize = 64 * 1024;

const ROBOT_STATE: u8 = 16;
const ROBOT_MESSAGE: u8 = 20;

/// Bytes that are not the protocol.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// A size field that cannot be, or is more than this crate takes.
    #[error("{of} has size {size}, allowed is 5 to {limit}")]
    Size {
        /// "packet" or "sub-package".
        of: &'static str,
        /// As the size field says.
        size: i32,
        /// Most bytes there can be.
        limit: usize,
    },
    /// A body that ends before its fields do.
    #[error("{of} is too short")]
    Short {
        /// Packet or sub-package.
        of: &'static str,
    },
}

/// What a controller sends.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// Ten times a second.
    State(Box<RobotState>),
    /// Something happened.
    Notice(Stamp, Notice),
    /// A packet this crate does not read: program state, safety setup, Modbus...
    Other {
        /// Type of the packet.
        kind: u8,
        /// Bytes of its body.
        bytes: usize,
    },
}

/// When and where a notice comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// Controller clock, microseconds.
    pub timestamp_us: u64,
    /// Number of the controller's part that speaks.
    pub source: i8,
}

/// What happened.
#[derive(Clone, Debug, PartialEq)]
pub enum Notice {
    /// `textmsg` of a program.
    Text(String),
    /// Name and version of the controller; the first thing a connection brings.
    Version {
        /// "URControl".
        name: String,
        /// Major, minor.
        version: [u8; 2],
        /// Third number.
        bugfix: i32,
        /// Fourth number.
        build: i32,
        /// When it was built.
        date: String,
    },
    /// The safety mode changed.
    SafetyMode {
        /// Code and argument, as C123A4.
        code: i32,
        /// Argument of the code.
        argument: i32,
        /// New mode.
        mode: SafetyMode,
    },
    /// An error, warning or remark of the controller.
    ErrorCode(ErrorCode),
    /// An event with a title, such as the begin and end of a program (`PROGRAM_XXX_STARTED`, `PROGRAM_XXX_STOPPED`).
    Key {
        /// Code of the event.
        code: i32,
        /// Argument of the code.
        argument: i32,
        /// What happened.
        title: String,
        /// To what: the program's name.
        text: String,
    },
    /// A program failed; one that does not compile is told so too.
    RuntimeException {
        /// Line, from 1.
        line: i32,
        /// Column, from 1.
        column: i32,
        /// Why.
        text: String,
    },
    /// A notice this crate does not read: popups, values asked of the operator, labels of a program.
    Other {
        /// Type of the message.
        kind: i8,
        /// Bytes of its body.
        bytes: usize,
    },
}

/// A remark of the controller; UR's manuals list the codes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ErrorCode {
    /// C of "C153A4".
    pub code: i32,
    /// A of "C153A4".
    pub argument: i32,
    /// How grave.
    pub level: Level,
    /// What `data` is.
    pub data_type: u32,
    /// Bits of a value that belongs to the remark.
    pub data: u32,
    /// Mostly empty: the text is found by the code.
    pub text: String,
}

/// How grave a remark is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// 0, and 128 and above, which are meant for the maker.
    Debug,
    /// 1
    Info,
    /// 2
    Warning,
    /// 3: stopped.
    Violation,
    /// 4: off.
    Fault,
    /// 5
    Critical,
    /// Not known, so as grave as can be.
    Unknown(i32),
}

impl Level {
    /// From the number on the wire.
    pub fn from_code(code: i32) -> Self {
        match code {
            0 | 128.. => Self::Debug,
            1 => Self::Info,
            2 => Self::Warning,
            3 => Self::Violation,
            4 => Self::Fault,
            5 => Self::Critical,
            other => Self::Unknown(other),
        }
    }
}

impl fmt::Display for ErrorCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "C{}A{}", self.code, self.argument)?;
        if !self.text.is_empty() {
            write!(f, " {}", self.text)?;
        }
        Ok(())
    }
}

/// One packet cut from a stream of bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet<'a> {
    /// Type byte.
    pub kind: u8,
    /// Bytes after the header.
    pub body: &'a [u8],
}

impl<'a> Packet<'a> {
    /// The first packet of `bytes`, or `None` while it is incomplete.
    ///
    /// # Errors
    /// A size that cannot be, or more than [`MAX_PACKET_BYTES`].
    pub fn first(bytes: &'a [u8]) -> Result<Option<Self>, Error> {
        cut(bytes, "packet", MAX_PACKET_BYTES)
    }

    /// Bytes of the whole packet.
    pub fn size(&self) -> usize {
        HEADER_BYTES + self.body.len()
    }
}

/// Cuts what has a size and a type off the front: packets and sub-packages alike.
pub(super) fn cut<'a>(
    bytes: &'a [u8],
    of: &'static str,
    limit: usize,
) -> Result<Option<Packet<'a>>, Error> {
    let [a, b, c, d, rest @ ..] = bytes else {
        return Ok(None);
    };
    let size = i32::from_be_bytes([*a, *b, *c, *d]);
    let whole = usize::try_from(size)
        .ok()
        .filter(|size| (HEADER_BYTES..=limit).contains(size))
        .ok_or(Error::Size { of, size, limit })?;
    // The size counts its own 4 bytes.
    let packet = rest.get(..whole - 4).and_then(<[u8]>::split_first);
    Ok(packet.map(|(kind, body)| Packet { kind: *kind, body }))
}

impl Message {
    /// Reads a packet. What newer software adds behind the known fields is passed over.
    ///
    /// # Errors
    /// A body that is shorter than its fields, sub-packages that do not fit their packet.
    pub fn decode(packet: Packet<'_>) -> Result<Self, Error> {
        match packet.kind {
            ROBOT_STATE => Ok(Self::State(Box::new(RobotState::decode(packet.body)?))),
            ROBOT_MESSAGE => {
                let mut body = Body::of("robot message", packet.body);
                let stamp = Stamp {
                    timestamp_us: body.u64()?,
                    source: body.i8()?,
                };
                Ok(Self::Notice(stamp, Notice::decode(&mut body)?))
            }
            kind => Ok(Self::Other {
                kind,
                bytes: packet.body.len(),
            }),
        }
    }
}

impl Notice {
    fn decode(body: &mut Body<'_>) -> Result<Self, Error> {
        let kind = body.i8()?;
        Ok(match kind {
            0 => Self::Text(body.text()),
            3 => Self::Version {
                name: body.short_text()?,
                version: [body.u8()?, body.u8()?],
                bugfix: body.i32()?,
                build: body.i32()?,
                date: body.text(),
            },
            5 => Self::SafetyMode {
                code: body.i32()?,
                argument: body.i32()?,
                mode: SafetyMode::from_code(i32::from(body.u8()?)),
            },
            6 => Self::ErrorCode(ErrorCode {
                code: body.i32()?,
                argument: body.i32()?,
                level: Level::from_code(body.i32()?),
                data_type: body.u32()?,
                data: body.u32()?,
                text: body.text(),
            }),
            7 => Self::Key {
                code: body.i32()?,
                argument: body.i32()?,
                title: body.short_text()?,
                text: body.text(),
            },
            10 => Self::RuntimeException {
                line: body.i32()?,
                column: body.i32()?,
                text: body.text(),
            },
            kind => Self::Other {
                kind,
                bytes: body.bytes.len(),
            },
        })
    }
}

/// The part of a body that is not read yet.
pub(super) struct Body<'a> {
    of: &'static str,
    bytes: &'a [u8],
}

impl<'a> Body<'a> {
    pub(super) fn of(of: &'static str, bytes: &'a [u8]) -> Self {
        Self { of, bytes }
    }

    /// Bytes left.
    pub(super) fn left(&self) -> usize {
        self.bytes.len()
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Error> {
        let (head, rest) = self
            .bytes
            .split_first_chunk()
            .ok_or(Error::Short { of: self.of })?;
        self.bytes = rest;
        Ok(*head)
    }

    pub(super) fn skip<const N: usize>(&mut self) -> Result<(), Error> {
        self.array::<N>().map(drop)
    }

    pub(super) fn u8(&mut self) -> Result<u8, Error> {
        self.array().map(u8::from_be_bytes)
    }

    pub(super) fn i8(&mut self) -> Result<i8, Error> {
        self.array().map(i8::from_be_bytes)
    }

    pub(super) fn flag(&mut self) -> Result<bool, Error> {
        self.u8().map(|byte| byte != 0)
    }

    pub(super) fn u32(&mut self) -> Result<u32, Error> {
        self.array().map(u32::from_be_bytes)
    }

    pub(super) fn i32(&mut self) -> Result<i32, Error> {
        self.array().map(i32::from_be_bytes)
    }

    pub(super) fn u64(&mut self) -> Result<u64, Error> {
        self.array().map(u64::from_be_bytes)
    }

    pub(super) fn f32(&mut self) -> Result<f32, Error> {
        self.array().map(f32::from_be_bytes)
    }

    pub(super) fn f64(&mut self) -> Result<f64, Error> {
        self.array().map(f64::from_be_bytes)
    }

    pub(super) fn f64s<const N: usize>(&mut self) -> Result<[f64; N], Error> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    pub(super) fn u32s<const N: usize>(&mut self) -> Result<[u32; N], Error> {
        let mut values = [0; N];
        for value in &mut values {
            *value = self.u32()?;
        }
        Ok(values)
    }

    /// All that is left; its encoding is not documented.
    fn text(&mut self) -> String {
        String::from_utf8_lossy(std::mem::take(&mut self.bytes)).into_owned()
    }

    fn short_text(&mut self) -> Result<String, Error> {
        let length = usize::from(self.u8()?);
        let (text, rest) = self
            .bytes
            .split_at_checked(length)
            .ok_or(Error::Short { of: self.of })?;
        self.bytes = rest;
        Ok(String::from_utf8_lossy(text).into_owned())
    }
}

#[cfg(test)]
mod tests;
