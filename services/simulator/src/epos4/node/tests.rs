//! A master's view of one drive, frame by frame.

use epos4_link::canopen::emcy::Emergency;
use epos4_link::canopen::nmt::Target;
use epos4_link::canopen::sdo::{AbortCode, Initiate, Request, Response};
use epos4_link::cia402::Statusword;
use epos4_link::frame::Id;

use super::*;
use crate::epos4::mechanics::{Contact, INPUT_COUNT, Input};

const STEP_S: f64 = 0.002;

/// One drive, a master's hands on it, and everything that the drive sent.
struct Rig {
    node: Node,
    now_s: f64,
    mechanics: Box<dyn Fn(f64) -> Mechanics>,
    sent: Vec<Frame>,
}

/// Negative limit, positive limit and home switch, normally open, on the first three inputs.
fn switches(actuated: [bool; 3]) -> [Input; INPUT_COUNT] {
    let mut inputs = [Input::default(); INPUT_COUNT];
    for (input, actuated) in inputs.iter_mut().zip(actuated) {
        *input = Input::new(Contact::NormallyOpen, actuated);
    }
    inputs
}

impl Rig {
    fn new() -> Self {
        Self::with(NodeConfig::new(2, 4711), |_| Mechanics::default())
    }

    fn with(config: NodeConfig, mechanics: impl Fn(f64) -> Mechanics + 'static) -> Self {
        let mut rig = Self {
            node: Node::new(config),
            now_s: 0.0,
            mechanics: Box::new(mechanics),
            sent: Vec::new(),
        };
        rig.run(STEP_S);
        rig
    }

    /// A feed axis: from the stop at -1000 qc, with its switch from 0 down, to the stop at 30 000 qc.
    fn feed(position_qc: f64) -> Self {
        Self::with(
            NodeConfig {
                position_qc,
                ..NodeConfig::new(2, 4711)
            },
            |position_qc| Mechanics {
                hard_stop_low_qc: Some(-1000.0),
                hard_stop_high_qc: Some(30_000.0),
                inputs: switches([position_qc < 0.0, false, false]),
                ..Mechanics::default()
            },
        )
    }

    fn run(&mut self, time_s: f64) {
        for _ in 0..(time_s / STEP_S).round() as usize {
            self.now_s += STEP_S;
            let mechanics = (self.mechanics)(self.node.position_quadcounts());
            self.sent
                .extend(self.node.step(STEP_S, self.now_s, &mechanics));
        }
    }

    fn run_until(&mut self, limit_s: f64, mut done: impl FnMut(&mut Self) -> bool) -> f64 {
        let start_s = self.now_s;
        while !done(self) {
            assert!(
                self.now_s - start_s < limit_s,
                "not within {limit_s} s; statusword {:04X}",
                self.statusword()
            );
            self.run(STEP_S);
        }
        self.now_s - start_s
    }

    fn send(&mut self, frame: Frame) {
        let answers = self.node.on_frame(&frame, self.now_s);
        self.sent.extend(answers);
    }

    fn nmt(&mut self, command: Command) {
        self.send(nmt::encode(command, Target::Node(2)));
    }

    fn request(&mut self, request: &Request) -> Response {
        let frame = Frame::standard(0x602, request.encode());
        let mut answers = self.node.on_frame(&frame, self.now_s);
        let answer = answers
            .pop()
            .filter(|answer| answer.cob_id() == Some(0x582))
            .expect("an answer");
        self.sent.extend(answers);
        Response::decode(answer.data().try_into().unwrap())
    }

    fn try_write(&mut self, index: u16, subindex: u8, data: &[u8]) -> Result<(), AbortCode> {
        match self.request(&Request::Download(
            Address::new(index, subindex),
            Initiate::of(data),
        )) {
            Response::Download(_) => Ok(()),
            Response::Abort(_, code) => Err(code),
            other => panic!("{other:?}"),
        }
    }

    fn write(&mut self, index: u16, subindex: u8, data: &[u8]) {
        self.try_write(index, subindex, data).unwrap();
    }

