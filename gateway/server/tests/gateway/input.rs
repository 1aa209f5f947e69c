//! Bad input: refused with field, value and limit, and nothing kept.

use arthro_bootstrap::status::violations;
use arthro_proto::common::v1 as common;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::upload_model_request::Payload as ModelPayload;
use arthro_proto::gateway::v1::upload_scene_request::Payload as ScenePayload;
use tonic::{Code, Status};

use super::bench::{Bench, model, packed, reason, scene};

/// The violations of uploading `messages` as the scene of a new case.
async fn scene_refused(
    edit: impl FnOnce(&mut Vec<proto::UploadSceneRequest>),
) -> Vec<(String, String)> {
    let mut bench = Bench::new().await;
    let case_id = bench.case().await;
    let mut messages = scene(&case_id);
    edit(&mut messages);
    let refusal = bench
        .cases
        .upload_scene(tokio_stream::iter(messages))
        .await
        .unwrap_err();
    assert_eq!(refusal.code(), Code::InvalidArgument, "{refusal:?}");
    let case = bench.get(&case_id).await.case.unwrap();
    assert!(case.scene_digest.is_empty(), "nothing was kept");
    violations(&refusal)
}

/// The same for the model.
async fn model_refused(
    edit: impl FnOnce(&mut Vec<proto::UploadModelRequest>),
) -> Vec<(String, String)> {
    let mut bench = Bench::new().await;
    let case_id = bench.case().await;
    let mut messages = model(&case_id);
    edit(&mut messages);
    let refusal = bench
        .cases
        .upload_model(tokio_stream::iter(messages))
        .await
        .unwrap_err();
    assert_eq!(refusal.code(), Code::InvalidArgument, "{refusal:?}");
    let case = bench.get(&case_id).await.case.unwrap();
    assert!(case.model_digest.is_empty(), "nothing was kept");
    violations(&refusal)
}

fn scene_header(messages: &mut [proto::UploadSceneRequest]) -> &mut common::CloudHeader {
    match &mut messages[0].payload {
        Some(ScenePayload::Header(header)) => match &mut header.scene {
            Some(proto::scene_header::Scene::Cloud(cloud)) => cloud,
            _ => panic!("the scene is a cloud"),
        },
        _ => panic!("the header comes first"),
    }
}

fn model_header(messages: &mut [proto::UploadModelRequest]) -> &mut proto::ModelHeader {
    match &mut messages[0].payload {
        Some(ModelPayload::Header(header)) => header,
        _ => panic!("the header comes first"),
    }
}

fn violation(field: &str, description: &str) -> Vec<(String, String)> {
    vec![(field.to_owned(), description.to_owned())]
}

#[tokio::test(flavor = "multi_thread")]
async fn a_cloud_of_ten_million_points_is_refused_from_its_header() {
    let refused = scene_refused(|messages| {
        scene_header(messages).point_count = 10_000_000;
        messages.truncate(1);
    });
    assert_eq!(
        refused.await,
        violation(
            "header.cloud.point_count",
            "is 10000000; must be within 100 .. 2000000"
        )
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_cloud_of_three_points_is_refused() {
    let refused = scene_refused(|messages| scene_header(messages).point_count = 3);
    assert_eq!(
        refused.await,
        violation(
            "header.cloud.point_count",
            "is 3; must be within 100 .. 2000000"
        )
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn an_empty_upload_is_refused() {
    let refused = scene_refused(Vec::clear);
    assert_eq!(
        refused.await,
        violation("header", "is missing; it must be the first message")
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_cloud_with_a_nan_is_refused() {
    let refused = scene_refused(|messages| {
        let mut values = vec![1.0; 600];
        values[301] = f32::NAN;
        messages[1].payload = Some(ScenePayload::Points(packed(&values).into()));
    });
    assert_eq!(
        refused.await,
        violation("points[100]", "holds NaN; must be finite")
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_cloud_in_metres_is_refused() {
    let refused = scene_refused(|messages| {
        let values: Vec<f32> = (0..600).map(|index| index as f32 * 1e-4).collect();
        messages[1].payload = Some(ScenePayload::Points(packed(&values).into()));
    })
    .await;
    assert_eq!(refused[0].0, "points");
    assert!(refused[0].1.ends_with("are these metres?"), "{refused:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn fewer_points_than_announced_are_refused() {
    let refused = scene_refused(|messages| scene_header(messages).point_count = 201);
    assert_eq!(
        refused.await,
        violation("points", "holds 2400 bytes; the header announced 2412")
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_model_in_the_cameras_frame_is_refused() {
    let refused = model_refused(|messages| {
        let mesh = model_header(messages).mesh.as_mut().unwrap();
        mesh.frame = common::Frame::Camera.into();
    });
    assert_eq!(
        refused.await,
        violation("header.mesh.frame", "is FRAME_CAMERA; must be FRAME_CT")
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn every_violation_of_a_header_is_named_at_once() {
    let refused = model_refused(|messages| {
        let header = model_header(messages);
        header.lesion_spacing_mm = f64::NAN;
        header.mesh.as_mut().unwrap().triangle_count = 500_001;
    })
    .await;
    let fields: Vec<_> = refused.iter().map(|(field, _)| field.as_str()).collect();
    assert_eq!(
        fields,
        ["header.mesh.triangle_count", "header.lesion_spacing_mm"]
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn an_unknown_case_is_not_found() {
    let mut bench = Bench::new().await;
    let refusals: Vec<Status> = vec![
        bench
            .cases
            .get_case(proto::GetCaseRequest {
                case_id: "nobody".to_owned(),
            })
            .await
            .unwrap_err(),
        bench
            .cases
            .upload_model(tokio_stream::iter(model("nobody")))
            .await
            .unwrap_err(),
        bench.accept("nobody").await.unwrap_err(),
        bench.start("nobody", &"0".repeat(64)).await.unwrap_err(),
    ];
    for refusal in refusals {
        assert_eq!(refusal.code(), Code::NotFound, "{refusal:?}");
        assert_eq!(reason::<()>(Err(refusal)), "UNKNOWN_CASE");
    }
    let recovered = bench
        .recover("nobody", proto::RecoveryAction::Withdraw)
        .await
        .unwrap_err();
    assert_eq!(recovered.code(), Code::NotFound);
}

#[tokio::test(flavor = "multi_thread")]
async fn empty_texts_are_named() {
    let mut bench = Bench::new().await;
    let refusal = bench
        .cases
        .create_case(proto::CreateCaseRequest {
            label: "  ".to_owned(),
        })
        .await
        .unwrap_err();
    assert_eq!(
        violations(&refusal),
        violation("label", "is empty; must have 1 to 200 characters")
    );
    let refusal = bench
        .procedures
        .start_procedure(proto::StartProcedureRequest::default())
        .await
        .unwrap_err();
    let fields: Vec<_> = violations(&refusal)
        .into_iter()
        .map(|(field, _)| field)
        .collect();
    assert_eq!(fields, ["case_id", "plan_digest", "operator"]);
}
