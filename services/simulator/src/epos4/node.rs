//! One simulated EPOS4: everything that it answers on the bus, and its shaft.

mod device;

use std::collections::BTreeMap;

use epos4_link::canopen::heartbeat;
use epos4_link::canopen::nmt::{self, Command, State as NmtState};
use epos4_link::canopen::object::Address;
use epos4_link::canopen::sdo::server::Server;
use epos4_link::canopen::sdo::{request_cob_id, response_cob_id};
use epos4_link::cia402::State;
use epos4_link::frame::Frame;

use self::device::Device;
use super::defects::Defects;
use super::drive::Drive;
use super::errors;
use super::mechanics::Mechanics;
use super::network::Network;
use super::objects::Objects;
use super::pdo::{self, Occasion, Received, TransmitPdos};
use super::shaft::Motor;
use epos4_link::objects;

/// What distinguishes one drive from another.
#[derive(Clone, Debug)]
pub struct NodeConfig {
    /// 1 to 127.
    pub node_id: u8,
    /// Object 0x1018:04.
    pub serial: u32,
    /// Where the true shaft stands at power-up, quadcounts. The drive does not know: it counts from 0.
    pub position_qc: f64,
    /// The motor.
    pub motor: Motor,
    /// Parameters that were stored when the drive was commissioned.
    pub parameters: Vec<(Address, i64)>,
}

/// One drive.
#[derive(Debug)]
pub struct Node {
    node_id: u8,
    network: Network,
    sdo: Server,
    transmit: TransmitPdos,
    device: Device,
    /// What arrived of the mechanism in the last step.
    mechanics: Mechanics,
    /// Process data that wait for SYNC, by number.
    awaiting_sync: BTreeMap<u16, Vec<(Address, Vec<u8>)>>,
    supplied: bool,
}

const SYNC_COB_ID: u16 = 0x080;

impl NodeConfig {
    /// A drive with the axis' motor: brushed DC, encoder with 512 pulses a turn, gear 21:1, 500 mA nominal.
    #[must_use]
    pub fn new(node_id: u8, serial: u32) -> Self {
        Self {
            node_id,
            serial,
            position_qc: 0.0,
            motor: Motor::default(),
            parameters: vec![
                (objects::SENSORS_CONFIGURATION.address, 0x0000_0001),
                (objects::CONTROL_STRUCTURE.address, 0x0001_1111),
                (objects::COMMUTATION_SENSORS.address, 0),
                (objects::MOTOR_TYPE.address, 1),
                (objects::TORQUE_CONSTANT.address, 9_000),
                (objects::ENCODER_PULSES.address, 512),
                (objects::GEAR_NUMERATOR.address, 21),
                (objects::GEAR_DENOMINATOR.address, 1),
                (objects::NOMINAL_CURRENT.address, 500),
                (objects::OUTPUT_CURRENT_LIMIT.address, 800),
            ],
        }
    }
}

impl Node {
    /// A drive just powered up. Its boot-up message goes out with the first step.
    #[must_use]
    pub fn new(config: NodeConfig) -> Self {
        let mut parameters = config.parameters;
        parameters.push((objects::SERIAL_NUMBER.address, i64::from(config.serial)));
        let objects = Objects::new(config.node_id, &parameters);
        Self {
            node_id: config.node_id,
            network: Network::new(),
            sdo: Server::default(),
            transmit: TransmitPdos::default(),
            device: Device::new(objects, Drive::new(config.position_qc, config.motor)),
            mechanics: Mechanics::default(),
            awaiting_sync: BTreeMap::new(),
            supplied: true,
        }
    }

    /// The node id.
    #[must_use]
    pub fn node_id(&self) -> u8 {
        self.node_id
    }

    /// Where the mechanism truly is, quadcounts of the shaft that turns it. What the drive counts (0x6064) differs by its
    /// reference, and by what belt and encoder lost.
    #[must_use]
    pub fn position_quadcounts(&self) -> f64 {
        self.device.drive.shaft().mechanism_qc()
    }

    /// The true speed of the motor, quadcounts a second, signed.
    #[must_use]
    pub fn speed_quadcounts_s(&self) -> f64 {
        self.device.drive.shaft().rotor_qc_s()
    }

    /// The true force at the tool, N: of a feed between its blades.
    #[must_use]
    pub fn tool_force_n(&self) -> f64 {
        self.mechanics.tool_force_n
    }

    /// Whether it is supplied with power.
    #[must_use]
    pub fn is_supplied(&self) -> bool {
        self.supplied
    }

    /// Its state on the network.
    #[must_use]
    pub fn network_state(&self) -> NmtState {
        self.network.state()
    }

    /// Takes the supply away, or gives it back: then it boots as after power-up. Without it the motor is free.
    pub fn supply(&mut self, supplied: bool) {
        if supplied == self.supplied {
            return;
        }
        self.supplied = supplied;
        self.device.restart();
        self.network = Network::new();
        self.sdo = Server::default();
        self.awaiting_sync.clear();
    }

    /// What is wrong with it from now on.
    pub fn suffer(&mut self, defects: Defects) {
        self.device.defects = defects;
    }

    /// Makes the motor as warm as this in its I2t model, %.
    pub fn heat_motor(&mut self, level_percent: f64) {
        self.device.drive.thermal().heat_motor(level_percent);
    }

    /// The true current, mA, signed.
    #[must_use]
    pub fn current_ma(&self) -> f64 {
        self.device.drive.shaft().current_ma
    }

