//! `servoc`: the tool goes straight towards a goal that may change with every call, at a constant speed once it has it.

use nalgebra::{Isometry3, Vector6};

use super::way;
use crate::ur5::kinematics;

/// The tool on its way.
#[derive(Clone, Debug)]
pub struct Chase {
    pose: Isometry3<f64>,
    twist: Vector6<f64>,
    goal: Isometry3<f64>,
    speed: f64,
    accel: f64,
}

impl Chase {
    /// From a tool at `pose` that moves with `twist`, in base axes.
    pub fn new(
        pose: Isometry3<f64>,
        twist: Vector6<f64>,
        goal: Isometry3<f64>,
        speed: f64,
        accel: f64,
    ) -> Self {
        Self {
            pose,
            twist,
            goal,
            speed,
            accel,
        }
    }

    /// The same tool, which is at `pose` now, on its way to another goal.
    pub fn towards(
        &self,
        pose: Isometry3<f64>,
        goal: Isometry3<f64>,
        speed: f64,
        accel: f64,
    ) -> Self {
        Self::new(pose, self.twist, goal, speed, accel)
    }

    /// The pose after `dt` s of path time, and whether that is the goal.
    pub fn advance(&mut self, dt: f64, dt_real: f64) -> (Isometry3<f64>, bool) {
        let rest = kinematics::twist_between(&self.pose, &self.goal);
        let length = way(&rest);
        let last_step = self.accel * dt_real * dt_real;
        if length <= last_step.max(1e-9) && way(&self.twist) <= self.accel * dt_real * 2.0 {
            (self.pose, self.twist) = (self.goal, Vector6::zeros());
            return (self.pose, true);
        }
        // As fast as it can still stop at the goal, one cycle of delay taken off.
        let stoppable = (2.0 * self.accel * (length - way(&self.twist) * dt_real).max(0.0)).sqrt();
        let wanted = rest / length * self.speed.min(stoppable).min(length / dt_real);
        let missing = way(&(wanted - self.twist));
        let share = (self.accel * dt_real / missing.max(1e-12)).min(1.0);
        let before = self.twist;
        self.twist += (wanted - before) * share;
        self.pose = kinematics::moved(&self.pose, &((before + self.twist) * (0.5 * dt)));
        (self.pose, false)
    }
}
