//! The RTDE protocol without I/O, for both directions: a client encodes [`Request`] and decodes [`Reply`], a controller
//! the other way round. Big endian; a frame is `u16 size` (header included), `u8 type`, payload.

mod value;

pub use value::{Type, Value, take, take_values};

/// Bytes before the payload: size and type.
pub const HEADER_BYTES: usize = 3;
/// The size field is 16 bit wide, so no frame is longer.
pub const MAX_FRAME_BYTES: usize = u16::MAX as usize;
/// Longest list of names in one setup request (RTDE guide).
pub const MAX_NAMES_BYTES: usize = 2048;

/// Version of the protocol. A connection starts with 1 until 2 was asked for and accepted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Version {
    /// Without recipe ids in data packages and without an output frequency.
    #[default]
    V1,
    /// Since 3.4 / 5.0.
    V2,
}

/// What a client sends.
#[derive(Clone, Debug, PartialEq)]
pub enum Request {
    /// `V`: wants this version.
    ProtocolVersion(u16),
    /// `v`: asks for the version of the controller.
    ControllerVersion,
    /// `M`: a line for the log.
    Text(Text),
    /// `O`: output recipe.
    SetupOutputs {
        /// Packages per second; `None` in version 1, which sends every cycle of 125 Hz.
        frequency_hz: Option<f64>,
        /// Fields in order.
        names: Vec<String>,
    },
    /// `I`: input recipe.
    SetupInputs {
        /// Fields in order.
        names: Vec<String>,
    },
    /// `S`: begin to send outputs.
    Start,
    /// `P`: cease to send outputs.
    Pause,
    /// `U`: input values; the fields follow the recipe and are decoded with [`take_values`].
    Data {
        /// Input recipe.
        recipe: u8,
        /// Encoded fields.
        fields: Vec<u8>,
    },
}

/// What a controller sends.
#[derive(Clone, Debug, PartialEq)]
pub enum Reply {
    /// `V`
    ProtocolVersion {
        /// The version is now in use.
        accepted: bool,
    },
    /// `v`: major, minor, bugfix, build.
    ControllerVersion([u32; 4]),
    /// `M`
    Text(Text),
    /// `O`
    SetupOutputs {
        /// 1, or 0 when the recipe is refused; `None` in version 1.
        recipe: Option<u8>,
        /// One for each name.
        types: Vec<Type>,
    },
    /// `I`
    SetupInputs {
        /// 1, 2, 3... in order of setup, or 0 when the recipe is refused.
        recipe: u8,
        /// One for each name.
        types: Vec<Type>,
    },
    /// `S`
    Start {
        /// Outputs flow from now on.
        accepted: bool,
    },
    /// `P`
    Pause {
        /// No outputs from now on.
        accepted: bool,
    },
    /// `U`: output values.
    Data {
        /// Output recipe; `None` in version 1.
        recipe: Option<u8>,
        /// Encoded fields.
        fields: Vec<u8>,
    },
}

/// A line for the log or from it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Text {
    /// Text; the protocol carries at most 255 bytes.
    pub message: String,
    /// Who says it; at most 255 bytes.
    pub source: String,
    /// 0 exception, 1 error, 2 warning, 3 info.
    pub level: u8,
}

/// Bytes that are not RTDE.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// The size field is smaller than the header.
    #[error("frame size {0} is smaller than its header of 3 bytes")]
    Size(usize),
    /// A type this direction does not have.
    #[error("unknown package type {0}")]
    PackageType(u8),
    /// The payload ends before its fields do.
    #[error("payload of package type {0} is too short")]
    Short(u8),
    /// The payload goes on after its fields.
    #[error("payload of package type {0} has {1} bytes too many")]
    Long(u8, usize),
    /// Names or types that are not text.
    #[error("package type {0} holds text that is not utf-8")]
    Text(u8),
    /// A name list over the limit of the guide.
    #[error("list of names has {0} bytes, limit is 2048")]
    Names(usize),
    /// A type word nobody knows.
    #[error("unknown field type {0}")]
    FieldType(String),
}

const PROTOCOL_VERSION: u8 = b'V';
const CONTROLLER_VERSION: u8 = b'v';
const TEXT: u8 = b'M';
const DATA: u8 = b'U';
const SETUP_OUTPUTS: u8 = b'O';
const SETUP_INPUTS: u8 = b'I';
const START: u8 = b'S';
const PAUSE: u8 = b'P';

/// One frame cut from a stream of bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// Type byte.
    pub kind: u8,
    /// Bytes after the header.
    pub payload: &'a [u8],
}

impl<'a> Frame<'a> {
    /// The first frame of `bytes`, or `None` while it is incomplete.
    ///
    /// # Errors
    /// A size field that cannot be.
    pub fn first(bytes: &'a [u8]) -> Result<Option<Self>, Error> {
        let [high, low, kind, rest @ ..] = bytes else {
            return Ok(None);
        };
        let size = usize::from(u16::from_be_bytes([*high, *low]));
        let Some(payload_bytes) = size.checked_sub(HEADER_BYTES) else {
            return Err(Error::Size(size));
        };
        Ok(rest.get(..payload_bytes).map(|payload| Self {
            kind: *kind,
            payload,
        }))
    }

