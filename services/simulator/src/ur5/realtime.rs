//! The packet of the realtime interface (port 30003): a size and doubles, the more the newer the software.

use super::{Controller, Since, Version, measurements::JOINT_TEMPERATURE_C};

/// Columns of a packet and the first versions that send so many. Sizes in bytes are 4 + 8 times that.
const COLUMNS: [(usize, Since); 6] = [
    // From 5.10 payload mass, centre of gravity and inertia.
    (152, Since::e_only([5, 10, 0])),
    // From 5.9 three more that nobody documents.
    (142, Since::e_only([5, 9, 0])),
    // The safety status.
    (139, Since::new([3, 10, 0], [5, 4, 0])),
    // The elbow.
    (138, Since::new([3, 5, 0], [5, 0, 0])),
    // Digital outputs and program state.
    (132, Since::cb3_only([3, 2, 0])),
    (130, Since::cb3_only([3, 0, 0])),
];

/// Doubles in the packet of a version.
fn columns(version: Version) -> usize {
    COLUMNS
        .iter()
        .find(|(_, since)| version.has(*since))
        .map_or(130, |(columns, _)| *columns)
}

impl Controller {
    /// Appends the packet of this cycle. The numbers are columns of the manual's table, from 1.
    pub(super) fn encode_realtime(&self, out: &mut Vec<u8>) {
        let start = out.len();
        let bytes = 4 + 8 * columns(self.robot.config.software());
        out.extend((bytes as i32).to_be_bytes());
        let mut put = |values: &[f64]| {
            values
                .iter()
                .for_each(|value| out.extend(value.to_be_bytes()))
        };
        let drives = &self.robot.drives;
        put(&[self.timestamp_s()]); // 1
        put(&self.robot.target.q); // 2
        put(&self.robot.target.qd); // 8
        put(&self.robot.target_qdd); // 14
        put(&self.target_current_a()); // 20
        put(&self.target_moment_nm()); // 26
        put(&drives.q); // 32
        put(&drives.qd); // 38
        put(&self.actual_current_a()); // 44
        put(&self.target_current_a()); // 50 control currents
        put(&self.actual_tool_pose()); // 56
        put(&self.actual_tool_speed()); // 62
        put(&self.wrench()); // 68
        put(&self.target_tool_pose()); // 74
        put(&self.target_tool_speed()); // 80
        put(&[0.0]); // 86 digital inputs
        put(&[JOINT_TEMPERATURE_C; 6]); // 87
        put(&[self.step_s() * 0.1, 0.0]); // 93 controller timer, 94 internal
        put(&[f64::from(self.robot_mode().code())]); // 95
        put(&self.joint_modes().map(f64::from)); // 96
        put(&[f64::from(self.safety_mode().code())]); // 102
        put(&[0.0; 6]); // 103 internal
        put(&self.tool_accelerometer()); // 109
        put(&[0.0; 6]); // 112 internal
        put(&[self.robot.scaling(), self.momentum_kg_m_s()]); // 118
        put(&[0.0, 0.0]); // 120 internal
        put(&[48.0, self.robot_voltage_v(), self.robot_current_a()]); // 122
        put(&[self.robot_voltage_v(); 6]); // 125
        put(&[f64::from_bits(self.robot.digital_outputs)]); // 131
        put(&[f64::from(self.runtime_state().code())]); // 132
        put(&self.elbow_position()); // 133
        put(&self.elbow_velocity()); // 136
        put(&[f64::from(self.safety_mode().code())]); // 139
        put(&[0.0; 3]); // 140 internal
        put(&[self.robot.payload_kg]); // 143
        put(&self.robot.payload_cog_m); // 144
        put(&self.payload_inertia()); // 147
        // An older version knows the first columns only.
        out.truncate(start + bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ur5::{Config, Series};

    #[test]
    fn packets_have_the_sizes_that_clients_choose_versions_by() {
        for (version, bytes) in [
            ("3.1.0", 1044),
            ("3.2.0", 1060),
            ("3.5.4", 1108),
            ("3.15.8", 1116),
            ("5.3.0", 1108),
            ("5.4.0", 1116),
            ("5.9.4", 1140),
            ("5.12.6", 1220),
        ] {
            let series = if version.starts_with('3') {
                Series::Cb3
            } else {
                Series::E
            };
            let config = Config {
                version: Some(version.parse().unwrap()),
                ..Config::of(series)
            };
            let mut out = vec![7];
            Controller::new(config).encode_realtime(&mut out);
            assert_eq!(out.len(), 1 + bytes, "{version}");
            assert_eq!(out[1..5], (bytes as i32).to_be_bytes(), "{version}");
        }
    }
}
