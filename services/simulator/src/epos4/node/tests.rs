//! A master's view of one drive, frame by frame.

mod cyclic;
mod defects;
mod errors;
mod fuzz;
mod homing;
mod inputs;
mod machine;
mod modes;
mod network;
mod process_data;
mod supervision;

use epos4_link::canopen::emcy::Emergency;
use epos4_link::canopen::nmt::Target;
use epos4_link::canopen::sdo::{AbortCode, Initiate, Request, Response};
use epos4_link::cia402::Statusword;
use epos4_link::frame::Id;

use super::*;
use crate::epos4::drives::Drives;
use crate::epos4::fault::Fault;
use crate::epos4::mechanics::{Contact, INPUT_COUNT, Input};

const STEP_S: f64 = 0.002;

/// One drive, a master's hands on it, and everything that the drive sent.
struct Rig {
    drives: Drives,
    step_s: f64,
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
            drives: Drives::new(vec![Node::new(config)]),
            step_s: STEP_S,
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
        for _ in 0..(time_s / self.step_s).round() as usize {
            self.now_s += self.step_s;
            let mechanics = (self.mechanics)(self.drives.nodes[0].position_quadcounts());
            let sent = self.drives.tick(self.step_s, self.now_s, &[mechanics]);
            self.sent.extend(sent);
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
            self.run(self.step_s);
        }
        self.now_s - start_s
    }

    fn node(&mut self) -> &mut Node {
        &mut self.drives.nodes[0]
    }

    /// Does something to the drive.
    fn inject(&mut self, fault: Fault) -> u64 {
        self.drives.inject(Some(2), fault, 7).unwrap()
    }

    fn clear(&mut self, id: u64) {
        assert_eq!(self.drives.clear(Some(id)).len(), 1);
    }

    fn affected(&mut self) -> u64 {
        self.drives.faults().list()[0].affected
    }

    fn send(&mut self, frame: Frame) {
        let answers = self.drives.on_frame(&frame, self.now_s);
        self.sent.extend(answers);
    }

    fn nmt(&mut self, command: Command) {
        self.send(nmt::encode(command, Target::Node(2)));
    }

    fn request(&mut self, request: &Request) -> Response {
        let frame = Frame::standard(0x602, request.encode());
        let mut answers = self.drives.on_frame(&frame, self.now_s);
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
