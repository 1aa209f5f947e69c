//! How far each joint may turn.

use std::f64::consts::{PI, TAU};

use super::Joints;

/// The travel of each joint, rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointLimits {
    /// Least angle of each joint, rad.
    pub min_rad: Joints,
    /// Largest angle of each joint, rad.
    pub max_rad: Joints,
}

/// All joints turn a full turn either way; the elbow half a turn, beyond which the forearm would pass
/// through the upper arm.
impl Default for JointLimits {
    fn default() -> Self {
        let max_rad = [TAU, TAU, PI, TAU, TAU, TAU];
        Self {
            min_rad: max_rad.map(|limit| -limit),
            max_rad,
        }
    }
}

impl JointLimits {
    /// The smallest distance of any joint to its limit, rad; negative beyond it.
    pub fn margin_rad(&self, joints: &Joints) -> f64 {
        (0..6)
            .map(|i| (joints[i] - self.min_rad[i]).min(self.max_rad[i] - joints[i]))
            .fold(f64::INFINITY, f64::min)
    }

    /// Each joint by whole turns to where it is nearest to `reference` within its limits; `None` where one
    /// has no such turn.
    pub fn unwind(&self, joints: &Joints, reference: &Joints) -> Option<Joints> {
        let mut unwound = *joints;
        for (i, joint) in unwound.iter_mut().enumerate() {
            let turns = ((reference[i] - *joint) / TAU).round();
            let lowest = ((self.min_rad[i] - *joint) / TAU).ceil();
            let highest = ((self.max_rad[i] - *joint) / TAU).floor();
            // Also false where an angle or the reference is not a number.
            let within = lowest <= highest && turns.is_finite();
            if !within {
                return None;
            }
            *joint += turns.clamp(lowest, highest) * TAU;
        }
        Some(unwound)
    }
}
