//! Two owners in one cell: each sees the other's newest measured joints and the way that it is on.

use super::*;
use crate::clearance::Clearance;

/// Two arms face to face, their tips this far apart.
async fn facing(gap_mm: f64) -> [Cell; 2] {
    let arm = tool_arm();
    let shape = ArmShape::new(&arm, ToolShape::default());
    let pose = arm.base_from_tool(&START);
    let portal = pose.origin() + shaft(&pose) * 80.0;
    // The other base is half a turn about the vertical through the middle between the tips.
    let level = Vector3::new(shaft(&pose).x, shaft(&pose).y, 0.0).normalize();
    let middle = pose.origin() + level * (0.5 * gap_mm);
    let middle = Vector3::new(middle.x, middle.y, 0.0);
    let half = Rotation::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
    let base = Rigid::new(half, middle - half * middle);
    let berths = Berth::beside(Clearance::new((arm, shape), (arm, shape), base));
    let mut cells = berths.map(|berth| {
        let robot = FakeRobot::new(arm, START);
        Cell::in_berth(robot, Some(portal.into()), portal, Limits::default(), berth)
    });
    for cell in &mut cells {
        cell.connected().await;
        cell.token = cell.acquire();
    }
    cells
}

/// The tool as at the start, level ahead towards the other arm.
fn ahead_pose(ahead_mm: f64) -> Rigid<Base, Tool> {
    let pose = tool_arm().base_from_tool(&START);
    let level = Vector3::new(shaft(&pose).x, shaft(&pose).y, 0.0).normalize();
    Rigid::new(pose.rotation(), pose.translation_mm() + level * ahead_mm)
}

fn ahead(ahead_mm: f64) -> Move {
    Move::Free {
        base_from_tool: ahead_pose(ahead_mm),
        speed_mm_s: None,
    }
}

#[tokio::test]
async fn a_move_that_would_touch_the_other_arm_is_refused_before_it_begins() {
    let [mut moving, _other] = facing(60.0).await;
    let refusal = moving.begin(ahead(70.0)).await.unwrap_err();
    assert_eq!(refusal.reason(), "ARMS_TOO_NEAR");
    let told = refusal.to_string();
    assert!(told.contains("the shaft comes to"), "{told}");
    assert!(
        told.contains("from the shaft of the other arm at"),
        "{told}"
    );
    assert!(
        moving
            .commands()
            .iter()
            .all(|command| *command == Command::Hold)
    );
    moving.carry_out(ahead(20.0)).await.unwrap();
}

#[tokio::test]
async fn an_arm_that_moves_is_stopped_within_two_cycles_when_the_other_comes_near() {
    let [mut moving, other] = facing(80.0).await;
    let mut progress = moving.begin(ahead(70.0)).await.unwrap();
    under_way(&mut progress).await;
    let pushed = tool_arm().joints(&ahead_pose(75.0), &START).unwrap();
    other.robot.lock().joints = pushed;
    // One cycle of the other owner, which tells of it.
    other.state().await;
    let before = moving.commands().len();
    let operation = ended(&mut progress).await.operation;
    assert_eq!(operation.reason, "ARMS_TOO_NEAR", "{operation:?}");
    assert!(operation.detail.contains("limit 1.000 mm"), "{operation:?}");
    let commands = moving.commands();
    let stop = commands
        .iter()
        .position(|command| *command == Command::Stop);
    assert!(stop.unwrap() < before + 2, "{stop:?} {before}");
    assert_eq!(other.state().await.fault, None, "it only stood there");
}

#[tokio::test]
async fn arms_that_are_too_near_part_once_that_is_acknowledged() {
    let [mut moving, _other] = facing(0.5).await;
    let apart = ahead(-40.0);
    assert_eq!(moving.refusal(apart.clone()).await, "ARMS_TOO_NEAR");
    moving.recover().await.unwrap();
    let nearer = ahead(10.0);
    assert_eq!(moving.refusal(nearer).await, "ARMS_TOO_NEAR");
    let progress = moving.carry_out(apart).await.unwrap();
    assert_eq!(progress.operation.state, OperationState::Done);
}

