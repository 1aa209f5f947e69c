//! Kinematics of an arm that carries a tool: joints to tool and back, every inverse verified.

pub mod ur5;

use arthro_geometry::Rigid;
use arthro_geometry::frame::{Base, Flange, Tool};

/// Six joint angles from base to wrist 3, rad.
pub type Joints = [f64; 6];

/// How far the forward kinematics of an inverse solution may be from what was asked, mm and rad.
const RESIDUAL_MAX: f64 = 1e-9;

/// A UR5 with a tool at its flange.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolArm {
    flange_from_tool: Rigid<Flange, Tool>,
    tool_from_flange: Rigid<Tool, Flange>,
}

/// Why no joints reach a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unreachable {
    /// Farther or nearer than the arm can.
    OutOfReach,
    /// Reachable only beyond the travel of a joint.
    JointLimit,
}

impl ToolArm {
    /// With a tool mounted as stated.
    pub fn new(flange_from_tool: Rigid<Flange, Tool>) -> Self {
        Self {
            flange_from_tool,
            tool_from_flange: flange_from_tool.inverse(),
        }
    }

    /// How the tool is mounted.
    pub fn flange_from_tool(&self) -> Rigid<Flange, Tool> {
        self.flange_from_tool
    }

    /// Where the tool is at the given joints.
    pub fn base_from_tool(&self, joints: &Joints) -> Rigid<Base, Tool> {
        ur5::forward(joints) * self.flange_from_tool
    }

    /// The joints nearest to `reference` that bring the tool to a pose.
    pub fn joints(
        &self,
        base_from_tool: &Rigid<Base, Tool>,
        reference: &Joints,
    ) -> Result<Joints, Unreachable> {
        let base_from_flange = *base_from_tool * self.tool_from_flange;
        let solutions = ur5::inverse(&base_from_flange, reference);
        if solutions.as_slice().is_empty() {
            return Err(Unreachable::OutOfReach);
        }
        let joints = solutions
            .nearest(reference)
            .ok_or(Unreachable::JointLimit)?;
        let reached = ur5::forward(&joints);
        let missed_mm = (reached.origin() - base_from_flange.origin()).norm();
        let missed_rad = turn_between(&reached, &base_from_flange);
        if missed_mm.max(missed_rad) > RESIDUAL_MAX {
            return Err(Unreachable::OutOfReach);
        }
        Ok(joints)
    }
}

/// The angle between two orientations, rad, precise also where it is tiny.
pub fn turn_between(a: &Rigid<Base, Flange>, b: &Rigid<Base, Flange>) -> f64 {
    let between = a.rotation().inverse() * b.rotation();
    2.0 * between.imag().norm().atan2(between.w.abs())
}

/// The joint that differs most, and by how much, rad.
pub fn largest_difference(a: &Joints, b: &Joints) -> (usize, f64) {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs())
        .enumerate()
        .fold(
            (0, 0.0),
            |worst, next| {
                if next.1 > worst.1 { next } else { worst }
            },
        )
}
