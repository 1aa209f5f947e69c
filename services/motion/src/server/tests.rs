mod through_portal;

use std::f64::consts::FRAC_1_SQRT_2;

use arthro_bootstrap::status;
use proto::move_request::Motion as Wanted;
use tokio_stream::StreamExt as _;
use tonic::Code;

use super::*;
use crate::arm::fake::FakeRobot;
use crate::config::ArmConfig;

/// The service over two fake robots that stand at their neutral joints.
struct Cell {
    motion: Motion,
    token: u64,
    next_id: u64,
}

const PORTAL: common::Point = common::Point {
    x_mm: 700.0,
    y_mm: 0.0,
    z_mm: 265.0,
};

impl Cell {
    async fn new() -> Self {
        let commander = Commander::new(1, Box::new(|| Duration::ZERO));
        let arm = |name| {
            let config = ArmConfig {
                portal_mm: Some([700.0, 0.0, 265.0]),
                ..ArmConfig::default()
            };
            let setup = config.check(name).unwrap();
            let robot = FakeRobot::new(setup.options.arm, setup.neutral_joints_rad);
            let (handle, owner) = setup.options.start(robot, commander.clone());
            tokio::spawn(owner.run());
            Arm {
                handle,
                controller: watch::channel("UR5 fake".to_owned()).1,
                neutral_joints_rad: setup.neutral_joints_rad,
            }
        };
        let arms = [arm("forceps"), arm("arthroscope")];
        for arm in &arms {
            let mut published = arm.handle.published();
            published
                .wait_for(|published| published.state.is_some())
                .await
                .unwrap();
        }
        let token = commander
            .acquire("test", Duration::from_secs(2))
            .unwrap()
            .fencing_token;
        Self {
            motion: Motion::new(commander, arms, Drain::never()),
            token,
            next_id: 0,
        }
    }

    fn by(&mut self) -> Option<common::Authorization> {
        self.next_id += 1;
        Some(common::Authorization {
            fencing_token: self.token,
            operation_id: format!("op-{}", self.next_id),
        })
    }

    async fn begin(&mut self, wanted: Wanted) -> Result<Stream<proto::MoveResponse>, Status> {
        let request = proto::MoveRequest {
            authorization: self.by(),
            arm: common::Arm::Forceps.into(),
            motion: Some(wanted),
        };
        let response = self.motion.r#move(Request::new(request)).await?;
        Ok(response.into_inner())
    }

    /// The fields that a move is refused for.
    async fn violations(&mut self, wanted: Wanted) -> Vec<(String, String)> {
        let status = self.begin(wanted).await.err().unwrap();
        assert_eq!(status.code(), Code::InvalidArgument);
        status::violations(&status)
    }

    async fn check(&self, targets: Vec<common::Point>) -> Result<Vec<proto::MotionCheck>, Status> {
        let request = proto::CheckMotionRequest {
            arm: common::Arm::Forceps.into(),
            targets,
            ..proto::CheckMotionRequest::default()
        };
        let response = self.motion.check_motion(Request::new(request)).await?;
        Ok(response.into_inner().checks)
    }
}

fn insert(depth_mm: f64) -> Wanted {
    Wanted::Insert(proto::InsertMove {
        depth_mm,
        speed_mm_s: 0.0,
    })
}

fn target(x_mm: f64, y_mm: f64, z_mm: f64) -> common::Point {
    common::Point { x_mm, y_mm, z_mm }
}

#[tokio::test]
async fn the_cell_describes_itself() {
    let cell = Cell::new().await;
    let request = Request::new(proto::GetCellRequest {});
    let told = cell.motion.get_cell(request).await.unwrap().into_inner();
    assert_eq!(told.arms.len(), 2);
    let forceps = &told.arms[0];
    assert_eq!(forceps.arm(), common::Arm::Forceps);
    assert!(forceps.connected);
    assert_eq!(forceps.controller, "UR5 fake");
    assert_eq!(forceps.portal, Some(PORTAL));
    assert_eq!(forceps.limits.unwrap().rcm_stop_mm, 1.0);
    let rotation = forceps.flange_from_tool.unwrap().rotation.unwrap();
    assert!((rotation.y + FRAC_1_SQRT_2).abs() < 1e-12);
    assert_eq!(told.lease.unwrap().holder, "test");
}

