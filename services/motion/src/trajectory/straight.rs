//! The walk along a straight move of the controller, for comparison with paths through the portal.

use arthro_geometry::Point3;

use super::rates::JUMP_RAD;
use super::{Margins, jump, unreachable_at};
use crate::error::Error;
use crate::kinematics::{Joints, ToolArm, largest_difference};
use crate::rcm::Placement;
use crate::rcm::straight::Straight;

/// Most samples that are walked.
const SAMPLES_MAX: usize = 2000;

/// Goes along a line at constant speed; what it finds, and the joints at its end.
///
/// # Errors
/// The line leaves the reach or the joint limits, or a joint jumps.
pub fn walk_straight(
    arm: &ToolArm,
    line: &Straight,
    portal: &Point3,
    start: &Joints,
    duration_s: f64,
    period_s: f64,
) -> Result<(Margins, Joints), Error> {
    let samples = ((duration_s / period_s).ceil() as usize).clamp(1, SAMPLES_MAX);
    let period_s = (duration_s / samples as f64).max(f64::MIN_POSITIVE);
    let deviation_mm =
        |joints: &Joints| Placement::of(&arm.base_from_tool(joints), portal).deviation_mm();
    let mut margins = Margins::at(arm, start);
    margins.rcm_at_samples_mm = deviation_mm(start);
    let mut before = *start;
    for sample in 1..=samples {
        let s = sample as f64 / samples as f64;
        let joints = arm
            .joints(&line.pose(s), &before)
            .map_err(|unreachable| unreachable_at(unreachable, s))?;
        let (joint, step_rad) = largest_difference(&joints, &before);
        if !(..=JUMP_RAD).contains(&step_rad) {
            return Err(jump(joint, step_rad, s));
        }
        let middle = std::array::from_fn(|i| 0.5 * (joints[i] + before[i]));
        let mut here = Margins::at(arm, &joints);
        here.joint_speed_rad_s = step_rad / period_s;
        here.rcm_at_samples_mm = deviation_mm(&joints);
        here.rcm_between_samples_mm = deviation_mm(&middle);
        margins = margins.worst(&here);
        before = joints;
    }
    Ok((margins, before))
}
