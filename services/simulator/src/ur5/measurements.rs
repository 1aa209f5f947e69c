//! Values that clients see and that are made of several: poses, forces, currents, status words.
//!
//! Torques and currents are those of the joints' model (inertia and friction, no gravity; see the joints' room); forces are
//! the weight that was not declared and what an external sensor tells.

use nalgebra::{Translation3, Vector3};
use ur_link::{RobotMode, SafetyMode};

use super::{
    Control, Controller, OperationalMode, Series,
    kinematics::{self, Joints},
    power::Button,
    robot::GRAVITY_M_S2,
};

/// Voltage of the arm's supply, V.
pub const SUPPLY_V: f64 = 48.0;
/// Current of an arm that stands, A.
const STANDING_A: f64 = 0.6;
/// Temperature of joints at work, °C.
pub const JOINT_TEMPERATURE_C: f64 = 29.0;
/// Masses of the links, kg.
const LINKS_KG: [f64; 6] = [3.7, 8.393, 2.33, 1.219, 1.219, 0.1879];

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

    pub(super) fn target_moment_nm(&self) -> Joints {
        let robot = &self.robot;
        robot.drives.torque_nm(&robot.target.qd, &robot.target_qdd)
    }

    pub(super) fn target_current_a(&self) -> Joints {
        let robot = &self.robot;
        robot.drives.current_a(&robot.target.qd, &robot.target_qdd)
    }

    pub(super) fn actual_torque_nm(&self) -> Joints {
        let drives = &self.robot.drives;
        drives.torque_nm(&drives.qd, &drives.qdd)
    }

    pub(super) fn actual_current_a(&self) -> Joints {
        let drives = &self.robot.drives;
        drives.current_a(&drives.qd, &drives.qdd)
    }

    /// Following errors of the joints, rad.
    pub(super) fn following_error_rad(&self) -> Joints {
        let (target, actual) = (&self.robot.target.q, &self.robot.drives.q);
        std::array::from_fn(|joint| target[joint] - actual[joint])
    }

    /// Force on the tool in base axes, N and Nm.
    pub(super) fn wrench(&self) -> Joints {
        self.robot.wrench()
    }

    /// The same in the flange's own axes.
    pub(super) fn flange_wrench(&self) -> Joints {
        let flange = self.robot.dh.flange(&self.robot.drives.q);
        let wrench = self.robot.wrench();
        let turned = |part: &[f64]| {
            flange
                .rotation
                .inverse_transform_vector(&Vector3::new(part[0], part[1], part[2]))
        };
        let (force, torque) = (turned(&wrench[..3]), turned(&wrench[3..]));
        [force.x, force.y, force.z, torque.x, torque.y, torque.z]
    }

    pub(super) fn force_n(&self) -> f64 {
        let [x, y, z, ..] = self.robot.wrench();
        x.hypot(y).hypot(z)
    }

    /// Of the links, taken as points at their ends, and the payload: kg m/s.
    pub(super) fn momentum_kg_m_s(&self) -> f64 {
        let drives = &self.robot.drives;
        if drives.qd == [0.0; 6] {
            return 0.0;
        }
        let speeds = self.robot.dh.joint_speeds(&drives.q, &drives.qd);
        let links: f64 = speeds
            .iter()
            .zip(LINKS_KG)
            .map(|(speed, mass)| speed.norm() * mass)
            .sum();
        links + speeds[5].norm() * self.robot.carried_kg()
    }

    pub(super) fn elbow_position(&self) -> [f64; 3] {
        self.robot.dh.elbow(&self.robot.drives.q).into()
    }

    pub(super) fn elbow_velocity(&self) -> [f64; 3] {
        let drives = &self.robot.drives;
        self.robot.dh.joint_speeds(&drives.q, &drives.qd)[1].into()
    }

    /// What an accelerometer at rest in the tool feels: its own axes, m/s².
    pub(super) fn tool_accelerometer(&self) -> [f64; 3] {
        let flange = self.robot.dh.flange(&self.robot.drives.q);
        let felt = flange
            .rotation
            .inverse_transform_vector(&Vector3::new(0.0, 0.0, GRAVITY_M_S2));
        felt.into()
    }

    /// Of the payload about its centre of gravity: xx, yy, zz, xy, xz, yz. A point mass has none.
    pub(super) fn payload_inertia(&self) -> Joints {
        [0.0; 6]
    }

    pub(super) fn has_power(&self) -> bool {
        matches!(
            self.robot_mode(),
            RobotMode::PowerOn | RobotMode::Idle | RobotMode::Backdrive | RobotMode::Running
        )
    }

    pub(super) fn robot_voltage_v(&self) -> f64 {
        if self.has_power() { SUPPLY_V } else { 0.0 }
    }

    pub(super) fn robot_current_a(&self) -> f64 {
        if !self.has_power() {
            return 0.0;
        }
        let joints = self.actual_current_a();
        STANDING_A + joints.iter().map(|current| current.abs()).sum::<f64>()
    }

    /// Numbers of the RTDE guide.
    pub(super) fn joint_modes(&self) -> [i32; 6] {
        let mode = match self.robot_mode() {
            RobotMode::Running => 253,
            RobotMode::Idle => 255,
            RobotMode::PowerOn | RobotMode::Booting => 247,
            _ => 239,
        };
        let failed = self.robot.failed_joints();
        std::array::from_fn(|joint| if failed[joint] { 252 } else { mode })
    }

    /// Power on, program running.
    pub(super) fn robot_status_bits(&self) -> u32 {
        // A held program has not ended.
        let runs = self.program.is_some();
        u32::from(self.has_power()) | u32::from(runs) << 1
    }

    pub(super) fn safety_status_bits(&self) -> u32 {
        let safety = self.safety_mode();
        let power = &self.robot.power;
        let (robot, system) = (
            power.is_pressed(Button::Robot),
            power.is_pressed(Button::System),
        );
        let bits = [
            safety == SafetyMode::Normal,
            safety == SafetyMode::Reduced,
            safety == SafetyMode::ProtectiveStop,
            safety == SafetyMode::Recovery,
            safety == SafetyMode::SafeguardStop,
            system,
            robot,
            robot || system,
            safety == SafetyMode::Violation,
            safety == SafetyMode::Fault,
            !safety.allows_motion(),
        ];
        (0..).zip(bits).map(|(bit, on)| u32::from(on) << bit).sum()
    }

    /// Bits 0 and 1: inputs, 2 and 3: outputs; on: volts.
    pub(super) fn analog_io_types(&self) -> u32 {
        u32::from(self.robot.analog_in_volts & 3) << 2
    }

    /// 0 automatic, 1 manual: the numbers of the masterboard's sub-package.
    pub(super) fn operational_selector(&self) -> u8 {
        u8::from(self.pendant.operational == Some(OperationalMode::Manual))
    }

    /// Programs and commands from clients are taken.
    pub fn control(&self) -> Control {
        match self.robot.config.series {
            Series::Cb3 => Control::Remote,
            Series::E => self.pendant.control,
        }
    }

    /// Cycles since the start.
    pub(super) fn cycles(&self) -> u64 {
        (self.timestamp_s() / self.step_s()).round() as u64
    }
}

