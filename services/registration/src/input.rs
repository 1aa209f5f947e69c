//! What a registration needs of its input, checked before any work: every violation is named, with value and limit.

use arthro_geometry::nalgebra::{Matrix3, SymmetricEigen};
use arthro_geometry::{Cloud, Point3, Vector3};

use crate::error::{Error, Violation};
use crate::pipeline::Options;
use crate::scale::ScaleRange;

/// Fewest points of a cloud.
pub const MIN_POINTS: usize = 100;
/// Most points of a cloud.
pub const MAX_POINTS: usize = 2_000_000;
/// Smallest diagonal of a cloud's bounding box, mm.
pub const MIN_EXTENT_MM: f64 = 0.5;
/// Largest diagonal of a cloud's bounding box, mm.
pub const MAX_EXTENT_MM: f64 = 1000.0;
/// Farthest a coordinate may be from its origin, mm.
pub const MAX_COORDINATE_MM: f64 = 100_000.0;
/// A cloud that spreads less than this share of its length across it lies on a line, which determines no pose.
pub const MIN_WIDTH: f64 = 0.02;
/// One that spreads less than this share of its length off its best plane lies on a plane, which determines none either.
pub const MIN_THICKNESS: f64 = 1e-3;
/// Scales accepted: between two sensors that may differ in unit by mistake of neither.
pub const SCALES: std::ops::RangeInclusive<f64> = 0.01..=100.0;
/// Widest range of scales, as the ratio of its ends; what is searched grows with its logarithm.
pub const MAX_SCALE_RATIO: f64 = 100.0;

/// Shortest time that a registration can be asked to answer in, s.
pub const MIN_DEADLINE_S: f64 = 0.05;

/// Refuses what cannot be registered.
pub fn check(source: &Cloud, target: &Cloud, options: &Options) -> Result<(), Error> {
    let mut violations = options_violations(options);
    violations.extend(cloud_violation("source", &source.points));
    violations.extend(cloud_violation("target", &target.points));
    if violations.is_empty() {
        Ok(())
    } else {
        Err(Error::Invalid(violations))
    }
}

/// What is wrong with the options.
pub fn options_violations(options: &Options) -> Vec<Violation> {
    let mut violations = Vec::new();
    let ScaleRange { low, high } = options.scale;
    let is_scale = |scale: &f64| SCALES.contains(scale);
    if !is_scale(&low) || !is_scale(&high) {
        violations.push(Violation::new(
            "scale",
            format!(
                "is {low} to {high}, must be within {} to {}",
                SCALES.start(),
                SCALES.end()
            ),
        ));
    } else if low > high {
        violations.push(Violation::new(
            "scale",
            format!("is the empty range {low} to {high}, must begin at or below its end"),
        ));
    } else if high / low > MAX_SCALE_RATIO {
        violations.push(Violation::new(
            "scale",
            format!("is {low} to {high}, must span at most a factor of {MAX_SCALE_RATIO}"),
        ));
    }
    if let Some((low, high)) = options.target_region
        && !(low.iter().chain(high.iter()).all(|c| c.is_finite()) && low <= high)
    {
        violations.push(Violation::new(
            "target_region",
            format!("is {low} to {high}, must be a box with its lower corner first"),
        ));
    }
    if let Some(viewpoint) = options.viewpoint
        && !viewpoint.iter().all(|c| c.abs() <= MAX_COORDINATE_MM)
    {
        violations.push(Violation::new(
            "viewpoint",
            format!("is {viewpoint}, must be finite and within {MAX_COORDINATE_MM} mm"),
        ));
    }
    violations
}

/// What is wrong with a cloud's announced number of points.
pub fn count_violation(field: &str, count: usize) -> Option<Violation> {
    let limit = match count {
        0 => return Some(Violation::new(field, "is empty, needs at least 100 points")),
        _ if count < MIN_POINTS => format!("at least {MIN_POINTS}"),
        _ if count > MAX_POINTS => format!("at most {MAX_POINTS}"),
        _ => return None,
    };
    Some(Violation::new(
        field,
        format!("has {count} points, must have {limit}"),
    ))
}

