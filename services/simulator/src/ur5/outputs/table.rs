//! Every output but the registers: name, first version, value. Names and types are those of the RTDE guide; first versions
//! too where clients depend on them, else the field is offered by every version.

use super::{
    Read::{Byte, Double, Int, Long, Six, SixInts, Three, Word},
    Row,
};
use crate::ur5::{
    Since,
    measurements::{JOINT_TEMPERATURE_C, SUPPLY_V},
};

const ALWAYS: Since = Since::ALWAYS;
const E_SERIES: Since = Since::e_only([5, 0, 0]);

pub(super) const STATE: &[Row] = &[
    ("timestamp", ALWAYS, Double(|c| c.timestamp_s())),
    // joints
    ("target_q", ALWAYS, Six(|c| c.robot.target.q)),
    ("target_qd", ALWAYS, Six(|c| c.robot.target.qd)),
    ("target_qdd", ALWAYS, Six(|c| c.robot.target_qdd)),
    ("target_current", ALWAYS, Six(|c| c.target_current_a())),
    ("target_moment", ALWAYS, Six(|c| c.target_moment_nm())),
    ("actual_q", ALWAYS, Six(|c| c.robot.drives.q)),
    ("actual_qd", ALWAYS, Six(|c| c.robot.drives.qd)),
    ("actual_current", ALWAYS, Six(|c| c.actual_current_a())),
    ("actual_current_window", ALWAYS, Six(|_| [0.5; 6])),
    (
        "actual_current_as_torque",
        Since::e_only([5, 23, 0]),
        Six(|c| c.actual_torque_nm()),
    ),
    (
        "joint_control_output",
        ALWAYS,
        Six(|c| c.following_error_rad()),
    ),
    (
        "joint_temperatures",
        ALWAYS,
        Six(|_| [JOINT_TEMPERATURE_C; 6]),
    ),
    (
        "actual_joint_voltage",
        ALWAYS,
        Six(|c| [c.robot_voltage_v(); 6]),
    ),
    ("joint_mode", ALWAYS, SixInts(|c| c.joint_modes())),
    // tool
    ("actual_TCP_pose", ALWAYS, Six(|c| c.actual_tool_pose())),
    ("actual_TCP_speed", ALWAYS, Six(|c| c.actual_tool_speed())),
    ("actual_TCP_force", ALWAYS, Six(|c| c.wrench())),
    ("target_TCP_pose", ALWAYS, Six(|c| c.target_tool_pose())),
    ("target_TCP_speed", ALWAYS, Six(|c| c.target_tool_speed())),
    ("tcp_offset", ALWAYS, Six(|c| c.robot.tcp_offset)),
    ("tcp_force_scalar", ALWAYS, Double(|c| c.force_n())),
    (
        "actual_tool_accelerometer",
        ALWAYS,
        Three(|c| c.tool_accelerometer()),
    ),
    (
        "ft_raw_wrench",
        Since::e_only([5, 9, 0]),
        Six(|c| c.flange_wrench()),
    ),
    (
        "wrench_calc_from_currents",
        Since::e_only([5, 9, 0]),
        Six(|c| c.wrench()),
    ),
    (
        "payload",
        Since::new([3, 11, 0], [5, 5, 1]),
        Double(|c| c.robot.payload_kg),
    ),
    (
        "payload_cog",
        Since::new([3, 11, 0], [5, 5, 1]),
        Three(|c| c.robot.payload_cog_m),
    ),
    (
        "payload_inertia",
        Since::new([3, 15, 0], [5, 11, 0]),
        Six(|c| c.payload_inertia()),
    ),
    // elbow
    (
        "elbow_position",
        Since::new([3, 5, 0], [5, 0, 0]),
        Three(|c| c.elbow_position()),
    ),
    (
        "elbow_velocity",
        Since::new([3, 5, 0], [5, 0, 0]),
        Three(|c| c.elbow_velocity()),
    ),
    // modes
    ("robot_mode", ALWAYS, Int(|c| c.robot_mode().code())),
    ("safety_mode", ALWAYS, Int(|c| c.safety_mode().code())),
    (
        "safety_status",
        Since::new([3, 10, 0], [5, 4, 0]),
        Int(|c| c.safety_mode().code()),
    ),
    (
        "runtime_state",
        ALWAYS,
        Word(|c| c.runtime_state().code() as u32),
    ),
    ("robot_status_bits", ALWAYS, Word(|c| c.robot_status_bits())),
    (
        "safety_status_bits",
        ALWAYS,
        Word(|c| c.safety_status_bits()),
    ),
    ("speed_scaling", ALWAYS, Double(|c| c.robot.scaling())),
    (
        "target_speed_fraction",
        ALWAYS,
        Double(|c| c.robot.speed_slider),
    ),
    (
        "script_control_line",
        Since::new([3, 14, 0], [5, 9, 0]),
        Word(|_| 0),
    ),
    // controller
    (
        "actual_execution_time",
        ALWAYS,
        Double(|c| c.step_s() * 0.1),
    ),
    ("target_execution_time", ALWAYS, Double(|c| c.step_s())),
    ("actual_momentum", ALWAYS, Double(|c| c.momentum_kg_m_s())),
    ("actual_main_voltage", ALWAYS, Double(|_| SUPPLY_V)),
    (
        "actual_robot_voltage",
        ALWAYS,
        Double(|c| c.robot_voltage_v()),
    ),
    (
        "actual_robot_current",
        ALWAYS,
        Double(|c| c.robot_current_a()),
    ),
    ("control_step", E_SERIES, Long(|c| c.cycles())),
    // inputs and outputs; nothing is wired to the inputs
    ("actual_digital_input_bits", ALWAYS, Long(|_| 0)),
    (
        "actual_digital_output_bits",
        ALWAYS,
        Long(|c| c.robot.digital_outputs),
    ),
    (
        "actual_configurable_digital_input_bits",
        ALWAYS,
        Long(|_| 0),
    ),
    (
        "actual_configurable_digital_output_bits",
        ALWAYS,
        Long(|c| c.robot.digital_outputs >> 8 & 0xff),
    ),
    ("analog_io_types", ALWAYS, Word(|c| c.analog_io_types())),
    ("standard_analog_input0", ALWAYS, Double(|_| 0.0)),
    ("standard_analog_input1", ALWAYS, Double(|_| 0.0)),
    (
        "standard_analog_output0",
        ALWAYS,
        Double(|c| c.robot.analog_outputs[0]),
    ),
    (
        "standard_analog_output1",
        ALWAYS,
        Double(|c| c.robot.analog_outputs[1]),
    ),
    ("io_current", ALWAYS, Double(|_| 0.0)),
    ("euromap67_input_bits", ALWAYS, Word(|_| 0)),
    ("euromap67_output_bits", ALWAYS, Word(|_| 0)),
    ("euromap67_24V_voltage", ALWAYS, Double(|_| 0.0)),
    ("euromap67_24V_current", ALWAYS, Double(|_| 0.0)),
    ("encoder0_raw", E_SERIES, Int(|_| 0)),
    ("encoder1_raw", E_SERIES, Int(|_| 0)),
    ("tool_mode", ALWAYS, Word(|c| c.joint_modes()[5] as u32)),
    ("tool_analog_input_types", ALWAYS, Word(|_| 0)),
    ("tool_analog_input0", ALWAYS, Double(|_| 0.0)),
    ("tool_analog_input1", ALWAYS, Double(|_| 0.0)),
    ("tool_output_voltage", ALWAYS, Int(|_| 0)),
    ("tool_output_current", ALWAYS, Double(|_| 0.0)),
    ("tool_temperature", ALWAYS, Double(|_| JOINT_TEMPERATURE_C)),
    ("tool_output_mode", E_SERIES, Byte(|_| 0)),
    ("tool_digital_output0_mode", E_SERIES, Byte(|_| 0)),
    ("tool_digital_output1_mode", E_SERIES, Byte(|_| 0)),
];
