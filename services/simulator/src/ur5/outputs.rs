//! What an RTDE client can ask for, by name.

use ur_link::{
    RobotMode, SafetyMode,
    rtde::wire::{Type, Value},
};

use super::{Controller, kinematics::Joints, registers::Register};

/// Voltage of the arm's supply, V.
const SUPPLY_V: f64 = 48.0;
/// Temperature of joints at work, °C.
pub(super) const JOINT_TEMPERATURE_C: f64 = 29.0;

/// A field of an output recipe.
#[derive(Clone, Copy, Debug)]
pub struct Output(Source);

#[derive(Clone, Copy, Debug)]
enum Source {
    State(fn(&Controller) -> Value),
    Input(Register),
    Output(Register),
}

impl Output {
    /// The field of this name with its type; `None` for names this controller does not know.
    pub fn from_name(name: &str) -> Option<(Self, Type)> {
        if let Some((_, kind, read)) = STATE.iter().find(|(known, ..)| *known == name) {
            return Some((Self(Source::State(*read)), *kind));
        }
        let (source, register): (fn(Register) -> Source, _) = match name.split_once('_')? {
            ("input", rest) => (Source::Input, Register::from_name(rest)?),
            ("output", rest) => (Source::Output, Register::from_name(rest)?),
            _ => return None,
        };
        Some((Self(source(register)), register.kind()))
    }

    /// Its value now.
    pub fn read(self, controller: &Controller) -> Value {
        match self.0 {
            Source::State(read) => read(controller),
            Source::Input(register) => register.read(&controller.robot.inputs),
            Source::Output(register) => register.read(&controller.robot.outputs),
        }
    }
}

