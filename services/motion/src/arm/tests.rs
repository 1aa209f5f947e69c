mod control;
mod hostile;
mod supervisor;
mod two_arms;

use std::f64::consts::FRAC_PI_2;
use std::sync::atomic::{AtomicU64, Ordering};

use arthro_authority::{OperationState, Outcome};
use arthro_geometry::nalgebra::Unit;
use arthro_geometry::{Point3, Rotation, Vector3};
use ur_link::{Command, ProgramState, RuntimeState};

use super::fake::{FakeRobot, PERIOD_S};
use super::*;
use crate::bodies::{ArmShape, ToolShape};
use crate::rcm::{Portal, shaft};

const START: Joints = [0.479, -1.185, -2.041, 3.004, -1.102, -1.469];

/// One arm with its owner running against a fake robot; the host's clock stands unless set.
struct Cell {
    robot: FakeRobot,
    handle: ArmHandle,
    commander: Commander,
    host_ms: Arc<AtomicU64>,
    token: u64,
    next_id: u64,
    portal: Point3,
    owner: tokio::task::JoinHandle<()>,
}

fn tool_arm() -> ToolArm {
    ToolArm::new(
        crate::kinematics::model::Model::ur5(),
        Rigid::new(
            Rotation::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2),
            Vector3::new(0.0, 0.0, 310.0),
        ),
    )
}

fn apart() -> Berth {
    Berth::apart(ArmShape::new(&tool_arm(), ToolShape::default()))
}

impl Cell {
    /// The tip 80 mm in front of a portal on the shaft's axis.
    async fn new() -> Self {
        Self::standing(Limits::default(), None).await
    }

    /// The same with other limits and a portal whose axis is the shaft's.
    async fn limited(limits: Limits) -> Self {
        let pose = tool_arm().base_from_tool(&START);
        Self::standing(limits, Some(Unit::new_normalize(shaft(&pose)))).await
    }

    async fn standing(limits: Limits, axis: Option<Unit<Vector3>>) -> Self {
        let pose = tool_arm().base_from_tool(&START);
        let point = pose.origin() + shaft(&pose) * 80.0;
        let robot = FakeRobot::new(tool_arm(), START);
        let set = Some(Portal { point, axis });
        let mut cell = Self::in_berth(robot, set, point, limits, apart());
        cell.connected().await;
        cell.token = cell.acquire();
        cell
    }

    fn with(robot: FakeRobot, set: Option<Point3>, portal: Point3) -> Self {
        Self::in_berth(
            robot,
            set.map(Into::into),
            portal,
            Limits::default(),
            apart(),
        )
    }

    fn in_berth(
        robot: FakeRobot,
        set: Option<Portal>,
        portal: Point3,
        limits: Limits,
        berth: Berth,
    ) -> Self {
        let host_ms = Arc::new(AtomicU64::new(0));
        let clock = host_ms.clone();
        let commander = Commander::new(
            1,
            Box::new(move || Duration::from_millis(clock.load(Ordering::SeqCst))),
        );
        let options = ArmOptions {
            name: "forceps",
            address: "fake:30004".to_owned(),
            arm: tool_arm(),
            limits,
            berth,
            portal: set,
            period_s: PERIOD_S,
            silence: Duration::from_millis(100),
            reconnect: Duration::from_millis(1),
        };
        let (handle, owner) = options.start(robot.clone(), commander.clone());
        Self {
            robot,
            handle,
            commander,
            host_ms,
            token: 0,
            next_id: 0,
            portal,
            owner: tokio::spawn(owner.run()),
        }
    }

    fn acquire(&self) -> u64 {
        let ttl = Duration::from_secs(2);
        self.commander.acquire("test", ttl).unwrap().fencing_token
    }

    async fn connected(&self) -> Published {
        self.published(|published| published.connected && published.state.is_some())
            .await
    }

    async fn published(&self, condition: impl FnMut(&Published) -> bool) -> Published {
        let mut published = self.handle.published();
        let seen = published.wait_for(condition).await.unwrap();
        seen.clone()
    }

    async fn state(&self) -> ArmState {
        // One whole cycle later than anything done before.
        let now_s = self.robot.lock().time_s;
        let later = |published: &Published| {
            let state = published.state.as_ref();
            state.is_some_and(|state| state.time_s > now_s)
        };
        self.published(later).await.state.unwrap()
    }

