//! Every fault of the simulated drives in every state of the service: home, move, bite, and holding after a bite. Whatever
//! happens: the operation ends with the reason that this table says, the fault stays until a person acknowledges it,
//! nothing moves meanwhile, the jaw is never told closed when it is not, and afterwards everything works again.
//!
//! Service, drives and the socket between them are real; time is faster.

#![allow(
    clippy::panic,
    clippy::unwrap_used,
    reason = "a test says why it failed by panicking"
)]

use std::collections::{BTreeMap, VecDeque};
use std::sync::Mutex;

use arthro_authority::OperationState;
use arthro_bootstrap::status;
use arthro_instrument::axis::Axis;
use arthro_instrument::bite::Jaw;
use arthro_instrument::config::Config;
use arthro_instrument::drives::{Command, Readiness, Report};
use arthro_simulator::bench::JawConfig;
use arthro_simulator::epos4::Fault;
use arthro_tests::drives::{DriveWorld, side_by_side};

/// Worlds side by side.
const WORLDS: usize = 8;
/// How far a shaft that stands may creep, quadcounts.
const CREEP_QC: f64 = 2.0;
/// For so long of the bus nothing may move after a fault, and again after its cause is gone, s.
const STANDS_FOR_S: f64 = 1.0;
/// Open by more than this, a jaw is not closed, mm: `bite.closed_tolerance_mm`.
const CLOSED_GAP_MM: f64 = 0.3;
/// What the bites draw at most, mA: enough to cut the block.
const BITE_MA: f64 = 400.0;
/// Where the moves lead, mm or degrees.
const FAR: f64 = 6.0;
const FAR_DEG: f64 = 90.0;

/// What a bit that is another can look like: in an answer, in a statusword, in a heartbeat, in process data.
const GARBLED: &[&str] = &[
    "SDO_NO_ANSWER",
    "SDO_ABORTED",
    "SDO_WRONG_SIZE",
    "SDO_READ_BACK",
    "DUPLICATE_NODE_ID",
    "UNKNOWN_STATUSWORD",
    "DRIVE_LEFT_OPERATION",
    "DRIVE_NO_TRANSITION",
    "NOT_HOMED",
    "REFERENCE_LOST",
    "HOMING_FAILED",
    "HOMING_INTERRUPTED",
    "POSITION_LIMITS_NOT_KEPT",
    "HEARTBEAT_LOST",
    "NMT_STATE_LOST",
    "UNEXPECTED_BOOT_UP",
    "STALE_PROCESS_DATA",
    "TARGET_NOT_REACHED",
    "JAW_NOT_CLOSED",
    "JAW_STALLED",
    "JAW_CLOSURE_DOUBTFUL",
];

/// What the service does when the fault comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum During {
    Home,
    Move,
    Bite,
    Holding,
}

/// What must come of it.
#[derive(Clone, Copy, Debug)]
enum Expected {
    /// A latched fault with one of these reasons.
    Fault(&'static [&'static str]),
    /// The operation fails with this reason; the drive obeys, and nothing is latched.
    Failed(&'static str),
    /// It ends well, and what is told of it is true. What comes next ends well too.
    Nothing,
    /// As nothing; but the next motion is the latched fault.
    Later(&'static [&'static str]),
    /// It ends well, and no one can know that the mechanism is elsewhere: the jaw must not be told closed.
    Unseen,
    /// By chance either of the two: nothing, or a latched fault with one of these reasons.
    Chance(&'static [&'static str]),
}
use During::{Bite, Holding, Home, Move};
use Expected::{Chance, Failed, Later, Nothing, Unseen};

#[derive(Clone, Copy, Debug)]
struct Case {
    fault: Fault,
    /// The drive that is hurt; none: the bus.
    node_id: Option<u8>,
    /// The axis that works meanwhile.
    axis: Axis,
    during: During,
}