/// What is wrong with a cloud.
pub fn cloud_violation(field: &str, points: &[Point3]) -> Option<Violation> {
    if let Some(violation) = count_violation(field, points.len()) {
        return Some(violation);
    }
    let far = |p: &Point3| !p.iter().all(|c| c.abs() <= MAX_COORDINATE_MM);
    if let Some(index) = points.iter().position(far) {
        let Point3 { coords } = points[index];
        return Some(Violation::new(
            format!("{field}[{index}]"),
            format!(
                "is ({}, {}, {}), must be finite and within {MAX_COORDINATE_MM} mm",
                coords.x, coords.y, coords.z
            ),
        ));
    }
    let (low, high) = arthro_geometry::cloud::bounds(points)?;
    let extent_mm = (high - low).norm();
    if extent_mm < MIN_EXTENT_MM {
        return Some(Violation::new(
            field,
            format!(
                "spans {extent_mm:.4} mm, must span at least {MIN_EXTENT_MM} mm; are the coordinates in metres?"
            ),
        ));
    }
    if extent_mm > MAX_EXTENT_MM {
        return Some(Violation::new(
            field,
            format!(
                "spans {extent_mm:.1} mm, must span at most {MAX_EXTENT_MM} mm; are the coordinates in micrometres, or is more than the meniscus in it?"
            ),
        ));
    }
    let [thickness_mm, width_mm, length_mm] = spreads_mm(points);
    let flat = |what: &str, spread_mm: f64, least: f64| {
        let least_mm = least * length_mm;
        (spread_mm < least_mm).then(|| {
            Violation::new(
                field,
                format!("lies on a {what}: it spreads {spread_mm:.6} mm across it, must spread at least {least_mm:.6} mm"),
            )
        })
    };
    flat("line", width_mm, MIN_WIDTH).or_else(|| flat("plane", thickness_mm, MIN_THICKNESS))
}

/// Standard deviations along the main directions, the least first, mm.
fn spreads_mm(points: &[Point3]) -> [f64; 3] {
    let count = points.len() as f64;
    let mean = points.iter().map(|p| p.coords).sum::<Vector3>() / count;
    let covariance: Matrix3<f64> = points
        .iter()
        .map(|p| p.coords - mean)
        .map(|d| d * d.transpose())
        .sum();
    let mut spreads = SymmetricEigen::new(covariance / count).eigenvalues;
    spreads.as_mut_slice().sort_by(f64::total_cmp);
    [spreads[0], spreads[1], spreads[2]].map(|variance| variance.max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patch(scale: f64) -> Vec<Point3> {
        (0..400)
            .map(|i| {
                Point3::new(
                    f64::from(i % 20),
                    f64::from(i / 20),
                    f64::from(i % 20).sin(),
                ) * scale
            })
            .collect()
    }

    fn said(points: &[Point3]) -> String {
        cloud_violation("target", points)
            .map(|v| format!("{} {}", v.field, v.description))
            .unwrap_or_default()
    }

    #[test]
    fn a_good_cloud_passes() {
        assert_eq!(said(&patch(1.0)), "");
    }

    #[test]
    fn bad_clouds_are_refused_by_name_value_and_limit() {
        assert!(said(&[]).contains("is empty"));
        assert!(said(&patch(1.0)[..3]).contains("has 3 points, must have at least 100"));
        assert!(said(&patch(0.001)).contains("metres?"));
        assert!(said(&patch(1000.0)).contains("at most 1000 mm"));
        let mut points = patch(1.0);
        points[7].y = f64::NAN;
        assert!(said(&points).contains("target[7] is (7, NaN, "));
        let line: Vec<Point3> = (0..200)
            .map(|i| Point3::new(f64::from(i), 0.0, 0.0))
            .collect();
        assert!(said(&line).contains("lies on a line"));
        let plane: Vec<Point3> = patch(1.0)
            .iter()
            .map(|p| Point3::new(p.x, p.y, 0.3 * p.x))
            .collect();
        assert!(said(&plane).contains("lies on a plane"));
    }

    #[test]
    fn bad_options_are_all_named_at_once() {
        let options = Options {
            scale: ScaleRange {
                low: 3.5,
                high: 0.3,
            },
            viewpoint: Some(Point3::new(0.0, f64::INFINITY, 0.0)),
            target_region: Some((Point3::new(1.0, 0.0, 0.0), Point3::origin())),
            ..Options::default()
        };
        let said: Vec<String> = options_violations(&options)
            .into_iter()
            .map(|violation| format!("{} {}", violation.field, violation.description))
            .collect();
        assert_eq!(said.len(), 3);
        assert!(
            said[0].starts_with("scale is the empty range 3.5 to 0.3"),
            "{}",
            said[0]
        );
        assert!(said[1].starts_with("target_region"));
        assert!(said[2].starts_with("viewpoint"));
    }

    #[test]
    fn scales_beyond_all_reason_are_refused() {
        for (low, high, expected) in [
            (f64::NAN, 1.0, "must be within"),
            (-1.0, 1.0, "must be within"),
            (0.01, 100.0, "must span at most"),
        ] {
            let options = Options {
                scale: ScaleRange { low, high },
                ..Options::default()
            };
            let said = &options_violations(&options)[0].description;
            assert!(said.contains(expected), "{said}");
        }
    }
}
