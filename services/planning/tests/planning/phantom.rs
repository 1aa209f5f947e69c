//! The paper's start, goal and box on the torn phantom.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use arthro_geometry::{Point3, Vector3, phantom};
use arthro_planning::Error;
use arthro_planning::bites::{Ended, Partial, Patience};
use arthro_planning::evaluation::Evaluation;
use arthro_planning::jaw::Bite;
use arthro_planning::plan::{self, Given, Plan, Planner, Request};
use arthro_planning::target::Aim;

use crate::world::{
    band_case, papers_case, papers_search, plan, tear_case, worst_displaced_percent,
};

fn bites(plan: &Plan) -> Vec<Bite> {
    plan.bites.iter().map(|planned| planned.bite).collect()
}

#[test]
fn a_tear_is_cleared_with_the_fewest_bites_there_are() {
    for seed in 0..3 {
        let plan = plan(&Request {
            seed,
            ..tear_case()
        })
        .unwrap();
        let evaluation = &plan.evaluation;
        assert!(evaluation.bites <= 5, "{evaluation:?}");
        assert!(evaluation.region_covered_percent >= 95.0, "{evaluation:?}");
        assert_eq!(evaluation.lesion_covered_percent, 100.0);
        assert!(evaluation.outside_removed_mm3 <= 4.5, "{evaluation:?}");
        assert!(evaluation.is_order_feasible(), "{evaluation:?}");
        let choice = plan.choice.unwrap();
        assert_eq!(
            (choice.bound, choice.ended),
            (evaluation.bites, Ended::Optimal)
        );
    }
}

#[test]
fn everything_inboard_of_the_papers_contour_takes_about_half_the_papers_bites() {
    let plan = plan(&band_case()).unwrap();
    let evaluation = &plan.evaluation;
    assert!(evaluation.bites <= 20, "{evaluation:?}");
    assert!(evaluation.region_covered_percent >= 95.0, "{evaluation:?}");
    assert!(evaluation.outside_removed_mm3 <= 15.0, "{evaluation:?}");
    assert!(evaluation.rim_min_mm >= 3.2, "{evaluation:?}");
    assert!(evaluation.is_order_feasible(), "{evaluation:?}");
    assert!(plan.choice.unwrap().bound <= evaluation.bites);
}

#[test]
fn the_lesion_stays_covered_when_every_bite_lands_off() {
    let request = tear_case();
    let bites = bites(&plan(&request).unwrap());
    let error_mm = request.limits.placement_error_mm;
    let covered = worst_displaced_percent(&request, &bites, &phantom::SUPERIOR, error_mm);
    assert!(covered >= 95.0, "{covered} % at {error_mm} mm");
}

#[test]
fn jaws_that_meet_the_contour_with_an_edge_spare_the_rim_that_centred_ones_cut() {
    let request = band_case();
    let planned = plan(&request).unwrap();
    // The paper's way: every path point is the middle of a bite.
    let paper = plan(&Request {
        planner: Planner::Paper(papers_search()),
        ..request
    })
    .unwrap();
    let (edged, centred) = (&planned.evaluation, &paper.evaluation);
    assert!(centred.bites > edged.bites);
    assert!(centred.outside_removed_mm3 > 5.0 * edged.outside_removed_mm3);
    assert!(centred.rim_min_mm < edged.rim_min_mm - 1.0);
    assert!(paper.choice.is_none() && planned.path.is_empty());
}

#[test]
fn an_edge_of_every_jaw_meets_the_contour_or_lies_inboard_of_it() {
    let request = tear_case();
    for planned in plan(&request).unwrap().bites {
        let bite = planned.bite;
        let offset = bite.contour_point - bite.center;
        let across = bite.opening.cross(&bite.approach);
        let along = offset.dot(&bite.approach).abs() / request.jaw.length_mm;
        let aside = offset.dot(&across).abs() / request.jaw.width_mm;
        // The middle of the jaw is never on the contour.
        assert!(along.max(aside) > 0.25, "{along} {aside}");
    }
}

fn score_on_contour(request: &Request, plan: &Plan, bites: &[Bite]) -> Evaluation {
    plan::evaluate(&plan::EvaluationRequest {
        model: request.model.clone(),
        lesion: request.lesion.clone(),
        lesion_spacing_mm: request.lesion_spacing_mm,
        contour: plan.contour.clone(),
        bites: bites.iter().map(Given::from).collect(),
        portals: request.portals.clone(),
        jaw: request.jaw,
        throat_limit: request.limits.throat_limit,
        voxel_mm: request.voxel_mm,
    })
    .unwrap()
}

