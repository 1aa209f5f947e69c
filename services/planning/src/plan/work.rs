//! The two planners on a prepared model.

use std::ops::ControlFlow;

use arthro_geometry::{Point3, Vector3};

use super::approach::Approach;
use super::{Choice, Progress, Request};
use crate::bites::{self, Access, Found, Patience};
use crate::contour::Spline;
use crate::error::Error;
use crate::evaluation::Task;
use crate::jaw::Bite;
use crate::paper::{self, Search};

/// What is aimed at outside the region if nothing is said: so much, and this share of the region, mm3.
const USUAL_OUTSIDE: (f64, f64) = (2.0, 0.04);
/// What may go outside the region where that is too little, mm3.
const MOST_OUTSIDE_MM3: f64 = 15.0;

/// What a planner hands back, in the axes of the crescent.
pub(super) struct Bitten {
    pub(super) bites: Vec<(usize, Bite)>,
    pub(super) path: Vec<Point3>,
    pub(super) choice: Option<Choice>,
}

/// What both planners work on.
pub(super) struct Work<'a> {
    pub(super) request: &'a Request,
    pub(super) task: &'a Task<'a>,
    pub(super) approach: &'a Approach<'a>,
    pub(super) contour: &'a Spline,
    pub(super) placement_error_mm: Option<f64>,
    pub(super) region_mm3: f64,
}

impl Work<'_> {
    fn in_box(&self, point: &Point3) -> bool {
        let Some((low, high)) = self.request.target_box else {
            return true;
        };
        let point = self.task.crescent.ct_from_meniscal * *point;
        point.inf(&low) == low && point.sup(&high) == high
    }

    /// As few bites as clear the region.
    pub(super) fn fewest(
        &self,
        patience: &(dyn Fn() -> Patience + Sync),
        watch: &mut dyn FnMut(Progress),
    ) -> Result<Bitten, Error> {
        let limits = &self.request.limits;
        let access = Access {
            portals: self.task.portals,
            allowed: &|portal, bite| {
                self.in_box(&bite.center) && self.approach.is_clear(portal, bite)
            },
            rim_min_mm: self.request.contour_rules.rim_min_mm,
            placement_error_mm: self.placement_error_mm,
        };
        let (base_mm3, share) = USUAL_OUTSIDE;
        let usual_mm3 = (base_mm3 + share * self.region_mm3).min(MOST_OUTSIDE_MM3);
        let usual_limits_mm3 = [usual_mm3, MOST_OUTSIDE_MM3];
        let outside_limits_mm3 = limits.outside_limit_mm3.map(|limit_mm3| [limit_mm3; 2]);
        let rules = bites::Rules {
            region_share: limits.region_percent / 100.0,
            outside_limits_mm3: outside_limits_mm3.unwrap_or(usual_limits_mm3),
            throat_limit: self.task.throat_limit,
            partial: limits.partial,
        };
        let mut hear = |found: Found| {
            watch(Progress {
                stage: "bites",
                fraction: 0.2 + 0.75 * found.fraction,
                iterations: 0,
                incumbent: found.incumbent,
                bound: found.bound,
            });
        };
        let effort = bites::Effort {
            seed: self.request.seed,
            factor: self.request.effort,
        };
        let chosen = bites::choose(self.task, &access, &rules, &effort, patience, &mut hear);
        let chosen = chosen.map_err(|refusal| self.approach.explained(refusal))?;
        if chosen.bites.is_empty() {
            let region_mm3 = self.region_mm3;
            return Err(Error::NoBite { region_mm3 });
        }
        Ok(Bitten {
            bites: chosen.bites,
            path: Vec::new(),
            choice: Some(Choice {
                bound: chosen.bound,
                complete: chosen.complete,
                ended: chosen.ended,
            }),
        })
    }

    /// The paper's bites along its path.
    pub(super) fn paper(
        &self,
        search: &Search,
        patience: &(dyn Fn() -> Patience + Sync),
        watch: &mut dyn FnMut(Progress),
    ) -> Result<Bitten, Error> {
        let allowed = |point: &Point3| self.in_box(point);
        let path = paper::search(
            self.contour,
            self.task.voxels,
            search,
            allowed,
            |iterations| {
                let share = f64::from(iterations) / f64::from(search.max_iterations);
                watch(Progress {
                    stage: "rrt",
                    fraction: 0.2 + 0.75 * share,
                    iterations,
                    incumbent: None,
                    bound: None,
                });
                match patience() {
                    Patience::GoOn => ControlFlow::Continue(()),
                    // Half a path is no path.
                    Patience::Hurry | Patience::Stop => ControlFlow::Break(()),
                }
            },
        )?;
        let superior = Vector3::z();
        let bites = paper::bites(&path.points, &self.task.portals[0], &superior)?;
        Ok(Bitten {
            bites: bites.into_iter().map(|bite| (0, bite)).collect(),
            path: path.points,
            choice: None,
        })
    }
}