    fn by(&mut self) -> Authorization {
        self.next_id += 1;
        Authorization {
            fencing_token: self.token,
            operation_id: format!("op-{}", self.next_id),
        }
    }

    async fn begin(&mut self, wanted: Move) -> Result<watch::Receiver<Progress>, Error> {
        let by = self.by();
        let command = format!("{wanted:?}");
        match self.handle.begin(by, command.as_bytes(), wanted).await? {
            Accepted::Running { progress, .. } => Ok(progress),
            Accepted::Ended(operation) => panic!("ended: {operation:?}"),
        }
    }

    async fn carry_out(&mut self, wanted: Move) -> Result<Progress, Error> {
        Ok(ended(&mut self.begin(wanted).await?).await)
    }

    async fn refusal(&mut self, wanted: Move) -> String {
        self.begin(wanted).await.unwrap_err().reason().to_owned()
    }

    /// Brings the tip to a depth.
    async fn go_to_depth(&mut self, depth_mm: f64) {
        let progress = self.carry_out(insert(depth_mm)).await.unwrap();
        assert_eq!(
            progress.operation.state,
            OperationState::Done,
            "{progress:?}"
        );
    }

    async fn recover(&mut self) -> Result<(), Error> {
        let by = self.by();
        self.handle.recover_fault(by, b"recover").await
    }

    fn commands(&self) -> Vec<Command> {
        self.robot.lock().commands.clone()
    }
}

async fn ended(progress: &mut watch::Receiver<Progress>) -> Progress {
    let over = |progress: &Progress| progress.operation.state != OperationState::Running;
    progress.wait_for(over).await.unwrap().clone()
}

async fn under_way(progress: &mut watch::Receiver<Progress>) {
    progress
        .wait_for(|progress| progress.fraction > 0.1)
        .await
        .unwrap();
}

fn insert(depth_mm: f64) -> Move {
    Move::Insert {
        depth_mm,
        speed_mm_s: None,
    }
}

fn retract(depth_mm: f64) -> Move {
    Move::Retract {
        depth_mm,
        speed_mm_s: None,
    }
}

fn pivot(cell: &Cell, angle_rad: f64) -> Move {
    let pose = tool_arm().base_from_tool(&START);
    let turn = Rotation::from_axis_angle(&Vector3::y_axis(), angle_rad);
    Move::Pivot {
        aim: cell.portal + turn * shaft(&pose) * 40.0,
        speed_rad_s: None,
    }
}

fn free(cell: &Cell, depth_mm: f64, up_mm: f64) -> Move {
    let pose = tool_arm().base_from_tool(&START);
    let tip = cell.portal + shaft(&pose) * depth_mm + Vector3::z() * up_mm;
    Move::Free {
        base_from_tool: Rigid::new(pose.rotation(), tip.coords),
        speed_mm_s: None,
    }
}

fn joints(joints_rad: Joints) -> Move {
    Move::Joints {
        joints_rad,
        speed_rad_s: None,
    }
}

#[tokio::test]
async fn one_bite_goes_in_and_out_on_the_portal() {
    let mut cell = Cell::new().await;
    let steps = [
        free(&cell, -5.0, 0.0),
        pivot(&cell, 0.2),
        insert(45.0),
        retract(-5.0),
        pivot(&cell, 0.0),
        free(&cell, -60.0, 30.0),
    ];
    for (number, wanted) in steps.into_iter().enumerate() {
        let progress = cell.carry_out(wanted).await.unwrap();
        assert_eq!(
            progress.operation.state,
            OperationState::Done,
            "step {number}: {progress:?}"
        );
        assert_eq!(progress.fraction, 1.0);
        assert!(
            progress.rcm_deviation_max_mm < 1e-6,
            "step {number}: {progress:?}"
        );
        let placement = cell.state().await.placement.unwrap();
        let depth_mm = [-5.0, -5.0, 45.0, -5.0, -5.0, -60.0][number];
        if number < 5 {
            assert!(
                (placement.depth_mm - depth_mm).abs() < 1e-3,
                "step {number}: {placement:?}"
            );
        }
    }
    let state = cell.state().await;
    assert!(!state.moving && !state.inside && state.fault.is_none());
}

