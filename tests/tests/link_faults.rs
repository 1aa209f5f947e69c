//! A thousand faults of the network while an arm moves inside the knee. Whatever happens: the arm comes to stand and
//! nothing moves it after that, a new link does not either, there is no jump, the shaft stays on the portal, and what is
//! told of the move is true.
//!
//! The whole path is real: the owner of the arm, its driver, sockets, the program on the simulated controller. Only time
//! is not: the controller is ticked as fast as its client answers.

#![allow(
    clippy::panic,
    clippy::unwrap_used,
    reason = "a test says why it failed by panicking"
)]

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use arthro_authority::{Operation, OperationState};
use arthro_geometry::{Point3, Rotation, Vector3};
use arthro_motion::arm::{Accepted, ArmHandle};
use arthro_motion::command::{Authorization, Commander, Progress};
use arthro_motion::config::ArmConfig;
use arthro_motion::controller::UrController;
use arthro_motion::kinematics::{Joints, ToolArm, largest_difference};
use arthro_motion::plan::Move;
use arthro_motion::rcm::{Placement, shaft};
use arthro_simulator::ur5::{self, Controller, Ports, Series, ServerOptions, Servers};
use arthro_tests::proxy::{Fault, Proxy, Way};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tokio::sync::watch;
use tokio::task::{JoinHandle, JoinSet};

const FAULTS: usize = 1000;
/// Worlds that run side by side: most of the wall time is waiting for silence.
const WORLDS: usize = 10;
/// Wall time that the clock waits for a client that owes an answer: in lock step while the network is good.
const ANSWER_LIMIT: Duration = Duration::from_secs(5);
/// While it is bad the answer may never come; the clock goes on at this pace, which a client that is answered keeps.
const TICK_IN_FAULT: Duration = Duration::from_millis(1);
/// Wall time without states after which the service stops, and after which the link fails.
const SILENCE: Duration = Duration::from_millis(60);
const LINK_SILENCE: Duration = Duration::from_millis(120);
/// Wall time for anything at all: reached only by a test that hangs.
const PATIENCE: Duration = Duration::from_secs(60);
/// Depth of the tip beyond the portal in all moves, mm.
const DEPTH_MM: f64 = 30.0;
/// Where a retraction ends: just outside, mm.
const OUTSIDE_MM: f64 = -2.0;
/// Pivots go this far to each side, rad.
const SIDE_RAD: f64 = 0.15;
/// The controller and the program stop with 4 rad/s2; the drives follow with 40.
const ACCELERATION_MAX_RAD_S2: f64 = 12.0;
/// Ticks in which nothing may move for the arm to stand.
const STANDING_TICKS: usize = 12;
/// The farthest that an arm at rest creeps while its drives settle, rad.
const RESTING_RAD: f64 = 2e-4;

struct World {
    controller: ur5::Shared,
    servers: Servers,
    proxy: Proxy,
    handle: ArmHandle,
    owner: JoinHandle<()>,
    arm: ToolArm,
    portal: Point3,
    token: u64,
    next_id: u64,
    side: f64,
    /// True joints of the last two ticks.
    track: [Joints; 2],
    /// Where the arm came to stand, while nobody commands it.
    anchor: Option<Joints>,
    begun: Instant,
    struck: bool,
}

/// How many faults of each kind ended how: "Drop ToClient: Failed STATE_STALE".
type Tally = BTreeMap<String, usize>;

