//! The watch over one arm: every controller cycle it judges what was measured, never what was
//! commanded, and says why an arm must stop.

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::{Point3, Rigid};
use ur_link::{RobotMode, SafetyMode};

use crate::kinematics::{Joints, ToolArm};
use crate::limits::Limits;
use crate::rcm::Placement;

/// A measured tip may be this much deeper than the deepest commanded one, mm.
const DEPTH_TOLERANCE_MM: f64 = 0.5;
/// A measured joint may be this much faster than the fastest planned one.
const SPEED_TOLERANCE: f64 = 1.2;

/// One arm's watch. It remembers whether the tip is inside and when the last state came.
#[derive(Clone, Debug)]
pub struct Supervisor {
    arm: ToolArm,
    limits: Limits,
    inside: bool,
    last_time_s: Option<f64>,
    /// A deviation that the operator has acknowledged: the shaft may be drawn back along its own line.
    acknowledged_mm: f64,
}

/// What the arm is doing, as far as the rules differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Regime {
    /// It stands or is being stopped.
    Standing,
    /// It moves outside.
    Outside,
    /// It pivots or goes in.
    Inward,
    /// It draws back.
    Outward,
}

/// What was measured in one controller cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Controller clock, s.
    pub time_s: f64,
    /// Joint angles, rad.
    pub joints_rad: Joints,
    /// Joint speeds, rad/s.
    pub joint_speeds_rad_s: Joints,
    /// Power and brakes.
    pub robot_mode: RobotMode,
    /// The controller's own safety system.
    pub safety_mode: SafetyMode,
}

/// What follows from the measured joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// From measured joints.
    pub base_from_tool: Rigid<Base, Tool>,
    /// To the portal, if there is one.
    pub placement: Option<Placement>,
    /// Whether the tip is beyond the portal.
    pub inside: bool,
    /// Controller time since the state before, s.
    pub gap_s: f64,
}

/// Why the arm must stop.
#[derive(Clone, Debug, PartialEq)]
pub struct Breach {
    /// A stable word.
    pub reason: &'static str,
    /// With value and limit.
    pub detail: String,
}

impl Supervisor {
    /// Nothing measured yet.
    pub fn new(arm: ToolArm, limits: Limits) -> Self {
        Self {
            arm,
            limits,
            inside: false,
            last_time_s: None,
            acknowledged_mm: 0.0,
        }
    }

    /// Takes in a new measurement.
    ///
    /// Once inside, the tip counts as inside until it is drawn back, however far the shaft strays.
    pub fn observe(&mut self, measured: &Measured, portal: Option<&Point3>) -> Observation {
        let base_from_tool = self.arm.base_from_tool(&measured.joints_rad);
        let placement = portal.map(|portal| Placement::of(&base_from_tool, portal));
        self.inside = placement.is_some_and(|placement| {
            let drawn_back = placement.depth_mm <= 0.0;
            placement.is_inside() || (self.inside && !drawn_back)
        });
        if !self.inside {
            self.acknowledged_mm = 0.0;
        }
        let gap_s = self
            .last_time_s
            .map_or(0.0, |last_time_s| measured.time_s - last_time_s);
        self.last_time_s = Some(measured.time_s);
        Observation {
            base_from_tool,
            placement,
            inside: self.inside,
            gap_s,
        }
    }

    /// The first rule that is broken, the most severe first.
    pub fn check(
        &self,
        regime: Regime,
        measured: &Measured,
        seen: &Observation,
    ) -> Result<(), Breach> {
        self.check_controller(measured)?;
        let moving = regime != Regime::Standing;
        if moving && !(0.0..=self.limits.stale_s).contains(&seen.gap_s) {
            return Err(breach(
                "STATE_STALE",
                "controller time since the state before",
                seen.gap_s,
                self.limits.stale_s,
                "s",
            ));
        }
        self.check_portal(regime, seen)?;
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
        Ok(())
    }

    /// Lets a shaft that is off the portal be drawn back, after its fault was acknowledged.
    pub fn acknowledge(&mut self, seen: &Observation) {
        if let Some(placement) = seen.placement.filter(|_| seen.inside) {
            self.acknowledged_mm = placement.deviation_mm();
        }
    }

    /// A gap in the states is over, such as that of a new link.
    pub fn forget_time(&mut self) {
        self.last_time_s = None;
    }

    /// Rules about the controller, which hold whatever the arm does.
    fn check_controller(&self, measured: &Measured) -> Result<(), Breach> {
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
        let depth_limit = self.limits.depth_max_mm + DEPTH_TOLERANCE_MM;
        if regime == Regime::Inward && placement.depth_mm > depth_limit {
            return Err(breach(
                "TOO_DEEP",
                "depth beyond the portal",
                placement.depth_mm,
                depth_limit,
                "mm",
            ));
        }
        Ok(())
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

fn breach(reason: &'static str, what: &str, value: f64, limit: f64, unit: &str) -> Breach {
    Breach {
        reason,
        detail: format!("{what} is {value:.3} {unit}; limit {limit:.3} {unit}"),
    }
}

#[cfg(test)]
mod tests;