#[tokio::test]
async fn a_stop_reaches_the_controller_within_two_cycles() {
    let mut cell = Cell::new().await;
    cell.go_to_depth(-5.0).await;
    let mut progress = cell.begin(pivot(&cell, 0.5)).await.unwrap();
    under_way(&mut progress).await;
    let before = cell.commands().len();
    cell.handle.stop("surgeon".to_owned()).await;
    let commands = cell.commands();
    let stop = commands
        .iter()
        .position(|command| *command == Command::Stop);
    assert!(stop.unwrap() < before + 2, "{before}: {stop:?}");
    let progress = ended(&mut progress).await;
    assert_eq!(progress.operation.state, OperationState::Stopped);
    assert_eq!(progress.operation.reason, "STOP_REQUESTED");
    assert_eq!(progress.operation.detail, "surgeon");
    assert!(progress.fraction < 0.5);
    // It does not go on by itself, and a new move may begin.
    let joints_before = cell.state().await.joints_rad;
    assert_eq!(cell.state().await.joints_rad, joints_before);
    cell.carry_out(pivot(&cell, 0.1)).await.unwrap();
}

#[tokio::test]
async fn a_second_move_is_refused_while_one_runs() {
    let mut cell = Cell::new().await;
    let _first = cell.begin(insert(-5.0)).await.unwrap();
    assert_eq!(cell.refusal(insert(0.0)).await, "ARM_MOVING");
}

#[tokio::test]
async fn a_stale_token_is_refused() {
    let mut cell = Cell::new().await;
    let old = cell.token;
    cell.commander.release(old).unwrap();
    cell.token = cell.acquire();
    let newest = std::mem::replace(&mut cell.token, old);
    assert_eq!(cell.refusal(insert(-5.0)).await, "STALE_FENCING_TOKEN");
    cell.token = newest + 1;
    assert_eq!(cell.refusal(insert(-5.0)).await, "NO_LEASE");
    assert!(
        cell.commands()
            .iter()
            .all(|command| *command == Command::Hold)
    );
}

#[tokio::test]
async fn a_lease_that_expires_stops_the_arm() {
    let mut cell = Cell::new().await;
    cell.go_to_depth(-5.0).await;
    let mut progress = cell.begin(pivot(&cell, 0.5)).await.unwrap();
    under_way(&mut progress).await;
    cell.host_ms.store(2001, Ordering::SeqCst);
    let before = cell.commands().len();
    let progress = ended(&mut progress).await;
    assert_eq!(progress.operation.state, OperationState::Stopped);
    assert_eq!(progress.operation.reason, "LEASE_EXPIRED");
    let stop = cell
        .commands()
        .iter()
        .position(|command| *command == Command::Stop);
    assert!(stop.unwrap() < before + 2);
    assert_eq!(cell.refusal(insert(0.0)).await, "LEASE_EXPIRED");
}

#[tokio::test]
async fn a_renewed_lease_keeps_the_arm_moving() {
    let mut cell = Cell::new().await;
    cell.go_to_depth(-5.0).await;
    let mut progress = cell.begin(pivot(&cell, 0.5)).await.unwrap();
    under_way(&mut progress).await;
    cell.host_ms.store(1900, Ordering::SeqCst);
    cell.commander.renew(cell.token).unwrap();
    cell.host_ms.store(3800, Ordering::SeqCst);
    assert_eq!(
        ended(&mut progress).await.operation.state,
        OperationState::Done
    );
}

#[tokio::test]
async fn a_lease_is_not_released_while_an_arm_moves() {
    let mut cell = Cell::new().await;
    let mut progress = cell.begin(insert(-5.0)).await.unwrap();
    assert_eq!(
        cell.commander.release(cell.token).unwrap_err().reason(),
        "ARM_MOVING"
    );
    ended(&mut progress).await;
    cell.commander.release(cell.token).unwrap();
}

