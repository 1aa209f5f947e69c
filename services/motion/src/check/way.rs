//! What the way to a target is like, and which limit it comes nearest to.

use crate::trajectory::{Margins, RCM_BETWEEN_SAMPLES_MM};

/// Distances to limits that are ample: farther is no better.
const JOINT_AMPLE_RAD: f64 = 0.5;
const SINGULAR_AMPLE_RAD: f64 = 0.35;
const SHOULDER_AMPLE_MM: f64 = 150.0;
const CONE_AMPLE_RAD: f64 = 0.175;
const DEPTH_AMPLE_MM: f64 = 10.0;

/// A way to a target, at its worst place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    /// Of joints and shaft.
    pub margins: Margins,
    /// Of the shaft to the edge of the cone, rad; half a turn without an axis.
    pub cone_rad: f64,
    /// Of the target to the deepest allowed, mm.
    pub depth_mm: f64,
    /// The limit of the joints' speed, rad/s.
    pub joint_speed_max_rad_s: f64,
    /// Of the way in, s.
    pub duration_s: f64,
}

impl Way {
    /// The least room to any limit, 1 ample and 0 at the limit, and the limit's name.
    pub fn least_room(&self) -> (f64, &'static str) {
        let margins = &self.margins;
        let singularities = &margins.singularities;
        [
            (margins.joint_limit_rad / JOINT_AMPLE_RAD, "JOINT_LIMIT"),
            (singularities.wrist_rad / SINGULAR_AMPLE_RAD, "WRIST"),
            (singularities.elbow_rad / SINGULAR_AMPLE_RAD, "ELBOW"),
            (singularities.shoulder_mm / SHOULDER_AMPLE_MM, "SHOULDER"),
            (self.cone_rad / CONE_AMPLE_RAD, "CONE"),
            (self.depth_mm / DEPTH_AMPLE_MM, "DEPTH"),
            (
                1.0 - margins.rcm_between_samples_mm / RCM_BETWEEN_SAMPLES_MM,
                "RCM",
            ),
            (
                1.0 - margins.joint_speed_rad_s / self.joint_speed_max_rad_s,
                "JOINT_SPEED",
            ),
        ]
        .into_iter()
        .map(|(room, word)| (room.clamp(0.0, 1.0), word))
        .fold(
            (1.0, "NONE"),
            |least, next| {
                if next.0 < least.0 { next } else { least }
            },
        )
    }
}
