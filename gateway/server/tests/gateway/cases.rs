//! Cases: what each stage needs, keeps and voids.

use arthro_gateway::config::Config;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::CaseState;
use arthro_proto::registration::v1 as registration;
use tonic::{Code, Status};

use super::bench::{Bench, reason};

#[tokio::test(flavor = "multi_thread")]
async fn a_case_goes_from_uploads_to_an_approved_plan() {
    let mut bench = Bench::new().await;
    let case_id = bench.case().await;
    bench.upload(&case_id).await;
    let case = bench.get(&case_id).await.case.unwrap();
    assert_eq!(case.state(), CaseState::Ready);
    assert_eq!(case.model_digest.len(), 64);

    let events = bench.register(&case_id).await;
    assert_eq!(events.len(), 2);
    assert!(*bench.world.source_points.borrow() >= 100);
    let described = bench.get(&case_id).await;
    assert_eq!(described.case.unwrap().state(), CaseState::Registered);
    // The residuals are kept too.
    assert_eq!(
        described.registration.unwrap().residuals_mm.as_ref(),
        [1, 2, 3, 4]
    );

    let accepted = bench.accept(&case_id).await.unwrap();
    assert_eq!(accepted.state(), CaseState::Accepted);
    bench.plan(&case_id).await.unwrap();
    let case = bench.get(&case_id).await.case.unwrap();
    assert_eq!(case.state(), CaseState::Planned);
    let approved = bench.approve(&case_id, &case.plan_digest).await.unwrap();
    assert_eq!(approved.state(), CaseState::Approved);
    assert_eq!(approved.approved_by, "surgeon");
    assert_eq!(approved.approved_digest, case.plan_digest);

    let listed = bench
        .cases
        .list_cases(proto::ListCasesRequest::default())
        .await
        .unwrap();
    assert_eq!(listed.into_inner().cases, [approved]);
}