const FAULTS: [Fault; 25] = [
    Fault::DropNode,
    Fault::LateHeartbeat(0.15),
    Fault::LateHeartbeat(1.0),
    Fault::Emergency(0x2310),
    Fault::Emergency(0x7320),
    Fault::FrozenEncoder,
    Fault::SlippingBelt(0.5),
    Fault::CutWire(1),
    Fault::PressedSwitch(1),
    Fault::SlowSdo(0.01),
    Fault::SlowSdo(8.0),
    Fault::SilentSdo,
    Fault::CorruptFrame(0.05),
    Fault::LostPdo(0.05),
    Fault::LostPdo(1.0),
    Fault::DuplicateNode,
    Fault::WrongIdentity(0x6150_0000),
    Fault::SwappedGear(19, 1),
    Fault::StoOpen,
    Fault::Supply(5.0),
    Fault::PowerStageTemperature(120.0),
    Fault::Jam,
    Fault::I2tLevel(150.0),
    Fault::BusOff,
    Fault::ErrorPassive,
];

/// The table. Where nothing is said of a state, a fault acts alike in all.
fn expected(case: &Case) -> Expected {
    let feed_2 = case.axis == Axis::ForcepsFeed;
    match (case.fault, case.during) {
        (Fault::DropNode, _) => Expected::Fault(&["HEARTBEAT_LOST"]),
        (Fault::LateHeartbeat(extra_s), _) if extra_s > 0.2 => Expected::Fault(&["HEARTBEAT_LOST"]),
        (Fault::Emergency(0x2310), _) => Expected::Fault(&["OVERCURRENT"]),
        (Fault::Emergency(_), _) => Expected::Fault(&["POSITION_SENSOR"]),
        (Fault::FrozenEncoder | Fault::Jam, Home | Move) => Expected::Fault(&["FOLLOWING_ERROR"]),
        // The count stands while the current is at its limit: just what hard tissue does.
        (Fault::FrozenEncoder | Fault::Jam, Bite) => Failed("JAW_NOT_CLOSED"),
        (Fault::FrozenEncoder | Fault::Jam, Holding) => Later(&["FOLLOWING_ERROR"]),
        (Fault::SlippingBelt(_), Bite) => Expected::Fault(&["JAW_CLOSURE_DOUBTFUL"]),
        (Fault::SlippingBelt(_), _) => Unseen,
        // The way out of a switch is free: forwards it is not noticed.
        (Fault::CutWire(_) | Fault::PressedSwitch(_), Move | Bite) => Nothing,
        (Fault::CutWire(_), Home) if !feed_2 => Expected::Fault(&["FOLLOWING_ERROR"]),
        (Fault::CutWire(_) | Fault::PressedSwitch(_), Home) => {
            Expected::Fault(&["HOMING_TIMED_OUT"])
        }
        (Fault::CutWire(_) | Fault::PressedSwitch(_), Holding) => {
            Expected::Fault(&["LIMIT_SWITCH"])
        }
        (Fault::SlowSdo(extra_s), _) if extra_s > 1.0 => Expected::Fault(&["SDO_NO_ANSWER"]),
        (Fault::SilentSdo, _) => Expected::Fault(&["SDO_NO_ANSWER"]),
        (Fault::CorruptFrame(_), _) => Chance(GARBLED),
        (Fault::LostPdo(1.0), Holding) => Later(&["STALE_PROCESS_DATA"]),
        (Fault::LostPdo(1.0), _) => Expected::Fault(&["STALE_PROCESS_DATA"]),
        (Fault::LostPdo(_), _) => Chance(&["STALE_PROCESS_DATA"]),
        (Fault::DuplicateNode, _) => Expected::Fault(&["UNEXPECTED_BOOT_UP", "DUPLICATE_NODE_ID"]),
        (Fault::StoOpen, _) => Expected::Fault(&["SAFE_TORQUE_OFF"]),
        (Fault::Supply(_), _) => Expected::Fault(&["SUPPLY_VOLTAGE"]),
        (Fault::PowerStageTemperature(_), _) => Expected::Fault(&["OVERTEMPERATURE"]),
        (Fault::BusOff, _) => Expected::Fault(&["BUS_OFF"]),
        // socketcand's line of an error frame has its class and no more: which state it is cannot be told.
        (Fault::ErrorPassive, _) => Nothing,
        _ => Nothing,
    }
}

fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    let feed = Axis::ForcepsFeed;
    for fault in FAULTS {
        let hurt = |node_id| (!fault.is_of_the_bus()).then_some(node_id);
        let mut add = |axis, node_id, during| {
            cases.push(Case {
                fault,
                node_id,
                axis,
                during,
            });
        };
        for during in [Home, Move, Bite, Holding] {
            add(feed, hurt(2), during);
        }
        for during in [Home, Move] {
            add(Axis::ArthroscopeFeed, hurt(4), during);
        }
        add(Axis::ForcepsRotation, hurt(1), Move);
    }
    // What happens to another axis leaves no jaw that is told closed either.
    for fault in [Fault::DropNode, Fault::Emergency(0x2310)] {
        for during in [Home, Move, Bite, Holding] {
            cases.push(Case {
                fault,
                node_id: Some(1),
                axis: feed,
                during,
            });
        }
    }
    cases
}

impl Case {
    fn name(&self) -> String {
        let node = self.node_id.map_or("bus".to_owned(), |id| id.to_string());
        format!(
            "{:?} of {node} in {:?} of {}",
            self.fault, self.during, self.axis
        )
    }

    /// Its row in the table that is printed.
    fn row(&self) -> String {
        let node = self.node_id.map_or("bus".to_owned(), |id| id.to_string());
        format!("{:?} of {node}, {}", self.fault, self.axis)
    }

    /// The axis whose drive is hurt; of a fault of the bus, the one that works.
    fn hurt(&self) -> Axis {
        match self.node_id {
            Some(node_id) => Axis::ALL[usize::from(node_id) - 1],
            None => self.axis,
        }
    }

    fn far(&self) -> f64 {
        match self.axis {
            Axis::ForcepsRotation | Axis::ArthroscopeRotation => FAR_DEG,
            Axis::ForcepsFeed | Axis::ArthroscopeFeed => FAR,
        }
    }

    /// So far the axis has moved when the fault comes, quadcounts: a millimetre of a feed, 20 degrees.
    fn begun_qc(&self) -> f64 {
        match self.axis {
            Axis::ForcepsRotation | Axis::ArthroscopeRotation => 2_400.0,
            Axis::ForcepsFeed | Axis::ArthroscopeFeed => 21_504.0,
        }
    }

    fn command(&self) -> Command {
        match self.during {
            Home => Command::Home(vec![self.axis]),
            Move => self.a_move(self.far()),
            Bite | Holding => Command::Bite {
                current_limit_ma: BITE_MA,
            },
        }
    }

    fn a_move(&self, target: f64) -> Command {
        Command::Move {
            axis: self.axis,
            target,
        }
    }

    /// Carries the case out in a world where all is well, and leaves it so; the reason that came of it.
    async fn suffer(&self, world: &mut DriveWorld) -> String {
        let start = if self.during == Home { self.far() } else { 0.0 };
        world.succeed(self.a_move(start)).await;
        let stood = world.settle().await;
        let mut ticket = world.begin(self.command()).await.unwrap();
        if self.during == Holding {
            let report = world.ended(&mut ticket).await;
            assert_eq!(report.operation.state, OperationState::Done, "{report:?}");
            assert_eq!(world.handle.snapshot().jaw, Jaw::ClosedOnTissue);
            world.settle().await;
        } else {
            let place = self.axis.index();
            let (from_qc, begun_qc) = (stood.shafts_qc[place], self.begun_qc());
            world
                .until_truly("moving", |truth| {
                    let moved_qc = (truth.shafts_qc[place] - from_qc).abs();
                    moved_qc > begun_qc && truth.speeds_qc_s[place] != 0.0
                })
                .await;
        }
        let id = world.inject(self.node_id, self.fault);
        let report = match self.during {
            Holding => {
                // Two looks at an axis at rest, and an SDO that is waited for.
                world.pass(1.0).await;
                if matches!(expected(self), Expected::Fault(_)) {
                    let hurt = self.hurt().index();
                    world
                        .until("at fault", |state| state.axes[hurt].fault.is_some())
                        .await;
                }
                None
            }
            _ => Some(world.ended(&mut ticket).await),
        };
        let came = self.judge(world, report.as_ref()).await;
        world.bus.clear(Some(id));
        self.recover(world, &came).await;
        world.check();
        came.reason
    }

