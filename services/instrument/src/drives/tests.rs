mod bite;
mod fake;
mod requests;
mod switches;

use arthro_authority::OperationState;
use epos4_link::cia402::State;
use epos4_link::objects;
use tokio::task::JoinHandle;

use self::fake::FakeCell;
use super::*;
use crate::config::Config;

/// Node ids of the axes.
const FORCEPS_ROTATION: usize = 1;
const FORCEPS_FEED: usize = 2;
const QC_PER_MM: f64 = 21_504.0;

/// The service over four fake drives.
struct World {
    cell: FakeCell,
    handle: Handle,
    token: u64,
    operations: u32,
    owner: JoinHandle<()>,
}

impl World {
    /// All drives ready, and a lease.
    async fn ready() -> Self {
        let mut world = Self::start(FakeCell::start());
        for axis in Axis::ALL {
            world
                .until(|state| state.axes[axis.index()].readiness == Readiness::Ready)
                .await;
        }
        world.token = world
            .handle
            .acquire("test".into(), Duration::from_secs(60))
            .await
            .unwrap()
            .fencing_token;
        world
    }

    /// Ready, and every axis has its reference.
    async fn homed() -> Self {
        let mut world = Self::ready().await;
        let home = world.run(Command::Home(Axis::ALL.to_vec())).await;
        assert_eq!(home.operation.state, OperationState::Done, "{home:?}");
        world
    }

    fn start(cell: FakeCell) -> Self {
        let mut config = Config {
            sdo_timeout_s: 3.0,
            ..Config::default()
        };
        config.bite.force_table = vec![[40.0, 0.0], [100.0, 15.0], [760.0, 270.0]];
        let bus = cell.clone();
        let connector = move || -> std::pin::Pin<Box<dyn Future<Output = Connected> + Send>> {
            let bus = bus.clone();
            Box::pin(async move { Ok(bus.attach()) })
        };
        let (drives, handle) = Drives::with_connector(config.check().unwrap(), Box::new(connector));
        let owner = tokio::spawn(drives.run(Drain::never()));
        Self {
            cell,
            handle,
            token: 0,
            operations: 0,
            owner,
        }
    }

    fn authorization(&mut self) -> Authorization {
        self.operations += 1;
        Authorization {
            fencing_token: self.token,
            operation_id: format!("operation-{}", self.operations),
        }
    }

    async fn begin(&mut self, command: Command) -> Result<Ticket, Refusal> {
        let authorization = self.authorization();
        self.handle.command(authorization, command).await
    }

    async fn run(&mut self, command: Command) -> Report {
        self.begin(command).await.unwrap().ended().await.unwrap()
    }

    async fn feed_to(&mut self, target: f64) -> Report {
        self.run(Command::Move {
            axis: Axis::ForcepsFeed,
            target,
        })
        .await
    }

    /// The word of a refused command.
    async fn reason(&mut self, command: Command) -> String {
        let status = tonic::Status::from(self.begin(command).await.unwrap_err());
        arthro_bootstrap::status::reason(&status).unwrap()
    }

    /// Waits until the state is as wanted.
    async fn until(&self, wanted: impl Fn(&Snapshot) -> bool) {
        let mut states = self.handle.states();
        let reached = tokio::time::timeout(
            Duration::from_secs(30),
            states.wait_for(|state| wanted(state)),
        )
        .await;
        assert!(reached.is_ok(), "{:#?}", self.handle.snapshot());
    }

    fn fault(&self, axis: Axis) -> &'static str {
        self.handle.snapshot().axes[axis.index()]
            .fault
            .as_ref()
            .map_or("", |fault| fault.reason)
    }

    /// A move that has begun and all but stands until the drives' time goes on.
    async fn long_move(&mut self) -> Ticket {
        self.cell.set_micros_per_request(1);
        let ticket = self
            .begin(Command::Move {
                axis: Axis::ForcepsFeed,
                target: 14.0,
            })
            .await
            .unwrap();
        self.cell
            .until(FORCEPS_FEED, |drive| !drive.targets_qc.is_empty())
            .await;
        ticket
    }
}

impl Drop for World {
    fn drop(&mut self) {
        self.owner.abort();
    }
}

