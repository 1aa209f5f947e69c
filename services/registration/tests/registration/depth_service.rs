//! `DeprojectDepth` over a real connection: what may be asked for beside the image, and what is refused.

use arthro_proto::common::v1::{CloudHeader, Frame, Point, Pose, Quaternion};
use arthro_proto::registration::v1 as api;
use arthro_proto::registration::v1::deproject_depth_request::Payload;
use arthro_proto::registration::v1::deproject_depth_response::Payload as Answer;
use arthro_registration::depth::distortion::Distortion;
use tonic::{Code, Status};

use crate::depth_scene::{INTRINSICS, Knee, UNIT_MM, noisy, render};
use crate::service::client;

#[derive(Default)]
struct Received {
    header: CloudHeader,
    /// Position and normal.
    points: Vec<[f32; 6]>,
    /// Sigmas, view, pixel.
    details: Vec<([f32; 2], [u32; 2])>,
    report: Option<api::DepthReport>,
}

async fn ask(payloads: Vec<Payload>) -> Result<Received, Status> {
    let messages: Vec<_> = payloads
        .into_iter()
        .map(|payload| api::DeprojectDepthRequest {
            payload: Some(payload),
        })
        .collect();
    let mut stream = client()
        .await
        .deproject_depth(tokio_stream::iter(messages))
        .await?
        .into_inner();
    let mut received = Received::default();
    while let Some(message) = stream.message().await? {
        let word = |bytes: &[u8], at: usize| [0, 1, 2, 3].map(|i| bytes[4 * at + i]);
        match message.payload.unwrap() {
            Answer::Header(header) => received.header = header,
            Answer::Points(bytes) => {
                assert!(received.details.is_empty() && bytes.len() <= 256 * 1024);
                let packed = bytes.chunks_exact(24);
                received.points.extend(
                    packed.map(|point| {
                        [0, 1, 2, 3, 4, 5].map(|at| f32::from_le_bytes(word(point, at)))
                    }),
                );
            }
            Answer::Details(bytes) => {
                assert!(bytes.len() <= 256 * 1024);
                received
                    .details
                    .extend(bytes.chunks_exact(16).map(|details| {
                        (
                            [0, 1].map(|at| f32::from_le_bytes(word(details, at))),
                            [2, 3].map(|at| u32::from_le_bytes(word(details, at))),
                        )
                    }));
            }
            Answer::Report(report) => assert!(received.report.replace(report).is_none()),
        }
    }
    Ok(received)
}

fn header() -> api::DepthHeader {
    api::DepthHeader {
        intrinsics: Some(api::Intrinsics {
            width_px: INTRINSICS.width_px,
            height_px: INTRINSICS.height_px,
            fx_px: INTRINSICS.fx_px,
            fy_px: INTRINSICS.fy_px,
            cx_px: INTRINSICS.cx_px,
            cy_px: INTRINSICS.cy_px,
            distortion: None,
        }),
        depth_unit_mm: UNIT_MM,
        ..Default::default()
    }
}

