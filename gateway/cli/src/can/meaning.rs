//! What the value of an object means, in words.

use epos4_link::canopen::emcy;
use epos4_link::canopen::object::Address;
use epos4_link::cia402::Statusword;
use epos4_link::dictionary::{Entry, Kind};
use epos4_link::objects;

/// A value with its unit, and what it means where that is a matter of bits or codes.
pub fn words(entry: &Entry, value: i64) -> String {
    let number = match (entry.kind, entry.unit) {
        (Kind::U16 | Kind::U32, "") => format!("0x{value:0width$X}", width = 2 * entry.kind.size()),
        (_, "") => value.to_string(),
        (_, unit) => format!("{value} {unit}"),
    };
    match meaning(entry, value) {
        Some(meaning) => format!("{number} ({meaning})"),
        None => number,
    }
}

/// What bits and codes say; `None` for a plain number.
pub fn meaning(entry: &Entry, value: i64) -> Option<String> {
    const STATUSWORD: u16 = objects::STATUSWORD.address.index;
    const CONTROLWORD: u16 = objects::CONTROLWORD.address.index;
    const ERROR_CODE: u16 = objects::ERROR_CODE.address.index;
    const ERROR_REGISTER: u16 = objects::ERROR_REGISTER.address.index;
    match (entry.address.index, entry.address.subindex) {
        (STATUSWORD, _) => Some(statusword(value as u16)),
        (CONTROLWORD, _) => Some(controlword(value as u16)),
        (ERROR_REGISTER, _) => Some(error_register(value as u8)),
        (ERROR_CODE, _) => Some(emcy::text(value as u16).to_owned()),
        (0x1003, 1..) => Some(emcy::text(value as u16).to_owned()),
        (0x6060 | 0x6061, _) => mode(value).map(str::to_owned),
        (0x1600..=0x1603 | 0x1A00..=0x1A03, 1..) if value != 0 => Some(mapped(value)),
        _ => None,
    }
}

/// State and flags of 0x6041.
pub fn statusword(word: u16) -> String {
    let state = Statusword(word)
        .state()
        .map_or_else(|| "NO_STATE".to_owned(), |state| state.to_string());
    // Bits 8 and 14 are reserved; 12 and 13 depend on the mode.
    let flags = [
        (4, "voltage"),
        (7, "warning"),
        (9, "remote"),
        (10, "target reached"),
        (11, "internal limit"),
        (12, "bit 12"),
        (13, "bit 13"),
        (15, "referenced"),
    ];
    with_flags(state, &flags, word)
}

/// The order of 0x6040 and its flags.
fn controlword(word: u16) -> String {
    let order = match word & 0x8F {
        order if order & 0x80 != 0 => "fault reset",
        order if order & 0x02 == 0 => "disable voltage",
        order if order & 0x04 == 0 => "quick stop",
        order if order & 0x01 == 0 => "shutdown",
        order if order & 0x08 == 0 => "switch on",
        _ => "enable operation",
    };
    let flags = [
        (4, "bit 4 start"),
        (5, "at once"),
        (6, "relative"),
        (8, "halt"),
        (15, "endless"),
    ];
    with_flags(order.to_owned(), &flags, word)
}

fn with_flags(first: String, flags: &[(u8, &str)], word: u16) -> String {
    let set = flags
        .iter()
        .filter(|(bit, _)| word >> bit & 1 == 1)
        .map(|(_, name)| (*name).to_owned());
    std::iter::once(first)
        .chain(set)
        .collect::<Vec<_>>()
        .join(", ")
}

/// The bits of 0x1001 (CiA 301, 7.5.2.2).
pub fn error_register(register: u8) -> String {
    let bits = [
        "generic",
        "current",
        "voltage",
        "temperature",
        "communication",
        "device profile",
        "reserved",
        "motion",
    ];
    let set: Vec<&str> = bits
        .iter()
        .enumerate()
        .filter(|(bit, _)| register >> bit & 1 == 1)
        .map(|(_, name)| *name)
        .collect();
    if set.is_empty() {
        "no error".to_owned()
    } else {
        set.join(", ")
    }
}

fn mode(code: i64) -> Option<&'static str> {
    match code {
        1 => Some("profile position"),
        3 => Some("profile velocity"),
        6 => Some("homing"),
        8 => Some("cyclic synchronous position"),
        9 => Some("cyclic synchronous velocity"),
        10 => Some("cyclic synchronous torque"),
        _ => None,
    }
}

/// The object that an entry of a mapping names.
fn mapped(entry: i64) -> String {
    let (address, bits) = mapped_object(entry);
    let name = epos4_link::dictionary::entry(address).map_or("unknown object", |entry| entry.name);
    format!("{address} {name}, {bits} bits")
}

/// Index, subindex and bit count of an entry of a mapping.
pub fn mapped_object(entry: i64) -> (Address, u8) {
    (
        Address::new((entry >> 16) as u16, (entry >> 8) as u8),
        entry as u8,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use epos4_link::canopen::object::Address;
    use epos4_link::dictionary;

    fn of(index: u16, value: i64) -> String {
        let entry = dictionary::entry(Address::new(index, 0)).expect("an object");
        words(entry, value)
    }

    #[test]
    fn words_bits_and_units_are_told() {
        assert_eq!(
            of(0x6041, 0x8237),
            "0x8237 (OPERATION_ENABLED, voltage, remote, referenced)"
        );
        assert_eq!(of(0x6041, 0x0008), "0x0008 (FAULT)");
        assert_eq!(
            of(0x6040, 0x005F),
            "0x005F (enable operation, bit 4 start, relative)"
        );
        assert_eq!(of(0x6040, 0x0080), "0x0080 (fault reset)");
        assert_eq!(of(0x6064, -43_008), "-43008 qc");
        assert_eq!(of(0x603F, 0x8611), "0x8611 (following error)");
        assert_eq!(of(0x1001, 0x81), "129 (generic, motion)");
        assert_eq!(of(0x6061, 6), "6 (homing)");
    }
}
