//! Reads the parts of a request and collects what is wrong with them.

use std::ops::RangeInclusive;

use arthro_bootstrap::status;
use arthro_geometry::{Point3, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::planning::v1 as proto;
use tonic::Status;

use crate::jaw::{DEFAULT_THROAT_MM, Jaw};
use crate::plan::Given;

/// Coordinates of a CT, mm.
const COORDINATE_MM: RangeInclusive<f64> = -10_000.0..=10_000.0;
const LESION_SPACING_MM: RangeInclusive<f64> = 0.1..=2.0;
const JAW_WIDTH_MM: RangeInclusive<f64> = 0.5..=10.0;
pub(in crate::server) const JAW_LENGTH_MM: RangeInclusive<f64> = 0.5..=20.0;
const THROAT_MM: RangeInclusive<f64> = 0.1..=10.0;
const VOXEL_MM: RangeInclusive<f64> = 0.2..=2.0;
/// How far a unit direction's length may be from 1.
const UNIT_TOLERANCE: f64 = 1e-3;
/// How far the cosine between approach and opening may be from 0.
const RIGHT_ANGLE_TOLERANCE: f64 = 1e-2;

/// Collects what is wrong, so that the caller hears of everything at once.
#[derive(Default)]
pub(in crate::server) struct Check {
    violations: Vec<(String, String)>,
}

impl Check {
    pub(in crate::server) fn violation(
        &mut self,
        field: impl Into<String>,
        problem: impl Into<String>,
    ) {
        self.violations.push((field.into(), problem.into()));
    }

    pub(in crate::server) fn done<T>(self, value: T) -> Result<T, Status> {
        if self.violations.is_empty() {
            Ok(value)
        } else {
            self.done_never()
        }
    }

    pub(in crate::server) fn done_never<T>(self) -> Result<T, Status> {
        Err(status::invalid_all(self.violations))
    }

    /// A number in a range; 0 stands for the default.
    pub(in crate::server) fn number(
        &mut self,
        field: &str,
        value: f64,
        default: f64,
        range: RangeInclusive<f64>,
    ) -> f64 {
        if value == 0.0 {
            return default;
        }
        self.within(field, value, range);
        value
    }

    pub(in crate::server) fn within(
        &mut self,
        field: &str,
        value: f64,
        range: RangeInclusive<f64>,
    ) {
        // NaN is in no range.
        if !range.contains(&value) {
            let problem = format!("is {value}; must be {} .. {}", range.start(), range.end());
            self.violation(field, problem);
        }
    }

    /// A whole number up to a limit; 0 stands for the default.
    pub(in crate::server) fn count(
        &mut self,
        field: &str,
        value: u32,
        default: u32,
        most: u32,
    ) -> u32 {
        if value == 0 {
            return default;
        }
        if value > most {
            self.violation(field, format!("is {value}; must be at most {most}"));
        }
        value
    }

    /// A number in a range, of which 0 may be one.
    pub(in crate::server) fn given(
        &mut self,
        field: &str,
        value: Option<f64>,
        range: RangeInclusive<f64>,
    ) -> Option<f64> {
        if let Some(value) = value {
            self.within(field, value, range);
        }
        value
    }

    /// At most so many; more are not looked at.
    pub(in crate::server) fn at_most(&mut self, field: &str, count: usize, limit: usize) -> bool {
        if count > limit {
            self.violation(field, format!("are {count}; must be at most {limit}"));
        }
        count <= limit
    }

    pub(in crate::server) fn lesion_spacing(&mut self, value: f64) -> f64 {
        self.number("options.lesion_spacing_mm", value, 0.5, LESION_SPACING_MM)
    }

    pub(in crate::server) fn voxel(&mut self, value: f64) -> f64 {
        self.number("options.voxel_mm", value, 0.5, VOXEL_MM)
    }

    pub(in crate::server) fn point(
        &mut self,
        field: &str,
        point: Option<&common::Point>,
    ) -> Point3 {
        let Some(point) = point else {
            self.violation(field, "is missing");
            return Point3::origin();
        };
        for (axis, value) in [
            ("x_mm", point.x_mm),
            ("y_mm", point.y_mm),
            ("z_mm", point.z_mm),
        ] {
            self.within(&format!("{field}.{axis}"), value, COORDINATE_MM);
        }
        Point3::new(point.x_mm, point.y_mm, point.z_mm)
    }

    pub(in crate::server) fn points(
        &mut self,
        field: &str,
        points: &[common::Point],
    ) -> Vec<Point3> {
        let indexed = points.iter().enumerate();
        indexed
            .map(|(index, point)| self.point(&format!("{field}[{index}]"), Some(point)))
            .collect()
    }

    fn direction(&mut self, field: &str, direction: Option<&common::Direction>) -> Vector3 {
        let Some(direction) = direction else {
            self.violation(field, "is missing");
            return Vector3::x();
        };
        let vector = Vector3::new(direction.x, direction.y, direction.z);
        let length = vector.norm();
        if (length - 1.0).abs() <= UNIT_TOLERANCE {
            return vector / length;
        }
        let problem = format!("has length {length}; must be 1 within {UNIT_TOLERANCE}");
        self.violation(field, problem);
        Vector3::x()
    }

    pub(in crate::server) fn target_box(
        &mut self,
        target_box: Option<&common::Box>,
    ) -> (Point3, Point3) {
        let corner = |pick: fn(&common::Box) -> Option<&common::Point>| target_box.and_then(pick);
        let low = self.point("options.target_box.min", corner(|b| b.min.as_ref()));
        let high = self.point("options.target_box.max", corner(|b| b.max.as_ref()));
        for (axis, name) in ["x_mm", "y_mm", "z_mm"].into_iter().enumerate() {
            if low[axis] >= high[axis] && target_box.is_some() {
                let problem = format!("is empty: {name} from {} to {}", low[axis], high[axis]);
                self.violation("options.target_box", problem);
            }
        }
        (low, high)
    }

    pub(in crate::server) fn jaw(&mut self, jaw: Option<&proto::Jaw>) -> Jaw {
        let jaw = jaw.copied().unwrap_or_else(|| {
            self.violation("options.jaw", "is missing");
            proto::Jaw {
                width_mm: *JAW_WIDTH_MM.start(),
                length_mm: *JAW_LENGTH_MM.start(),
                throat_mm: None,
            }
        });
        self.within("options.jaw.width_mm", jaw.width_mm, JAW_WIDTH_MM);
        self.within("options.jaw.length_mm", jaw.length_mm, JAW_LENGTH_MM);
        let throat_mm = self.given("options.jaw.throat_mm", jaw.throat_mm, THROAT_MM);
        Jaw {
            throat_mm: throat_mm.unwrap_or(DEFAULT_THROAT_MM),
            ..Jaw::new(jaw.width_mm, jaw.length_mm)
        }
    }

    pub(in crate::server) fn bites(&mut self, bites: &[proto::Bite]) -> Vec<Given> {
        let mut read = Vec::with_capacity(bites.len());
        for (index, bite) in bites.iter().enumerate() {
            let field = |name: &str| format!("options.bites[{index}].{name}");
            let violations = self.violations.len();
            let center = self.point(&field("center"), bite.center.as_ref());
            let axis = self.direction(&field("approach"), bite.approach.as_ref());
            let opening = bite.opening.as_ref();
            let opening = opening.map(|opening| self.direction(&field("opening"), Some(opening)));
            let cosine = opening.map_or(0.0, |opening| axis.dot(&opening));
            if cosine.abs() > RIGHT_ANGLE_TOLERANCE && self.violations.len() == violations {
                let angle_deg = cosine.clamp(-1.0, 1.0).acos().to_degrees();
                let problem = format!("is {angle_deg:.1} deg from approach; must be 90 deg");
                self.violation(field("opening"), problem);
            }
            read.push(Given {
                center,
                axis,
                opening,
            });
        }
        read
    }
}