type Row = (&'static str, Type, fn(&Controller) -> Value);

/// Names, types and values. Forces, currents and the like are those of an arm in free space without friction.
const STATE: &[Row] = &[
    ("timestamp", Type::Double, |c| {
        Value::Double(c.timestamp_s())
    }),
    ("target_q", Type::Vector6D, |c| {
        Value::Vector6D(c.robot.target.q)
    }),
    ("target_qd", Type::Vector6D, |c| {
        Value::Vector6D(c.robot.target.qd)
    }),
    ("target_qdd", Type::Vector6D, |c| {
        Value::Vector6D(c.robot.target_qdd)
    }),
    ("target_current", Type::Vector6D, |_| {
        Value::Vector6D([0.0; 6])
    }),
    ("target_moment", Type::Vector6D, |_| {
        Value::Vector6D([0.0; 6])
    }),
    ("actual_q", Type::Vector6D, |c| {
        Value::Vector6D(c.robot.drives.q)
    }),
    ("actual_qd", Type::Vector6D, |c| {
        Value::Vector6D(c.robot.drives.qd)
    }),
    ("actual_current", Type::Vector6D, |_| {
        Value::Vector6D([0.0; 6])
    }),
    ("actual_current_window", Type::Vector6D, |_| {
        Value::Vector6D([0.5; 6])
    }),
    ("actual_current_as_torque", Type::Vector6D, |_| {
        Value::Vector6D([0.0; 6])
    }),
    ("joint_control_output", Type::Vector6D, |_| {
        Value::Vector6D([0.0; 6])
    }),
    ("actual_TCP_pose", Type::Vector6D, |c| {
        Value::Vector6D(c.actual_tool_pose())
    }),
    ("actual_TCP_speed", Type::Vector6D, |c| {
        Value::Vector6D(c.actual_tool_speed())
    }),
    ("actual_TCP_force", Type::Vector6D, |_| {
        Value::Vector6D([0.0; 6])
    }),
    ("target_TCP_pose", Type::Vector6D, |c| {
        Value::Vector6D(c.target_tool_pose())
    }),
    ("target_TCP_speed", Type::Vector6D, |c| {
        Value::Vector6D(c.target_tool_speed())
    }),
    ("actual_digital_input_bits", Type::UInt64, |_| {
        Value::UInt64(0)
    }),
    ("joint_temperatures", Type::Vector6D, |_| {
        Value::Vector6D([JOINT_TEMPERATURE_C; 6])
    }),
    ("actual_execution_time", Type::Double, |c| {
        Value::Double(c.step_s() * 0.1)
    }),
    ("target_execution_time", Type::Double, |c| {
        Value::Double(c.step_s())
    }),
    ("robot_mode", Type::Int32, |c| {
        Value::Int32(c.robot_mode().code())
    }),
    ("joint_mode", Type::Vector6Int32, |c| {
        Value::Vector6Int32([c.joint_mode(); 6])
    }),
    ("safety_mode", Type::Int32, |c| {
        Value::Int32(c.safety_mode().code())
    }),
    ("safety_status", Type::Int32, |c| {
        Value::Int32(c.safety_mode().code())
    }),
    ("actual_tool_accelerometer", Type::Vector3D, |_| {
        Value::Vector3D([0.0, 0.0, -9.82])
    }),
    ("speed_scaling", Type::Double, |c| {
        Value::Double(c.robot.scaling())
    }),
    ("target_speed_fraction", Type::Double, |c| {
        Value::Double(c.robot.speed_slider)
    }),
    ("actual_momentum", Type::Double, |_| Value::Double(0.0)),
    ("actual_main_voltage", Type::Double, |_| {
        Value::Double(SUPPLY_V)
    }),
    ("actual_robot_voltage", Type::Double, |c| {
        Value::Double(c.robot_voltage())
    }),
    ("actual_robot_current", Type::Double, |_| Value::Double(0.6)),
    ("actual_joint_voltage", Type::Vector6D, |c| {
        Value::Vector6D([c.robot_voltage(); 6])
    }),
    ("actual_digital_output_bits", Type::UInt64, |c| {
        Value::UInt64(c.robot.digital_outputs)
    }),
    ("runtime_state", Type::UInt32, |c| {
        Value::UInt32(c.runtime_state().code() as u32)
    }),
    ("elbow_position", Type::Vector3D, |c| {
        Value::Vector3D(c.elbow_position())
    }),
    ("elbow_velocity", Type::Vector3D, |_| {
        Value::Vector3D([0.0; 3])
    }),
    ("robot_status_bits", Type::UInt32, |c| {
        Value::UInt32(c.robot_status_bits())
    }),
    ("safety_status_bits", Type::UInt32, |c| {
        Value::UInt32(c.safety_status_bits())
    }),
    ("analog_io_types", Type::UInt32, |_| Value::UInt32(0)),
    ("standard_analog_input0", Type::Double, |_| {
        Value::Double(0.0)
    }),
    ("standard_analog_input1", Type::Double, |_| {
        Value::Double(0.0)
    }),
    ("standard_analog_output0", Type::Double, |c| {
        Value::Double(c.robot.analog_outputs[0])
    }),
    ("standard_analog_output1", Type::Double, |c| {
        Value::Double(c.robot.analog_outputs[1])
    }),
    ("io_current", Type::Double, |_| Value::Double(0.0)),
    ("euromap67_input_bits", Type::UInt32, |_| Value::UInt32(0)),
    ("euromap67_output_bits", Type::UInt32, |_| Value::UInt32(0)),
    ("euromap67_24V_voltage", Type::Double, |_| {
        Value::Double(0.0)
    }),
    ("euromap67_24V_current", Type::Double, |_| {
        Value::Double(0.0)
    }),
    ("tool_mode", Type::UInt32, |c| {
        Value::UInt32(c.joint_mode() as u32)
    }),
    ("tool_analog_input_types", Type::UInt32, |_| {
        Value::UInt32(0)
    }),
    ("tool_analog_input0", Type::Double, |_| Value::Double(0.0)),
    ("tool_analog_input1", Type::Double, |_| Value::Double(0.0)),
    ("tool_output_voltage", Type::Int32, |_| Value::Int32(0)),
    ("tool_output_current", Type::Double, |_| Value::Double(0.0)),
    ("tool_temperature", Type::Double, |_| {
        Value::Double(JOINT_TEMPERATURE_C)
    }),
    ("tcp_force_scalar", Type::Double, |_| Value::Double(0.0)),
    ("tcp_offset", Type::Vector6D, |c| {
        Value::Vector6D(c.robot.tcp_offset)
    }),
    ("payload", Type::Double, |c| {
        Value::Double(c.robot.payload_kg)
    }),
    ("payload_cog", Type::Vector3D, |c| {
        Value::Vector3D(c.robot.payload_cog_m)
    }),
    ("payload_inertia", Type::Vector6D, |_| {
        Value::Vector6D([0.0; 6])
    }),
];

/// Values that are made of several.
impl Controller {
    pub(super) fn actual_tool_pose(&self) -> Joints {
        self.robot.tool_pose(&self.robot.drives.q)
    }

    pub(super) fn target_tool_pose(&self) -> Joints {
        self.robot.tool_pose(&self.robot.target.q)
    }

    pub(super) fn actual_tool_speed(&self) -> Joints {
        self.robot
            .tool_speed(&self.robot.drives.q, &self.robot.drives.qd)
    }

    pub(super) fn target_tool_speed(&self) -> Joints {
        self.robot
            .tool_speed(&self.robot.target.q, &self.robot.target.qd)
    }

    pub(super) fn has_power(&self) -> bool {
        matches!(
            self.robot_mode(),
            RobotMode::PowerOn | RobotMode::Idle | RobotMode::Backdrive | RobotMode::Running
        )
    }

    pub(super) fn robot_voltage(&self) -> f64 {
        if self.has_power() { SUPPLY_V } else { 0.0 }
    }

    pub(super) fn joint_mode(&self) -> i32 {
        match self.robot_mode() {
            RobotMode::Running => 253,
            RobotMode::Idle => 255,
            RobotMode::PowerOn | RobotMode::Booting => 247,
            _ => 239,
        }
    }

    /// Power, program.
    fn robot_status_bits(&self) -> u32 {
        u32::from(self.has_power()) | u32::from(self.program.is_some()) << 1
    }

    fn safety_status_bits(&self) -> u32 {
        match self.safety_mode() {
            SafetyMode::Normal => 1,
            SafetyMode::Reduced => 1 << 1,
            // Protective stopped, and stopped due to safety.
            SafetyMode::ProtectiveStop => 1 << 2 | 1 << 10,
            other => 1 << (other.code().clamp(1, 31) - 1),
        }
    }

    pub(super) fn elbow_position(&self) -> [f64; 3] {
        let [base, shoulder, ..] = self.robot.drives.q;
        let dh = &self.robot.dh;
        let (reach, height) = (dh.a_m[1] * shoulder.cos(), dh.a_m[1] * shoulder.sin());
        [reach * base.cos(), reach * base.sin(), height + dh.d_m[0]]
    }
}
