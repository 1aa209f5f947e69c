//! What the walk through a trajectory found, and how it compares.

/// What the check of a trajectory found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// Smallest distance of any joint to its limit, rad.
    pub joint_limit_rad: f64,
    /// Largest distance of the shaft to where the path has it, at samples, mm.
    pub rcm_at_samples_mm: f64,
    /// The same halfway between samples with joints moving linearly, mm.
    pub rcm_between_samples_mm: f64,
    /// Largest joint speed, rad/s.
    pub joint_speed_rad_s: f64,
}

impl Margins {
    /// The worse of two, number by number.
    pub fn worst(&self, other: &Self) -> Self {
        Self {
            joint_limit_rad: self.joint_limit_rad.min(other.joint_limit_rad),
            rcm_at_samples_mm: self.rcm_at_samples_mm.max(other.rcm_at_samples_mm),
            rcm_between_samples_mm: self
                .rcm_between_samples_mm
                .max(other.rcm_between_samples_mm),
            joint_speed_rad_s: self.joint_speed_rad_s.max(other.joint_speed_rad_s),
        }
    }
}