#[tokio::test]
async fn a_repeated_operation_does_not_act_again() {
    let mut cell = Cell::new().await;
    let by = cell.by();
    let first = cell
        .handle
        .begin(by.clone(), b"in", insert(-5.0))
        .await
        .unwrap();
    let Accepted::Running {
        mut progress,
        repeated: false,
    } = first
    else {
        panic!("not begun")
    };
    let again = cell
        .handle
        .begin(by.clone(), b"in", insert(-5.0))
        .await
        .unwrap();
    assert!(matches!(again, Accepted::Running { repeated: true, .. }));
    ended(&mut progress).await;
    let commands = cell.commands().len();
    let after = cell
        .handle
        .begin(by.clone(), b"in", insert(-5.0))
        .await
        .unwrap();
    let Accepted::Ended(operation) = after else {
        panic!("acted again")
    };
    assert_eq!(operation.state, OperationState::Done);
    cell.state().await;
    assert!(
        cell.commands()[commands..]
            .iter()
            .all(|command| *command == Command::Hold)
    );
    let other = cell
        .handle
        .begin(by, b"out", retract(-20.0))
        .await
        .err()
        .unwrap();
    assert_eq!(other.reason(), "OPERATION_ID_REUSED");
}

#[tokio::test]
async fn a_call_that_is_dropped_does_not_stop_its_move() {
    let mut cell = Cell::new().await;
    let by = cell.by();
    let id = by.operation_id.clone();
    drop(
        cell.handle
            .begin(by.clone(), b"in", insert(-5.0))
            .await
            .unwrap(),
    );
    cell.published(|published| {
        let state = published.state.as_ref().unwrap();
        state.operation_id.as_ref() == Some(&id)
    })
    .await;
    let Accepted::Running { mut progress, .. } =
        cell.handle.begin(by, b"in", insert(-5.0)).await.unwrap()
    else {
        panic!("ended")
    };
    assert_eq!(
        ended(&mut progress).await.operation.state,
        OperationState::Done
    );
}

#[tokio::test]
async fn moves_outside_are_refused_while_inside() {
    let mut cell = Cell::new().await;
    cell.go_to_depth(10.0).await;
    assert_eq!(cell.refusal(free(&cell, -60.0, 0.0)).await, "TOOL_INSIDE");
    assert_eq!(cell.refusal(joints(START)).await, "TOOL_INSIDE");
    let by = cell.by();
    let portal = cell.portal;
    let refusal = cell.handle.set_portal(by, b"", portal).await.unwrap_err();
    assert_eq!(refusal.reason(), "TOOL_INSIDE");
    assert!(cell.state().await.inside);
}

#[tokio::test]
async fn a_way_outside_that_leads_inside_is_refused() {
    let mut cell = Cell::new().await;
    assert_eq!(
        cell.refusal(free(&cell, 20.0, 0.0)).await,
        "WAY_LEADS_INSIDE"
    );
    let pose = tool_arm().base_from_tool(&START);
    let inside = Rigid::new(pose.rotation(), (cell.portal + shaft(&pose) * 20.0).coords);
    let inside = tool_arm().joints(&inside, &START).unwrap();
    assert_eq!(cell.refusal(joints(inside)).await, "WAY_LEADS_INSIDE");
}

#[tokio::test]
async fn an_insertion_beside_the_portal_is_refused() {
    let mut cell = Cell::new().await;
    let wanted = free(&cell, -5.0, 1.5);
    cell.carry_out(wanted).await.unwrap();
    assert_eq!(cell.refusal(insert(10.0)).await, "SHAFT_OFF_PORTAL");
    assert_eq!(cell.refusal(pivot(&cell, 0.1)).await, "SHAFT_OFF_PORTAL");
}

#[tokio::test]
async fn an_insertion_slightly_off_the_portal_regains_it() {
    let mut cell = Cell::new().await;
    let wanted = free(&cell, -20.0, 0.5);
    cell.carry_out(wanted).await.unwrap();
    let progress = cell.carry_out(insert(40.0)).await.unwrap();
    assert!(progress.rcm_deviation_max_mm < 1e-6, "{progress:?}");
}

#[tokio::test]
async fn moves_through_the_portal_need_one() {
    let robot = FakeRobot::new(tool_arm(), START);
    let mut cell = Cell::with(robot, None, Point3::new(700.0, 0.0, 265.0));
    cell.connected().await;
    cell.token = cell.acquire();
    for wanted in [insert(5.0), retract(-5.0), pivot(&cell, 0.1)] {
        assert_eq!(cell.refusal(wanted).await, "PORTAL_NOT_SET");
    }
    let by = cell.by();
    let portal = tool_arm().base_from_tool(&START);
    let portal = portal.origin() + shaft(&portal) * 80.0;
    cell.handle.set_portal(by, b"", portal).await.unwrap();
    cell.carry_out(insert(-5.0)).await.unwrap();
}

