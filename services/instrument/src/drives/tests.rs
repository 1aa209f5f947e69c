mod bite;
mod bus;
mod fake;
mod faults;
mod hostile;
mod lease;
mod motion;
mod process_data;
mod requests;
mod set_up;
mod stop;
mod switches;

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use arthro_authority::OperationState;
use epos4_link::bus::CanBus;
use epos4_link::cia402::State;
use epos4_link::frame::{Frame, Stamped};
use epos4_link::objects;
use tokio::task::JoinHandle;

use self::fake::FakeCell;
use super::session::Connected;
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
    /// How often the controller was restarted.
    restarts: Arc<AtomicU32>,
    /// Whether the bus takes no frames.
    is_choked: Arc<AtomicBool>,
    shut_down: Option<oneshot::Sender<()>>,
    owner: JoinHandle<()>,
}

struct ToFake {
    cell: FakeCell,
    restarts: Arc<AtomicU32>,
    is_choked: Arc<AtomicBool>,
}

impl Way for ToFake {
    fn connect(&self) -> std::pin::Pin<Box<dyn Future<Output = Connected> + Send>> {
        let port = Port {
            bus: self.cell.attach(),
            is_choked: self.is_choked.clone(),
        };
        Box::pin(async move { Ok(Box::new(port) as Box<dyn CanBus>) })
    }

    fn restart(&self) -> Result<(), epos4_link::bus::Error> {
        self.restarts.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }
}

/// A port of the fake bus that can be made to take no frames.
struct Port {
    bus: Box<dyn CanBus>,
    is_choked: Arc<AtomicBool>,
}

impl CanBus for Port {
    fn send(&mut self, frame: Frame) -> Result<(), epos4_link::bus::Error> {
        if self.is_choked.load(Ordering::Relaxed) {
            return Err(epos4_link::bus::Error::QueueFull);
        }
        self.bus.send(frame)
    }

    fn poll_receive(
        &mut self,
        context: &mut std::task::Context<'_>,
    ) -> std::task::Poll<Result<Stamped, epos4_link::bus::Error>> {
        self.bus.poll_receive(context)
    }
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
        let restarts = Arc::new(AtomicU32::new(0));
        let is_choked = Arc::new(AtomicBool::new(false));
        let way = ToFake {
            cell: cell.clone(),
            restarts: restarts.clone(),
            is_choked: is_choked.clone(),
        };
        let (drives, handle) = Drives::with_way(config.check().unwrap(), Box::new(way));
        let (shut_down, draining) = oneshot::channel::<()>();
        let owner = tokio::spawn(drives.run_until(async move {
            draining.await.ok();
        }));
        Self {
            cell,
            handle,
            token: 0,
            operations: 0,
            restarts,
            is_choked,
            shut_down: Some(shut_down),
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

    fn faults(&self) -> [&'static str; 4] {
        Axis::ALL.map(|axis| self.fault(axis))
    }

    async fn until_all_have(&self, reason: &str) {
        self.until(|state| {
            let mut axes = state.axes.iter();
            axes.all(|axis| {
                axis.fault
                    .as_ref()
                    .is_some_and(|fault| fault.reason == reason)
            })
        })
        .await;
    }

    async fn until_ready(&self) {
        self.until(|state| {
            let mut axes = state.axes.iter();
            axes.all(|axis| axis.readiness == Readiness::Ready)
        })
        .await;
    }

    async fn recover_all(&mut self) -> OperationState {
        let report = self.run(Command::Recover(Axis::ALL.to_vec())).await;
        report.operation.state
    }

    /// A move that has begun and all but stands until the drives' time goes on.
    async fn long_move(&mut self) -> Ticket {
        self.cell.hold_time();
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