#[tokio::test]
async fn a_move_near_the_way_of_the_other_arm_waits_until_that_has_ended() {
    let [mut first, mut second] = facing(110.0).await;
    let mut progress = first.begin(ahead(70.0)).await.unwrap();
    under_way(&mut progress).await;
    let wanted = ahead(45.0);
    assert_eq!(second.refusal(wanted.clone()).await, "ARM_BUSY_NEARBY");
    assert_eq!(
        ended(&mut progress).await.operation.state,
        OperationState::Done
    );
    // Where the first arm stands now there is no room either; once it is back there is.
    assert_eq!(second.refusal(wanted.clone()).await, "ARMS_TOO_NEAR");
    first.carry_out(ahead(0.0)).await.unwrap();
    let progress = second.carry_out(wanted).await.unwrap();
    assert_eq!(progress.operation.state, OperationState::Done);
}

#[tokio::test]
async fn arms_whose_ways_keep_apart_move_at_once() {
    let [mut first, mut second] = facing(500.0).await;
    let mut one = first.begin(ahead(70.0)).await.unwrap();
    let mut other = second.begin(ahead(70.0)).await.unwrap();
    for progress in [&mut one, &mut other] {
        assert_eq!(ended(progress).await.operation.state, OperationState::Done);
    }
}

#[tokio::test]
async fn an_arm_does_not_go_on_while_the_other_has_no_link_but_is_drawn_back() {
    let [mut moving, other] = facing(400.0).await;
    moving.go_to_depth(30.0).await;
    let mut progress = moving.begin(insert(60.0)).await.unwrap();
    under_way(&mut progress).await;
    other.robot.lock().unreachable = true;
    let operation = ended(&mut progress).await.operation;
    assert_eq!(operation.reason, "OTHER_ARM_UNKNOWN", "{operation:?}");
    moving.recover().await.unwrap();
    assert_eq!(moving.refusal(insert(60.0)).await, "RETRACT_ONLY");
    let progress = moving.carry_out(retract(-5.0)).await.unwrap();
    assert_eq!(progress.operation.state, OperationState::Done);
    assert_eq!(moving.refusal(insert(30.0)).await, "OTHER_ARM_UNKNOWN");
    other.robot.lock().unreachable = false;
    other.connected().await;
    moving.carry_out(insert(30.0)).await.unwrap();
}

#[tokio::test]
async fn an_arm_does_not_go_on_while_the_other_is_silent() {
    let [mut moving, other] = facing(400.0).await;
    moving.go_to_depth(-5.0).await;
    let mut progress = moving.begin(pivot(&moving, 0.5)).await.unwrap();
    under_way(&mut progress).await;
    other.robot.lock().silent = true;
    let operation = ended(&mut progress).await.operation;
    assert_eq!(operation.reason, "OTHER_ARM_UNKNOWN", "{operation:?}");
    assert!(
        operation
            .detail
            .contains("age of the other arm's last state is 0.20"),
        "{operation:?}"
    );
    other.robot.lock().silent = false;
}

#[tokio::test]
async fn no_arm_moves_in_a_cell_whose_layout_nobody_stated() {
    let arm = tool_arm();
    let berth = Berth::unstated(ArmShape::new(&arm, ToolShape::default()));
    let portal = Point3::new(700.0, 0.0, 265.0);
    let robot = FakeRobot::new(arm, START);
    let mut cell = Cell::in_berth(robot, Some(portal.into()), portal, Limits::default(), berth);
    cell.connected().await;
    cell.token = cell.acquire();
    assert_eq!(
        cell.refusal(free(&cell, -100.0, 0.0)).await,
        "LAYOUT_UNKNOWN"
    );
}