fn depth_chunks(frames: impl IntoIterator<Item = Vec<u16>>) -> Vec<Payload> {
    let bytes: Vec<u8> = frames
        .into_iter()
        .flatten()
        .flat_map(u16::to_le_bytes)
        .collect();
    bytes
        .chunks(99_999)
        .map(|chunk| Payload::Depth(chunk.to_vec().into()))
        .collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn frames_are_averaged_and_cleaned_and_details_and_report_follow_the_points() {
    let knee = Knee::new(0.0, 0.0);
    let truth = render(&Distortion::None, &|ray| knee.depth_mm(ray));
    let frames = (0..4).map(|seed| {
        let mut frame = noisy(&truth, seed);
        frame[320 * 120 + 158] = 2500;
        frame
    });
    let mut payloads = vec![Payload::Header(api::DepthHeader {
        frame_count: 4,
        max_depth_mm: 390.0,
        flying_pixels: Some(api::FlyingPixels::default()),
        outliers: Some(api::OutlierFilter {
            method: Some(api::outlier_filter::Method::Statistical(
                api::StatisticalFilter::default(),
            )),
        }),
        plane: Some(api::PlaneRemoval::default()),
        with_details: true,
        ..header()
    })];
    payloads.extend(depth_chunks(frames));
    let received = ask(payloads).await.unwrap();
    assert_eq!(received.header.frame(), Frame::Camera);
    assert_eq!(received.header.point_count as usize, received.points.len());
    assert_eq!(received.details.len(), received.points.len());
    assert!(received.points.len() > 500, "{}", received.points.len());
    for (point, ([sigma_mm, _], [view, pixel])) in received.points.iter().zip(&received.details) {
        // 0.45 mm at this distance, from four frames.
        assert!((0.2..0.3).contains(sigma_mm), "{sigma_mm} mm");
        assert_eq!(*view, 0);
        assert!((f64::from(point[2]) - truth[*pixel as usize]).abs() < 2.0);
    }
    let report = received.report.unwrap();
    assert_eq!(report.clipped.len(), 4);
    assert_eq!(report.strays, 1);
    assert_eq!(report.planes.len(), 1);
    assert!((report.planes[0].offset_mm + 350.0).abs() < 0.1);
    assert_eq!(report.viewpoints, [Point::default()]);
    let pixels = INTRINSICS.pixels() as u32;
    let gone = report.without_depth
        + report.saturated
        + report.out_of_range
        + report.flying
        + report.strays
        + report.planes[0].removed;
    assert_eq!(gone + received.header.point_count, pixels);
}

#[tokio::test(flavor = "multi_thread")]
async fn viewpoints_come_together_in_base_each_with_its_frames_and_mask() {
    let pixels = INTRINSICS.pixels() as usize;
    let view = |x_mm: f64| api::DepthView {
        base_from_camera: Some(Pose {
            rotation: Some(Quaternion {
                w: 1.0,
                ..Default::default()
            }),
            translation: Some(Point {
                x_mm,
                y_mm: 0.0,
                z_mm: 1000.0,
            }),
        }),
    };
    let mut payloads = vec![Payload::Header(api::DepthHeader {
        frame_count: 2,
        has_mask: true,
        views: vec![view(0.0), view(500.0)],
        with_details: true,
        ..header()
    })];
    payloads.extend(depth_chunks([
        vec![3000; pixels],
        vec![3001; pixels],
        vec![4000; pixels],
        vec![4002; pixels],
    ]));
    let mut mask = vec![0u8; 2 * pixels];
    mask[320 * 121 + 158] = 1;
    mask[pixels + 320 * 121 + 158] = 1;
    payloads.push(Payload::Mask(mask.into()));
    let received = ask(payloads).await.unwrap();
    assert_eq!(received.header.frame(), Frame::Base);
    let middles: Vec<[f32; 3]> = received.points.iter().map(|p| [p[0], p[1], p[2]]).collect();
    assert_eq!(middles, [[0.0, 0.0, 1300.05], [500.0, 0.0, 1400.1]]);
    let views: Vec<u32> = received
        .details
        .iter()
        .map(|(_, [view, _])| *view)
        .collect();
    assert_eq!(views, [0, 1]);
    let report = received.report.unwrap();
    assert_eq!(report.viewpoints.len(), 2);
    assert_eq!(report.viewpoints[1].x_mm, 500.0);
}

async fn refusal(header: api::DepthHeader) -> String {
    let status = ask(vec![Payload::Header(header)]).await.err().unwrap();
    assert_eq!(status.code(), Code::InvalidArgument, "{status}");
    assert!(!status.details().is_empty());
    status.message().to_owned()
}

#[tokio::test]
async fn what_cannot_be_done_is_refused_by_field_value_and_limit_before_any_depth_comes() {
    let distorted = |distortion| {
        let mut header = header();
        if let Some(intrinsics) = &mut header.intrinsics {
            intrinsics.distortion = Some(distortion);
        }
        header
    };
    let cases = [
        (
            distorted(api::Distortion {
                k1: f64::NAN,
                ..Default::default()
            }),
            "header.intrinsics.distortion.k1: is NaN, must be finite",
        ),
        (
            distorted(api::Distortion {
                k1: -3.0,
                ..Default::default()
            }),
            "header.intrinsics.distortion: does not converge at pixel (319, 0), 0.4787",
        ),
        (
            distorted(api::Distortion {
                model: 9,
                ..Default::default()
            }),
            "header.intrinsics.distortion.model: is 9",
        ),
        (
            api::DepthHeader {
                frame_count: 1000,
                roi: Some(api::Roi::default()),
                min_depth_mm: -1.0,
                noise: Some(api::StereoNoise {
                    baseline_mm: -50.0,
                    subpixel_px: 0.0,
                }),
                outliers: Some(api::OutlierFilter { method: None }),
                plane: Some(api::PlaneRemoval {
                    min_share: 0.01,
                    ..Default::default()
                }),
                ..header()
            },
            "header.frame_count: is 1000, must be 1 to 256; \
             header.frame_count: makes 76800000 depth values, must make at most 32000000; \
             header.outliers.method: is not set, must be statistical or radius; \
             header.roi: has no column, must have at least 1; \
             header.roi: has no row, must have at least 1; \
             header.min_depth_mm: is -1, must be finite and at least 0; \
             header.noise.baseline_mm: is -50, must be greater than 0 and at most 10000; \
             header.plane.min_share: is 0.01, must be 0.15 to 1",
        ),
        (
            api::DepthHeader {
                views: vec![
                    api::DepthView::default(),
                    api::DepthView {
                        base_from_camera: Some(Pose {
                            rotation: Some(Quaternion::default()),
                            translation: Some(Point {
                                x_mm: f64::INFINITY,
                                ..Default::default()
                            }),
                        }),
                    },
                ],
                ..header()
            },
            "header.views[0].base_from_camera: must have a rotation and a translation; \
             header.views[1].base_from_camera.rotation: has norm 0, must be 1 within 0.001; \
             header.views[1].base_from_camera.translation: is (inf, 0, 0), must be finite",
        ),
        (
            api::DepthHeader {
                views: vec![api::DepthView::default(); 65],
                ..header()
            },
            "header.views: has 65, must have 1 to 64; \
             header.views: have 4992000 pixels together, must have at most 4000000; \
             header.views[0].base_from_camera: must have a rotation and a translation; ",
        ),
        (
            api::DepthHeader {
                views: vec![api::DepthView::default(); 65],
                ..header()
            },
            "request: violates 43 more limits",
        ),
    ];
    for (header, expected) in cases {
        let said = refusal(header).await;
        assert!(said.contains(expected), "{said} lacks {expected}");
    }
}

#[tokio::test]
async fn frames_that_were_announced_must_come_and_no_more() {
    let header = api::DepthHeader {
        frame_count: 2,
        ..header()
    };
    let pixels = INTRINSICS.pixels() as usize;
    for (frames, said) in [
        (1, "depth: ended after 153600 bytes, 307200 are announced"),
        (3, "bytes came, 307200 are announced"),
    ] {
        let mut payloads = vec![Payload::Header(header.clone())];
        payloads.extend(depth_chunks(vec![vec![3000; pixels]; frames]));
        let status = ask(payloads).await.err().unwrap();
        assert!(status.message().contains(said), "{status}");
    }
}

#[tokio::test]
async fn a_scene_that_is_all_plane_is_refused() {
    let mut payloads = vec![Payload::Header(api::DepthHeader {
        plane: Some(api::PlaneRemoval::default()),
        ..header()
    })];
    payloads.extend(depth_chunks([vec![3500; INTRINSICS.pixels() as usize]]));
    let status = ask(payloads).await.err().unwrap();
    assert!(
        status
            .message()
            .contains("header.plane: takes 76800 of 76800 points"),
        "{status}"
    );
}
