//! The objects that govern motion, read out of the dictionary and brought to quadcounts, seconds and milliamperes.

use super::objects::Objects;
use epos4_link::objects;

/// A snapshot, taken before each piece of work.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// Speeds of the dictionary are in rpm of the motor.
    pub qc_s_per_rpm: f64,
    /// Of position and velocity profiles.
    pub profile: Profile,
    /// Quick stop.
    pub quick_stop_qc_s2: f64,
    /// No demand exceeds it.
    pub max_speed_qc_s: f64,
    /// Acceleration of the cyclic velocity mode.
    pub max_acceleration_qc_s2: f64,
    /// The lag that is error 0x8611; none when off.
    pub following_window_qc: Option<f64>,
    /// How near the target counts as reached, and for how long, s; none when the end of the profile counts.
    pub position_window: Option<(f64, f64)>,
    /// Software limits, user coordinates; none when both are 0.
    pub position_limits_qc: Option<(f64, f64)>,
    /// 0x605B.
    pub shutdown_option: i64,
    /// 0x605C.
    pub disable_option: i64,
    /// 0x605E.
    pub fault_reaction_option: i64,
    /// 0x6007.
    pub abort_connection_option: i64,
    /// Targets.
    pub target_position_qc: f64,
    /// 0x60FF.
    pub target_speed_qc_s: f64,
    /// 0x6071 and 0x60B2 as a current.
    pub target_current_ma: f64,
    /// 0x60B0, for the cyclic position mode.
    pub position_offset_qc: f64,
    /// 0x60B1, for the cyclic velocity mode.
    pub speed_offset_qc_s: f64,
    /// 0x60C2; 0 takes each target of the cyclic position mode at once.
    pub interpolation_period_s: f64,
    /// 0x3001:01.
    pub nominal_current_ma: f64,
    /// 0x3001:02.
    pub current_limit_ma: f64,
    /// 0x3001:04.
    pub thermal_time_constant_s: f64,
    /// Whether the encoder has an index, 0x3010:02.
    pub has_index: bool,
    /// When the shaft counts as standing.
    pub standstill: Standstill,
    /// Homing.
    pub homing: HomingParameters,
    /// Functions of digital inputs 1 to 8, 0x3142.
    pub input_functions: [i64; 8],
    /// 0x3141:02.
    pub input_polarity: u16,
}

/// A trapezoidal velocity profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    /// Cruising speed.
    pub speed_qc_s: f64,
    /// Speeding up.
    pub acceleration_qc_s2: f64,
    /// Slowing down.
    pub deceleration_qc_s2: f64,
}

/// 0x30E0.
#[derive(Clone, Copy, Debug)]
pub struct Standstill {
    /// Slower than this is standing.
    pub window_qc_s: f64,
    /// For this long.
    pub time_s: f64,
    /// After this long a transition goes on regardless.
    pub timeout_s: f64,
}

/// 0x6098, 0x6099, 0x609A, 0x30B0 to 0x30B2.
#[derive(Clone, Copy, Debug)]
pub struct HomingParameters {
    /// Method.
    pub method: i64,
    /// Towards a switch or stop.
    pub switch_search: Profile,
    /// Towards an edge or index.
    pub zero_search: Profile,
    /// The value given to the home point.
    pub position_qc: f64,
    /// Distance from where the reference was found to the home point.
    pub offset_qc: f64,
    /// The current that counts as a stop.
    pub current_threshold_ma: f64,
}

