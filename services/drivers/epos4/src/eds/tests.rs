use super::*;
use crate::canopen::object::Address;
use crate::dictionary::{Access, Kind, Mapping, entry};

/// The lines of one section.
fn section(file: &str, name: &str) -> Vec<String> {
    let heading = format!("[{name}]");
    file.split("\r\n")
        .skip_while(|line| *line != heading)
        .skip(1)
        .take_while(|line| !line.is_empty())
        .map(str::to_owned)
        .collect()
}

fn value(file: &str, name: &str, key: &str) -> Option<String> {
    section(file, name)
        .iter()
        .find_map(|line| Some(line.strip_prefix(key)?.strip_prefix('=')?.to_owned()))
}

#[test]
fn the_same_table_gives_the_same_bytes() {
    assert_eq!(write(None), write(None));
    assert_ne!(write(None), write(Some(3)));
}

#[test]
fn an_object_is_written_as_cia_306_has_it() {
    let file = write(None);
    assert_eq!(
        section(&file, "6065"),
        [
            "ParameterName=following error window",
            "ObjectType=0x7",
            "DataType=0x0007",
            "AccessType=rww",
            "DefaultValue=2000",
            "PDOMapping=1",
        ]
    );
    assert_eq!(
        section(&file, "607D"),
        [
            "SubNumber=3",
            "ParameterName=software position limit",
            "ObjectType=0x8",
        ]
    );
    assert_eq!(
        section(&file, "6098"),
        [
            "ParameterName=homing method",
            "ObjectType=0x7",
            "DataType=0x0002",
            "AccessType=rww",
            "DefaultValue=7",
            "LowLimit=-4",
            "HighLimit=37",
            "PDOMapping=1",
        ]
    );
}

#[test]
fn the_node_id_is_left_to_the_reader_or_added() {
    let cob_id = |file: &str| value(file, "1801sub1", "DefaultValue");
    assert_eq!(cob_id(&write(None)), Some("$NODEID+0xC0000280".to_owned()));
    assert_eq!(cob_id(&write(Some(3))), Some("0xC0000283".to_owned()));
}

#[test]
fn every_object_is_described_once_and_listed_once() {
    let file = write(None);
    let headings = |name: &str| file.matches(&format!("[{name}]\r\n")).count();
    for described in entries() {
        let Address { index, subindex } = described.address;
        let has_members = entry(Address::new(index, 1)).is_some();
        let name = if has_members {
            format!("{index:04X}sub{subindex:X}")
        } else {
            format!("{index:04X}")
        };
        assert_eq!(headings(&name), 1, "{name}");
        let default = value(&file, &name, "DefaultValue");
        assert!(default.is_some_and(|text| !text.is_empty()), "{name}");
        let listed = format!("=0x{index:04X}\r\n");
        assert_eq!(file.matches(&listed).count(), 1, "{listed}");
    }
    let listed: usize = ["Mandatory", "Optional", "Manufacturer"]
        .iter()
        .filter_map(|list| value(&file, &format!("{list}Objects"), "SupportedObjects"))
        .filter_map(|count| count.parse::<usize>().ok())
        .sum();
    assert_eq!(listed, indices().len());
}

#[test]
fn members_of_an_object_differ_in_name() {
    let file = write(None);
    for index in indices() {
        let names: Vec<_> = record(index)
            .iter()
            .map(|member| format!("{index:04X}sub{:X}", member.address.subindex))
            .map(|section| value(&file, &section, "ParameterName"))
            .collect();
        let mut distinct = names.clone();
        distinct.sort();
        distinct.dedup();
        assert!(
            names.len() == 1 || names.len() == distinct.len(),
            "0x{index:04X}"
        );
        assert!(
            !file.contains("ParameterName=object 0x"),
            "an object without a name"
        );
    }
}

#[test]
fn lines_are_short_ascii_with_carriage_return() {
    let file = write(None);
    assert!(file.is_ascii());
    assert_eq!(file.matches('\n').count(), file.matches("\r\n").count());
    assert!(file.lines().all(|line| line.len() <= 255));
    assert_eq!(
        value(&file, "1008", "DefaultValue"),
        Some("EPOS4".to_owned())
    );
    assert!(matches!(
        entry(Address::new(0x1008, 0)).map(|entry| entry.kind),
        Some(Kind::Text("EPOS4"))
    ));
}

/// A number as CiA 306-1 writes it, with the node id added where it is asked for.
fn parsed(text: &str, node_id: i64) -> i64 {
    let (offset, digits) = match text.strip_prefix("$NODEID+") {
        Some(digits) => (node_id, digits),
        None => (0, text),
    };
    let number = match digits.strip_prefix("0x") {
        Some(hex) => i64::from_str_radix(hex, 16),
        None => digits.parse(),
    };
    number.expect("a number") + offset
}

#[test]
fn what_is_read_back_is_the_table() {
    let file = write(None);
    for described in entries() {
        let Address { index, subindex } = described.address;
        let member = format!("{index:04X}sub{subindex:X}");
        let name = if section(&file, &member).is_empty() {
            format!("{index:04X}")
        } else {
            member
        };
        let stated = |key| value(&file, &name, key);
        let kind = match stated("DataType").as_deref() {
            Some("0x0002") => Kind::I8,
            Some("0x0003") => Kind::I16,
            Some("0x0004") => Kind::I32,
            Some("0x0005") => Kind::U8,
            Some("0x0006") => Kind::U16,
            Some("0x0007") => Kind::U32,
            Some("0x0009") => Kind::Text("EPOS4"),
            other => panic!("{name}: {other:?}"),
        };
        assert_eq!(kind, described.kind, "{name}");
        let access = stated("AccessType").unwrap_or_default();
        let is_writable = described.access != Access::ReadOnly;
        assert_eq!(access.starts_with("rw"), is_writable, "{name}");
        assert_eq!(
            access == "rww",
            is_writable && described.mapping == Mapping::Receive,
            "{name}"
        );
        let mappable = stated("PDOMapping").map(|text| text == "1");
        assert_eq!(mappable, Some(described.mapping != Mapping::No), "{name}");
        if let Kind::Text(_) = kind {
            continue;
        }
        let default = stated("DefaultValue").map(|text| parsed(&text, 5));
        assert_eq!(default, Some(described.factory_value(5)), "{name}");
        let limit = |key, of_type| stated(key).map_or(of_type, |text| parsed(&text, 0));
        let (low, high) = (
            limit("LowLimit", kind.range().0),
            limit("HighLimit", kind.range().1),
        );
        if is_writable {
            assert!(
                described.legal.allows(low) && described.legal.allows(high),
                "{name}"
            );
            for beyond in [low - 1, high + 1] {
                assert!(!described.legal.allows(beyond), "{name}: {beyond}");
            }
        }
    }
}
