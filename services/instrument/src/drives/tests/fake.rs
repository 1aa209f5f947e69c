//! Four small drives on a bus within the process. Their clock runs ahead of real time, but never farther than a few
//! heartbeats of the service that they have not heard, so that nothing depends on how fast the test runs.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use epos4_link::bus::{self, CanBus, in_process};
use epos4_link::canopen::emcy::Emergency;
use epos4_link::canopen::object::{Address, Object, Value};
use epos4_link::canopen::sdo::server::{Dictionary, Length, Server};
use epos4_link::canopen::sdo::{AbortCode, response_cob_id};
use epos4_link::canopen::{heartbeat, nmt};
use epos4_link::cia402::{Command, State, Statusword, homing, profile_position};
use epos4_link::dictionary;
use epos4_link::frame::Frame;
use epos4_link::objects;
use tokio::sync::watch;

/// Where the blades touch, 10 mm.
const CLOSED_QC: f64 = 215_040.0;
/// Blade on blade, 2000 mA/mm.
const MA_PER_QC: f64 = 2000.0 / 21_504.0;

/// The bus with its drives. Clones are the same.
#[derive(Clone)]
pub(super) struct FakeCell {
    bus: in_process::Bus,
    /// In the order of the node ids, from 1.
    pub(super) drives: watch::Sender<[Drive; 4]>,
    micros_per_tick: Arc<AtomicU64>,
    /// What others than drives sent.
    pub(super) host_heartbeats: Arc<AtomicU64>,
    pub(super) host_pdos: Arc<Mutex<Vec<Frame>>>,
}

/// The drives' time that a millisecond of real time takes.
const MICROS_PER_TICK: u64 = 20_000;
/// The drives' clock stands when the service's heartbeat is owed for this long.
const OWED_HEARTBEAT_US: u64 = 200_000;
const HOST: u8 = 127;

#[derive(Clone, Debug)]
pub(super) struct Drive {
    node_id: u8,
    pub(super) objects: BTreeMap<Address, Vec<u8>>,
    pub(super) nmt_state: nmt::State,
    pub(super) state: State,
    pub(super) homed: bool,
    pub(super) position_qc: f64,
    demand_qc: f64,
    target_qc: Option<f64>,
    homing_ends_in_us: Option<u64>,
    controlword: u16,
    /// What stops the motor when it moves forward.
    pub(super) obstacle_qc: Option<f64>,
    /// What the motor draws while it moves, mA.
    pub(super) running_ma: i32,
    /// The motor turns and the jaw does not close.
    pub(super) belt_slips: bool,
    /// Neither answers nor sends.
    pub(super) dead: bool,
    /// Read instead of the true statusword.
    pub(super) statusword: Option<u16>,
    pub(super) fault_persists: bool,
    /// Sends no process data.
    pub(super) mute: bool,
    /// What was sent last in TPDO 1 to 3, and when.
    sent_pdos: [Option<(Vec<u8>, u64)>; 3],
    /// Controlwords in the order of their coming.
    pub(super) controlwords: Vec<u16>,
    /// Targets that were taken.
    pub(super) targets_qc: Vec<i32>,
}

impl FakeCell {
    pub(super) fn start() -> Self {
        let clock = Arc::new(AtomicU64::new(0));
        let read_clock = clock.clone();
        let bus =
            in_process::Bus::new(move || Duration::from_micros(read_clock.load(Ordering::Relaxed)));
        let drives = watch::Sender::new([1, 2, 3, 4].map(Drive::new));
        let cell = Self {
            bus,
            drives,
            micros_per_tick: Arc::new(AtomicU64::new(MICROS_PER_TICK)),
            host_heartbeats: Arc::default(),
            host_pdos: Arc::default(),
        };
        tokio::spawn(cell.clone().run(clock));
        cell
    }

    /// All but stops the drives' clock, and with it every motion.
    pub(super) fn hold_time(&self) {
        self.micros_per_tick.store(1, Ordering::Relaxed);
    }

    pub(super) fn let_time_go(&self) {
        self.micros_per_tick
            .store(MICROS_PER_TICK, Ordering::Relaxed);
    }

