//! Domain results as messages.

use arthro_geometry::{Point3, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::planning::v1 as proto;

use super::options::Contour;
use crate::contour::Spline;
use crate::evaluation::Evaluation;
use crate::jaw::Bite;
use crate::plan::{Plan, Progress};

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
    });
    proto::PlanResectionResponse { event: Some(event) }
}

pub(super) fn plan(plan: &Plan, seconds: f64) -> proto::ResectionPlan {
    proto::ResectionPlan {
        bites: plan.bites.iter().map(bite).collect(),
        contour: plan.contour.iter().map(point).collect(),
        path: plan.path.iter().map(point).collect(),
        evaluation: Some(evaluation(&plan.evaluation)),
        seconds,
    }
}

pub(super) fn evaluation(evaluation: &Evaluation) -> proto::ResectionEvaluation {
    proto::ResectionEvaluation {
        bites: u32::try_from(evaluation.bites).unwrap_or(u32::MAX),
        lesion_mm3: evaluation.lesion_mm3,
        lesion_covered_percent: evaluation.lesion_covered_percent,
        region_mm3: evaluation.region_mm3,
        region_covered_percent: evaluation.region_covered_percent,
        healthy_removed_mm3: evaluation.healthy_removed_mm3,
        outside_removed_mm3: evaluation.outside_removed_mm3,
        rim_min_mm: evaluation.rim_min_mm,
        rim_min_at: Some(point(&evaluation.rim_min_at)),
        rim_mean_mm: evaluation.rim_mean_mm,
    }
}

fn bite(bite: &Bite) -> proto::Bite {
    proto::Bite {
        center: Some(point(&bite.center)),
        approach: Some(direction(&bite.approach)),
        opening: Some(direction(&bite.opening)),
        contour_point: Some(point(&bite.contour_point)),
    }
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
