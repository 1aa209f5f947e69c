//! The objects of the EPOS4 that are used here, with type and unit. Names follow maxon's firmware specification.
//!
//! Velocities of the profile are in rpm of the motor shaft, accelerations in rpm/s, positions in quadcounts,
//! currents in mA: the drive's factory units (0x60A8 to 0x60AA).

use crate::canopen::object::Object;

/// CiA profile number 402 and the kind of drive.
pub const DEVICE_TYPE: Object<u32> = Object::new(0x1000, 0, "device type", "");
/// Bits of the errors that are present.
pub const ERROR_REGISTER: Object<u8> = Object::new(0x1001, 0, "error register", "");
/// How many errors are remembered; writing 0 clears them.
pub const ERROR_HISTORY_COUNT: Object<u8> = Object::new(0x1003, 0, "number of errors", "");
/// The newest remembered error.
pub const ERROR_HISTORY_NEWEST: Object<u32> = Object::new(0x1003, 1, "error history 1", "");
/// `node << 16 | timeout in ms` of the heartbeat that the drive expects; 0 is off.
pub const CONSUMER_HEARTBEAT_1: Object<u32> =
    Object::new(0x1016, 1, "consumer 1 heartbeat time", "");
/// Period of the drive's own heartbeat; 0 is off.
pub const PRODUCER_HEARTBEAT: Object<u16> = Object::new(0x1017, 0, "producer heartbeat time", "ms");
/// 0x000000FB for maxon.
pub const VENDOR_ID: Object<u32> = Object::new(0x1018, 1, "vendor id", "");
/// Hardware in the upper word, 0 in the lower: 0x60500000 is the Compact 24/1.5 CAN.
pub const PRODUCT_CODE: Object<u32> = Object::new(0x1018, 2, "product code", "");
/// Firmware in the upper word: 0x01700000 is 0x0170.
pub const REVISION_NUMBER: Object<u32> = Object::new(0x1018, 3, "revision number", "");
/// Of this very drive.
pub const SERIAL_NUMBER: Object<u32> = Object::new(0x1018, 4, "serial number", "");

/// Encoder increments a motor turn, four times the pulses.
pub const MAIN_SENSOR_RESOLUTION: Object<u32> =
    Object::new(0x3000, 5, "main sensor resolution", "inc/rev");
/// The motor's continuous current.
pub const NOMINAL_CURRENT: Object<u32> = Object::new(0x3001, 1, "nominal current", "mA");
/// What the drive never exceeds: the limit of force and torque.
pub const OUTPUT_CURRENT_LIMIT: Object<u32> = Object::new(0x3001, 2, "output current limit", "mA");
/// The position that the home point gets.
pub const HOME_POSITION: Object<i32> = Object::new(0x30B0, 0, "home position", "qc");
/// How far the axis moves away from the home point after it was found.
pub const HOME_OFFSET_MOVE_DISTANCE: Object<i32> =
    Object::new(0x30B1, 0, "home offset move distance", "qc");
/// The current that ends a homing by current threshold.
pub const HOMING_CURRENT_THRESHOLD: Object<u16> =
    Object::new(0x30B2, 0, "current threshold for homing mode", "mA");
/// Current, averaged over 10 ms.
pub const CURRENT_AVERAGED: Object<i32> =
    Object::new(0x30D1, 1, "current actual value averaged", "mA");
/// Current.
pub const CURRENT_ACTUAL: Object<i32> = Object::new(0x30D1, 2, "current actual value", "mA");
/// Velocity, averaged.
pub const VELOCITY_AVERAGED: Object<i32> =
    Object::new(0x30D3, 1, "velocity actual value averaged", "rpm");

/// The function of a digital input, 1 to 8: 0 negative limit switch, 1 positive limit switch, 2 home switch, 255 none.
pub const fn digital_input_function(input: u8) -> Object<u8> {
    Object::new(0x3142, input, "digital input configuration", "")
}

/// What the drive does when the communication is lost: 3 is quick stop, then disable.
pub const ABORT_CONNECTION_OPTION: Object<i16> =
    Object::new(0x6007, 0, "abort connection option code", "");
/// The newest error.
pub const ERROR_CODE: Object<u16> = Object::new(0x603F, 0, "error code", "");
/// Commands of CiA 402, see [`crate::cia402`].
pub const CONTROLWORD: Object<u16> = Object::new(0x6040, 0, "controlword", "");
/// State of CiA 402, see [`crate::cia402`].
pub const STATUSWORD: Object<u16> = Object::new(0x6041, 0, "statusword", "");
/// The mode asked for.
pub const MODES_OF_OPERATION: Object<i8> = Object::new(0x6060, 0, "modes of operation", "");
/// The mode in force.
pub const MODES_OF_OPERATION_DISPLAY: Object<i8> =
    Object::new(0x6061, 0, "modes of operation display", "");
/// Where the profile is.
pub const POSITION_DEMAND: Object<i32> = Object::new(0x6062, 0, "position demand value", "qc");
/// Where the motor is.
pub const POSITION_ACTUAL: Object<i32> = Object::new(0x6064, 0, "position actual value", "qc");
/// The largest lag behind the demand before error 0x8611.
pub const FOLLOWING_ERROR_WINDOW: Object<u32> =
    Object::new(0x6065, 0, "following error window", "qc");
/// Velocity.
pub const VELOCITY_ACTUAL: Object<i32> = Object::new(0x606C, 0, "velocity actual value", "rpm");
/// Where the profile goes.
pub const TARGET_POSITION: Object<i32> = Object::new(0x607A, 0, "target position", "qc");
/// Software limit; with the upper one 0 too it is off.
pub const MIN_POSITION_LIMIT: Object<i32> = Object::new(0x607D, 1, "min position limit", "qc");
/// Software limit; with the lower one 0 too it is off.
pub const MAX_POSITION_LIMIT: Object<i32> = Object::new(0x607D, 2, "max position limit", "qc");
/// Speed of the profile.
pub const PROFILE_VELOCITY: Object<u32> = Object::new(0x6081, 0, "profile velocity", "rpm");
/// Acceleration of the profile.
pub const PROFILE_ACCELERATION: Object<u32> =
    Object::new(0x6083, 0, "profile acceleration", "rpm/s");
/// Deceleration of the profile.
pub const PROFILE_DECELERATION: Object<u32> =
    Object::new(0x6084, 0, "profile deceleration", "rpm/s");
/// Deceleration of a quick stop.
pub const QUICK_STOP_DECELERATION: Object<u32> =
    Object::new(0x6085, 0, "quick stop deceleration", "rpm/s");
/// How the home point is found.
pub const HOMING_METHOD: Object<i8> = Object::new(0x6098, 0, "homing method", "");
/// Speed of the search for a switch or stop.
pub const HOMING_SPEED_SWITCH: Object<u32> =
    Object::new(0x6099, 1, "speed for switch search", "rpm");
/// Speed of the search for the edge or index.
pub const HOMING_SPEED_ZERO: Object<u32> = Object::new(0x6099, 2, "speed for zero search", "rpm");
/// Acceleration of homing.
pub const HOMING_ACCELERATION: Object<u32> = Object::new(0x609A, 0, "homing acceleration", "rpm/s");
/// Bits of the modes that the drive has.
pub const SUPPORTED_DRIVE_MODES: Object<u32> = Object::new(0x6502, 0, "supported drive modes", "");
