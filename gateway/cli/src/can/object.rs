//! Which object a person means, and which value.

use epos4_link::canopen::object::Address;
use epos4_link::dictionary::{self, Access, Entry, Kind, Legal, entries};
use epos4_link::objects;

use crate::arguments::ObjectKind;
use crate::exit::Failure;

/// How many near names are told.
const NEAR_MAX: usize = 8;
/// Words within so many letters of what was typed count as near.
const TYPING_ERRORS: usize = 2;

/// An object as it was asked for.
#[derive(Clone, Copy, Debug)]
pub struct Asked {
    /// Where it stands.
    pub address: Address,
    /// What the table says of it.
    pub entry: Option<&'static Entry>,
    /// How its bytes are read; `None` when nobody says.
    pub kind: Option<Kind>,
}

impl Asked {
    /// By name, or by index and subindex. An object that the table has not is read as `kind`.
    pub fn parse(text: &str, kind: Option<ObjectKind>) -> Result<Self, Failure> {
        let address = match address(text)? {
            Some(address) => address,
            None => named(text)?.address,
        };
        let entry = dictionary::entry(address);
        Ok(Self {
            address,
            entry,
            kind: entry.map(|entry| entry.kind).or(kind.map(Kind::from)),
        })
    }

    /// Its name, or its address when it has none.
    pub fn name(&self) -> String {
        self.entry.map_or_else(
            || "unknown object".to_owned(),
            |entry| entry.name.to_owned(),
        )
    }

    /// The bytes to write, once the value is found to fit.
    pub fn bytes(&self, text: &str) -> Result<Vec<u8>, Failure> {
        let kind = self.kind.ok_or_else(|| {
            let fault = format!(
                "{} is not in the table of this program; say its type with --type",
                self.address
            );
            Failure::refused("TYPE_UNKNOWN", fault)
        })?;
        let (low, high) = kind.range();
        let value = number(text, self.address).ok_or_else(|| {
            let fault = format!("{text:?} is no whole number; write decimal or 0x hexadecimal");
            Failure::refused("VALUE_INVALID", fault)
        })?;
        let range = |limits: String| {
            let fault = format!("{} {}: {value} is not {limits}", self.address, self.name());
            Failure::refused("VALUE_OUT_OF_RANGE", fault)
        };
        match self.entry {
            Some(entry) if entry.access == Access::ReadOnly => {
                let fault = format!("{} {} is read-only", entry.address, entry.name);
                return Err(Failure::refused("OBJECT_READ_ONLY", fault));
            }
            Some(entry) if !entry.legal.allows(value) => return Err(range(limits(entry))),
            _ if !(low..=high).contains(&value) => {
                return Err(range(format!("{low} to {high}")));
            }
            _ => {}
        }
        Ok(kind.encode(value))
    }
}

/// The legal values in words.
fn limits(entry: &Entry) -> String {
    let unit = match entry.unit {
        "" => String::new(),
        unit => format!(" {unit}"),
    };
    match entry.legal {
        Legal::Between(low, high) => format!("{low} to {high}{unit}"),
        Legal::OneOf(values) => {
            let values: Vec<_> = values.iter().map(ToString::to_string).collect();
            format!("one of {}{unit}", values.join(", "))
        }
    }
}

/// Decimal or hexadecimal, or the word of a signature where one is taken.
fn number(text: &str, address: Address) -> Option<i64> {
    match text {
        "save" if address == objects::STORE_ALL.address => {
            return Some(i64::from(objects::SAVE_SIGNATURE));
        }
        "load" if address == objects::RESTORE_ALL.address => {
            return Some(i64::from(objects::LOAD_SIGNATURE));
        }
        _ => {}
    }
    let (sign, digits) = match text.strip_prefix('-') {
        Some(digits) => (-1, digits),
        None => (1, text),
    };
    let is_plain = digits.starts_with(|first: char| first.is_ascii_digit());
    let value = match digits.strip_prefix("0x").or(digits.strip_prefix("0X")) {
        Some(hex) if hex.starts_with(|first: char| first.is_ascii_hexdigit()) => {
            i64::from_str_radix(hex, 16).ok()?
        }
        None if is_plain => digits.parse().ok()?,
        _ => return None,
    };
    Some(sign * value)
}

