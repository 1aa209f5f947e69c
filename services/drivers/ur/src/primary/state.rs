//! The robot's state as the primary and secondary interfaces send it, in sub-packages of which not every packet has all.
//! Units are the controller's: m, rad, s, V, A, °C, N.

use super::wire::{Body, Error, cut};
use crate::{RobotMode, SafetyMode};

/// One packet of state. Kinematics and configuration come when a connection begins and when they change.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RobotState {
    /// Sub-package 0.
    pub mode: Option<Mode>,
    /// 1: base, shoulder, elbow, wrist 1, 2, 3.
    pub joints: Option<[Joint; 6]>,
    /// 2
    pub tool: Option<Tool>,
    /// 3
    pub masterboard: Option<Masterboard>,
    /// 4
    pub cartesian: Option<Cartesian>,
    /// 5
    pub kinematics: Option<Kinematics>,
    /// 6
    pub configuration: Option<Configuration>,
    /// 7
    pub force: Option<Force>,
    /// Sub-packages that were passed over, one bit for each type up to 31.
    pub passed_over: u32,
}

/// Power, program and speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Controller clock, microseconds.
    pub timestamp_us: u64,
    /// There is an arm.
    pub connected: bool,
    /// It may be powered.
    pub enabled: bool,
    /// It is powered.
    pub power_on: bool,
    /// An emergency stop button is pressed.
    pub emergency_stopped: bool,
    /// Protective stop.
    pub protective_stopped: bool,
    /// A program runs.
    pub program_running: bool,
    /// A program is paused.
    pub program_paused: bool,
    /// Power and brakes.
    pub robot_mode: RobotMode,
    /// 0 position, 1 teach, 2 force, 3 torque.
    pub control_mode: u8,
    /// 0..1: the speed slider.
    pub target_speed_fraction: f64,
    /// 0..1: the share of nominal speed at which trajectories advance.
    pub speed_scaling: f64,
    /// Most the slider allows; since 3.2.
    pub target_speed_fraction_limit: Option<f64>,
}

/// One joint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Joint {
    /// Measured, rad.
    pub actual_q: f64,
    /// Commanded, rad.
    pub target_q: f64,
    /// Measured, rad/s.
    pub actual_qd: f64,
    /// A.
    pub current_a: f32,
    /// V.
    pub voltage_v: f32,
    /// °C.
    pub motor_temperature_c: f32,
    /// 253 running, 255 idle, 252 fault, 239 no power...
    pub mode: u8,
}

/// The tool's connector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tool {
    /// Range of each analog input.
    pub input_ranges: [u8; 2],
    /// Analog inputs.
    pub inputs: [f64; 2],
    /// V.
    pub supply_v: f32,
    /// 0, 12 or 24 V.
    pub output_voltage_v: u8,
    /// A.
    pub current_a: f32,
    /// °C.
    pub temperature_c: f32,
    /// As a joint's.
    pub mode: u8,
}

/// The control box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Masterboard {
    /// Digital inputs.
    pub inputs: u32,
    /// Digital outputs.
    pub outputs: u32,
    /// Range of each analog input.
    pub input_ranges: [u8; 2],
    /// Analog inputs.
    pub analog_inputs: [f64; 2],
    /// 0 current, 1 voltage of each analog output.
    pub output_domains: [i8; 2],
    /// Analog outputs.
    pub analog_outputs: [f64; 2],
    /// °C.
    pub temperature_c: f32,
    /// V.
    pub robot_voltage_v: f32,
    /// A.
    pub robot_current_a: f32,
    /// A.
    pub io_current_a: f32,
    /// What the safety system allows.
    pub safety_mode: SafetyMode,
    /// Reduced limits.
    pub reduced: bool,
}

/// The tool in the base's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cartesian {
    /// Base from tool: m and rotation vector.
    pub base_from_tool: [f64; 6],
    /// Flange from tool: m and rotation vector; since 3.1.
    pub flange_from_tool: Option<[f64; 6]>,
}

