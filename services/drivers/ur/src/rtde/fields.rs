//! Every field that the RTDE guide and the maker's client library name: its type, and the first software that has it
//! where that is known. Recipes are checked against this table while they are compiled.

use super::{version::Since, wire::Type};

/// What is known of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Type on the wire.
    pub kind: Type,
    /// First software that has it; `None`: not documented, so as old as RTDE or unknown.
    pub since: Option<Since>,
}

/// A field by its name.
pub type Row = (&'static str, Field);

const fn field(kind: Type) -> Field {
    Field { kind, since: None }
}

const fn since(kind: Type, cb3: Option<[u32; 3]>, e_series: [u32; 3]) -> Field {
    Field {
        kind,
        since: Some(Since { cb3, e_series }),
    }
}

/// Fields a controller sends, without the registers. Units: rad, rad/s, rad/s^2, m, m/s, N, Nm, A, V, °C, kg, s since
/// the controller started; poses are position and rotation vector.
pub const OUTPUTS: &[Row] = &[
    ("timestamp", field(Type::Double)),
    ("target_q", field(Type::Vector6D)),
    ("target_qd", field(Type::Vector6D)),
    ("target_qdd", field(Type::Vector6D)),
    ("target_current", field(Type::Vector6D)),
    ("target_moment", field(Type::Vector6D)),
    ("actual_q", field(Type::Vector6D)),
    ("actual_qd", field(Type::Vector6D)),
    ("actual_current", field(Type::Vector6D)),
    ("actual_current_window", field(Type::Vector6D)),
    (
        "actual_current_as_torque",
        since(Type::Vector6D, None, [5, 23, 0]),
    ),
    ("joint_control_output", field(Type::Vector6D)),
    ("actual_TCP_pose", field(Type::Vector6D)),
    ("actual_TCP_speed", field(Type::Vector6D)),
    ("actual_TCP_force", field(Type::Vector6D)),
    ("actual_TCP_acceleration", field(Type::Vector6D)),
    ("target_TCP_pose", field(Type::Vector6D)),
    ("target_TCP_speed", field(Type::Vector6D)),
    ("target_TCP_acceleration", field(Type::Vector6D)),
    ("tcp_offset", field(Type::Vector6D)),
    ("actual_digital_input_bits", field(Type::UInt64)),
    (
        "actual_configurable_digital_input_bits",
        field(Type::UInt64),
    ),
    ("joint_temperatures", field(Type::Vector6D)),
    ("actual_execution_time", field(Type::Double)),
    ("target_execution_time", field(Type::Double)),
    ("robot_mode", field(Type::Int32)),
    ("joint_mode", field(Type::Vector6Int32)),
    ("safety_mode", field(Type::Int32)),
    (
        "safety_status",
        since(Type::Int32, Some([3, 10, 0]), [5, 4, 0]),
    ),
    ("actual_tool_accelerometer", field(Type::Vector3D)),
    ("speed_scaling", field(Type::Double)),
    ("target_speed_fraction", field(Type::Double)),
    ("actual_momentum", field(Type::Double)),
    ("actual_main_voltage", field(Type::Double)),
    ("actual_robot_voltage", field(Type::Double)),
    ("actual_robot_current", field(Type::Double)),
    ("actual_joint_voltage", field(Type::Vector6D)),
    ("actual_digital_output_bits", field(Type::UInt64)),
    (
        "actual_configurable_digital_output_bits",
        field(Type::UInt64),
    ),
    ("runtime_state", field(Type::UInt32)),
    ("elbow_position", field(Type::Vector3D)),
    ("elbow_velocity", field(Type::Vector3D)),
    ("robot_status_bits", field(Type::UInt32)),
    ("safety_status_bits", field(Type::UInt32)),
    ("analog_io_types", field(Type::UInt32)),
    ("standard_analog_input0", field(Type::Double)),
    ("standard_analog_input1", field(Type::Double)),
    ("standard_analog_output0", field(Type::Double)),
    ("standard_analog_output1", field(Type::Double)),
    ("io_current", field(Type::Double)),
    ("euromap67_input_bits", field(Type::UInt32)),
    ("euromap67_output_bits", field(Type::UInt32)),
    ("euromap67_24V_voltage", field(Type::Double)),
    ("euromap67_24V_current", field(Type::Double)),
    ("tool_mode", field(Type::UInt32)),
    ("tool_analog_input_types", field(Type::UInt32)),
    ("tool_analog_input0", field(Type::Double)),
    ("tool_analog_input1", field(Type::Double)),
    ("tool_output_voltage", field(Type::Int32)),
    ("tool_output_current", field(Type::Double)),
    ("tool_temperature", field(Type::Double)),
    ("tool_output_mode", field(Type::UInt8)),
    ("tool_digital_output0_mode", field(Type::UInt8)),
    ("tool_digital_output1_mode", field(Type::UInt8)),
    ("tcp_force_scalar", field(Type::Double)),
    ("joint_position_deviation_ratio", field(Type::Double)),
    ("collision_detection_ratio", field(Type::Double)),
    ("time_scale_source", field(Type::Int32)),
    ("script_control_line", field(Type::UInt32)),
    ("control_step", field(Type::UInt64)),
    ("actual_robot_energy_consumed", field(Type::Double)),
    (
        "actual_robot_braking_energy_dissipated",
        field(Type::Double),
    ),
    ("encoder0_raw", field(Type::Int32)),
    ("encoder1_raw", field(Type::Int32)),
    ("ft_raw_wrench", since(Type::Vector6D, None, [5, 9, 0])),
    ("wrench_calc_from_currents", field(Type::Vector6D)),
    ("payload", since(Type::Double, Some([3, 11, 0]), [5, 5, 1])),
    (
        "payload_cog",
        since(Type::Vector3D, Some([3, 11, 0]), [5, 5, 1]),
    ),
    (
        "payload_inertia",
        since(Type::Vector6D, Some([3, 15, 0]), [5, 11, 0]),
    ),
    ("target_gravity", field(Type::Vector3D)),
    ("target_base_acceleration", field(Type::Vector6D)),
    ("target_base_wrench", field(Type::Vector6D)),
];

/// Fields a client sends, without the registers. Each is written by one client at a time; what comes with a mask counts
/// only where the mask has a 1.
pub const INPUTS: &[Row] = &[
    ("speed_slider_mask", field(Type::UInt32)),
    ("speed_slider_fraction", field(Type::Double)),
    ("standard_digital_output_mask", field(Type::UInt8)),
    ("standard_digital_output", field(Type::UInt8)),
    ("configurable_digital_output_mask", field(Type::UInt8)),
    ("configurable_digital_output", field(Type::UInt8)),
    ("tool_digital_output_mask", field(Type::UInt8)),
    ("tool_digital_output", field(Type::UInt8)),
    ("standard_analog_output_mask", field(Type::UInt8)),
    ("standard_analog_output_type", field(Type::UInt8)),
    ("standard_analog_output_0", field(Type::Double)),
    ("standard_analog_output_1", field(Type::Double)),
    ("external_force_torque", field(Type::Vector6D)),
];

/// The field of this name that a controller sends: a row of [`OUTPUTS`], an output register, or the echo of an input
/// register.
pub const fn output(name: &str) -> Option<Field> {
    match find(OUTPUTS, name) {
        Some(found) => Some(found),
        None => match register(name, b"output_") {
            Some(found) => Some(found),
            None => register(name, b"input_"),
        },
    }
}

/// The field of this name that a client sends: a row of [`INPUTS`] or an input register.
pub const fn input(name: &str) -> Option<Field> {
    match find(INPUTS, name) {
        Some(found) => Some(found),
        None => register(name, b"input_"),
    }
}

/// The field is known and of this type.
pub const fn is(found: Option<Field>, kind: Type) -> bool {
    match found {
        Some(field) => field.kind as u8 == kind as u8,
        None => false,
    }
}

const fn find(rows: &[Row], name: &str) -> Option<Field> {
    let mut row = 0;
    while row < rows.len() {
        if same(rows[row].0.as_bytes(), name.as_bytes()) {
            return Some(rows[row].1);
        }
        row += 1;
    }
    None
}

const fn same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && starts(a, b)
}

