//! Bad input gets an error that names the field, the value and the limit, and loses nothing.
#![allow(clippy::panic, reason = "a test says why it failed by panicking")]

use arthro_bootstrap::status;
use arthro_proto::common::v1::{
    Arm, Authorization, Box as TargetBox, CloudHeader, Frame, Point, Pose, Quaternion,
};
use arthro_proto::gateway::v1::PlanCaseRequest;
use arthro_proto::motion::v1::{self as motion, move_request};
use arthro_proto::registration::v1::{
    RegisterOptions, RegisterRequest, RegisterResponse, register_request,
};
use arthro_tests::Cell;
use bytes::Bytes;
use tonic::{Code, Status};

/// A bowl of points that any registration would take, `scale` times as large.
fn bowl(count: u32, scale: f32) -> Vec<[f32; 3]> {
    (0..count)
        .map(|index| {
            let (turn, out) = (
                index as f32 * 2.4,
                (index as f32 / count as f32).sqrt() * 20.0,
            );
            let (x, y) = (out * turn.cos(), out * turn.sin());
            [x * scale, y * scale, (out * out / 40.0 + 300.0) * scale]
        })
        .collect()
}

fn packed(points: &[[f32; 3]]) -> Bytes {
    points
        .iter()
        .flatten()
        .flat_map(|number| number.to_le_bytes())
        .collect()
}

fn header(frame: Frame, point_count: u32) -> CloudHeader {
    CloudHeader {
        frame: frame.into(),
        point_count,
        has_normals: false,
    }
}

/// Sends a model and a view as announced, and returns how the service ended it.
async fn register(
    cell: &Cell,
    announced: u32,
    points: &[[f32; 3]],
) -> Result<Vec<RegisterResponse>, Status> {
    let model = bowl(500, 1.0);
    let options = RegisterOptions {
        source: Some(header(Frame::Ct, model.len() as u32)),
        target: Some(header(Frame::Camera, announced)),
        ..RegisterOptions::default()
    };
    use register_request::Payload;
    let requests = [
        Payload::Options(options),
        Payload::Source(packed(&model)),
        Payload::Target(packed(points)),
    ];
    let stream = tokio_stream::iter(requests.map(|payload| RegisterRequest {
        payload: Some(payload),
    }));
    let mut events = cell
        .registration()
        .await
        .register(stream)
        .await?
        .into_inner();
    let mut answers = Vec::new();
    while let Some(event) = events.message().await? {
        answers.push(event);
    }
    Ok(answers)
}

#[track_caller]
fn assert_names(refusal: &Status, field: &str, words: &[&str]) {
    assert_eq!(refusal.code(), Code::InvalidArgument, "{refusal:?}");
    let violations = status::violations(refusal);
    let (_, description) = violations
        .iter()
        .find(|(name, _)| name.contains(field))
        .unwrap_or_else(|| panic!("{field} is not named in {violations:?}"));
    for word in words {
        assert!(
            description.contains(word),
            "{word:?} is not in {description:?}"
        );
    }
}

#[tokio::test]
async fn clouds_that_cannot_be_registered_are_refused_by_name() {
    let cell = Cell::up().await;
    let refusal = register(&cell, 0, &[]).await.unwrap_err();
    assert_names(&refusal, "target", &["0", "100"]);

    let refusal = register(&cell, 3, &bowl(3, 1.0)).await.unwrap_err();
    assert_names(&refusal, "target", &["3", "100"]);

    let mut with_nan = bowl(500, 1.0);
    with_nan[123][1] = f32::NAN;
    let refusal = register(&cell, 500, &with_nan).await.unwrap_err();
    assert_names(&refusal, "target", &["NaN"]);
    assert!(refusal.message().contains("123"), "{}", refusal.message());

    let refusal = register(&cell, 500, &bowl(500, 1e-3)).await.unwrap_err();
    assert_names(&refusal, "target", &["metres"]);

    let line: Vec<[f32; 3]> = (0..500)
        .map(|index| [index as f32 * 0.1, 0.0, 300.0])
        .collect();
    let refusal = register(&cell, 500, &line).await.unwrap_err();
    assert_names(&refusal, "target", &["line"]);

    let refusal = register(&cell, 400, &bowl(500, 1.0)).await.unwrap_err();
    assert_names(&refusal, "target", &["6000 bytes", "4800"]);
    cell.teardown().await;
}

#[tokio::test]
async fn a_cloud_of_ten_million_points_is_refused_before_it_is_read() {
    let cell = Cell::up().await;
    let resident_before_kb = resident_kb(&cell, "registration");
    let refusal = register(&cell, 10_000_000, &bowl(500, 1.0))
        .await
        .unwrap_err();
    assert_names(&refusal, "target", &["10000000", "2000000"]);
    let grown_kb = resident_kb(&cell, "registration").saturating_sub(resident_before_kb);
    assert!(grown_kb < 50_000, "memory grew by {grown_kb} kB");
    cell.teardown().await;
}

