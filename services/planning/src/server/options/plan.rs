//! The options of a plan.

use std::ops::RangeInclusive;

use arthro_geometry::Mesh;
use arthro_proto::planning::v1 as proto;
use tonic::Status;

use super::check::Check;
use super::{MAX_CONTOUR_POINTS, MAX_PORTALS, PERCENT};
use crate::bites::Partial;
use crate::contour::MIN_CONTROL_POINTS;
use crate::paper::{Cost, Search};
use crate::plan::{Limits, Planner, Request};
use crate::server::{joint, view};
use crate::target::{Aim, Rules};

const TOLERANCE_MM: RangeInclusive<f64> = 0.1..=5.0;
const STEP_MM: RangeInclusive<f64> = 0.2..=3.0;
const COST_LIMIT_PER_MM: RangeInclusive<f64> = 0.01..=10.0;
const MAX_ITERATIONS: u32 = 1_000_000;
const RIM_MIN_MM: RangeInclusive<f64> = 0.5..=20.0;
const REGION_PERCENT: RangeInclusive<f64> = 50.0..=100.0;
const OUTSIDE_MM3: RangeInclusive<f64> = 0.0..=1000.0;
const PLACEMENT_ERROR_MM: RangeInclusive<f64> = 0.0..=3.0;
const REACH_MM: RangeInclusive<f64> = 1.0..=60.0;
const MARGIN_MM: RangeInclusive<f64> = 0.0..=5.0;
const MAX_EFFORT: u32 = 100;

/// The request without its model and lesion.
pub(crate) fn read(options: &proto::PlanResectionOptions) -> Result<Request, Status> {
    let mut check = Check::default();
    let (few_portals, few_points) = (
        check.at_most(
            "options.further_portals",
            options.further_portals.len(),
            MAX_PORTALS - 1,
        ),
        check.at_most("options.contour", options.contour.len(), MAX_CONTOUR_POINTS),
    );
    if !(few_portals && few_points) {
        return check.done_never();
    }
    let mut portals = vec![check.point("options.portal", options.portal.as_ref())];
    portals.extend(check.points("options.further_portals", &options.further_portals));
    let target_box = options.target_box.as_ref();
    let contour_rules = contour_rules(options, &mut check);
    let request = Request {
        model: Mesh::default(),
        lesion: Vec::new(),
        lesion_spacing_mm: check.lesion_spacing(options.lesion_spacing_mm),
        aim: aim(options, &mut check),
        target_box: target_box.map(|target_box| check.target_box(Some(target_box))),
        portals,
        jaw: check.jaw(options.jaw.as_ref()),
        voxel_mm: check.voxel(options.voxel_mm),
        planner: planner(options, contour_rules.tolerance_mm, &mut check),
        contour_rules,
        limits: limits(options, &mut check),
        effort: check.count("options.effort", options.effort, 1, MAX_EFFORT),
        knee: None,
        arthroscope: None,
        seed: options.seed,
    };
    let jaw_length_mm = request.jaw.length_mm;
    let joint = options.joint.as_ref();
    let knee = joint.map(|joint| joint::read(joint, jaw_length_mm, &mut check));
    let arthroscope = match &options.arthroscope {
        None => None,
        Some(given) => Some(view::read("options.arthroscope", given)?),
    };
    check.done(Request {
        knee,
        arthroscope,
        ..request
    })
}

fn aim(options: &proto::PlanResectionOptions, check: &mut Check) -> Aim {
    if !options.contour.is_empty() {
        let count = options.contour.len();
        if count < MIN_CONTROL_POINTS {
            let problem = format!("are {count}; must be at least {MIN_CONTROL_POINTS}");
            check.violation("options.contour", problem);
        }
        if options.start.is_some() || options.goal.is_some() {
            let problem = "is given beside start or goal; it has its own ends";
            check.violation("options.contour", problem);
        }
        let points = check.points("options.contour", &options.contour);
        return Aim::Curve { points };
    }
    if options.start.is_none() && options.goal.is_none() {
        return Aim::Lesion;
    }
    Aim::Ends {
        start: check.point("options.start", options.start.as_ref()),
        goal: check.point("options.goal", options.goal.as_ref()),
    }
}

fn contour_rules(options: &proto::PlanResectionOptions, check: &mut Check) -> Rules {
    let default = Rules::default();
    let margin_mm = options.lesion_margin_mm;
    let margin_mm = check.given("options.lesion_margin_mm", margin_mm, MARGIN_MM);
    let mut number = |field, value, default, range| check.number(field, value, default, range);
    Rules {
        tolerance_mm: number(
            "options.tolerance_mm",
            options.tolerance_mm,
            default.tolerance_mm,
            TOLERANCE_MM,
        ),
        rim_min_mm: number(
            "options.rim_min_mm",
            options.rim_min_mm,
            default.rim_min_mm,
            RIM_MIN_MM,
        ),
        reach_mm: number(
            "options.reach_mm",
            options.reach_mm,
            default.reach_mm,
            REACH_MM,
        ),
        lesion_margin_mm: margin_mm.unwrap_or(default.lesion_margin_mm),
    }
}

fn limits(options: &proto::PlanResectionOptions, check: &mut Check) -> Limits {
    let default = Limits::default();
    let percent = options.region_percent;
    let region_percent = default.region_percent;
    let outside_mm3 = options.outside_limit_mm3;
    let error_mm = options.placement_error_mm;
    let error_mm = check.given("options.placement_error_mm", error_mm, PLACEMENT_ERROR_MM);
    let throat = options.throat_limit_percent;
    let throat = check.given("options.throat_limit_percent", throat, PERCENT);
    Limits {
        region_percent: check.number(
            "options.region_percent",
            percent,
            region_percent,
            REGION_PERCENT,
        ),
        outside_limit_mm3: check.given("options.outside_limit_mm3", outside_mm3, OUTSIDE_MM3),
        placement_error_mm: error_mm.unwrap_or(default.placement_error_mm),
        throat_limit: throat.map_or(default.throat_limit, |percent| percent / 100.0),
        partial: if options.allow_partial {
            Partial::Allow
        } else {
            Partial::Refuse
        },
    }
}

fn planner(options: &proto::PlanResectionOptions, tolerance_mm: f64, check: &mut Check) -> Planner {
    let known = proto::Planner::try_from(options.planner);
    if known.is_err() {
        check.violation(
            "options.planner",
            format!("is {}; unknown", options.planner),
        );
    }
    let cost = match proto::PaperCost::try_from(options.paper_cost) {
        Ok(proto::PaperCost::AsPrinted) => Cost::AsPrinted,
        Ok(_) => Cost::Corrected,
        Err(_) => {
            let problem = format!("is {}; unknown", options.paper_cost);
            check.violation("options.paper_cost", problem);
            Cost::Corrected
        }
    };
    let search = Search {
        cost,
        step_mm: check.number("options.step_mm", options.step_mm, 1.0, STEP_MM),
        tolerance_mm,
        cost_limit_per_mm: check.number(
            "options.curvature_cost_limit",
            options.curvature_cost_limit,
            0.4,
            COST_LIMIT_PER_MM,
        ),
        max_iterations: check.count(
            "options.max_iterations",
            options.max_iterations,
            100_000,
            MAX_ITERATIONS,
        ),
        seed: options.seed,
    };
    match known {
        Ok(proto::Planner::Paper) => Planner::Paper(search),
        _ => Planner::Bites,
    }
}
