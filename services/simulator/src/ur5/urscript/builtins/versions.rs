//! In which controller software a function exists. A function that the version does not have is refused before the
//! program runs, as on the robot.

use crate::ur5::series::Since;

/// `struct()`
pub const STRUCTS: Since = Since::e_only([5, 11, 0]);
/// Lists whose length changes, and their methods.
pub const LISTS: Since = Since::e_only([5, 15, 0]);

const E: Since = Since::e_only([5, 0, 0]);
const TORQUE: Since = Since::e_only([5, 23, 0]);
const OPTIMOVE: Since = Since::e_only([5, 21, 0]);

/// Functions that not every version has; the rest are in all. What the manufacturer's own client library calls on CB3 without
/// asking for the version is in all, too.
const GATES: &[(&str, Since)] = &[
    ("direct_torque", TORQUE),
    (
        "enable_external_ft_sensor",
        Since::new([3, 3, 0], [5, 0, 0]),
    ),
    ("ft_rtde_input_enable", Since::new([3, 14, 1], [5, 9, 1])),
    ("get_coriolis_and_centrifugal_torques", TORQUE),
    ("get_freedrive_status", E),
    (
        "get_inverse_kin_has_solution",
        Since::new([3, 15, 0], [5, 10, 0]),
    ),
    ("get_jacobian", TORQUE),
    ("get_jacobian_time_derivative", TORQUE),
    ("get_mass_matrix", TORQUE),
    ("get_target_joint_accelerations", TORQUE),
    ("get_target_payload_inertia", Since::e_only([5, 10, 0])),
    ("interpreter_mode", E),
    ("make_list", LISTS),
    ("optimovej", OPTIMOVE),
    ("optimovel", OPTIMOVE),
    ("rpc_factory", Since::new([3, 0, 0], [5, 0, 0])),
    ("screw_driving", E),
    ("end_screw_driving", E),
    ("set_target_payload", Since::e_only([5, 10, 0])),
    ("set_tool_communication", E),
];

/// First versions with the built-in function of this name.
pub fn since(name: &str) -> Since {
    GATES
        .iter()
        .find(|(gated, _)| *gated == name)
        .map_or(Since::ALWAYS, |(_, since)| *since)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_gate_belongs_to_a_function() {
        for (name, _) in GATES {
            assert!(
                crate::ur5::urscript::builtins::find(name).is_some(),
                "{name}"
            );
        }
    }
}
