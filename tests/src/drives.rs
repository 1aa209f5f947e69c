//! The world of the tests that cross the instrument service and the simulated drives: the service's owner of the drives
//! and the drives of the bench in one process, with a socketcand connection between them, about ten times as fast as the
//! wall clock, and the truth beside.
//!
//! ```ignore
//! alone(async {
//!     let mut world = DriveWorld::up(JawConfig::default()).await;
//!     world.home_all().await;
//!     let report = world.run(Command::Bite { current_limit_ma: 400.0 }).await;
//!     assert!(world.truth().jaw_gap_mm < 0.3);
//! });
//! ```

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use arthro_authority::OperationState;
use arthro_bootstrap::Drain;
use arthro_instrument::axis::Axis;
use arthro_instrument::bite::Jaw;
use arthro_instrument::config::Config;
use arthro_instrument::drives::{
    Authorization, Command, Drives, Handle, Readiness, Report, Snapshot, Ticket,
};
use arthro_instrument::error::Refusal;
use arthro_simulator::bench::{Bench, JawConfig};
use arthro_simulator::cell::axes;
use arthro_simulator::epos4::{Bus, Fault, Node, socketcand};
use epos4_link::cia402::State;
use tokio::runtime::Builder;
use tokio::sync::watch;
use tokio::task::{JoinHandle, JoinSet};
use tokio::time::{Instant, sleep_until, timeout};

/// Node ids in the order of [`Axis::ALL`].
const NODE_IDS: [u8; 4] = [1, 2, 3, 4];
/// A step of the drives' clock, s.
pub const STEP_S: f64 = 0.001;
/// Speed of the drives' clock against the wall clock, where the machine allows it.
const TIME_SCALE: f64 = 10.0;
/// Later than this, the clock does not catch up: whoever is slow is not outrun.
const MAX_LAG: Duration = Duration::from_millis(20);
/// The clock waits this long, of the wall clock, for a heartbeat that a drive would miss.
const HOST_WAIT: Duration = Duration::from_secs(5);
/// So often everybody else has a turn in each step: a frame passes two sockets there and two back.
const TURNS: usize = 6;
/// Wall time for anything at all: reached only by a test that hangs.
pub const PATIENCE: Duration = Duration::from_secs(60);
/// Of the lease; each command renews it.
const LEASE: Duration = Duration::from_secs(60);
/// While a stop is under way it is asked again after this long, of the bus, s.
const STOPPING_S: f64 = 0.02;
/// No drive has moved for this long, of the bus: they stand, s.
const STANDING_S: f64 = 0.05;
/// A shaft that has not come to stand after this long, of the bus, is out of hand, s.
const STAND_WITHIN_S: f64 = 5.0;

/// The service, the drives, and the truth.
pub struct DriveWorld {
    /// The drives' bus, to hurt them.
    pub bus: Arc<Bus>,
    /// The way to the service.
    pub handle: Handle,
    /// The fencing token of the lease.
    pub token: u64,
    operations: u64,
    bench: Arc<Mutex<Bench>>,
    truth: watch::Sender<Truth>,
    truths: watch::Receiver<Truth>,
    /// Where the true shafts stand at position 0 of the service, quadcounts; since the last homing.
    zeros_qc: [f64; 4],
    owner: JoinHandle<()>,
    /// Time, and who watches that the jaw is never told otherwise than it is.
    tasks: JoinSet<()>,
    _server: socketcand::Server,
}

/// What the drives truly do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// The bus's clock, s.
    pub now_s: f64,
    /// Where the mechanisms are, quadcounts of the shafts that turn them, in the order of [`Axis::ALL`].
    pub shafts_qc: [f64; 4],
    /// How fast the motors turn, quadcounts a second.
    pub speeds_qc_s: [f64; 4],
    /// Between the blades, N.
    pub jaw_force_n: f64,
    /// Between the blades, mm; below 0 they press on each other.
    pub jaw_gap_mm: f64,
    /// When each drive was in OPERATION_ENABLED last, s.
    pub enabled_s: [f64; 4],
    /// The lowest and the highest place of each shaft since [`DriveWorld::forget_extremes`], quadcounts.
    pub extremes_qc: [(f64, f64); 4],
}

