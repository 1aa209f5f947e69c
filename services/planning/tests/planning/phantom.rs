//! The paper's start, goal and box on the torn phantom.

use std::ops::ControlFlow;

use arthro_geometry::{Point3, Vector3, phantom};
use arthro_planning::Error;
use arthro_planning::evaluation::Evaluation;
use arthro_planning::jaw::Bite;
use arthro_planning::plan;

use crate::world::{papers_case, plan, worst_displaced_percent};

#[test]
fn the_papers_case_clears_the_lesion_with_fewer_bites_than_the_paper() {
    for seed in 0..8 {
        let mut request = papers_case();
        request.search.seed = seed;
        let evaluation = plan(&request).unwrap().evaluation;
        assert!(evaluation.bites <= 26, "{evaluation:?}");
        assert!(evaluation.lesion_covered_percent >= 98.0, "{evaluation:?}");
        assert!(evaluation.region_covered_percent >= 90.0, "{evaluation:?}");
        assert!(evaluation.outside_removed_mm3 <= 25.0, "{evaluation:?}");
        assert!(evaluation.rim_min_mm >= 2.9, "{evaluation:?}");
    }
}

#[test]
fn the_lesion_stays_covered_when_every_bite_lands_off() {
    for seed in 0..4 {
        let mut request = papers_case();
        request.search.seed = seed;
        let plan = plan(&request).unwrap();
        for error_mm in [0.35, 0.7] {
            let covered =
                worst_displaced_percent(&request, &plan.bites, &phantom::SUPERIOR, error_mm);
            assert!(covered >= 95.0, "{covered} % at {error_mm} mm");
        }
    }
}

#[test]
fn a_given_tear_alone_takes_few_bites() {
    let mut request = papers_case();
    let shape = phantom::Phantom::default();
    let on_edge = |phi_deg: f64| {
        shape.point(phantom::Coordinates {
            phi_rad: phi_deg.to_radians(),
            width_fraction: 0.03,
            height_fraction: 0.5,
        })
    };
    (request.start, request.goal) = (on_edge(28.0), on_edge(-28.0));
    let evaluation = plan(&request).unwrap().evaluation;
    assert!(evaluation.bites <= 10);
    assert!(evaluation.lesion_covered_percent >= 98.0);
    assert!(evaluation.rim_min_mm > 4.0);
}

#[test]
fn without_a_lesion_what_lies_inboard_of_the_contour_is_cleared() {
    let mut request = papers_case();
    request.lesion.clear();
    let evaluation = plan(&request).unwrap().evaluation;
    assert!(evaluation.bites <= 26);
    assert!(evaluation.region_covered_percent >= 95.0);
    assert_eq!(
        evaluation.lesion_covered_percent,
        evaluation.region_covered_percent
    );
}

#[test]
fn jaws_that_meet_the_contour_with_an_edge_spare_the_rim_that_centred_ones_cut() {
    let request = papers_case();
    let plan = plan(&request).unwrap();
    // The paper's way: every path point is the middle of a bite.
    let centred: Vec<Bite> = plan
        .path
        .iter()
        .filter_map(|&point| Bite::through(&request.portal, point, &phantom::SUPERIOR, point))
        .collect();
    let centred = score_on_contour(&request, &plan, &centred);
    let edged = score_on_contour(&request, &plan, &plan.bites);
    assert!(centred.bites > edged.bites);
    assert!(centred.outside_removed_mm3 > 5.0 * edged.outside_removed_mm3);
    assert!(centred.rim_min_mm < edged.rim_min_mm - 1.0);
}

fn score_on_contour(request: &plan::Request, plan: &plan::Plan, bites: &[Bite]) -> Evaluation {
    plan::evaluate(&plan::EvaluationRequest {
        model: request.model.clone(),
        lesion: request.lesion.clone(),
        lesion_spacing_mm: request.lesion_spacing_mm,
        contour: plan.contour.clone(),
        bites: bites.to_vec(),
        jaw: request.jaw,
        voxel_mm: request.voxel_mm,
    })
    .unwrap()
}