/// A service that was restarted with the tool inside knows it as soon as it is told the portal, and not a cycle later.
#[tokio::test]
async fn a_portal_that_is_stated_with_the_tool_inside_finds_it_inside_at_once() {
    let robot = FakeRobot::new(tool_arm(), START);
    let pose = tool_arm().base_from_tool(&START);
    let behind_the_tip = pose.origin() - shaft(&pose) * 30.0;
    let mut cell = Cell::with(robot, None, behind_the_tip);
    cell.connected().await;
    cell.token = cell.acquire();
    let by = cell.by();
    cell.handle
        .set_portal(by, b"", behind_the_tip)
        .await
        .unwrap();
    // What is published with the answer, without waiting for another state.
    let state = cell.handle.published().borrow().state.clone().unwrap();
    assert!(state.inside, "{:?}", state.placement);
    assert_eq!(cell.refusal(free(&cell, -60.0, 0.0)).await, "TOOL_INSIDE");
    cell.carry_out(retract(-5.0)).await.unwrap();
    assert!(!cell.state().await.inside);
}

#[tokio::test]
async fn a_tip_beyond_a_portal_is_inside_as_soon_as_the_portal_is_stated() {
    let robot = FakeRobot::new(tool_arm(), START);
    let pose = tool_arm().base_from_tool(&START);
    let portal = pose.origin() - shaft(&pose) * 20.0;
    let mut cell = Cell::with(robot, None, portal);
    cell.connected().await;
    cell.token = cell.acquire();
    let mut published = cell.handle.published();
    let with_portal = published.wait_for(|published| published.portal.is_some());
    let by = cell.by();
    let (stated, seen) = tokio::join!(cell.handle.set_portal(by, b"", portal), with_portal);
    stated.unwrap();
    assert!(seen.unwrap().state.as_ref().unwrap().inside);
}

#[tokio::test]
async fn depths_and_directions_are_limited() {
    let mut cell = Cell::new().await;
    assert_eq!(cell.refusal(insert(80.5)).await, "TOO_DEEP");
    assert_eq!(cell.refusal(insert(-85.0)).await, "WRONG_DIRECTION");
    assert_eq!(cell.refusal(retract(-75.0)).await, "WRONG_DIRECTION");
    assert_eq!(cell.refusal(pivot(&cell, 1.6)).await, "TURN_TOO_WIDE");
}

#[tokio::test]
async fn what_cannot_be_reached_is_refused_before_anything_moves() {
    let mut cell = Cell::new().await;
    let far = Move::Free {
        base_from_tool: Rigid::new(Rotation::identity(), Vector3::new(1500.0, 0.0, 300.0)),
        speed_mm_s: None,
    };
    assert_eq!(cell.refusal(far).await, "OUT_OF_REACH");
    assert_eq!(
        cell.refusal(joints([0.0, 0.0, 3.2, 0.0, 0.0, 0.0])).await,
        "JOINT_LIMIT"
    );
    assert!(
        cell.commands()
            .iter()
            .all(|command| *command == Command::Hold)
    );
}

#[tokio::test]
async fn a_free_move_by_half_a_turn_is_refused() {
    let mut cell = Cell::new().await;
    let pose = tool_arm().base_from_tool(&START);
    for axis in [Vector3::x_axis(), -Vector3::x_axis()] {
        let half = Rotation::from_axis_angle(&axis, std::f64::consts::PI);
        let wanted = Move::Free {
            base_from_tool: Rigid::new(pose.rotation() * half, pose.translation_mm()),
            speed_mm_s: None,
        };
        assert_eq!(cell.refusal(wanted).await, "TURN_TOO_WIDE");
    }
}

