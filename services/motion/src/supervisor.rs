//! The watch over one arm: every controller cycle it judges what was measured, never what was
//! commanded, and says why an arm must stop.

mod other_arm;
mod rules;

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::nalgebra::Unit;
use arthro_geometry::{Point3, Rigid, Vector3};
use ur_link::{RobotMode, SafetyMode};

use self::other_arm::OtherArm;
use crate::bodies::Bodies;
use crate::cell::{Berth, Present};
use crate::clearance::Keep;
use crate::kinematics::{Joints, ToolArm};
use crate::limits::Limits;
use crate::rcm::{Placement, Turn, shaft};
use crate::workspace::least_room;

/// A deviation this much below the limit of the warning ends the episode.
const WARNING_ENDS: f64 = 0.8;
/// What an arm that is beyond a plane or too near to the other may still lose of its room once that was
/// acknowledged, mm: measurement and the stop ramp.
const ROOM_SLACK_MM: f64 = 1.0;
/// The step in time by which the speed of the tip is taken from the joint speeds, s.
const SPEED_STEP_S: f64 = 1e-4;

/// One arm's watch. It remembers whether the tip is inside, when the last state came, and what was acknowledged.
#[derive(Clone, Debug)]
pub struct Supervisor {
    arm: ToolArm,
    limits: Limits,
    berth: Berth,
    inside: bool,
    last: Option<Last>,
    /// Of states.
    number: u64,
    other: OtherArm,
    /// A deviation that the operator has acknowledged: the shaft may be drawn back along its own line.
    acknowledged_mm: f64,
    /// Room to the planes that the arm must keep, mm: 0 unless it was beyond one and that was acknowledged.
    plane_room_mm: f64,
    /// The shaft was beyond the warning limit and has not come back clearly below it.
    warned: bool,
}

#[derive(Clone, Copy, Debug)]
struct Last {
    time_s: f64,
    safety_mode: SafetyMode,
    bodies: Bodies,
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
    /// In the arm's base.
    pub bodies: Bodies,
    /// Speed of the tip, from measured joint speeds, mm/s.
    pub tip_speed_mm_s: f64,
    /// The shaft's angle to the axis of the portal, if it has one, rad.
    pub cone_rad: Option<f64>,
    /// The safety mode of the state before, if it was another one.
    pub safety_mode_before: Option<SafetyMode>,
    /// The shaft is off the portal by more than the limit of the warning, mm.
    pub warning_mm: Option<f64>,
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
    pub fn new(arm: ToolArm, limits: Limits, berth: Berth) -> Self {
        let keep = Keep::of(&limits);
        Self {
            arm,
            limits,
            berth,
            inside: false,
            last: None,
            number: 0,
            other: OtherArm::new(keep),
            acknowledged_mm: 0.0,
            plane_room_mm: 0.0,
            warned: false,
        }
    }

    /// Takes in a new measurement, tells the other arm of it and looks at the other arm.
    ///
    /// Once inside, the tip counts as inside until it is drawn back, however far the shaft strays.
    /// `axis` is that of the portal, into the joint: the middle of the cone that the shaft keeps to.
    pub fn observe(
        &mut self,
        measured: &Measured,
        portal: Option<&Point3>,
        axis: Option<&Unit<Vector3>>,
    ) -> Observation {
        let base_from_tool = self.arm.base_from_tool(&measured.joints_rad);
        let placement = portal.map(|portal| Placement::of(&base_from_tool, portal));
        self.inside = placement.is_some_and(|placement| {
            let drawn_back = placement.depth_mm <= 0.0;
            placement.is_inside() || (self.inside && !drawn_back)
        });
        if !self.inside {
            self.acknowledged_mm = 0.0;
        }
        let warning_mm = self.warning_mm(placement.as_ref());
        let bodies = self.berth.bodies(&measured.joints_rad, &base_from_tool);
        let gap_s = self.last.map_or(0.0, |last| measured.time_s - last.time_s);
        let safety_mode_before = self
            .last
            .map(|last| last.safety_mode)
            .filter(|before| *before != measured.safety_mode);
        self.tell(&bodies, gap_s);
        let common = self.berth.in_common(&bodies);
        self.other.look(&self.berth, &common, measured.time_s);
        let room_mm = least_room(&self.limits.planes, &base_from_tool.origin(), &bodies);
        if room_mm.is_none_or(|least| least.room_mm >= 0.0) {
            self.plane_room_mm = 0.0;
        }
        self.last = Some(Last {
            time_s: measured.time_s,
            safety_mode: measured.safety_mode,
            bodies,
        });
        Observation {
            base_from_tool,
            placement,
            inside: self.inside,
            gap_s,
            bodies,
            tip_speed_mm_s: self.tip_speed_mm_s(measured, &base_from_tool),
            cone_rad: axis.map(|axis| Turn::between(axis, &shaft(&base_from_tool)).angle_rad),
            safety_mode_before,
            warning_mm,
        }
    }