#[test]
fn a_plan_scored_as_a_foreign_list_of_bites_gets_the_same_score() {
    let request = papers_case();
    let plan = plan(&request).unwrap();
    let scored = score_on_contour(&request, &plan, &plan.bites);
    let close = |a: f64, b: f64, within: f64| assert!((a - b).abs() <= within, "{a} {b}");
    close(
        scored.lesion_covered_percent,
        plan.evaluation.lesion_covered_percent,
        0.1,
    );
    close(
        scored.region_covered_percent,
        plan.evaluation.region_covered_percent,
        1.0,
    );
    close(
        scored.healthy_removed_mm3,
        plan.evaluation.healthy_removed_mm3,
        1.0,
    );
    close(scored.rim_min_mm, plan.evaluation.rim_min_mm, 0.2);
}

#[test]
fn bites_have_their_axes_at_right_angles_and_their_centres_in_the_box() {
    let request = papers_case();
    let (low, high) = request.target_box;
    for bite in plan(&request).unwrap().bites {
        let along = (bite.center - request.portal).normalize();
        assert!((bite.approach - along).norm() < 1e-9);
        assert!(bite.approach.dot(&bite.opening).abs() < 1e-9);
        assert!(bite.opening.dot(&phantom::SUPERIOR) > 0.9);
        assert_eq!(bite.center.inf(&low), low);
        assert_eq!(bite.center.sup(&high), high);
    }
}

#[test]
fn the_path_leads_from_start_to_goal_and_stays_near_the_contour() {
    let request = papers_case();
    let plan = plan(&request).unwrap();
    assert!((plan.path[0] - request.start).norm() < 1e-9);
    assert!((plan.path[plan.path.len() - 1] - request.goal).norm() < 1e-9);
    let mut sum_mm = 0.0;
    for point in &plan.path {
        let distances = plan.contour.iter().map(|contour| (point - contour).norm());
        let distance_mm = distances.fold(f64::INFINITY, f64::min);
        assert!(distance_mm <= 1.0, "{distance_mm} mm");
        sum_mm += distance_mm;
    }
    // The search as printed in the paper strays by 2.3 mm on average.
    assert!(sum_mm / (plan.path.len() as f64) < 0.5);
}

#[test]
fn the_same_seed_gives_the_same_plan_and_another_seed_another_path() {
    let mut request = papers_case();
    let (first, again) = (plan(&request).unwrap(), plan(&request).unwrap());
    assert_eq!(first.bites, again.bites);
    assert_eq!(first.path, again.path);
    assert_eq!(first.evaluation, again.evaluation);
    request.search.seed = 2;
    assert_ne!(first.path, plan(&request).unwrap().path);
}

#[test]
fn the_progress_grows_and_names_every_stage() {
    let mut heard = Vec::new();
    plan::plan(&papers_case(), &mut |progress| {
        heard.push(progress);
        ControlFlow::Continue(())
    })
    .unwrap();
    assert!(
        heard
            .windows(2)
            .all(|pair| pair[0].fraction <= pair[1].fraction)
    );
    let mut stages: Vec<&str> = heard.iter().map(|progress| progress.stage).collect();
    stages.dedup();
    assert_eq!(stages, ["voxels", "contour", "rrt", "bites", "evaluation"]);
}

#[test]
fn a_plan_can_be_stopped_at_every_stage() {
    for stage in ["voxels", "contour", "rrt", "bites", "evaluation"] {
        let outcome = plan::plan(&papers_case(), &mut |progress| {
            if progress.stage == stage {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        });
        assert_eq!(outcome.map(|_| ()), Err(Error::Cancelled), "{stage}");
    }
}

/// The field that a broken request is refused for.
fn refused_field(request: &plan::Request) -> &'static str {
    match plan(request) {
        Err(Error::Invalid { field, .. }) => field,
        other => panic!("{other:?}"),
    }
}