impl DriveWorld {
    /// Four drives that are ready, with nothing homed, and a lease.
    pub async fn up(jaw: JawConfig) -> Self {
        Self::with(jaw, Config::default()).await
    }

    /// The same with another configuration of the service; its bus is that of the drives.
    pub async fn with(jaw: JawConfig, config: Config) -> Self {
        let bus = Bus::new(Bench::drives(&NODE_IDS));
        let server = socketcand::serve(([127, 0, 0, 1], 0).into(), Arc::clone(&bus))
            .await
            .unwrap_or_else(|error| panic!("the bus is not served: {error}"));
        let config = Config {
            bus: format!("socketcand://{}/can0", server.address()),
            ..config
        };
        let cell = config.check().unwrap_or_else(|error| panic!("{error}"));
        let (drives, handle) = Drives::new(cell);
        let bench = Bench::new(&NODE_IDS, jaw);
        let (truth, truths) = watch::channel(Truth::of(&bus, &bench, None));
        let bench = Arc::new(Mutex::new(bench));
        let mut tasks = JoinSet::new();
        tasks.spawn(keep_time(
            Arc::clone(&bus),
            Arc::clone(&bench),
            truth.clone(),
        ));
        let mut world = Self {
            bus,
            token: 0,
            operations: 0,
            bench,
            truth,
            truths,
            zeros_qc: [0.0; 4],
            owner: tokio::spawn(drives.run(Drain::never())),
            tasks,
            handle,
            _server: server,
        };
        world.until_ready().await;
        world.take_command(LEASE).await;
        world
    }

    /// Takes command, for as long as it is kept up; the old lease must be over.
    pub async fn take_command(&mut self, ttl: Duration) {
        match self.handle.acquire("test".to_owned(), ttl).await {
            Ok(lease) => self.token = lease.fencing_token,
            Err(refusal) => panic!("no lease: {refusal}"),
        }
    }

    /// The host dies: nobody sends or hears any more.
    pub async fn kill_host(&mut self) {
        self.owner.abort();
        // Aborted is how it ends.
        (&mut self.owner).await.err();
    }

    /// Puts another block into the jaw, which should be open.
    pub fn put_into_jaw(&mut self, jaw: JawConfig) {
        let mut bench = self.bench.lock().unwrap_or_else(PoisonError::into_inner);
        bench.put_into_jaw(jaw);
    }

    // === commands ===

    /// Gives a command, once no stop is under way any more.
    pub async fn begin(&mut self, command: Command) -> Result<Ticket, Refusal> {
        self.operations += 1;
        let authorization = Authorization {
            fencing_token: self.token,
            operation_id: format!("operation-{}", self.operations),
        };
        // A lease that is over shows in the refusal of the command.
        self.handle.renew(self.token).await.ok();
        let begun = Instant::now();
        loop {
            let answer = self.handle.command(authorization.clone(), command.clone());
            match answer.await {
                Err(Refusal::Stopping) if begun.elapsed() < PATIENCE => {
                    self.pass(STOPPING_S).await;
                }
                answer => return answer,
            }
        }
    }

    /// Gives a command and waits for its end.
    pub async fn run(&mut self, command: Command) -> Report {
        let told = format!("{command:?}");
        match self.begin(command).await {
            Ok(mut ticket) => self.ended(&mut ticket).await,
            Err(refusal) => panic!(
                "{told} is refused: {refusal}\n{:#?}",
                self.handle.snapshot()
            ),
        }
    }

    /// Gives a command that must succeed.
    pub async fn succeed(&mut self, command: Command) -> Report {
        let told = format!("{command:?}");
        let report = self.run(command).await;
        assert_eq!(
            report.operation.state,
            OperationState::Done,
            "{told}: {report:?}, {:?}",
            self.truth()
        );
        report
    }

