//! Addresses that the drive's own logic uses.

use epos4_link::canopen::object::Address;

macro_rules! addresses {
    ($($name:ident = $index:literal, $subindex:literal;)*) => {
        $(#[allow(missing_docs)] pub const $name: Address = Address::new($index, $subindex);)*
    };
}

addresses! {
    ERROR_REGISTER = 0x1001, 0;
    ERROR_HISTORY = 0x1003, 0;
    STORE_ALL = 0x1010, 1;
    RESTORE_ALL = 0x1011, 1;
    CONSUMER_HEARTBEAT_1 = 0x1016, 1;
    CONSUMER_HEARTBEAT_2 = 0x1016, 2;
    PRODUCER_HEARTBEAT = 0x1017, 0;
    SERIAL_NUMBER = 0x1018, 4;
    COMMUNICATION_ERROR_BEHAVIOUR = 0x1029, 1;
    NODE_ID = 0x2000, 0;
    MAIN_SENSOR_RESOLUTION = 0x3000, 5;
    NOMINAL_CURRENT = 0x3001, 1;
    OUTPUT_CURRENT_LIMIT = 0x3001, 2;
    TORQUE_CONSTANT = 0x3001, 5;
    GEAR_NUMERATOR = 0x3003, 1;
    GEAR_DENOMINATOR = 0x3003, 2;
    ENCODER_PULSES = 0x3010, 1;
    HOME_POSITION = 0x30B0, 0;
    HOME_OFFSET = 0x30B1, 0;
    HOMING_CURRENT_THRESHOLD = 0x30B2, 0;
    CURRENT_DEMAND = 0x30D0, 0;
    CURRENT_AVERAGED = 0x30D1, 1;
    CURRENT_ACTUAL = 0x30D1, 2;
    TORQUE_AVERAGED = 0x30D2, 1;
    VELOCITY_AVERAGED = 0x30D3, 1;
    STANDSTILL_WINDOW = 0x30E0, 1;
    STANDSTILL_TIME = 0x30E0, 2;
    STANDSTILL_TIMEOUT = 0x30E0, 3;
    INPUT_LEVELS = 0x3141, 1;
    INPUT_POLARITY = 0x3141, 2;
    INPUTS_BY_FUNCTION = 0x60FD, 0;
    ABORT_CONNECTION_OPTION = 0x6007, 0;
    ERROR_CODE = 0x603F, 0;
    CONTROLWORD = 0x6040, 0;
    STATUSWORD = 0x6041, 0;
    SHUTDOWN_OPTION = 0x605B, 0;
    DISABLE_OPTION = 0x605C, 0;
    FAULT_REACTION_OPTION = 0x605E, 0;
    MODE = 0x6060, 0;
    MODE_DISPLAY = 0x6061, 0;
    POSITION_DEMAND = 0x6062, 0;
    POSITION_ACTUAL = 0x6064, 0;
    FOLLOWING_WINDOW = 0x6065, 0;
    POSITION_WINDOW = 0x6067, 0;
    POSITION_WINDOW_TIME = 0x6068, 0;
    VELOCITY_DEMAND = 0x606B, 0;
    VELOCITY_ACTUAL = 0x606C, 0;
    TARGET_TORQUE = 0x6071, 0;
    RATED_TORQUE = 0x6076, 0;
    TORQUE_ACTUAL = 0x6077, 0;
    TARGET_POSITION = 0x607A, 0;
    MIN_POSITION = 0x607D, 1;
    MAX_POSITION = 0x607D, 2;
    MAX_PROFILE_VELOCITY = 0x607F, 0;
    MAX_MOTOR_SPEED = 0x6080, 0;
    PROFILE_VELOCITY = 0x6081, 0;
    PROFILE_ACCELERATION = 0x6083, 0;
    PROFILE_DECELERATION = 0x6084, 0;
    QUICK_STOP_DECELERATION = 0x6085, 0;
    HOMING_METHOD = 0x6098, 0;
    HOMING_SPEED_SWITCH = 0x6099, 1;
    HOMING_SPEED_ZERO = 0x6099, 2;
    HOMING_ACCELERATION = 0x609A, 0;
    MAX_ACCELERATION = 0x60C5, 0;
    SENSOR_POSITION = 0x60E4, 1;
    SENSOR_VELOCITY = 0x60E5, 1;
    FOLLOWING_ERROR = 0x60F4, 0;
    TARGET_VELOCITY = 0x60FF, 0;
}

/// The function of a digital input, counted from 1.
#[must_use]
pub const fn input_function(input: u8) -> Address {
    Address::new(0x3142, input)
}

/// A remembered error, 1 is the newest.
#[must_use]
pub const fn error_history(place: u8) -> Address {
    Address::new(0x1003, place)
}
