//! The sections of the file, and how an object becomes one or several of them.

use std::fmt;

use crate::dictionary::{Access, Entry, Kind, Legal, Mapping};

/// A heading and its lines.
#[derive(Debug)]
pub(super) struct Section {
    name: String,
    lines: Vec<(String, String)>,
}

// Object types of CiA 301, table 42.
const VAR: &str = "0x7";
const ARRAY: &str = "0x8";
const RECORD: &str = "0x9";
/// Objects with subindices that CiA 301, CiA 402 or the manual call arrays; all others are records.
const ARRAYS: [u16; 20] = [
    0x1003, 0x1010, 0x1011, 0x1016, 0x1029, 0x30D1, 0x30D2, 0x30D3, 0x3141, 0x3142, 0x3150, 0x3151,
    0x3160, 0x607B, 0x607D, 0x6099, 0x60E3, 0x60E4, 0x60E5, 0x60FE,
];

// === impl Section ===

impl Section {
    pub(super) fn new(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            lines: Vec::new(),
        }
    }

    pub(super) fn line(mut self, key: &str, value: impl fmt::Display) -> Self {
        self.lines.push((key.to_owned(), value.to_string()));
        self
    }
}

impl fmt::Display for Section {
    /// Lines end as CiA 306-1 wants them, with carriage return and line feed.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "[{}]\r\n", self.name)?;
        for (key, value) in &self.lines {
            write!(f, "{key}={value}\r\n")?;
        }
        f.write_str("\r\n")
    }
}

/// The sections of one index: the object, and each of its subindices when it has any.
pub(super) fn object_sections(record: &[Entry], node_id: Option<u8>) -> Vec<Section> {
    let Some(first) = record.first() else {
        return Vec::new();
    };
    let index = first.address.index;
    if let [variable] = record {
        return vec![object(
            format!("{index:04X}"),
            variable,
            variable.name,
            node_id,
        )];
    }
    let kind = if ARRAYS.contains(&index) {
        ARRAY
    } else {
        RECORD
    };
    let heading = Section::new(format!("{index:04X}"))
        .line("SubNumber", record.len())
        .line("ParameterName", record_name(index))
        .line("ObjectType", kind);
    let members = record.iter().map(|entry| {
        let section = format!("{index:04X}sub{:X}", entry.address.subindex);
        object(section, entry, &member_name(entry, record), node_id)
    });
    std::iter::once(heading).chain(members).collect()
}

fn object(section: String, entry: &Entry, name: &str, node_id: Option<u8>) -> Section {
    let described = Section::new(section)
        .line("ParameterName", name)
        .line("ObjectType", VAR)
        .line("DataType", data_type(entry.kind))
        .line("AccessType", access_type(entry));
    let with_default = described.line("DefaultValue", default_value(entry, node_id));
    let limited = match limits(entry) {
        Some((low, high)) => with_default
            .line("LowLimit", number(entry, low))
            .line("HighLimit", number(entry, high)),
        None => with_default,
    };
    limited.line("PDOMapping", u8::from(entry.mapping != Mapping::No))
}

/// The number of the data type in CiA 301, table 44.
fn data_type(kind: Kind) -> &'static str {
    match kind {
        Kind::I8 => "0x0002",
        Kind::I16 => "0x0003",
        Kind::I32 => "0x0004",
        Kind::U8 => "0x0005",
        Kind::U16 => "0x0006",
        Kind::U32 => "0x0007",
        Kind::Text(_) => "0x0009",
    }
}

/// `rww`, the process output of CiA 306-1, for what a receive PDO may carry.
fn access_type(entry: &Entry) -> &'static str {
    match (entry.access, entry.mapping) {
        (Access::ReadOnly, _) => "ro",
        (_, Mapping::Receive) => "rww",
        (_, Mapping::Transmit) => "rwr",
        (_, Mapping::No) => "rw",
    }
}