    /// Sends a frame as if from elsewhere on the bus.
    pub(super) fn inject(&self, frame: Frame) {
        self.bus.attach().send(frame).unwrap();
    }

    pub(super) fn attach(&self) -> Box<dyn CanBus> {
        Box::new(self.bus.attach())
    }

    /// Changes a drive; its node id counts from 1.
    pub(super) fn change(&self, node_id: usize, change: impl FnOnce(&mut Drive)) {
        self.drives
            .send_modify(|drives| change(&mut drives[node_id - 1]));
    }

    pub(super) fn drive(&self, node_id: usize) -> Drive {
        self.drives.borrow()[node_id - 1].clone()
    }

    /// Waits until a drive is as wanted.
    pub(super) async fn until(&self, node_id: usize, wanted: impl Fn(&Drive) -> bool) {
        let mut drives = self.drives.subscribe();
        let reached = drives.wait_for(|drives| wanted(&drives[node_id - 1]));
        let in_time = tokio::time::timeout(Duration::from_secs(30), reached)
            .await
            .is_ok();
        assert!(in_time, "{:#?}", self.drive(node_id));
    }

    /// Sends an emergency and puts the drive into fault.
    pub(super) fn fault(&self, node_id: usize, code: u16) {
        self.change(node_id, |drive| drive.enter_fault(code));
        let emergency = Emergency::new(code, 1).encode(node_id as u8);
        self.inject(emergency);
    }

    /// Nothing is heard of the drive between its end and its boot-up message.
    pub(super) fn restart(&self, node_id: usize) {
        self.restart_as(node_id, |_| {});
    }

    /// The same, and the drive is otherwise than before.
    pub(super) fn restart_as(&self, node_id: usize, change: impl FnOnce(&mut Drive)) {
        self.change(node_id, |drive| {
            *drive = Drive::new(node_id as u8);
            change(drive);
            drive.dead = true;
        });
        let boot_up = heartbeat::encode(node_id as u8, nmt::State::BootUp);
        self.inject(boot_up);
        self.change(node_id, |drive| drive.dead = false);
    }

    async fn run(self, clock: Arc<AtomicU64>) {
        let mut port = self.attach();
        let mut servers = [(); 4].map(|()| Server::default());
        let mut tick = tokio::time::interval(Duration::from_millis(1));
        tick.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let mut heard_us = None;
        loop {
            let frames = tokio::select! {
                biased;
                received = port.receive() => {
                    let frame = match received {
                        Ok(stamped) => stamped.frame,
                        Err(bus::Error::Closed(_)) => return,
                        Err(error) => panic!("{error}"),
                    };
                    let now_us = clock.load(Ordering::Relaxed);
                    if heartbeat::decode(&frame).is_some_and(|(node_id, _)| node_id == HOST) {
                        self.host_heartbeats.fetch_add(1, Ordering::Relaxed);
                        heard_us = Some(now_us);
                    }
                    self.answer(&frame, &mut servers, now_us)
                }
                _ = tick.tick() => {
                    let step_us = self.micros_per_tick.load(Ordering::Relaxed);
                    let now_us = clock.load(Ordering::Relaxed) + step_us;
                    if heard_us.is_some_and(|heard_us| now_us - heard_us > OWED_HEARTBEAT_US) {
                        continue;
                    }
                    // Frames of the middle of a tick are sent in the middle of it.
                    let mut frames = Vec::new();
                    let parts = step_us.div_ceil(1000);
                    for part in 1..=parts {
                        let part_us = now_us - step_us + step_us * part / parts;
                        self.drives.send_modify(|drives| {
                            for drive in drives.iter_mut() {
                                let advanced = drive.advance(part_us, step_us / parts);
                                frames.extend(advanced.into_iter().map(|frame| (part_us, frame)));
                            }
                        });
                    }
                    for (part_us, frame) in frames {
                        clock.store(part_us, Ordering::Relaxed);
                        port.send(frame).unwrap();
                    }
                    clock.store(now_us, Ordering::Relaxed);
                    continue;
                }
            };
            for frame in frames {
                port.send(frame).unwrap();
            }
        }
    }