    /// What came of it is as the table says, and what is told is true.
    async fn judge(&self, world: &mut DriveWorld, report: Option<&Report>) -> Came {
        let latched = world.faults()[self.hurt().index()];
        let name = self.name();
        let (state, reason) = match report {
            Some(report) => (report.operation.state, report.operation.reason.clone()),
            None => (OperationState::Done, latched.unwrap_or("").to_owned()),
        };
        let detail = format!("{name}: {report:?}, latched {:?}", world.faults());
        let expected = expected(self);
        match (expected, state) {
            (Expected::Fault(reasons), _) => {
                assert!(
                    report.is_none() || state == OperationState::Failed,
                    "{detail}"
                );
                assert!(reasons.contains(&&*reason), "{detail}");
                assert_eq!(latched, Some(&*reason), "{detail}");
            }
            (Failed(expected), state) => {
                assert_eq!(
                    (state, &*reason),
                    (OperationState::Failed, expected),
                    "{detail}"
                );
                assert_eq!(latched, None, "{detail}");
            }
            (Chance(reasons), OperationState::Failed) => {
                assert!(reasons.contains(&&*reason), "{detail}");
            }
            (Chance(reasons), _) => {
                assert!(
                    latched.is_none_or(|reason| reasons.contains(&reason)),
                    "{detail}"
                );
            }
            (Nothing | Later(_) | Unseen, state) => {
                assert_eq!((state, latched), (OperationState::Done, None), "{detail}");
            }
        }
        // Known to be closed is the jaw only while nothing is at fault and it truly is; a watch sees to that meanwhile.
        let stood = world.settle().await;
        let jaw = world.handle.snapshot().jaw;
        let is_closed = matches!(jaw, Jaw::ClosedEmpty | Jaw::ClosedOnTissue);
        let is_fault = latched.is_some() || state == OperationState::Failed;
        assert!(!(is_closed && is_fault), "{jaw:?} after {detail}");
        let creep_qc = world.creep_qc(&stood, STANDS_FOR_S).await;
        assert!(creep_qc <= CREEP_QC, "crept {creep_qc} qc after {detail}");
        if !is_fault && !matches!(expected, Unseen) {
            match self.during {
                Move => {
                    let off_qc = world.off_qc(self.axis, self.far());
                    assert!(off_qc <= 1.0, "off {off_qc} qc after {detail}");
                }
                // A value that was garbled on its way may give the jaw up: a doubt, and no fault.
                Bite | Holding if !is_closed && matches!(expected, Chance(_)) => {
                    assert_eq!(jaw, Jaw::Unknown, "{detail}");
                }
                Bite | Holding => assert!(
                    is_closed && stood.jaw_gap_mm <= CLOSED_GAP_MM,
                    "{jaw:?} with a gap of {} mm after {detail}",
                    stood.jaw_gap_mm
                ),
                Home => {}
            }
        }
        Came { reason, is_fault }
    }

