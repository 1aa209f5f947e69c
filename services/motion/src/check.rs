//! The dry run of targets: each is reached from the neutral pose as the moves would reach it, with a
//! pivot in front of the portal and an insertion.

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::{Point3, Rigid};

use crate::error::Error;
use crate::kinematics::{Joints, ToolArm};
use crate::limits::Limits;
use crate::rcm::{RcmPath, Regain, shaft};
use crate::trajectory::{Margins, Speeds, Trajectory, reach};

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
    pub portal: Point3,
    /// The controller's period, s.
    pub period_s: f64,
}

/// What came of one target.
#[derive(Clone, Debug, PartialEq)]
pub struct Checked {
    /// Of the target beyond the portal, mm.
    pub depth_mm: f64,
    /// What the way there is like, or why there is none.
    pub outcome: Result<Margins, Error>,
}

impl DryRun {
    /// Checks one target.
    pub fn check(&self, target: &Point3) -> Checked {
        let depth_mm = (target - self.portal).norm();
        Checked {
            depth_mm,
            outcome: self.walk(target, depth_mm),
        }
    }

    fn walk(&self, target: &Point3, depth_mm: f64) -> Result<Margins, Error> {
        if depth_mm > self.limits.depth_max_mm {
            return Err(Error::TooDeep {
                depth_mm,
                limit_mm: self.limits.depth_max_mm,
            });
        }
        let neutral = self.arm.base_from_tool(&self.neutral_joints_rad);
        let before_portal = self.portal + shaft(&neutral) * PIVOT_DEPTH_MM;
        let outside: Rigid<Base, Tool> = Rigid::new(neutral.rotation(), before_portal.coords);
        let here = RcmPath::along(&outside, self.portal, PIVOT_DEPTH_MM, Regain::Nothing);
        let joints = reach(&self.arm, &here, 0.0, &self.neutral_joints_rad)?;
        let path = RcmPath::pivot(&outside, self.portal, *target)
            .ok_or_else(|| Error::invalid("targets", "is the portal; must be another point"))?;
        let aimed = path.pose(1.0);
        let pivot = self.plan(path, &joints)?;
        let path = RcmPath::along(&aimed, self.portal, depth_mm, Regain::Nothing);
        let insertion = self.plan(path, &pivot.end())?;
        Ok(pivot.margins().worst(&insertion.margins()))
    }

    fn plan(&self, path: RcmPath, start: &Joints) -> Result<Trajectory, Error> {
        let speeds = Speeds {
            tip_mm_s: self.limits.inside_speed_mm_s,
            turn_rad_s: self.limits.pivot_speed_rad_s,
        };
        Trajectory::plan(self.arm, path, start, &self.limits, speeds, self.period_s)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use arthro_geometry::{Rotation, Vector3};

    use super::*;

    fn dry_run() -> DryRun {
        let arm = ToolArm::new(
            crate::kinematics::model::Model::ur5(),
            Rigid::new(
                Rotation::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2),
                Vector3::new(0.0, 0.0, 310.0),
            ),
        );
        DryRun {
            arm,
            limits: Limits::default(),
            neutral_joints_rad: [0.479, -1.185, -2.041, 3.004, -1.102, -1.469],
            portal: Point3::new(700.0, 0.0, 265.0),
            period_s: 0.008,
        }
    }

    #[test]
    fn targets_in_the_knee_are_reached_with_margins() {
        for (x, y, z) in [
            (740.0, 0.0, 250.0),
            (745.0, 20.0, 255.0),
            (755.0, -15.0, 248.0),
        ] {
            let checked = dry_run().check(&Point3::new(x, y, z));
            let margins = checked.outcome.unwrap();
            assert!(margins.joint_limit_rad > 0.3, "{margins:?}");
            assert!(margins.rcm_between_samples_mm < 0.01, "{margins:?}");
            assert!(checked.depth_mm > 40.0);
        }
    }

    #[test]
    fn targets_that_cannot_be_reached_say_why() {
        let reason = |target| {
            let checked = dry_run().check(&target);
            checked.outcome.unwrap_err().reason().to_owned()
        };
        assert_eq!(reason(Point3::new(800.0, 0.0, 250.0)), "TOO_DEEP");
        assert_eq!(reason(Point3::new(660.0, 0.0, 265.0)), "TURN_TOO_WIDE");
        let mut far = dry_run();
        far.portal = Point3::new(1300.0, 0.0, 265.0);
        let checked = far.check(&Point3::new(1340.0, 0.0, 250.0));
        assert_eq!(checked.outcome.unwrap_err().reason(), "OUT_OF_REACH");
    }
}