/// Denavit-Hartenberg parameters of this very arm, standard convention: the drawing's and the calibration's together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kinematics {
    /// Tells calibrations apart.
    pub checksum: [u32; 6],
    /// rad.
    pub dh_theta: [f64; 6],
    /// m.
    pub dh_a: [f64; 6],
    /// m.
    pub dh_d: [f64; 6],
    /// rad.
    pub dh_alpha: [f64; 6],
    /// As the controller numbers it; the numbers are not documented.
    pub status: u32,
}

/// What the arm is and may do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Configuration {
    /// Least and greatest position of each joint, rad.
    pub position_limits: [[f64; 2]; 6],
    /// Greatest speed, rad/s, and acceleration, rad/s^2, of each joint.
    pub motion_limits: [[f64; 2]; 6],
    /// Speed of `movej` by default, rad/s.
    pub joint_speed: f64,
    /// Acceleration of `movej` by default, rad/s^2.
    pub joint_acceleration: f64,
    /// Speed of `movel` by default, m/s.
    pub tool_speed: f64,
    /// Acceleration of `movel` by default, m/s^2.
    pub tool_acceleration: f64,
    /// m that count as one rad of the tool.
    pub equivalent_radius: f64,
    /// Of the drawing, m.
    pub dh_a: [f64; 6],
    /// Of the drawing, m.
    pub dh_d: [f64; 6],
    /// Of the drawing, rad.
    pub dh_alpha: [f64; 6],
    /// Of the drawing, rad.
    pub dh_theta: [f64; 6],
    /// Version of the control box.
    pub masterboard_version: i32,
    /// Type of the control box.
    pub box_type: i32,
    /// 1 UR5, 2 UR10, 3 UR3, 4 UR16, 7 UR20.
    pub robot_type: i32,
    /// Tells makes of the same size apart.
    pub robot_sub_type: i32,
}

/// Force at the tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Force {
    /// N and Nm.
    pub wrench: [f64; 6],
    /// How far from a singularity.
    pub dexterity: f64,
}

impl RobotState {
    /// Reads the body of a state packet.
    ///
    /// # Errors
    /// Sub-packages that do not fit their packet, or are shorter than their fields.
    pub fn decode(mut body: &[u8]) -> Result<Self, Error> {
        let mut state = Self::default();
        while !body.is_empty() {
            let part =
                cut(body, "sub-package", body.len())?.ok_or(Error::Short { of: "sub-package" })?;
            body = &body[part.size()..];
            let named = |of| Body::of(of, part.body);
            match part.kind {
                0 => state.mode = Some(Mode::decode(&mut named("robot mode data"))?),
                1 => state.joints = Some(decode_joints(&mut named("joint data"))?),
                2 => state.tool = Some(Tool::decode(&mut named("tool data"))?),
                3 => state.masterboard = Some(Masterboard::decode(&mut named("masterboard data"))?),
                4 => state.cartesian = Some(Cartesian::decode(&mut named("cartesian info"))?),
                5 => state.kinematics = Some(Kinematics::decode(&mut named("kinematics info"))?),
                6 => {
                    state.configuration =
                        Some(Configuration::decode(&mut named("configuration data"))?)
                }
                7 => state.force = Some(Force::decode(&mut named("force mode data"))?),
                other => state.passed_over |= 1u32.checked_shl(u32::from(other)).unwrap_or(0),
            }
        }
        Ok(state)
    }
}