impl World {
    /// An arm that stands with its tip inside the knee.
    async fn new(seed: u64) -> Self {
        let mut config = ArmConfig::default();
        config.limits.pivot_speed_rad_s = 0.5;
        config.limits.pivot_acceleration_rad_s2 = 2.0;
        // The joints of this controller lag by 9.5 to 10.5 ms.
        config.limits.joint_lag_spread_s = 0.001;
        let joints_rad = config.neutral_joints_rad;
        let controller: ur5::Shared = Arc::new(Mutex::new(Controller::new(ur5::Config {
            joints_rad,
            powered: true,
            ..ur5::Config::default()
        })));
        let options = ServerOptions {
            ports: Ports::FREE,
            ..ServerOptions::default()
        };
        let servers = ur5::serve(controller.clone(), options).await.unwrap();
        let addresses = servers.addresses();
        let proxy = Proxy::before(addresses.rtde, seed).await.unwrap();
        config.host = "127.0.0.1".to_owned();
        config.rtde_port = proxy.address().port();
        config.dashboard_port = addresses.dashboard.port();
        config.script_port = addresses.realtime.port();
        let mut setup = config.check("forceps").unwrap();
        let arm = setup.options.arm;
        let pose = arm.base_from_tool(&joints_rad);
        let portal = pose.origin() + shaft(&pose) * 20.0;
        setup.options.portal = Some(portal.into());
        setup.options.silence = SILENCE;
        setup.options.reconnect = Duration::from_millis(1);
        setup.link.silence_timeout = LINK_SILENCE;
        setup.link.reply_timeout = LINK_SILENCE;
        setup.link.startup_timeout = Duration::from_secs(2);
        let commander = Commander::new(1, Box::new(|| Duration::ZERO));
        let (connector, _) = UrController::new(setup.link);
        let (handle, owner) = setup.options.start(connector, commander.clone());
        let lease = commander.acquire("test", Duration::from_secs(60)).unwrap();
        let mut world = Self {
            controller,
            servers,
            proxy,
            handle,
            owner: tokio::spawn(owner.run()),
            arm,
            portal,
            token: lease.fencing_token,
            next_id: 0,
            side: 1.0,
            track: [joints_rad; 2],
            anchor: None,
            begun: Instant::now(),
            struck: false,
        };
        world.carry_out(Self::insert()).await;
        world
    }

    /// One cycle of the controller, and what must hold in each.
    async fn tick(&mut self) {
        let joints = {
            let mut controller = lock(&self.controller);
            controller.tick();
            controller.joints_rad()
        };
        self.servers.ticked();
        if self.struck {
            tokio::time::sleep(TICK_IN_FAULT).await;
        } else {
            self.servers.wait_for_clients(ANSWER_LIMIT).await;
            tokio::task::yield_now().await;
        }
        let [before, now] = self.track;
        let change: Joints = std::array::from_fn(|i| {
            (joints[i] - 2.0 * now[i] + before[i]) / Series::Cb3.step_s().powi(2)
        });
        let (joint, acceleration) = largest_difference(&change, &[0.0; 6]);
        assert!(
            acceleration <= ACCELERATION_MAX_RAD_S2,
            "joint {joint} jumps: {acceleration:.2} rad/s2"
        );
        let placement = Placement::of(&self.arm.base_from_tool(&joints), &self.portal);
        assert!(
            placement.depth_mm < 0.0 || placement.deviation_mm() < 0.5,
            "{placement:?}"
        );
        if let Some(anchor) = &self.anchor {
            let (joint, moved) = largest_difference(&joints, anchor);
            assert!(
                moved <= RESTING_RAD,
                "joint {joint} moved by {moved:.2e} rad and nobody commanded it"
            );
        }
        self.track = [now, joints];
        assert!(
            self.begun.elapsed() < PATIENCE,
            "nothing comes of it: {:?}",
            self.handle.published().borrow()
        );
    }

    fn strike(&mut self, fault: Fault) {
        self.struck = fault != Fault::None;
        self.proxy.strike(fault);
    }

    async fn ticks(&mut self, count: usize) {
        for _ in 0..count {
            self.tick().await;
        }
    }

    /// Ticks until the arm stands.
    async fn comes_to_stand(&mut self) {
        let mut standing = 0;
        while standing < STANDING_TICKS {
            self.tick().await;
            let [before, now] = self.track;
            let still = largest_difference(&before, &now).1 < 1e-6;
            standing = if still { standing + 1 } else { 0 };
        }
        self.anchor = Some(self.track[1]);
    }

