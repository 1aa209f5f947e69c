//! Two moves of which the second begins before the first ends: the corner between them is rounded by adding what is left
//! of the first to what is done of the second.

use nalgebra::Isometry3;

use super::{Motion, Progress, Target, each};
use crate::ur5::kinematics::{Dh, Joints};

/// A corner under way.
#[derive(Clone, Debug)]
pub struct Blend {
    first: Motion,
    first_target: Target,
    /// The move that follows.
    pub second: Motion,
    second_target: Target,
    corner: Joints,
}

impl Blend {
    /// Of a move whose joints are at `target` and one that begins at its goal.
    pub fn new(first: Motion, target: Target, corner: Joints, second: Motion) -> Self {
        Self {
            first,
            first_target: target,
            second,
            second_target: Target::resting(corner),
            corner,
        }
    }

    /// The joints after `dt` s of path time. [`Progress::Reached`] when the first move has ended.
    pub(super) fn advance(
        &mut self,
        dh: &Dh,
        flange_from_tool: &Isometry3<f64>,
        dt: f64,
        dt_real: f64,
    ) -> (Joints, Progress) {
        let first = self
            .first
            .advance(dh, &mut self.first_target, flange_from_tool, dt, dt_real);
        let second =
            self.second
                .advance(dh, &mut self.second_target, flange_from_tool, dt, dt_real);
        let joints = each(|joint| {
            self.first_target.q[joint] + self.second_target.q[joint] - self.corner[joint]
        });
        let progress = if second == Progress::NoSolution {
            second
        } else {
            first
        };
        (joints, progress)
    }
}