    /// The cause is gone. Nothing moves until a person acknowledges; then all is well again.
    async fn recover(&self, world: &mut DriveWorld, came: &Came) {
        let name = self.name();
        let stood = world.settle().await;
        let creep_qc = world.creep_qc(&stood, STANDS_FOR_S).await;
        assert!(
            creep_qc <= CREEP_QC,
            "crept {creep_qc} qc by itself after {name}"
        );
        if let Later(reasons) = expected(self) {
            let id = world.inject(self.node_id, self.fault);
            let report = world.run(self.a_move(0.0)).await;
            assert!(
                reasons.contains(&&*report.operation.reason),
                "{name}: {report:?}"
            );
            world.bus.clear(Some(id));
        }
        if world.faults()[self.axis.index()].is_some() {
            let refusal = world.begin(self.a_move(0.0)).await.unwrap_err();
            let word = status::reason(&refusal.into()).unwrap();
            assert_eq!(word, "AXIS_FAULTED", "{name}");
        } else if came.is_fault && matches!(expected(self), Expected::Fault(_)) {
            assert_ne!(self.hurt(), self.axis, "{name}: nothing is latched");
        }
        let recovered = world.run(Command::Recover(Axis::ALL.to_vec())).await;
        let state = recovered.operation.state;
        assert_eq!(state, OperationState::Done, "{name}: {recovered:?}");
        assert_eq!(world.faults(), [None; 4], "{name}");
        let stood = world.settle().await;
        let creep_qc = world.creep_qc(&stood, 0.2).await;
        assert!(
            creep_qc <= CREEP_QC,
            "crept {creep_qc} qc by the recovery after {name}"
        );
        world.until_ready().await;
        let axes = world.handle.snapshot().axes;
        let to_home = Axis::ALL
            .into_iter()
            .filter(|axis| *axis == self.axis || !axes[axis.index()].is_homed());
        let to_home: Vec<Axis> = to_home.collect();
        if (self.fault, self.during) == (Fault::FrozenEncoder, Bite) {
            // The motor ran away and pressed the blades on each other: they spring open, and the homing after that is
            // the first that can follow.
            let sprung = world.run(Command::Home(to_home.clone())).await;
            assert_eq!(sprung.operation.reason, "FOLLOWING_ERROR", "{sprung:?}");
            world.recover().await;
        }
        // Worlds go on side by side: this tells which one failed.
        println!("{name}: {:?}, and is homed", came.reason);
        world.home(&to_home).await;
        let half = 0.5 * self.far();
        world.succeed(self.a_move(half)).await;
        world.settle().await;
        let off_qc = world.off_qc(self.axis, half);
        assert!(off_qc <= 1.0, "off {off_qc} qc, recovered from {name}");
        let axes = world.handle.snapshot().axes;
        assert!(axes.iter().all(|axis| axis.readiness == Readiness::Ready));
    }
}

/// What came of a case.
struct Came {
    reason: String,
    is_fault: bool,
}

async fn world() -> DriveWorld {
    let config = Config {
        // Real time: ten times as much on the bus.
        sdo_timeout_s: 0.3,
        ..Config::default()
    };
    let mut world = DriveWorld::with(JawConfig::default(), config).await;
    world.watch_jaw(CLOSED_GAP_MM);
    world.home_all().await;
    world
}

/// The next one that waits.
fn next(waiting: &Mutex<VecDeque<Case>>) -> Option<Case> {
    waiting.lock().unwrap().pop_front()
}

/// Carries cases out in one world after the other; what came of each, in the order of the table.
async fn suffer_many(waiting: &Mutex<VecDeque<Case>>) -> Vec<(Case, String)> {
    let mut world = world().await;
    let mut came = Vec::new();
    while let Some(case) = next(waiting) {
        let reason = case.suffer(&mut world).await;
        came.push((case, reason));
    }
    came
}

#[test]
fn after_any_fault_in_any_state_nothing_moves_and_the_truth_is_told() {
    let cases = cases();
    let count = cases.len();
    let waiting = Mutex::new(VecDeque::from(cases));
    let came = side_by_side(WORLDS, |_| suffer_many(&waiting));
    let mut rows: BTreeMap<String, BTreeMap<During, String>> = BTreeMap::new();
    let mut suffered = 0;
    for (case, reason) in came.into_iter().flatten() {
        suffered += 1;
        let row = rows.entry(case.row()).or_default();
        row.insert(case.during, reason);
    }
    for (row, reasons) in &rows {
        let columns = [Home, Move, Bite, Holding].map(|during| match reasons.get(&during) {
            None => "",
            Some(reason) if reason.is_empty() => "-",
            Some(reason) => reason.as_str(),
        });
        println!("| {row} | {} |", columns.join(" | "));
    }
    assert_eq!(suffered, count);
}
