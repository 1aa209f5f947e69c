//! The table itself.

use std::sync::LazyLock;

use epos4_link::canopen::object::Address;

use super::{Access, Entry, Kind, Legal, Mapping, PDO_COUNT, PDO_ENTRIES_MAX, PDO_OFF};

/// All objects, by rising address.
pub(super) static ENTRIES: LazyLock<Vec<Entry>> = LazyLock::new(|| {
    let mut entries: Vec<Entry> = TABLE.to_vec();
    entries.extend((1_u8..).zip(HOMING_METHODS).map(|(subindex, method)| {
        ro(
            0x60E3,
            subindex,
            Kind::I8,
            *method,
            "supported homing method",
        )
    }));
    entries.extend(
        (1_u8..)
            .zip(FACTORY_INPUT_FUNCTIONS)
            .map(|(input, function)| {
                rw(0x3142, input, Kind::U8, *function, "digital input function")
                    .one_of(INPUT_FUNCTIONS)
            }),
    );
    for number in 0..PDO_COUNT {
        entries.extend(receive_pdo(number));
        entries.extend(transmit_pdo(number));
    }
    let counts: Vec<Entry> = entries
        .iter()
        .filter(|entry| entry.address.subindex == 1)
        .map(|entry| entry.address.index)
        .filter(|index| {
            !entries
                .iter()
                .any(|entry| entry.address == Address::new(*index, 0))
        })
        .map(|index| {
            let highest = entries
                .iter()
                .filter(|entry| entry.address.index == index)
                .map(|entry| entry.address.subindex);
            ro(
                index,
                0,
                Kind::U8,
                i64::from(highest.max().unwrap_or(0)),
                "highest subindex",
            )
        })
        .collect();
    entries.extend(counts);
    entries.sort_by_key(|entry| entry.address);
    entries
});

/// Supported homing methods, object 0x60E3.
const HOMING_METHODS: &[i64] = &[37, 34, 33, 27, 23, 18, 17, 11, 7, 2, 1, -1, -2, -3, -4];
/// Legal values of 0x3142: the limit and home switches, general purpose A to H, and the special functions.
const INPUT_FUNCTIONS: &[i64] = &[
    0, 1, 2, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 255,
];
/// Digital inputs 1 to 8 from the factory: both limit switches, home switch, general purpose D.
const FACTORY_INPUT_FUNCTIONS: &[i64] = &[0, 1, 2, 19, 255, 255, 255, 255];
/// Profile position, profile velocity, homing, and the three cyclic modes.
const MODES: &[i64] = &[1, 3, 6, 8, 9, 10];

const U32_MAX: i64 = u32::MAX as i64;