    /// Holds what was seen last against a portal that was stated since. Without it the tip would count as outside until the
    /// next measurement, and a tool that was inside all along could be let go elsewhere than back.
    pub fn place(&mut self, seen: &mut Observation, portal: &Point3, axis: Option<&Unit<Vector3>>) {
        let placement = Placement::of(&seen.base_from_tool, portal);
        self.inside = placement.is_inside();
        seen.placement = Some(placement);
        seen.inside = self.inside;
        seen.cone_rad =
            axis.map(|axis| Turn::between(axis, &shaft(&seen.base_from_tool)).angle_rad);
    }

    /// Lets an arm go on from where it is, once its operator has acknowledged that: a shaft that is off the
    /// portal may be drawn back, an arm beyond a plane or too near to the other may move away from it.
    pub fn acknowledge(&mut self, seen: &Observation) {
        if let Some(placement) = seen.placement.filter(|_| seen.inside) {
            self.acknowledged_mm = placement.deviation_mm();
        }
        let tip = seen.base_from_tool.origin();
        if let Some(least) = least_room(&self.limits.planes, &tip, &seen.bodies) {
            self.plane_room_mm = (least.room_mm - ROOM_SLACK_MM).min(0.0);
        }
        self.other.acknowledge(ROOM_SLACK_MM);
    }

    /// A gap in the states is over, such as that of a new link.
    pub fn forget_time(&mut self) {
        self.last = None;
        self.other.forget_time();
    }

    /// The free room to the other arm that a move must keep now.
    pub fn keep(&self) -> Keep {
        self.other.keep()
    }

    /// The free room to the planes that a move must keep now, mm.
    pub fn plane_room_mm(&self) -> f64 {
        self.plane_room_mm
    }

    fn tell(&mut self, bodies: &Bodies, gap_s: f64) {
        self.number += 1;
        let speed_mm_s = match self.last {
            Some(last) if gap_s > 0.0 => last.bodies.moved_mm(bodies) / gap_s,
            _ => 0.0,
        };
        self.berth.tell(Present {
            number: self.number,
            bodies: self.berth.in_common(bodies),
            speed_mm_s,
        });
    }

    fn warning_mm(&mut self, placement: Option<&Placement>) -> Option<f64> {
        let deviation_mm = placement
            .filter(|_| self.inside)
            .map_or(0.0, Placement::deviation_mm);
        let limit_mm = self.limits.rcm_warn_mm;
        self.warned =
            deviation_mm > limit_mm || (self.warned && deviation_mm > WARNING_ENDS * limit_mm);
        self.warned.then_some(deviation_mm)
    }

    /// By a small step along the measured joint speeds.
    fn tip_speed_mm_s(&self, measured: &Measured, base_from_tool: &Rigid<Base, Tool>) -> f64 {
        let ahead: Joints = std::array::from_fn(|i| {
            measured.joints_rad[i] + measured.joint_speeds_rad_s[i] * SPEED_STEP_S
        });
        let tip = self.arm.base_from_tool(&ahead).origin();
        (tip - base_from_tool.origin()).norm() / SPEED_STEP_S
    }
}

#[cfg(test)]
mod tests;
