//! What an arm may do, all in mm, rad and s.

use serde::{Deserialize, Serialize};

use crate::workspace::Plane;

/// Limits of one arm. The planner keeps within them; the supervisor checks what was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// The shaft's distance to the portal while inside: the supervisor stops beyond it, mm.
    pub rcm_stop_mm: f64,
    /// The same: the supervisor warns beyond it and lets the arm go on, mm.
    pub rcm_warn_mm: f64,
    /// The shaft's angle to the portal's axis while inside, if the portal has one, rad.
    pub cone_max_rad: f64,
    /// Speed of the tip in free moves, mm/s.
    pub free_speed_mm_s: f64,
    /// Acceleration of the tip in free moves, mm/s2.
    pub free_acceleration_mm_s2: f64,
    /// Speed of the tip along the shaft, mm/s.
    pub inside_speed_mm_s: f64,
    /// Acceleration of the tip along the shaft, mm/s2.
    pub inside_acceleration_mm_s2: f64,
    /// Measured speed of the tip while inside, whatever moves it: the supervisor stops beyond it, mm/s.
    pub tip_speed_inside_stop_mm_s: f64,
    /// Jerk of the tip along the shaft, mm/s3.
    pub inside_jerk_mm_s3: f64,
    /// Turning about the portal, rad/s.
    pub pivot_speed_rad_s: f64,
    /// Acceleration of the turning, rad/s2.
    pub pivot_acceleration_rad_s2: f64,
    /// Jerk of the turning, rad/s3.
    pub pivot_jerk_rad_s3: f64,
    /// Speed of any joint, rad/s. The supervisor stops at 1.2 times as much.
    pub joint_speed_rad_s: f64,
    /// Acceleration of any joint, rad/s2.
    pub joint_acceleration_rad_s2: f64,
    /// Jerk of any joint, rad/s3.
    pub joint_jerk_rad_s3: f64,
    /// Deepest tip beyond the portal, mm.
    pub depth_max_mm: f64,
    /// Controller time without a new state after which a moving arm is stopped, s.
    pub stale_s: f64,
    /// Free room between the shafts of both arms, mm.
    pub shafts_distance_min_mm: f64,
    /// Free room between any other two bodies of both arms, mm.
    pub arms_distance_min_mm: f64,
    /// Age of what is known of the other arm beyond which a moving arm is stopped, in this controller's time, s.
    pub other_arm_stale_s: f64,
    /// Half-spaces that the arm keeps to.
    pub planes: Vec<Plane>,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            rcm_stop_mm: 1.0,
            rcm_warn_mm: 0.5,
            cone_max_rad: 60f64.to_radians(),
            free_speed_mm_s: 100.0,
            free_acceleration_mm_s2: 300.0,
            inside_speed_mm_s: 20.0,
            inside_acceleration_mm_s2: 60.0,
            tip_speed_inside_stop_mm_s: 40.0,
            inside_jerk_mm_s3: 600.0,
            pivot_speed_rad_s: 0.25,
            pivot_acceleration_rad_s2: 0.75,
            pivot_jerk_rad_s3: 7.5,
            joint_speed_rad_s: 1.0,
            joint_acceleration_rad_s2: 3.0,
            joint_jerk_rad_s3: 30.0,
            depth_max_mm: 80.0,
            stale_s: 0.1,
            shafts_distance_min_mm: 1.0,
            arms_distance_min_mm: 20.0,
            other_arm_stale_s: 0.2,
            planes: Vec::new(),
        }
    }
}

impl Limits {
    /// The limits that are numbers by name, for checks of a configuration.
    pub fn named(&self) -> [(&'static str, f64); 20] {
        [
            ("rcm_stop_mm", self.rcm_stop_mm),
            ("rcm_warn_mm", self.rcm_warn_mm),
            ("cone_max_rad", self.cone_max_rad),
            ("free_speed_mm_s", self.free_speed_mm_s),
            ("free_acceleration_mm_s2", self.free_acceleration_mm_s2),
            ("inside_speed_mm_s", self.inside_speed_mm_s),
            ("inside_acceleration_mm_s2", self.inside_acceleration_mm_s2),
            (
                "tip_speed_inside_stop_mm_s",
                self.tip_speed_inside_stop_mm_s,
            ),
            ("inside_jerk_mm_s3", self.inside_jerk_mm_s3),
            ("pivot_speed_rad_s", self.pivot_speed_rad_s),
            ("pivot_acceleration_rad_s2", self.pivot_acceleration_rad_s2),
            ("pivot_jerk_rad_s3", self.pivot_jerk_rad_s3),
            ("joint_speed_rad_s", self.joint_speed_rad_s),
            ("joint_acceleration_rad_s2", self.joint_acceleration_rad_s2),
            ("joint_jerk_rad_s3", self.joint_jerk_rad_s3),
            ("depth_max_mm", self.depth_max_mm),
            ("stale_s", self.stale_s),
            ("shafts_distance_min_mm", self.shafts_distance_min_mm),
            ("arms_distance_min_mm", self.arms_distance_min_mm),
            ("other_arm_stale_s", self.other_arm_stale_s),
        ]
    }
}