#[tokio::test]
async fn a_move_streams_its_progress_and_ends_in_its_outcome() {
    let mut cell = Cell::new().await;
    let messages: Vec<_> = cell.begin(insert(-5.0)).await.unwrap().collect().await;
    let messages: Vec<_> = messages.into_iter().map(Result::unwrap).collect();
    assert!(messages.len() > 10, "{}", messages.len());
    assert!(messages.is_sorted_by(|a, b| a.fraction <= b.fraction));
    let last = messages.last().unwrap();
    let operation = last.operation.as_ref().unwrap();
    assert_eq!(operation.state(), common::OperationState::Done);
    assert!(!operation.repeated);
    assert_eq!(last.fraction, 1.0);
    let state = last.state.as_ref().unwrap();
    assert!(!state.inside && !state.moving);
    assert!((state.depth_mm + 5.0).abs() < 1e-3);
}

#[tokio::test]
async fn a_repeated_move_is_answered_with_its_first_outcome() {
    let mut cell = Cell::new().await;
    let _all: Vec<_> = cell.begin(insert(-5.0)).await.unwrap().collect().await;
    cell.next_id -= 1;
    let again: Vec<_> = cell.begin(insert(-5.0)).await.unwrap().collect().await;
    let [Ok(only)] = &again[..] else {
        panic!("{again:?}")
    };
    let operation = only.operation.as_ref().unwrap();
    assert_eq!(operation.state(), common::OperationState::Done);
    assert!(operation.repeated);
}

#[tokio::test]
async fn a_stop_without_lease_ends_a_move_as_stopped() {
    let mut cell = Cell::new().await;
    let mut stream = cell.begin(insert(-5.0)).await.unwrap();
    stream.next().await.unwrap().unwrap();
    let request = Request::new(proto::StopRequest {
        arm: 0,
        reason: "hand on the button".to_owned(),
    });
    cell.motion.stop(request).await.unwrap();
    let rest: Vec<_> = stream.collect().await;
    let last = rest.last().unwrap().as_ref().unwrap();
    let operation = last.operation.as_ref().unwrap();
    assert_eq!(operation.state(), common::OperationState::Stopped);
    assert_eq!(operation.detail, "hand on the button");
}

#[tokio::test]
async fn a_refusal_carries_its_reason_and_numbers() {
    let mut cell = Cell::new().await;
    let refusal = cell.begin(insert(99.0)).await.err().unwrap();
    assert_eq!(refusal.code(), Code::FailedPrecondition);
    assert_eq!(status::reason(&refusal).as_deref(), Some("TOO_DEEP"));
    cell.token = 7;
    let refusal = cell.begin(insert(5.0)).await.err().unwrap();
    assert_eq!(status::reason(&refusal).as_deref(), Some("NO_LEASE"));
}

#[tokio::test]
async fn bad_input_is_refused_by_field() {
    let mut cell = Cell::new().await;
    let pose = |w: f64, x_mm: f64| common::Pose {
        rotation: Some(common::Quaternion {
            w,
            x: 0.0,
            y: 0.0,
            z: 0.0,
        }),
        translation: Some(target(x_mm, 0.0, 300.0)),
    };
    let free = |base_from_tool, speed_mm_s| {
        Wanted::Free(proto::FreeMove {
            base_from_tool,
            speed_mm_s,
        })
    };
    assert_eq!(
        cell.violations(free(Some(pose(1.01, 600.0)), 0.0)).await,
        [(
            "free.base_from_tool.rotation".to_owned(),
            "has norm 1.01; must be 1 within 0.001".to_owned()
        )]
    );
    // All that is wrong is told at once.
    let both = cell
        .violations(free(Some(pose(1.0, f64::NAN)), 500.0))
        .await;
    assert_eq!(both[0].0, "free.base_from_tool.translation.x_mm");
    assert_eq!(
        both[1],
        (
            "free.speed_mm_s".to_owned(),
            "is 500 mm/s; must be 0 or within 0.1 .. 100 mm/s".to_owned()
        )
    );
    assert_eq!(
        cell.violations(free(None, 0.0)).await[0].0,
        "free.base_from_tool"
    );
    assert_eq!(
        cell.violations(insert(f64::INFINITY)).await[0].0,
        "insert.depth_mm"
    );
    let joint = |joints_rad| {
        Wanted::Joint(proto::JointMove {
            joints_rad,
            speed_rad_s: 0.0,
        })
    };
    assert_eq!(
        cell.violations(joint(vec![0.0; 5])).await[0].1,
        "has 5 angles; must have 6"
    );
    let six = vec![0.0, 0.0, f64::NAN, 0.0, 0.0, 0.0];
    assert_eq!(
        cell.violations(joint(six)).await[0].0,
        "joint.joints_rad[2]"
    );
    let nothing = proto::MoveRequest {
        arm: 9,
        ..proto::MoveRequest::default()
    };
    let status = cell
        .motion
        .r#move(Request::new(nothing))
        .await
        .err()
        .unwrap();
    let named: Vec<_> = status::violations(&status)
        .into_iter()
        .map(|(field, _)| field)
        .collect();
    assert_eq!(named, ["authorization", "arm", "motion"]);
}