#[test]
fn a_plan_scored_as_a_foreign_list_of_bites_gets_the_same_score() {
    let request = tear_case();
    let plan = plan(&request).unwrap();
    let scored = score_on_contour(&request, &plan, &bites(&plan));
    let close = |a: f64, b: f64, within: f64| assert!((a - b).abs() <= within, "{a} {b}");
    let expected = &plan.evaluation;
    close(
        scored.lesion_covered_percent,
        expected.lesion_covered_percent,
        0.1,
    );
    close(
        scored.region_covered_percent,
        expected.region_covered_percent,
        1.0,
    );
    close(
        scored.healthy_removed_mm3,
        expected.healthy_removed_mm3,
        1.0,
    );
    close(scored.rim_min_mm, expected.rim_min_mm, 0.2);
    assert!(scored.is_order_feasible());
}

#[test]
fn the_order_of_a_plan_is_part_of_it() {
    let request = band_case();
    let plan = plan(&request).unwrap();
    let mut turned = bites(&plan);
    turned.reverse();
    assert!(!score_on_contour(&request, &plan, &turned).is_order_feasible());
}

#[test]
fn bites_have_their_axes_at_right_angles_and_their_centres_in_the_box() {
    let request = papers_case();
    let (low, high) = request.target_box.unwrap();
    for bite in bites(&plan(&request).unwrap()) {
        let along = (bite.center - request.portals[0]).normalize();
        assert!((bite.approach - along).norm() < 1e-9);
        assert!(bite.approach.dot(&bite.opening).abs() < 1e-9);
        assert!(bite.opening.dot(&phantom::SUPERIOR) > 0.9);
        assert_eq!(bite.center.inf(&low), low);
        assert_eq!(bite.center.sup(&high), high);
    }
}

#[test]
fn a_second_portal_is_used_where_it_helps_and_bites_through_one_are_made_together() {
    let mut request = band_case();
    request.portals.push(Point3::new(62.0, 48.0, 94.5));
    let plan = plan(&request).unwrap();
    let portals: Vec<usize> = plan.bites.iter().map(|planned| planned.portal).collect();
    for planned in &plan.bites {
        let along = (planned.bite.center - request.portals[planned.portal]).normalize();
        assert!((planned.bite.approach - along).norm() < 1e-9);
    }
    let changes = portals.windows(2).filter(|pair| pair[0] != pair[1]).count();
    assert!(portals.contains(&1) && changes <= 4, "{portals:?}");
    assert!(plan.evaluation.is_order_feasible());
}

#[test]
fn the_same_seed_gives_the_same_plan_on_any_number_of_threads() {
    let request = tear_case();
    let expected = plan(&request).unwrap();
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let again = pool.unwrap().install(|| plan(&request)).unwrap();
        assert_eq!(bites(&again), bites(&expected));
        assert_eq!(again.evaluation, expected.evaluation);
        assert_eq!(again.choice, expected.choice);
    }
}

#[test]
fn the_papers_search_with_another_seed_finds_another_path() {
    let path = |seed| {
        let search = arthro_planning::paper::Search {
            seed,
            ..papers_search()
        };
        let planner = Planner::Paper(search);
        plan(&Request {
            planner,
            ..band_case()
        })
        .unwrap()
        .path
    };
    assert_eq!(path(1), path(1));
    assert_ne!(path(1), path(2));
}

#[test]
fn the_progress_grows_names_every_stage_and_tells_incumbent_and_bound() {
    let mut heard = Vec::new();
    plan::plan(&tear_case(), &|| Patience::GoOn, &mut |progress| {
        heard.push(progress)
    })
    .unwrap();
    assert!(
        heard
            .windows(2)
            .all(|pair| pair[0].fraction <= pair[1].fraction + 1e-9)
    );
    let mut stages: Vec<&str> = heard.iter().map(|progress| progress.stage).collect();
    stages.dedup();
    assert_eq!(stages, ["voxels", "contour", "bites", "evaluation"]);
    let incumbents: Vec<usize> = heard
        .iter()
        .filter_map(|progress| progress.incumbent)
        .collect();
    assert!(!incumbents.is_empty() && incumbents.windows(2).all(|pair| pair[0] >= pair[1]));
    assert!(heard.last().unwrap().bound.is_some());
}

#[test]
fn a_plan_can_be_stopped_at_every_stage() {
    for stage in ["voxels", "contour", "bites", "evaluation"] {
        let reached = AtomicBool::new(false);
        let patience = || match reached.load(Ordering::Relaxed) {
            true => Patience::Stop,
            false => Patience::GoOn,
        };
        let outcome = plan::plan(&tear_case(), &patience, &mut |progress| {
            reached.fetch_or(progress.stage == stage, Ordering::Relaxed);
        });
        assert_eq!(outcome.map(|_| ()), Err(Error::Cancelled), "{stage}");
    }
}

#[test]
fn a_hurried_search_ends_with_the_best_plan_it_has() {
    let asked = AtomicUsize::new(0);
    let found = AtomicBool::new(false);
    let patience = || {
        asked.fetch_add(1, Ordering::Relaxed);
        match found.load(Ordering::Relaxed) {
            true => Patience::Hurry,
            false => Patience::GoOn,
        }
    };
    let plan = plan::plan(&band_case(), &patience, &mut |progress| {
        found.fetch_or(progress.incumbent.is_some(), Ordering::Relaxed);
    })
    .unwrap();
    assert_eq!(plan.choice.unwrap().ended, Ended::Deadline);
    assert!(plan.evaluation.region_covered_percent >= 95.0);
    assert!(plan.evaluation.is_order_feasible());
}

