//! The transitions of CiA 402: what commands, inputs and errors make of the state, and the ramps to standstill that some
//! of them wait for.

use epos4_link::canopen::emcy::Reaction;
use epos4_link::cia402::{Command, State};

use super::Drive;
use crate::epos4::inputs::Permission;
use crate::epos4::interpolation::Interpolation;
use crate::epos4::objects::Power;
use crate::epos4::parameters::Parameters;
use crate::epos4::positioning::Positioning;
use crate::epos4::trajectory::Trajectory;

/// A ramp to standstill.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stopping {
    /// The state when the shaft stands; none stays, as after a quick stop.
    pub(super) then: Option<State>,
    pub(super) deceleration_qc_s2: f64,
    standing_s: f64,
    waited_s: f64,
}

impl Drive {
    /// Answers an error.
    pub fn react(&mut self, reaction: Reaction, parameters: &Parameters) {
        if matches!(self.state, State::Fault) {
            return;
        }
        self.homing.fail();
        let deceleration_qc_s2 = match (
            reaction,
            parameters.fault_reaction_option,
            parameters.abort_connection_option,
        ) {
            (Reaction::Disable, _, _)
            | (Reaction::FaultOption, 0, _)
            | (Reaction::AbortConnection, _, 2) => None,
            (Reaction::FaultOption, 1, _) => Some(parameters.profile.deceleration_qc_s2),
            (Reaction::FaultOption | Reaction::AbortConnection, _, _) => {
                Some(parameters.quick_stop_qc_s2)
            }
        };
        match deceleration_qc_s2.filter(|_| self.power() == Power::On) {
            Some(deceleration_qc_s2) => {
                self.state = State::FaultReactionActive;
                self.brake(deceleration_qc_s2, Some(State::Fault));
            }
            None => self.enter(State::Fault),
        }
    }

    /// Answers the end of the communication, which is no error: NMT stop and resets.
    pub fn abort_connection(&mut self, parameters: &Parameters) {
        if self.power() == Power::Off {
            self.enter(match self.state {
                State::Fault => State::Fault,
                _ => State::SwitchOnDisabled,
            });
        } else if parameters.abort_connection_option == 2 {
            self.enter(State::SwitchOnDisabled);
        } else if self.state != State::FaultReactionActive {
            self.brake(parameters.quick_stop_qc_s2, Some(State::SwitchOnDisabled));
        }
    }

    /// Inputs that command: drive enable and quick stop.
    pub(super) fn obey_inputs(&mut self, parameters: &Parameters) {
        let commanded = matches!(self.state, State::OperationEnabled | State::QuickStopActive);
        if commanded && self.inputs.forbids(Permission::DriveEnable, parameters) {
            self.enter(State::SwitchOnDisabled);
        }
        if self.state == State::OperationEnabled
            && self.inputs.forbids(Permission::QuickStop, parameters)
        {
            self.obey(Command::QuickStop, parameters);
        }
    }

    pub(super) fn obey(&mut self, command: Command, parameters: &Parameters) {
        use State::{
            OperationEnabled, QuickStopActive, ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn,
        };
        match (command, self.state) {
            (
                Command::DisableVoltage,
                ReadyToSwitchOn | SwitchedOn | OperationEnabled | QuickStopActive,
            )
            | (Command::QuickStop, ReadyToSwitchOn | SwitchedOn) => self.enter(SwitchOnDisabled),
            (Command::QuickStop, OperationEnabled) => {
                self.homing.interrupt();
                self.state = QuickStopActive;
                self.brake(parameters.quick_stop_qc_s2, None);
            }
            (Command::Shutdown, SwitchOnDisabled | SwitchedOn) => self.enter(ReadyToSwitchOn),
            (Command::Shutdown, OperationEnabled) if parameters.shutdown_option == 0 => {
                self.enter(ReadyToSwitchOn)
            }
            (Command::Shutdown, OperationEnabled) => {
                self.brake(parameters.profile.deceleration_qc_s2, Some(ReadyToSwitchOn));
            }
            (Command::SwitchOn, ReadyToSwitchOn) => self.enter(SwitchedOn),
            (Command::SwitchOn, OperationEnabled) if parameters.disable_option == 0 => {
                self.enter(SwitchedOn)
            }
            (Command::SwitchOn, OperationEnabled) => {
                self.brake(parameters.profile.deceleration_qc_s2, Some(SwitchedOn));
            }
            // From READY_TO_SWITCH_ON it passes SWITCHED_ON by itself.
            (Command::EnableOperation, ReadyToSwitchOn | SwitchedOn | QuickStopActive)
                if ![Permission::DriveEnable, Permission::QuickStop]
                    .iter()
                    .any(|input| self.inputs.forbids(*input, parameters)) =>
            {
                self.enter(OperationEnabled);
            }
            _ => {}
        }
    }

    /// Enters a state with nothing left of the motion before.
    pub(super) fn enter(&mut self, state: State) {
        if state == State::OperationEnabled {
            self.trajectory = match self.state {
                State::QuickStopActive => self.trajectory,
                _ => Trajectory::standing_at(self.shaft.position_qc),
            };
        }
        self.state = state;
        self.stopping = None;
        self.positioning = Positioning::default();
        self.interpolation = Interpolation::default();
        if state != State::OperationEnabled {
            self.homing.interrupt();
        }
    }

    /// Starts a ramp to standstill from what the shaft really does.
    pub(super) fn brake(&mut self, deceleration_qc_s2: f64, then: Option<State>) {
        if self.stopping.is_some_and(|stopping| stopping.then == then) {
            return;
        }
        self.trajectory = Trajectory {
            position_qc: self.shaft.position_qc,
            speed_qc_s: self.shaft.speed_qc_s,
            acceleration_qc_s2: 0.0,
        };
        self.stopping = Some(Stopping {
            then,
            deceleration_qc_s2,
            standing_s: 0.0,
            waited_s: 0.0,
        });
    }

    pub(super) fn finish_stopping(&mut self, parameters: &Parameters, dt_s: f64) {
        let (shaft, trajectory) = (&self.shaft, &self.trajectory);
        let Some(stopping) = self
            .stopping
            .as_mut()
            .filter(|_| trajectory.speed_qc_s == 0.0)
        else {
            return;
        };
        let standstill = parameters.standstill;
        let stands = shaft.speed_qc_s.abs() <= standstill.window_qc_s;
        stopping.standing_s = if stands {
            stopping.standing_s + dt_s
        } else {
            0.0
        };
        stopping.waited_s += dt_s;
        if stopping.standing_s < standstill.time_s && stopping.waited_s < standstill.timeout_s {
            return;
        }
        if let Some(state) = stopping.then {
            self.enter(state);
        }
    }
}