    /// Ticks until the service shows the arm as it is now.
    async fn connected(&mut self) {
        let since_s = lock(&self.controller).timestamp_s();
        let published = self.handle.published();
        let fresh = || {
            let published = published.borrow();
            let state = published.state.as_ref();
            published.connected && state.is_some_and(|state| state.time_s > since_s)
        };
        while !fresh() {
            self.tick().await;
        }
    }

    fn by(&mut self) -> Authorization {
        self.next_id += 1;
        Authorization {
            fencing_token: self.token,
            operation_id: format!("op-{}", self.next_id),
        }
    }

    async fn begin(&mut self, wanted: Move) -> Option<watch::Receiver<Progress>> {
        let (handle, by) = (self.handle.clone(), self.by());
        self.anchor = None;
        let asked = tokio::spawn(async move { handle.begin(by, b"move", wanted).await });
        while !asked.is_finished() {
            self.tick().await;
        }
        match asked.await.unwrap() {
            Ok(Accepted::Running { progress, .. }) => Some(progress),
            Ok(Accepted::Ended(operation)) => panic!("{operation:?}"),
            Err(_) => None,
        }
    }

    /// Where the shaft shall point at the end of this pivot.
    fn aim(&self) -> Point3 {
        let turn = Rotation::from_axis_angle(&Vector3::y_axis(), self.side * SIDE_RAD);
        let neutral = self
            .arm
            .base_from_tool(&ArmConfig::default().neutral_joints_rad);
        self.portal + turn * shaft(&neutral) * DEPTH_MM
    }

    /// Recovers until the move has begun: a busy machine may have stopped the arm without any fault of ours.
    async fn begin_soundly(&mut self, wanted: &Move) -> watch::Receiver<Progress> {
        loop {
            self.connected().await;
            let (handle, by) = (self.handle.clone(), self.by());
            let asked = tokio::spawn(async move { handle.recover_fault(by, b"recover").await });
            while !asked.is_finished() {
                self.tick().await;
            }
            // A refusal shows when the move is refused.
            drop(asked.await.unwrap());
            self.connected().await;
            if let Some(progress) = self.begin(wanted.clone()).await {
                return progress;
            }
            // After a fault inside only the way out is open; then the tip may come in again.
            for depth in [Self::retract(), Self::insert()] {
                if let Some(progress) = self.begin(depth).await {
                    self.ends(&progress).await;
                }
            }
        }
    }

    fn retract() -> Move {
        Move::Retract {
            depth_mm: OUTSIDE_MM,
            speed_mm_s: None,
        }
    }

    fn insert() -> Move {
        Move::Insert {
            depth_mm: DEPTH_MM,
            speed_mm_s: None,
        }
    }

    async fn ends(&mut self, progress: &watch::Receiver<Progress>) {
        while is_running(progress) {
            self.tick().await;
        }
    }

    async fn carry_out(&mut self, wanted: Move) {
        loop {
            let progress = self.begin_soundly(&wanted).await;
            self.ends(&progress).await;
            if progress.borrow().operation.state == OperationState::Done {
                return;
            }
        }
    }

    /// One fault in a move. None if the move was over before it struck.
    async fn suffer(&mut self, fault: Fault, after_ticks: usize) -> Option<Operation> {
        self.begun = Instant::now();
        self.side = -self.side;
        let wanted = Move::Pivot {
            aim: self.aim(),
            speed_rad_s: None,
        };
        let mut progress = self.begin_soundly(&wanted).await;
        self.ticks(after_ticks).await;
        if !is_running(&progress) {
            self.comes_to_stand().await;
            return None;
        }
        self.strike(fault);
        self.comes_to_stand().await;
        // Its outcome is told while the network is still bad, or the move has ended well in spite of it.
        while is_running(&progress) {
            self.tick().await;
        }
        self.ticks(20).await;
        self.strike(Fault::None);
        self.connected().await;
        self.ticks(20).await;
        let told = progress.borrow_and_update().clone();
        self.must_be_true(&told, fault);
        Some(told.operation)
    }

