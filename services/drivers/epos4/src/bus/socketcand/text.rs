//! The text of linux-can's `socketcand` in raw mode, both directions, without I/O. A client and a server of the
//! protocol share it.
//!
//! Every message is `< ... >` with single spaces and no newline. The two directions write frames differently:
//! a client sends lower-case unpadded bytes apart (`< send 601 8 40 41 60 0 0 0 0 0 >`), a server answers with
//! upper-case padded bytes together (`< frame 581 1.000000 4B41600037060000 >`). An empty payload leaves two spaces.
//! Reading and writing frames allocates nothing.

mod splitter;

use std::fmt;
use std::io::Write;
use std::time::Duration;

use crate::frame::{Frame, Id, MAX_DATA_LEN, Stamped};

pub use self::splitter::Splitter;

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
    /// A frame that was on the bus. Of an error frame the protocol carries the class bits and no payload.
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
    pub fn parse(message: &[u8]) -> Result<Self, ParseError> {
        let mut words = words(message);
        match words.next() {
            Some(b"send") => parse_send(message, words).map(Self::Send),
            Some(b"open") => match (words.next(), words.next()) {
                (Some(bus), None) => Ok(Self::Open(text(bus))),
                _ => Err(malformed(message, "one bus name expected")),
            },
            Some(b"rawmode") => Ok(Self::RawMode),
            Some(b"echo") => Ok(Self::Echo),
            other => Err(ParseError::UnknownCommand(text(other.unwrap_or_default()))),
        }
    }

    /// Appends the message.
    pub fn write(&self, out: &mut Vec<u8>) {
        match self {
            Self::Open(bus) => append(out, format_args!("< open {bus} >")),
            Self::RawMode => out.extend_from_slice(b"< rawmode >"),
            Self::Echo => out.extend_from_slice(b"< echo >"),
            Self::Send(frame) => write_send(frame, out),
        }
    }
}

impl fmt::Display for Request {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut message = Vec::new();
        self.write(&mut message);
        f.write_str(&text(&message))
    }
}

/// Appends [`Request::Send`]: data unpadded and apart.
pub fn write_send(frame: &Frame, out: &mut Vec<u8>) {
    out.extend_from_slice(b"< send ");
    write_id(frame.id(), out);
    append(out, format_args!(" {:X} ", frame.data().len()));
    for (i, byte) in frame.data().iter().enumerate() {
        if i > 0 {
            out.push(b' ');
        }
        if *byte > 0xF {
            out.push(b"0123456789abcdef"[usize::from(byte >> 4)]);
        }
        out.push(b"0123456789abcdef"[usize::from(byte & 0xF)]);
    }
    out.extend_from_slice(b" >");
}

fn parse_send<'a>(
    message: &[u8],
    mut words: impl Iterator<Item = &'a [u8]>,
) -> Result<Frame, ParseError> {
    let id = words
        .next()
        .and_then(parse_id)
        .ok_or_else(|| malformed(message, "identifier"))?;
    let len = words
        .next()
        .and_then(parse_hex)
        .map(|len| len as usize)
        .filter(|len| *len <= MAX_DATA_LEN)
        .ok_or_else(|| malformed(message, "length 0 to 8 expected"))?;
    let mut data = [0; MAX_DATA_LEN];
    for byte in &mut data[..len] {
        *byte = words
            .next()
            .filter(|word| word.len() <= 2)
            .and_then(parse_hex)
            .ok_or_else(|| malformed(message, "data bytes"))? as u8;
    }
    match words.next() {
        None => Frame::new(id, &data[..len]).ok_or_else(|| malformed(message, "data bytes")),
        Some(_) => Err(malformed(message, "data bytes")),
    }
}

// === impl Reply ===

impl Reply {
    /// Reads the inside of `< ... >`.
    pub fn parse(message: &[u8]) -> Result<Self, ParseError> {
        let mut words = words(message);
        match words.next() {
            Some(b"frame") => parse_frame(message, words).map(Self::Frame),
            Some(b"hi") => Ok(Self::Hi),
            Some(b"ok") => Ok(Self::Ok),
            Some(b"echo") => Ok(Self::Echo),
            Some(b"error") => Ok(parse_error_frame(words).map_or_else(
                || {
                    let all = text(message);
                    Self::Error(all.trim().trim_start_matches("error").trim().to_owned())
                },
                Self::Frame,
            )),
            other => Err(ParseError::UnknownCommand(text(other.unwrap_or_default()))),
        }
    }

    /// Appends the message.
    pub fn write(&self, out: &mut Vec<u8>) {
        match self {
            Self::Hi => out.extend_from_slice(b"< hi >"),
            Self::Ok => out.extend_from_slice(b"< ok >"),
            Self::Echo => out.extend_from_slice(b"< echo >"),
            Self::Error(words) => append(out, format_args!("< error {words} >")),
            Self::Frame(stamped) => write_frame(stamped, out),
        }
    }
}

impl fmt::Display for Reply {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut message = Vec::new();
        self.write(&mut message);
        f.write_str(&text(&message))
    }
}

