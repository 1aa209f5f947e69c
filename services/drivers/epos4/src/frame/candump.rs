//! Lines of a CAN log as can-utils write and replay them (`candump -l`, `canplayer`):
//! `(1795366526.766067) can0 601#4041600000000000`.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use super::{Frame, Id, MAX_DATA_LEN, Stamped};

/// A frame of a bus. Written and read as a line of the log, without its end.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Line<Name = String> {
    /// The interface, e.g. `can0`.
    pub interface: Name,
    /// The frame and its time.
    pub stamped: Stamped,
}

/// Why a line cannot be read.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("can log line {line:?}: {problem}")]
pub struct ParseError {
    /// As given, at most its first 200 characters.
    pub line: String,
    /// What is wrong with it.
    pub problem: &'static str,
}

impl<Name: fmt::Display> fmt::Display for Line<Name> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            interface,
            stamped: Stamped { frame, stamp },
        } = self;
        write!(
            f,
            "({:010}.{:06}) {interface} {frame:?}",
            stamp.as_secs(),
            stamp.subsec_micros()
        )
    }
}

impl FromStr for Line {
    type Err = ParseError;

    fn from_str(line: &str) -> Result<Self, ParseError> {
        let bad = |problem| ParseError {
            line: line.chars().take(200).collect(),
            problem,
        };
        let mut words = line.split_ascii_whitespace();
        let stamp = words
            .next()
            .and_then(|word| word.strip_prefix('(')?.strip_suffix(')'))
            .and_then(parse_stamp)
            .ok_or_else(|| bad("a time as (seconds.microseconds) expected"))?;
        let interface = words
            .next()
            .ok_or_else(|| bad("no name of an interface"))?
            .to_owned();
        let frame = words.next().ok_or_else(|| bad("no frame"))?;
        let (id, data) = frame
            .split_once('#')
            .ok_or_else(|| bad("no # in the frame"))?;
        let id = parse_id(id).ok_or_else(|| bad("an identifier of 3 or 8 digits expected"))?;
        let data = data.as_bytes();
        let mut bytes = [0; MAX_DATA_LEN];
        if data.len() % 2 != 0 || data.len() > 2 * MAX_DATA_LEN {
            return Err(bad("0 to 8 bytes of two digits each expected"));
        }
        for (byte, digits) in bytes.iter_mut().zip(data.chunks(2)) {
            *byte =
                hex(digits).ok_or_else(|| bad("0 to 8 bytes of two digits each expected"))? as u8;
        }
        // Newer can-utils append a direction.
        if words.any(|word| !matches!(word, "T" | "R")) {
            return Err(bad("more words than time, interface and frame"));
        }
        let frame = Frame::new(id, &bytes[..data.len() / 2]).ok_or_else(|| bad("data"))?;
        Ok(Self {
            interface,
            stamped: Stamped { frame, stamp },
        })
    }
}

fn parse_stamp(word: &str) -> Option<Duration> {
    let (seconds, micros) = word.split_once('.')?;
    let digits = |word: &str| word.bytes().all(|byte| byte.is_ascii_digit());
    if micros.len() != 6 || !digits(seconds) || !digits(micros) {
        return None;
    }
    let micros: u32 = micros.parse().ok()?;
    Some(Duration::new(seconds.parse().ok()?, micros * 1000))
}

fn parse_id(word: &str) -> Option<Id> {
    let id = hex(word.as_bytes())?;
    match word.len() {
        3 if id <= u32::from(Id::MAX_STANDARD) => Some(Id::Standard(id as u16)),
        8 if id <= Id::MAX_EXTENDED => Some(Id::Extended(id)),
        8 if id & !Id::MAX_EXTENDED == Id::ERROR_FLAG => Some(Id::Error(id & Id::MAX_EXTENDED)),
        _ => None,
    }
}

/// Up to eight digits.
fn hex(word: &[u8]) -> Option<u32> {
    if word.len() > 8 {
        return None;
    }
    word.iter().try_fold(0, |sum, byte| {
        Some(sum << 4 | char::from(*byte).to_digit(16)?)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_those_of_can_utils() {
        for text in [
            "(1795366526.766067) can0 601#4041600000000000",
            "(0000000001.500000) vcan1 080#",
            "(0000000000.000001) can0 00001ABC#FF",
            "(1795366526.766067) can0 20000040#0000000000000000",
        ] {
            let line: Line = text.parse().unwrap();
            assert_eq!(line.to_string(), text);
        }
        let line: Line = "(1795366526.766067)  can0 701#05 R".parse().unwrap();
        assert_eq!(
            line.stamped,
            Stamped {
                frame: Frame::standard(0x701, [5]),
                stamp: Duration::new(1_795_366_526, 766_067_000)
            }
        );
    }

    #[test]
    fn a_bad_line_is_named_with_its_problem() {
        for (text, problem) in [
            ("", "time"),
            ("1.000000 can0 601#", "time"),
            ("(1.5) can0 601#", "time"),
            ("(1.000000)", "interface"),
            ("(1.000000) can0", "no frame"),
            ("(1.000000) can0 601", "no #"),
            ("(1.000000) can0 801#", "identifier"),
            ("(1.000000) can0 FFFFFFFF#", "identifier"),
            ("(1.000000) can0 601#0", "two digits"),
            ("(1.000000) can0 601#R", "two digits"),
            ("(1.000000) can0 601##100", "two digits"),
            ("(1.000000) can0 601#000000000000000000", "two digits"),
            ("(1.000000) can0 601#00 more", "more words"),
        ] {
            let error = text.parse::<Line>().unwrap_err();
            assert!(error.problem.contains(problem), "{error}");
        }
    }

    proptest::proptest! {
        #[test]
        fn no_text_panics(text in "[(]?[0-9.]{0,12}[)]? ?.{0,40}") {
            let _any = text.parse::<Line>();
        }
    }
}
