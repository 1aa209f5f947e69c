//! How far the arm is from where it loses a direction of motion.
//!
//! With the lengths of the drawing `|det J| = |a2 a3 sin q3 sin q5 (a2 c2 + a3 c23 + d5 s234)|`: there are three
//! ways to be singular, and no others. A calibrated arm is singular within some milliradians of these.

use std::f64::consts::PI;

use super::Joints;
use super::links::Links;

/// The distances to the three singularities.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Singularities {
    /// Of joint 5 to 0 or half a turn, where joints 4 and 6 turn about parallel axes, rad.
    pub wrist_rad: f64,
    /// Of joint 3 to 0 or half a turn, where the arm is stretched or folded, rad.
    pub elbow_rad: f64,
    /// Of the last bend of the wrist to the vertical plane through the shoulder's axes, mm: within it joint 1
    /// does not move the wrist out of the plane of the arm.
    pub shoulder_mm: f64,
}

impl Singularities {
    /// Of an arm with these lengths at the given joints.
    pub fn of(links: &Links, joints: &Joints) -> Self {
        Self {
            wrist_rad: to_half_turns(joints[4]),
            elbow_rad: to_half_turns(joints[2]),
            shoulder_mm: reach_of_last_bend(links, joints).abs(),
        }
    }
}

/// `|det J|` of an arm with these lengths, mm3: Yoshikawa's manipulability.
pub fn manipulability_mm3(links: &Links, joints: &Joints) -> f64 {
    let arms = links.a2_mm * links.a3_mm * joints[2].sin();
    (arms * joints[4].sin() * reach_of_last_bend(links, joints)).abs()
}

/// Of the last bend along the arm's plane from the axis of joint 1, mm; negative behind it.
fn reach_of_last_bend(links: &Links, joints: &Joints) -> f64 {
    let q23 = joints[1] + joints[2];
    links.a2_mm * joints[1].cos() + links.a3_mm * q23.cos() + links.d5_mm * (q23 + joints[3]).sin()
}

/// To the nearest multiple of half a turn, rad.
fn to_half_turns(angle: f64) -> f64 {
    (angle - PI * (angle / PI).round()).abs()
}