#[test]
fn places_that_do_not_fit_the_tissue_are_refused_by_name() {
    let mut request = papers_case();
    request.start += Vector3::new(0.0, -6.0, 0.0);
    assert_eq!(refused_field(&request), "options.start");

    let mut request = papers_case();
    request.goal += Vector3::new(4.0, 0.0, 0.0);
    assert_eq!(refused_field(&request), "options.goal");

    let mut request = papers_case();
    request.target_box = (Point3::new(50.0, 40.0, 80.0), Point3::new(60.0, 70.0, 90.0));
    assert_eq!(refused_field(&request), "options.target_box");

    let mut request = papers_case();
    request.portal = Point3::new(56.0, 67.0, 50.0);
    assert_eq!(refused_field(&request), "options.portal");
}

#[test]
fn a_mesh_in_metres_and_one_turned_inside_out_in_part_are_refused() {
    let mut request = papers_case();
    for vertex in &mut request.model.vertices {
        *vertex *= 0.001;
    }
    assert_eq!(refused_field(&request), "model");

    let mut request = papers_case();
    for triangle in request.model.triangles.iter_mut().step_by(2) {
        triangle.swap(0, 1);
    }
    assert!(plan(&request).is_err());
}

#[test]
fn a_mesh_turned_inside_out_as_a_whole_has_the_same_plan() {
    let mut request = papers_case();
    let expected = plan(&request).unwrap();
    for triangle in &mut request.model.triangles {
        triangle.swap(0, 1);
    }
    let turned = plan(&request).unwrap();
    assert_eq!(turned.bites.len(), expected.bites.len());
}

#[test]
fn a_lesion_outside_the_model_is_refused_with_its_share() {
    let mut request = papers_case();
    for point in &mut request.lesion {
        point.y -= 5.0;
    }
    match plan(&request) {
        Err(Error::LesionOutsideModel {
            outside_percent,
            farthest_mm,
            ..
        }) => {
            assert!(outside_percent > 50.0);
            assert!(farthest_mm > 0.5);
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_goal_too_near_the_rim_is_refused_with_the_rim_it_would_leave() {
    let mut request = papers_case();
    request.goal.y += 1.5;
    request.goal.z -= 1.5;
    match plan(&request) {
        Err(Error::RimBelowLimit {
            rim_mm, limit_mm, ..
        }) => assert!(rim_mm < limit_mm),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_cost_limit_that_no_path_keeps_is_refused_after_the_iterations_given() {
    let mut request = papers_case();
    request.search.cost_limit_per_mm = 0.01;
    request.search.max_iterations = 5_000;
    match plan(&request) {
        Err(Error::NoPath {
            iterations,
            left_mm,
        }) => {
            assert_eq!(iterations, 5_000);
            assert!(left_mm > 1.0);
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_contour_along_the_free_edge_leaves_nothing_to_remove() {
    let mut request = papers_case();
    request.lesion.clear();
    let shape = phantom::Phantom::default();
    let on_edge = |phi_deg: f64| {
        shape.point(phantom::Coordinates {
            phi_rad: phi_deg.to_radians(),
            width_fraction: 0.0,
            height_fraction: 0.5,
        })
    };
    (request.start, request.goal) = (on_edge(10.0), on_edge(-10.0));
    assert!(matches!(plan(&request), Err(Error::NothingToRemove { .. })));
}

#[test]
fn a_box_around_start_and_goal_alone_is_refused_instead_of_planned_in_part() {
    let mut request = papers_case();
    request.lesion.clear();
    let (start, goal) = (request.start, request.goal);
    let around = Vector3::repeat(0.1);
    request.target_box = (start.inf(&goal) - around, start.sup(&goal) + around);
    assert!(matches!(plan(&request), Err(Error::NoPath { .. })));
}