#[tokio::test]
async fn a_breach_stops_the_arm_and_is_latched_until_recovered() {
    let mut cell = Cell::new().await;
    cell.go_to_depth(30.0).await;
    let mut progress = cell.begin(insert(60.0)).await.unwrap();
    under_way(&mut progress).await;
    // Half a degree at the base is some 6 mm at the portal.
    cell.robot.lock().encoder_error[0] = 0.008;
    let progress = ended(&mut progress).await;
    {
        let mut robot = cell.robot.lock();
        robot.joints[0] += std::mem::take(&mut robot.encoder_error[0]);
    }
    assert_eq!(progress.operation.state, OperationState::Failed);
    assert_eq!(progress.operation.reason, "RCM_DEVIATION");
    assert!(
        progress.rcm_deviation_max_mm < 1.0,
        "told of the way until the breach"
    );
    let fault = cell.state().await.fault.unwrap();
    assert_eq!(fault.reason, "RCM_DEVIATION");
    assert!(fault.detail.contains("limit 1.000 mm"), "{}", fault.detail);
    assert_eq!(cell.refusal(insert(60.0)).await, "FAULT_LATCHED");
    assert_eq!(cell.commands().last(), Some(&Command::Stop));
    cell.recover().await.unwrap();
    assert_eq!(cell.state().await.fault, None);
    // The shaft stays where it is: only drawing back is open, along its own line.
    assert_eq!(cell.refusal(insert(60.0)).await, "RETRACT_ONLY");
    let progress = cell.carry_out(retract(-5.0)).await.unwrap();
    assert_eq!(
        progress.operation.state,
        OperationState::Done,
        "{progress:?}"
    );
    assert!(!cell.state().await.inside);
}

#[tokio::test]
async fn a_protective_stop_is_not_recovered_while_it_lasts() {
    let mut cell = Cell::new().await;
    let mut progress = cell.begin(insert(-5.0)).await.unwrap();
    under_way(&mut progress).await;
    cell.robot.lock().safety_mode = SafetyMode::ProtectiveStop;
    let progress = ended(&mut progress).await;
    assert_eq!(progress.operation.reason, "SAFETY_MODE");
    assert_eq!(cell.recover().await.unwrap_err().reason(), "SAFETY_MODE");
    cell.robot.lock().safety_mode = SafetyMode::Normal;
    cell.state().await;
    cell.recover().await.unwrap();
    cell.carry_out(insert(-5.0)).await.unwrap();
}

#[tokio::test]
async fn a_gap_in_the_states_stops_a_move() {
    let mut cell = Cell::new().await;
    let mut progress = cell.begin(insert(-5.0)).await.unwrap();
    under_way(&mut progress).await;
    cell.robot.lock().gap_s = 0.2;
    assert_eq!(ended(&mut progress).await.operation.reason, "STATE_STALE");
}

#[tokio::test]
async fn a_program_that_ends_stops_a_move_and_is_started_again() {
    let mut cell = Cell::new().await;
    let mut progress = cell.begin(insert(-5.0)).await.unwrap();
    under_way(&mut progress).await;
    {
        let mut robot = cell.robot.lock();
        robot.program = ProgramState::default();
        robot.runtime_state = RuntimeState::Stopped;
    }
    assert_eq!(ended(&mut progress).await.operation.reason, "PROGRAM_ENDED");
    assert_eq!(cell.robot.lock().links_made, 1);
    assert_eq!(cell.recover().await, Ok(()));
    let mut published = cell.handle.published();
    published
        .wait_for(|published| !published.connected)
        .await
        .unwrap();
    cell.connected().await;
    assert_eq!(cell.robot.lock().links_made, 2);
    cell.carry_out(insert(-5.0)).await.unwrap();
}

#[tokio::test]
async fn a_link_lost_in_a_move_is_a_fault_and_a_new_link_moves_nothing() {
    let mut cell = Cell::new().await;
    let mut progress = cell.begin(insert(-5.0)).await.unwrap();
    under_way(&mut progress).await;
    cell.robot.lock().unreachable = true;
    let progress = ended(&mut progress).await;
    assert_eq!(progress.operation.state, OperationState::InDoubt);
    assert_eq!(progress.operation.reason, "LINK_LOST");
    let published = cell.published(|published| !published.connected).await;
    let last = published.state.unwrap();
    assert_eq!(last.fault.unwrap().reason, "LINK_LOST");
    assert!(!last.connected && last.operation_id.is_none());
    assert_eq!(cell.refusal(insert(-5.0)).await, "NOT_CONNECTED");
    cell.handle.stop("nobody listens".to_owned()).await;
    let sent = cell.commands().len();
    cell.robot.lock().unreachable = false;
    cell.connected().await;
    assert_eq!(cell.refusal(insert(-5.0)).await, "FAULT_LATCHED");
    cell.state().await;
    assert!(
        cell.commands()[sent..]
            .iter()
            .all(|command| *command == Command::Stop)
    );
    cell.recover().await.unwrap();
    cell.carry_out(insert(-5.0)).await.unwrap();
}

