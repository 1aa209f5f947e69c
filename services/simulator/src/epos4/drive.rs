//! The drive proper: the CiA 402 state machine, the modes, and the shaft they turn.

mod modes;
mod transitions;

use epos4_link::cia402::{Command, HALT, State, Statusword, homing, profile_position};

use self::modes::Mode;
use self::transitions::Stopping;
use super::defects::Drivetrain;
use super::errors::code;
use super::homing::Homing;
use super::inputs::{Inputs, Switch};
use super::interpolation::Interpolation;
use super::mechanics::Mechanics;
use super::objects::Power;
use super::parameters::Parameters;
use super::positioning::{Positioning, Taken};
use super::shaft::{Motor, Shaft};
use super::thermal::Thermal;
use super::trajectory::Trajectory;

/// State machine, mode and shaft.
#[derive(Clone, Debug)]
pub struct Drive {
    state: State,
    controlword: u16,
    mode: Mode,
    /// A transition that waits for the shaft to stand.
    stopping: Option<Stopping>,
    trajectory: Trajectory,
    positioning: Positioning,
    homing: Homing,
    interpolation: Interpolation,
    shaft: Shaft,
    thermal: Thermal,
    motor: Motor,
    /// Where the true shaft stands at position 0.
    origin_qc: f64,
    referenced: bool,
    inputs: Inputs,
    following_error: bool,
}

/// The homing method that takes the present position; without power it does so at once.
const PRESENT_POSITION: i64 = 37;
/// The drive's own control cycle, s.
const CYCLE_S: f64 = 0.0004;

impl Drive {
    /// Just powered up: free, without a reference, at position 0.
    #[must_use]
    pub fn new(position_qc: f64, motor: Motor) -> Self {
        Self {
            state: State::SwitchOnDisabled,
            controlword: 0,
            mode: Mode::ProfilePosition,
            stopping: None,
            trajectory: Trajectory::standing_at(position_qc),
            positioning: Positioning::default(),
            homing: Homing::default(),
            interpolation: Interpolation::default(),
            shaft: Shaft::at(position_qc),
            thermal: Thermal::default(),
            motor,
            origin_qc: position_qc,
            referenced: false,
            inputs: Inputs::default(),
            following_error: false,
        }
    }

    /// Power cycle: the shaft stays where it is, its position is 0 from now on.
    pub fn restart(&mut self) {
        *self = Self {
            shaft: self.shaft,
            thermal: self.thermal,
            ..Self::new(self.shaft.position_qc, self.motor)
        };
    }

    /// The state.
    #[must_use]
    pub fn state(&self) -> State {
        self.state
    }

    /// The true shaft.
    #[must_use]
    pub fn shaft(&self) -> &Shaft {
        &self.shaft
    }

    /// How warm motor and power stage are.
    pub fn thermal(&mut self) -> &mut Thermal {
        &mut self.thermal
    }

    /// The demand.
    #[must_use]
    pub fn trajectory(&self) -> &Trajectory {
        &self.trajectory
    }

    /// The active input functions, as last seen.
    #[must_use]
    pub fn inputs(&self) -> Inputs {
        self.inputs
    }

    /// A position of the true shaft as the drive counts it.
    #[must_use]
    pub fn counted_qc(&self, position_qc: f64) -> i64 {
        (position_qc - self.origin_qc).round() as i64
    }

    /// Object 0x6061.
    #[must_use]
    pub fn mode_code(&self) -> i64 {
        self.mode.code()
    }

    /// Whether the power stage is on.
    #[must_use]
    pub fn power(&self) -> Power {
        match self.state {
            State::OperationEnabled | State::QuickStopActive | State::FaultReactionActive => {
                Power::On
            }
            _ => Power::Off,
        }
    }

    /// Object 0x6041. `remote` is whether the node is operational on the network.
    #[must_use]
    pub fn statusword(&self, parameters: &Parameters, remote: bool) -> u16 {
        let state = match self.state {
            State::NotReadyToSwitchOn => 0x00,
            State::SwitchOnDisabled => 0x40,
            State::ReadyToSwitchOn => 0x21,
            State::SwitchedOn => 0x33,
            State::OperationEnabled => 0x37,
            State::QuickStopActive => 0x17,
            State::FaultReactionActive => 0x1F,
            State::Fault => 0x08,
        };
        let (bit_10, bit_12, bit_13) = self.mode_status(parameters);
        let bits = [
            (1 << 9, remote),
            (Statusword::TARGET_REACHED, bit_10),
            (
                Statusword::INTERNAL_LIMIT,
                self.power() == Power::On && (self.shaft.limited || self.thermal.limits()),
            ),
            (1 << 12, bit_12),
            (1 << 13, bit_13),
            (Statusword::REFERENCED, self.referenced),
        ];
        bits.into_iter()
            .filter(|(_, set)| *set)
            .fold(state, |word, (bit, _)| word | bit)
    }

    /// Sets the mode, object 0x6060. What moves is brought to a stand by the new mode.
    pub fn set_mode(&mut self, code: i64) {
        let Some(mode) = Mode::of(code).filter(|mode| *mode != self.mode) else {
            return;
        };
        self.mode = mode;
        self.positioning = Positioning::default();
        self.homing = Homing::default();
        self.interpolation = Interpolation::default();
    }

