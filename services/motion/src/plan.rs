//! What a move turns into, checked along its whole way before anything moves.

pub mod inside;

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::nalgebra::Unit;
use arthro_geometry::{Point3, Rigid, Vector3};

use crate::error::Error;
use crate::kinematics::{Joints, ToolArm, Unreachable, largest_difference};
use crate::limits::Limits;
use crate::rcm::{Placement, Portal};
use crate::supervisor::{Observation, Regime};
use crate::trajectory::{Trajectory, jump};

/// Steps of the check of a move outside: no longer than these, mm and rad.
const STEP_MM: f64 = 5.0;
const STEP_RAD: f64 = 0.02;
/// A joint that moves farther in one such step jumps.
const JUMP_RAD: f64 = 0.3;
/// A turn of the tool is taken for at least this long a way, mm a rad: controllers bound the turning of
/// a move on the spot by a radius of their own, which is larger.
const TURN_RADIUS_MM: f64 = 100.0;
/// What a straight move may use of the joint speed limit: the rest is for the controller's own tracking.
const LINE_JOINT_SHARE: f64 = 0.85;
/// No straight move is slower, mm/s.
const LINE_SPEED_MIN_MM_S: f64 = 1.0;
/// A wider turn is so near to half a turn that the controller might take the other way round, rad.
const TURN_MAX_RAD: f64 = std::f64::consts::PI - 0.01;

/// A move as asked for. A speed of `None` means the limit.
#[derive(Clone, Debug, PartialEq)]
pub enum Move {
    /// A straight line outside.
    Free {
        /// Tool pose at the end.
        base_from_tool: Rigid<Base, Tool>,
        /// Tip speed, mm/s.
        speed_mm_s: Option<f64>,
    },
    /// Turns the shaft about the portal.
    Pivot {
        /// What the shaft shall aim at.
        aim: Point3,
        /// Turning speed, rad/s.
        speed_rad_s: Option<f64>,
    },
    /// Along the shaft, deeper.
    Insert {
        /// Depth at the end, mm.
        depth_mm: f64,
        /// Tip speed, mm/s.
        speed_mm_s: Option<f64>,
    },
    /// Along the shaft, back.
    Retract {
        /// Depth at the end, mm.
        depth_mm: f64,
        /// Tip speed, mm/s.
        speed_mm_s: Option<f64>,
    },
    /// Turns, rolls and inserts at once, on the portal.
    Rcm {
        /// Where the shaft shall point; `None`: as it does.
        aim: Option<Aim>,
        /// Depth at the end, mm.
        depth_mm: f64,
        /// About the shaft at the end, from the portal's reference, rad; `None`: as it is.
        roll_rad: Option<f64>,
        /// Tip speed, mm/s.
        speed_mm_s: Option<f64>,
        /// Turning speed, rad/s.
        speed_rad_s: Option<f64>,
    },
    /// All joints in common time, outside.
    Joints {
        /// At the end, rad.
        joints_rad: Joints,
        /// Speed of the leading joint, rad/s.
        speed_rad_s: Option<f64>,
    },
}

/// Where a shaft shall point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aim {
    /// Towards this point, in base.
    Point(Point3),
    /// In base, out of the tip.
    Direction(Unit<Vector3>),
}

/// A move that may begin.
#[derive(Clone, Debug)]
pub enum Plan {
    /// Streamed joint by joint.
    Stream {
        /// What is streamed.
        trajectory: Box<Trajectory>,
        /// Inward or outward.
        regime: Regime,
    },
    /// The controller's own straight line.
    Line {
        /// Tool pose at the end.
        base_from_tool: Rigid<Base, Tool>,
        /// Tip speed, mm/s.
        speed_mm_s: f64,
    },
    /// The controller's own joint move.
    Joints {
        /// At the end, rad.
        joints_rad: Joints,
        /// Speed of the leading joint, rad/s.
        speed_rad_s: f64,
    },
}

/// What a move is planned from.
#[derive(Clone, Copy, Debug)]
pub struct Situation<'a> {
    /// The arm and its tool.
    pub arm: &'a ToolArm,
    /// Its limits.
    pub limits: &'a Limits,
    /// The controller's period, s.
    pub period_s: f64,
    /// The portal, if set.
    pub portal: Option<Portal>,
    /// The joints last commanded: a stream continues from them without a step.
    pub joints_rad: &'a Joints,
    /// What was measured last.
    pub seen: &'a Observation,
}

