//! What a move turns into, checked along its whole way before anything moves.

pub mod inside;

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::nalgebra::Unit;
use arthro_geometry::{Point3, Rigid, Vector3};

use crate::error::Error;
use crate::free_way::FreeWay;
use crate::kinematics::{Joints, ToolArm, Unreachable, largest_difference};
use crate::limits::Limits;
use crate::rcm::{Placement, Portal};
use crate::supervisor::{Observation, Regime};
use crate::trajectory::jump;
use crate::way::Way;

/// Steps of the check of a move outside: no longer than these, mm and rad.
const STEP_MM: f64 = 5.0;
const STEP_RAD: f64 = 0.02;
/// A joint that moves farther in one such step jumps.
const JUMP_RAD: f64 = 0.3;
/// A wider turn is so near to half a turn that the way round it is a matter of rounding, rad.
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
        /// About the shaft.
        roll: Roll,
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

/// What becomes of the roll about the shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Roll {
    /// It stays as it is.
    Kept,
    /// At the end, from the portal's reference, rad.
    To(f64),
    /// It is chosen along the way.
    Free,
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
pub struct Plan {
    /// What is streamed, joint by joint.
    pub way: Way,
    /// Which rules hold on it.
    pub regime: Regime,
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
                roll,
                speed_mm_s,
                speed_rad_s,
            } => {
                let speeds = self.speeds(*speed_mm_s, *speed_rad_s);
                self.plan_rcm(*aim, *depth_mm, *roll, speeds)
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
            before = joints;
        }
        let speed_mm_s = speed_mm_s.unwrap_or(self.limits.free_speed_mm_s);
        let way = FreeWay::line(*self.arm, self.joints_rad, *end, speed_mm_s, self.limits)?;
        Ok(outside(way))
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
        let speed_rad_s = speed_rad_s.unwrap_or(self.limits.joint_speed_rad_s);
        let way = FreeWay::joints(*self.arm, self.joints_rad, end, speed_rad_s, self.limits)?;
        Ok(outside(way))
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

fn outside(way: FreeWay) -> Plan {
    Plan {
        way: Way::Outside(Box::new(way)),
        regime: Regime::Outside,
    }
}