const MOVE_ROTATION: Command = Command::Move {
    axis: Axis::ForcepsRotation,
    target: 90.0,
};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn drives_are_set_up_and_none_is_switched_on() {
    let world = World::ready().await;
    let state = world.handle.snapshot();
    assert_eq!(state.axes[1].identity.unwrap().serial_number, 1002);
    assert_eq!(state.jaw, Jaw::Unknown);
    for node_id in 1..=4 {
        let drive = world.cell.drive(node_id);
        assert_eq!(
            (drive.state, drive.controlwords.len()),
            (State::SwitchOnDisabled, 0)
        );
        assert_eq!(drive.get(objects::PRODUCER_HEARTBEAT), 100);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_drive_of_another_kind_is_not_commanded() {
    let cell = FakeCell::start();
    cell.change(FORCEPS_FEED, |drive| {
        drive.set(objects::PRODUCT_CODE, 0x6150_0000)
    });
    let mut world = World::start(cell);
    let why = "product code (0x1018:02) is 0x61500000, configured is 0x60500000";
    world
        .until(|state| state.axes[1].readiness == Readiness::NotReady(why.to_owned()))
        .await;
    world
        .until(|state| state.axes[0].readiness == Readiness::Ready)
        .await;
    world.token = world
        .handle
        .acquire("test".into(), Duration::from_secs(60))
        .await
        .unwrap()
        .fencing_token;
    assert_eq!(
        world.reason(Command::Home(vec![Axis::ForcepsFeed])).await,
        "AXIS_NOT_READY"
    );
    assert!(world.cell.drive(FORCEPS_FEED).controlwords.is_empty());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_axis_without_reference_moves_only_to_find_it() {
    let mut world = World::ready().await;
    assert_eq!(world.reason(MOVE_ROTATION).await, "NOT_HOMED");
    assert_eq!(world.reason(Command::OpenJaw).await, "NOT_HOMED");
    let home = world.run(Command::Home(vec![Axis::ForcepsFeed])).await;
    assert_eq!(home.operation.detail, "forceps_feed at -1.000 mm");
    assert_eq!(world.handle.snapshot().jaw, Jaw::Open);
    let moved = world.feed_to(3.0).await;
    assert_eq!(
        (moved.operation.state, &*moved.operation.detail),
        (OperationState::Done, "forceps_feed at 3.000 mm")
    );
    let drive = world.cell.drive(FORCEPS_FEED);
    assert_eq!(drive.targets_qc, [64_512]);
    assert_eq!(drive.get(objects::PROFILE_VELOCITY), 6_300);
    assert_eq!(
        drive.get(objects::MAX_POSITION_LIMIT),
        (14.15 * QC_PER_MM).round() as i32
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_search_for_a_switch_that_no_input_has_is_refused_before_the_motor_obeys() {
    let mut world = World::ready().await;
    world.cell.change(FORCEPS_FEED, |drive| {
        drive.set(objects::digital_input_function(1), 255)
    });
    let home = world.run(Command::Home(vec![Axis::ForcepsFeed])).await;
    assert_eq!(home.operation.reason, "HOMING_SWITCH_NOT_MAPPED");
    assert_ne!(
        world.cell.drive(FORCEPS_FEED).state,
        State::OperationEnabled
    );
    assert_eq!(world.fault(Axis::ForcepsFeed), "");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn only_the_holder_of_the_lease_commands() {
    let mut world = World::homed().await;
    world.handle.release(world.token).await.unwrap();
    assert_eq!(world.reason(MOVE_ROTATION).await, "NO_LEASE");
    let newer = world
        .handle
        .acquire("other".into(), Duration::from_secs(60))
        .await
        .unwrap()
        .fencing_token;
    assert!(newer > world.token);
    assert_eq!(world.reason(MOVE_ROTATION).await, "STALE_FENCING_TOKEN");
    assert!(world.cell.drive(FORCEPS_ROTATION).targets_qc.is_empty());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_repeated_operation_is_answered_and_does_not_act_again() {
    let mut world = World::homed().await;
    let authorization = world.authorization();
    let mut first = world
        .handle
        .command(authorization.clone(), MOVE_ROTATION)
        .await
        .unwrap();
    let mut again = world
        .handle
        .command(authorization.clone(), MOVE_ROTATION)
        .await
        .unwrap();
    assert!(!first.repeated && again.repeated);
    assert_eq!(first.ended().await, again.ended().await);
    let mut later = world
        .handle
        .command(authorization.clone(), MOVE_ROTATION)
        .await
        .unwrap();
    assert_eq!(
        later.ended().await.unwrap().operation.state,
        OperationState::Done
    );
    assert_eq!(world.cell.drive(FORCEPS_ROTATION).targets_qc, [10_752]);
    let other = Command::Move {
        axis: Axis::ForcepsRotation,
        target: 91.0,
    };
    let refused = world
        .handle
        .command(authorization, other)
        .await
        .unwrap_err();
    assert!(matches!(
        refused,
        Refusal::Authority(arthro_authority::Refusal::OperationIdReused { .. })
    ));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_motion_goes_on_when_nobody_watches_it() {
    let mut world = World::homed().await;
    drop(world.long_move().await);
    assert_eq!(world.reason(Command::OpenJaw).await, "AXIS_MOVING");
    let refused = world.handle.release(world.token).await.unwrap_err();
    world.cell.set_micros_per_request(1000);
    assert!(matches!(
        refused,
        Refusal::AxisMoving {
            axis: Axis::ForcepsFeed,
            ..
        }
    ));
    world
        .cell
        .until(FORCEPS_FEED, |drive| drive.position_qc == 14.0 * QC_PER_MM)
        .await;
    world.until(|state| !state.axes[1].moving).await;
    assert_eq!(
        world.cell.drive(FORCEPS_FEED).state,
        State::OperationEnabled
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn stop_needs_no_lease_and_ends_every_motion() {
    let mut world = World::homed().await;
    let mut ticket = world.long_move().await;
    world.handle.stop("the operator".into()).await.unwrap();
    let stopped = ticket.ended().await.unwrap().operation;
    assert_eq!(
        (stopped.state, &*stopped.reason),
        (OperationState::Stopped, "STOPPED")
    );
    assert_eq!(stopped.detail, "stopped: the operator");
    let drive = world.cell.drive(FORCEPS_FEED);
    assert_eq!(
        (drive.state, drive.controlwords.last()),
        (State::QuickStopActive, Some(&0x0002))
    );
    assert!(drive.position_qc < 14.0 * QC_PER_MM);
    assert_eq!(world.handle.snapshot().jaw, Jaw::Unknown);
    // Nothing goes on by itself; a new command does.
    world.cell.set_micros_per_request(1000);
    let moved = world.feed_to(2.0).await;
    assert_eq!(moved.operation.state, OperationState::Done);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_lost_lease_quick_stops_the_drives() {
    let mut world = World::homed().await;
    world.handle.release(world.token).await.unwrap();
    world.token = world
        .handle
        .acquire("short".into(), Duration::from_millis(200))
        .await
        .unwrap()
        .fencing_token;
    assert_eq!(
        world.cell.drive(FORCEPS_FEED).state,
        State::OperationEnabled,
        "homing left it so"
    );
    for node_id in 1..=4 {
        world
            .cell
            .until(node_id, |drive| drive.state == State::QuickStopActive)
            .await;
    }
    assert_eq!(world.reason(MOVE_ROTATION).await, "LEASE_EXPIRED");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_lost_heartbeat_stops_the_others_and_stays_until_it_is_recovered() {
    let mut world = World::homed().await;
    let mut ticket = world.long_move().await;
    world
        .cell
        .change(FORCEPS_ROTATION, |drive| drive.dead = true);
    world.cell.set_micros_per_request(1000);
    let ended = ticket.ended().await.unwrap().operation;
    assert_eq!(
        (ended.state, &*ended.reason),
        (OperationState::Failed, "HEARTBEAT_LOST")
    );
    world
        .cell
        .until(FORCEPS_FEED, |drive| drive.state == State::QuickStopActive)
        .await;
    world
        .until(|state| state.axes[0].readiness != Readiness::Ready)
        .await;
    world
        .cell
        .change(FORCEPS_ROTATION, |drive| drive.dead = false);
    world
        .until(|state| state.axes[0].readiness == Readiness::Ready)
        .await;
    assert_eq!(
        world.fault(Axis::ForcepsRotation),
        "HEARTBEAT_LOST",
        "it does not go by itself"
    );
    assert_eq!(world.reason(MOVE_ROTATION).await, "AXIS_FAULTED");
    let recovered = world.run(Command::Recover(Axis::ALL.to_vec())).await;
    assert_eq!(recovered.operation.state, OperationState::Done);
    assert_eq!(
        world.run(MOVE_ROTATION).await.operation.state,
        OperationState::Done
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_emergency_is_latched_and_a_fault_that_persists_is_not_recovered() {
    let mut world = World::homed().await;
    world.cell.fault(FORCEPS_FEED, 0x2310);
    world.until(|state| state.axes[1].fault.is_some()).await;
    assert_eq!(world.fault(Axis::ForcepsFeed), "OVERCURRENT");
    world
        .cell
        .until(FORCEPS_ROTATION, |drive| {
            drive.state == State::QuickStopActive
        })
        .await;
    world
        .handle
        .stop("wait until the quick stop is over".into())
        .await
        .unwrap();
    world
        .cell
        .change(FORCEPS_FEED, |drive| drive.fault_persists = true);
    let failed = world.run(Command::Recover(vec![Axis::ForcepsFeed])).await;
    assert_eq!(failed.operation.reason, "OVERCURRENT");
    assert_eq!(world.fault(Axis::ForcepsFeed), "OVERCURRENT");
    world
        .cell
        .change(FORCEPS_FEED, |drive| drive.fault_persists = false);
    let recovered = world.run(Command::Recover(vec![Axis::ForcepsFeed])).await;
    assert_eq!(recovered.operation.state, OperationState::Done);
    assert_eq!(
        world.cell.drive(FORCEPS_FEED).state,
        State::SwitchOnDisabled,
        "nothing is switched on by that"
    );
    assert_eq!(
        world.feed_to(1.0).await.operation.state,
        OperationState::Done
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_drive_that_restarts_has_a_fault_and_no_reference() {
    let mut world = World::homed().await;
    let mut ticket = world.long_move().await;
    world.cell.restart(FORCEPS_FEED);
    world.cell.set_micros_per_request(1000);
    assert_eq!(
        ticket.ended().await.unwrap().operation.reason,
        "UNEXPECTED_BOOT_UP"
    );
    world
        .until(|state| state.axes[1].readiness == Readiness::Ready)
        .await;
    world
        .handle
        .stop("wait until the quick stop is over".into())
        .await
        .unwrap();
    assert_eq!(world.reason(Command::OpenJaw).await, "AXIS_FAULTED");
    world.run(Command::Recover(vec![Axis::ForcepsFeed])).await;
    assert_eq!(world.reason(Command::OpenJaw).await, "NOT_HOMED");
    assert_eq!(world.handle.snapshot().jaw, Jaw::Unknown);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_statusword_that_no_standard_knows_is_a_fault() {
    let mut world = World::homed().await;
    let mut ticket = world.long_move().await;
    world
        .cell
        .change(FORCEPS_FEED, |drive| drive.statusword = Some(0x006F));
    assert_eq!(
        ticket.ended().await.unwrap().operation.reason,
        "UNKNOWN_STATUSWORD"
    );
    assert_eq!(world.fault(Axis::ForcepsFeed), "UNKNOWN_STATUSWORD");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_silent_bus_is_a_fault_of_every_axis_and_stop_says_that_it_cannot() {
    let world = World::homed().await;
    for node_id in 1..=4 {
        world.cell.change(node_id, |drive| drive.dead = true);
    }
    world
        .until(|state| state.axes.iter().all(|axis| axis.fault.is_some()))
        .await;
    let refused = world.handle.stop("nobody hears".into()).await.unwrap_err();
    assert!(matches!(refused, Refusal::StopNotConfirmed(_)), "{refused}");
}

#[tokio::test]
async fn the_service_starts_without_a_bus_and_says_so() {
    let unused = std::net::TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    let config = Config {
        bus: format!("socketcand://{unused}/can0"),
        ..Config::default()
    };
    let (drives, handle) = Drives::new(config.check().unwrap());
    let owner = tokio::spawn(drives.run(Drain::never()));
    let lease = handle
        .acquire("test".into(), Duration::from_secs(60))
        .await
        .unwrap();
    let authorization = Authorization {
        fencing_token: lease.fencing_token,
        operation_id: "home".into(),
    };
    let refused = handle
        .command(authorization, Command::Home(vec![Axis::ForcepsFeed]))
        .await
        .unwrap_err();
    assert!(matches!(refused, Refusal::AxisNotReady { .. }));
    let status = tonic::Status::from(handle.stop("test".into()).await.unwrap_err());
    assert_eq!(
        arthro_bootstrap::status::reason(&status).as_deref(),
        Some("STOP_NOT_CONFIRMED")
    );
    owner.abort();
}
