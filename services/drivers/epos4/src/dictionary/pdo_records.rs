//! Communication and mapping records of the process data objects, 0x1400 to 0x1A03.

use crate::canopen::object::Address;
use crate::entry::{Entry, Kind, Rules};

/// The number of PDOs in each direction.
pub const PDO_COUNT: u16 = 4;
/// The number of objects that one PDO may carry.
pub const PDO_ENTRIES_MAX: u8 = 12;
/// Set in a COB-ID: the PDO is off.
pub const PDO_OFF: i64 = 0x8000_0000;

const RECEIVE_MAPS: [&[i64]; PDO_COUNT as usize] = [
    &[0x6040_0010],
    &[0x6040_0010, 0x6060_0008],
    &[0x6040_0010, 0x607A_0020],
    &[0x6040_0010, 0x60FF_0020],
];
const TRANSMIT_MAPS: [&[i64]; PDO_COUNT as usize] = [
    &[0x6041_0010],
    &[0x6041_0010, 0x6061_0008],
    &[0x6041_0010, 0x6064_0020],
    &[0x6041_0010, 0x606C_0020],
];

/// The records of all PDOs.
pub(super) fn all() -> Vec<Entry> {
    (0..PDO_COUNT)
        .flat_map(|number| receive(number).into_iter().chain(transmit(number)))
        .collect()
}

/// A PDO that the drive receives, counted from 0.
fn receive(number: u16) -> Vec<Entry> {
    let index = 0x1400 + number;
    let cob_id = Rules::rw(0x200 + 0x100 * i64::from(number)).plus_node_id();
    let mut entries = vec![
        entry(index, 1, Kind::U32, "cob-id of rpdo", "", cob_id),
        entry(
            index,
            2,
            Kind::U8,
            "transmission type of rpdo",
            "",
            Rules::rw(255),
        ),
    ];
    entries.extend(map(0x1600 + number, RECEIVE_MAPS[usize::from(number)]));
    entries
}

/// A PDO that the drive sends, counted from 0.
fn transmit(number: u16) -> Vec<Entry> {
    let index = 0x1800 + number;
    let off = if number == 0 { 0 } else { PDO_OFF };
    let cob_id = Rules::rw(off | (0x4000_0180 + 0x100 * i64::from(number))).plus_node_id();
    let mut entries = vec![
        entry(index, 1, Kind::U32, "cob-id of tpdo", "", cob_id),
        entry(
            index,
            2,
            Kind::U8,
            "transmission type of tpdo",
            "",
            Rules::rw(255),
        ),
        entry(
            index,
            3,
            Kind::U16,
            "inhibit time of tpdo",
            "100 us",
            Rules::rw(10),
        ),
    ];
    entries.extend(map(0x1A00 + number, TRANSMIT_MAPS[usize::from(number)]));
    entries
}

fn map(index: u16, mapped: &[i64]) -> Vec<Entry> {
    let count = Rules::rw(mapped.len() as i64).between(0, i64::from(PDO_ENTRIES_MAX));
    let mut entries = vec![entry(
        index,
        0,
        Kind::U8,
        "number of mapped objects",
        "",
        count,
    )];
    let objects = mapped.iter().copied().chain(std::iter::repeat(0));
    entries.extend(objects.zip(1..=PDO_ENTRIES_MAX).map(|(object, subindex)| {
        entry(
            index,
            subindex,
            Kind::U32,
            "mapped object",
            "",
            Rules::rw(object),
        )
    }));
    entries
}

fn entry(
    index: u16,
    subindex: u8,
    kind: Kind,
    name: &'static str,
    unit: &'static str,
    rules: Rules,
) -> Entry {
    Entry::new(Address::new(index, subindex), kind, name, unit, rules)
}
