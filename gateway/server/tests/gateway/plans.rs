//! Plans of a case: what planning is asked, what is kept of its answer, and what is refused.

use arthro_bootstrap::status::violations;
use arthro_gateway::config::Config;
use arthro_gateway::wire;
use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::{Rotation, Similarity};
use arthro_proto::common::v1 as common;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::planning::v1 as planning;
use tonic::Code;

use super::bench::{Bench, calibration, plan_request};
use super::fakes::computing::CAMERA_FROM_CT_MM;

/// A case whose registration was accepted.
async fn accepted(bench: &mut Bench) -> String {
    let case_id = bench.case().await;
    bench.upload(&case_id).await;
    bench.register(&case_id).await;
    bench.accept(&case_id).await.unwrap();
    case_id
}

/// What planning is asked for a request that only names the case and what `edit` says.
async fn asked(edit: impl FnOnce(&mut proto::PlanCaseRequest)) -> planning::PlanResectionOptions {
    let mut bench = Bench::new().await;
    let mut request = proto::PlanCaseRequest {
        case_id: accepted(&mut bench).await,
        ..proto::PlanCaseRequest::default()
    };
    edit(&mut request);
    let mut events = bench.cases.plan_case(request).await.unwrap().into_inner();
    while events.message().await.unwrap().is_some() {}
    let options = bench.world.plan_options.lock().unwrap().take();
    options.expect("planning was asked")
}

#[tokio::test(flavor = "multi_thread")]
async fn without_ends_the_contour_is_left_to_the_planner() {
    let options = asked(|_| ()).await;
    assert!(options.start.is_none() && options.goal.is_none() && options.contour.is_empty());
    assert!(options.target_box.is_none());
    assert_eq!(options.lesion_spacing_mm, 0.5);
    assert_eq!(options.jaw.unwrap().throat_mm, Some(1.0));
}

