//! A lesion that somebody marked on the meniscus with points or with a closed curve.
//!
//! Both are seen along superior and go through the full thickness: a mark is set on a surface, and a
//! punch cuts everything below its jaw.

use std::ops::RangeInclusive;

use arthro_geometry::Point3;
use nalgebra::Vector2;

use super::Lesion;
use crate::crescent::Crescent;
use crate::error::Error;
use crate::voxels::Voxels;

/// Most points of a mark.
const MAX_POINTS: usize = 2000;
/// Radius of a point, mm.
const RADIUS_MM: RangeInclusive<f64> = 0.1..=10.0;
/// Fewest points of a closed curve.
const MIN_CURVE_POINTS: usize = 3;
/// Pieces into which the curve between two points is cut.
const PIECES: usize = 8;

const FIELD: &str = "lesion";

impl Lesion {
    /// The tissue within a radius of any of the points in ct, as cylinders along superior.
    ///
    /// # Errors
    /// Without points, with too many, with a point that is not on or over the tissue (by its index),
    /// and for a radius beyond its limits.
    pub fn near_points(
        points_in_ct: &[Point3],
        radius_mm: f64,
        crescent: &Crescent,
        voxels: &Voxels,
        tolerance_mm: f64,
    ) -> Result<Self, Error> {
        if !RADIUS_MM.contains(&radius_mm) {
            return Err(Error::invalid(
                "lesion_radius_mm",
                format!(
                    "is {radius_mm}; must be {} .. {} mm",
                    RADIUS_MM.start(),
                    RADIUS_MM.end()
                ),
            ));
        }
        let places = places(points_in_ct, 1, crescent)?;
        let mut marks = vec![false; voxels.centers().len()];
        for (index, place) in places.iter().enumerate() {
            if voxels.middle_mm(place.x, place.y, tolerance_mm).is_none() {
                return Err(Error::invalid(
                    FIELD,
                    format!("[{index}] is more than {tolerance_mm} mm beside the tissue"),
                ));
            }
            for voxel in voxels.near(place.x, place.y, radius_mm) {
                let offset = voxels.centers()[voxel].xy().coords - place;
                marks[voxel] |= offset.norm_squared() <= radius_mm * radius_mm;
            }
        }
        Self::of_marks(marks, voxels)
    }

    /// The tissue inside a closed curve through the points in ct, seen along superior.
    ///
    /// # Errors
    /// With too few or too many points, if the curve crosses itself, and if no tissue lies inside.
    pub fn inside_curve(
        points_in_ct: &[Point3],
        crescent: &Crescent,
        voxels: &Voxels,
    ) -> Result<Self, Error> {
        let places = places(points_in_ct, MIN_CURVE_POINTS, crescent)?;
        check_crossing(&places)?;
        let outline = rounded(&places);
        let mut marks = Vec::with_capacity(voxels.centers().len());
        // The voxels of a column, one after the other, share their place.
        let columns = voxels.centers().chunk_by(|a, b| a.xy() == b.xy());
        for column in columns {
            let inside = is_inside(&column[0].xy().coords, &outline);
            marks.extend(column.iter().map(|_| inside));
        }
        Self::of_marks(marks, voxels)
    }

    fn of_marks(marks: Vec<bool>, voxels: &Voxels) -> Result<Self, Error> {
        let lesion = Self::of_voxels(marks, voxels);
        if lesion.points.is_empty() {
            return Err(Error::invalid(FIELD, "marks no tissue of the model"));
        }
        Ok(lesion)
    }
}

/// The points seen along superior.
fn places(
    points_in_ct: &[Point3],
    least: usize,
    crescent: &Crescent,
) -> Result<Vec<Vector2<f64>>, Error> {
    let count = points_in_ct.len();
    if !(least..=MAX_POINTS).contains(&count) {
        return Err(Error::invalid(
            FIELD,
            format!("has {count} points; must have {least} .. {MAX_POINTS}"),
        ));
    }
    let meniscal_from_ct = crescent.ct_from_meniscal.inverse();
    let points = points_in_ct.iter().enumerate();
    points
        .map(|(index, point)| {
            if point.iter().all(|value| value.is_finite()) {
                return Ok((meniscal_from_ct * *point).xy().coords);
            }
            Err(Error::invalid(
                FIELD,
                format!("[{index}] is {point}; must be finite numbers"),
            ))
        })
        .collect()
}

fn check_crossing(corners: &[Vector2<f64>]) -> Result<(), Error> {
    let count = corners.len();
    let side = |from: usize| [corners[from], corners[(from + 1) % count]];
    for first in 0..count {
        // The next side and the one before touch it by their ends.
        for second in first + 2..count.min(first + count - 1) {
            if cross(side(first), side(second)) {
                return Err(Error::invalid(
                    FIELD,
                    format!("crosses itself after points [{first}] and [{second}]"),
                ));
            }
        }
    }
    Ok(())
}

fn cross(a: [Vector2<f64>; 2], b: [Vector2<f64>; 2]) -> bool {
    let side =
        |line: [Vector2<f64>; 2], point: Vector2<f64>| (line[1] - line[0]).perp(&(point - line[0]));
    side(a, b[0]) * side(a, b[1]) < 0.0 && side(b, a[0]) * side(b, a[1]) < 0.0
}

/// The closed Catmull-Rom curve through the corners, as a viewer draws it between its points.
fn rounded(corners: &[Vector2<f64>]) -> Vec<Vector2<f64>> {
    let count = corners.len();
    let mut outline = Vec::with_capacity(count * PIECES);
    for corner in 0..count {
        let at = |offset: usize| corners[(corner + count - 1 + offset) % count];
        let [before, from, to, after] = [at(0), at(1), at(2), at(3)];
        for piece in 0..PIECES {
            let t = piece as f64 / PIECES as f64;
            let (t2, t3) = (t * t, t * t * t);
            outline.push(
                0.5 * (2.0 * from
                    + (to - before) * t
                    + (2.0 * before - 5.0 * from + 4.0 * to - after) * t2
                    + (3.0 * from - before - 3.0 * to + after) * t3),
            );
        }
    }
    outline
}

/// Whether a ray from the place along x leaves the outline an odd number of times.
fn is_inside(place: &Vector2<f64>, outline: &[Vector2<f64>]) -> bool {
    let mut inside = false;
    let mut before = outline[outline.len() - 1];
    for &corner in outline {
        if (corner.y > place.y) != (before.y > place.y) {
            let share = (place.y - before.y) / (corner.y - before.y);
            inside ^= before.x + share * (corner.x - before.x) > place.x;
        }
        before = corner;
    }
    inside
}
