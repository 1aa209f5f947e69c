//! Joint velocities that move the tip as wanted while the shaft stays on the portal.
//!
//! With the tip's Jacobian `J_tip`, that of the shaft's point at the portal `J_rcm` (across the shaft), the shaft's
//! offset `e` from the portal and the shaft's direction `u`:
//!
//! ```text
//! minimise  |J_tip q' - v|^2 + w^2 (u . omega - r)^2 + d^2 |q'|^2
//! subject to  J_rcm q' = -K e        low(q) <= q' <= high(q)
//! ```
//!
//! Portal (2) and tip (3) leave one of six degrees of freedom, the roll about the shaft: its rate `r` leads to where the
//! margin grows. What the limits do not allow is taken from the tip's velocity and never from the portal.

use arthro_geometry::nalgebra::{Matrix6, SMatrix, SVector, Vector6};
use arthro_geometry::{Point3, Vector3};

use super::Comfort;
use super::program::{Bound, Program, Unsolvable};
use crate::kinematics::{Joints, ToolArm};
use crate::rcm::{Placement, shaft};

/// How the law weighs and what it may use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law {
    /// Speed of any joint, rad/s.
    pub joint_speed_rad_s: f64,
    /// A joint's speed towards its limit is at most this times its distance from it, 1/s.
    pub limit_approach_per_s: f64,
    /// K: how fast an offset from the portal is brought back, 1/s. Well below one by the period in which the velocities
    /// are integrated: from 1 / period on it swings.
    pub rcm_gain_per_s: f64,
    /// Speed of the roll that leads to a larger margin, rad/s.
    pub roll_speed_rad_s: f64,
    /// Distances that are far enough.
    pub comfort: Comfort,
}

impl Default for Law {
    fn default() -> Self {
        Self {
            joint_speed_rad_s: 1.0,
            limit_approach_per_s: 5.0,
            rcm_gain_per_s: 25.0,
            roll_speed_rad_s: 0.3,
            comfort: Comfort::default(),
        }
    }
}

/// What the law answers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Velocity {
    /// Of the joints, rad/s.
    pub joints_rad_s: Joints,
    /// Which limits hold a joint back.
    pub held: [Option<Bound>; 6],
    /// The wanted velocity of the tip less the one it gets, mm/s.
    pub slack_mm_s: Vector3,
    /// Of the roll about the shaft, rad/s.
    pub roll_rad_s: f64,
}

/// Why the shaft cannot stay on the portal.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Stuck {
    /// Within the joints' limits.
    #[error(
        "no joint velocities within {joint_speed_rad_s} rad/s and the travel keep the shaft on the portal, which it passes at {offset_mm:.3} mm"
    )]
    Limits {
        /// The limit, rad/s.
        joint_speed_rad_s: f64,
        /// Distance of the shaft to the portal, mm.
        offset_mm: f64,
    },
    /// The arm is singular across the shaft, or a number is none.
    #[error(
        "the arm cannot move the shaft across the portal: manipulability {manipulability_mm3:.3e} mm3"
    )]
    Singular {
        /// `|det J|`, mm3.
        manipulability_mm3: f64,
    },
}

impl Stuck {
    /// The stable word.
    pub fn reason(&self) -> &'static str {
        match self {
            Self::Limits { .. } => "RCM_INFEASIBLE",
            Self::Singular { .. } => "RCM_SINGULAR",
        }
    }
}

/// What a turn about the shaft counts for beside a motion of the tip, mm/rad: little, so that the tip comes first.
const ROLL_MM: f64 = 1.0;
/// What the turn of a joint counts for, mm/rad: so little that it only decides where nothing else does.
const JOINT_MM: f64 = 0.03;
/// Step of the derivative of the margin, rad.
const DIFFERENCE_RAD: f64 = 1e-4;
/// Gain of the margin by roll that is worth the whole speed, 1/rad.
const WORTH_PER_RAD: f64 = 0.2;