    /// Bytes of the whole frame.
    pub fn size(&self) -> usize {
        HEADER_BYTES + self.payload.len()
    }

    /// A data package, which is what flows each cycle.
    pub fn is_data(&self) -> bool {
        self.kind == DATA
    }
}

impl Request {
    /// Appends the frame. Nothing is appended when the payload does not fit a frame.
    pub fn encode(&self, version: Version, out: &mut Vec<u8>) {
        match self {
            Self::ProtocolVersion(wanted) => frame(out, PROTOCOL_VERSION, |out| {
                out.extend(wanted.to_be_bytes())
            }),
            Self::ControllerVersion => frame(out, CONTROLLER_VERSION, |_| {}),
            Self::Text(text) => frame(out, TEXT, |out| text.encode(version, out)),
            Self::SetupOutputs {
                frequency_hz,
                names,
            } => frame(out, SETUP_OUTPUTS, |out| {
                out.extend(frequency_hz.iter().flat_map(|hz| hz.to_be_bytes()));
                out.extend(names.join(",").as_bytes());
            }),
            Self::SetupInputs { names } => frame(out, SETUP_INPUTS, |out| {
                out.extend(names.join(",").as_bytes())
            }),
            Self::Start => frame(out, START, |_| {}),
            Self::Pause => frame(out, PAUSE, |_| {}),
            Self::Data { recipe, fields } => {
                data_frame(out, Some(*recipe), |out| out.extend(fields))
            }
        }
    }

    /// Decodes what a client sent.
    ///
    /// # Errors
    /// Any payload that is not the protocol.
    pub fn decode(frame: Frame<'_>, version: Version) -> Result<Self, Error> {
        let mut rest = Payload {
            kind: frame.kind,
            bytes: frame.payload,
        };
        let request = match frame.kind {
            PROTOCOL_VERSION => Self::ProtocolVersion(u16::from_be_bytes(rest.array()?)),
            CONTROLLER_VERSION => Self::ControllerVersion,
            TEXT => Self::Text(Text::decode(version, &mut rest)?),
            SETUP_OUTPUTS => {
                let frequency_hz = match version {
                    Version::V1 => None,
                    Version::V2 => Some(f64::from_be_bytes(rest.array()?)),
                };
                Self::SetupOutputs {
                    frequency_hz,
                    names: rest.names()?,
                }
            }
            SETUP_INPUTS => Self::SetupInputs {
                names: rest.names()?,
            },
            START => Self::Start,
            PAUSE => Self::Pause,
            DATA => Self::Data {
                recipe: rest.u8()?,
                fields: rest.all().to_vec(),
            },
            other => return Err(Error::PackageType(other)),
        };
        rest.end()?;
        Ok(request)
    }
}

impl Reply {
    /// Appends the frame. Nothing is appended when the payload does not fit a frame.
    pub fn encode(&self, version: Version, out: &mut Vec<u8>) {
        match self {
            Self::ProtocolVersion { accepted } => {
                frame(out, PROTOCOL_VERSION, |out| out.push(u8::from(*accepted)))
            }
            Self::ControllerVersion(parts) => {
                frame(out, CONTROLLER_VERSION, |out| {
                    out.extend(parts.iter().flat_map(|part| part.to_be_bytes()))
                });
            }
            Self::Text(text) => frame(out, TEXT, |out| text.encode(version, out)),
            Self::SetupOutputs { recipe, types } => frame(out, SETUP_OUTPUTS, |out| {
                out.extend(recipe);
                out.extend(type_list(types).as_bytes());
            }),
            Self::SetupInputs { recipe, types } => frame(out, SETUP_INPUTS, |out| {
                out.push(*recipe);
                out.extend(type_list(types).as_bytes());
            }),
            Self::Start { accepted } => frame(out, START, |out| out.push(u8::from(*accepted))),
            Self::Pause { accepted } => frame(out, PAUSE, |out| out.push(u8::from(*accepted))),
            Self::Data { recipe, fields } => data_frame(out, *recipe, |out| out.extend(fields)),
        }
    }