/// `6041`, `0x6041`, `3001:02`; `None` when it looks like a name.
fn address(text: &str) -> Result<Option<Address>, Failure> {
    let (index, subindex) = match text.split_once(':') {
        Some((index, subindex)) => (index, Some(subindex)),
        None => (text, None),
    };
    let digits = index.strip_prefix("0x").unwrap_or(index);
    let is_index = digits.len() == 4 && digits.bytes().all(|digit| digit.is_ascii_hexdigit());
    if !is_index && subindex.is_none() && digits == index {
        return Ok(None);
    }
    let parsed = || {
        let index = u16::from_str_radix(digits, 16).ok().filter(|_| is_index)?;
        let subindex = match subindex {
            Some(text) => {
                let digits = text.strip_prefix("0x").unwrap_or(text);
                let is_short = (1..=2).contains(&digits.len());
                u8::from_str_radix(digits, 16).ok().filter(|_| is_short)?
            }
            None => 0,
        };
        Some(Address::new(index, subindex))
    };
    parsed().map(Some).ok_or_else(|| {
        let fault = format!(
            "{text:?} is no object: write four hexadecimal digits, and a subindex as in 3001:02"
        );
        Failure::refused("OBJECT_INVALID", fault)
    })
}

/// The one object of this name.
fn named(text: &str) -> Result<&'static Entry, Failure> {
    let wanted = normal(text);
    let exact: Vec<_> = entries()
        .iter()
        .filter(|entry| entry.name == wanted)
        .collect();
    match exact.as_slice() {
        [entry] => Ok(entry),
        [] => {
            let near = near(&wanted);
            let hint = if near.is_empty() {
                "write its index, such as 6041".to_owned()
            } else {
                format!("near are {}", listed(&near))
            };
            let fault = format!("no object is called {text:?}; {hint}");
            Err(Failure::refused("OBJECT_UNKNOWN", fault))
        }
        several => {
            let fault = format!("{text:?} are {}; write the index", listed(several));
            Err(Failure::refused("OBJECT_AMBIGUOUS", fault))
        }
    }
}

fn normal(text: &str) -> String {
    let spaced = text.to_lowercase().replace(['_', '-'], " ");
    // Names with a dash of their own, such as cob-id, are looked for as they are written too.
    let as_is = text.to_lowercase();
    if entries().iter().any(|entry| entry.name == as_is) {
        return as_is;
    }
    spaced.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Objects whose name has all the words. Nearest first.
fn near(wanted: &str) -> Vec<&'static Entry> {
    let words: Vec<&str> = wanted.split(' ').filter(|word| !word.is_empty()).collect();
    if words.is_empty() {
        return Vec::new();
    }
    let mut near: Vec<(usize, &Entry)> = entries()
        .iter()
        .filter(|entry| words.iter().all(|word| has_word(entry.name, word)))
        .map(|entry| (distance(wanted, entry.name), entry))
        .collect();
    near.sort_by_key(|(distance, entry)| (*distance, entry.address));
    near.into_iter().map(|(_, entry)| entry).collect()
}

/// Whether a name has the word, or one that is almost spelt so.
fn has_word(name: &str, word: &str) -> bool {
    let is_near = |part| word.len() > TYPING_ERRORS && distance(part, word) <= TYPING_ERRORS;
    name.contains(word) || name.split(' ').any(is_near)
}

fn listed(entries: &[&Entry]) -> String {
    let mut words: Vec<String> = entries
        .iter()
        .take(NEAR_MAX)
        .map(|entry| format!("{} {}", entry.address, entry.name))
        .collect();
    if entries.len() > NEAR_MAX {
        words.push(format!("and {} more", entries.len() - NEAR_MAX));
    }
    words.join(", ")
}