impl Law {
    /// The velocities at `joints_rad` for a wanted velocity of the tip in base axes.
    pub fn velocity(
        &self,
        arm: &ToolArm,
        joints_rad: &Joints,
        portal: &Point3,
        tip_mm_s: &Vector3,
    ) -> Result<Velocity, Stuck> {
        let base_from_tool = arm.base_from_tool(joints_rad);
        let u = shaft(&base_from_tool);
        let placement = Placement::of(&base_from_tool, portal);
        let at_portal = portal + placement.offset;
        let tip = arm.jacobian_at(joints_rad, &base_from_tool.origin());
        let moving = tip.fixed_rows::<3>(0);
        let rolling = u.transpose() * tip.fixed_rows::<3>(3);
        let passing = arm.jacobian_at(joints_rad, &at_portal);
        let across = [Vector3::y(), Vector3::z()].map(|axis| base_from_tool.direction(&axis));
        let mut equations = SMatrix::<f64, 2, 6>::zeros();
        let mut equal_to = SVector::<f64, 2>::zeros();
        for (row, axis) in across.iter().enumerate() {
            equations.set_row(row, &(axis.transpose() * passing.fixed_rows::<3>(0)));
            equal_to[row] = -self.rcm_gain_per_s * axis.dot(&placement.offset);
        }
        let roll_rad_s = self.roll_rad_s(arm, joints_rad, &tip, &u);
        let (low, high) = self.bounds(arm, joints_rad);
        let program = Program {
            quadratic: moving.tr_mul(&moving)
                + rolling.tr_mul(&rolling) * (ROLL_MM * ROLL_MM)
                + Matrix6::from_diagonal_element(JOINT_MM * JOINT_MM),
            linear: moving.tr_mul(tip_mm_s)
                + rolling.transpose() * (ROLL_MM * ROLL_MM * roll_rad_s),
            equations,
            equal_to,
            low,
            high,
        };
        let solution = program.solve().map_err(|unsolvable| match unsolvable {
            Unsolvable::Infeasible => Stuck::Limits {
                joint_speed_rad_s: self.joint_speed_rad_s,
                offset_mm: placement.deviation_mm(),
            },
            Unsolvable::Degenerate => Stuck::Singular {
                manipulability_mm3: arm.model().manipulability_mm3(joints_rad),
            },
        })?;
        Ok(Velocity {
            joints_rad_s: solution.x.into(),
            held: solution.held,
            slack_mm_s: tip_mm_s - moving * solution.x,
            roll_rad_s: (rolling * solution.x).x,
        })
    }

    /// The rate of the roll that leads to a larger margin.
    fn roll_rad_s(
        &self,
        arm: &ToolArm,
        joints_rad: &Joints,
        tip: &Matrix6<f64>,
        u: &Vector3,
    ) -> f64 {
        let roll = Vector6::new(0.0, 0.0, 0.0, u.x, u.y, u.z);
        let Some(way) = tip.lu().solve(&roll) else {
            return 0.0;
        };
        let margin = |step: f64| {
            let beside = std::array::from_fn(|i| joints_rad[i] + step * way[i]);
            self.comfort.margin(arm, &beside)
        };
        let gain = (margin(DIFFERENCE_RAD) - margin(-DIFFERENCE_RAD)) / (2.0 * DIFFERENCE_RAD);
        if !gain.is_finite() {
            return 0.0;
        }
        self.roll_speed_rad_s * (gain / WORTH_PER_RAD).clamp(-1.0, 1.0)
    }

    fn bounds(&self, arm: &ToolArm, joints_rad: &Joints) -> (Vector6<f64>, Vector6<f64>) {
        let travel = arm.model().limits();
        let speed = self.joint_speed_rad_s;
        let toward = |distance_rad: f64| (distance_rad * self.limit_approach_per_s).min(speed);
        let low = |i: usize| -toward(joints_rad[i] - travel.min_rad[i]);
        let high = |i: usize| toward(travel.max_rad[i] - joints_rad[i]);
        (
            Vector6::from_fn(|i, _| low(i)),
            Vector6::from_fn(|i, _| high(i)),
        )
    }
}

#[cfg(test)]
mod tests;
