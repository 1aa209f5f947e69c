//! The object dictionary of an EPOS4 Compact 24/1.5 CAN with firmware 0x0170: every object with type, access, legal
//! values, unit and factory value, as data.
//!
//! The typed constants of [`objects`](crate::objects) and these entries are one table. [`entries`] serves whoever treats
//! objects alike: a drive's server, a tool that reads by name, the writer of an electronic data sheet.

mod pdo_records;

use std::sync::LazyLock;

use crate::canopen::object::Address;
use crate::entry::Rules;
use crate::objects;

pub use self::pdo_records::{PDO_COUNT, PDO_ENTRIES_MAX, PDO_OFF};
pub use crate::entry::{Access, Entry, Kind, Legal, Mapping};

/// All objects, by rising address.
#[must_use]
pub fn entries() -> &'static [Entry] {
    &ENTRIES
}

/// An object by its address.
#[must_use]
pub fn entry(address: Address) -> Option<&'static Entry> {
    place(address).map(|place| &ENTRIES[place])
}

/// Where an object stands in [`entries`]. A simulated drive asks at every step of its cell.
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

static ENTRIES: LazyLock<Vec<Entry>> = LazyLock::new(|| {
    let mut entries: Vec<Entry> = objects::tables().concat();
    entries.extend(objects::series());
    entries.extend(pdo_records::all());
    entries.extend(counts(&entries));
    entries.sort_by_key(|entry| entry.address);
    entries
});

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

/// Subindex 0 of every record that does not state its own: the highest subindex.
fn counts(entries: &[Entry]) -> Vec<Entry> {
    let stated = |address| entries.iter().any(|entry| entry.address == address);
    let mut records: Vec<u16> = entries
        .iter()
        .filter(|entry| entry.address.subindex > 0)
        .map(|entry| entry.address.index)
        .filter(|index| !stated(Address::new(*index, 0)))
        .collect();
    records.sort_unstable();
    records.dedup();
    let highest = |index| {
        entries
            .iter()
            .map(|entry| entry.address)
            .filter(|address| address.index == index)
            .map(|address| address.subindex)
            .max()
    };
    records
        .into_iter()
        .map(|index| {
            let count = i64::from(highest(index).unwrap_or(0));
            Entry::new(
                Address::new(index, 0),
                Kind::U8,
                "highest subindex",
                "",
                Rules::ro(count),
            )
        })
        .collect()
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
        let count = |index| entry(Address::new(index, 0)).unwrap().default;
        assert_eq!(count(0x1018), 4);
        assert_eq!(count(0x60E3), 15);
        assert_eq!(count(0x1800), 3);
        assert_eq!(count(0x1A02), 2);
        assert_eq!(count(0x3010), 4);
    }

    #[test]
    fn objects_that_the_drive_lacks_are_absent() {
        for index in [
            0x6072, 0x605D, 0x607C, 0x1009, 0x100A, 0x1006, 0x100C, 0x100D, 0x1015, 0x1019,
        ] {
            assert!(!has_index(index), "0x{index:04X}");
        }
        assert!(place(Address::new(0x1800, 5)).is_none());
        assert!(place(Address::new(0x1400, 5)).is_none());
    }

    #[test]
    fn the_typed_objects_are_the_entries() {
        let entry = entry(objects::POSITION_ACTUAL.address).unwrap();
        assert_eq!(
            (entry.kind, entry.name, entry.unit),
            (Kind::I32, "position actual value", "qc")
        );
        assert_eq!(objects::POSITION_ACTUAL.name, entry.name);
    }

    #[test]
    fn cob_ids_carry_the_node_id() {
        let cob_id = |index| entry(Address::new(index, 1)).unwrap().factory_value(3);
        assert_eq!(cob_id(0x1800), 0x4000_0183);
        assert_eq!(cob_id(0x1801), 0xC000_0283);
        assert_eq!(cob_id(0x1402), 0x403);
    }
}
