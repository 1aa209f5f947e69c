//! The electronic data sheet of the drive (CiA 306-1) for configuration tools and foreign masters, written from the
//! [`dictionary`](crate::dictionary) and from nothing else.
//!
//! The same table always gives the same bytes: no date of today and no name of a machine enters.

mod sections;

use crate::dictionary::{Entry, entries};

use self::sections::{Section, object_sections};

/// What the file calls itself.
pub const FILE_NAME: &str = "epos4_compact_24_1.5_can.eds";

/// When the form of the file changed last, as CiA 306-1 wants dates and times: month, day, year.
const FORM_DATE: &str = "11-26-2026";
const FORM_TIME: &str = "12:00AM";
/// Bit rates of the drive, kbit/s, and whether it has them (maxon's data sheet of product 0x6050).
const BIT_RATES: [(u16, bool); 8] = [
    (1000, true),
    (800, true),
    (500, true),
    (250, true),
    (125, true),
    (50, true),
    (20, true),
    (10, false),
];
/// Objects that every CANopen device has (CiA 306-1).
const MANDATORY: [u16; 3] = [0x1000, 0x1001, 0x1018];
const MANUFACTURER: std::ops::Range<u16> = 0x2000..0x6000;
/// CiA 306-1 defines Dummy0001 to Dummy0007. The drive maps none of them.
const DUMMY_COUNT: u8 = 7;

/// The data sheet. Defaults that contain the node id are written `$NODEID+...`, or as numbers when the node id is
/// given, for tools that cannot add.
#[must_use]
pub fn write(node_id: Option<u8>) -> String {
    let mut sections = vec![file_info(), comments(), device_info(), dummy_usage()];
    let indices = indices();
    let is_mandatory = |index: &u16| MANDATORY.contains(index);
    let is_manufacturer = |index: &u16| MANUFACTURER.contains(index);
    let lists: [(&str, Vec<u16>); 3] = [
        (
            "MandatoryObjects",
            indices.iter().copied().filter(is_mandatory).collect(),
        ),
        (
            "OptionalObjects",
            indices
                .iter()
                .copied()
                .filter(|index| !is_mandatory(index) && !is_manufacturer(index))
                .collect(),
        ),
        (
            "ManufacturerObjects",
            indices.iter().copied().filter(is_manufacturer).collect(),
        ),
    ];
    for (name, listed) in lists {
        sections.push(object_list(name, &listed));
        sections.extend(
            listed
                .iter()
                .flat_map(|index| object_sections(record(*index), node_id)),
        );
    }
    sections.iter().map(ToString::to_string).collect()
}

/// Every index once, rising.
fn indices() -> Vec<u16> {
    let mut indices: Vec<u16> = entries().iter().map(|entry| entry.address.index).collect();
    indices.dedup();
    indices
}

/// The objects of one index, by rising subindex.
fn record(index: u16) -> &'static [Entry] {
    let from = entries().partition_point(|entry| entry.address.index < index);
    let to = entries().partition_point(|entry| entry.address.index <= index);
    &entries()[from..to]
}

fn file_info() -> Section {
    Section::new("FileInfo")
        .line("FileName", FILE_NAME)
        .line("FileVersion", 1)
        .line("FileRevision", 0)
        .line("EDSVersion", "4.0")
        .line(
            "Description",
            "Objects of an EPOS4 Compact 24/1.5 CAN that epos4-link knows",
        )
        .line("CreationTime", FORM_TIME)
        .line("CreationDate", FORM_DATE)
        .line("CreatedBy", "epos4-link")
        .line("ModificationTime", FORM_TIME)
        .line("ModificationDate", FORM_DATE)
        .line("ModifiedBy", "epos4-link")
}

fn comments() -> Section {
    Section::new("Comments")
        .line("Lines", 2)
        .line(
            "Line1",
            "Written from the object table of epos4-link; not a document of the drive's maker.",
        )
        .line(
            "Line2",
            "Objects of the drive that epos4-link does not use are absent.",
        )
}

fn device_info() -> Section {
    let default = |index, subindex| {
        let address = crate::canopen::object::Address::new(index, subindex);
        crate::dictionary::entry(address).map_or(0, |entry| entry.default)
    };
    let rates = BIT_RATES.into_iter().fold(
        Section::new("DeviceInfo")
            .line("VendorName", "maxon motor ag")
            .line("VendorNumber", sections::hex(default(0x1018, 1), 4))
            .line("ProductName", "EPOS4 Compact 24/1.5 CAN")
            .line("ProductNumber", sections::hex(default(0x1018, 2), 4))
            .line("RevisionNumber", sections::hex(default(0x1018, 3), 4))
            .line("OrderCode", "546714"),
        |section, (rate, has)| section.line(&format!("BaudRate_{rate}"), u8::from(has)),
    );
    rates
        .line("SimpleBootUpMaster", 0)
        .line("SimpleBootUpSlave", 1)
        .line("Granularity", 8)
        .line("DynamicChannelsSupported", 0)
        .line("CompactPDO", 0)
        .line("GroupMessaging", 0)
        .line("NrOfRXPDO", crate::dictionary::PDO_COUNT)
        .line("NrOfTXPDO", crate::dictionary::PDO_COUNT)
        .line("LSS_Supported", 1)
}

fn dummy_usage() -> Section {
    (1..=DUMMY_COUNT).fold(Section::new("DummyUsage"), |section, dummy| {
        section.line(&format!("Dummy{dummy:04}"), 0)
    })
}

fn object_list(name: &str, indices: &[u16]) -> Section {
    let counted = Section::new(name).line("SupportedObjects", indices.len());
    (1..).zip(indices).fold(counted, |section, (place, index)| {
        section.line(&i32::to_string(&place), sections::hex(i64::from(*index), 2))
    })
}

#[cfg(test)]
mod tests;
