//! The target: the new free edge that a resection aims at, and the region inboard of it.
//!
//! The contour comes from two ends, from a lesion or from a drawn curve. Its depth is a share of the
//! crescent's width. Between two ends the share goes straight from one to the other, which leaves the
//! curvature most even; around a lesion it is deepened by a bump whose slope and curvature do not jump,
//! since a rim must not change its width suddenly. The contour is a cubic B-spline by least squares
//! through the middle of the tissue, and none leaves less rim than asked for.

mod bump;
mod drawn;
mod heights;
mod lines;
mod station;

use arthro_geometry::frame::Frame;
use arthro_geometry::{Point3, Rigid};

use crate::band::Band;
use crate::contour::Spline;
use crate::crescent::Crescent;
use crate::error::Error;
use crate::jaw::{Bite, Jaw};
use crate::lesion::Lesion;
use crate::voxels::Voxels;

use station::Station;

pub use lines::Line;

/// Contour between two control points, mm.
const CONTROL_SPACING_MM: f64 = 1.0;
/// Least distance from start to goal, mm.
const MIN_CHORD_MM: f64 = 3.0;
/// Distance between the points at which the region inboard is tabulated, mm.
const BAND_SPACING_MM: f64 = 0.2;
/// Rounds of lifting the fitted spline out of the lesion's margin.
const MAX_ROUNDS: usize = 8;
/// How much of the lesion's margin a fit may use up, mm.
const FIT_SLACK_MM: f64 = 0.05;
/// Largest share of the lesion that the contour may leave, percent.
const MAX_BEYOND_PERCENT: f64 = 2.0;
/// Steepest change of depth beside a lesion, mm a mm: 60 degrees.
const MAX_SLOPE: f64 = 1.73;
/// Steepest slope of a bump of height 1 with ramps of length 1.
const BUMP_SLOPE: f64 = 1.9;

/// What the contour comes from; points in the axes of the crescent, mm.
#[derive(Clone, Debug)]
pub enum Aim {
    /// From one point of the tissue to another, deeper where the lesion reaches further.
    Ends {
        /// First point.
        start: Point3,
        /// Last point.
        goal: Point3,
    },
    /// Around the lesion, from the free edge to the free edge.
    Lesion,
    /// Along points that somebody drew, from either end.
    Curve {
        /// In order along the curve.
        points: Vec<Point3>,
    },
}

impl Aim {
    /// The same in another frame.
    pub fn carried<A: Frame, B: Frame>(&self, a_from_b: &Rigid<A, B>) -> Self {
        match self {
            Self::Ends { start, goal } => Self::Ends {
                start: *a_from_b * *start,
                goal: *a_from_b * *goal,
            },
            Self::Lesion => Self::Lesion,
            Self::Curve { points } => Self::Curve {
                points: points.iter().map(|point| *a_from_b * *point).collect(),
            },
        }
    }
}

/// What every contour has to keep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// Depth up to which a point counts as lying on the free edge, and how far beside the tissue a
    /// drawn point may lie, mm.
    pub tolerance_mm: f64,
    /// Rim that must be left wherever something is removed, mm.
    pub rim_min_mm: f64,
    /// How far along the free edge the contour reaches to each side of a lesion's middle before it is
    /// back where it would run without the lesion, mm; further around a wide or deep lesion.
    pub reach_mm: f64,
    /// How far outboard of the lesion the contour passes, mm; half a cell of its grid at least.
    pub lesion_margin_mm: f64,
}

impl Default for Rules {
    fn default() -> Self {
        Self {
            tolerance_mm: 1.0,
            rim_min_mm: 3.0,
            // 28 degrees of a free edge of radius 12.5 mm.
            reach_mm: 6.1,
            lesion_margin_mm: 0.25,
        }
    }
}

/// The new free edge and what lies inboard of it.
#[derive(Clone, Debug)]
pub struct Target {
    /// The contour in the axes of the crescent.
    pub spline: Spline,
    /// The region inboard of it.
    pub band: Band,
}

impl Target {
    /// Draws the contour.
    pub fn draw(
        aim: &Aim,
        rules: &Rules,
        lesion: Option<&Lesion>,
        crescent: &Crescent,
        voxels: &Voxels,
    ) -> Result<Self, Error> {
        let place = Place { crescent, voxels };
        let target = match aim {
            Aim::Ends { start, goal } => between(start, goal, rules, lesion, place)?,
            Aim::Lesion => {
                let lesion = lesion.filter(|lesion| !lesion.points.is_empty());
                around(lesion.ok_or_else(no_lesion)?, rules, place)?
            }
            Aim::Curve { points } => drawn::along(points, rules, place)?,
        };
        target.check_lesion(lesion, crescent)?;
        target.check_rim(rules, crescent)?;
        Ok(target)
    }