fn default_value(entry: &Entry, node_id: Option<u8>) -> String {
    match (entry.kind, entry.plus_node_id, node_id) {
        (Kind::Text(text), _, _) => text.to_owned(),
        (_, true, None) => format!("$NODEID+{}", hex(entry.default, entry.kind.size())),
        (_, _, node_id) => number(entry, entry.factory_value(node_id.unwrap_or(0))),
    }
}

/// Lowest and highest value that may be written, when the type allows more. What lies between two legal values the form
/// of the file cannot tell.
fn limits(entry: &Entry) -> Option<(i64, i64)> {
    if entry.access == Access::ReadOnly {
        return None;
    }
    let (low, high) = match entry.legal {
        Legal::Between(low, high) => (low, high),
        Legal::OneOf(values) => (*values.iter().min()?, *values.iter().max()?),
    };
    ((low, high) != entry.kind.range()).then_some((low, high))
}

/// Decimal for what counts something, hexadecimal for codes and bits.
fn number(entry: &Entry, value: i64) -> String {
    let is_code = matches!(entry.kind, Kind::U32 | Kind::U16) && entry.unit.is_empty();
    if is_code {
        hex(value, entry.kind.size())
    } else {
        value.to_string()
    }
}

/// `0x` and two digits a byte.
pub(super) fn hex(value: i64, bytes: usize) -> String {
    format!("0x{value:0width$X}", width = 2 * bytes)
}

/// Names tell the members of one object apart: readers look members up by them.
fn member_name(entry: &Entry, record: &[Entry]) -> String {
    let is_shared = record
        .iter()
        .any(|other| other.address != entry.address && other.name == entry.name);
    if is_shared {
        format!("{} {}", entry.name, entry.address.subindex)
    } else {
        entry.name.to_owned()
    }
}

/// The name of an object with subindices. One without a name of its own is called by its index.
fn record_name(index: u16) -> String {
    let pdo = (index & 3) + 1;
    let name = match index {
        0x1003 => "error history",
        0x1010 => "store parameters",
        0x1011 => "restore default parameters",
        0x1016 => "consumer heartbeat time",
        0x1018 => "identity object",
        0x1029 => "error behaviour",
        0x1200 => "sdo server parameter",
        0x1400..=0x1403 => return format!("receive pdo {pdo} parameter"),
        0x1600..=0x1603 => return format!("receive pdo {pdo} mapping"),
        0x1800..=0x1803 => return format!("transmit pdo {pdo} parameter"),
        0x1A00..=0x1A03 => return format!("transmit pdo {pdo} mapping"),
        0x2200 => "power supply",
        0x2201 => "power supply limits",
        0x3000 => "axis configuration",
        0x3001 => "motor data",
        0x3002 => "electrical system parameters",
        0x3003 => "gear configuration",
        0x3010 => "digital incremental encoder 1",
        0x30A0 => "current control parameter set",
        0x30A1 => "position control parameter set",
        0x30A2 => "velocity control parameter set",
        0x30D1 => "current actual values",
        0x30D2 => "torque actual values",
        0x30D3 => "velocity actual values",
        0x30E0 => "standstill window configuration",
        0x3141 => "digital input properties",
        0x3142 => "configuration of digital inputs",
        0x3150 => "digital output properties",
        0x3151 => "configuration of digital outputs",
        0x3158 => "holding brake configuration",
        0x3160 => "analog input properties",
        0x3200 => "motor protection",
        0x3201 => "temperatures",
        0x3202 => "safe torque off",
        0x607B => "position range limit",
        0x607D => "software position limit",
        0x6099 => "homing speeds",
        0x60C2 => "interpolation time period",
        0x60E3 => "supported homing methods",
        0x60E4 => "additional position actual value",
        0x60E5 => "additional velocity actual value",
        0x60FE => "digital outputs",
        index => return format!("object 0x{index:04X}"),
    };
    name.to_owned()
}
