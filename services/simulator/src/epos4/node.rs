//! One simulated EPOS4: everything that it answers on the bus, and its shaft.

use epos4_link::canopen::emcy::Emergency;
use epos4_link::canopen::heartbeat;
use epos4_link::canopen::nmt::{self, Command, State as NmtState};
use epos4_link::canopen::object::Address;
use epos4_link::canopen::sdo::server::{Dictionary, Length, Server};
use epos4_link::canopen::sdo::{AbortCode, request_cob_id, response_cob_id};
use epos4_link::cia402::State;
use epos4_link::frame::Frame;

use super::drive::{Control, Drive};
use super::faults::{self, Faults};
use super::inputs;
use super::network::Network;
use super::objects::{Objects, Power};
use super::parameters::Parameters;
use super::pdo::{self, Occasion, Received, TransmitPdos};
use super::shaft::{Mechanics, Motor};
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
    mechanics: Mechanics,
}

/// What an SDO request reads and writes: the node without its SDO server.
#[derive(Debug)]
struct Device {
    objects: Objects,
    /// The revision of the objects of which they are a snapshot.
    parameters: (u64, Parameters),
    drive: Drive,
    faults: Faults,
    /// Whether the network lets the drive be commanded: statusword bit 9.
    remote: bool,
    /// Emergencies not yet on the bus.
    emergencies: Vec<Emergency>,
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
                (objects::OUTPUT_CURRENT_LIMIT.address, 1000),
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
            device: Device {
                parameters: (objects.revision(), Parameters::of(&objects)),
                objects,
                drive: Drive::new(config.position_qc, config.motor),
                faults: Faults::default(),
                remote: false,
                emergencies: Vec::new(),
            },
            mechanics: Mechanics::default(),
        }
    }

    /// The node id.
    #[must_use]
    pub fn node_id(&self) -> u8 {
        self.node_id
    }

    /// Where the true shaft is, quadcounts. What the drive counts (0x6064) differs by its reference.
    #[must_use]
    pub fn position_quadcounts(&self) -> f64 {
        self.device.drive.shaft().position_qc
    }

    /// The true current, mA, signed.
    #[must_use]
    pub fn current_ma(&self) -> f64 {
        self.device.drive.shaft().current_ma
    }

    /// The CiA 402 state.
    #[must_use]
    pub fn drive_state(&self) -> State {
        self.device.drive.state()
    }

    /// A frame of another node or of the master was on the bus; what this node answers.
    pub fn on_frame(&mut self, frame: &Frame, now_s: f64) -> Vec<Frame> {
        if self.network.state() == NmtState::BootUp {
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
            Some(SYNC_COB_ID) => self.outgoing(Occasion::Sync, now_s),
            Some(cob_id) if cob_id == request_cob_id(self.node_id) => self.answer_sdo(frame, now_s),
            _ if self.network.state() == NmtState::Operational => self.receive_pdo(frame, now_s),
            _ => Vec::new(),
        }
    }

    /// Lets time pass up to `now_s`; what this node sends by itself.
    pub fn step(&mut self, dt_s: f64, now_s: f64, mechanics: &Mechanics) -> Vec<Frame> {
        self.mechanics = *mechanics;
        let mut frames: Vec<Frame> = self
            .network
            .due(self.node_id, &self.device.objects, now_s)
            .into_iter()
            .collect();
        let parameters = self.device.parameters();
        for code in self.device.drive.step(dt_s, &parameters, mechanics) {
            self.device.announce(code);
        }
        if self.network.lost_a_heartbeat(&self.device.objects, now_s) {
            self.device.raise(faults::code::HEARTBEAT);
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

    /// The controlword acts last, on the targets that came with it.
    fn receive_pdo(&mut self, frame: &Frame, now_s: f64) -> Vec<Frame> {
        match pdo::receive(frame, &self.device.objects) {
            None => return Vec::new(),
            Some(Received::TooShort) => {
                self.device.raise(faults::code::PDO_LENGTH);
                self.network.on_communication_error(&self.device.objects);
            }
            Some(Received::Objects(mut received)) => {
                received.sort_by_key(|(address, _)| *address == objects::CONTROLWORD.address);
                for (address, bytes) in received {
                    if let Err(code) = self.device.write(address, &bytes, Length::Given) {
                        tracing::debug!(node = self.node_id, object = %address, %code, "process data refused");
                    }
                }
            }
        }
        self.outgoing(Occasion::Event, now_s)
    }
}

impl Device {
    /// The parameters in force.
    fn parameters(&mut self) -> Parameters {
        let revision = self.objects.revision();
        if self.parameters.0 != revision {
            self.parameters = (revision, Parameters::of(&self.objects));
        }
        self.parameters.1.clone()
    }

    /// Puts an error into register and history, and reacts.
    fn raise(&mut self, code: u16) {
        let parameters = self.parameters();
        self.announce(code);
        self.drive.react(faults::effect(code).1, &parameters);
    }

    /// Puts an error to which the drive has reacted into register and history.
    fn announce(&mut self, code: u16) {
        if faults::loses_reference(code) {
            self.drive.lose_reference();
        }
        self.emergencies
            .extend(self.faults.raise(code, &mut self.objects));
    }

    fn control(&mut self, controlword: u16) {
        let parameters = self.parameters();
        match self.drive.control(controlword, &parameters) {
            Control::Done => {}
            Control::AcknowledgeErrors => self
                .emergencies
                .extend(self.faults.reset(&mut self.objects)),
            Control::Raise(code) => self.raise(code),
        }
    }

    fn abort_connection(&mut self) {
        let parameters = self.parameters();
        self.drive.abort_connection(&parameters);
    }

    fn restart(&mut self) {
        self.objects.restart();
        self.drive.restart();
        self.faults = Faults::default();
        self.emergencies.clear();
    }

    /// Brings the objects that show the drive's state up to date.
    fn publish(&mut self, mechanics: &Mechanics) {
        let parameters = self.parameters();
        let (shaft, demand) = (*self.drive.shaft(), *self.drive.trajectory());
        let position_qc = self.drive.counted_qc(shaft.position_qc);
        let rpm = |speed_qc_s: f64| (speed_qc_s / parameters.qc_s_per_rpm).round() as i64;
        let nominal_ma = self.objects.get(objects::NOMINAL_CURRENT.address).max(1) as f64;
        let per_mille = |current_ma: f64| {
            (current_ma / nominal_ma * 1000.0)
                .round()
                .clamp(-32_768.0, 32_767.0) as i64
        };
        let values = [
            (
                objects::STATUSWORD.address,
                i64::from(self.drive.statusword(&parameters, self.remote)),
            ),
            (
                objects::MODES_OF_OPERATION_DISPLAY.address,
                self.drive.mode_code(),
            ),
            (objects::POSITION_ACTUAL.address, position_qc),
            (objects::SENSOR_POSITION.address, position_qc),
            (
                objects::POSITION_DEMAND.address,
                self.drive.counted_qc(demand.position_qc),
            ),
            (
                objects::FOLLOWING_ERROR.address,
                (demand.position_qc - shaft.position_qc).round() as i64,
            ),
            (objects::VELOCITY_DEMAND.address, rpm(demand.speed_qc_s)),
            (objects::VELOCITY_ACTUAL.address, rpm(shaft.speed_qc_s)),
            (objects::SENSOR_VELOCITY.address, rpm(shaft.speed_qc_s)),
            (
                objects::VELOCITY_AVERAGED.address,
                rpm(shaft.speed_averaged_qc_s),
            ),
            (
                objects::CURRENT_DEMAND.address,
                shaft.current_ma.round() as i64,
            ),
            (
                objects::CURRENT_ACTUAL.address,
                shaft.current_ma.round() as i64,
            ),
            (
                objects::CURRENT_AVERAGED.address,
                shaft.current_averaged_ma.round() as i64,
            ),
            (objects::TORQUE_ACTUAL.address, per_mille(shaft.current_ma)),
            (
                objects::TORQUE_AVERAGED.address,
                per_mille(shaft.current_averaged_ma),
            ),
            (
                objects::INPUT_LEVELS.address,
                i64::from(inputs::levels(mechanics)),
            ),
            (
                objects::DIGITAL_INPUTS.address,
                i64::from(self.drive.inputs().0),
            ),
        ];
        for (address, value) in values {
            self.objects.set(address, value);
        }
    }
}

impl Dictionary for Device {
    fn read(&mut self, address: Address) -> Result<Vec<u8>, AbortCode> {
        self.objects.read(address)
    }

    fn write(&mut self, address: Address, data: &[u8], length: Length) -> Result<(), AbortCode> {
        let power: Power = self.drive.power();
        self.objects.write(address, data, length, power)?;
        const CONTROLWORD: Address = objects::CONTROLWORD.address;
        const MODES_OF_OPERATION: Address = objects::MODES_OF_OPERATION.address;
        const ERROR_HISTORY_COUNT: Address = objects::ERROR_HISTORY_COUNT.address;
        match address {
            CONTROLWORD => self.control(self.objects.get(objects::CONTROLWORD.address) as u16),
            MODES_OF_OPERATION => self
                .drive
                .set_mode(self.objects.get(objects::MODES_OF_OPERATION.address)),
            ERROR_HISTORY_COUNT => faults::clear_history(&mut self.objects),
            _ => {}
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