    /// The end of an operation.
    pub async fn ended(&self, ticket: &mut Ticket) -> Report {
        match timeout(PATIENCE, ticket.ended()).await {
            Ok(Some(report)) => report,
            other => panic!("{other:?}: {:#?}", self.handle.snapshot()),
        }
    }

    /// Moves an axis to a position, in its unit.
    pub async fn move_to(&mut self, axis: Axis, target: f64) -> Report {
        self.succeed(Command::Move { axis, target }).await
    }

    /// Homes axes, and learns where their reference truly is.
    pub async fn home(&mut self, axes: &[Axis]) {
        self.succeed(Command::Home(axes.to_vec())).await;
        self.settle().await;
        for axis in axes {
            let node = &self.handle.cell().axes[axis.index()].spec;
            let position = self.position(*axis);
            self.zeros_qc[axis.index()] = self.truth().shafts_qc[axis.index()]
                - f64::from(node.drivetrain.to_quadcounts(position));
        }
    }

    /// Homes all axes.
    pub async fn home_all(&mut self) {
        self.home(&Axis::ALL).await;
    }

    /// Acknowledges all faults; the operation must succeed.
    pub async fn recover(&mut self) {
        self.succeed(Command::Recover(Axis::ALL.to_vec())).await;
    }

    // === what the service tells ===

    /// The position that the service tells, in the axis' unit.
    pub fn position(&self, axis: Axis) -> f64 {
        match self.handle.snapshot().axes[axis.index()].sample {
            Some(sample) => sample.position,
            None => panic!("{axis} was never looked at"),
        }
    }

    /// The reasons of the latched faults; each must tell what a person does.
    pub fn faults(&self) -> [Option<&'static str>; 4] {
        let axes = self.handle.snapshot().axes;
        axes.map(|axis| {
            axis.fault.map(|fault| {
                assert!(!fault.response.is_empty(), "{fault:?} without a response");
                fault.reason
            })
        })
    }

    /// Waits until the state is as wanted.
    pub async fn until(&self, what: &str, wanted: impl Fn(&Snapshot) -> bool) {
        let mut states = self.handle.states();
        let reached = timeout(PATIENCE, states.wait_for(|state| wanted(state))).await;
        assert!(
            matches!(reached, Ok(Ok(_))),
            "never {what}: {:#?}",
            self.handle.snapshot()
        );
    }

    /// Waits until every drive can be commanded.
    pub async fn until_ready(&self) {
        self.until("ready", |state| {
            let mut axes = state.axes.iter();
            axes.all(|axis| axis.readiness == Readiness::Ready)
        })
        .await;
    }

    // === the truth ===

    /// What the drives truly do.
    pub fn truth(&self) -> Truth {
        *self.truths.borrow()
    }

    /// Counts the extremes of the shafts from now on.
    pub fn forget_extremes(&self) {
        self.truth
            .send_modify(|truth| truth.extremes_qc = truth.shafts_qc.map(|qc| (qc, qc)));
    }

    /// Waits until the truth is as wanted; which it is then.
    pub async fn until_truly(&self, what: &str, wanted: impl Fn(&Truth) -> bool) -> Truth {
        let mut truths = self.truths.clone();
        match timeout(PATIENCE, truths.wait_for(|truth| wanted(truth))).await {
            Ok(Ok(truth)) => *truth,
            _ => panic!("never {what}: {:?} {:#?}", self.truth(), self.bus.faults()),
        }
    }

    /// Waits for so much time of the bus; the truth then.
    pub async fn pass(&self, time_s: f64) -> Truth {
        let until_s = self.truth().now_s + time_s;
        self.until_truly("later", |truth| truth.now_s >= until_s)
            .await
    }