    fn answer(&self, frame: &Frame, servers: &mut [Server; 4], now_us: u64) -> Vec<Frame> {
        let mut answers = Vec::new();
        if frame
            .cob_id()
            .is_some_and(|id| (0x201..=0x204).contains(&id))
        {
            self.host_pdos.lock().unwrap().push(*frame);
        }
        self.drives.send_modify(|drives| {
            if let Some((command, target)) = nmt::decode(frame) {
                for drive in drives
                    .iter_mut()
                    .filter(|drive| target.includes(drive.node_id) && !drive.dead)
                {
                    drive.nmt_state = command.outcome();
                    drive.sent_pdos = [const { None }; 3];
                    answers.push(heartbeat::encode(drive.node_id, drive.nmt_state));
                    answers.extend(drive.process_data(now_us));
                }
            }
            for drive in drives.iter_mut() {
                let is_own = frame.cob_id() == Some(0x200 + u16::from(drive.node_id));
                if is_own && !drive.dead && drive.nmt_state == nmt::State::Operational {
                    let word = u16::from_le_bytes(frame.data().try_into().unwrap());
                    drive.on_controlword(word);
                    answers.extend(drive.process_data(now_us));
                }
            }
            let node_id = frame
                .cob_id()
                .filter(|id| (0x601..=0x604).contains(id))
                .map(|id| usize::from(id - 0x600));
            let Some(node_id) = node_id else { return };
            let drive = &mut drives[node_id - 1];
            let request = frame.data().try_into().unwrap();
            let answer = servers[node_id - 1].answer(request, drive);
            // What a request changed is sent ahead of its answer.
            answers.extend(drive.process_data(now_us));
            if let Some(answer) = answer
                && !drive.dead
            {
                answers.push(Frame::standard(response_cob_id(node_id as u8), answer));
            }
        });
        answers
    }
}

impl Drive {
    fn new(node_id: u8) -> Self {
        let mut drive = Self {
            node_id,
            objects: dictionary::entries()
                .iter()
                .map(|entry| {
                    (
                        entry.address,
                        entry.kind.encode(entry.factory_value(node_id)),
                    )
                })
                .collect(),
            nmt_state: nmt::State::PreOperational,
            state: State::SwitchOnDisabled,
            homed: false,
            position_qc: 5000.0,
            demand_qc: 5000.0,
            target_qc: None,
            homing_ends_in_us: None,
            controlword: 0,
            obstacle_qc: None,
            running_ma: 40,
            belt_slips: false,
            dead: false,
            statusword: None,
            fault_persists: false,
            mute: false,
            sent_pdos: [const { None }; 3],
            controlwords: Vec::new(),
            targets_qc: Vec::new(),
        };
        drive.set(objects::SERIAL_NUMBER, 1000 + u32::from(node_id));
        drive.set(objects::MAIN_SENSOR_RESOLUTION, 2048);
        drive.set(objects::ENCODER_PULSES, 512);
        drive.set(objects::GEAR_NUMERATOR, 21);
        drive.set(objects::OUTPUT_CURRENT_LIMIT, 800);
        drive.set(objects::INPUT_POLARITY, if node_id == 2 { 1 } else { 0 });
        // Every switch is free.
        drive.set(objects::INPUT_LEVELS, if node_id == 2 { 1 } else { 0 });
        drive
    }

    pub(super) fn set<T: Value>(&mut self, object: Object<T>, value: T) {
        self.objects.insert(object.address, value.to_le_vec());
    }

    pub(super) fn get<T: Value + Default>(&self, object: Object<T>) -> T {
        self.objects
            .get(&object.address)
            .and_then(|bytes| T::from_le_slice(bytes))
            .unwrap_or_default()
    }

    pub(super) fn enter_fault(&mut self, code: u16) {
        self.state = State::Fault;
        self.target_qc = None;
        self.set(objects::ERROR_CODE, code);
    }

