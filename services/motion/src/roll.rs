//! The free roll about the shaft: a tip that follows a path through the portal leaves the arm one degree of
//! freedom, with which it keeps away from the ends of its joints and from its singularities.
//!
//! [`velocity`] is the law of one instant, a quadratic program over joint velocities; [`profile`] chooses the
//! roll along a whole path. Both are pure. A roll of `rho` turns the tool about its own x:
//! `base_from_tool(s) * R_x(rho)` has the same tip and the same shaft. A shaft along the flange's axis is rolled by joint 6
//! alone, which helps against that joint's limits only; one that leans from it moves the whole arm.

pub mod profile;
pub mod program;
pub mod velocity;

use arthro_geometry::Rotation;
use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::{Rigid, Vector3};

use crate::kinematics::{Joints, ToolArm};

/// The tool turned about its shaft.
pub fn rolled(base_from_tool: &Rigid<Base, Tool>, roll_rad: f64) -> Rigid<Base, Tool> {
    let roll = Rotation::from_axis_angle(&Vector3::x_axis(), roll_rad);
    Rigid::new(
        base_from_tool.rotation() * roll,
        base_from_tool.translation_mm(),
    )
}

/// Whether a move may choose the roll about the shaft.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Choice {
    /// The roll stays as it is, or goes where the move says.
    #[default]
    Keep,
    /// It is chosen along the way.
    Free,
}

/// What counts as far enough from a limit or a singularity: each distance is divided by it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comfort {
    /// Of a joint to its limit, rad.
    pub joint_limit_rad: f64,
    /// Of joint 5 to the wrist's singularity, rad.
    pub wrist_rad: f64,
    /// Of joint 3 to the elbow's singularity, rad.
    pub elbow_rad: f64,
    /// Of the last bend to the shoulder's singularity, mm.
    pub shoulder_mm: f64,
}

impl Default for Comfort {
    fn default() -> Self {
        Self {
            joint_limit_rad: 0.5,
            wrist_rad: 0.3,
            elbow_rad: 0.3,
            shoulder_mm: 80.0,
        }
    }
}

impl Comfort {
    /// The least of the distances in shares of what is far enough; at most 1, negative beyond a joint limit.
    pub fn margin(&self, arm: &ToolArm, joints: &Joints) -> f64 {
        let near = arm.model().singularities(joints);
        (arm.limit_margin_rad(joints) / self.joint_limit_rad)
            .min(near.wrist_rad / self.wrist_rad)
            .min(near.elbow_rad / self.elbow_rad)
            .min(near.shoulder_mm / self.shoulder_mm)
            .min(1.0)
    }
}