const TABLE: &[Entry] = {
    use Kind::{I8, I16, I32, Text, U8, U16, U32};
    &[
        ro(0x1000, 0, U32, 0x0002_0192, "device type"),
        ro(0x1001, 0, U8, 0, "error register").tx(),
        rw(0x1003, 0, U8, 0, "number of errors").one_of(&[0]),
        ro(0x1003, 1, U32, 0, "error history 1"),
        ro(0x1003, 2, U32, 0, "error history 2"),
        ro(0x1003, 3, U32, 0, "error history 3"),
        ro(0x1003, 4, U32, 0, "error history 4"),
        ro(0x1003, 5, U32, 0, "error history 5"),
        ro(0x1005, 0, U32, 0x80, "cob-id sync"),
        ro(0x1008, 0, Text("EPOS4"), 0, "manufacturer device name"),
        rw(0x1010, 1, U32, 1, "save all parameters"),
        rw(0x1011, 1, U32, 1, "restore all default parameters"),
        ro(0x1014, 0, U32, 0x80, "cob-id emcy").plus_node_id(),
        rw(0x1016, 1, U32, 0, "consumer 1 heartbeat time").between(0, 0x007F_FFFF),
        rw(0x1016, 2, U32, 0, "consumer 2 heartbeat time").between(0, 0x007F_FFFF),
        rw(0x1017, 0, U16, 0, "producer heartbeat time"),
        ro(0x1018, 1, U32, 0x0000_00FB, "vendor id"),
        ro(0x1018, 2, U32, 0x6050_0000, "product code"),
        ro(0x1018, 3, U32, 0x0170_0000, "revision number"),
        ro(0x1018, 4, U32, 0, "serial number"),
        rw(0x1029, 1, U8, 0, "communication error behaviour").between(0, 2),
        ro(0x1200, 1, U32, 0x600, "cob-id sdo client to server").plus_node_id(),
        ro(0x1200, 2, U32, 0x580, "cob-id sdo server to client").plus_node_id(),
        ro(0x2000, 0, U8, 0, "node id").plus_node_id(),
        rw(0x2001, 0, U8, 9, "can bit rate").between(0, 9),
        ro(0x2200, 1, U16, 240, "power supply voltage"),
        rw(0x3000, 1, U32, 0x0000_0001, "sensors configuration").power_off(),
        rw(0x3000, 2, U32, 0x0001_1111, "control structure").power_off(),
        rw(0x3000, 3, U32, 0, "commutation sensors").power_off(),
        ro(0x3000, 5, U32, 2000, "main sensor resolution"),
        ro(0x3000, 6, U32, 50_000, "max system speed"),
        rw(0x3001, 1, U32, 1500, "nominal current")
            .between(0, 1500)
            .rx(),
        rw(0x3001, 2, U32, 4500, "output current limit")
            .between(0, 4500)
            .rx(),
        rw(0x3001, 3, U8, 1, "number of pole pairs").power_off(),
        rw(0x3001, 4, U16, 40, "thermal time constant winding"),
        rw(0x3001, 5, U32, 9_000, "motor torque constant"),
        rw(0x3002, 1, U32, 0, "electrical resistance"),
        rw(0x3002, 2, U16, 0, "electrical inductance"),
        rw(0x3003, 1, U32, 1, "gear reduction numerator")
            .between(1, U32_MAX)
            .power_off(),
        rw(0x3003, 2, U32, 1, "gear reduction denominator")
            .between(1, U32_MAX)
            .power_off(),
        rw(0x3003, 3, U32, 100_000, "max gear input speed"),
        rw(0x3003, 4, U8, 0, "gear miscellaneous configuration").power_off(),
        rw(0x3010, 1, U32, 500, "encoder number of pulses")
            .between(16, 2_500_000)
            .power_off(),
        rw(0x3010, 2, U16, 1, "encoder type").power_off(),
        ro(0x3010, 4, I32, 0, "encoder index position"),
        rw(0x30B0, 0, I32, 0, "home position").rx(),
        rw(0x30B1, 0, I32, 0, "home offset move distance"),
        rw(0x30B2, 0, U16, 500, "current threshold for homing mode").rx(),
        ro(0x30D0, 0, I32, 0, "current demand value").tx(),
        ro(0x30D1, 1, I32, 0, "current actual value averaged").tx(),
        ro(0x30D1, 2, I32, 0, "current actual value").tx(),
        ro(0x30D2, 1, I16, 0, "torque actual value averaged").tx(),
        ro(0x30D3, 1, I32, 0, "velocity actual value averaged").tx(),
        rw(0x30E0, 1, U32, 30, "standstill window"),
        rw(0x30E0, 2, U16, 2, "standstill window time"),
        rw(0x30E0, 3, U16, 1000, "standstill window timeout"),
        ro(0x3141, 1, U16, 0, "digital input logic state").tx(),
        rw(0x3141, 2, U16, 0, "digital input polarity"),
        ro(0x3200, 1, U16, 0, "i2t level motor").tx(),
        ro(0x3200, 2, U16, 0, "i2t level power stage").tx(),
        ro(0x3201, 1, I16, 300, "temperature power stage").tx(),
        ro(0x3201, 4, U16, 1050, "max temperature power stage"),
        ro(0x3202, 1, U8, 3, "sto input states"),
        rw(0x6007, 0, I16, 3, "abort connection option code").between(2, 3),
        ro(0x603F, 0, U16, 0, "error code").tx(),
        rw(0x6040, 0, U16, 0, "controlword").rx(),
        ro(0x6041, 0, U16, 0x0040, "statusword").tx(),
        rw(0x605A, 0, I16, 6, "quick stop option code").one_of(&[6]),
        rw(0x605B, 0, I16, 0, "shutdown option code").between(0, 1),
        rw(0x605C, 0, I16, 1, "disable operation option code").between(0, 1),
        rw(0x605E, 0, I16, 2, "fault reaction option code").between(0, 2),
        rw(0x6060, 0, I8, 1, "modes of operation")
            .one_of(MODES)
            .rx(),
        ro(0x6061, 0, I8, 1, "modes of operation display").tx(),
        ro(0x6062, 0, I32, 0, "position demand value").tx(),
        ro(0x6064, 0, I32, 0, "position actual value").tx(),
        rw(0x6065, 0, U32, 2000, "following error window").rx(),
        rw(0x6066, 0, U16, 0, "following error timeout").one_of(&[0]),
        rw(0x6067, 0, U32, U32_MAX, "position window").rx(),
        rw(0x6068, 0, U16, 0, "position window time").rx(),
        ro(0x606B, 0, I32, 0, "velocity demand value").tx(),
        ro(0x606C, 0, I32, 0, "velocity actual value").tx(),
        rw(0x6071, 0, I16, 0, "target torque").rx(),
        ro(0x6076, 0, U32, 0, "motor rated torque"),
        ro(0x6077, 0, I16, 0, "torque actual value").tx(),
        rw(0x607A, 0, I32, 0, "target position").rx(),
        rw(0x607B, 1, I32, 0, "min position range limit").one_of(&[0]),
        rw(0x607B, 2, I32, 0, "max position range limit").one_of(&[0]),
        rw(0x607D, 1, I32, 0, "min position limit").rx(),
        rw(0x607D, 2, I32, 0, "max position limit").rx(),
        rw(0x607F, 0, U32, 50_000, "max profile velocity").rx(),
        rw(0x6080, 0, U32, 50_000, "max motor speed").rx(),
        rw(0x6081, 0, U32, 1000, "profile velocity").rx(),
        rw(0x6083, 0, U32, 10_000, "profile acceleration")
            .between(1, U32_MAX)
            .rx(),
        rw(0x6084, 0, U32, 10_000, "profile deceleration")
            .between(1, U32_MAX)
            .rx(),
        rw(0x6085, 0, U32, 10_000, "quick stop deceleration")
            .between(1, U32_MAX)
            .rx(),
        rw(0x6086, 0, I16, 0, "motion profile type").one_of(&[0]),
        rw(0x6098, 0, I8, 7, "homing method")
            .one_of(HOMING_METHODS)
            .rx(),
        rw(0x6099, 1, U32, 100, "speed for switch search").rx(),
        rw(0x6099, 2, U32, 10, "speed for zero search").rx(),
        rw(0x609A, 0, U32, 1000, "homing acceleration")
            .between(1, U32_MAX)
            .rx(),
        ro(0x60A8, 0, U32, 0x00B5_0000, "si unit position"),
        rw(0x60A9, 0, U32, 0x00B4_4700, "si unit velocity")
            .one_of(&[0x00B4_4700])
            .power_off(),
        ro(0x60AA, 0, U32, 0x00C0_0300, "si unit acceleration"),
        rw(0x60C5, 0, U32, U32_MAX, "max acceleration")
            .between(1, U32_MAX)
            .rx(),
        ro(
            0x60E4,
            1,
            I32,
            0,
            "additional position actual value sensor 1",
        )
        .tx(),
        ro(
            0x60E5,
            1,
            I32,
            0,
            "additional velocity actual value sensor 1",
        )
        .tx(),
        ro(0x60F4, 0, I32, 0, "following error actual value").tx(),
        ro(0x60FD, 0, U32, 0, "digital inputs").tx(),
        rw(0x60FF, 0, I32, 0, "target velocity").rx(),
        rw(0x6402, 0, U16, 1, "motor type")
            .one_of(&[1, 10, 11])
            .power_off(),
        ro(0x6502, 0, U32, 0x0000_03A5, "supported drive modes"),
    ]
};

