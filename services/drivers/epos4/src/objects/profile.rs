//! Objects of the drive profile CiA 402, 0x6000 to 0x6FFF.

use super::{HOMING_METHODS, objects};
use crate::entry::Rules;

const U32_MAX: i64 = u32::MAX as i64;

/// Profile position, profile velocity, homing, and the three cyclic modes.
const MODES: &[i64] = &[1, 3, 6, 8, 9, 10];

objects! {
    /// What the drive does when the communication is lost: 2 disables, 3 is quick stop, then disable.
    ABORT_CONNECTION_OPTION: i16 = 0x6007, 0, "abort connection option code", "", Rules::rw(3).between(2, 3);
    /// The newest error.
    ERROR_CODE: u16 = 0x603F, 0, "error code", "", Rules::ro(0).tx();
    /// Commands of CiA 402, see [`crate::cia402`].
    CONTROLWORD: u16 = 0x6040, 0, "controlword", "", Rules::rw(0).rx();
    /// State of CiA 402, see [`crate::cia402`].
    STATUSWORD: u16 = 0x6041, 0, "statusword", "", Rules::ro(0x0040).tx();
    /// Only 6 is legal: brake on the quick stop ramp and stay.
    QUICK_STOP_OPTION: i16 = 0x605A, 0, "quick stop option code", "", Rules::rw(6).one_of(&[6]);
    /// 0 power off at once, 1 brake first.
    SHUTDOWN_OPTION: i16 = 0x605B, 0, "shutdown option code", "", Rules::rw(0).between(0, 1);
    /// 0 power off at once, 1 brake first.
    DISABLE_OPERATION_OPTION: i16 = 0x605C, 0, "disable operation option code", "", Rules::rw(1).between(0, 1);
    /// 0 disable, 1 brake as in the profile, 2 brake on the quick stop ramp.
    FAULT_REACTION_OPTION: i16 = 0x605E, 0, "fault reaction option code", "", Rules::rw(2).between(0, 2);
    /// The mode asked for.
    MODES_OF_OPERATION: i8 = 0x6060, 0, "modes of operation", "", Rules::rw(1).one_of(MODES).rx();
    /// The mode in force.
    MODES_OF_OPERATION_DISPLAY: i8 = 0x6061, 0, "modes of operation display", "", Rules::ro(1).tx();
    /// Where the profile is.
    POSITION_DEMAND: i32 = 0x6062, 0, "position demand value", "qc", Rules::ro(0).tx();
    /// Where the motor is.
    POSITION_ACTUAL: i32 = 0x6064, 0, "position actual value", "qc", Rules::ro(0).tx();
    /// The largest lag behind the demand before error 0x8611; 0xFFFFFFFF is off.
    FOLLOWING_ERROR_WINDOW: u32 = 0x6065, 0, "following error window", "qc", Rules::rw(2000).rx();
    /// Fixed.
    FOLLOWING_ERROR_TIMEOUT: u16 = 0x6066, 0, "following error timeout", "ms", Rules::rw(0).one_of(&[0]).rx();
    /// How near the target counts as reached; 0xFFFFFFFF is off: the end of the profile counts.
    POSITION_WINDOW: u32 = 0x6067, 0, "position window", "qc", Rules::rw(U32_MAX).rx();
    /// For how long.
    POSITION_WINDOW_TIME: u16 = 0x6068, 0, "position window time", "ms", Rules::rw(0).rx();
    /// What the profile asks for.
    VELOCITY_DEMAND: i32 = 0x606B, 0, "velocity demand value", "rpm", Rules::ro(0).tx();
    /// Velocity.
    VELOCITY_ACTUAL: i32 = 0x606C, 0, "velocity actual value", "rpm", Rules::ro(0).tx();
    /// Of the cyclic torque mode, of the motor's rated torque.
    TARGET_TORQUE: i16 = 0x6071, 0, "target torque", "0.1 %", Rules::rw(0).rx();
    /// Nominal current times torque constant.
    RATED_TORQUE: u32 = 0x6076, 0, "motor rated torque", "uNm", Rules::ro(0);
    /// Torque.
    TORQUE_ACTUAL: i16 = 0x6077, 0, "torque actual value", "0.1 %", Rules::ro(0).tx();
    /// Where the profile goes.
    TARGET_POSITION: i32 = 0x607A, 0, "target position", "qc", Rules::rw(0).rx();
    /// Fixed.
    MIN_POSITION_RANGE: i32 = 0x607B, 1, "min position range limit", "qc", Rules::rw(0).one_of(&[0]).rx();
    /// Fixed.
    MAX_POSITION_RANGE: i32 = 0x607B, 2, "max position range limit", "qc", Rules::rw(0).one_of(&[0]).rx();
    /// Software limit; with the upper one 0 too it is off.
    MIN_POSITION_LIMIT: i32 = 0x607D, 1, "min position limit", "qc", Rules::rw(0).rx();
    /// Software limit; with the lower one 0 too it is off.
    MAX_POSITION_LIMIT: i32 = 0x607D, 2, "max position limit", "qc", Rules::rw(0).rx();
    /// What no profile exceeds.
    MAX_PROFILE_VELOCITY: u32 = 0x607F, 0, "max profile velocity", "rpm", Rules::rw(50_000).rx();
    /// What the motor stands.
    MAX_MOTOR_SPEED: u32 = 0x6080, 0, "max motor speed", "rpm", Rules::rw(50_000).rx();
    /// Speed of the profile.
    PROFILE_VELOCITY: u32 = 0x6081, 0, "profile velocity", "rpm", Rules::rw(1000).rx();
    /// Acceleration of the profile.
    PROFILE_ACCELERATION: u32 = 0x6083, 0, "profile acceleration", "rpm/s", Rules::rw(10_000).between(1, U32_MAX).rx();
    /// Deceleration of the profile.
    PROFILE_DECELERATION: u32 = 0x6084, 0, "profile deceleration", "rpm/s", Rules::rw(10_000).between(1, U32_MAX).rx();
    /// Deceleration of a quick stop.
    QUICK_STOP_DECELERATION: u32 = 0x6085, 0, "quick stop deceleration", "rpm/s", Rules::rw(10_000).between(1, U32_MAX).rx();
    /// Only 0 is legal: a trapezoid.
    MOTION_PROFILE_TYPE: i16 = 0x6086, 0, "motion profile type", "", Rules::rw(0).one_of(&[0]).rx();
    /// How the home point is found.
    HOMING_METHOD: i8 = 0x6098, 0, "homing method", "", Rules::rw(7).one_of(HOMING_METHODS).rx();
    /// Speed of the search for a switch or stop.
    HOMING_SPEED_SWITCH: u32 = 0x6099, 1, "speed for switch search", "rpm", Rules::rw(100).rx();
    /// Speed of the search for the edge or index.
    HOMING_SPEED_ZERO: u32 = 0x6099, 2, "speed for zero search", "rpm", Rules::rw(10).rx();
    /// Acceleration of homing.
    HOMING_ACCELERATION: u32 = 0x609A, 0, "homing acceleration", "rpm/s", Rules::rw(1000).between(1, U32_MAX).rx();
    /// Increments.
    SI_UNIT_POSITION: u32 = 0x60A8, 0, "si unit position", "", Rules::rw(0x00B5_0000).one_of(&[0x00B5_0000]).power_off();
    /// rpm.
    SI_UNIT_VELOCITY: u32 = 0x60A9, 0, "si unit velocity", "", Rules::rw(0x00B4_4700).one_of(&[0x00B4_4700]).power_off();
    /// rpm/s.
    SI_UNIT_ACCELERATION: u32 = 0x60AA, 0, "si unit acceleration", "", Rules::rw(0x00C0_0300).one_of(&[0x00C0_0300]).power_off();
    /// Added to the target of the cyclic position mode.
    POSITION_OFFSET: i32 = 0x60B0, 0, "position offset", "qc", Rules::rw(0).rx();
    /// Added to the target of the cyclic velocity mode.
    VELOCITY_OFFSET: i32 = 0x60B1, 0, "velocity offset", "rpm", Rules::rw(0).rx();
    /// Added to the target of the cyclic torque mode.
    TORQUE_OFFSET: i16 = 0x60B2, 0, "torque offset", "0.1 %", Rules::rw(0).rx();
    /// Between two targets of the cyclic modes, the period of SYNC; 0 takes each target at once.
    INTERPOLATION_PERIOD: u8 = 0x60C2, 1, "interpolation time period value", "ms", Rules::rw(0).between(0, 100).rx();
    /// Power of ten of its unit, s.
    INTERPOLATION_INDEX: i8 = 0x60C2, 2, "interpolation time index", "", Rules::rw(-3).one_of(&[-3]).rx();
    /// What no profile exceeds.
    MAX_ACCELERATION: u32 = 0x60C5, 0, "max acceleration", "rpm/s", Rules::rw(U32_MAX).between(1, U32_MAX).rx();
    /// As sensor 1 counts.
    SENSOR_POSITION: i32 = 0x60E4, 1, "additional position actual value sensor 1", "qc", Rules::ro(0).tx();
    /// As sensor 1 measures.
    SENSOR_VELOCITY: i32 = 0x60E5, 1, "additional velocity actual value sensor 1", "rpm", Rules::ro(0).tx();
    /// Demand less actual.
    FOLLOWING_ERROR: i32 = 0x60F4, 0, "following error actual value", "qc", Rules::ro(0).tx();
    /// The inputs by function, after the polarity: bit n is function n of 0x3142.
    DIGITAL_INPUTS: u32 = 0x60FD, 0, "digital inputs", "", Rules::ro(0).tx();
    /// The outputs by function.
    DIGITAL_OUTPUTS: u32 = 0x60FE, 1, "digital outputs", "", Rules::rw(0).rx();
    /// Of the velocity modes.
    TARGET_VELOCITY: i32 = 0x60FF, 0, "target velocity", "rpm", Rules::rw(0).rx();
    /// 1 DC with brushes, 10 sinus, 11 block commutated.
    MOTOR_TYPE: u16 = 0x6402, 0, "motor type", "", Rules::rw(10).one_of(&[1, 10, 11]).power_off();
    /// Bits of the modes that the drive has.
    SUPPORTED_DRIVE_MODES: u32 = 0x6502, 0, "supported drive modes", "", Rules::ro(0x0000_03A5).tx();
}
