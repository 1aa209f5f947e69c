//! The rules, in the order in which they are asked: the most severe first. docs/supervisor.md tells them as a table.

use ur_link::RobotMode;

use super::{Breach, Measured, Observation, Regime, Supervisor};
use crate::workspace::least_room;

/// A measured tip may be this much deeper than the deepest commanded one, mm.
const DEPTH_TOLERANCE_MM: f64 = 0.5;
/// A measured shaft may lean this much more than the planned one leans at most, rad.
const CONE_TOLERANCE_RAD: f64 = 0.01;
/// A measured joint may be this much faster than the fastest planned one.
const SPEED_TOLERANCE: f64 = 1.2;

impl Supervisor {
    /// The first rule that is broken, the most severe first.
    pub fn check(
        &self,
        regime: Regime,
        measured: &Measured,
        seen: &Observation,
    ) -> Result<(), Breach> {
        check_controller(measured)?;
        let moving = regime != Regime::Standing;
        if moving {
            self.check_state(measured, seen)?;
        }
        self.check_portal(regime, seen)?;
        self.check_speeds(measured, seen)?;
        if moving {
            self.check_planes(seen)?;
            self.other.check(regime, self.limits.other_arm_stale_s)?;
        }
        Ok(())
    }

    /// Rules about the state itself while the arm moves.
    fn check_state(&self, measured: &Measured, seen: &Observation) -> Result<(), Breach> {
        // A NaN is in no range.
        if !(0.0..=self.limits.stale_s).contains(&seen.gap_s) {
            return Err(breach(
                "STATE_STALE",
                "controller time since the state before",
                seen.gap_s,
                self.limits.stale_s,
                "s",
            ));
        }
        if let Some(before) = seen.safety_mode_before {
            return Err(Breach {
                reason: "MODE_CHANGED",
                detail: format!(
                    "safety mode was {before} and is {}; must not change during a move",
                    measured.safety_mode
                ),
            });
        }
        Ok(())
    }

    /// Rules about the portal.
    fn check_portal(&self, regime: Regime, seen: &Observation) -> Result<(), Breach> {
        let Some(placement) = seen.placement.filter(|_| seen.inside) else {
            return Ok(());
        };
        if regime == Regime::Outside {
            return Err(breach(
                "TOOL_INSIDE",
                "depth beyond the portal in a move outside",
                placement.depth_mm,
                0.0,
                "mm",
            ));
        }
        let rcm_limit = self.rcm_limit_mm();
        if placement.deviation_mm() > rcm_limit {
            return Err(breach(
                "RCM_DEVIATION",
                "distance of the shaft to the portal",
                placement.deviation_mm(),
                rcm_limit,
                "mm",
            ));
        }
        if regime != Regime::Inward {
            return Ok(());
        }
        let depth_limit = self.limits.depth_max_mm + DEPTH_TOLERANCE_MM;
        if placement.depth_mm > depth_limit {
            return Err(breach(
                "TOO_DEEP",
                "depth beyond the portal",
                placement.depth_mm,
                depth_limit,
                "mm",
            ));
        }
        let cone_limit = self.limits.cone_max_rad + CONE_TOLERANCE_RAD;
        match seen.cone_rad {
            Some(cone_rad) if cone_rad > cone_limit => Err(breach(
                "CONE",
                "angle of the shaft to the axis of the portal",
                cone_rad,
                cone_limit,
                "rad",
            )),
            _ => Ok(()),
        }
    }

    fn check_speeds(&self, measured: &Measured, seen: &Observation) -> Result<(), Breach> {
        let speed_limit = SPEED_TOLERANCE * self.limits.joint_speed_rad_s;
        for (joint, speed) in (1..).zip(measured.joint_speeds_rad_s) {
            // A NaN is in no range.
            if !(..=speed_limit).contains(&speed.abs()) {
                let what = format!("speed of joint {joint}");
                return Err(breach(
                    "JOINT_SPEED",
                    &what,
                    speed.abs(),
                    speed_limit,
                    "rad/s",
                ));
            }
        }
        let tip_limit = self.limits.tip_speed_inside_stop_mm_s;
        if seen.inside && !(..=tip_limit).contains(&seen.tip_speed_mm_s) {
            return Err(breach(
                "TIP_SPEED_INSIDE",
                "speed of the tip inside",
                seen.tip_speed_mm_s,
                tip_limit,
                "mm/s",
            ));
        }
        Ok(())
    }

    fn check_planes(&self, seen: &Observation) -> Result<(), Breach> {
        let tip = seen.base_from_tool.origin();
        match least_room(&self.limits.planes, &tip, &seen.bodies) {
            Some(least) if least.room_mm < self.plane_room_mm => {
                let what = format!("room of the {} to the plane {}", least.body, least.plane);
                Err(breach(
                    "WORKSPACE",
                    &what,
                    least.room_mm,
                    self.plane_room_mm,
                    "mm",
                ))
            }
            _ => Ok(()),
        }
    }

    /// The stop limit; after an acknowledged breach half of it beyond the deviation acknowledged.
    fn rcm_limit_mm(&self) -> f64 {
        let stop_mm = self.limits.rcm_stop_mm;
        if self.acknowledged_mm > 0.0 {
            stop_mm.max(self.acknowledged_mm + 0.5 * stop_mm)
        } else {
            stop_mm
        }
    }
}

/// Rules about the controller, which hold whatever the arm does.
fn check_controller(measured: &Measured) -> Result<(), Breach> {
    if !measured.safety_mode.allows_motion() {
        return Err(Breach {
            reason: "SAFETY_MODE",
            detail: format!(
                "safety mode is {}; must be NORMAL or REDUCED",
                measured.safety_mode
            ),
        });
    }
    if measured.robot_mode != RobotMode::Running {
        return Err(Breach {
            reason: "ROBOT_MODE",
            detail: format!("robot mode is {}; must be RUNNING", measured.robot_mode),
        });
    }
    // A NaN fails every comparison and would pass every limit.
    if !measured.joints_rad.iter().all(|joint| joint.is_finite()) {
        return Err(Breach {
            reason: "STATE_UNKNOWN",
            detail: "a measured joint is no number".to_owned(),
        });
    }
    Ok(())
}

pub(super) fn breach(
    reason: &'static str,
    what: &str,
    value: f64,
    limit: f64,
    unit: &str,
) -> Breach {
    Breach {
        reason,
        detail: format!("{what} is {value:.3} {unit}; limit {limit:.3} {unit}"),
    }
}