    /// Waits until all shafts stand; fails when they go on for seconds.
    pub async fn settle(&self) -> Truth {
        let begun_s = self.truth().now_s;
        let mut truths = self.truths.clone();
        let mut moved_s = begun_s;
        loop {
            let truth = *truths.borrow_and_update();
            if !truth.stands() {
                moved_s = truth.now_s;
            }
            if truth.now_s >= moved_s + STANDING_S {
                return truth;
            }
            assert!(truth.now_s < begun_s + STAND_WITHIN_S, "{truth:?}");
            if !matches!(timeout(PATIENCE, truths.changed()).await, Ok(Ok(()))) {
                panic!("time stands still at {truth:?}");
            }
        }
    }

    /// The farthest that any shaft goes from where it is in `truth` during so much time of the bus, quadcounts.
    pub async fn creep_qc(&self, truth: &Truth, time_s: f64) -> f64 {
        let mut truths = self.truths.clone();
        let until_s = self.truth().now_s + time_s;
        let mut farthest_qc = 0.0_f64;
        loop {
            let now = *truths.borrow_and_update();
            for (now_qc, then_qc) in now.shafts_qc.iter().zip(truth.shafts_qc) {
                farthest_qc = farthest_qc.max((now_qc - then_qc).abs());
            }
            if now.now_s >= until_s {
                return farthest_qc;
            }
            if !matches!(timeout(PATIENCE, truths.changed()).await, Ok(Ok(()))) {
                panic!("time stands still at {now:?}");
            }
        }
    }

    /// How far an axis truly is from a position, quadcounts, by the reference that its last homing found.
    pub fn off_qc(&self, axis: Axis, position: f64) -> f64 {
        let drivetrain = &self.handle.cell().axes[axis.index()].spec.drivetrain;
        let true_qc = self.truth().shafts_qc[axis.index()] - self.zeros_qc[axis.index()];
        (true_qc - f64::from(drivetrain.to_quadcounts(position))).abs()
    }

    /// Where the reference of an axis truly is, quadcounts.
    pub fn zero_qc(&self, axis: Axis) -> f64 {
        self.zeros_qc[axis.index()]
    }

    /// Hurts one drive, or all; the number of the fault.
    pub fn inject(&self, node_id: Option<u8>, fault: Fault) -> u64 {
        match self.bus.inject(node_id, fault, 7) {
            Some(id) => id,
            None => panic!("too many faults"),
        }
    }

    /// Watches from now on that the jaw is told closed only while it truly is and nothing is at fault; the watch fails
    /// with the world.
    pub fn watch_jaw(&mut self, closed_gap_mm: f64) {
        let (handle, truths) = (self.handle.clone(), self.truths.clone());
        self.tasks.spawn(async move {
            let mut states = handle.states();
            while states.changed().await.is_ok() {
                let before_mm = truths.borrow().jaw_gap_mm;
                let state = states.borrow_and_update().clone();
                if !matches!(state.jaw, Jaw::ClosedEmpty | Jaw::ClosedOnTissue) {
                    continue;
                }
                // The state is of a moment between the two, however slow this watch is.
                let gap_mm = truths.borrow().jaw_gap_mm.min(before_mm);
                let faults = state.axes.iter().filter_map(|axis| axis.fault.clone());
                let faults: Vec<_> = faults.collect();
                assert!(
                    gap_mm <= closed_gap_mm && faults.is_empty(),
                    "{:?} is told of a jaw open by {gap_mm} mm, with {faults:?}",
                    state.jaw
                );
            }
        });
    }

    /// Fails if a watch has failed, or the owner has died.
    pub fn check(&mut self) {
        assert!(!self.owner.is_finished(), "the owner of the drives is gone");
        if let Some(Err(error)) = self.tasks.try_join_next() {
            panic!("{error}");
        }
    }
}

impl Drop for DriveWorld {
    fn drop(&mut self) {
        self.owner.abort();
    }
}

