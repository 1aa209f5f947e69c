//! The object dictionary of the simulated drive: every object with type, access, legal values and default, as an
//! EPOS4 Compact 24/1.5 CAN with firmware 0x0170 has it.

pub mod at;
mod table;

use std::sync::LazyLock;

use epos4_link::canopen::object::Address;

use self::table::ENTRIES;

/// One object.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Where it stands.
    pub address: Address,
    /// What it holds.
    pub kind: Kind,
    /// Who may write it.
    pub access: Access,
    /// Which PDOs may carry it.
    pub mapping: Mapping,
    /// Which values may be written.
    pub legal: Legal,
    /// The factory value, before the node id is added.
    pub default: i64,
    /// Whether the node id is part of the default: it is a COB-ID.
    pub plus_node_id: bool,
    /// Its name in the manual, lowercase.
    pub name: &'static str,
}

/// A CANopen data type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Unsigned, 1 byte.
    U8,
    /// Unsigned, 2 bytes.
    U16,
    /// Unsigned, 4 bytes.
    U32,
    /// Signed, 1 byte.
    I8,
    /// Signed, 2 bytes.
    I16,
    /// Signed, 4 bytes.
    I32,
    /// This text.
    Text(&'static str),
}

/// Who may write an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// The drive alone.
    ReadOnly,
    /// The master.
    ReadWrite,
    /// The master, while the power stage is off.
    ReadWritePowerOff,
}

/// Which PDOs may carry an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mapping {
    /// None.
    No,
    /// Those that the drive sends.
    Transmit,
    /// Those that it receives.
    Receive,
}

/// Which values may be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Legal {
    /// Lowest to highest.
    Between(i64, i64),
    /// These alone.
    OneOf(&'static [i64]),
}

/// The number of PDOs in each direction.
pub const PDO_COUNT: u16 = 4;
/// The number of objects that one PDO may carry.
pub const PDO_ENTRIES_MAX: u8 = 12;
/// Set in a COB-ID: the PDO is off.
pub const PDO_OFF: i64 = 0x8000_0000;

/// All objects, by rising address.
#[must_use]
pub fn entries() -> &'static [Entry] {
    &ENTRIES
}

/// Where an object stands in [`entries`]. The drives ask at every step of the cell.
#[must_use]
pub fn place(address: Address) -> Option<usize> {
    let first = first_place(address.index)?;
    let record = ENTRIES[first..]
        .iter()
        .take_while(|entry| entry.address.index == address.index);
    let offset = record
        .map(|entry| entry.address.subindex)
        .position(|subindex| subindex == address.subindex)?;
    Some(first + offset)
}

/// Whether any object has this index.
#[must_use]
pub fn has_index(index: u16) -> bool {
    first_place(index).is_some()
}

fn first_place(index: u16) -> Option<usize> {
    Some(usize::from(FIRST_PLACES[usize::from(index)]))
        .filter(|place| *place != usize::from(NO_PLACE))
}

/// For every index, where its first object stands.
static FIRST_PLACES: LazyLock<Vec<u16>> = LazyLock::new(|| {
    let mut first_places = vec![NO_PLACE; 1 << 16];
    for (place, entry) in (0..).zip(ENTRIES.iter()) {
        let first = &mut first_places[usize::from(entry.address.index)];
        *first = place.min(*first);
    }
    first_places
});

const NO_PLACE: u16 = u16::MAX;

impl Kind {
    /// Bytes on the bus.
    #[must_use]
    pub const fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 => 4,
            Self::Text(text) => text.len(),
        }
    }

    /// Lowest and highest value.
    const fn range(self) -> (i64, i64) {
        match self {
            Self::U8 => (0, u8::MAX as i64),
            Self::U16 => (0, u16::MAX as i64),
            Self::U32 => (0, u32::MAX as i64),
            Self::I8 => (i8::MIN as i64, i8::MAX as i64),
            Self::I16 => (i16::MIN as i64, i16::MAX as i64),
            Self::I32 => (i32::MIN as i64, i32::MAX as i64),
            Self::Text(_) => (0, 0),
        }
    }

    /// Little-endian bytes of a value.
    #[must_use]
    pub fn encode(self, value: i64) -> Vec<u8> {
        match self {
            Self::Text(text) => text.as_bytes().to_vec(),
            number => value.to_le_bytes()[..number.size()].to_vec(),
        }
    }

    /// The value of exactly [`size`](Self::size) little-endian bytes.
    #[must_use]
    pub fn decode(self, bytes: &[u8]) -> Option<i64> {
        Some(match self {
            Self::U8 => i64::from(u8::from_le_bytes(bytes.try_into().ok()?)),
            Self::U16 => i64::from(u16::from_le_bytes(bytes.try_into().ok()?)),
            Self::U32 => i64::from(u32::from_le_bytes(bytes.try_into().ok()?)),
            Self::I8 => i64::from(i8::from_le_bytes(bytes.try_into().ok()?)),
            Self::I16 => i64::from(i16::from_le_bytes(bytes.try_into().ok()?)),
            Self::I32 => i64::from(i32::from_le_bytes(bytes.try_into().ok()?)),
            Self::Text(_) => return None,
        })
    }
}

impl Legal {
    /// Whether the value may be written.
    #[must_use]
    pub fn allows(self, value: i64) -> bool {
        match self {
            Self::Between(low, high) => (low..=high).contains(&value),
            Self::OneOf(values) => values.contains(&value),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_address_stands_once_and_every_default_fits_its_type() {
        for pair in entries().windows(2) {
            assert!(pair[0].address < pair[1].address, "{}", pair[1].address);
        }
        for entry in entries() {
            let (low, high) = entry.kind.range();
            assert!(
                (low..=high).contains(&entry.default),
                "{} {}",
                entry.address,
                entry.name
            );
            if entry.access != Access::ReadOnly {
                assert!(
                    entry.legal.allows(entry.default),
                    "{} {}",
                    entry.address,
                    entry.name
                );
            }
        }
    }

    #[test]
    fn records_count_their_highest_subindex() {
        let count = |index| entries()[place(Address::new(index, 0)).unwrap()].default;
        assert_eq!(count(0x1018), 4);
        assert_eq!(count(0x60E3), 15);
        assert_eq!(count(0x1800), 3);
        assert_eq!(count(0x1A02), 2);
    }

    #[test]
    fn objects_that_the_drive_lacks_are_absent() {
        for index in [
            0x6072, 0x605D, 0x607C, 0x1009, 0x100A, 0x1006, 0x100C, 0x100D,
        ] {
            assert!(!has_index(index), "0x{index:04X}");
        }
        assert!(place(Address::new(0x1800, 5)).is_none());
    }

    #[test]
    fn numbers_survive_their_bytes() {
        for (kind, value) in [
            (Kind::I8, -4),
            (Kind::I32, -645_120),
            (Kind::U32, i64::from(u32::MAX)),
            (Kind::U16, 0x8611),
        ] {
            assert_eq!(kind.decode(&kind.encode(value)), Some(value));
        }
    }
}
