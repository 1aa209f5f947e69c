//! The dry run of targets: each is reached as the moves would reach it, with a pivot in front of the
//! portal and an insertion, or by the paper's moves.

mod way;

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::{Point3, Rigid};

pub use self::way::Way;
use crate::cell::Berth;
use crate::clearance::Keep;
use crate::error::Error;
use crate::kinematics::{Joints, ToolArm};
use crate::limits::Limits;
use crate::plan::inside::within_cone;
use crate::rcm::paper::Formula;
use crate::rcm::path::direction_to;
use crate::rcm::straight::Straight;
use crate::rcm::{Portal, RcmPath, Regain, shaft};
use crate::roll::Choice;
use crate::sweep::Walker;
use crate::trajectory::straight::walk_straight;
use crate::trajectory::{Margins, PlanTrajectory, Speeds, Trajectory, reach};

/// Depth of the pivot: the tip is just outside, mm.
const PIVOT_DEPTH_MM: f64 = -5.0;

/// The arm that targets are checked for.
#[derive(Clone, Debug)]
pub struct DryRun {
    /// The arm and its tool.
    pub arm: ToolArm,
    /// Its limits.
    pub limits: Limits,
    /// Where the arm waits between bites; gives the branch and the roll about the shaft.
    pub neutral_joints_rad: Joints,
    /// The portal.
    pub portal: Portal,
    /// The controller's period, s.
    pub period_s: f64,
    /// How targets are reached.
    pub method: Method,
    /// What becomes of the roll on the way in; counts for [`Method::Rcm`].
    pub roll: Choice,
    /// Where it stands in the cell.
    pub berth: Berth,
}

/// A way from outside the portal to a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// A pivot in front of the portal and an insertion.
    Rcm,
    /// The paper's straight moves, for comparison.
    Paper(Formula),
}

/// Where each target is approached from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// From the neutral pose, each by itself.
    Any,
    /// From where the retraction after the one before left the arm.
    AsListed,
}

/// What came of one target.
#[derive(Clone, Debug, PartialEq)]
pub struct Checked {
    /// Of the target beyond the portal, mm.
    pub depth_mm: f64,
    /// What the way there is like, or why there is none.
    pub outcome: Result<Way, Error>,
}

/// Where an arm waits outside, on the portal.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    joints_rad: Joints,
    base_from_tool: Rigid<Base, Tool>,
}

impl Checked {
    /// The index of the target with the least room: the first without a way, or the way with the least.
    pub fn worst(checked: &[Self]) -> Option<usize> {
        let room = |checked: &Self| match &checked.outcome {
            Ok(way) => way.least_room().0,
            Err(_) => f64::NEG_INFINITY,
        };
        (0..checked.len()).min_by(|a, b| room(&checked[*a]).total_cmp(&room(&checked[*b])))
    }
}

impl DryRun {
    /// Checks targets, in their order.
    pub fn check_all(&self, targets: &[Point3], order: Order) -> Vec<Checked> {
        let mut waiting = self.neutral();
        let mut all = Vec::with_capacity(targets.len());
        for target in targets {
            let depth_mm = (target - self.portal.point).norm();
            let walked = waiting
                .clone()
                .and_then(|from| self.walk(&from, target, depth_mm));
            let outcome = walked.map(|(way, outside)| {
                if order == Order::AsListed {
                    waiting = Ok(outside);
                }
                way
            });
            all.push(Checked { depth_mm, outcome });
        }
        all
    }

    /// Checks one target, from the neutral pose.
    pub fn check(&self, target: &Point3) -> Checked {
        let depth_mm = (target - self.portal.point).norm();
        let walked = self
            .neutral()
            .and_then(|from| self.walk(&from, target, depth_mm));
        Checked {
            depth_mm,
            outcome: walked.map(|(way, _)| way),
        }
    }

    /// In front of the portal, in the neutral direction.
    fn neutral(&self) -> Result<Waiting, Error> {
        let neutral = self.arm.base_from_tool(&self.neutral_joints_rad);
        let depth_mm = match self.method {
            Method::Rcm => PIVOT_DEPTH_MM,
            Method::Paper(_) => 0.0,
        };
        let tip = self.portal.point + shaft(&neutral) * depth_mm;
        let outside: Rigid<Base, Tool> = Rigid::new(neutral.rotation(), tip.coords);
        let here = RcmPath::along(&outside, self.portal, depth_mm, Regain::Nothing);
        Ok(Waiting {
            joints_rad: reach(&self.arm, &here, 0.0, &self.neutral_joints_rad)?,
            base_from_tool: outside,
        })
    }

    /// The way to a target, and where the arm waits after the retraction from it.
    fn walk(
        &self,
        from: &Waiting,
        target: &Point3,
        depth_mm: f64,
    ) -> Result<(Way, Waiting), Error> {
        if !(..=self.limits.depth_max_mm).contains(&depth_mm) {
            return Err(Error::TooDeep {
                depth_mm,
                limit_mm: self.limits.depth_max_mm,
            });
        }
        let direction = direction_to(&self.portal, target)
            .ok_or_else(|| Error::invalid("targets", "is the portal; must be another point"))?;
        within_cone(&self.portal, &direction, self.limits.cone_max_rad)?;
        let (margins, duration_s, outside) = match self.method {
            Method::Rcm => self.pivot_and_insert(from, target, depth_mm)?,
            Method::Paper(formula) => self.as_in_the_paper(from, target, formula)?,
        };
        let way = Way {
            margins,
            cone_rad: self
                .portal
                .lean_rad(&direction)
                .map_or(std::f64::consts::PI, |lean| self.limits.cone_max_rad - lean),
            depth_mm: self.limits.depth_max_mm - depth_mm,
            joint_speed_max_rad_s: self.limits.joint_speed_rad_s,
            duration_s,
        };
        Ok((way, outside))
    }