    /// What was told of the move and of the arm is how they are.
    fn must_be_true(&self, told: &Progress, fault: Fault) {
        let operation = &told.operation;
        let published = self.handle.published();
        let published = published.borrow();
        let shown = published.state.as_ref().expect("the arm was seen");
        let joints = self.track[1];
        let (joint, apart) = largest_difference(&shown.joints_rad, &joints);
        assert!(apart < 1e-6, "joint {joint} is shown {apart:.2e} rad off");
        let latched = shown.fault.as_ref().map(|fault| fault.reason);
        // A pivot turns the shaft; what a stop on the way did to the depth, it keeps.
        let aim = (self.aim() - self.portal).normalize();
        let off_rad = shaft(&self.arm.base_from_tool(&joints)).angle(&aim);
        match operation.state {
            // What struck after its end may have latched a fault all the same.
            OperationState::Done => {
                assert!(off_rad < 1e-3, "{fault:?}: done, and {off_rad:.1e} rad off");
            }
            OperationState::Failed => {
                assert_eq!(
                    latched,
                    Some(&*operation.reason),
                    "{fault:?}: {operation:?}"
                );
            }
            OperationState::InDoubt => {
                assert_eq!(operation.reason, "LINK_LOST", "{fault:?}: {operation:?}");
                assert!(latched.is_some(), "{fault:?}: {operation:?}");
            }
            OperationState::Stopped | OperationState::Running => {
                panic!("{fault:?}: {operation:?}")
            }
        }
    }
}

impl Drop for World {
    fn drop(&mut self) {
        self.owner.abort();
    }
}

fn is_running(progress: &watch::Receiver<Progress>) -> bool {
    progress.borrow().operation.state == OperationState::Running
}

fn lock(controller: &ur5::Shared) -> MutexGuard<'_, Controller> {
    controller.lock().unwrap_or_else(PoisonError::into_inner)
}

fn any_fault(rng: &mut ChaCha8Rng) -> Fault {
    let way = if rng.random() {
        Way::ToClient
    } else {
        Way::ToController
    };
    let frames = rng.random_range(1..=12);
    match rng.random_range(0..9) {
        0 => Fault::Drop(way, frames),
        1 => Fault::Stall(way),
        2 => Fault::Reset,
        3 => Fault::Close,
        4 => Fault::HalfOpen,
        5 => Fault::Corrupt(way, frames),
        6 => Fault::Reorder(way, frames),
        7 => Fault::Duplicate(way, frames),
        _ => Fault::Truncate(way),
    }
}

async fn suffer_many(seed: u64, faults: usize) -> Tally {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut world = World::new(seed << 32).await;
    let mut tally = Tally::default();
    let mut struck = 0;
    while struck < faults {
        let fault = any_fault(&mut rng);
        let after_ticks = rng.random_range(5..100);
        let Some(operation) = world.suffer(fault, after_ticks).await else {
            continue;
        };
        let kind = format!("{fault:?}").replace(|c: char| c.is_ascii_digit(), "");
        let ended = format!("{kind} {:?} {}", operation.state, operation.reason);
        *tally.entry(ended).or_default() += 1;
        struck += 1;
    }
    tally
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn after_any_fault_of_the_link_nothing_moves_and_the_truth_is_told() {
    let mut worlds = JoinSet::new();
    for seed in 1..=WORLDS as u64 {
        worlds.spawn(suffer_many(seed, FAULTS / WORLDS));
    }
    let mut all = Tally::default();
    for tally in worlds.join_all().await {
        for (ended, count) in tally {
            *all.entry(ended).or_default() += count;
        }
    }
    for (ended, count) in &all {
        println!("{count:5} {ended}");
    }
    assert_eq!(all.values().sum::<usize>(), FAULTS);
    // Each way to end was met: the test strikes what it means to strike.
    for state in ["Done", "Failed", "InDoubt"] {
        assert!(all.keys().any(|ended| ended.contains(state)), "{state}");
    }
}
