//! The packet of the realtime interface (port 30003) as versions 3.5 to 3.9 have it: a size and 138 doubles.

use super::{Controller, outputs::JOINT_TEMPERATURE_C};

/// Size of the packet.
pub const BYTES: usize = 4 + 8 * 138;

impl Controller {
    /// Appends the packet of this cycle. The numbers are columns of the manual's table, from 1.
    pub(super) fn encode_realtime(&self, out: &mut Vec<u8>) {
        let start = out.len();
        out.extend((BYTES as i32).to_be_bytes());
        let mut put = |values: &[f64]| {
            values
                .iter()
                .for_each(|value| out.extend(value.to_be_bytes()))
        };
        let zeros = [0.0; 6];
        let drives = &self.robot.drives;
        put(&[self.timestamp_s()]); // 1
        put(&self.robot.target.q); // 2
        put(&self.robot.target.qd); // 8
        put(&self.robot.target_qdd); // 14
        put(&zeros); // 20 target currents
        put(&zeros); // 26 target moments
        put(&drives.q); // 32
        put(&drives.qd); // 38
        put(&zeros); // 44 currents
        put(&zeros); // 50 control currents
        put(&self.actual_tool_pose()); // 56
        put(&self.actual_tool_speed()); // 62
        put(&zeros); // 68 force
        put(&self.target_tool_pose()); // 74
        put(&self.target_tool_speed()); // 80
        put(&[0.0]); // 86 digital inputs
        put(&[JOINT_TEMPERATURE_C; 6]); // 87
        put(&[0.0, 0.0]); // 93 controller timer, 94 internal
        put(&[f64::from(self.robot_mode().code())]); // 95
        put(&[f64::from(self.joint_mode()); 6]); // 96
        put(&[f64::from(self.safety_mode().code())]); // 102
        put(&zeros); // 103 internal
        put(&[0.0, 0.0, -9.82]); // 109 tool accelerometer
        put(&zeros); // 112 internal
        put(&[self.robot.scaling(), 0.0]); // 118, 119 momentum
        put(&[0.0, 0.0]); // 120 internal
        put(&[48.0, self.robot_voltage(), 0.6]); // 122
        put(&[self.robot_voltage(); 6]); // 125
        put(&[f64::from_bits(self.robot.digital_outputs)]); // 131
        put(&[f64::from(self.runtime_state().code())]); // 132
        put(&self.elbow_position()); // 133
        put(&[0.0; 3]); // 136 elbow speed
        debug_assert_eq!(out.len() - start, BYTES);
    }
}