const fn starts(text: &[u8], head: &[u8]) -> bool {
    if text.len() < head.len() {
        return false;
    }
    let mut at = 0;
    while at < head.len() {
        if text[at] != head[at] {
            return false;
        }
        at += 1;
    }
    true
}

/// Registers 0..23 are meant for fieldbuses, 24..47 for clients of RTDE. The upper half came later.
const UPPER: Option<Since> = Some(Since {
    cb3: Some([3, 9, 0]),
    e_series: [5, 3, 0],
});

const fn register(name: &str, direction: &[u8]) -> Option<Field> {
    let name = name.as_bytes();
    if !starts(name, direction) {
        return None;
    }
    let (_, rest) = name.split_at(direction.len());
    if same(rest, b"bit_registers0_to_31") || same(rest, b"bit_registers32_to_63") {
        return Some(field(Type::UInt32));
    }
    let bits = numbered(rest, b"bit_register_");
    if let Some(64..=127) = bits {
        return Some(Field {
            kind: Type::Bool,
            since: UPPER,
        });
    }
    let (number, kind) = match numbered(rest, b"int_register_") {
        Some(number) => (number, Type::Int32),
        None => match numbered(rest, b"double_register_") {
            Some(number) => (number, Type::Double),
            None => return None,
        },
    };
    match number {
        0..=23 => Some(field(kind)),
        24..=47 => Some(Field { kind, since: UPPER }),
        _ => None,
    }
}