impl Truth {
    fn of(bus: &Bus, bench: &Bench, before: Option<&Self>) -> Self {
        let now_s = bus.now_s();
        let mut enabled_s = before.map_or([0.0; 4], |before| before.enabled_s);
        let (shafts_qc, speeds_qc_s, jaw_force_n) = bus.with_drives(|drives| {
            let mut shafts_qc = [0.0; 4];
            let mut speeds_qc_s = [0.0; 4];
            for (place, node) in drives.nodes.iter().take(4).enumerate() {
                shafts_qc[place] = node.position_quadcounts();
                speeds_qc_s[place] = node.speed_quadcounts_s();
                if node.drive_state() == State::OperationEnabled {
                    enabled_s[place] = now_s;
                }
            }
            let feed = drives.nodes.get(Axis::ForcepsFeed.index());
            (shafts_qc, speeds_qc_s, feed.map_or(0.0, Node::tool_force_n))
        });
        Self {
            now_s,
            enabled_s,
            extremes_qc: std::array::from_fn(|place| {
                let qc = shafts_qc[place];
                let (low_qc, high_qc) = before.map_or((qc, qc), |before| before.extremes_qc[place]);
                (low_qc.min(qc), high_qc.max(qc))
            }),
            shafts_qc,
            speeds_qc_s,
            jaw_force_n,
            jaw_gap_mm: bench.gap_mm(axes::feed_mm(shafts_qc[Axis::ForcepsFeed.index()])),
        }
    }

    /// Whether nothing turns.
    pub fn stands(&self) -> bool {
        self.speeds_qc_s.iter().all(|speed_qc_s| *speed_qc_s == 0.0)
    }

    /// Where the forceps feed truly is, mm.
    pub fn jaw_feed_mm(&self) -> f64 {
        axes::feed_mm(self.shafts_qc[Axis::ForcepsFeed.index()])
    }
}

/// Ticks the bus and tells the truth of each step, until it is aborted.
async fn keep_time(bus: Arc<Bus>, bench: Arc<Mutex<Bench>>, truth: watch::Sender<Truth>) {
    let period = Duration::from_secs_f64(STEP_S / TIME_SCALE);
    let mut due = Instant::now();
    for step in 1_u64.. {
        due += period;
        let now = Instant::now();
        if due > now {
            sleep_until(due).await;
        } else if now > due + MAX_LAG {
            due = now;
        }
        bus.wait_for_heartbeats(STEP_S, HOST_WAIT).await;
        {
            let mut bench = bench.lock().unwrap_or_else(PoisonError::into_inner);
            let mechanics = bench.mechanics(&bus.positions_quadcounts());
            bus.tick(STEP_S, step as f64 * STEP_S, &mechanics);
            truth.send_modify(|truth| *truth = Truth::of(&bus, &bench, Some(truth)));
        }
        for _ in 0..TURNS {
            tokio::task::yield_now().await;
        }
    }
}

/// Runs a world, or several one after the other, in a thread of its own: drives and host take turns there, so that the
/// clock never outruns the host, however busy the machine is.
pub fn alone<T>(world: impl Future<Output = T>) -> T {
    let runtime = Builder::new_current_thread()
        .enable_all()
        // Sockets are looked at in each turn.
        .event_interval(1)
        .build();
    match runtime {
        Ok(runtime) => runtime.block_on(world),
        Err(error) => panic!("no runtime: {error}"),
    }
}

/// Runs worlds side by side, each [`alone`]; what came of them.
pub fn side_by_side<T: Send, F: Future<Output = T>>(
    count: usize,
    world: impl Fn(usize) -> F + Sync,
) -> Vec<T> {
    std::thread::scope(|scope| {
        let world = &world;
        let threads: Vec<_> = (0..count)
            .map(|place| scope.spawn(move || alone(world(place))))
            .collect();
        let ended = threads.into_iter().map(|thread| match thread.join() {
            Ok(came) => came,
            Err(why) => std::panic::resume_unwind(why),
        });
        ended.collect()
    })
}