#[tokio::test(flavor = "multi_thread")]
async fn cases_are_listed_page_by_page() {
    let mut bench = Bench::new().await;
    let mut created = Vec::new();
    for _ in 0..5 {
        created.push(bench.case().await);
    }
    created.reverse();
    let mut listed = Vec::new();
    let mut page_token = String::new();
    loop {
        let page = cases_page(&mut bench, 2, page_token).await.unwrap();
        assert!(page.cases.len() <= 2);
        listed.extend(page.cases.into_iter().map(|case| case.case_id));
        page_token = page.next_page_token;
        if page_token.is_empty() {
            break;
        }
    }
    assert_eq!(listed, created);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_page_that_cannot_be_is_refused() {
    let mut bench = Bench::new().await;
    let too_large = cases_page(&mut bench, 1001, String::new()).await;
    assert_eq!(
        too_large.unwrap_err().message(),
        "page_size: is 1001; must be within 1 .. 1000, or 0 for 100"
    );
    let unknown = cases_page(&mut bench, 0, "no case".to_owned()).await;
    assert_eq!(
        unknown.unwrap_err().message(),
        "page_token: is \"no case\"; must be the next_page_token of an answer, or empty"
    );
    let request = proto::ListProceduresRequest {
        page_size: 0,
        page_token: "no procedure".to_owned(),
    };
    let unknown = bench.procedures.list_procedures(request).await;
    assert_eq!(
        unknown.unwrap_err().message(),
        "page_token: is \"no procedure\"; must be the next_page_token of an answer, or empty"
    );
}

async fn cases_page(
    bench: &mut Bench,
    page_size: u32,
    page_token: String,
) -> Result<proto::ListCasesResponse, Status> {
    let request = proto::ListCasesRequest {
        page_size,
        page_token,
    };
    Ok(bench.cases.list_cases(request).await?.into_inner())
}

#[tokio::test(flavor = "multi_thread")]
async fn another_scene_voids_everything_behind_it() {
    let mut bench = Bench::new().await;
    let (case_id, _) = bench.approved().await;
    bench.upload(&case_id).await;
    let described = bench.get(&case_id).await;
    assert_eq!(described.case.unwrap().state(), CaseState::Ready);
    assert!(described.registration.is_none() && described.plan.is_none());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_rejected_registration_is_not_accepted() {
    let mut bench = Bench::new().await;
    *bench.world.verdict.lock().unwrap() = registration::Verdict::Reject;
    let case_id = bench.case().await;
    bench.upload(&case_id).await;
    bench.register(&case_id).await;
    let accepted = bench.accept(&case_id).await;
    assert_eq!(reason(accepted), "REGISTRATION_REJECTED");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_plan_needs_an_accepted_registration() {
    let mut bench = Bench::new().await;
    let case_id = bench.case().await;
    bench.upload(&case_id).await;
    assert_eq!(reason(bench.plan(&case_id).await), "NOT_REGISTERED");
    bench.register(&case_id).await;
    assert_eq!(
        reason(bench.plan(&case_id).await),
        "REGISTRATION_NOT_ACCEPTED"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_plan_needs_a_calibrated_cell() {
    let mut bench = Bench::with(|config: &mut Config| config.calibration = None).await;
    let case_id = bench.case().await;
    bench.upload(&case_id).await;
    bench.register(&case_id).await;
    bench.accept(&case_id).await.unwrap();
    assert_eq!(reason(bench.plan(&case_id).await), "NOT_CALIBRATED");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_digest_that_was_not_seen_is_not_approved() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.planned().await;
    let other = format!(
        "{}{}",
        &digest[..63],
        if digest.ends_with('0') { '1' } else { '0' }
    );
    let approved = bench.approve(&case_id, &other).await;
    assert_eq!(reason(approved), "DIGEST_MISMATCH");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_depth_image_becomes_a_scene() {
    use proto::upload_scene_request::Payload;
    let mut bench = Bench::new().await;
    let case_id = bench.case().await;
    let header = proto::SceneHeader {
        case_id,
        scene: Some(proto::scene_header::Scene::Depth(
            registration::DepthHeader {
                intrinsics: Some(registration::Intrinsics {
                    width_px: 20,
                    height_px: 10,
                    fx_px: 20.0,
                    fy_px: 20.0,
                    cx_px: 10.0,
                    cy_px: 5.0,
                    distortion: None,
                }),
                depth_unit_mm: 0.1,
                has_mask: true,
                ..Default::default()
            },
        )),
    };
    let messages = [
        Payload::Header(header),
        Payload::Depth(vec![1; 400].into()),
        Payload::Mask(vec![1; 200].into()),
    ]
    .map(|payload| proto::UploadSceneRequest {
        payload: Some(payload),
    });
    let answer = bench
        .cases
        .upload_scene(tokio_stream::iter(messages))
        .await
        .unwrap()
        .into_inner();
    assert_eq!(answer.point_count, 200);
    assert_eq!(answer.case.unwrap().scene_digest.len(), 64);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_scene_of_several_frames_is_taken_whole_and_one_of_several_viewpoints_is_refused() {
    use proto::upload_scene_request::Payload;
    let mut bench = Bench::new().await;
    let case_id = bench.case().await;
    let header = registration::DepthHeader {
        intrinsics: Some(registration::Intrinsics {
            width_px: 20,
            height_px: 10,
            ..Default::default()
        }),
        frame_count: 3,
        ..Default::default()
    };
    let upload = |header, depth_bytes| {
        let header = proto::SceneHeader {
            case_id: case_id.clone(),
            scene: Some(proto::scene_header::Scene::Depth(header)),
        };
        let messages = [
            Payload::Header(header),
            Payload::Depth(vec![1; depth_bytes].into()),
        ]
        .map(|payload| proto::UploadSceneRequest {
            payload: Some(payload),
        });
        let mut cases = bench.cases.clone();
        async move { cases.upload_scene(tokio_stream::iter(messages)).await }
    };
    upload(header.clone(), 1200).await.unwrap();
    let short = upload(header.clone(), 400).await.unwrap_err();
    assert!(short.message().contains("1200"), "{short}");
    let endless = registration::DepthHeader {
        frame_count: u32::MAX,
        ..header.clone()
    };
    let refusal = upload(endless, 0).await.unwrap_err();
    assert!(refusal.message().contains("header.depth.frame_count"));
    let views = registration::DepthHeader {
        views: vec![registration::DepthView::default(); 2],
        ..header
    };
    let refusal = upload(views, 1200).await.unwrap_err();
    assert!(
        refusal
            .message()
            .contains("header.depth.views: has 2 viewpoints; must have none"),
        "{refusal}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_that_is_away_is_named() {
    // Bound and never served: a connection to it fails once it is dropped.
    let closed = std::net::TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .to_string();
    let mut bench = Bench::with(|config: &mut Config| config.planning = closed.into()).await;
    let case_id = bench.case().await;
    bench.upload(&case_id).await;
    bench.register(&case_id).await;
    bench.accept(&case_id).await.unwrap();
    let refusal = bench.plan(&case_id).await.unwrap_err();
    assert_eq!(refusal.code(), Code::Unavailable);
    assert_eq!(reason::<()>(Err(refusal)), "PLANNING_UNAVAILABLE");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_revised_bite_has_to_come_from_the_portal() {
    let mut bench = Bench::new().await;
    let (case_id, _) = bench.planned().await;
    let mut bites = bench.get(&case_id).await.plan.unwrap().bites;
    let bite = &mut bites[1];
    (bite.approach, bite.opening) = (bite.opening, bite.approach);
    let revised = bench
        .cases
        .revise_plan(proto::RevisePlanRequest { case_id, bites })
        .await;
    let violations = arthro_bootstrap::status::violations(&revised.unwrap_err());
    assert_eq!(violations[0].0, "bites[1].approach");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_revised_plan_keeps_its_bites_over_a_read() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.planned().await;
    let mut bites = bench.get(&case_id).await.plan.unwrap().bites;
    bites.swap(0, 2);
    let request = proto::RevisePlanRequest {
        case_id: case_id.clone(),
        bites: bites.clone(),
    };
    let revised = bench.cases.revise_plan(request).await.unwrap().into_inner();
    assert_ne!(revised.case.as_ref().unwrap().plan_digest, digest);
    let described = bench.get(&case_id).await;
    assert_eq!(described.plan.unwrap().bites, bites);
    assert_eq!(
        described.case.unwrap().plan_digest,
        revised.case.unwrap().plan_digest
    );
}
