//! What stops the arm: broken limits, buttons, joints that fail; and how clients are told.

use super::{Level, Message, Robot};
use crate::ur5::power::Button;

/// Deceleration of a protective stop, rad/s².
const PROTECTIVE_STOP_RAD_S2: f64 = 20.0;
/// Number of the error that a protective stop is told with.
const PROTECTIVE_STOP_CODE: i32 = 153;
/// Number of the error that a failed joint is told with; its argument is the joint.
const JOINT_FAULT_CODE: i32 = 4;

impl Robot {
    /// Stops the arm until a person unlocks it.
    pub fn protective_stop(&mut self, reason: &str) {
        if self.power.protective_stop() {
            tracing::warn!(reason, now_s = self.now_s(), "protective stop");
            self.log.push(Message::Error {
                code: PROTECTIVE_STOP_CODE,
                argument: 0,
                level: Level::Violation,
                text: format!("protective stop: {reason}"),
            });
            self.stop(PROTECTIVE_STOP_RAD_S2);
        }
    }

    /// Presses an emergency stop: the arm stops, then loses its power.
    pub fn press(&mut self, button: Button) {
        self.power.press(button);
        if self.is_moving() {
            self.stop(PROTECTIVE_STOP_RAD_S2);
        }
    }

    /// A joint fails, or is whole again; the safety system needs a restart after that.
    pub fn set_joint_failed(&mut self, joint: usize, failed: bool) {
        if let Some(state) = self.failed_joints.get_mut(joint)
            && std::mem::replace(state, failed) != failed
            && failed
        {
            self.log.push(Message::Error {
                code: JOINT_FAULT_CODE,
                argument: joint as i32,
                level: Level::Fault,
                text: format!("joint {joint} does not respond"),
            });
        }
    }

    /// Which joints have failed.
    pub fn failed_joints(&self) -> &[bool; 6] {
        &self.failed_joints
    }

    /// The first limit that the commanded joints break.
    pub(super) fn broken_limit(&self) -> Option<String> {
        let (position, speed) = (self.config.joint_range_rad, self.config.joint_speed_rad_s);
        (0..6).find_map(|joint| {
            let (q, qd) = (self.target.q[joint], self.target.qd[joint]);
            if !(q.is_finite() && q.abs() <= position) {
                Some(format!("joint {joint} at {q:.3} rad, limit {position:.3}"))
            } else if qd.abs() > speed * 1.05 {
                Some(format!("joint {joint} at {qd:.3} rad/s, limit {speed:.3}"))
            } else {
                None
            }
        })
    }

    /// Tells clients of another safety mode.
    pub(super) fn tell_safety(&mut self) {
        let safety = self.power.safety();
        if safety != self.safety_told {
            tracing::info!(%safety, now_s = self.now_s(), "safety mode");
            self.safety_told = safety;
            self.log.push(Message::Safety(safety));
        }
    }
}
