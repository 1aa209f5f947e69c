mod api;
mod bite;
mod fake;
mod faults;
mod lease;
mod motion;
mod set_up;
mod stop;

use std::sync::atomic::{AtomicU32, Ordering};

use arthro_authority::OperationState;
use arthro_proto::instrument::v1 as proto;
use arthro_proto::instrument::v1::axis_position::Value as Position;
use arthro_proto::instrument::v1::instrument_service_server::InstrumentService as _;
use epos4_link::canopen::object::Address;
use epos4_link::canopen::sdo::AbortCode;
use epos4_link::cia402::State;
use epos4_link::objects;
use tokio::task::JoinHandle;
use tonic::Code;

use self::fake::FakeCell;
use super::session::Connected;
use super::*;
use crate::config::Config;
use crate::server::Instrument;

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
    owner: JoinHandle<()>,
}

struct ToFake(FakeCell, Arc<AtomicU32>);

impl Way for ToFake {
    fn connect(&self) -> std::pin::Pin<Box<dyn Future<Output = Connected> + Send>> {
        let cell = self.0.clone();
        Box::pin(async move { Ok(cell.attach()) })
    }

    fn restart(&self) -> Result<(), epos4_link::bus::Error> {
        self.1.fetch_add(1, Ordering::Relaxed);
        Ok(())
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
        let config = Config {
            sdo_timeout_s: 3.0,
            ..Config::default()
        };
        let restarts = Arc::new(AtomicU32::new(0));
        let way = ToFake(cell.clone(), restarts.clone());
        let (drives, handle) = Drives::with_way(config.check().unwrap(), Box::new(way));
        let owner = tokio::spawn(drives.run(Drain::never()));
        Self {
            cell,
            handle,
            token: 0,
            operations: 0,
            restarts,
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