    /// The bite with the point of the contour that the edge of its jaw meets, or comes nearest to.
    pub fn meeting(&self, bite: &Bite, jaw: &Jaw) -> Bite {
        let across = bite.opening.cross(&bite.approach);
        let off_edge = |point: &Point3| {
            let offset = point - bite.center;
            let along = offset.dot(&bite.approach).abs() / jaw.length_mm;
            let aside = offset.dot(&across).abs() / jaw.width_mm;
            (along.max(aside) - 0.5).abs()
        };
        let points = self.spline.points_every(BAND_SPACING_MM).into_iter();
        let nearest = points.min_by(|a, b| off_edge(a).total_cmp(&off_edge(b)));
        Bite {
            contour_point: nearest.unwrap_or(bite.center),
            ..*bite
        }
    }

    fn of(spline: Spline, crescent: &Crescent) -> Self {
        let band = Band::inboard_of(&spline.points_every(BAND_SPACING_MM), crescent);
        Self { spline, band }
    }

    fn check_lesion(&self, lesion: Option<&Lesion>, crescent: &Crescent) -> Result<(), Error> {
        let points = lesion.map_or(&[][..], |lesion| lesion.points.as_slice());
        let left = points
            .iter()
            .filter(|point| !self.band.contains(point, crescent))
            .count();
        beyond_path(left, points.len())
    }