    fn read(&mut self, index: u16, subindex: u8) -> i64 {
        let address = Address::new(index, subindex);
        match self.request(&Request::Upload(address)) {
            Response::Upload(_, Initiate::Expedited(payload)) => {
                let kind = epos4_link::dictionary::entries()
                    [epos4_link::dictionary::place(address).unwrap()]
                .kind;
                kind.decode(payload.as_slice()).unwrap()
            }
            other => panic!("{other:?}"),
        }
    }

    fn control(&mut self, controlword: u16) {
        self.write(0x6040, 0, &controlword.to_le_bytes());
    }

    fn statusword(&mut self) -> u16 {
        self.read(0x6041, 0) as u16
    }

    fn state(&mut self) -> State {
        Statusword(self.statusword()).state().unwrap()
    }

    fn has(&mut self, bit: u8) -> bool {
        self.statusword() >> bit & 1 == 1
    }

    fn enable(&mut self) {
        for controlword in [0x06, 0x07, 0x0F] {
            self.control(controlword);
        }
        assert_eq!(self.state(), State::OperationEnabled);
    }

    /// One absolute move in profile position mode; the time it took.
    fn move_to(&mut self, target_qc: i32, limit_s: f64) -> f64 {
        self.write(0x607A, 0, &target_qc.to_le_bytes());
        self.control(0x0F);
        self.control(0x1F);
        assert!(self.has(12) && !self.has(10));
        self.control(0x0F);
        assert!(!self.has(12));
        self.run_until(limit_s, |rig| rig.has(10))
    }

    fn home(&mut self, method: i8, limit_s: f64) -> f64 {
        self.write(0x6098, 0, &method.to_le_bytes());
        self.write(0x6060, 0, &[6]);
        self.enable();
        self.control(0x1F);
        assert_eq!(self.statusword() & 0x3400, 0, "in progress at once");
        self.run_until(limit_s, |rig| rig.statusword() & 0x3400 != 0)
    }

    fn emergencies(&self) -> Vec<u16> {
        self.sent
            .iter()
            .filter_map(Emergency::decode)
            .map(|(_, emergency)| emergency.code)
            .collect()
    }
}

#[test]
fn a_drive_announces_itself_and_then_beats() {
    let mut rig = Rig::new();
    assert_eq!(rig.sent, [Frame::standard(0x702, [0x00])]);
    rig.write(0x1017, 0, &100_u16.to_le_bytes());
    rig.sent.clear();
    rig.run(1.0);
    assert_eq!(rig.sent.len(), 10);
    assert!(
        rig.sent
            .iter()
            .all(|frame| *frame == Frame::standard(0x702, [0x7F]))
    );
    rig.nmt(Command::Start);
    rig.sent.clear();
    rig.run(0.1);
    assert_eq!(rig.sent, [Frame::standard(0x702, [0x05])]);
    rig.nmt(Command::ResetNode);
    rig.sent.clear();
    rig.run(1.0);
    assert_eq!(
        rig.sent,
        [Frame::standard(0x702, [0x00])],
        "the unsaved heartbeat time is gone"
    );
}

