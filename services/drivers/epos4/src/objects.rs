//! The objects of the EPOS4 Compact 24/1.5 CAN with firmware 0x0170, typed. Names follow maxon's firmware specification.
//!
//! Velocities of the profile are in rpm of the motor shaft, accelerations in rpm/s, positions in quadcounts,
//! currents in mA: the drive's factory units (0x60A8 to 0x60AA).
//!
//! Each line of these tables is both a typed constant and an entry of the [`dictionary`](crate::dictionary).

mod communication;
mod manufacturer;
mod profile;

use crate::canopen::object::{Address, Object};
use crate::entry::{Entry, Kind, Rules};

pub use self::communication::*;
pub use self::manufacturer::*;
pub use self::profile::*;

/// `save`, the signature that 0x1010:01 takes.
pub const SAVE_SIGNATURE: u32 = 0x6576_6173;
/// `load`, the signature that 0x1011:01 takes.
pub const LOAD_SIGNATURE: u32 = 0x6461_6F6C;
/// Digital inputs of the drive, 0x3142:01 to :08.
pub const INPUT_COUNT: u8 = 8;
/// Errors that the drive remembers, 0x1003:01 to :05.
pub const ERROR_HISTORY_LEN: u8 = 5;
/// The methods of homing that the drive has, 0x60E3: 37 the present position, 34 and 33 the index, 27 and 23 the home
/// switch, 18 and 17 a limit switch, 11, 7, 2 and 1 a switch and the index, -1 to -4 a stop by current.
pub const HOMING_METHODS: &[i64] = &[37, 34, 33, 27, 23, 18, 17, 11, 7, 2, 1, -1, -2, -3, -4];

/// The function of a digital input, 1 to 8: 0 negative limit switch, 1 positive limit switch, 2 home switch, 16 to 23
/// general purpose A to H, 24 and 25 limit switches without error, 26 touch probe, 27 drive enable, 28 quick stop, 255
/// none.
pub const fn digital_input_function(input: u8) -> Object<u8> {
    Object::new(0x3142, input, "digital input function", "")
}

/// A remembered error, 1 to 5, 1 being the newest.
pub const fn error_history(place: u8) -> Object<u32> {
    Object::new(0x1003, place, "error history", "")
}

/// States each object once: as a typed constant, and as an entry of `TABLE`.
macro_rules! objects {
    ($($(#[$doc:meta])* $name:ident: $type:ident = $index:literal, $subindex:literal, $text:literal, $unit:literal, $rules:expr;)*) => {
        $($(#[$doc])* pub const $name: crate::canopen::object::Object<$type> =
            crate::canopen::object::Object::new($index, $subindex, $text, $unit);)*

        pub(super) const TABLE: &[crate::entry::Entry] = &[$(crate::entry::Entry::new(
            crate::canopen::object::Address::new($index, $subindex),
            objects!(@kind $type),
            $text,
            $unit,
            $rules,
        )),*];
    };
    (@kind u8) => { crate::entry::Kind::U8 };
    (@kind u16) => { crate::entry::Kind::U16 };
    (@kind u32) => { crate::entry::Kind::U32 };
    (@kind i8) => { crate::entry::Kind::I8 };
    (@kind i16) => { crate::entry::Kind::I16 };
    (@kind i32) => { crate::entry::Kind::I32 };
}
use objects;

/// The tables of the typed objects.
pub(crate) fn tables() -> [&'static [Entry]; 3] {
    [communication::TABLE, manufacturer::TABLE, profile::TABLE]
}

/// Legal values of 0x3142.
const INPUT_FUNCTIONS: &[i64] = &[
    0, 1, 2, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 255,
];
/// Digital inputs 1 to 8 from the factory: both limit switches, home switch, general purpose D.
const FACTORY_INPUT_FUNCTIONS: [i64; INPUT_COUNT as usize] = [0, 1, 2, 19, 255, 255, 255, 255];

/// The objects that are alike but for their subindex, and the text.
pub(crate) fn series() -> Vec<Entry> {
    let device_name = Entry::new(
        Address::new(0x1008, 0),
        Kind::Text("EPOS4"),
        "manufacturer device name",
        "",
        Rules::ro(0),
    );
    let history = (1..=ERROR_HISTORY_LEN).map(|place| {
        let object = error_history(place);
        Entry::new(
            object.address,
            Kind::U32,
            object.name,
            object.unit,
            Rules::ro(0),
        )
    });
    let inputs = (1..).zip(FACTORY_INPUT_FUNCTIONS).map(|(input, function)| {
        let object = digital_input_function(input);
        let rules = Rules::rw(function).one_of(INPUT_FUNCTIONS);
        Entry::new(object.address, Kind::U8, object.name, object.unit, rules)
    });
    let homing_methods = (1..).zip(HOMING_METHODS).map(|(subindex, method)| {
        Entry::new(
            Address::new(0x60E3, subindex),
            Kind::I8,
            "supported homing method",
            "",
            Rules::ro(*method),
        )
    });
    std::iter::once(device_name)
        .chain(history)
        .chain(inputs)
        .chain(homing_methods)
        .collect()
}
