//! The paper's planner (section 2.4.1), for comparison: a random tree from start to goal whose points
//! are the middles of the bites.
//!
//! The [`rrt`] grows the tree, the [`cost`] decides which branches may grow, the guide tells where on
//! the reference contour a point is. [`bites`] turns a path into the bites that the paper makes of it;
//! [`equally_spaced`] is what the paper's planner would do at best: no search, the contour itself.
//!
//! What is wrong with the cost as printed, on a circle of 13.3 mm and a threshold of 0.4:
//! - Eq. 9, `|sin(turn)|`, is no curvature: following the circle costs 0.056 at a step of 0.25 mm,
//!   0.000 at 1 mm, 0.221 at 4 mm.
//! - A reversal costs 0.075, as little as a straight line, and both pass.
//! - An arc bent the wrong way, a zig-zag and a circle 3 mm beside the reference cost 0.000.
//! - The mean over the path (Eq. 8) hides a kink: a right angle after 30 mm costs less than 0.05.
//! - A node whose extensions are all refused stays the nearest one, and the search stalls.
//!
//! On the phantom the printed cost succeeds with 3, 37, 100, 100 and 100 of 100 seeds at thresholds of
//! 0.1 to 0.5, always about 2.4 mm off the contour; the corrected one with all of them, 0.23 mm off.
//! The figures are in `docs/planning-paper.md`; tests hold them.

pub mod cost;
mod guide;
pub mod rrt;
mod slabs;

use arthro_geometry::{Point3, Vector3};

use crate::contour::Spline;
use crate::error::Error;
use crate::jaw::Bite;

pub use cost::Cost;
pub use rrt::{Path, Search, search};

/// Path points, and so bites, that the paper reports on its contour.
pub const PAPERS_BITES: usize = 39;
/// How many bites may be spread over a contour.
const BITES: std::ops::RangeInclusive<usize> = 2..=1_000;

/// The paper's bites: one on every point of a path, the middle of the jaw on the point.
///
/// Points, `portal` and the unit direction `superior` are in one frame, mm. Refused where a shaft
/// through the portal would come straight from above.
pub fn bites(points: &[Point3], portal: &Point3, superior: &Vector3) -> Result<Vec<Bite>, Error> {
    let centred = points.iter().map(|&point| {
        Bite::through(portal, point, superior, point).ok_or_else(|| {
            Error::invalid(
                "options.portal",
                format!(
                    "lies straight above or in the path point ({:.1}, {:.1}, {:.1}) mm; the jaw \
                     must come from the side",
                    point.x, point.y, point.z
                ),
            )
        })
    });
    centred.collect()
}

/// The paper's bites without a search: `count` of them at equal arc length on the contour itself,
/// both ends included.
pub fn equally_spaced(
    contour: &Spline,
    count: usize,
    portal: &Point3,
    superior: &Vector3,
) -> Result<Vec<Bite>, Error> {
    if !BITES.contains(&count) {
        return Err(Error::invalid(
            "count",
            format!("is {count}; must be {} .. {}", BITES.start(), BITES.end()),
        ));
    }
    let last = (count - 1) as f64;
    let on_contour = |bite: usize| {
        let length_mm = contour.length_mm() * bite as f64 / last;
        contour.point(contour.parameter_at(length_mm))
    };
    let points: Vec<Point3> = (0..count).map(on_contour).collect();
    bites(&points, portal, superior)
}
