//! Domain results as messages.

use arthro_geometry::{Point3, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::planning::v1 as proto;

use super::options::Contour;
use super::{joint, view};
use crate::bites::Ended;
use crate::contour::Spline;
use crate::evaluation::Evaluation;
use crate::evaluation::order::BiteAccount;
use crate::plan::{Plan, Planned, Progress};

pub(super) fn contour(spline: &Spline, wanted: &Contour) -> proto::FitContourResponse {
    let parameters = spline.parameters_every(wanted.spacing_mm);
    let samples = parameters.iter().map(|&at| proto::ContourSample {
        point: Some(point(&spline.point(at))),
        curvature_per_mm: spline.curvature_per_mm(at),
    });
    proto::FitContourResponse {
        samples: samples.collect(),
        length_mm: spline.length_mm(),
        fit_rms_mm: spline.rms_mm(&wanted.points),
    }
}

pub(super) fn progress(progress: &Progress) -> proto::PlanResectionResponse {
    let event = proto::plan_resection_response::Event::Progress(proto::PlanProgress {
        stage: progress.stage.to_owned(),
        iterations: progress.iterations,
        fraction: progress.fraction,
        incumbent: progress.incumbent.map(count),
        bound: progress.bound.map(count),
    });
    proto::PlanResectionResponse { event: Some(event) }
}

pub(super) fn plan(plan: &Plan, seconds: f64) -> proto::ResectionPlan {
    let planner = match plan.choice {
        Some(_) => proto::Planner::Bites,
        None => proto::Planner::Paper,
    };
    let ended = match plan.choice.map(|choice| choice.ended) {
        None => proto::SearchEnd::Unspecified,
        Some(Ended::Optimal) => proto::SearchEnd::Optimal,
        Some(Ended::Effort) => proto::SearchEnd::Effort,
        Some(Ended::Deadline) => proto::SearchEnd::Deadline,
    };
    proto::ResectionPlan {
        bites: plan.bites.iter().map(bite).collect(),
        contour: plan.contour.iter().map(point).collect(),
        path: plan.path.iter().map(point).collect(),
        evaluation: Some(evaluation(&plan.evaluation)),
        seconds,
        planner: planner.into(),
        bound: plan.choice.map_or(0, |choice| count(choice.bound)),
        complete: plan.choice.is_none_or(|choice| choice.complete),
        ended: ended.into(),
        views: plan.views.iter().map(view::view).collect(),
        clearances: plan
            .bites
            .iter()
            .filter_map(|planned| planned.clearance.as_ref())
            .map(joint::clearance)
            .collect(),
    }
}

pub(super) fn evaluation(evaluation: &Evaluation) -> proto::ResectionEvaluation {
    proto::ResectionEvaluation {
        bites: count(evaluation.bites),
        lesion_mm3: evaluation.lesion_mm3,
        lesion_covered_percent: evaluation.lesion_covered_percent,
        region_mm3: evaluation.region_mm3,
        region_covered_percent: evaluation.region_covered_percent,
        healthy_removed_mm3: evaluation.healthy_removed_mm3,
        outside_removed_mm3: evaluation.outside_removed_mm3,
        rim_min_mm: evaluation.rim_min_mm,
        rim_min_at: Some(point(&evaluation.rim_min_at)),
        rim_mean_mm: evaluation.rim_mean_mm,
        removed_mm3: evaluation.removed_mm3,
        left_mm3: evaluation.left_mm3,
        rim_min_angle_rad: evaluation.rim_min_angle_rad,
        scallop_rms_mm: evaluation.scallop.map(|scallop| scallop.rms_mm),
        scallop_max_mm: evaluation.scallop.map(|scallop| scallop.max_mm),
        edge_jumps: count(evaluation.edge_turns.jumps),
        edge_turn_max_rad: evaluation.edge_turns.largest_rad,
        edge_turn_rms_rad: evaluation.edge_turns.rms_rad,
        predicted_seconds: evaluation.predicted_seconds,
        order_feasible: evaluation.is_order_feasible(),
        infeasible_bites: evaluation
            .infeasible
            .iter()
            .map(|blocked| count(blocked.bite))
            .collect(),
        accounts: evaluation.accounts.iter().map(account).collect(),
    }
}

fn account(account: &BiteAccount) -> proto::BiteAccount {
    proto::BiteAccount {
        region_mm3: account.region_mm3,
        outside_mm3: account.outside_mm3,
        throat_blocked_percent: 100.0 * account.throat_share,
        seconds: account.seconds,
    }
}

fn bite(planned: &Planned) -> proto::Bite {
    let bite = &planned.bite;
    proto::Bite {
        center: Some(point(&bite.center)),
        approach: Some(direction(&bite.approach)),
        opening: Some(direction(&bite.opening)),
        contour_point: Some(point(&bite.contour_point)),
        portal: count(planned.portal),
    }
}

fn count(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

pub(super) fn point(point: &Point3) -> common::Point {
    common::Point {
        x_mm: point.x,
        y_mm: point.y,
        z_mm: point.z,
    }
}

fn direction(direction: &Vector3) -> common::Direction {
    common::Direction {
        x: direction.x,
        y: direction.y,
        z: direction.z,
    }
}