/// Communication and mapping record of a PDO that the drive receives, counted from 0.
fn receive_pdo(number: u16) -> Vec<Entry> {
    let maps: [&[i64]; 4] = [
        &[0x6040_0010],
        &[0x6040_0010, 0x6060_0008],
        &[0x6040_0010, 0x607A_0020],
        &[0x6040_0010, 0x60FF_0020],
    ];
    let mut entries = vec![
        rw(
            0x1400 + number,
            1,
            Kind::U32,
            0x200 + 0x100 * i64::from(number),
            "cob-id of rpdo",
        )
        .plus_node_id(),
        rw(
            0x1400 + number,
            2,
            Kind::U8,
            255,
            "transmission type of rpdo",
        ),
    ];
    entries.extend(map_record(0x1600 + number, maps[usize::from(number)]));
    entries
}

/// Communication and mapping record of a PDO that the drive sends, counted from 0.
fn transmit_pdo(number: u16) -> Vec<Entry> {
    let maps: [&[i64]; 4] = [
        &[0x6041_0010],
        &[0x6041_0010, 0x6061_0008],
        &[0x6041_0010, 0x6064_0020],
        &[0x6041_0010, 0x606C_0020],
    ];
    let off = if number == 0 { 0 } else { PDO_OFF };
    let cob_id = off | (0x4000_0180 + 0x100 * i64::from(number));
    let mut entries = vec![
        rw(0x1800 + number, 1, Kind::U32, cob_id, "cob-id of tpdo").plus_node_id(),
        rw(
            0x1800 + number,
            2,
            Kind::U8,
            255,
            "transmission type of tpdo",
        ),
        rw(0x1800 + number, 3, Kind::U16, 10, "inhibit time of tpdo"),
    ];
    entries.extend(map_record(0x1A00 + number, maps[usize::from(number)]));
    entries
}

