//! The path from plan to controller: samples, late packages, silent links, the speed slider, other commanders.

use super::*;
use crate::rcm::Placement;

/// A pivot and a pivot back, with the slider as `slider` has it at each share of the way. What the joints followed.
async fn followed(slider: impl Fn(f64) -> f64) -> Vec<Joints> {
    let mut cell = Cell::new().await;
    cell.go_to_depth(40.0).await;
    cell.robot.lock().followed.clear();
    for angle_rad in [0.2, 0.0] {
        let mut progress = cell.begin(pivot(&cell, angle_rad)).await.unwrap();
        loop {
            let now = progress.borrow_and_update().clone();
            cell.robot.lock().scaling = slider(now.fraction);
            match now.operation.state {
                OperationState::Running => progress.changed().await.unwrap(),
                OperationState::Done => break,
                _ => panic!("{now:?}"),
            }
        }
        cell.robot.lock().scaling = 1.0;
    }
    let portal = cell.portal;
    let followed = cell.robot.lock().followed.clone();
    for joints in &followed {
        let pose = tool_arm().base_from_tool(joints);
        assert!(Placement::of(&pose, &portal).deviation_mm() <= 1e-6);
    }
    followed
}

#[tokio::test]
async fn the_slider_changes_the_time_of_a_move_and_not_one_sample_of_it() {
    let full = followed(|_| 1.0).await;
    assert!(full.len() > 100);
    assert_eq!(followed(|_| 0.5).await, full);
    assert_eq!(followed(|_| 0.2).await, full);
    assert_eq!(
        followed(|fraction| 0.1 + 0.9 * (17.0 * fraction).sin().abs()).await,
        full
    );
}

#[tokio::test]
async fn packages_that_get_lost_are_bridged() {
    let mut cell = Cell::new().await;
    let start = cell.robot.lock().followed.len();
    let mut progress = cell.begin(insert(-5.0)).await.unwrap();
    under_way(&mut progress).await;
    cell.robot.lock().packages_to_lose = 3;
    assert_eq!(
        ended(&mut progress).await.operation.state,
        OperationState::Done
    );
    let bridged = cell.robot.lock().followed[start..].to_vec();
    let mut whole = Cell::new().await;
    whole.carry_out(insert(-5.0)).await.unwrap();
    assert_eq!(bridged, whole.robot.lock().followed);
}

#[tokio::test]
async fn an_empty_window_stops_the_move_for_good() {
    let mut cell = Cell::new().await;
    let mut progress = cell.begin(insert(-5.0)).await.unwrap();
    under_way(&mut progress).await;
    cell.robot.lock().packages_to_lose = 6;
    let progress = ended(&mut progress).await;
    assert_eq!(progress.operation.state, OperationState::Failed);
    assert_eq!(progress.operation.reason, "CONTROLLER_FAULT");
    assert!(progress.operation.detail.contains("Starved"));
    let joints_rad = cell.state().await.joints_rad;
    cell.state().await;
    assert_eq!(cell.state().await.joints_rad, joints_rad);
    assert_eq!(cell.refusal(insert(-5.0)).await, "FAULT_LATCHED");
}

#[tokio::test]
async fn a_move_at_slider_zero_is_refused() {
    let mut cell = Cell::new().await;
    cell.robot.lock().scaling = 0.0;
    cell.state().await;
    assert_eq!(cell.refusal(insert(-5.0)).await, "SPEED_SLIDER_ZERO");
    cell.robot.lock().scaling = f64::NAN;
    cell.state().await;
    assert_eq!(cell.refusal(insert(-5.0)).await, "SPEED_SLIDER_ZERO");
    cell.robot.lock().scaling = 0.01;
    cell.state().await;
    cell.begin(insert(-75.0)).await.unwrap();
}

#[tokio::test]
async fn a_link_that_falls_silent_is_told_to_stop() {
    let mut cell = Cell::new().await;
    let mut progress = cell.begin(insert(-5.0)).await.unwrap();
    under_way(&mut progress).await;
    cell.robot.lock().silent = true;
    let faulty = |published: &Published| published.state.as_ref().unwrap().fault.is_some();
    let published = cell.published(faulty).await;
    assert_eq!(
        published.state.unwrap().fault.unwrap().reason,
        "STATE_STALE"
    );
    assert_eq!(cell.commands().last(), Some(&Command::Stop));
    // How it ended is known only once the arm is seen to stand.
    assert_eq!(progress.borrow().operation.state, OperationState::Running);
    cell.robot.lock().silent = false;
    let progress = ended(&mut progress).await;
    assert_eq!(progress.operation.state, OperationState::Failed);
    assert_eq!(progress.operation.reason, "STATE_STALE");
}

#[tokio::test]
async fn a_silent_link_is_no_fault_of_an_arm_that_stands() {
    let cell = Cell::new().await;
    cell.robot.lock().silent = true;
    tokio::time::sleep(Duration::from_millis(250)).await;
    cell.robot.lock().silent = false;
    assert_eq!(cell.state().await.fault, None);
}

#[tokio::test]
async fn a_link_lost_while_the_arm_is_being_stopped_leaves_the_move_in_doubt() {
    let mut cell = Cell::new().await;
    let mut progress = cell.begin(insert(-5.0)).await.unwrap();
    under_way(&mut progress).await;
    cell.robot.lock().silent = true;
    cell.published(|published| published.state.as_ref().unwrap().fault.is_some())
        .await;
    {
        let mut robot = cell.robot.lock();
        robot.unreachable = true;
        robot.silent = false;
    }
    let progress = ended(&mut progress).await;
    assert_eq!(progress.operation.state, OperationState::InDoubt);
    assert_eq!(progress.operation.reason, "LINK_LOST");
    assert!(progress.operation.detail.contains("being stopped"));
}

#[tokio::test]
async fn states_that_do_not_come_are_counted() {
    let mut cell = Cell::new().await;
    let mut progress = cell.begin(insert(-5.0)).await.unwrap();
    under_way(&mut progress).await;
    let before = cell.state().await.states_missed;
    cell.robot.lock().gap_s = 6.0 * PERIOD_S;
    assert_eq!(
        ended(&mut progress).await.operation.state,
        OperationState::Done
    );
    assert_eq!(cell.state().await.states_missed, before + 6);
}

#[tokio::test]
async fn a_program_of_somebody_else_is_not_ended_by_ours() {
    let mut cell = Cell::new().await;
    let mut progress = cell.begin(insert(-5.0)).await.unwrap();
    under_way(&mut progress).await;
    cell.robot.lock().program.ready = false;
    let progress = ended(&mut progress).await;
    assert_eq!(progress.operation.reason, "PROGRAM_ENDED");
    assert!(progress.operation.detail.contains("another program"));
    cell.recover().await.unwrap();
    let now_s = cell.robot.lock().time_s;
    cell.published(|published| published.state.as_ref().unwrap().time_s > now_s + 3.0)
        .await;
    assert_eq!(cell.robot.lock().links_made, 1);
    assert_eq!(cell.refusal(insert(-5.0)).await, "CONTROLLER_NOT_READY");
    // Once it has ended, ours comes back, and with it nothing of the move.
    cell.robot.lock().runtime_state = RuntimeState::Stopped;
    let followed = cell.robot.lock().followed.len();
    cell.published(|published| !published.connected).await;
    cell.connected().await;
    cell.state().await;
    assert_eq!(cell.robot.lock().followed.len(), followed);
    cell.carry_out(insert(-5.0)).await.unwrap();
}
