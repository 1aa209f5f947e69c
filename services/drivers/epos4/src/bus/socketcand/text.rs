//! The text of linux-can's `socketcand` in raw mode, both directions, without I/O. A client and a server of the
//! protocol share it.
//!
//! Every message is `< ... >` with single spaces and no newline. The two directions write frames differently:
//! a client sends lower-case unpadded bytes apart (`< send 601 8 40 41 60 0 0 0 0 0 >`), a server answers with
//! upper-case padded bytes together (`< frame 581 1.000000 4B41600037060000 >`). An empty payload leaves two spaces.

use std::fmt;
use std::time::Duration;

use crate::frame::{Frame, Id, MAX_DATA_LEN, Stamped};

/// What a client says.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Request {
    /// Opens a bus of the server by name, e.g. `can0`.
    Open(String),
    /// Asks for every frame of the bus.
    RawMode,
    /// Asks for an [`Reply::Echo`], to see that the server lives.
    Echo,
    /// Puts a frame on the bus.
    Send(Frame),
}

/// What a server says.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Reply {
    /// The greeting of an accepted connection.
    Hi,
    /// The last request was carried out.
    Ok,
    /// Answer to [`Request::Echo`].
    Echo,
    /// A frame that was on the bus. An error frame carries its class bits and no payload.
    Frame(Stamped),
    /// The last request was refused, with the server's words.
    Error(String),
}

/// A message that does not follow the protocol.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum ParseError {
    /// The first word is none of the protocol.
    #[error("unknown socketcand command {0:?}")]
    UnknownCommand(String),
    /// A known message with a wrong part.
    #[error("malformed socketcand message {message:?}: {part}")]
    Malformed {
        /// The message without its brackets.
        message: String,
        /// Which part is wrong.
        part: &'static str,
    },
    /// More bytes without a closing bracket than any message has.
    #[error("socketcand message longer than {} bytes", Splitter::MAX_MESSAGE_LEN)]
    TooLong,
}

// === impl Request ===

impl Request {
    /// Reads the inside of `< ... >`.
    pub fn parse(message: &str) -> Result<Self, ParseError> {
        let mut words = message.split_ascii_whitespace();
        match words.next() {
            Some("open") => match (words.next(), words.next()) {
                (Some(bus), None) => Ok(Self::Open(bus.to_owned())),
                _ => Err(malformed(message, "one bus name expected")),
            },
            Some("rawmode") => Ok(Self::RawMode),
            Some("echo") => Ok(Self::Echo),
            Some("send") => parse_send(message, words).map(Self::Send),
            other => Err(ParseError::UnknownCommand(
                other.unwrap_or_default().to_owned(),
            )),
        }
    }
}

impl fmt::Display for Request {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Open(bus) => write!(f, "< open {bus} >"),
            Self::RawMode => f.write_str("< rawmode >"),
            Self::Echo => f.write_str("< echo >"),
            Self::Send(frame) => {
                write!(f, "< send {} {:X} ", frame.id(), frame.data().len())?;
                for (i, byte) in frame.data().iter().enumerate() {
                    write!(f, "{}{byte:x}", if i == 0 { "" } else { " " })?;
                }
                f.write_str(" >")
            }
        }
    }
}

fn parse_send<'a>(
    message: &str,
    mut words: impl Iterator<Item = &'a str>,
) -> Result<Frame, ParseError> {
    let id = words
        .next()
        .and_then(parse_id)
        .ok_or_else(|| malformed(message, "identifier"))?;
    let len = words
        .next()
        .and_then(|word| usize::from_str_radix(word, 16).ok())
        .filter(|len| *len <= MAX_DATA_LEN)
        .ok_or_else(|| malformed(message, "length 0 to 8 expected"))?;
    let bytes: Option<Vec<u8>> = words
        .take(MAX_DATA_LEN + 1)
        .map(|word| {
            if word.len() <= 2 {
                u8::from_str_radix(word, 16).ok()
            } else {
                None
            }
        })
        .collect();
    let bytes = bytes
        .filter(|bytes| bytes.len() == len)
        .ok_or_else(|| malformed(message, "data bytes"))?;
    Frame::new(id, &bytes).ok_or_else(|| malformed(message, "data bytes"))
}

// === impl Reply ===

impl Reply {
    /// Reads the inside of `< ... >`.
    pub fn parse(message: &str) -> Result<Self, ParseError> {
        let mut words = message.split_ascii_whitespace();
        match words.next() {
            Some("hi") => Ok(Self::Hi),
            Some("ok") => Ok(Self::Ok),
            Some("echo") => Ok(Self::Echo),
            Some("frame") => parse_frame(message, words).map(Self::Frame),
            Some("error") => Ok(parse_error_frame(words).map_or_else(
                || Self::Error(message.trim().trim_start_matches("error").trim().to_owned()),
                Self::Frame,
            )),
            other => Err(ParseError::UnknownCommand(
                other.unwrap_or_default().to_owned(),
            )),
        }
    }
}