#[tokio::test(flavor = "multi_thread")]
async fn what_the_planner_understands_is_passed_on() {
    let drawn = common::Point {
        x_mm: 53.0,
        ..common::Point::default()
    };
    let options = asked(|request| {
        request.contour = vec![drawn; 4];
        request.planner = planning::Planner::Paper.into();
        request.paper_cost = planning::PaperCost::AsPrinted.into();
        request.allow_partial = true;
        request.effort = 7;
        request.region_percent = 97.0;
        request.outside_limit_mm3 = Some(0.0);
        request.placement_error_mm = Some(0.5);
        request.jaw = Some(planning::Jaw {
            width_mm: 2.0,
            length_mm: 4.0,
            throat_mm: Some(1.5),
        });
    })
    .await;
    let expected = planning::PlanResectionOptions {
        contour: vec![drawn; 4],
        planner: planning::Planner::Paper.into(),
        paper_cost: planning::PaperCost::AsPrinted.into(),
        allow_partial: true,
        effort: 7,
        region_percent: 97.0,
        outside_limit_mm3: Some(0.0),
        placement_error_mm: Some(0.5),
        jaw: Some(planning::Jaw {
            width_mm: 2.0,
            length_mm: 4.0,
            throat_mm: Some(1.5),
        }),
        // From the case and the cell.
        model: options.model,
        lesion: options.lesion,
        lesion_spacing_mm: options.lesion_spacing_mm,
        portal: options.portal,
        arthroscope: options.arthroscope,
        ..planning::PlanResectionOptions::default()
    };
    assert_eq!(options, expected);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_arthroscope_watches_through_its_portal_as_the_model_has_it() {
    let options = asked(|_| ()).await;
    let portal = options.arthroscope.unwrap().portal.unwrap();
    let cell = Config {
        calibration: Some(calibration()),
        ..Config::default()
    };
    let cell = cell.cell().unwrap().unwrap();
    let base_from_ct = Similarity::from(cell.forceps_base_from_camera)
        * Similarity::<Camera, Ct>::new(1.0, Rotation::identity(), CAMERA_FROM_CT_MM.into());
    let there = base_from_ct * wire::point(Some(portal), "portal").unwrap();
    let drawn = cell.forceps_base_from_arthroscope_base * cell.arthroscope_portal;
    assert!((there - drawn).norm() < 1e-9, "{there} {drawn}");
    let off = asked(|request| request.views = proto::ViewPlanning::Off.into());
    assert!(off.await.arthroscope.is_none());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_plan_keeps_its_views_and_a_revision_those_of_its_bites() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.planned().await;
    let plan = bench.get(&case_id).await.plan.unwrap();
    assert_eq!(plan.views.len(), plan.bites.len());

    let mut bites = plan.bites.clone();
    bites.swap(0, 2);
    let mut revise = async |bites: &[planning::Bite]| {
        let request = proto::RevisePlanRequest {
            case_id: case_id.clone(),
            bites: bites.to_vec(),
        };
        bench.cases.revise_plan(request).await.unwrap();
        bench.get(&case_id).await
    };
    let swapped = revise(&bites).await;
    let mut views = plan.views.clone();
    views.swap(0, 2);
    assert_eq!(swapped.plan.unwrap().views, views);
    assert_ne!(swapped.case.unwrap().plan_digest, digest);

    bites[1].contour_point = bites[0].center;
    let moved = revise(&bites).await;
    assert!(moved.plan.unwrap().views.is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_bite_through_a_portal_that_the_cell_does_not_have_is_refused() {
    let mut bench = Bench::new().await;
    let (case_id, _) = bench.planned().await;
    let mut bites = bench.get(&case_id).await.plan.unwrap().bites;
    bites[1].portal = 1;
    let request = proto::RevisePlanRequest { case_id, bites };
    let refusal = bench.cases.revise_plan(request).await.unwrap_err();
    assert_eq!(
        violations(&refusal),
        [(
            "bites[1].portal".to_owned(),
            "is 1; the cell has one forceps portal, 0".to_owned()
        )]
    );

    let case_id = accepted(&mut bench).await;
    *bench.world.last_bites_portal.lock().unwrap() = 3;
    let refusal = bench.plan(&case_id).await.unwrap_err();
    assert!(refusal.message().contains("bites[2].portal"), "{refusal}");
    assert!(bench.get(&case_id).await.plan.is_none());
}

#[tokio::test(flavor = "multi_thread")]
async fn what_planning_refuses_is_named_as_it_was_asked() {
    let mut bench = Bench::new().await;
    let request = proto::PlanCaseRequest {
        case_id: accepted(&mut bench).await,
        region_percent: 200.0,
        ..proto::PlanCaseRequest::default()
    };
    let mut events = bench.cases.plan_case(request).await.unwrap().into_inner();
    let refusal = loop {
        match events.message().await {
            Ok(Some(_)) => {}
            Ok(None) => panic!("it was planned"),
            Err(refusal) => break refusal,
        }
    };
    assert_eq!(refusal.code(), Code::InvalidArgument);
    assert_eq!(
        violations(&refusal),
        [(
            "region_percent".to_owned(),
            "is 200; must be 50 .. 100".to_owned()
        )]
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_start_without_a_goal_is_named() {
    let mut bench = Bench::new().await;
    let request = proto::PlanCaseRequest {
        goal: None,
        ..plan_request("some case")
    };
    let refusal = bench.cases.plan_case(request).await.unwrap_err();
    assert_eq!(
        violations(&refusal),
        [("goal".to_owned(), "is missing beside start".to_owned())]
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn an_inverted_target_box_is_named() {
    let mut bench = Bench::new().await;
    let mut request = plan_request("some case");
    let target_box = request.target_box.as_mut().unwrap();
    target_box.min = Some(common::Point {
        x_mm: 70.0,
        ..target_box.min.unwrap()
    });
    let refusal = bench.cases.plan_case(request).await.unwrap_err();
    assert_eq!(
        violations(&refusal),
        [(
            "target_box.min.x_mm".to_owned(),
            "is 70; must be below max, 60".to_owned()
        )]
    );
}