/// The number after `head`, without leading zeros, up to 999.
const fn numbered(text: &[u8], head: &[u8]) -> Option<u32> {
    if !starts(text, head) {
        return None;
    }
    let (_, digits) = text.split_at(head.len());
    if digits.is_empty() || digits.len() > 3 || (digits[0] == b'0' && digits.len() > 1) {
        return None;
    }
    let mut number = 0;
    let mut at = 0;
    while at < digits.len() {
        if !digits[at].is_ascii_digit() {
            return None;
        }
        number = number * 10 + (digits[at] - b'0') as u32;
        at += 1;
    }
    Some(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn registers_are_known_by_their_number() {
        let kind = |name| output(name).map(|field| field.kind);
        assert_eq!(kind("output_int_register_0"), Some(Type::Int32));
        assert_eq!(kind("output_double_register_47"), Some(Type::Double));
        assert_eq!(kind("input_double_register_24"), Some(Type::Double));
        assert_eq!(kind("output_bit_register_64"), Some(Type::Bool));
        assert_eq!(kind("output_bit_registers32_to_63"), Some(Type::UInt32));
        for unknown in [
            "output_int_register_48",
            "output_int_register_",
            "output_int_register_07",
            "output_int_register_1x",
            "output_bit_register_63",
            "output_bit_register_128",
            "int_register_1",
            "timestamps",
            "",
        ] {
            assert_eq!(kind(unknown), None, "{unknown}");
        }
    }

    #[test]
    fn a_client_cannot_write_what_a_controller_sends() {
        assert_eq!(input("actual_q"), None);
        assert_eq!(input("output_int_register_24"), None);
        assert!(input("input_int_register_24").is_some());
        assert!(output("speed_slider_mask").is_none());
    }

    #[test]
    fn no_name_stands_twice() {
        for rows in [OUTPUTS, INPUTS] {
            for (at, (name, _)) in rows.iter().enumerate() {
                assert!(
                    rows[..at].iter().all(|(before, _)| before != name),
                    "{name}"
                );
            }
        }
    }
}