/// Appends [`Reply::Frame`]: data padded and together. An error frame is written as socketcand writes it, by its class
/// bits alone.
pub fn write_frame(Stamped { frame, stamp }: &Stamped, out: &mut Vec<u8>) {
    let (seconds, micros) = (stamp.as_secs(), stamp.subsec_micros());
    if let Id::Error(class) = frame.id() {
        return append(
            out,
            format_args!("< error {class:03X} {seconds}.{micros:06} >"),
        );
    }
    out.extend_from_slice(b"< frame ");
    write_id(frame.id(), out);
    append(out, format_args!(" {seconds}.{micros:06} "));
    for byte in frame.data() {
        out.push(UPPER_DIGITS[usize::from(byte >> 4)]);
        out.push(UPPER_DIGITS[usize::from(byte & 0xF)]);
    }
    out.extend_from_slice(b" >");
}

fn parse_frame<'a>(
    message: &[u8],
    mut words: impl Iterator<Item = &'a [u8]>,
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
    let frame = parse_packed(words.flatten())
        .and_then(|(data, len)| Frame::new(id, &data[..len]))
        .ok_or_else(|| malformed(message, "data bytes"))?;
    Ok(Stamped { frame, stamp })
}

/// Up to eight bytes of two digits each, and how many there are.
fn parse_packed<'a>(
    mut digits: impl Iterator<Item = &'a u8>,
) -> Option<([u8; MAX_DATA_LEN], usize)> {
    let mut data = [0; MAX_DATA_LEN];
    let mut len = 0;
    while let Some(high) = digits.next() {
        *data.get_mut(len)? = hex_digit(*high)? << 4 | hex_digit(*digits.next()?)?;
        len += 1;
    }
    Some((data, len))
}

/// `error 040 12.5` is a report of the controller, `error unknown command` a refusal in words. The flag that the kernel
/// sets in the identifier of an error frame may be there or not.
fn parse_error_frame<'a>(mut words: impl Iterator<Item = &'a [u8]>) -> Option<Stamped> {
    let class = words.next().and_then(parse_hex)?;
    let stamp = words.next().and_then(parse_stamp)?;
    let frame = Frame::new(Id::Error(class & Id::MAX_EXTENDED), &[])?;
    words.next().is_none().then_some(Stamped { frame, stamp })
}

// Words and numbers

const UPPER_DIGITS: &[u8; 16] = b"0123456789ABCDEF";

fn words(message: &[u8]) -> impl Iterator<Item = &[u8]> {
    message
        .split(u8::is_ascii_whitespace)
        .filter(|word| !word.is_empty())
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn append(out: &mut Vec<u8>, message: fmt::Arguments<'_>) {
    // A vector takes whatever is written to it.
    out.write_fmt(message).ok();
}

/// Three digits for 11 bits, eight for 29.
fn write_id(id: Id, out: &mut Vec<u8>) {
    let (bits, digits) = match id {
        Id::Standard(id) => (u32::from(id), 3),
        Id::Extended(id) => (id, 8),
        // Nobody sends a report: the kernel's flag makes it an identifier that every server refuses.
        Id::Error(class) => (Id::ERROR_FLAG | class, 8),
    };
    for digit in (0..digits).rev() {
        out.push(UPPER_DIGITS[(bits >> (4 * digit) & 0xF) as usize]);
    }
}

/// Up to three digits are 11 bits, eight digits are 29.
fn parse_id(word: &[u8]) -> Option<Id> {
    let id = parse_hex(word)?;
    match word.len() {
        1..=3 if id <= u32::from(Id::MAX_STANDARD) => Some(Id::Standard(id as u16)),
        8 if id <= Id::MAX_EXTENDED => Some(Id::Extended(id)),
        _ => None,
    }
}

/// Up to eight digits.
fn parse_hex(word: &[u8]) -> Option<u32> {
    if !(1..=8).contains(&word.len()) {
        return None;
    }
    word.iter()
        .try_fold(0, |sum, byte| Some(sum << 4 | u32::from(hex_digit(*byte)?)))
}

fn hex_digit(byte: u8) -> Option<u8> {
    char::from(byte).to_digit(16).map(|digit| digit as u8)
}

/// `seconds.microseconds`, exact to the microsecond.
fn parse_stamp(word: &[u8]) -> Option<Duration> {
    let point = word.iter().position(|byte| *byte == b'.');
    let (seconds, fraction) = match point {
        Some(at) => (&word[..at], &word[at + 1..]),
        None => (word, &b"0"[..]),
    };
    if seconds.is_empty() || fraction.is_empty() {
        return None;
    }
    let seconds = seconds.iter().try_fold(0_u64, |sum, byte| {
        sum.checked_mul(10)?.checked_add(decimal_digit(*byte)?)
    })?;
    let mut micros = 0;
    let mut unit = 100_000;
    for byte in fraction {
        micros += decimal_digit(*byte)? as u32 * unit;
        unit /= 10;
    }
    Some(Duration::new(seconds, micros * 1000))
}

fn decimal_digit(byte: u8) -> Option<u64> {
    byte.is_ascii_digit().then(|| u64::from(byte - b'0'))
}

fn malformed(message: &[u8], part: &'static str) -> ParseError {
    ParseError::Malformed {
        message: text(message),
        part,
    }
}

#[cfg(test)]
mod tests;