#[test]
fn the_identity_is_that_of_the_papers_drive() {
    let mut rig = Rig::new();
    assert_eq!(rig.read(0x1018, 1), 0x0000_00FB);
    assert_eq!(rig.read(0x1018, 2), 0x6050_0000);
    assert_eq!(rig.read(0x1018, 3), 0x0170_0000);
    assert_eq!(rig.read(0x1018, 4), 4711);
    assert_eq!(rig.read(0x3000, 5), 2048);
    assert_eq!(rig.read(0x6502, 0), 0x3A5);
    assert_eq!(
        rig.request(&Request::Upload(Address::new(0x1008, 0))),
        Response::Upload(
            Address::new(0x1008, 0),
            Initiate::Segmented { size: Some(5) }
        )
    );
    match rig.request(&Request::UploadSegment { toggle: false }) {
        Response::UploadSegment(segment) => assert_eq!(
            (segment.payload.as_slice(), segment.last),
            (&b"EPOS4"[..], true)
        ),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_stopped_node_answers_nothing() {
    let mut rig = Rig::new();
    rig.nmt(Command::Stop);
    let upload = Request::Upload(Address::new(0x1018, 1)).encode();
    assert_eq!(
        rig.node
            .on_frame(&Frame::standard(0x602, upload), rig.now_s),
        []
    );
    rig.nmt(Command::EnterPreOperational);
    assert_eq!(rig.read(0x1018, 1), 0xFB);
}

#[test]
fn the_state_machine_follows_the_standard() {
    use State::{OperationEnabled, QuickStopActive, ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn};
    for (path, state) in [
        (&[0x0006_u16][..], ReadyToSwitchOn),
        (&[0x07], SwitchOnDisabled),
        (&[0x0F], SwitchOnDisabled),
        (&[0x06, 0x07], SwitchedOn),
        (&[0x06, 0x0F], OperationEnabled),
        (&[0x06, 0x07, 0x0F], OperationEnabled),
        (&[0x06, 0x07, 0x06], ReadyToSwitchOn),
        (&[0x06, 0x07, 0x00], SwitchOnDisabled),
        (&[0x06, 0x07, 0x02], SwitchOnDisabled),
        (&[0x06, 0x00], SwitchOnDisabled),
        (&[0x06, 0x0F, 0x07], SwitchedOn),
        (&[0x06, 0x0F, 0x06], ReadyToSwitchOn),
        (&[0x06, 0x0F, 0x00], SwitchOnDisabled),
        (&[0x06, 0x0F, 0x02], QuickStopActive),
        (&[0x06, 0x0F, 0x02, 0x0F], OperationEnabled),
        (&[0x06, 0x0F, 0x02, 0x00], SwitchOnDisabled),
        (&[0x06, 0x0F, 0x80], OperationEnabled),
    ] {
        let mut rig = Rig::new();
        for controlword in path {
            rig.control(*controlword);
            rig.run(0.01);
        }
        assert_eq!(rig.state(), state, "{path:X?}");
    }
}

#[test]
fn a_profile_position_move_ends_within_a_quadcount_in_the_time_of_its_trapezoid() {
    let mut rig = Rig::new();
    rig.write(0x6081, 0, &3000_u32.to_le_bytes());
    rig.enable();
    for target_qc in [21_504, -5376, -5375, 100_000, 0] {
        let distance_qc = (f64::from(target_qc) - rig.node.position_quadcounts()).abs();
        // 3000 rpm, 10 000 rpm/s both ways.
        let (speed, acceleration) = (102_400.0_f64, 341_333.3);
        let ideal_s = if distance_qc > speed * speed / acceleration {
            distance_qc / speed + speed / acceleration
        } else {
            2.0 * (distance_qc / acceleration).sqrt()
        };
        let took_s = rig.move_to(target_qc, 10.0);
        assert!(
            (took_s - ideal_s).abs() < 0.02 + 0.01 * ideal_s,
            "{target_qc}: {took_s} s for {ideal_s} s"
        );
        rig.run(0.05);
        assert!((rig.node.position_quadcounts() - f64::from(target_qc)).abs() < 1.0);
        assert_eq!(rig.read(0x6064, 0), i64::from(target_qc));
        assert_eq!(rig.read(0x606C, 0), 0);
    }
}

#[test]
fn set_points_are_buffered_replaced_and_added() {
    let mut rig = Rig::new();
    rig.enable();
    let target = |rig: &mut Rig, target_qc: i32, controlword: u16| {
        rig.write(0x607A, 0, &target_qc.to_le_bytes());
        rig.control(controlword);
    };
    target(&mut rig, 5000, 0x1F);
    rig.control(0x0F);
    // A second one waits, and its acknowledge stays until the first is reached.
    target(&mut rig, 7000, 0x1F);
    rig.control(0x0F);
    assert!(rig.has(12));
    rig.run_until(2.0, |rig| !rig.has(12));
    assert!((rig.node.position_quadcounts() - 5000.0).abs() < 20.0);
    rig.run_until(2.0, |rig| rig.has(10));
    assert_eq!(rig.read(0x6064, 0), 7000);
    // At once, leaving the present one.
    target(&mut rig, 100_000, 0x1F);
    rig.run(0.1);
    target(&mut rig, 6000, 0x0F);
    rig.control(0x3F);
    rig.run_until(3.0, |rig| rig.has(10));
    assert_eq!(rig.read(0x6064, 0), 6000);
    // A distance.
    target(&mut rig, -500, 0x0F);
    rig.control(0x5F);
    rig.run_until(2.0, |rig| rig.has(10));
    assert_eq!(rig.read(0x6064, 0), 5500);
}

#[test]
fn halt_stops_and_its_end_goes_on() {
    let mut rig = Rig::new();
    rig.enable();
    rig.write(0x607A, 0, &50_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run(0.5);
    rig.control(0x11F);
    rig.run_until(0.5, |rig| rig.has(10));
    let halted_qc = rig.node.position_quadcounts();
    rig.run(0.5);
    assert!((rig.node.position_quadcounts() - halted_qc).abs() < 1.0 && halted_qc < 40_000.0);
    rig.control(0x1F);
    rig.run_until(3.0, |rig| rig.has(10));
    assert_eq!(rig.read(0x6064, 0), 50_000);
}

#[test]
fn a_quick_stop_brakes_and_holds() {
    let mut rig = Rig::new();
    rig.enable();
    rig.write(0x607A, 0, &500_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run(1.0);
    let from_qc = rig.node.position_quadcounts();
    rig.control(0x02);
    assert_eq!(rig.state(), State::QuickStopActive);
    rig.run(0.3);
    assert_eq!(
        (rig.state(), rig.read(0x606C, 0)),
        (State::QuickStopActive, 0)
    );
    // 1000 rpm at 10 000 rpm/s
    let way_qc = rig.node.position_quadcounts() - from_qc;
    assert!((way_qc - 1706.7).abs() < 40.0, "{way_qc}");
    rig.control(0x0F);
    rig.run(0.5);
    assert_eq!(
        (rig.state(), rig.read(0x606C, 0)),
        (State::OperationEnabled, 0),
        "nothing goes on by itself"
    );
}

#[test]
fn leaving_operation_waits_for_standstill() {
    let mut rig = Rig::new();
    rig.enable();
    rig.write(0x607A, 0, &500_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run(1.0);
    rig.control(0x07);
    assert_eq!(rig.state(), State::OperationEnabled);
    let took_s = rig.run_until(1.0, |rig| rig.state() == State::SwitchedOn);
    assert!((0.1..0.13).contains(&took_s), "{took_s}");
}

#[test]
fn velocity_mode_turns_at_the_target_velocity() {
    let mut rig = Rig::new();
    rig.write(0x6060, 0, &[3]);
    rig.write(0x60FF, 0, &(-600_i32).to_le_bytes());
    rig.enable();
    rig.run_until(0.2, |rig| rig.has(10));
    assert!(!rig.has(12));
    let from_qc = rig.node.position_quadcounts();
    rig.run(1.0);
    assert!((rig.node.position_quadcounts() - from_qc + 20_480.0).abs() < 30.0);
    assert_eq!(rig.read(0x606C, 0), -600);
    rig.control(0x10F);
    rig.run(0.2);
    assert!(rig.has(10) && rig.has(12));
}

#[test]
fn the_current_limit_stalls_the_drive_on_a_load() {
    // From 10 000 qc on a spring of 50 mA per 1000 qc.
    let mut rig = Rig::with(NodeConfig::new(2, 1), |position_qc| Mechanics {
        load_ma: ((position_qc - 10_000.0) * 0.05).max(0.0),
        ..Mechanics::default()
    });
    rig.write(0x3001, 2, &300_u32.to_le_bytes());
    rig.write(0x6065, 0, &u32::MAX.to_le_bytes());
    rig.enable();
    rig.write(0x607A, 0, &100_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run(4.0);
    assert!(rig.has(11), "internal limit active");
    assert!(
        rig.has(10),
        "without a position window the end of the profile counts"
    );
    rig.write(0x6067, 0, &100_u32.to_le_bytes());
    assert!(!rig.has(10));
    assert_eq!((rig.read(0x30D1, 2), rig.read(0x30D1, 1)), (300, 300));
    assert_eq!(rig.read(0x6077, 0), 600);
    // 300 mA are 40 mA friction and 260 mA spring; momentum carries the shaft a little further. the rotor's momentum presses a little further.
    let position_qc = rig.node.position_quadcounts();
    assert!((15_200.0..15_850.0).contains(&position_qc), "{position_qc}");
    assert_eq!(rig.read(0x606C, 0), 0);
    // And back.
    rig.control(0x0F);
    rig.write(0x6067, 0, &u32::MAX.to_le_bytes());
    rig.move_to(0, 5.0);
}

#[test]
fn a_blocked_shaft_is_a_following_error_until_reset() {
    let mut rig = Rig::feed(29_000.0);
    rig.enable();
    rig.write(0x607A, 0, &50_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run_until(2.0, |rig| rig.state() == State::Fault);
    assert_eq!(rig.emergencies(), [0x8611]);
    assert_eq!((rig.read(0x603F, 0), rig.read(0x1001, 0)), (0x8611, 0x80));
    assert_eq!((rig.read(0x1003, 0), rig.read(0x1003, 1)), (1, 0x8611));
    assert!(rig.has(13));
    assert_eq!(rig.read(0x30D1, 2), 0);
    // The level alone resets nothing, the edge does.
    rig.control(0x0F);
    assert_eq!(rig.state(), State::Fault);
    rig.control(0x80);
    assert_eq!(rig.state(), State::SwitchOnDisabled);
    rig.run(STEP_S);
    assert_eq!(rig.emergencies(), [0x8611, 0x0000]);
    assert_eq!(
        (
            rig.read(0x603F, 0),
            rig.read(0x1001, 0),
            rig.read(0x1003, 0)
        ),
        (0, 0, 1)
    );
    rig.write(0x1003, 0, &[0]);
    assert_eq!((rig.read(0x1003, 0), rig.read(0x1003, 1)), (0, 0));
    rig.enable();
    rig.move_to(0, 3.0);
}

#[test]
fn a_limit_switch_is_a_fault_and_the_way_out_stays_free() {
    let mut rig = Rig::feed(3000.0);
    rig.enable();
    rig.write(0x607A, 0, &(-10_000_i32).to_le_bytes());
    rig.control(0x1F);
    rig.run_until(2.0, |rig| rig.state() == State::Fault);
    assert_eq!(rig.emergencies(), [0x8A80]);
    assert_eq!((rig.read(0x60FD, 0), rig.read(0x3141, 1)), (1, 1));
    rig.control(0x80);
    rig.enable();
    rig.write(0x607A, 0, &(-10_000_i32).to_le_bytes());
    rig.control(0x1F);
    rig.run_until(0.5, |rig| rig.state() == State::Fault);
    rig.control(0x00);
    rig.control(0x80);
    rig.enable();
    rig.move_to(0, 2.0);
    assert_eq!(rig.read(0x60FD, 0), 0);
    assert_eq!(rig.emergencies(), [0x8A80, 0, 0x8A80, 0]);
}

#[test]
fn software_limits_refuse_a_target_beyond() {
    let mut rig = Rig::new();
    rig.write(0x607D, 1, &(-100_i32).to_le_bytes());
    rig.write(0x607D, 2, &5000_i32.to_le_bytes());
    rig.enable();
    rig.move_to(5000, 1.0);
    rig.write(0x607A, 0, &5001_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run(0.1);
    assert_eq!(
        (rig.state(), rig.emergencies()),
        (State::Fault, vec![0x8A82])
    );
    assert_eq!(rig.read(0x6064, 0), 5000);
}

#[test]
fn homing_on_the_limit_switch_finds_its_edge() {
    for start_qc in [9000.0, -500.0] {
        let mut rig = Rig::feed(start_qc);
        rig.write(0x30B0, 0, &(-21_504_i32).to_le_bytes());
        rig.write(0x6099, 1, &300_u32.to_le_bytes());
        rig.home(17, 20.0);
        assert_eq!(
            rig.statusword() & 0xB400,
            0x9400,
            "attained, reached, referenced"
        );
        assert!(
            (0.0..3.0).contains(&rig.node.position_quadcounts()),
            "{}",
            rig.node.position_quadcounts()
        );
        assert_eq!(rig.read(0x6064, 0), -21_504);
        assert!(rig.emergencies().is_empty());
    }
}

#[test]
fn homing_moves_by_its_offset_and_sets_the_position_there() {
    let mut rig = Rig::feed(9000.0);
    rig.write(0x30B1, 0, &2048_i32.to_le_bytes());
    rig.home(17, 40.0);
    assert_eq!(rig.read(0x6064, 0), 0);
    assert!((rig.node.position_quadcounts() - 2048.0).abs() < 3.0);
    rig.write(0x6060, 0, &[1]);
    rig.control(0x0F);
    rig.move_to(5000, 2.0);
    assert!((rig.node.position_quadcounts() - 7048.0).abs() < 3.0);
    assert!(rig.has(15));
}

#[test]
fn homing_by_current_finds_the_hard_stop() {
    for (method, start_qc, stop_qc) in [(-4, 9000.0, 0.0), (-3, 9000.0, 30_000.0)] {
        let mut rig = Rig::with(
            NodeConfig {
                position_qc: start_qc,
                ..NodeConfig::new(2, 1)
            },
            |_| Mechanics {
                hard_stop_low_qc: Some(0.0),
                hard_stop_high_qc: Some(30_000.0),
                ..Mechanics::default()
            },
        );
        rig.write(0x6099, 1, &500_u32.to_le_bytes());
        rig.home(method, 30.0);
        assert_eq!(rig.statusword() & 0x3400, 0x1400);
        assert_eq!(
            (rig.node.position_quadcounts(), rig.read(0x6064, 0)),
            (stop_qc, 0),
            "method {method}"
        );
    }
}

#[test]
fn homing_by_current_below_the_threshold_ends_in_a_following_error() {
    let mut rig = Rig::with(NodeConfig::new(2, 1), |_| Mechanics {
        hard_stop_low_qc: Some(0.0),
        ..Mechanics::default()
    });
    rig.write(0x3001, 2, &400_u32.to_le_bytes());
    rig.home(-4, 5.0);
    assert_eq!(rig.statusword() & 0x3400, 0x2000, "homing error");
    assert_eq!(rig.emergencies(), [0x8611]);
    assert!(!rig.has(15));
}

#[test]
fn homing_on_home_switch_index_and_present_position() {
    let home_switch = |position_qc: f64| Mechanics {
        inputs: switches([
            position_qc < -10_000.0,
            position_qc > 20_000.0,
            (5000.0..8000.0).contains(&position_qc),
        ]),
        ..Mechanics::default()
    };
    for (method, start_qc, home_qc) in [
        (23, 0.0, 4999.0),
        (23, 6000.0, 4999.0),
        (23, 12_000.0, 4999.0),
        (27, 12_000.0, 8000.0),
        (27, 0.0, 8000.0),
        (7, 0.0, 4096.0),
        (11, 12_000.0, 8192.0),
        (1, 0.0, -8192.0),
        (2, 0.0, 18_432.0),
        (18, 0.0, 20_000.0),
        (33, 100.0, 0.0),
        (34, 100.0, 2048.0),
        (37, 1234.0, 1234.0),
    ] {
        let mut rig = Rig::with(
            NodeConfig {
                position_qc: start_qc,
                ..NodeConfig::new(2, 1)
            },
            home_switch,
        );
        rig.write(0x6099, 1, &200_u32.to_le_bytes());
        rig.write(0x6099, 2, &60_u32.to_le_bytes());
        rig.home(method, 60.0);
        assert_eq!(rig.statusword() & 0xB400, 0x9400, "method {method}");
        let position_qc = rig.node.position_quadcounts();
        assert!(
            (position_qc - home_qc).abs() < 6.0,
            "method {method} from {start_qc}: {position_qc}"
        );
        assert_eq!(rig.read(0x6064, 0), 0);
    }
}

#[test]
fn homing_is_interrupted_when_its_start_bit_falls() {
    let mut rig = Rig::feed(25_000.0);
    rig.write(0x6098, 0, &[17]);
    rig.write(0x6060, 0, &[6]);
    rig.enable();
    rig.control(0x1F);
    rig.run(0.5);
    rig.control(0x0F);
    rig.run_until(0.5, |rig| rig.statusword() & 0x3400 == 0x0400);
    assert!(!rig.has(15));
}

#[test]
fn a_lost_master_heartbeat_stops_the_motion() {
    let mut rig = Rig::new();
    rig.write(0x1016, 1, &(0x7F_0000_u32 | 300).to_le_bytes());
    rig.nmt(Command::Start);
    rig.enable();
    rig.write(0x607A, 0, &500_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run(0.5);
    assert_eq!(
        rig.state(),
        State::OperationEnabled,
        "no heartbeat yet, nothing to lose"
    );
    for _ in 0..10 {
        rig.send(heartbeat::encode(0x7F, NmtState::Operational));
        rig.run(0.1);
    }
    assert_eq!(rig.state(), State::OperationEnabled);
    let took_s = rig.run_until(1.0, |rig| rig.state() == State::Fault);
    assert!((0.2..0.35).contains(&took_s), "{took_s}");
    rig.run(0.01);
    assert_eq!((rig.emergencies(), rig.read(0x606C, 0)), (vec![0x8130], 0));
    assert_eq!(rig.read(0x1001, 0), 0x10);
    assert!(!rig.has(9), "back in pre-operational");
}

#[test]
fn an_nmt_stop_brings_a_moving_drive_to_a_stand() {
    let mut rig = Rig::new();
    rig.nmt(Command::Start);
    rig.enable();
    rig.write(0x607A, 0, &500_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run(0.5);
    rig.nmt(Command::Stop);
    rig.run(0.5);
    assert_eq!(rig.node.drive_state(), State::SwitchOnDisabled);
    let position_qc = rig.node.position_quadcounts();
    rig.run(0.5);
    assert_eq!(rig.node.position_quadcounts(), position_qc);
}

#[test]
fn process_data_command_and_report() {
    let mut rig = Rig::new();
    rig.nmt(Command::Start);
    let tpdo = |rig: &Rig| {
        rig.sent
            .iter()
            .filter(|frame| frame.cob_id() == Some(0x182))
            .map(|frame| frame.data().to_vec())
            .next_back()
    };
    assert_eq!(tpdo(&rig), Some(vec![0x40, 0x02]));
    for (controlword, statusword) in [(0x06, 0x0221_u16), (0x07, 0x0233), (0x0F, 0x0637)] {
        rig.run(STEP_S);
        rig.send(Frame::standard(0x202, [controlword, 0]));
        assert_eq!(tpdo(&rig), Some(statusword.to_le_bytes().to_vec()));
    }
    rig.send(Frame::standard(0x402, [0x1F, 0, 0xE8, 0x03, 0, 0]));
    rig.run(0.5);
    assert_eq!(rig.node.position_quadcounts().round(), 1000.0);
    rig.send(Frame::standard(0x402, [0x0F, 0]));
    rig.run(0.5);
    assert_eq!(
        (rig.emergencies(), rig.state()),
        (vec![0x8210], State::Fault)
    );
}

#[test]
fn process_data_on_sync_comes_with_every_nth() {
    let mut rig = Rig::new();
    rig.write(0x1802, 2, &[2]);
    rig.write(0x1802, 1, &0x4000_0382_u32.to_le_bytes());
    rig.nmt(Command::Start);
    rig.sent.clear();
    for _ in 0..6 {
        rig.run(0.01);
        rig.send(Frame::standard(0x080, []));
    }
    let synced: Vec<_> = rig
        .sent
        .iter()
        .filter(|frame| frame.id() == Id::standard(0x382))
        .collect();
    assert_eq!(synced.len(), 3);
    assert_eq!(synced[0].data().len(), 6);
}

#[test]
fn a_restart_forgets_the_reference_but_not_the_place() {
    let mut rig = Rig::feed(9000.0);
    rig.home(37, 1.0);
    assert!(rig.has(15));
    rig.nmt(Command::ResetNode);
    rig.run(0.01);
    assert!(!rig.has(15));
    assert_eq!(
        (rig.state(), rig.read(0x6064, 0)),
        (State::SwitchOnDisabled, 0)
    );
    assert_eq!(rig.node.position_quadcounts(), 9000.0);
}

#[test]
fn an_injected_error_is_reported_and_disables() {
    let mut rig = Rig::new();
    rig.enable();
    rig.node.inject_error(0x2310);
    rig.run(STEP_S);
    assert_eq!(
        (rig.state(), rig.emergencies(), rig.read(0x1001, 0)),
        (State::Fault, vec![0x2310], 2)
    );
}

#[test]
fn block_transfer_is_refused_as_unknown() {
    let mut rig = Rig::new();
    let response = rig.request(&Request::Other(0xA0));
    assert!(
        matches!(response, Response::Abort(_, AbortCode::UNKNOWN_COMMAND)),
        "{response:?}"
    );
}