/// Resident memory of a service from /proc.
fn resident_kb(cell: &Cell, service: &str) -> u64 {
    let path = format!("/proc/{}/status", cell.at.processes[service]);
    let text = std::fs::read_to_string(path).expect("the process runs");
    let line = text.lines().find(|line| line.starts_with("VmRSS:"));
    line.and_then(|line| line.split_whitespace().nth(1))
        .and_then(|number| number.parse().ok())
        .expect("the process has a resident size")
}

#[tokio::test]
async fn a_target_box_off_the_meniscus_and_a_start_off_the_tissue_are_refused() {
    let cell = Cell::up().await;
    let case_id = cell.registered_case().await;
    let point = |x_mm, y_mm, z_mm| Some(Point { x_mm, y_mm, z_mm });
    let far = TargetBox {
        min: point(500.0, 500.0, 500.0),
        max: point(510.0, 510.0, 510.0),
    };
    let near = TargetBox {
        min: point(50.0, 40.0, 30.0),
        max: point(60.0, 70.0, 70.0),
    };
    let request = |start, goal, target_box| PlanCaseRequest {
        case_id: case_id.clone(),
        start,
        goal,
        target_box: Some(target_box),
        ..PlanCaseRequest::default()
    };
    let (start, goal) = (point(53.0, 48.0, 61.0), point(54.0, 53.0, 36.0));
    for (request, field) in [
        (request(start, goal, far), "target_box"),
        (request(point(0.0, 0.0, 0.0), goal, near), "start"),
        (request(start, point(f64::NAN, 53.0, 36.0), near), "goal"),
    ] {
        let mut cases = cell.cases().await;
        let refusal = match cases.plan_case(request).await {
            Err(refusal) => refusal,
            Ok(events) => {
                let mut events = events.into_inner();
                loop {
                    match events.message().await {
                        Err(refusal) => break refusal,
                        Ok(Some(_)) => {}
                        Ok(None) => panic!("{field}: planned all the same"),
                    }
                }
            }
        };
        assert_names(&refusal, field, &[]);
    }
    // Nothing was lost: the case still stands where it stood, and can be planned.
    let targets = cell.at.targets.display().to_string();
    cell.done(&["case", "plan", &case_id, "--targets", &targets])
        .await;
    cell.teardown().await;
}

fn free_move(fencing_token: u64, operation_id: &str, base_from_tool: Pose) -> motion::MoveRequest {
    motion::MoveRequest {
        authorization: Some(Authorization {
            fencing_token,
            operation_id: operation_id.to_owned(),
        }),
        arm: Arm::Forceps.into(),
        motion: Some(move_request::Motion::Free(motion::FreeMove {
            base_from_tool: Some(base_from_tool),
            speed_mm_s: 0.0,
        })),
    }
}

#[tokio::test]
async fn a_rotation_that_is_none_and_a_target_out_of_reach_are_refused_before_anything_moves() {
    let cell = Cell::up().await;
    let mut arms = cell.motion().await;
    let request = motion::AcquireLeaseRequest {
        holder: "test".to_owned(),
        ttl_s: 30.0,
    };
    let lease = arms
        .acquire_lease(request)
        .await
        .expect("a lease")
        .into_inner();
    let token = lease.lease.expect("a lease").fencing_token;
    let pose = |w, x_mm| Pose {
        rotation: Some(Quaternion {
            w,
            x: 0.0,
            y: 0.0,
            z: 0.0,
        }),
        translation: Some(Point {
            x_mm,
            y_mm: -200.0,
            z_mm: 300.0,
        }),
    };
    let refusal = arms
        .r#move(free_move(token, "a", pose(0.5, 500.0)))
        .await
        .unwrap_err();
    assert_names(&refusal, "rotation", &["0.5", "1"]);

    let refusal = match arms.r#move(free_move(token, "b", pose(1.0, 5_000.0))).await {
        Err(refusal) => refusal,
        Ok(_) => panic!("five metres are within reach"),
    };
    assert_eq!(status::reason(&refusal).as_deref(), Some("OUT_OF_REACH"));

    let request = motion::CheckMotionRequest {
        arm: Arm::Forceps.into(),
        targets: vec![Point {
            x_mm: 5_000.0,
            y_mm: 0.0,
            z_mm: 0.0,
        }],
        portal: Some(Point {
            x_mm: 700.0,
            y_mm: 0.0,
            z_mm: 265.0,
        }),
        ..motion::CheckMotionRequest::default()
    };
    let checks = arms
        .check_motion(request)
        .await
        .expect("a dry run")
        .into_inner()
        .checks;
    assert!(!checks[0].reachable);
    assert!(!checks[0].detail.is_empty());
    cell.teardown().await;
}

#[tokio::test]
async fn a_model_that_does_not_state_its_space_is_refused_for_a_case() {
    let cell = Cell::up().await;
    let file = cell.folder().join("untagged.ply");
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n30 0 0\n0 30 0\n3 0 1 2\n";
    std::fs::write(&file, text).expect("the file can be written");
    let path = file.display().to_string();
    let answer = cell
        .command(&["case", "create", "untagged", "--model", &path])
        .await;
    assert_eq!((answer.code, answer.reason()), (3, "FILE_INVALID"));
    let message = answer.json["error"]["message"].as_str().unwrap_or_default();
    assert!(message.contains("space"), "{message}");
    cell.teardown().await;
}