impl kinematics::Dh {
    /// Where the elbow is, m.
    pub(super) fn elbow(&self, joints: &Joints) -> Vector3<f64> {
        self.ends(joints)[1]
    }

    /// Speed of the end of each link, m/s.
    pub(super) fn joint_speeds(&self, joints: &Joints, speeds: &Joints) -> [Vector3<f64>; 6] {
        let ends = self.ends(joints);
        let mut moving = [Vector3::zeros(); 6];
        let mut base_from_link = nalgebra::Isometry3::identity();
        for joint in 0..6 {
            let (origin, axis) = (
                base_from_link.translation.vector,
                base_from_link * Vector3::z() * speeds[joint],
            );
            for link in joint..6 {
                moving[link] += axis.cross(&(ends[link] - origin));
            }
            base_from_link *= self.link(joint, joints[joint]);
        }
        moving
    }

    fn ends(&self, joints: &Joints) -> [Vector3<f64>; 6] {
        let mut base_from_link = nalgebra::Isometry3::from(Translation3::identity());
        std::array::from_fn(|joint| {
            base_from_link *= self.link(joint, joints[joint]);
            base_from_link.translation.vector
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_speed_of_a_link_is_the_derivative_of_its_place() {
        let dh = kinematics::UR5E;
        let joints = [0.3, -1.2, 1.4, -0.7, 1.1, 0.2];
        let speeds = [0.5, -0.3, 0.7, 0.2, -0.4, 0.9];
        let step = 1e-6;
        let ahead: Joints = std::array::from_fn(|joint| joints[joint] + speeds[joint] * step);
        let told = dh.joint_speeds(&joints, &speeds);
        for (link, (now, then)) in dh.ends(&joints).iter().zip(dh.ends(&ahead)).enumerate() {
            assert!(
                ((then - now) / step - told[link]).norm() < 1e-5,
                "link {link}"
            );
        }
    }
}