#[tokio::test]
async fn leases_are_refused_by_field_or_reason() {
    let cell = Cell::new().await;
    let acquire = async |holder: &str, ttl_s| {
        let holder = holder.to_owned();
        let request = Request::new(proto::AcquireLeaseRequest { holder, ttl_s });
        cell.motion.acquire_lease(request).await.err().unwrap()
    };
    let held = acquire("other", 0.0).await;
    assert_eq!(status::reason(&held).as_deref(), Some("LEASE_HELD"));
    assert_eq!(status::violations(&acquire("", 0.0).await)[0].0, "holder");
    assert_eq!(status::violations(&acquire("a", 100.0).await)[0].0, "ttl_s");
    assert_eq!(
        status::violations(&acquire("a", f64::NAN).await)[0].0,
        "ttl_s"
    );
}

#[tokio::test]
async fn a_dry_run_answers_for_each_target_in_order() {
    let cell = Cell::new().await;
    let targets = vec![
        target(740.0, 0.0, 250.0),
        target(900.0, 0.0, 250.0),
        target(742.0, 12.0, 252.0),
    ];
    let checks = cell.check(targets).await.unwrap();
    assert!(checks[0].reachable && checks[2].reachable);
    assert!(checks[0].joint_margin_rad > 0.3 && checks[0].rcm_deviation_mm < 0.01);
    assert!((checks[0].depth_mm - 42.720).abs() < 1e-3);
    assert_eq!(checks[1].reason, "TOO_DEEP");
    assert!(
        checks[1].detail.contains("limit 80 mm"),
        "{}",
        checks[1].detail
    );
}

#[tokio::test]
async fn a_dry_run_of_no_or_too_many_or_bad_targets_is_refused() {
    let cell = Cell::new().await;
    let refusal = |outcome: Result<Vec<_>, Status>| status::violations(&outcome.err().unwrap());
    assert_eq!(
        refusal(cell.check(Vec::new()).await)[0].1,
        "has 0 points; must have 1 .. 1000"
    );
    assert_eq!(
        refusal(cell.check(vec![PORTAL; 1001]).await)[0].0,
        "targets"
    );
    let bad = vec![PORTAL, target(0.0, f64::NAN, 0.0)];
    assert_eq!(refusal(cell.check(bad).await)[0].0, "targets[1].y_mm");
}

#[tokio::test]
async fn the_watch_begins_at_once_and_keeps_to_the_controllers_clock() {
    let cell = Cell::new().await;
    let request = Request::new(proto::WatchStateRequest { period_s: 0.2 });
    let mut stream = cell.motion.watch_state(request).await.unwrap().into_inner();
    let mut times = Vec::new();
    for _ in 0..20 {
        let message = stream.next().await.unwrap().unwrap();
        assert_eq!(message.arms.len(), 2);
        let latest = message.arms.iter().map(|arm| arm.controller_time_s);
        times.push(latest.fold(0.0, f64::max));
    }
    for pair in times.windows(2) {
        assert!(pair[1] - pair[0] > 0.15, "{times:?}");
    }
    let request = Request::new(proto::WatchStateRequest { period_s: 0.001 });
    let status = cell.motion.watch_state(request).await.err().unwrap();
    assert_eq!(status::violations(&status)[0].0, "period_s");
}

#[tokio::test]
async fn a_portal_is_set_and_told() {
    let mut cell = Cell::new().await;
    let portal = target(705.0, 3.0, 260.0);
    let request = proto::SetPortalRequest {
        authorization: cell.by(),
        arm: common::Arm::Arthroscope.into(),
        portal: Some(portal),
        ..proto::SetPortalRequest::default()
    };
    cell.motion.set_portal(Request::new(request)).await.unwrap();
    let request = Request::new(proto::GetCellRequest {});
    let told = cell.motion.get_cell(request).await.unwrap().into_inner();
    assert_eq!(told.arms[1].portal, Some(portal));
}
