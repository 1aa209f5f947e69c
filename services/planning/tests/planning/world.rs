//! The cases that the tests plan.

use arthro_geometry::phantom::{self, Phantom, RadialTear};
use arthro_geometry::{Mesh, Point3, Vector3};
use arthro_planning::Error;
use arthro_planning::bites::Patience;
use arthro_planning::evaluation::Evaluation;
use arthro_planning::jaw::{Bite, Jaw};
use arthro_planning::paper::{Cost, Search};
use arthro_planning::plan::{self, EvaluationRequest, Given, Limits, Plan, Planner, Request};
use arthro_planning::target::{Aim, Rules};

pub const LESION_SPACING_MM: f64 = 0.5;

/// The torn phantom with the paper's start, goal and box.
pub fn papers_case() -> Request {
    Request {
        model: phantom::mesh(),
        lesion: lesion(&phantom::mesh(), |point| {
            Phantom::default().is_torn(point, &RadialTear::BODY)
        }),
        lesion_spacing_mm: LESION_SPACING_MM,
        aim: Aim::Ends {
            start: phantom::START,
            goal: phantom::GOAL,
        },
        contour_rules: Rules::default(),
        target_box: Some(phantom::TARGET_BOX),
        portals: vec![phantom::PORTAL_ANTEROLATERAL],
        jaw: Jaw::new(3.0, 4.5),
        voxel_mm: 0.5,
        planner: Planner::Bites,
        limits: Limits::default(),
        effort: 1,
        knee: None,
        arthroscope: None,
        seed: 1,
    }
}

/// The scenario TEAR: the contour leads around the tear alone.
pub fn tear_case() -> Request {
    Request {
        aim: Aim::Lesion,
        ..papers_case()
    }
}

/// The scenario BAND: everything inboard of the contour from the paper's start to its goal.
pub fn band_case() -> Request {
    Request {
        lesion: Vec::new(),
        contour_rules: Rules {
            rim_min_mm: 3.2,
            ..Rules::default()
        },
        ..papers_case()
    }
}

/// The paper's search as the service sets it by default.
pub fn papers_search() -> Search {
    Search {
        cost: Cost::Corrected,
        step_mm: 1.0,
        tolerance_mm: 1.0,
        cost_limit_per_mm: 0.4,
        max_iterations: 100_000,
        seed: 1,
    }
}

/// The points of a grid around a mesh that are damaged.
pub fn lesion(mesh: &Mesh, is_damaged: impl Fn(&Point3) -> bool) -> Vec<Point3> {
    let (low, high) = mesh.bounds().unwrap();
    let first = low.map(|value| (value / LESION_SPACING_MM).floor() as i64);
    let last = high.map(|value| (value / LESION_SPACING_MM).ceil() as i64);
    let mut points = Vec::new();
    for i in first.x..=last.x {
        for j in first.y..=last.y {
            for k in first.z..=last.z {
                let point = Point3::new(i as f64, j as f64, k as f64) * LESION_SPACING_MM;
                if is_damaged(&point) {
                    points.push(point);
                }
            }
        }
    }
    points
}

pub fn plan(request: &Request) -> Result<Plan, Error> {
    plan::plan(request, &|| Patience::GoOn, &mut |_| {})
}

/// Scores bites on the request's lesion alone.
pub fn score(request: &Request, bites: &[Bite]) -> Evaluation {
    plan::evaluate(&EvaluationRequest {
        model: request.model.clone(),
        lesion: request.lesion.clone(),
        lesion_spacing_mm: request.lesion_spacing_mm,
        contour: Vec::new(),
        bites: bites.iter().map(Given::from).collect(),
        portals: request.portals.clone(),
        jaw: request.jaw,
        throat_limit: request.limits.throat_limit,
        voxel_mm: request.voxel_mm,
    })
    .unwrap()
}

/// The least share of the lesion that stays covered when all bites lie `error_mm` off in the plane
/// across `superior`, whatever the direction.
pub fn worst_displaced_percent(
    request: &Request,
    bites: &[Bite],
    superior: &Vector3,
    error_mm: f64,
) -> f64 {
    let first = superior.cross(&bites[0].approach).normalize();
    let second = superior.cross(&first);
    let covered = (0..36).map(|step| {
        let (sin, cos) = (f64::from(step) * std::f64::consts::TAU / 36.0).sin_cos();
        let by = (first * cos + second * sin) * error_mm;
        let displaced: Vec<Bite> = bites.iter().map(|bite| bite.displaced(&by)).collect();
        score(request, &displaced).lesion_covered_percent
    });
    covered.fold(100.0, f64::min)
}