impl Situation<'_> {
    /// Checks a move and plans it.
    pub fn plan(&self, wanted: &Move) -> Result<Plan, Error> {
        match wanted {
            Move::Free {
                base_from_tool,
                speed_mm_s,
            } => self.plan_line(base_from_tool, *speed_mm_s),
            Move::Joints {
                joints_rad,
                speed_rad_s,
            } => self.plan_joints(joints_rad, *speed_rad_s),
            Move::Pivot { aim, speed_rad_s } => self.plan_pivot(*aim, *speed_rad_s),
            Move::Insert {
                depth_mm,
                speed_mm_s,
            } => self.plan_insert(*depth_mm, *speed_mm_s),
            Move::Retract {
                depth_mm,
                speed_mm_s,
            } => self.plan_retract(*depth_mm, *speed_mm_s),
            Move::Rcm {
                aim,
                depth_mm,
                roll_rad,
                speed_mm_s,
                speed_rad_s,
            } => {
                let speeds = self.speeds(*speed_mm_s, *speed_rad_s);
                self.plan_rcm(*aim, *depth_mm, *roll_rad, speeds)
            }
        }
    }

    fn plan_line(&self, end: &Rigid<Base, Tool>, speed_mm_s: Option<f64>) -> Result<Plan, Error> {
        self.must_be_outside()?;
        let start = self.arm.base_from_tool(self.joints_rad);
        // The end first: short of the boundary of the reach the joints jump.
        self.reach(end, self.joints_rad, 1.0)?;
        let length_mm = (end.origin() - start.origin()).norm();
        let turn_rad = start.rotation().angle_to(&end.rotation());
        if turn_rad > TURN_MAX_RAD {
            return Err(Error::TurnTooWide {
                turn_rad,
                limit_rad: TURN_MAX_RAD,
            });
        }
        let steps = (length_mm / STEP_MM)
            .max(turn_rad / STEP_RAD)
            .ceil()
            .max(1.0) as usize;
        let mut before = *self.joints_rad;
        let mut fastest_joint_rad = 0.0_f64;
        for step in 1..=steps {
            let s = step as f64 / steps as f64;
            let tip = start.origin() + (end.origin() - start.origin()) * s;
            let rotation = start.rotation().slerp(&end.rotation(), s);
            let pose = Rigid::new(rotation, tip.coords);
            self.must_stay_outside(&pose)?;
            let joints = self.reach(&pose, &before, s)?;
            let (joint, step_rad) = largest_difference(&joints, &before);
            if step_rad > JUMP_RAD {
                return Err(jump(joint, step_rad, s));
            }
            fastest_joint_rad = fastest_joint_rad.max(step_rad * steps as f64);
            before = joints;
        }
        // The controller keeps the tip's speed, not the joints': where a joint turns much on a short
        // way the tip must go slower. `fastest_joint_rad` is its turn if the whole way were like that.
        let way_mm = length_mm.max(turn_rad * TURN_RADIUS_MM);
        let joints_allow_mm_s =
            LINE_JOINT_SHARE * self.limits.joint_speed_rad_s * way_mm / fastest_joint_rad.max(1e-9);
        let wanted_mm_s = speed_mm_s.unwrap_or(self.limits.free_speed_mm_s);
        Ok(Plan::Line {
            base_from_tool: *end,
            speed_mm_s: wanted_mm_s.min(joints_allow_mm_s).max(LINE_SPEED_MIN_MM_S),
        })
    }

    fn plan_joints(&self, end: &Joints, speed_rad_s: Option<f64>) -> Result<Plan, Error> {
        self.must_be_outside()?;
        if self.arm.limit_margin_rad(end) < 0.0 {
            return Err(Error::JointLimit { percent: 100.0 });
        }
        let (_, turn_rad) = largest_difference(end, self.joints_rad);
        let steps = (turn_rad / STEP_RAD).ceil().max(1.0) as usize;
        for step in 1..=steps {
            let s = step as f64 / steps as f64;
            let joints: Joints =
                std::array::from_fn(|i| self.joints_rad[i] + (end[i] - self.joints_rad[i]) * s);
            self.must_stay_outside(&self.arm.base_from_tool(&joints))?;
        }
        Ok(Plan::Joints {
            joints_rad: *end,
            speed_rad_s: speed_rad_s.unwrap_or(self.limits.joint_speed_rad_s),
        })
    }

    fn must_be_outside(&self) -> Result<(), Error> {
        match self.seen.placement {
            Some(placement) if self.seen.inside => Err(Error::ToolInside {
                depth_mm: placement.depth_mm,
            }),
            _ => Ok(()),
        }
    }

    fn must_stay_outside(&self, pose: &Rigid<Base, Tool>) -> Result<(), Error> {
        match self.portal.map(|portal| Placement::of(pose, &portal.point)) {
            Some(placement) if placement.is_inside() => Err(Error::WayLeadsInside {
                depth_mm: placement.depth_mm,
            }),
            _ => Ok(()),
        }
    }

    fn reach(&self, pose: &Rigid<Base, Tool>, before: &Joints, s: f64) -> Result<Joints, Error> {
        let percent = 100.0 * s;
        self.arm
            .joints(pose, before)
            .map_err(|unreachable| match unreachable {
                Unreachable::OutOfReach => Error::OutOfReach { percent },
                Unreachable::JointLimit => Error::JointLimit { percent },
            })
    }
}