impl Mode {
    fn decode(body: &mut Body<'_>) -> Result<Self, Error> {
        Ok(Self {
            timestamp_us: body.u64()?,
            connected: body.flag()?,
            enabled: body.flag()?,
            power_on: body.flag()?,
            emergency_stopped: body.flag()?,
            protective_stopped: body.flag()?,
            program_running: body.flag()?,
            program_paused: body.flag()?,
            robot_mode: RobotMode::from_code(i32::from(body.i8()?)),
            control_mode: body.u8()?,
            target_speed_fraction: body.f64()?,
            speed_scaling: body.f64()?,
            // 38 bytes until 3.1, 46 and more since.
            target_speed_fraction_limit: if body.left() >= 8 {
                Some(body.f64()?)
            } else {
                None
            },
        })
    }
}

fn decode_joints(body: &mut Body<'_>) -> Result<[Joint; 6], Error> {
    let mut joints = [Joint::default(); 6];
    for joint in &mut joints {
        *joint = Joint {
            actual_q: body.f64()?,
            target_q: body.f64()?,
            actual_qd: body.f64()?,
            current_a: body.f32()?,
            voltage_v: body.f32()?,
            motor_temperature_c: body.f32()?,
            // The temperature of a processor that no joint of today has.
            mode: body.skip::<4>().and_then(|()| body.u8())?,
        };
    }
    Ok(joints)
}

impl Tool {
    fn decode(body: &mut Body<'_>) -> Result<Self, Error> {
        Ok(Self {
            input_ranges: [body.u8()?, body.u8()?],
            inputs: body.f64s()?,
            supply_v: body.f32()?,
            output_voltage_v: body.u8()?,
            current_a: body.f32()?,
            temperature_c: body.f32()?,
            mode: body.u8()?,
        })
    }
}

impl Masterboard {
    fn decode(body: &mut Body<'_>) -> Result<Self, Error> {
        Ok(Self {
            inputs: body.u32()?,
            outputs: body.u32()?,
            input_ranges: [body.u8()?, body.u8()?],
            analog_inputs: body.f64s()?,
            output_domains: [body.i8()?, body.i8()?],
            analog_outputs: body.f64s()?,
            temperature_c: body.f32()?,
            robot_voltage_v: body.f32()?,
            robot_current_a: body.f32()?,
            io_current_a: body.f32()?,
            safety_mode: SafetyMode::from_code(i32::from(body.u8()?)),
            reduced: body.flag()?,
        })
    }
}

impl Cartesian {
    fn decode(body: &mut Body<'_>) -> Result<Self, Error> {
        Ok(Self {
            base_from_tool: body.f64s()?,
            flange_from_tool: if body.left() >= 48 {
                Some(body.f64s()?)
            } else {
                None
            },
        })
    }
}

impl Kinematics {
    fn decode(body: &mut Body<'_>) -> Result<Self, Error> {
        Ok(Self {
            checksum: body.u32s()?,
            dh_theta: body.f64s()?,
            dh_a: body.f64s()?,
            dh_d: body.f64s()?,
            dh_alpha: body.f64s()?,
            status: body.u32()?,
        })
    }
}

impl Configuration {
    fn decode(body: &mut Body<'_>) -> Result<Self, Error> {
        let mut pairs = [[[0.0; 2]; 6]; 2];
        for pair in pairs.iter_mut().flatten() {
            *pair = body.f64s()?;
        }
        let [position_limits, motion_limits] = pairs;
        Ok(Self {
            position_limits,
            motion_limits,
            joint_speed: body.f64()?,
            joint_acceleration: body.f64()?,
            tool_speed: body.f64()?,
            tool_acceleration: body.f64()?,
            equivalent_radius: body.f64()?,
            dh_a: body.f64s()?,
            dh_d: body.f64s()?,
            dh_alpha: body.f64s()?,
            dh_theta: body.f64s()?,
            masterboard_version: body.i32()?,
            box_type: body.i32()?,
            robot_type: body.i32()?,
            robot_sub_type: body.i32()?,
        })
    }
}

impl Force {
    fn decode(body: &mut Body<'_>) -> Result<Self, Error> {
        Ok(Self {
            wrench: body.f64s()?,
            dexterity: body.f64()?,
        })
    }
}
