//! The text of a file by lines and words, without copying it.
//!
//! Lines end in LF or CR LF, the last one in nothing if need be. What follows a text header is still there as bytes.

use std::borrow::Cow;

use super::scalar::Scalar;
use super::{Error, quoted};

/// The lines of a file that have not been read yet.
pub(crate) struct Lines<'a> {
    rest: &'a [u8],
    number: usize,
}

impl<'a> Lines<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self {
            rest: bytes,
            number: 0,
        }
    }

    /// The bytes after the lines that were read.
    pub(crate) fn rest(&self) -> &'a [u8] {
        self.rest
    }

    /// The next line that is not blank; `what` must not be missing.
    pub(crate) fn expect(&mut self, what: &str) -> Result<Line<'a>, Error> {
        self.find(|line| !line.is_blank())
            .ok_or_else(|| Error::Line {
                line: self.number,
                what: format!("the file ends here, before {what}"),
            })
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = Line<'a>;

    fn next(&mut self) -> Option<Line<'a>> {
        if self.rest.is_empty() {
            return None;
        }
        let end = self.rest.iter().position(|byte| *byte == b'\n');
        let (line, rest) = match end {
            Some(end) => (&self.rest[..end], &self.rest[end + 1..]),
            None => (self.rest, &self.rest[..0]),
        };
        self.rest = rest;
        self.number += 1;
        Some(Line {
            number: self.number,
            rest: line.strip_suffix(b"\r").unwrap_or(line),
        })
    }
}

/// What is left of a line.
pub(crate) struct Line<'a> {
    /// Number of the line, the first is 1.
    pub(crate) number: usize,
    rest: &'a [u8],
}

impl<'a> Line<'a> {
    /// The line before the first.
    pub(crate) const fn empty() -> Self {
        Self {
            number: 0,
            rest: &[],
        }
    }

    pub(crate) fn is_blank(&self) -> bool {
        self.rest.iter().all(u8::is_ascii_whitespace)
    }

    /// What is left as text; bytes that are not UTF-8 become replacement characters.
    pub(crate) fn text(&self) -> Cow<'a, str> {
        String::from_utf8_lossy(self.rest)
    }

    /// The text after `mark` if the line is a comment, which begins with it.
    pub(crate) fn comment(&self, mark: char) -> Option<String> {
        let first = self.rest.trim_ascii_start().first()?;
        let text = (char::from(*first) == mark).then(|| self.text())?;
        text.trim_start().strip_prefix(mark).map(str::to_owned)
    }

    /// Takes all the words.
    pub(crate) fn words(&mut self) -> Vec<&'a str> {
        std::iter::from_fn(|| self.word()).collect()
    }

    /// Takes the next word. A word that is not UTF-8 is a replacement character, which no format knows.
    pub(crate) fn word(&mut self) -> Option<&'a str> {
        let start = self.rest.trim_ascii_start();
        let end = start
            .iter()
            .position(u8::is_ascii_whitespace)
            .unwrap_or(start.len());
        let (word, rest) = start.split_at(end);
        self.rest = rest;
        (!word.is_empty()).then(|| std::str::from_utf8(word).unwrap_or("\u{FFFD}"))
    }

    /// Takes the next word, which must be there; `what` is its name.
    pub(crate) fn expect_word(&mut self, what: &str) -> Result<&'a str, Error> {
        self.word()
            .ok_or_else(|| self.wrong(format!("the line ends before {}", quoted(what))))
    }

    /// Takes the next word as a number of type `scalar`; `what` is its name.
    pub(crate) fn number(&mut self, scalar: Scalar, what: &str) -> Result<f64, Error> {
        let word = self.expect_word(what)?;
        scalar.parse(word).ok_or_else(|| {
            self.wrong(format!(
                "{} is {}, must be a number of type {scalar}",
                quoted(what),
                quoted(word)
            ))
        })
    }

    /// Takes the next word as a count; `what` is its name.
    pub(crate) fn count(&mut self, what: &str) -> Result<usize, Error> {
        let word = self.expect_word(what)?;
        word.parse().map_err(|_| {
            self.wrong(format!(
                "{} is {}, must be a count",
                quoted(what),
                quoted(word)
            ))
        })
    }

    /// Refuses the words that nobody took.
    pub(crate) fn end(&mut self) -> Result<(), Error> {
        match self.word() {
            Some(word) => Err(self.wrong(format!("{} is one word too many", quoted(word)))),
            None => Ok(()),
        }
    }

    /// What is wrong with this line.
    pub(crate) fn wrong(&self, what: String) -> Error {
        Error::Line {
            line: self.number,
            what,
        }
    }
}