    /// How long until a heartbeat that the drive expects counts as missed; none when it expects none.
    #[must_use]
    pub fn patience_s(&self, now_s: f64) -> Option<f64> {
        self.network.patience_s(now_s)
    }

    /// The CiA 402 state.
    #[must_use]
    pub fn drive_state(&self) -> State {
        self.device.drive.state()
    }

    /// A frame of another node or of the master was on the bus; what this node answers.
    pub fn on_frame(&mut self, frame: &Frame, now_s: f64) -> Vec<Frame> {
        if !self.supplied || self.network.state() == NmtState::BootUp {
            return Vec::new();
        }
        if let Some((command, target)) = nmt::decode(frame) {
            if target.includes(self.node_id) {
                self.obey_network(command);
            }
            return self.outgoing(Occasion::Event, now_s);
        }
        if let Some((from, state)) = heartbeat::decode(frame) {
            self.network.on_heartbeat(from, state, now_s);
            return Vec::new();
        }
        match frame.cob_id() {
            Some(SYNC_COB_ID) => {
                for (_, received) in std::mem::take(&mut self.awaiting_sync) {
                    self.device.receive(received);
                }
                self.outgoing(Occasion::Sync, now_s)
            }
            Some(cob_id) if cob_id == request_cob_id(self.node_id) => self.answer_sdo(frame, now_s),
            _ if self.network.state() == NmtState::Operational => self.receive_pdo(frame, now_s),
            _ => Vec::new(),
        }
    }

    /// Lets time pass up to `now_s`; what this node sends by itself.
    pub fn step(&mut self, dt_s: f64, now_s: f64, mechanics: &Mechanics) -> Vec<Frame> {
        self.mechanics = self.device.defects.wired(mechanics);
        let drivetrain = self.device.defects.drivetrain;
        let parameters = self.device.parameters();
        if !self.supplied {
            self.device
                .drive
                .step(dt_s, &parameters, &self.mechanics, drivetrain);
            return Vec::new();
        }
        let mut frames: Vec<Frame> = self
            .network
            .due(self.node_id, &self.device.objects, now_s)
            .into_iter()
            .collect();
        let drive = &mut self.device.drive;
        for code in drive.step(dt_s, &parameters, &self.mechanics, drivetrain) {
            self.device.announce(code);
        }
        self.device.supervise(dt_s);
        if self.network.lost_a_heartbeat(&self.device.objects, now_s) {
            self.device.raise(errors::code::HEARTBEAT);
            self.network.on_communication_error(&self.device.objects);
        }
        frames.extend(self.outgoing(Occasion::Event, now_s));
        frames
    }

    /// Makes an error appear, as a defect would; its emergency goes out with the next step.
    pub fn inject_error(&mut self, code: u16) {
        self.device.raise(code);
    }

    fn obey_network(&mut self, command: Command) {
        let before = self.network.state();
        self.network.obey(command);
        match command {
            Command::Start if before != NmtState::Operational => self.transmit.restart(),
            Command::Stop => self.device.abort_connection(),
            Command::ResetCommunication => {
                self.device.abort_connection();
                self.device.objects.restart_communication();
                self.sdo = Server::default();
            }
            Command::ResetNode => {
                self.device.restart();
                self.sdo = Server::default();
                self.awaiting_sync.clear();
            }
            Command::Start | Command::EnterPreOperational => {}
        }
    }

    /// Emergencies and PDOs that are due. A stopped node is silent.
    fn outgoing(&mut self, occasion: Occasion, now_s: f64) -> Vec<Frame> {
        let state = self.network.state();
        self.device.remote = state == NmtState::Operational;
        self.device.publish(&self.mechanics);
        let emergencies = std::mem::take(&mut self.device.emergencies);
        let mut frames = Vec::new();
        if matches!(state, NmtState::PreOperational | NmtState::Operational) {
            frames.extend(
                emergencies
                    .iter()
                    .map(|emergency| emergency.encode(self.node_id)),
            );
        }
        if state == NmtState::Operational {
            frames.extend(self.transmit.due(&self.device.objects, occasion, now_s));
        }
        frames
    }

    /// What a request changed is sent ahead of its answer, so that a master that has the answer has the change.
    fn answer_sdo(&mut self, frame: &Frame, now_s: f64) -> Vec<Frame> {
        let Ok(request) = frame.data().try_into() else {
            return Vec::new();
        };
        if self.network.state() == NmtState::Stopped {
            return Vec::new();
        }
        self.device.publish(&self.mechanics);
        let answer = self.sdo.answer(request, &mut self.device);
        let mut frames = self.outgoing(Occasion::Event, now_s);
        frames.extend(answer.map(|answer| Frame::standard(response_cob_id(self.node_id), answer)));
        frames
    }

    fn receive_pdo(&mut self, frame: &Frame, now_s: f64) -> Vec<Frame> {
        match pdo::receive(frame, &self.device.objects) {
            None => return Vec::new(),
            Some(Received::TooShort) => {
                self.device.raise(errors::code::PDO_LENGTH);
                self.network.on_communication_error(&self.device.objects);
            }
            Some(Received::Objects(received)) => self.device.receive(received),
            Some(Received::OnSync(number, received)) => {
                self.awaiting_sync.insert(number, received);
            }
        }
        self.outgoing(Occasion::Event, now_s)
    }
}

#[cfg(test)]
mod tests;