impl Parameters {
    /// Reads the dictionary.
    #[must_use]
    pub fn of(objects: &Objects) -> Self {
        let number = |address| objects.get(address) as f64;
        let seconds = |address| objects.get(address) as f64 / 1000.0;
        let qc_s_per_rpm = number(objects::MAIN_SENSOR_RESOLUTION.address) / 60.0;
        let max_speed_rpm = number(objects::MAX_PROFILE_VELOCITY.address)
            .min(number(objects::MAX_MOTOR_SPEED.address));
        let profile = |speed, acceleration, deceleration| Profile {
            speed_qc_s: number(speed).min(max_speed_rpm) * qc_s_per_rpm,
            acceleration_qc_s2: number(acceleration) * qc_s_per_rpm,
            deceleration_qc_s2: number(deceleration) * qc_s_per_rpm,
        };
        let homing_profile = |speed| {
            profile(
                speed,
                objects::HOMING_ACCELERATION.address,
                objects::HOMING_ACCELERATION.address,
            )
        };
        let unlimited = i64::from(u32::MAX);
        let window = objects.get(objects::FOLLOWING_ERROR_WINDOW.address);
        let reached = objects.get(objects::POSITION_WINDOW.address);
        let (low, high) = (
            number(objects::MIN_POSITION_LIMIT.address),
            number(objects::MAX_POSITION_LIMIT.address),
        );
        let torque_constant_unm_a = number(objects::TORQUE_CONSTANT.address).max(1.0);
        Self {
            qc_s_per_rpm,
            profile: profile(
                objects::PROFILE_VELOCITY.address,
                objects::PROFILE_ACCELERATION.address,
                objects::PROFILE_DECELERATION.address,
            ),
            quick_stop_qc_s2: number(objects::QUICK_STOP_DECELERATION.address) * qc_s_per_rpm,
            max_speed_qc_s: max_speed_rpm * qc_s_per_rpm,
            max_acceleration_qc_s2: number(objects::MAX_ACCELERATION.address) * qc_s_per_rpm,
            following_window_qc: (window != unlimited).then_some(window as f64),
            position_window: (reached != unlimited).then(|| {
                (
                    reached as f64,
                    seconds(objects::POSITION_WINDOW_TIME.address),
                )
            }),
            position_limits_qc: (low != 0.0 || high != 0.0).then_some((low, high)),
            shutdown_option: objects.get(objects::SHUTDOWN_OPTION.address),
            disable_option: objects.get(objects::DISABLE_OPERATION_OPTION.address),
            fault_reaction_option: objects.get(objects::FAULT_REACTION_OPTION.address),
            abort_connection_option: objects.get(objects::ABORT_CONNECTION_OPTION.address),
            target_position_qc: number(objects::TARGET_POSITION.address),
            target_speed_qc_s: number(objects::TARGET_VELOCITY.address)
                .clamp(-max_speed_rpm, max_speed_rpm)
                * qc_s_per_rpm,
            // per mille of uNm, over uNm/A, is mA
            target_current_ma: (number(objects::TARGET_TORQUE.address)
                + number(objects::TORQUE_OFFSET.address))
                * number(objects::RATED_TORQUE.address)
                / torque_constant_unm_a,
            position_offset_qc: number(objects::POSITION_OFFSET.address),
            speed_offset_qc_s: number(objects::VELOCITY_OFFSET.address) * qc_s_per_rpm,
            interpolation_period_s: seconds(objects::INTERPOLATION_PERIOD.address),
            nominal_current_ma: number(objects::NOMINAL_CURRENT.address),
            current_limit_ma: number(objects::OUTPUT_CURRENT_LIMIT.address),
            thermal_time_constant_s: number(objects::THERMAL_TIME_CONSTANT.address) / 10.0,
            has_index: objects.get(objects::ENCODER_TYPE.address) == 1,
            standstill: Standstill {
                window_qc_s: number(objects::STANDSTILL_WINDOW.address) * qc_s_per_rpm,
                time_s: seconds(objects::STANDSTILL_TIME.address),
                timeout_s: seconds(objects::STANDSTILL_TIMEOUT.address),
            },
            homing: HomingParameters {
                method: objects.get(objects::HOMING_METHOD.address),
                switch_search: homing_profile(objects::HOMING_SPEED_SWITCH.address),
                zero_search: homing_profile(objects::HOMING_SPEED_ZERO.address),
                position_qc: number(objects::HOME_POSITION.address),
                offset_qc: number(objects::HOME_OFFSET_MOVE_DISTANCE.address),
                current_threshold_ma: number(objects::HOMING_CURRENT_THRESHOLD.address),
            },
            input_functions: std::array::from_fn(|input| {
                objects.get(objects::digital_input_function(input as u8 + 1).address)
            }),
            input_polarity: objects.get(objects::INPUT_POLARITY.address) as u16,
        }
    }
}
