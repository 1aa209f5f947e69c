//! The inverse solutions of one pose.

use super::Joints;
use super::joint_limits::JointLimits;

/// Most solutions that an arm of six turning joints has.
const MOST: usize = 16;

/// Up to eight of the arm as drawn: shoulder, wrist and elbow two ways each.
#[derive(Clone, Copy, Debug)]
pub struct Solutions {
    joints: [Joints; MOST],
    count: usize,
}

impl Default for Solutions {
    fn default() -> Self {
        Self {
            joints: [[0.0; 6]; MOST],
            count: 0,
        }
    }
}

impl Solutions {
    /// The solutions found.
    pub fn as_slice(&self) -> &[Joints] {
        &self.joints[..self.count]
    }

    /// The solution nearest to `reference`, each joint taken by whole turns to where it is nearest
    /// within its limits. `None` when there is none within the limits.
    pub fn nearest(&self, reference: &Joints, limits: &JointLimits) -> Option<Joints> {
        self.as_slice()
            .iter()
            .filter_map(|solution| limits.unwind(solution, reference))
            .map(|joints| (squared_distance(&joints, reference), joints))
            .min_by(|(a, _), (b, _)| a.total_cmp(b))
            .map(|(_, joints)| joints)
    }

    /// Adds one; beyond the most that there can be it is a repetition, and left out.
    pub(super) fn push(&mut self, joints: Joints) {
        if let Some(free) = self.joints.get_mut(self.count) {
            *free = joints;
            self.count += 1;
        }
    }
}

fn squared_distance(a: &Joints, b: &Joints) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}
