//! How far joints that lag unequally bring the shaft off the portal.
//!
//! A joint that follows with the lag `T` is at `q - T q'` while it turns steadily. Lags that all joints
//! share only delay the path; what one joint lags more or less than the mean moves the shaft's point at
//! the portal by that lag times the speed that the joint gives this point, across the shaft.

use arthro_geometry::Vector3;

use crate::kinematics::{Joints, ToolArm};
use crate::rcm::{RcmPath, shaft};

/// Patterns of joints that lag more and less, but for the sign of all.
const PATTERNS: u32 = 1 << 5;

/// The largest deviation, mm, per second of lag beyond or below the mean and per unit of `s` a second,
/// over all patterns of which joints lag more and which less. `by_s` is dq/ds. Nothing while the tip is
/// outside.
pub fn deviation_per_lag(
    arm: &ToolArm,
    path: &RcmPath,
    s: f64,
    joints: &Joints,
    by_s: &[f64],
) -> f64 {
    if path.depth_mm(s) <= 0.0 {
        return 0.0;
    }
    let along = shaft(&path.pose(s));
    let jacobian = arm.jacobian_at(joints, &path.portal());
    let across: [Vector3; 6] = std::array::from_fn(|i| {
        let moved = jacobian.fixed_view::<3, 1>(0, i) * by_s[i];
        moved - along * along.dot(&moved)
    });
    (0..PATTERNS)
        .map(|pattern| {
            let signed = across.iter().enumerate().map(|(i, moved)| {
                if pattern >> i & 1 == 1 {
                    *moved
                } else {
                    -moved
                }
            });
            signed.sum::<Vector3>().norm_squared()
        })
        .fold(0.0, f64::max)
        .sqrt()
}
