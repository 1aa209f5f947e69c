//! A contour along points that somebody drew: clicked in a viewer, or a markup curve.

use arthro_geometry::Point3;

use super::{MIN_CHORD_MM, Place, Rules, Target, heights, spline_through};
use crate::contour::{MIN_CONTROL_POINTS, Spline};
use crate::error::Error;

/// Most points of a drawn curve.
const MAX_POINTS: usize = 2000;
/// A point nearer to the one before counts as the same, mm.
const DISTINCT_MM: f64 = 0.05;
/// Distance between the points of the curve that are held to the tissue, mm.
const SAMPLE_MM: f64 = 0.5;
/// How far a hand may slip back along the crescent, degrees.
const MAX_BACK_DEG: f64 = 1.0;

const FIELD: &str = "options.curve";

/// A drawn point and its place in the list.
#[derive(Clone, Copy)]
struct Drawn {
    index: usize,
    /// In the plane of the crescent: a click lands on a surface, the contour runs through the middle.
    flat: Point3,
}

/// The contour along the points, whichever of its ends comes first.
pub(super) fn along(points: &[Point3], rules: &Rules, place: Place<'_>) -> Result<Target, Error> {
    let drawn = read(points, rules, place)?;
    check_crossing(&drawn)?;
    check_course(&drawn, place)?;
    let flat: Vec<Point3> = drawn.iter().map(|point| point.flat).collect();
    let chord_mm = (flat[flat.len() - 1] - flat[0]).norm();
    if chord_mm < MIN_CHORD_MM {
        return Err(Error::invalid(
            FIELD,
            format!("ends {chord_mm:.2} mm from its begin; must be at least {MIN_CHORD_MM} mm"),
        ));
    }
    let mut samples = Spline::fit(&flat, flat.len())?.points_every(SAMPLE_MM);
    heights::lift(&mut samples, None, place.voxels);
    for sample in &samples {
        if place
            .voxels
            .distance_mm(sample, rules.tolerance_mm)
            .is_none()
        {
            let away = |point: &Drawn| (point.flat.xy() - sample.xy()).norm_squared();
            let nearest = drawn.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
            let index = nearest.map_or(0, |point| point.index);
            return Err(Error::invalid(
                FIELD,
                format!(
                    "leaves the tissue near point [{index}] by more than the tolerance, {} mm",
                    rules.tolerance_mm
                ),
            ));
        }
    }
    Ok(Target::of(spline_through(&samples)?, place.crescent))
}

/// The distinct points, each checked to be a number on the tissue.
fn read(points: &[Point3], rules: &Rules, place: Place<'_>) -> Result<Vec<Drawn>, Error> {
    if points.len() > MAX_POINTS {
        return Err(Error::invalid(
            FIELD,
            format!("has {} points; must be at most {MAX_POINTS}", points.len()),
        ));
    }
    let mut drawn: Vec<Drawn> = Vec::new();
    for (index, point) in points.iter().enumerate() {
        if !point.iter().all(|value| value.is_finite()) {
            return Err(Error::invalid(
                FIELD,
                format!("[{index}] is {point}; must be finite numbers"),
            ));
        }
        // Seen along superior: how high above the tissue a click landed does not matter.
        let middle_mm = place.voxels.middle_mm(point.x, point.y, rules.tolerance_mm);
        if middle_mm.is_none() {
            return Err(Error::invalid(
                FIELD,
                format!(
                    "[{index}] is further than the tolerance, {} mm, beside the tissue",
                    rules.tolerance_mm
                ),
            ));
        }
        let flat = Point3::new(point.x, point.y, 0.0);
        let before = drawn.last();
        if before.is_none_or(|before| (before.flat - flat).norm() > DISTINCT_MM) {
            drawn.push(Drawn { index, flat });
        }
    }
    if drawn.len() < MIN_CONTROL_POINTS {
        return Err(Error::invalid(
            FIELD,
            format!(
                "has {} distinct points; must be at least {MIN_CONTROL_POINTS}",
                drawn.len()
            ),
        ));
    }
    Ok(drawn)
}

/// Refuses a curve that crosses itself.
fn check_crossing(drawn: &[Drawn]) -> Result<(), Error> {
    for (first, a) in drawn.windows(2).enumerate() {
        for b in drawn[first + 1..].windows(2).skip(1) {
            if cross(a, b) {
                return Err(Error::invalid(
                    FIELD,
                    format!(
                        "crosses itself: from point [{}] to [{}] and from [{}] to [{}]",
                        a[0].index, a[1].index, b[0].index, b[1].index
                    ),
                ));
            }
        }
    }
    Ok(())
}

/// Whether two segments meet: each has its ends on both sides of the other.
fn cross(a: &[Drawn], b: &[Drawn]) -> bool {
    let side = |line: &[Drawn], point: &Drawn| {
        let along = line[1].flat - line[0].flat;
        along.xy().perp(&(point.flat - line[0].flat).xy())
    };
    side(a, &b[0]) * side(a, &b[1]) < 0.0 && side(b, &a[0]) * side(b, &a[1]) < 0.0
}

/// Refuses a curve that turns back along the crescent: what lies inboard of it would be ambiguous.
fn check_course(drawn: &[Drawn], place: Place<'_>) -> Result<(), Error> {
    let angle_deg = |point: &Drawn| place.crescent.angle_rad(&point.flat).to_degrees();
    let first_deg = angle_deg(&drawn[0]);
    let onward = (angle_deg(&drawn[drawn.len() - 1]) - first_deg).signum();
    let mut furthest_deg = first_deg;
    for point in drawn {
        let back_deg = (furthest_deg - angle_deg(point)) * onward;
        if back_deg > MAX_BACK_DEG {
            return Err(Error::invalid(
                FIELD,
                format!(
                    "[{}] goes back along the crescent by {back_deg:.1} deg; must be at most {MAX_BACK_DEG} deg",
                    point.index
                ),
            ));
        }
        if back_deg < 0.0 {
            furthest_deg = angle_deg(point);
        }
    }
    Ok(())
}