#[test]
fn no_time_at_all_is_a_refusal_and_no_half_plan() {
    let outcome = plan::plan(&band_case(), &|| Patience::Hurry, &mut |_| {});
    assert_eq!(outcome.map(|_| ()), Err(Error::Deadline));
}

/// The field that a broken request is refused for.
fn refused_field(request: &Request) -> &'static str {
    match plan(request) {
        Err(Error::Invalid { field, .. }) => field,
        other => panic!("{other:?}"),
    }
}

fn with_ends(start: Point3, goal: Point3) -> Request {
    Request {
        aim: Aim::Ends { start, goal },
        ..papers_case()
    }
}

#[test]
fn places_that_do_not_fit_the_tissue_are_refused_by_name() {
    let off = Vector3::new(0.0, -6.0, 0.0);
    let request = with_ends(phantom::START + off, phantom::GOAL);
    assert_eq!(refused_field(&request), "options.start");

    let off = Vector3::new(4.0, 0.0, 0.0);
    let request = with_ends(phantom::START, phantom::GOAL + off);
    assert_eq!(refused_field(&request), "options.goal");

    let mut request = papers_case();
    request.target_box = Some((Point3::new(50.0, 40.0, 80.0), Point3::new(60.0, 70.0, 90.0)));
    assert_eq!(refused_field(&request), "options.target_box");

    let mut request = papers_case();
    request.portals = vec![Point3::new(56.0, 67.0, 50.0)];
    assert_eq!(refused_field(&request), "options.portal");

    let mut request = papers_case();
    request.portals.clear();
    assert_eq!(refused_field(&request), "options.portal");

    let mut request = tear_case();
    request.lesion.clear();
    assert_eq!(refused_field(&request), "lesion");
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
    let mut request = tear_case();
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
    let request = with_ends(phantom::START, phantom::GOAL + Vector3::new(0.0, 1.5, -1.5));
    match plan(&request) {
        Err(Error::RimBelowLimit {
            rim_mm, limit_mm, ..
        }) => assert!(rim_mm < limit_mm),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_cost_limit_that_no_path_keeps_is_refused_after_the_iterations_given() {
    let search = arthro_planning::paper::Search {
        cost_limit_per_mm: 0.01,
        max_iterations: 5_000,
        ..papers_search()
    };
    let planner = Planner::Paper(search);
    match plan(&Request {
        planner,
        ..band_case()
    }) {
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
    let shape = phantom::Phantom::default();
    let on_edge = |phi_deg: f64| {
        shape.point(phantom::Coordinates {
            phi_rad: phi_deg.to_radians(),
            width_fraction: 0.0,
            height_fraction: 0.5,
        })
    };
    let request = Request {
        lesion: Vec::new(),
        ..with_ends(on_edge(10.0), on_edge(-10.0))
    };
    assert!(matches!(plan(&request), Err(Error::NothingToRemove { .. })));
}

/// A box around the contour's ends that leaves out the body between them.
fn half_boxed() -> Request {
    let (low, high) = phantom::TARGET_BOX;
    Request {
        target_box: Some((low, Point3::new(high.x, 54.0, high.z))),
        ..band_case()
    }
}

#[test]
fn tissue_that_no_bite_reaches_is_refused_with_its_volume_and_place() {
    match plan(&half_boxed()) {
        Err(Error::UnreachableTissue {
            residual_mm3,
            allowed_mm3,
            at,
            ..
        }) => {
            assert!(residual_mm3 > allowed_mm3 && allowed_mm3 > 10.0);
            assert!(at.y > 54.0 && (42.0..58.0).contains(&at.z), "{at}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_partial_plan_comes_only_when_asked_for_and_says_so() {
    let mut request = half_boxed();
    request.limits.partial = Partial::Allow;
    let partial = plan(&request).unwrap();
    assert!(!partial.choice.unwrap().complete);
    assert!(partial.evaluation.region_covered_percent < 95.0);
    assert!(partial.evaluation.region_covered_percent > 20.0);
    assert!(partial.evaluation.is_order_feasible());
}

#[test]
fn an_outside_limit_of_nothing_is_refused_with_what_the_closest_bites_leave_and_take() {
    let mut request = band_case();
    request.limits.outside_limit_mm3 = Some(0.0);
    request.limits.region_percent = 99.5;
    match plan(&request) {
        Err(Error::RegionNotCleared {
            residual_mm3,
            allowed_mm3,
            outside_mm3,
            outside_limit_mm3,
            ..
        }) => assert!(residual_mm3 > allowed_mm3 || outside_mm3 > outside_limit_mm3),
        Err(Error::UnreachableTissue { .. }) => {}
        other => panic!("{other:?}"),
    }
}
