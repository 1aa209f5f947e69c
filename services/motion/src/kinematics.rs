//! Kinematics of an arm that carries a tool: joints to tool and back, every inverse verified.
//!
//! [`model`] says which arm it is; [`links`] is the closed form of an arm as drawn, [`dh`] the chain of a
//! calibrated one, [`polish`] its inverse; [`singularity`] tells how far the arm is from losing a direction.

pub mod dh;
pub mod flange_pose;
pub mod joint_limits;
pub mod links;
pub mod model;
pub mod polish;
pub mod singularity;
pub mod solutions;
mod trigonometry;

use arthro_geometry::frame::{Base, Flange, Tool};
use arthro_geometry::nalgebra::Matrix6;
use arthro_geometry::{Point3, Rigid, Vector3};

use self::flange_pose::FlangePose;
use self::model::Model;

/// Six joint angles from base to wrist 3, rad.
pub type Joints = [f64; 6];

/// How far the forward kinematics of an inverse solution may be from what was asked, mm and rad.
const RESIDUAL_MAX: f64 = 1e-9;

/// An arm with a tool at its flange.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolArm {
    model: Model,
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
    pub fn new(model: Model, flange_from_tool: Rigid<Flange, Tool>) -> Self {
        Self {
            model,
            flange_from_tool,
            tool_from_flange: flange_from_tool.inverse(),
        }
    }

    /// The same arm as drawn, without its calibration.
    pub fn drawn(&self) -> Self {
        Self::new(self.model.drawn(), self.flange_from_tool)
    }

    /// The arm without its tool.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// How the tool is mounted.
    pub fn flange_from_tool(&self) -> Rigid<Flange, Tool> {
        self.flange_from_tool
    }

    /// Where the tool is at the given joints.
    pub fn base_from_tool(&self, joints: &Joints) -> Rigid<Base, Tool> {
        self.model.base_from_flange(joints) * self.flange_from_tool
    }

    /// Velocity in base axes of a point that moves with the tool, `[v mm/s; w rad/s] = J q'`.
    pub fn jacobian_at(&self, joints: &Joints, point: &Point3) -> Matrix6<f64> {
        let mut jacobian = self.model.jacobian(joints);
        let from_flange = point.coords - self.model.forward(joints).origin_mm;
        for mut column in jacobian.column_iter_mut() {
            let turning = column.fixed_rows::<3>(3).into_owned();
            let mut moving = column.fixed_rows_mut::<3>(0);
            moving += turning.cross(&from_flange);
        }
        jacobian
    }

    /// The joints nearest to `reference` that bring the tool to a pose.
    pub fn joints(
        &self,
        base_from_tool: &Rigid<Base, Tool>,
        reference: &Joints,
    ) -> Result<Joints, Unreachable> {
        let flange = FlangePose::from(*base_from_tool * self.tool_from_flange);
        let solutions = self.model.inverse_near(&flange, reference);
        if solutions.as_slice().is_empty() {
            return Err(Unreachable::OutOfReach);
        }
        let joints = solutions
            .nearest(reference, self.model.limits())
            .ok_or(Unreachable::JointLimit)?;
        let reached = self.model.forward(&joints);
        let (shift_mm, turn_rad) = reached.error_to(&flange);
        let missed = shift_mm.norm().max(turn_rad.norm());
        let reaches = (..=RESIDUAL_MAX).contains(&missed) && reached.faces(&flange);
        if reaches {
            Ok(joints)
        } else {
            Err(Unreachable::OutOfReach)
        }
    }

    /// The smallest distance of any joint to its limit, rad; negative beyond it.
    pub fn limit_margin_rad(&self, joints: &Joints) -> f64 {
        self.model.limit_margin_rad(joints)
    }
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

/// The Jacobian of a chain whose joints turn about the given axes through the given points, at `point`.
fn jacobian_of(pivots: &[(Vector3, Vector3); 6], point: &Vector3) -> Matrix6<f64> {
    let mut jacobian = Matrix6::zeros();
    for (column, (axis, origin)) in pivots.iter().enumerate() {
        let moving = axis.cross(&(point - origin));
        jacobian
            .fixed_view_mut::<3, 1>(0, column)
            .copy_from(&moving);
        jacobian.fixed_view_mut::<3, 1>(3, column).copy_from(axis);
    }
    jacobian
}

/// The same angle in (-pi, pi].
fn wrap(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    angle - TAU * ((angle - PI) / TAU).ceil()
}

#[cfg(test)]
mod tests;
