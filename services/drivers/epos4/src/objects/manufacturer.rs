//! maxon's own objects, 0x2000 to 0x3FFF.

use super::objects;
use crate::entry::Rules;

const U32_MAX: i64 = u32::MAX as i64;

objects! {
    /// Set by the DIP switches.
    NODE_ID: u8 = 0x2000, 0, "node id", "", Rules::ro(0).plus_node_id();
    /// Code of the bit rate; 9 detects it.
    BIT_RATE: u8 = 0x2001, 0, "can bit rate", "", Rules::rw(9).between(0, 9);
    /// Of the power stage.
    SUPPLY_VOLTAGE: u16 = 0x2200, 1, "power supply voltage", "0.1 V", Rules::ro(240);
    /// Below it the drive raises 0x3220.
    UNDERVOLTAGE_LIMIT: u32 = 0x2201, 1, "undervoltage limit", "mV", Rules::rw(8_000).between(8_000, 28_500);
    /// Above it the drive raises 0x3210.
    OVERVOLTAGE_LIMIT: u32 = 0x2201, 2, "overvoltage limit", "mV", Rules::rw(32_000);
    /// Types of sensors 1 to 3, a byte each from the lowest: 1 is a digital incremental encoder.
    SENSORS_CONFIGURATION: u32 = 0x3000, 1, "sensors configuration", "", Rules::rw(0x0010_0001).power_off();
    /// A nibble each from the lowest: current, velocity and position control, gear, main sensor.
    CONTROL_STRUCTURE: u32 = 0x3000, 2, "control structure", "", Rules::rw(0x0001_0111).power_off();
    /// 0 for a motor with brushes.
    COMMUTATION_SENSORS: u32 = 0x3000, 3, "commutation sensors", "", Rules::rw(0x31).power_off();
    /// Bits of the axis.
    AXIS_MISCELLANEOUS: u32 = 0x3000, 4, "axis configuration miscellaneous", "", Rules::rw(0).power_off();
    /// Encoder increments a motor turn, four times the pulses.
    MAIN_SENSOR_RESOLUTION: u32 = 0x3000, 5, "main sensor resolution", "inc/rev", Rules::ro(2000);
    /// What sensors and controller allow.
    MAX_SYSTEM_SPEED: u32 = 0x3000, 6, "max system speed", "rpm", Rules::ro(50_000);
    /// The motor's continuous current.
    NOMINAL_CURRENT: u32 = 0x3001, 1, "nominal current", "mA", Rules::rw(1500).between(0, 1500).rx();
    /// What the drive never exceeds: the limit of force and torque.
    OUTPUT_CURRENT_LIMIT: u32 = 0x3001, 2, "output current limit", "mA", Rules::rw(4500).between(0, 4500).rx();
    /// Of the motor.
    POLE_PAIRS: u8 = 0x3001, 3, "number of pole pairs", "", Rules::rw(1).between(1, 255).power_off();
    /// Of the winding, for the I2t model.
    THERMAL_TIME_CONSTANT: u16 = 0x3001, 4, "thermal time constant winding", "0.1 s", Rules::rw(40).between(1, 10_000);
    /// Of the motor.
    TORQUE_CONSTANT: u32 = 0x3001, 5, "motor torque constant", "uNm/A", Rules::rw(0).between(0, 10_000_000);
    /// Of the winding.
    RESISTANCE: u32 = 0x3002, 1, "electrical resistance", "mOhm", Rules::rw(0);
    /// Of the winding.
    INDUCTANCE: u16 = 0x3002, 2, "electrical inductance", "uH", Rules::rw(0);
    /// Motor turns of the gear's ratio.
    GEAR_NUMERATOR: u32 = 0x3003, 1, "gear reduction numerator", "", Rules::rw(1).between(1, U32_MAX).power_off();
    /// Output turns of the gear's ratio.
    GEAR_DENOMINATOR: u32 = 0x3003, 2, "gear reduction denominator", "", Rules::rw(1).between(1, U32_MAX).power_off();
    /// What the gear stands.
    MAX_GEAR_SPEED: u32 = 0x3003, 3, "max gear input speed", "rpm", Rules::rw(100_000).between(1, 100_000);
    /// Bit 0: the output turns the other way round.
    GEAR_CONFIGURATION: u32 = 0x3003, 4, "gear miscellaneous configuration", "", Rules::rw(0).between(0, 1).power_off();
    /// A motor turn.
    ENCODER_PULSES: u32 = 0x3010, 1, "encoder number of pulses", "inc/rev", Rules::rw(500).between(16, 2_500_000).power_off();
    /// 0 without index, 1 with index.
    ENCODER_TYPE: u16 = 0x3010, 2, "encoder type", "", Rules::rw(1).power_off();
    /// Where the index was seen last.
    ENCODER_INDEX_POSITION: i32 = 0x3010, 4, "encoder index position", "qc", Rules::ro(0).tx();
    /// Of the current controller.
    CURRENT_GAIN_P: u32 = 0x30A0, 1, "current controller p gain", "uV/A", Rules::rw(1_171_880).rx();
    /// Of the current controller.
    CURRENT_GAIN_I: u32 = 0x30A0, 2, "current controller i gain", "uV/(A ms)", Rules::rw(3_906_250).rx();
    /// Of the position controller.
    POSITION_GAIN_P: u32 = 0x30A1, 1, "position controller p gain", "uA/rad", Rules::rw(1_500_000).rx();
    /// Of the position controller.
    POSITION_GAIN_I: u32 = 0x30A1, 2, "position controller i gain", "uA/(rad s)", Rules::rw(780_000).rx();
    /// Of the position controller.
    POSITION_GAIN_D: u32 = 0x30A1, 3, "position controller d gain", "uA s/rad", Rules::rw(16_000).rx();
    /// Of the velocity controller.
    VELOCITY_GAIN_P: u32 = 0x30A2, 1, "velocity controller p gain", "uA s/rad", Rules::rw(20_000).rx();
    /// Of the velocity controller.
    VELOCITY_GAIN_I: u32 = 0x30A2, 2, "velocity controller i gain", "uA/rad", Rules::rw(500_000).rx();
    /// The position that the home point gets.
    HOME_POSITION: i32 = 0x30B0, 0, "home position", "qc", Rules::rw(0).rx();
    /// How far the axis moves away from the home point after it was found.
    HOME_OFFSET_MOVE_DISTANCE: i32 = 0x30B1, 0, "home offset move distance", "qc", Rules::rw(0);
    /// The current that ends a homing by current threshold.
    HOMING_CURRENT_THRESHOLD: u16 = 0x30B2, 0, "current threshold for homing mode", "mA", Rules::rw(500).between(0, 4500).rx();
    /// What the controller asks for.
    CURRENT_DEMAND: i32 = 0x30D0, 0, "current demand value", "mA", Rules::ro(0).tx();
    /// Current, averaged over 10 ms.
    CURRENT_AVERAGED: i32 = 0x30D1, 1, "current actual value averaged", "mA", Rules::ro(0).tx();
    /// Current.
    CURRENT_ACTUAL: i32 = 0x30D1, 2, "current actual value", "mA", Rules::ro(0).tx();
    /// Torque, averaged.
    TORQUE_AVERAGED: i16 = 0x30D2, 1, "torque actual value averaged", "0.1 %", Rules::ro(0).tx();
    /// Velocity, averaged.
    VELOCITY_AVERAGED: i32 = 0x30D3, 1, "velocity actual value averaged", "rpm", Rules::ro(0).tx();
    /// Slower than this is standing; 0xFFFFFFFF is off.
    STANDSTILL_WINDOW: u32 = 0x30E0, 1, "standstill window", "rpm", Rules::rw(30);
    /// For this long.
    STANDSTILL_TIME: u16 = 0x30E0, 2, "standstill window time", "ms", Rules::rw(2);
    /// After this long a transition goes on regardless.
    STANDSTILL_TIMEOUT: u16 = 0x30E0, 3, "standstill window timeout", "ms", Rules::rw(1000);
    /// Levels of the inputs, bit 0 is input 1, before the polarity.
    INPUT_LEVELS: u16 = 0x3141, 1, "digital input logic state", "", Rules::ro(0).tx();
    /// Bits of the inputs that are active when low.
    INPUT_POLARITY: u16 = 0x3141, 2, "digital input polarity", "", Rules::rw(0);
    /// Levels of the outputs, bit 0 is output 1.
    OUTPUT_LEVELS: u16 = 0x3150, 1, "digital output logic state", "", Rules::ro(0).tx();
    /// Bits of the outputs that are active when low.
    OUTPUT_POLARITY: u16 = 0x3150, 2, "digital output polarity", "", Rules::rw(0);
    /// Function of output 1: 16 and 17 general purpose A and B, 24 holding brake, 25 ready or fault, 255 none.
    OUTPUT_FUNCTION_1: u8 = 0x3151, 1, "digital output function 1", "", Rules::rw(16).one_of(&[16, 17, 24, 25, 255]);
    /// Function of output 2.
    OUTPUT_FUNCTION_2: u8 = 0x3151, 2, "digital output function 2", "", Rules::rw(17).one_of(&[16, 17, 24, 25, 255]);
    /// Function of the high-speed output 1.
    OUTPUT_FUNCTION_3: u8 = 0x3151, 3, "digital output function 3", "", Rules::rw(255).one_of(&[16, 17, 24, 25, 255]);
    /// How long the holding brake takes to open.
    BRAKE_RISE_TIME: u16 = 0x3158, 1, "holding brake rise time", "ms", Rules::rw(10).between(0, 5000);
    /// How long it takes to close.
    BRAKE_FALL_TIME: u16 = 0x3158, 2, "holding brake fall time", "ms", Rules::rw(10).between(0, 5000);
    /// Whether it is closed.
    BRAKE_STATE: u8 = 0x3158, 3, "holding brake state", "", Rules::ro(0);
    /// Analog input 1.
    ANALOG_INPUT_1: i16 = 0x3160, 1, "analog input 1 voltage", "mV", Rules::ro(0).tx();
    /// Analog input 2.
    ANALOG_INPUT_2: i16 = 0x3160, 2, "analog input 2 voltage", "mV", Rules::ro(0).tx();
    /// How much of the motor's thermal reserve is used; at 100 % the current is limited to the nominal one.
    I2T_MOTOR: u16 = 0x3200, 1, "i2t level motor", "%", Rules::ro(0).tx();
    /// Likewise of the power stage.
    I2T_POWER_STAGE: u16 = 0x3200, 2, "i2t level power stage", "%", Rules::ro(0).tx();
    /// Temperature of the power stage.
    POWER_STAGE_TEMPERATURE: i16 = 0x3201, 1, "temperature power stage", "0.1 C", Rules::ro(300);
    /// Above it the drive raises 0x4210.
    MAX_POWER_STAGE_TEMPERATURE: u16 = 0x3201, 4, "max temperature power stage", "0.1 C", Rules::rw(1000).between(0, 1000);
    /// Bits 0 and 1: the two inputs of safe torque off carry voltage. The motor has torque only with both.
    STO_INPUTS: u8 = 0x3202, 1, "sto input states", "", Rules::ro(3);
}