impl fmt::Display for Reply {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hi => f.write_str("< hi >"),
            Self::Ok => f.write_str("< ok >"),
            Self::Echo => f.write_str("< echo >"),
            Self::Error(words) => write!(f, "< error {words} >"),
            Self::Frame(Stamped { frame, stamp }) => {
                let (seconds, micros) = (stamp.as_secs(), stamp.subsec_micros());
                if let Id::Error(_) = frame.id() {
                    return write!(f, "< error {} {seconds}.{micros:06} >", frame.id());
                }
                write!(f, "< frame {} {seconds}.{micros:06} ", frame.id())?;
                frame
                    .data()
                    .iter()
                    .try_for_each(|byte| write!(f, "{byte:02X}"))?;
                f.write_str(" >")
            }
        }
    }
}

fn parse_frame<'a>(
    message: &str,
    mut words: impl Iterator<Item = &'a str>,
) -> Result<Stamped, ParseError> {
    let id = words
        .next()
        .and_then(parse_id)
        .ok_or_else(|| malformed(message, "identifier"))?;
    let stamp = words
        .next()
        .and_then(parse_stamp)
        .ok_or_else(|| malformed(message, "time stamp"))?;
    // Some servers put spaces between the bytes.
    let digits: String = words.collect();
    let bytes: Option<Vec<u8>> = digits
        .as_bytes()
        .chunks(2)
        .map(|pair| match pair {
            [high, low] => Some(hex_digit(*high)? << 4 | hex_digit(*low)?),
            _ => None,
        })
        .collect();
    let frame = bytes
        .and_then(|bytes| Frame::new(id, &bytes))
        .ok_or_else(|| malformed(message, "data bytes"))?;
    Ok(Stamped { frame, stamp })
}

/// `error 20000040 12.5` is a report of the controller, `error unknown command` a refusal in words.
fn parse_error_frame<'a>(mut words: impl Iterator<Item = &'a str>) -> Option<Stamped> {
    let class = words.next().and_then(parse_hex)?;
    let stamp = words.next().and_then(parse_stamp)?;
    let frame = Frame::new(Id::Error(class & Id::MAX_EXTENDED), &[])?;
    words.next().is_none().then_some(Stamped { frame, stamp })
}

/// Up to three digits are 11 bits, eight digits are 29.
fn parse_id(word: &str) -> Option<Id> {
    let id = parse_hex(word)?;
    match word.len() {
        1..=3 if id <= u32::from(Id::MAX_STANDARD) => Some(Id::Standard(id as u16)),
        8 if id <= Id::MAX_EXTENDED => Some(Id::Extended(id)),
        _ => None,
    }
}

fn parse_hex(word: &str) -> Option<u32> {
    if word.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        u32::from_str_radix(word, 16).ok()
    } else {
        None
    }
}

fn hex_digit(byte: u8) -> Option<u8> {
    char::from(byte).to_digit(16).map(|digit| digit as u8)
}

/// `seconds.microseconds`, exact to the microsecond.
fn parse_stamp(word: &str) -> Option<Duration> {
    let (seconds, fraction) = word.split_once('.').unwrap_or((word, "0"));
    let all_digits =
        |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    if !all_digits(seconds) || !all_digits(fraction) {
        return None;
    }
    let micros: u32 = fraction
        .bytes()
        .chain(std::iter::repeat(b'0'))
        .take(6)
        .fold(0, |sum, digit| sum * 10 + u32::from(digit - b'0'));
    Some(Duration::new(seconds.parse().ok()?, micros * 1000))
}

fn malformed(message: &str, part: &'static str) -> ParseError {
    ParseError::Malformed {
        message: message.to_owned(),
        part,
    }
}

/// Cuts a byte stream into messages, however the segments fall.
#[derive(Default, Debug)]
pub struct Splitter {
    pending: Vec<u8>,
}

impl Splitter {
    /// The longest message accepted; the protocol's own are below 100 bytes.
    pub const MAX_MESSAGE_LEN: usize = 200;

    /// Appends received bytes and takes out every complete message, without its brackets.
    /// Bytes between messages are ignored.
    pub fn push(&mut self, bytes: &[u8]) -> Result<Vec<String>, ParseError> {
        let mut messages = Vec::new();
        for byte in bytes {
            match (byte, self.pending.is_empty()) {
                (b'<', _) => {
                    self.pending.clear();
                    self.pending.push(b'<');
                }
                (_, true) => {}
                (b'>', false) => {
                    messages.push(
                        String::from_utf8_lossy(&self.pending[1..])
                            .trim()
                            .to_owned(),
                    );
                    self.pending.clear();
                }
                (byte, false) if self.pending.len() < Self::MAX_MESSAGE_LEN => {
                    self.pending.push(*byte)
                }
                _ => return Err(ParseError::TooLong),
            }
        }
        Ok(messages)
    }
}

#[cfg(test)]
mod tests;