    fn pivot_and_insert(
        &self,
        from: &Waiting,
        target: &Point3,
        depth_mm: f64,
    ) -> Result<(Margins, f64, Waiting), Error> {
        let path = RcmPath::pivot(&from.base_from_tool, self.portal, *target)
            .ok_or_else(|| Error::invalid("targets", "is the portal; must be another point"))?;
        let pivot = self.plan(path, &from.joints_rad)?;
        let aimed = pivot.path().pose(1.0);
        let path = RcmPath::along(&aimed, self.portal, depth_mm, Regain::Nothing);
        let insertion = self.plan(path, &pivot.end())?;
        self.keeps_clear(&pivot, &from.joints_rad)?;
        self.keeps_clear(&insertion, &pivot.end())?;
        let margins = pivot.margins().worst(&insertion.margins());
        let (margins, outside) = match self.roll {
            // The retraction is the insertion backwards: it ends where the pivot did.
            Choice::Keep => {
                let outside = Waiting {
                    joints_rad: pivot.end(),
                    base_from_tool: aimed,
                };
                (margins, outside)
            }
            Choice::Free => {
                let (retraction, outside) = self.retract(&insertion)?;
                (margins.worst(&retraction), outside)
            }
        };
        Ok((
            margins,
            pivot.duration_s() + insertion.duration_s(),
            outside,
        ))
    }

    /// Back out with the roll that the insertion ended with.
    fn retract(&self, insertion: &Trajectory) -> Result<(Margins, Waiting), Error> {
        let inside = insertion.path().pose(1.0);
        let path = RcmPath::along(&inside, self.portal, PIVOT_DEPTH_MM, Regain::Nothing);
        let base_from_tool = path.pose(1.0);
        let retraction = self.timed(Trajectory::plan, path, &insertion.end())?;
        self.keeps_clear(&retraction, &insertion.end())?;
        let outside = Waiting {
            joints_rad: retraction.end(),
            base_from_tool,
        };
        Ok((retraction.margins(), outside))
    }

    /// Of the planes and of the other arm where it is now.
    fn keeps_clear(&self, trajectory: &Trajectory, start: &Joints) -> Result<(), Error> {
        let walker = Walker {
            arm: &self.arm,
            limits: &self.limits,
            berth: &self.berth,
            plane_room_mm: 0.0,
        };
        let sweep = walker.sweep_of(trajectory, start)?;
        self.berth.keeps_clear(&sweep, &Keep::of(&self.limits))
    }

    fn as_in_the_paper(
        &self,
        from: &Waiting,
        target: &Point3,
        formula: Formula,
    ) -> Result<(Margins, f64, Waiting), Error> {
        let [turn, insertion] = formula
            .moves(&from.base_from_tool, &self.portal.point, target)
            .ok_or_else(|| Error::invalid("targets", "is the portal; must be another point"))?;
        let walk = |line: &Straight, start: &Joints| {
            let duration_s = (line.length_mm() / self.limits.inside_speed_mm_s)
                .max(line.turn_rad() / self.limits.pivot_speed_rad_s);
            walk_straight(
                &self.arm,
                line,
                &self.portal.point,
                start,
                duration_s,
                self.period_s,
            )
            .map(|(margins, end)| (margins, duration_s, end))
        };
        let (turned, turn_s, at_portal) = walk(&turn, &from.joints_rad)?;
        let (inserted, insertion_s, _) = walk(&insertion, &at_portal)?;
        let margins = turned.worst(&inserted);
        let deviation_mm = margins
            .rcm_between_samples_mm
            .max(margins.rcm_at_samples_mm);
        if !(..=self.limits.rcm_stop_mm).contains(&deviation_mm) {
            return Err(Error::RcmDeviation {
                deviation_mm,
                limit_mm: self.limits.rcm_stop_mm,
            });
        }
        let outside = Waiting {
            joints_rad: at_portal,
            base_from_tool: turn.to,
        };
        Ok((margins, turn_s + insertion_s, outside))
    }

    fn plan(&self, path: RcmPath, start: &Joints) -> Result<Trajectory, Error> {
        let plan = match self.roll {
            Choice::Keep => Trajectory::plan,
            Choice::Free => Trajectory::plan_rolling,
        };
        self.timed(plan, path, start)
    }

    fn timed(
        &self,
        plan: PlanTrajectory,
        path: RcmPath,
        start: &Joints,
    ) -> Result<Trajectory, Error> {
        let speeds = Speeds {
            tip_mm_s: self.limits.inside_speed_mm_s,
            turn_rad_s: self.limits.pivot_speed_rad_s,
        };
        plan(self.arm, path, start, &self.limits, speeds, self.period_s)
    }
}

#[cfg(test)]
mod tests;