#[tokio::test]
async fn an_arm_out_of_reach_of_the_network_answers() {
    let robot = FakeRobot::new(tool_arm(), START);
    robot.lock().unreachable = true;
    let mut cell = Cell::with(robot, None, Point3::origin());
    cell.token = cell.acquire();
    assert_eq!(cell.refusal(insert(1.0)).await, "NOT_CONNECTED");
    cell.handle.stop("just in case".to_owned()).await;
    assert_eq!(cell.recover().await.unwrap_err().reason(), "NOT_CONNECTED");
}

#[tokio::test]
async fn the_speed_slider_stretches_a_stream() {
    let mut cell = Cell::new().await;
    cell.go_to_depth(-5.0).await;
    let began_s = cell.robot.lock().time_s;
    cell.carry_out(pivot(&cell, 0.2)).await.unwrap();
    let full_s = cell.robot.lock().time_s - began_s;
    cell.robot.lock().scaling = 0.5;
    let began_s = cell.robot.lock().time_s;
    cell.carry_out(pivot(&cell, 0.0)).await.unwrap();
    let half_s = cell.robot.lock().time_s - began_s;
    assert!(
        (half_s / full_s - 2.0).abs() < 0.1,
        "{full_s} s, {half_s} s"
    );
}

#[tokio::test]
async fn a_stream_never_steps_and_a_slider_at_zero_holds_it() {
    let mut cell = Cell::new().await;
    let mut progress = cell.begin(insert(-5.0)).await.unwrap();
    under_way(&mut progress).await;
    cell.robot.lock().scaling = 0.0;
    let now_s = cell.robot.lock().time_s;
    let later = |published: &Published| published.state.as_ref().unwrap().time_s > now_s + 2.0;
    cell.published(later).await;
    let held = progress.borrow().fraction;
    cell.published(|published| published.state.as_ref().unwrap().time_s > now_s + 4.0)
        .await;
    assert_eq!(progress.borrow().fraction, held);
    cell.robot.lock().scaling = 1.0;
    assert_eq!(
        ended(&mut progress).await.operation.state,
        OperationState::Done
    );
    let streamed = cell.robot.lock().followed.clone();
    for pair in streamed.windows(2) {
        let step = crate::kinematics::largest_difference(&pair[0], &pair[1]).1;
        assert!(step <= 1.0 * PERIOD_S, "{step}");
    }
}

#[tokio::test]
async fn an_owner_whose_handles_are_gone_stops_the_arm_and_ends() {
    let mut cell = Cell::new().await;
    let mut progress = cell.begin(insert(-5.0)).await.unwrap();
    under_way(&mut progress).await;
    let Cell { handle, owner, .. } = cell;
    drop(handle);
    assert_eq!(ended(&mut progress).await.operation.reason, "SHUTTING_DOWN");
    owner.await.unwrap();
}

#[tokio::test]
async fn the_first_outcome_of_an_operation_stands() {
    let mut cell = Cell::new().await;
    let by = cell.by();
    let refused = cell.handle.begin(by.clone(), b"deep", insert(99.0)).await;
    assert_eq!(refused.err().unwrap().reason(), "TOO_DEEP");
    let Accepted::Ended(operation) = cell
        .handle
        .begin(by.clone(), b"deep", insert(99.0))
        .await
        .unwrap()
    else {
        panic!("acted")
    };
    assert_eq!(
        (operation.state, &*operation.reason),
        (OperationState::Failed, "TOO_DEEP")
    );
    let detail = String::new();
    let first = cell
        .commander
        .finish(&by.operation_id, Outcome::Done { detail });
    assert_eq!(first.state, OperationState::Failed);
}