    /// Refuses a contour that leaves too little rim, the lesion's part of it included.
    fn check_rim(&self, rules: &Rules, crescent: &Crescent) -> Result<(), Error> {
        let narrowest = crescent
            .rays()
            .filter_map(|angle_rad| {
                let radius_mm = self.band.radius_mm(angle_rad)?;
                let edge_mm = crescent.edge_mm(angle_rad)?;
                let left_mm = crescent.rim_mm(angle_rad)? - radius_mm;
                (radius_mm - edge_mm > rules.tolerance_mm).then_some((left_mm, angle_rad))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((rim_mm, angle_rad)) = narrowest.filter(|(rim, _)| *rim < rules.rim_min_mm) else {
            return Ok(());
        };
        let apart_rad = |point: &Point3| (crescent.angle_rad(point) - angle_rad).abs();
        let points = self.spline.points_every(BAND_SPACING_MM).into_iter();
        let at = points.min_by(|a, b| apart_rad(a).total_cmp(&apart_rad(b)));
        Err(Error::RimBelowLimit {
            rim_mm,
            limit_mm: rules.rim_min_mm,
            at: crescent.ct_from_meniscal * at.unwrap_or_else(Point3::origin),
            angle_rad,
        })
    }
}

/// Where a contour is drawn.
#[derive(Clone, Copy)]
struct Place<'a> {
    crescent: &'a Crescent,
    voxels: &'a Voxels,
}

fn no_lesion() -> Error {
    Error::invalid(
        "lesion",
        "is empty; a target around the lesion needs at least one point of it",
    )
}

fn beyond_path(left: usize, points: usize) -> Result<(), Error> {
    let beyond_percent = 100.0 * left as f64 / points.max(1) as f64;
    if beyond_percent > MAX_BEYOND_PERCENT {
        return Err(Error::LesionBeyondPath {
            beyond_percent,
            limit_percent: MAX_BEYOND_PERCENT,
        });
    }
    Ok(())
}

/// From start to goal, deepened around the lesion.
fn between(
    start: &Point3,
    goal: &Point3,
    rules: &Rules,
    lesion: Option<&Lesion>,
    place: Place<'_>,
) -> Result<Target, Error> {
    let chord_mm = (goal - start).norm();
    if chord_mm < MIN_CHORD_MM {
        return Err(Error::invalid(
            "options.goal",
            format!("is {chord_mm:.2} mm from the start; must be at least {MIN_CHORD_MM} mm"),
        ));
    }
    let angles = [start, goal].map(|end| place.crescent.angle_rad(end));
    let mut stations =
        Station::between(angles[0], angles[1], place.crescent).map_err(|angle_rad| {
            let field = if angle_rad == angles[0] {
                "options.start"
            } else {
                "options.goal"
            };
            Error::invalid(field, "lies beyond the horns of the crescent")
        })?;
    let last = stations.len() - 1;
    let depth = |station: &Station, end: &Point3| station.depth(end.xy().coords.norm()).max(0.0);
    let (from, to) = (depth(&stations[0], start), depth(&stations[last], goal));
    let whole_mm = stations[last].way_mm.max(1e-6);
    let chosen: Vec<f64> = stations
        .iter()
        .map(|station| from + (to - from) * station.way_mm / whole_mm)
        .collect();
    let ends = Some([*start, *goal]);
    let Some(lesion) = lesion else {
        return Ok(Target::of(
            fit(&stations, &chosen, ends, place)?,
            place.crescent,
        ));
    };
    let margin_mm = rules.lesion_margin_mm;
    let beyond = station::demand(&mut stations, lesion, margin_mm, place.crescent);
    beyond_path(beyond, lesion.points.len())?;
    let (from_mm, to_mm) = reach_mm(&stations, rules).unwrap_or_default();
    let bump_ends_mm = (from_mm.max(0.0), to_mm.min(stations[last].way_mm));
    deepened(stations, &chosen, bump_ends_mm, ends, rules, place)
}

/// From the free edge around the lesion to the free edge, or out through the end of a horn that is
/// nearer than the contour reaches.
fn around(lesion: &Lesion, rules: &Rules, place: Place<'_>) -> Result<Target, Error> {
    let (first_rad, last_rad) = place.crescent.span_rad();
    let mut stations = Station::between(first_rad, last_rad, place.crescent).map_err(gap)?;
    let margin_mm = rules.lesion_margin_mm;
    station::demand(&mut stations, lesion, margin_mm, place.crescent);
    let ends_mm = reach_mm(&stations, rules).ok_or_else(no_lesion)?;
    stations.retain(|station| (ends_mm.0..=ends_mm.1).contains(&station.way_mm));
    let chosen = vec![0.0; stations.len()];
    deepened(stations, &chosen, ends_mm, None, rules, place)
}

fn gap(angle_rad: f64) -> Error {
    Error::NotACrescent {
        problem: format!("there is no tissue at {:.0} deg", angle_rad.to_degrees()),
    }
}

/// From where to where along the free edge a contour is deepened for the lesion, mm: as the rules have
/// it, and further where the lesion is so wide or deep that the ramps would be too steep. `None`
/// without a lesion.
fn reach_mm(stations: &[Station], rules: &Rules) -> Option<(f64, f64)> {
    let needy = stations.iter().filter(|station| station.need > 0.0);
    let first_mm = needy.clone().next()?.way_mm;
    let last_mm = needy.clone().next_back()?.way_mm;
    let deepest_mm = needy.fold(0.0, |deepest: f64, station| {
        deepest.max(station.need * station.width_mm)
    });
    let middle_mm = 0.5 * (first_mm + last_mm);
    let ramp_mm = BUMP_SLOPE * deepest_mm / MAX_SLOPE;
    let half_mm = rules.reach_mm.max(0.5 * (last_mm - first_mm) + ramp_mm);
    Some((middle_mm - half_mm, middle_mm + half_mm))
}

/// The chosen depths deepened around the lesion until the fitted contour clears its margin.
fn deepened(
    mut stations: Vec<Station>,
    chosen: &[f64],
    bump_ends_mm: (f64, f64),
    ends: Option<[Point3; 2]>,
    rules: &Rules,
    place: Place<'_>,
) -> Result<Target, Error> {
    let needs: Vec<f64> = stations.iter().map(|station| station.need).collect();
    let mut round = 0;
    loop {
        let reach = |stations: &[Station]| reach_mm(stations, rules);
        let depths = bump::deepen(&stations, chosen, bump_ends_mm, reach);
        let target = Target::of(fit(&stations, &depths, ends, place)?, place.crescent);
        round += 1;
        if round == MAX_ROUNDS || !lift(&mut stations, &needs, &target.band) {
            return Ok(target);
        }
    }
}

/// Raises what the stations need where a fit cuts into the lesion's margin; false where none does.
fn lift(stations: &mut [Station], needs: &[f64], band: &Band) -> bool {
    let mut lifted = false;
    for (station, &need) in stations.iter_mut().zip(needs) {
        let Some(radius_mm) = band.radius_mm(station.angle_rad).filter(|_| need > 0.0) else {
            continue;
        };
        let short = need - station.depth(radius_mm);
        if short * station.width_mm > FIT_SLACK_MM {
            station.need += short;
            lifted = true;
        }
    }
    lifted
}

/// The spline through the depths of the stations, at the height of the middle of the tissue.
fn fit(
    stations: &[Station],
    depths: &[f64],
    ends: Option<[Point3; 2]>,
    place: Place<'_>,
) -> Result<Spline, Error> {
    let mut points: Vec<Point3> = stations
        .iter()
        .zip(depths)
        .map(|(station, &depth)| station.at(depth))
        .collect();
    heights::lift(
        &mut points,
        ends.map(|ends| ends.map(|end| end.z)),
        place.voxels,
    );
    let last = points.len() - 1;
    if let Some([start, goal]) = ends {
        (points[0], points[last]) = (start, goal);
    }
    spline_through(&points)
}

fn spline_through(points: &[Point3]) -> Result<Spline, Error> {
    let chords = points.windows(2).map(|pair| (pair[1] - pair[0]).norm());
    let control_points = (chords.sum::<f64>() / CONTROL_SPACING_MM).ceil() as usize + 3;
    Ok(Spline::fit(
        points,
        control_points.clamp(4, points.len() - 1),
    )?)
}

#[cfg(test)]
mod tests;
