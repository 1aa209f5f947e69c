//! What an SDO request reads and writes: the objects, the drive behind them, and its errors.

use epos4_link::canopen::emcy::Emergency;
use epos4_link::canopen::object::Address;
use epos4_link::canopen::sdo::AbortCode;
use epos4_link::canopen::sdo::server::{Dictionary, Length};
use epos4_link::cia402::State;
use epos4_link::objects;

use crate::epos4::defects::Defects;
use crate::epos4::drive::{Control, Drive};
use crate::epos4::errors::{self, Errors};
use crate::epos4::mechanics::Mechanics;
use crate::epos4::objects::{Objects, Power};
use crate::epos4::outputs::{self, Brake};
use crate::epos4::parameters::Parameters;

/// What an SDO request reads and writes: the node without its SDO server.
#[derive(Debug)]
pub(super) struct Device {
    pub(super) objects: Objects,
    /// The revision of the objects of which they are a snapshot.
    pub(super) parameters: (u64, Parameters),
    pub(super) drive: Drive,
    pub(super) errors: Errors,
    pub(super) defects: Defects,
    pub(super) brake: Brake,
    /// Whether the network lets the drive be commanded: statusword bit 9.
    pub(super) remote: bool,
    /// Emergencies not yet on the bus.
    pub(super) emergencies: Vec<Emergency>,
}

impl Device {
    /// Just powered up.
    pub(super) fn new(objects: Objects, drive: Drive) -> Self {
        Self {
            parameters: (objects.revision(), Parameters::of(&objects)),
            objects,
            drive,
            errors: Errors::default(),
            defects: Defects::default(),
            brake: Brake::default(),
            remote: false,
            emergencies: Vec::new(),
        }
    }

    /// The parameters in force.
    pub(super) fn parameters(&mut self) -> Parameters {
        let revision = self.objects.revision();
        if self.parameters.0 != revision {
            self.parameters = (revision, Parameters::of(&self.objects));
        }
        self.parameters.1.clone()
    }

    /// Puts an error into register and history, and reacts.
    pub(super) fn raise(&mut self, code: u16) {
        let parameters = self.parameters();
        self.announce(code);
        self.drive.react(errors::effect(code).1, &parameters);
    }

    /// Puts an error to which the drive has reacted into register and history.
    pub(super) fn announce(&mut self, code: u16) {
        if errors::loses_reference(code) {
            self.drive.lose_reference();
        }
        self.emergencies
            .extend(self.errors.raise(code, &mut self.objects));
    }

    /// Errors that stand as long as their cause: acknowledged before it is gone, they come again.
    pub(super) fn supervise(&mut self, dt_s: f64) {
        let power = self.drive.power();
        self.brake.step(power, &self.objects, dt_s);
        let (defects, objects) = (&self.defects, &self.objects);
        let supply_mv = defects.supply_v() * 1000.0;
        let limit = |address| objects.get(address) as f64;
        let causes = [
            (
                errors::code::UNDERVOLTAGE,
                supply_mv < limit(objects::UNDERVOLTAGE_LIMIT.address),
            ),
            (
                errors::code::OVERVOLTAGE,
                supply_mv > limit(objects::OVERVOLTAGE_LIMIT.address),
            ),
            (
                errors::code::OVERTEMPERATURE,
                defects.power_stage_c() * 10.0
                    > limit(objects::MAX_POWER_STAGE_TEMPERATURE.address),
            ),
            (
                errors::code::SAFE_TORQUE_OFF,
                defects.sto_open && power == Power::On,
            ),
        ];
        for (code, stands) in causes {
            if stands && !self.errors.has(code) {
                self.raise(code);
            }
        }
    }

    /// Process data. The controlword acts last, on the targets that came with it.
    pub(super) fn receive(&mut self, mut received: Vec<(Address, Vec<u8>)>) {
        received.sort_by_key(|(address, _)| *address == objects::CONTROLWORD.address);
        for (address, bytes) in received {
            if let Err(code) = self.write(address, &bytes, Length::Given) {
                tracing::debug!(object = %address, %code, "process data refused");
            }
        }
    }

    fn control(&mut self, controlword: u16) {
        let parameters = self.parameters();
        match self.drive.control(controlword, &parameters) {
            Control::Done => {}
            Control::AcknowledgeErrors => self
                .emergencies
                .extend(self.errors.reset(&mut self.objects)),
            Control::Raise(code) => self.raise(code),
        }
    }

    pub(super) fn abort_connection(&mut self) {
        let parameters = self.parameters();
        self.drive.abort_connection(&parameters);
    }

    pub(super) fn restart(&mut self) {
        self.objects.restart();
        self.drive.restart();
        self.errors = Errors::default();
        self.emergencies.clear();
    }

    /// Brings the objects that show the drive's state up to date.
    pub(super) fn publish(&mut self, mechanics: &Mechanics) {
        let parameters = self.parameters();
        let (shaft, demand) = (*self.drive.shaft(), *self.drive.trajectory());
        let position_qc = self.drive.counted_qc(shaft.position_qc);
        let [i2t_motor_percent, i2t_stage_percent] = self.drive.thermal().levels_percent();
        let fault = self.drive.state() == State::Fault;
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
            (objects::I2T_MOTOR.address, i2t_motor_percent),
            (objects::I2T_POWER_STAGE.address, i2t_stage_percent),
            (
                objects::SUPPLY_VOLTAGE.address,
                (self.defects.supply_v() * 10.0).round() as i64,
            ),
            (
                objects::POWER_STAGE_TEMPERATURE.address,
                (self.defects.power_stage_c() * 10.0).round() as i64,
            ),
            (
                objects::STO_INPUTS.address,
                if self.defects.sto_open { 0 } else { 3 },
            ),
            (
                objects::BRAKE_STATE.address,
                i64::from(self.brake.is_closed()),
            ),
            (
                objects::OUTPUT_LEVELS.address,
                i64::from(outputs::levels(&self.objects, self.brake, fault)),
            ),
            (objects::INPUT_LEVELS.address, i64::from(mechanics.levels())),
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
        match self.defects.claimed(address) {
            Some(bytes) => Ok(bytes),
            None => self.objects.read(address),
        }
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
            ERROR_HISTORY_COUNT => errors::clear_history(&mut self.objects),
            // Another sensor configuration: what was counted means nothing any more.
            Address {
                index: 0x3000 | 0x3010,
                ..
            } => self.drive.lose_reference(),
            _ => {}
        }
        Ok(())
    }
}
