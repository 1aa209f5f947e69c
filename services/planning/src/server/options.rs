//! The options of a request, checked, with their defaults.

use std::ops::RangeInclusive;

use arthro_bootstrap::status;
use arthro_geometry::{Mesh, Point3, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::planning::v1 as proto;
use tonic::Status;

use crate::contour::MIN_CONTROL_POINTS;
use crate::jaw::{Bite, Jaw};
use crate::plan;
use crate::rrt::Search;

/// Most points of a contour.
const MAX_CONTOUR_POINTS: usize = 10_000;
/// Most bites that are scored.
pub(super) const MAX_BITES: usize = 1_000;
/// Coordinates of a CT, mm.
const COORDINATE_MM: RangeInclusive<f64> = -10_000.0..=10_000.0;
const SPACING_MM: RangeInclusive<f64> = 0.05..=10.0;
const LESION_SPACING_MM: RangeInclusive<f64> = 0.1..=2.0;
const JAW_WIDTH_MM: RangeInclusive<f64> = 0.5..=10.0;
pub(super) const JAW_LENGTH_MM: RangeInclusive<f64> = 0.5..=20.0;
const VOXEL_MM: RangeInclusive<f64> = 0.2..=2.0;
const TOLERANCE_MM: RangeInclusive<f64> = 0.1..=5.0;
const STEP_MM: RangeInclusive<f64> = 0.2..=3.0;
const COST_LIMIT_PER_MM: RangeInclusive<f64> = 0.01..=10.0;
const ITERATIONS: RangeInclusive<u32> = 1..=1_000_000;
const RIM_MIN_MM: RangeInclusive<f64> = 0.5..=20.0;
/// How far a unit direction's length may be from 1.
const UNIT_TOLERANCE: f64 = 1e-3;
/// How far the cosine between approach and opening may be from 0.
const RIGHT_ANGLE_TOLERANCE: f64 = 1e-2;
/// Control points that are chosen at most.
const MAX_CHOSEN_CONTROL_POINTS: usize = 64;

/// A contour to be fitted.
#[derive(Debug)]
pub(super) struct Contour {
    pub(super) points: Vec<Point3>,
    pub(super) control_points: usize,
    pub(super) spacing_mm: f64,
}

impl Contour {
    pub(super) fn read(request: proto::FitContourRequest) -> Result<Self, Status> {
        let mut check = Check::default();
        let count = request.points.len();
        if !(MIN_CONTROL_POINTS..=MAX_CONTOUR_POINTS).contains(&count) {
            return Err(status::invalid(
                "points",
                format!("are {count}; must be {MIN_CONTROL_POINTS} .. {MAX_CONTOUR_POINTS}"),
            ));
        }
        let points = check.points("points", &request.points);
        let spacing_mm = check.number("spacing_mm", request.spacing_mm, 1.0, SPACING_MM);
        // Half as many as points smooths what a hand clicked.
        let chosen = (count / 2 + 2).clamp(MIN_CONTROL_POINTS, MAX_CHOSEN_CONTROL_POINTS);
        let control_points = match request.control_point_count as usize {
            0 => chosen.min(count),
            given => given,
        };
        check.done(Self {
            points,
            control_points,
            spacing_mm,
        })
    }
}

/// The request without its model and lesion.
pub(super) fn plan(options: &proto::PlanResectionOptions) -> Result<plan::Request, Status> {
    let mut check = Check::default();
    let request = plan::Request {
        model: Mesh::default(),
        lesion: Vec::new(),
        lesion_spacing_mm: check.lesion_spacing(options.lesion_spacing_mm),
        start: check.point("options.start", options.start.as_ref()),
        goal: check.point("options.goal", options.goal.as_ref()),
        target_box: check.target_box(options.target_box.as_ref()),
        portal: check.point("options.portal", options.portal.as_ref()),
        jaw: check.jaw(options.jaw.as_ref()),
        voxel_mm: check.voxel(options.voxel_mm),
        rim_min_mm: check.number("options.rim_min_mm", options.rim_min_mm, 3.0, RIM_MIN_MM),
        search: Search {
            step_mm: check.number("options.step_mm", options.step_mm, 1.0, STEP_MM),
            tolerance_mm: check.number(
                "options.tolerance_mm",
                options.tolerance_mm,
                1.0,
                TOLERANCE_MM,
            ),
            cost_limit_per_mm: check.number(
                "options.curvature_cost_limit",
                options.curvature_cost_limit,
                0.4,
                COST_LIMIT_PER_MM,
            ),
            max_iterations: check.iterations(options.max_iterations),
            seed: options.seed,
        },
    };
    check.done(request)
}

/// The request without its model and lesion.
pub(super) fn evaluation(
    options: &proto::EvaluateResectionOptions,
) -> Result<plan::EvaluationRequest, Status> {
    let mut check = Check::default();
    for (field, count, limit) in [
        ("options.contour", options.contour.len(), MAX_CONTOUR_POINTS),
        ("options.bites", options.bites.len(), MAX_BITES),
    ] {
        if count > limit {
            check.violation(field, format!("are {count}; must be at most {limit}"));
            return check.done_never();
        }
    }
    let request = plan::EvaluationRequest {
        model: Mesh::default(),
        lesion: Vec::new(),
        lesion_spacing_mm: check.lesion_spacing(options.lesion_spacing_mm),
        contour: check.points("options.contour", &options.contour),
        bites: check.bites(&options.bites),
        jaw: check.jaw(options.jaw.as_ref()),
        voxel_mm: check.voxel(options.voxel_mm),
    };
    check.done(request)
}

/// Collects what is wrong, so that the caller hears of everything at once.
#[derive(Default)]
pub(super) struct Check {
    violations: Vec<(String, String)>,
}

impl Check {
    pub(super) fn violation(&mut self, field: impl Into<String>, problem: impl Into<String>) {
        self.violations.push((field.into(), problem.into()));
    }

    pub(super) fn done<T>(self, value: T) -> Result<T, Status> {
        if self.violations.is_empty() {
            Ok(value)
        } else {
            self.done_never()
        }
    }

    fn done_never<T>(self) -> Result<T, Status> {
        Err(status::invalid_all(self.violations))
    }

    /// A number in a range; 0 stands for the default.
    pub(super) fn number(
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

    pub(super) fn within(&mut self, field: &str, value: f64, range: RangeInclusive<f64>) {
        // NaN is in no range.
        if !range.contains(&value) {
            let problem = format!("is {value}; must be {} .. {}", range.start(), range.end());
            self.violation(field, problem);
        }
    }

    fn iterations(&mut self, value: u32) -> u32 {
        if value == 0 {
            return 100_000;
        }
        if !ITERATIONS.contains(&value) {
            let problem = format!("is {value}; must be at most {}", ITERATIONS.end());
            self.violation("options.max_iterations", problem);
        }
        value
    }

    fn lesion_spacing(&mut self, value: f64) -> f64 {
        self.number("options.lesion_spacing_mm", value, 0.5, LESION_SPACING_MM)
    }

    fn voxel(&mut self, value: f64) -> f64 {
        self.number("options.voxel_mm", value, 0.5, VOXEL_MM)
    }

    fn point(&mut self, field: &str, point: Option<&common::Point>) -> Point3 {
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

    pub(super) fn points(&mut self, field: &str, points: &[common::Point]) -> Vec<Point3> {
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

    fn target_box(&mut self, target_box: Option<&common::Box>) -> (Point3, Point3) {
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

    fn jaw(&mut self, jaw: Option<&proto::Jaw>) -> Jaw {
        let jaw = jaw.copied().unwrap_or_else(|| {
            self.violation("options.jaw", "is missing");
            proto::Jaw {
                width_mm: *JAW_WIDTH_MM.start(),
                length_mm: *JAW_LENGTH_MM.start(),
            }
        });
        self.within("options.jaw.width_mm", jaw.width_mm, JAW_WIDTH_MM);
        self.within("options.jaw.length_mm", jaw.length_mm, JAW_LENGTH_MM);
        Jaw {
            width_mm: jaw.width_mm,
            length_mm: jaw.length_mm,
        }
    }

    fn bites(&mut self, bites: &[proto::Bite]) -> Vec<Bite> {
        let mut read = Vec::with_capacity(bites.len());
        for (index, bite) in bites.iter().enumerate() {
            let field = |name: &str| format!("options.bites[{index}].{name}");
            let violations = self.violations.len();
            let center = self.point(&field("center"), bite.center.as_ref());
            let approach = self.direction(&field("approach"), bite.approach.as_ref());
            let opening = self.direction(&field("opening"), bite.opening.as_ref());
            let cosine = approach.dot(&opening);
            if cosine.abs() > RIGHT_ANGLE_TOLERANCE && self.violations.len() == violations {
                let angle_deg = cosine.clamp(-1.0, 1.0).acos().to_degrees();
                let problem = format!("is {angle_deg:.1} deg from approach; must be 90 deg");
                self.violation(field("opening"), problem);
            }
            read.push(Bite {
                center,
                approach,
                opening,
                // Where the edge was meant to be does not change what a bite cuts.
                contour_point: center,
            });
        }
        read
    }
}
