//! The server over a real connection: a good client, and bad ones.

use arthro_bootstrap::{Host, Service as _};
use arthro_proto::common::v1::{CloudHeader, Frame};
use arthro_proto::registration::v1 as api;
use arthro_proto::registration::v1::register_request::Payload;
use arthro_proto::registration::v1::register_response::Event;
use arthro_proto::registration::v1::registration_service_client::RegistrationServiceClient;
use arthro_registration::{Config, Server};
use tokio::net::TcpListener;
use tonic::transport::server::TcpIncoming;
use tonic::transport::{Channel, server};
use tonic::{Code, Status};

use crate::world::{crescent, seen};

/// A server on a free port, ended with its runtime.
pub async fn client() -> RegistrationServiceClient<Channel> {
    client_of(Config::default()).await
}

async fn client_of(config: Config) -> RegistrationServiceClient<Channel> {
    let routes = Server::build(config, Host::alone()).await.unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(
        server::Server::builder()
            .add_routes(routes)
            .serve_with_incoming(TcpIncoming::from(listener).with_nodelay(Some(true))),
    );
    RegistrationServiceClient::connect(format!("http://{address}"))
        .await
        .unwrap()
}

fn header(frame: Frame, count: usize) -> CloudHeader {
    CloudHeader {
        frame: frame.into(),
        point_count: count as u32,
        has_normals: false,
    }
}

fn options(source: usize, target: usize) -> api::RegisterOptions {
    api::RegisterOptions {
        source: Some(header(Frame::Ct, source)),
        target: Some(header(Frame::Camera, target)),
        ..Default::default()
    }
}

fn packed(points: &[arthro_geometry::Point3]) -> Vec<u8> {
    points
        .iter()
        .flat_map(|p| [p.x, p.y, p.z])
        .flat_map(|c| (c as f32).to_le_bytes())
        .collect()
}

fn requests(
    payloads: Vec<Payload>,
) -> impl tonic::IntoStreamingRequest<Message = api::RegisterRequest> {
    let messages = payloads.into_iter().map(|payload| api::RegisterRequest {
        payload: Some(payload),
    });
    tokio_stream::iter(messages.collect::<Vec<_>>())
}

async fn refusal(payloads: Vec<Payload>) -> Status {
    match client().await.register(requests(payloads)).await {
        Err(status) => status,
        Ok(stream) => {
            let mut stream = stream.into_inner();
            loop {
                match stream.message().await {
                    Err(status) => return status,
                    Ok(message) => assert!(message.is_some(), "was not refused"),
                }
            }
        }
    }
}