fn map_record(index: u16, mapped: &[i64]) -> impl Iterator<Item = Entry> {
    let count = rw(
        index,
        0,
        Kind::U8,
        mapped.len() as i64,
        "number of mapped objects",
    )
    .between(0, i64::from(PDO_ENTRIES_MAX));
    let objects = mapped
        .iter()
        .copied()
        .chain(std::iter::repeat(0))
        .zip(1..=PDO_ENTRIES_MAX);
    std::iter::once(count).chain(
        objects
            .map(move |(object, subindex)| rw(index, subindex, Kind::U32, object, "mapped object"))
            .collect::<Vec<_>>(),
    )
}

const fn ro(index: u16, subindex: u8, kind: Kind, default: i64, name: &'static str) -> Entry {
    let (low, high) = kind.range();
    Entry {
        address: Address::new(index, subindex),
        kind,
        access: Access::ReadOnly,
        mapping: Mapping::No,
        legal: Legal::Between(low, high),
        default,
        plus_node_id: false,
        name,
    }
}

const fn rw(index: u16, subindex: u8, kind: Kind, default: i64, name: &'static str) -> Entry {
    Entry {
        access: Access::ReadWrite,
        ..ro(index, subindex, kind, default, name)
    }
}

impl Entry {
    const fn tx(self) -> Self {
        Self {
            mapping: Mapping::Transmit,
            ..self
        }
    }

    const fn rx(self) -> Self {
        Self {
            mapping: Mapping::Receive,
            ..self
        }
    }

    const fn power_off(self) -> Self {
        Self {
            access: Access::ReadWritePowerOff,
            ..self
        }
    }

    const fn plus_node_id(self) -> Self {
        Self {
            plus_node_id: true,
            ..self
        }
    }

    const fn between(self, low: i64, high: i64) -> Self {
        Self {
            legal: Legal::Between(low, high),
            ..self
        }
    }

    const fn one_of(self, values: &'static [i64]) -> Self {
        Self {
            legal: Legal::OneOf(values),
            ..self
        }
    }
}