    fn advance(&mut self, now_us: u64, step_us: u64) -> Vec<Frame> {
        let mut frames = Vec::new();
        if self.dead {
            return frames;
        }
        let period_us = 1000 * u64::from(self.get(objects::PRODUCER_HEARTBEAT));
        if period_us > 0 && now_us / period_us > (now_us - step_us) / period_us {
            frames.push(heartbeat::encode(self.node_id, self.nmt_state));
        }
        frames.extend(self.process_data(now_us));
        if let Some(us) = &mut self.homing_ends_in_us {
            *us = us.saturating_sub(step_us);
            if *us == 0 {
                self.homing_ends_in_us = None;
                self.homed = true;
                self.position_qc = self.get(objects::HOME_POSITION).into();
                self.demand_qc = self.position_qc;
            }
        }
        if let (State::OperationEnabled, Some(target_qc)) = (self.state, self.target_qc) {
            let step_qc =
                f64::from(self.get(objects::PROFILE_VELOCITY)) / 60e6 * 2048.0 * step_us as f64;
            self.demand_qc += (target_qc - self.demand_qc).clamp(-step_qc, step_qc);
            self.position_qc = self.obstacle_qc.map_or(self.demand_qc, |obstacle_qc| {
                self.demand_qc.min(obstacle_qc)
            });
            let lag_qc = (self.demand_qc - self.position_qc).abs();
            if lag_qc > f64::from(self.get(objects::FOLLOWING_ERROR_WINDOW)) {
                self.enter_fault(0x8611);
                frames.push(Emergency::new(0x8611, 0x80).encode(self.node_id));
            }
        }
        frames
    }

    /// What has changed in TPDO 1 to 3, no more often than their inhibit time allows.
    fn process_data(&mut self, now_us: u64) -> Vec<Frame> {
        if self.dead || self.mute || self.nmt_state != nmt::State::Operational {
            return Vec::new();
        }
        let mut frames = Vec::new();
        for number in [1, 2, 3] {
            let records = Address::new(0x19FF + number, 0);
            let count = self.objects[&records][0];
            let mut payload = Vec::new();
            for subindex in 1..=count {
                let entry = &self.objects[&Address::new(records.index, subindex)];
                let entry = u32::from_le_bytes(entry.as_slice().try_into().unwrap());
                let mapped = Address::new((entry >> 16) as u16, (entry >> 8) as u8);
                payload.extend(self.read(mapped).unwrap());
            }
            let inhibit = &self.objects[&Address::new(0x17FF + number, 3)];
            let inhibit_us = 100 * u64::from(u16::from_le_bytes([inhibit[0], inhibit[1]]));
            let cob_id = &self.objects[&Address::new(0x17FF + number, 1)];
            let cob_id = u32::from_le_bytes(cob_id.as_slice().try_into().unwrap());
            let sent = &mut self.sent_pdos[usize::from(number) - 1];
            let is_due = sent.as_ref().is_none_or(|(before, at_us)| {
                *before != payload && now_us.saturating_sub(*at_us) >= inhibit_us
            });
            if cob_id >> 31 == 0 && is_due {
                let id = epos4_link::frame::Id::standard(cob_id as u16);
                frames.push(Frame::new(id, &payload).unwrap());
                *sent = Some((payload, now_us));
            }
        }
        frames
    }

    fn on_controlword(&mut self, word: u16) {
        let before = std::mem::replace(&mut self.controlword, word);
        self.controlwords.push(word);
        let rising = word & !before;
        self.state = match (self.state, Command::from_controlword(before, word)) {
            (State::Fault, Command::FaultReset) if !self.fault_persists => State::SwitchOnDisabled,
            (State::Fault, _) => State::Fault,
            (_, Command::DisableVoltage) => State::SwitchOnDisabled,
            (State::OperationEnabled, Command::QuickStop) => State::QuickStopActive,
            (State::SwitchOnDisabled | State::SwitchedOn, Command::Shutdown) => {
                State::ReadyToSwitchOn
            }
            (State::ReadyToSwitchOn, Command::SwitchOn) => State::SwitchedOn,
            (State::SwitchedOn | State::QuickStopActive, Command::EnableOperation) => {
                State::OperationEnabled
            }
            (state, _) => state,
        };
        if self.state != State::OperationEnabled {
            self.target_qc = None;
            self.homing_ends_in_us = None;
            return;
        }
        let mode = self.get(objects::MODES_OF_OPERATION);
        if mode == 1 && rising & profile_position::NEW_SETPOINT != 0 {
            let target_qc = self.get(objects::TARGET_POSITION);
            self.targets_qc.push(target_qc);
            self.target_qc = Some(target_qc.into());
        }
        if mode == 6 && rising & homing::START != 0 {
            self.homed = false;
            self.homing_ends_in_us = Some(200_000);
        }
    }

