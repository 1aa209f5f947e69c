//! What the walk through a trajectory found, and how it compares.

use crate::kinematics::singularity::Singularities;
use crate::kinematics::{Joints, ToolArm};

/// What the check of a trajectory found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// Smallest distance of any joint to its limit, rad.
    pub joint_limit_rad: f64,
    /// Smallest distances to the singularities.
    pub singularities: Singularities,
    /// Smallest manipulability, mm3.
    pub manipulability_mm3: f64,
    /// Largest distance of the shaft to where the path has it, at samples, mm.
    pub rcm_at_samples_mm: f64,
    /// The same halfway between samples with joints moving linearly, mm.
    pub rcm_between_samples_mm: f64,
    /// Largest joint speed, rad/s.
    pub joint_speed_rad_s: f64,
}

impl Margins {
    /// Of an arm that stands at `joints`, on its path.
    pub fn at(arm: &ToolArm, joints: &Joints) -> Self {
        Self {
            joint_limit_rad: arm.limit_margin_rad(joints),
            singularities: arm.model().singularities(joints),
            manipulability_mm3: arm.model().manipulability_mm3(joints),
            rcm_at_samples_mm: 0.0,
            rcm_between_samples_mm: 0.0,
            joint_speed_rad_s: 0.0,
        }
    }

    /// The worse of two, number by number.
    pub fn worst(&self, other: &Self) -> Self {
        let (near, far) = (&self.singularities, &other.singularities);
        Self {
            joint_limit_rad: self.joint_limit_rad.min(other.joint_limit_rad),
            singularities: Singularities {
                wrist_rad: near.wrist_rad.min(far.wrist_rad),
                elbow_rad: near.elbow_rad.min(far.elbow_rad),
                shoulder_mm: near.shoulder_mm.min(far.shoulder_mm),
            },
            manipulability_mm3: self.manipulability_mm3.min(other.manipulability_mm3),
            rcm_at_samples_mm: self.rcm_at_samples_mm.max(other.rcm_at_samples_mm),
            rcm_between_samples_mm: self
                .rcm_between_samples_mm
                .max(other.rcm_between_samples_mm),
            joint_speed_rad_s: self.joint_speed_rad_s.max(other.joint_speed_rad_s),
        }
    }
}
