//! Moves through the portal: the shaft stays on it, in the cone and above the deepest depth.

use super::{Aim, Plan, Roll, Situation};
use crate::error::Error;
use crate::rcm::path::{Destination, direction_to};
use crate::rcm::{Placement, Portal, RcmPath, Regain, shaft};
use crate::supervisor::Regime;
use crate::trajectory::{PlanTrajectory, Speeds, Trajectory};
use crate::way::Way;
use arthro_geometry::nalgebra::Unit;
use arthro_geometry::{Point3, Vector3};

/// A tip less than this deeper or shallower than asked for is there, mm.
const DEPTH_NEAR_MM: f64 = 0.05;
/// A shaft less than this beyond the cone is at its edge, rad.
const LEAN_NEAR_RAD: f64 = 1e-3;
/// A combined move ends no farther outside than this, mm.
pub const OUTSIDE_MAX_MM: f64 = 100.0;

impl Situation<'_> {
    pub(super) fn plan_pivot(&self, aim: Point3, speed_rad_s: Option<f64>) -> Result<Plan, Error> {
        let (portal, _) = self.must_pass_portal()?;
        let direction = direction_to(&portal, &aim)
            .ok_or_else(|| Error::invalid("pivot.aim", "is the portal; must be another point"))?;
        self.must_be_in_cone(&portal, &direction)?;
        let end = Destination {
            direction: Some(direction),
            ..Destination::default()
        };
        let speeds = self.speeds(None, speed_rad_s);
        self.stream(&portal, &end, Regain::Portal, speeds, Regime::Inward)
    }

    pub(super) fn plan_insert(
        &self,
        depth_mm: f64,
        speed_mm_s: Option<f64>,
    ) -> Result<Plan, Error> {
        let (portal, placement) = self.must_pass_portal()?;
        self.must_not_be_too_deep(depth_mm)?;
        if depth_mm < placement.depth_mm - DEPTH_NEAR_MM {
            return Err(Error::Direction {
                from_mm: placement.depth_mm,
                to_mm: depth_mm,
                must: "an insertion must not go back",
            });
        }
        self.must_be_in_cone(&portal, &shaft(&self.seen.base_from_tool))?;
        let speeds = self.speeds(speed_mm_s, None);
        let end = to_depth(depth_mm);
        self.stream(&portal, &end, Regain::Portal, speeds, Regime::Inward)
    }

    /// The way out must be open also to a shaft that is off the portal: it keeps to its own line.
    pub(super) fn plan_retract(
        &self,
        depth_mm: f64,
        speed_mm_s: Option<f64>,
    ) -> Result<Plan, Error> {
        let (portal, placement) = self.placement()?;
        if depth_mm > placement.depth_mm + DEPTH_NEAR_MM {
            return Err(Error::Direction {
                from_mm: placement.depth_mm,
                to_mm: depth_mm,
                must: "a retraction must not go deeper",
            });
        }
        let regain = if placement.deviation_mm() <= self.limits.rcm_stop_mm {
            Regain::Portal
        } else {
            Regain::Nothing
        };
        let speeds = self.speeds(speed_mm_s, None);
        let end = to_depth(depth_mm);
        self.stream(&portal, &end, regain, speeds, Regime::Outward)
    }

    pub(super) fn plan_rcm(
        &self,
        aim: Option<Aim>,
        depth_mm: f64,
        roll: Roll,
        speeds: Speeds,
    ) -> Result<Plan, Error> {
        let (portal, _) = self.must_pass_portal()?;
        self.must_not_be_too_deep(depth_mm)?;
        let direction = match aim {
            None => None,
            Some(Aim::Direction(direction)) => Some(direction),
            Some(Aim::Point(aim)) => Some(direction_to(&portal, &aim).ok_or_else(|| {
                Error::invalid("rcm.aim", "is the portal; must be another point")
            })?),
        };
        let ends_along = direction.map_or(shaft(&self.seen.base_from_tool), Unit::into_inner);
        self.must_be_in_cone(&portal, &ends_along)?;
        let end = Destination {
            direction,
            depth_mm: Some(depth_mm),
            roll_rad: match roll {
                Roll::To(roll_rad) => Some(roll_rad),
                Roll::Kept | Roll::Free => None,
            },
        };
        let start = self.arm.base_from_tool(self.joints_rad);
        let path = RcmPath::to(&start, portal, &end, Regain::Portal);
        let plan = match roll {
            Roll::Kept | Roll::To(_) => Trajectory::plan,
            Roll::Free => Trajectory::plan_rolling,
        };
        self.timed(plan, path, speeds, Regime::Inward)
    }

    /// The speeds asked for; the limits where none are.
    pub(super) fn speeds(&self, speed_mm_s: Option<f64>, speed_rad_s: Option<f64>) -> Speeds {
        Speeds {
            tip_mm_s: speed_mm_s.unwrap_or(self.limits.inside_speed_mm_s),
            turn_rad_s: speed_rad_s.unwrap_or(self.limits.pivot_speed_rad_s),
        }
    }

    fn stream(
        &self,
        portal: &Portal,
        end: &Destination,
        regain: Regain,
        speeds: Speeds,
        regime: Regime,
    ) -> Result<Plan, Error> {
        let start = self.arm.base_from_tool(self.joints_rad);
        let path = RcmPath::to(&start, *portal, end, regain);
        self.timed(Trajectory::plan, path, speeds, regime)
    }

    fn timed(
        &self,
        plan: PlanTrajectory,
        path: RcmPath,
        speeds: Speeds,
        regime: Regime,
    ) -> Result<Plan, Error> {
        let trajectory = plan(
            *self.arm,
            path,
            self.joints_rad,
            self.limits,
            speeds,
            self.period_s,
        )?;
        Ok(Plan {
            way: Way::Portal(Box::new(trajectory)),
            regime,
        })
    }

    fn placement(&self) -> Result<(Portal, Placement), Error> {
        self.portal
            .zip(self.seen.placement)
            .ok_or(Error::PortalNotSet)
    }

    fn must_pass_portal(&self) -> Result<(Portal, Placement), Error> {
        let (portal, placement) = self.placement()?;
        let deviation_mm = placement.deviation_mm();
        if deviation_mm > self.limits.rcm_stop_mm {
            return Err(Error::ShaftOffPortal {
                deviation_mm,
                limit_mm: self.limits.rcm_stop_mm,
            });
        }
        Ok((portal, placement))
    }

    fn must_not_be_too_deep(&self, depth_mm: f64) -> Result<(), Error> {
        if depth_mm > self.limits.depth_max_mm {
            return Err(Error::TooDeep {
                depth_mm,
                limit_mm: self.limits.depth_max_mm,
            });
        }
        Ok(())
    }

    /// A cone of less than a right angle holds every great circle between two of its directions: the
    /// end of a turn that begins within it speaks for the way.
    fn must_be_in_cone(&self, portal: &Portal, direction: &Vector3) -> Result<(), Error> {
        within_cone(portal, direction, self.limits.cone_max_rad)
    }
}

/// Refuses a shaft that leans farther from the portal's axis than `limit_rad`.
pub fn within_cone(portal: &Portal, direction: &Vector3, limit_rad: f64) -> Result<(), Error> {
    match portal.lean_rad(direction) {
        Some(lean_rad) if !(..=limit_rad + LEAN_NEAR_RAD).contains(&lean_rad) => Err(Error::Cone {
            lean_rad,
            limit_rad,
        }),
        _ => Ok(()),
    }
}

fn to_depth(depth_mm: f64) -> Destination {
    Destination {
        depth_mm: Some(depth_mm),
        ..Destination::default()
    }
}