    /// Obeys a controlword. Tells whether errors are to be acknowledged, or which error it causes.
    pub fn control(&mut self, controlword: u16, parameters: &Parameters) -> Control {
        let previous = std::mem::replace(&mut self.controlword, controlword);
        let command = Command::from_controlword(previous, controlword);
        if self.state == State::Fault {
            if command != Command::FaultReset {
                return Control::Done;
            }
            self.state = State::SwitchOnDisabled;
            self.following_error = false;
            return Control::AcknowledgeErrors;
        }
        self.obey(command, parameters);
        let rising = controlword & !previous;
        if self.mode == Mode::Homing
            && self.power() == Power::Off
            && rising & homing::START != 0
            && parameters.homing.method == PRESENT_POSITION
        {
            self.origin_qc = self.shaft.position_qc - parameters.homing.position_qc;
            self.referenced = true;
            self.homing.attain();
        }
        if self.state != State::OperationEnabled || self.stopping.is_some() {
            return Control::Done;
        }
        match self.mode {
            Mode::ProfilePosition => {
                self.positioning.on_controlword(controlword);
                if rising & profile_position::NEW_SETPOINT != 0 {
                    let taken = self.positioning.take(
                        controlword,
                        parameters,
                        &self.trajectory,
                        self.origin_qc,
                    );
                    if taken == Taken::BeyondLimit {
                        return Control::Raise(code::SOFTWARE_LIMIT);
                    }
                }
            }
            Mode::Homing => {
                if rising & homing::START != 0 && controlword & HALT == 0 {
                    self.homing.start(&parameters.homing, &self.shaft);
                    self.referenced = false;
                } else if controlword & homing::START == 0 || controlword & HALT != 0 {
                    self.homing.interrupt();
                }
            }
            Mode::ProfileVelocity
            | Mode::CyclicPosition
            | Mode::CyclicVelocity
            | Mode::CyclicTorque => {}
        }
        Control::Done
    }

    /// Makes the position worthless, as an encoder error does.
    pub fn lose_reference(&mut self) {
        self.referenced = false;
    }

    /// Lets time pass, cycle by cycle; the errors that appeared. Nothing happens in no time.
    pub fn step(
        &mut self,
        dt_s: f64,
        parameters: &Parameters,
        mechanics: &Mechanics,
        drivetrain: Drivetrain,
    ) -> Vec<u16> {
        let cycles = (dt_s / CYCLE_S).ceil();
        let cycle_s = dt_s / cycles;
        let mut errors = Vec::new();
        for _ in 0..cycles as usize {
            for error in self.cycle(cycle_s, parameters, mechanics, drivetrain) {
                self.react(super::errors::effect(error).1, parameters);
                if !errors.contains(&error) {
                    errors.push(error);
                }
            }
        }
        errors
    }

    fn cycle(
        &mut self,
        dt_s: f64,
        parameters: &Parameters,
        mechanics: &Mechanics,
        drivetrain: Drivetrain,
    ) -> Vec<u16> {
        let inputs_before =
            std::mem::replace(&mut self.inputs, Inputs::read(mechanics, parameters));
        self.obey_inputs(parameters);
        let order = self.order(parameters, dt_s);
        self.shaft.cycle(
            order,
            self.thermal.limit_ma(parameters),
            &self.motor,
            (mechanics, drivetrain),
            dt_s,
        );
        self.thermal.cycle(self.shaft.current_ma, parameters, dt_s);
        // The count has left the range of 0x6064.
        if (self.shaft.position_qc - self.origin_qc).abs() > f64::from(i32::MAX) {
            self.referenced = false;
        }
        if self.power() == Power::Off {
            self.trajectory = Trajectory::standing_at(self.shaft.position_qc);
        }
        self.finish_stopping(parameters, dt_s);
        if self.state != State::OperationEnabled {
            return Vec::new();
        }
        let mut errors = Vec::new();
        if self.lags(parameters) {
            self.following_error = true;
            errors.push(code::FOLLOWING);
        }
        errors.extend(self.limit_switch_error(inputs_before));
        errors.extend(self.software_limit_error(parameters));
        errors
    }

    /// An error when a switch becomes active, or when a motion goes on into an active one: the way out stays free.
    fn limit_switch_error(&self, before: Inputs) -> Option<u16> {
        let ends = [
            (Switch::NegativeLimit, -1.0, code::NEGATIVE_LIMIT),
            (Switch::PositiveLimit, 1.0, code::POSITIVE_LIMIT),
        ];
        ends.into_iter()
            .filter(|(switch, _, _)| !self.homing.uses(*switch))
            .find(|(switch, direction, _)| {
                self.inputs.is_active(*switch)
                    && (!before.is_active(*switch) && !self.leaves(-direction)
                        || self.trajectory.speed_qc_s * direction > 0.0)
            })
            .map(|(_, _, code)| code)
    }
}

/// What follows from a controlword beyond the drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// Nothing.
    Done,
    /// The master acknowledged the errors.
    AcknowledgeErrors,
    /// The command itself is an error.
    Raise(u16),
}