/// The crescent as the camera sees it from the origin of its frame.
fn view() -> Vec<arthro_geometry::Point3> {
    let shift = arthro_geometry::Vector3::new(40.0, -30.0, 150.0);
    let points = seen(&crescent().points, shift.into(), 0.6, || 0.0).points;
    points.into_iter().map(|p| p - shift).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_registration_streams_its_stages_and_ends_in_one_result() {
    let (source, target) = (crescent().points, view());
    let mut payloads = vec![Payload::Options(options(source.len(), target.len()))];
    payloads.extend(
        packed(&source)
            .chunks(5001)
            .map(|c| Payload::Source(c.to_vec().into())),
    );
    payloads.extend(
        packed(&target)
            .chunks(4999)
            .map(|c| Payload::Target(c.to_vec().into())),
    );
    let mut stream = client()
        .await
        .register(requests(payloads))
        .await
        .unwrap()
        .into_inner();
    let mut events = Vec::new();
    while let Some(message) = stream.message().await.unwrap() {
        events.push(message.event.unwrap());
    }
    let stages: Vec<i32> = events
        .iter()
        .filter_map(|event| match event {
            Event::Stage(started) => Some(started.stage),
            _ => None,
        })
        .collect();
    assert_eq!(stages, [api::Stage::Coarse as i32, api::Stage::Fine as i32]);
    assert!(
        events
            .iter()
            .any(|event| matches!(event, Event::Candidate(_)))
    );
    assert!(
        events
            .iter()
            .any(|event| matches!(event, Event::Iteration(_)))
    );
    let results = events
        .iter()
        .filter(|event| matches!(event, Event::Result(_)))
        .count();
    let Some(Event::Result(result)) = events.last() else {
        panic!("the last event is no result");
    };
    assert_eq!(results, 1);
    assert_eq!(
        result.verdict(),
        api::Verdict::Accept,
        "{:?}",
        result.reasons
    );
    assert_eq!(result.residuals_mm.len(), 4 * target.len());
    let translation = result.camera_from_ct.as_ref().unwrap().translation.unwrap();
    assert!((translation.z_mm + 150.0).abs() < 0.5, "{translation:?}");
}

#[tokio::test]
async fn bad_input_is_refused_by_field_value_and_limit() {
    let good = || Payload::Source(packed(&crescent().points).into());
    let cases: [(Vec<Payload>, &str); 9] = [
        (vec![good()], "options: must come in the first message"),
        (
            vec![Payload::Options(options(0, 500))],
            "options.source.point_count: is empty",
        ),
        (
            vec![Payload::Options(options(500, 3))],
            "has 3 points, must have at least 100",
        ),
        (
            vec![Payload::Options(options(10_000_000, 500))],
            "has 10000000 points, must have at most 2000000",
        ),
        (
            vec![Payload::Options(api::RegisterOptions {
                target: Some(header(Frame::Ct, 500)),
                ..options(500, 500)
            })],
            "options.target.frame: is FRAME_CT, must be FRAME_CAMERA or FRAME_BASE",
        ),
        (
            vec![Payload::Options(api::RegisterOptions {
                scale_tolerance: 0.9,
                scale_prior: -1.0,
                ..options(500, 500)
            })],
            "options.scale_tolerance: is 0.9, must be 0 to 0.5; options.scale_prior: is -1, must be 0.01 to 100",
        ),
        (
            vec![
                Payload::Options(options(100, 100)),
                Payload::Source(vec![0; 1201].into()),
            ],
            "source: 1201 bytes came, 1200 are announced",
        ),
        (
            vec![
                Payload::Options(options(100, 100)),
                Payload::Source(vec![0; 1199].into()),
            ],
            "source: ended after 1199 bytes, 1200 are announced",
        ),
        (
            vec![
                Payload::Options(options(crescent().points.len(), 100)),
                good(),
                Payload::Target(f32::NAN.to_le_bytes().repeat(300).into()),
            ],
            "target[0]: is (NaN, NaN, NaN), must be finite",
        ),
    ];
    for (payloads, expected) in cases {
        let status = refusal(payloads).await;
        assert_eq!(status.code(), Code::InvalidArgument, "{expected}: {status}");
        assert!(
            status.message().contains(expected),
            "{} lacks {expected}",
            status.message()
        );
        assert!(!status.details().is_empty());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_goes_frees_its_computation() {
    let mut client = client_of(Config {
        max_computations: 1,
    })
    .await;
    let (source, target) = (crescent().points, view());
    let payloads = || {
        vec![
            Payload::Options(options(source.len(), target.len())),
            Payload::Source(packed(&source).into()),
            Payload::Target(packed(&target).into()),
        ]
    };
    let mut first = client
        .register(requests(payloads()))
        .await
        .unwrap()
        .into_inner();
    first.message().await.unwrap();
    let busy = client.register(requests(payloads())).await.unwrap_err();
    assert_eq!(busy.code(), Code::ResourceExhausted);
    drop(first);
    let freed = async {
        while client.register(requests(payloads())).await.is_err() {
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(std::time::Duration::from_secs(60), freed)
        .await
        .unwrap();
}

#[tokio::test]
async fn a_depth_image_comes_back_as_a_cloud_in_the_camera_frame() {
    use arthro_proto::registration::v1::deproject_depth_request::Payload;
    use arthro_proto::registration::v1::deproject_depth_response::Payload as Answer;
    let intrinsics = api::Intrinsics {
        width_px: 300,
        height_px: 100,
        fx_px: 400.0,
        fy_px: 400.0,
        cx_px: 149.5,
        cy_px: 49.5,
        distortion: None,
    };
    let header = api::DepthHeader {
        intrinsics: Some(intrinsics),
        depth_unit_mm: 0.1,
        has_mask: true,
        ..Default::default()
    };
    let depth: Vec<u8> = 2000u16.to_le_bytes().repeat(30_000);
    let mut mask = vec![1u8; 30_000];
    mask[..10_000].fill(0);
    let ask = |payloads: Vec<Payload>| {
        let messages = payloads
            .into_iter()
            .map(|payload| api::DeprojectDepthRequest {
                payload: Some(payload),
            });
        tokio_stream::iter(messages.collect::<Vec<_>>())
    };
    let mut payloads = vec![Payload::Header(header.clone())];
    payloads.extend(
        depth
            .chunks(7777)
            .map(|c| Payload::Depth(c.to_vec().into())),
    );
    payloads.push(Payload::Mask(mask.into()));
    let mut client = client().await;
    let mut stream = client
        .deproject_depth(ask(payloads))
        .await
        .unwrap()
        .into_inner();
    let Some(Answer::Header(cloud)) = stream.message().await.unwrap().unwrap().payload else {
        panic!("no header");
    };
    assert_eq!(
        (cloud.point_count, cloud.has_normals, cloud.frame()),
        (20_000, true, Frame::Camera)
    );
    let mut bytes = 0;
    while let Some(message) = stream.message().await.unwrap() {
        let Some(Answer::Points(points)) = message.payload else {
            panic!("no points");
        };
        assert!(points.len() <= 256 * 1024);
        bytes += points.len();
    }
    assert_eq!(bytes, 20_000 * 24);

    let status = client
        .deproject_depth(ask(vec![Payload::Header(api::DepthHeader {
            depth_unit_mm: 0.0,
            ..header
        })]))
        .await
        .unwrap_err();
    assert!(
        status.message().contains("header.depth_unit_mm: is 0"),
        "{}",
        status.message()
    );
}