/// Letters to insert, leave out or change (Levenshtein).
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, letter) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, other) in b.iter().enumerate() {
            let changed = diagonal + usize::from(letter != *other);
            diagonal = row[j + 1];
            row[j + 1] = changed.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

impl From<ObjectKind> for Kind {
    fn from(kind: ObjectKind) -> Self {
        match kind {
            ObjectKind::U8 => Self::U8,
            ObjectKind::U16 => Self::U16,
            ObjectKind::U32 => Self::U32,
            ObjectKind::I8 => Self::I8,
            ObjectKind::I16 => Self::I16,
            ObjectKind::I32 => Self::I32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str) -> Address {
        Asked::parse(text, None).expect("an object").address
    }

    fn refusal(text: &str) -> (String, String) {
        let failure = Asked::parse(text, None).expect_err("no object");
        (failure.reason, failure.message)
    }

    #[test]
    fn objects_are_named_or_numbered() {
        let statusword = Address::new(0x6041, 0);
        for text in [
            "statusword",
            "Statusword",
            "6041",
            "0x6041",
            "6041:00",
            "6041:0",
        ] {
            assert_eq!(at(text), statusword, "{text}");
        }
        for text in [
            "output current limit",
            "output_current_limit",
            "3001:02",
            "0x3001:0x2",
        ] {
            assert_eq!(at(text), Address::new(0x3001, 2), "{text}");
        }
        assert_eq!(at("cob-id sync"), Address::new(0x1005, 0));
        assert_eq!(at("1A00:0C"), Address::new(0x1A00, 12));
    }

    #[test]
    fn an_unknown_name_is_told_its_near_ones() {
        let (reason, message) = refusal("statusvord");
        assert_eq!(reason, "OBJECT_UNKNOWN");
        assert!(message.contains("0x6041:00 statusword"), "{message}");
        let (_, message) = refusal("positon actual");
        assert!(
            message.contains("0x6064:00 position actual value"),
            "{message}"
        );
        assert_eq!(refusal("").0, "OBJECT_UNKNOWN");
        assert_eq!(refusal("highest subindex").0, "OBJECT_AMBIGUOUS");
        for text in ["0x604", "6041:123", "60411:00", "6041:xy", "0x60410"] {
            assert_eq!(refusal(text).0, "OBJECT_INVALID", "{text}");
        }
    }

    #[test]
    fn values_are_checked_before_they_are_sent() {
        let bytes = |object: &str, value: &str| {
            Asked::parse(object, None)
                .expect("an object")
                .bytes(value)
                .map_err(|failure| failure.reason)
        };
        assert_eq!(bytes("607A", "-2"), Ok(vec![0xFE, 0xFF, 0xFF, 0xFF]));
        assert_eq!(bytes("6040", "0x0F"), Ok(vec![0x0F, 0]));
        assert_eq!(bytes("1010:01", "save"), Ok(b"save".to_vec()));
        for (object, value, reason) in [
            ("6041", "1", "OBJECT_READ_ONLY"),
            ("605A", "2", "VALUE_OUT_OF_RANGE"),
            ("3001:02", "4501", "VALUE_OUT_OF_RANGE"),
            ("6040", "65536", "VALUE_OUT_OF_RANGE"),
            ("607A", "1.5", "VALUE_INVALID"),
            ("607A", "--1", "VALUE_INVALID"),
            ("607A", "0x-1", "VALUE_INVALID"),
            ("607A", "save", "VALUE_INVALID"),
            ("607A", "99999999999999999999", "VALUE_INVALID"),
            ("5FFF", "1", "TYPE_UNKNOWN"),
        ] {
            assert_eq!(
                bytes(object, value),
                Err(reason.to_owned()),
                "{object} {value}"
            );
        }
        let foreign = Asked::parse("5FFF", Some(ObjectKind::I8)).expect("an object");
        assert_eq!(
            foreign.bytes("-1").map_err(|failure| failure.reason),
            Ok(vec![0xFF])
        );
        assert!(foreign.bytes("128").is_err());
    }
}