    fn true_statusword(&self) -> u16 {
        let mut word = match self.state {
            State::NotReadyToSwitchOn => 0x00,
            State::SwitchOnDisabled => 0x40,
            State::ReadyToSwitchOn => 0x21,
            State::SwitchedOn => 0x23,
            State::OperationEnabled => 0x27,
            State::QuickStopActive => 0x07,
            State::FaultReactionActive => 0x0F,
            State::Fault => 0x08,
        };
        if self.homed {
            word |= Statusword::REFERENCED;
        }
        match self.get(objects::MODES_OF_OPERATION) {
            1 if self.controlword & profile_position::NEW_SETPOINT != 0 => {
                word |= Statusword::SETPOINT_ACKNOWLEDGED
            }
            6 if self.homed => word |= Statusword::HOMING_ATTAINED | Statusword::TARGET_REACHED,
            _ => {}
        }
        if self
            .target_qc
            .is_some_and(|target_qc| target_qc == self.demand_qc)
        {
            word |= Statusword::TARGET_REACHED;
        }
        word
    }

    fn active_functions(&self) -> u32 {
        let active = self.get(objects::INPUT_LEVELS) ^ self.get(objects::INPUT_POLARITY);
        (1..=objects::INPUT_COUNT)
            .filter(|input| active >> (input - 1) & 1 == 1)
            .map(|input| self.get(objects::digital_input_function(input)))
            .filter(|function| *function < 32)
            .fold(0, |functions, function| functions | 1 << function)
    }

    fn current_ma(&self) -> i32 {
        // Blade on blade.
        let beyond_qc = self.position_qc - CLOSED_QC;
        if beyond_qc > 0.0 && self.node_id == 2 && !self.belt_slips {
            return self.running_ma + (beyond_qc * MA_PER_QC) as i32;
        }
        match self.target_qc {
            Some(_) if self.demand_qc != self.position_qc => {
                self.get(objects::OUTPUT_CURRENT_LIMIT) as i32
            }
            Some(target_qc) if target_qc != self.demand_qc => self.running_ma,
            _ => 0,
        }
    }
}

impl Dictionary for Drive {
    fn read(&mut self, address: Address) -> Result<Vec<u8>, AbortCode> {
        Ok(match (address.index, address.subindex) {
            (0x6041, 0) => self
                .statusword
                .unwrap_or(self.true_statusword())
                .to_le_vec(),
            (0x6061, 0) => self.get(objects::MODES_OF_OPERATION).to_le_vec(),
            (0x6062, 0) => (self.demand_qc as i32).to_le_vec(),
            (0x6064, 0) => (self.position_qc as i32).to_le_vec(),
            (0x606C, 0) => 0_i32.to_le_vec(),
            (0x30D1, 2) => self.current_ma().to_le_vec(),
            (0x60FD, 0) => self.active_functions().to_le_vec(),
            _ => {
                return self
                    .objects
                    .get(&address)
                    .cloned()
                    .ok_or(AbortCode::NO_OBJECT);
            }
        })
    }

    fn write(&mut self, address: Address, data: &[u8], _: Length) -> Result<(), AbortCode> {
        if self.dead {
            return Ok(());
        }
        if address == objects::CONTROLWORD.address {
            self.on_controlword(u16::from_le_bytes([data[0], data[1]]));
        }
        self.objects.insert(address, data.to_vec());
        Ok(())
    }
}