    /// Decodes what a controller sent.
    ///
    /// # Errors
    /// Any payload that is not the protocol.
    pub fn decode(frame: Frame<'_>, version: Version) -> Result<Self, Error> {
        let mut rest = Payload {
            kind: frame.kind,
            bytes: frame.payload,
        };
        let reply = match frame.kind {
            PROTOCOL_VERSION => Self::ProtocolVersion {
                accepted: rest.u8()? != 0,
            },
            CONTROLLER_VERSION => {
                let mut parts = [0; 4];
                for part in &mut parts {
                    *part = u32::from_be_bytes(rest.array()?);
                }
                Self::ControllerVersion(parts)
            }
            TEXT => Self::Text(Text::decode(version, &mut rest)?),
            SETUP_OUTPUTS => Self::SetupOutputs {
                recipe: rest.recipe(version)?,
                types: rest.types()?,
            },
            SETUP_INPUTS => Self::SetupInputs {
                recipe: rest.u8()?,
                types: rest.types()?,
            },
            START => Self::Start {
                accepted: rest.u8()? != 0,
            },
            PAUSE => Self::Pause {
                accepted: rest.u8()? != 0,
            },
            DATA => Self::Data {
                recipe: rest.recipe(version)?,
                fields: rest.all().to_vec(),
            },
            other => return Err(Error::PackageType(other)),
        };
        rest.end()?;
        Ok(reply)
    }
}

impl Text {
    fn encode(&self, version: Version, out: &mut Vec<u8>) {
        match version {
            Version::V1 => {
                out.push(self.level);
                out.extend(short(&self.message).as_bytes());
            }
            Version::V2 => {
                for part in [short(&self.message), short(&self.source)] {
                    out.push(part.len() as u8);
                    out.extend(part.as_bytes());
                }
                out.push(self.level);
            }
        }
    }

    fn decode(version: Version, rest: &mut Payload<'_>) -> Result<Self, Error> {
        match version {
            Version::V1 => Ok(Self {
                level: rest.u8()?,
                message: lossy(rest.all()),
                source: String::new(),
            }),
            Version::V2 => Ok(Self {
                message: rest.short_text()?,
                source: rest.short_text()?,
                level: rest.u8()?,
            }),
        }
    }
}

/// Appends one data package whose fields `write` appends; saves the detour over a value when it happens every cycle.
pub fn data_frame(out: &mut Vec<u8>, recipe: Option<u8>, write: impl FnOnce(&mut Vec<u8>)) {
    frame(out, DATA, |out| {
        out.extend(recipe);
        write(out);
    });
}

/// The longest head of `text` that a length byte can count.
fn short(text: &str) -> &str {
    let mut end = text.len().min(usize::from(u8::MAX));
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    &text[..end]
}

fn type_list(types: &[Type]) -> String {
    types
        .iter()
        .map(|kind| kind.word())
        .collect::<Vec<_>>()
        .join(",")
}

fn frame(out: &mut Vec<u8>, kind: u8, write: impl FnOnce(&mut Vec<u8>)) {
    let start = out.len();
    out.extend([0, 0, kind]);
    write(out);
    match u16::try_from(out.len() - start) {
        Ok(size) => out[start..start + 2].copy_from_slice(&size.to_be_bytes()),
        Err(_) => out.truncate(start),
    }
}

/// The part of a payload that is not read yet.
struct Payload<'a> {
    kind: u8,
    bytes: &'a [u8],
}

impl<'a> Payload<'a> {
    fn array<const N: usize>(&mut self) -> Result<[u8; N], Error> {
        take(&mut self.bytes).ok_or(Error::Short(self.kind))
    }

    fn u8(&mut self) -> Result<u8, Error> {
        self.array().map(|[byte]| byte)
    }

    fn recipe(&mut self, version: Version) -> Result<Option<u8>, Error> {
        match version {
            Version::V1 => Ok(None),
            Version::V2 => self.u8().map(Some),
        }
    }

    fn all(&mut self) -> &'a [u8] {
        std::mem::take(&mut self.bytes)
    }

    fn text(&mut self) -> Result<&'a str, Error> {
        std::str::from_utf8(self.all()).map_err(|_| Error::Text(self.kind))
    }

    fn short_text(&mut self) -> Result<String, Error> {
        let length = usize::from(self.u8()?);
        let (text, rest) = self
            .bytes
            .split_at_checked(length)
            .ok_or(Error::Short(self.kind))?;
        self.bytes = rest;
        Ok(lossy(text))
    }

    /// Names between commas; some clients end the list with a comma, so empty names are skipped.
    fn names(&mut self) -> Result<Vec<String>, Error> {
        if self.bytes.len() > MAX_NAMES_BYTES {
            return Err(Error::Names(self.bytes.len()));
        }
        Ok(words(self.text()?).map(str::to_owned).collect())
    }

    fn types(&mut self) -> Result<Vec<Type>, Error> {
        words(self.text()?)
            .map(|word| Type::from_word(word).ok_or_else(|| Error::FieldType(word.to_owned())))
            .collect()
    }

    fn end(&self) -> Result<(), Error> {
        if self.bytes.is_empty() {
            Ok(())
        } else {
            Err(Error::Long(self.kind, self.bytes.len()))
        }
    }
}

/// A line for the log is not worth a connection, whatever its encoding.
fn lossy(text: &[u8]) -> String {
    String::from_utf8_lossy(text).into_owned()
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(',')
        .map(str::trim)
        .filter(|word| !word.is_empty())
}

#[cfg(test)]
mod tests;
