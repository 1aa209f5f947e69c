//! What nodes and bus report, and what becomes of it: a fault is latched, ends every operation and stops every drive.

use std::time::Duration;

use arthro_authority::Outcome;
use epos4_link::frame::error::Class;
use epos4_link::network::Event;

use super::Drives;
use super::commands::Command;
use super::motion::Running;
use crate::axis::Axis;
use crate::bite::Jaw;
use crate::error::{Failure, Refusal};
use crate::supervisor::{self, Fault, Finding};

/// The emergency of safe torque off.
const SAFE_TORQUE_OFF: u16 = 0x8A88;

impl Drives {
    pub(super) fn on_event(&mut self, event: Event, now: Duration) {
        let mut findings = self.supervisor.on_time(now);
        match event {
            Event::Heartbeat {
                node_id,
                state,
                stamp,
            } => {
                if let Some(axis) = self.axis_of(node_id) {
                    self.session.on_heartbeat(axis, state);
                    findings.extend(self.supervisor.on_heartbeat(axis, state, stamp));
                }
            }
            Event::Emergency { node_id, emergency } => {
                if let Some(axis) = self.axis_of(node_id) {
                    tracing::warn!(%axis, code = format!("0x{:04X}", emergency.code), "emergency");
                    if emergency.code == SAFE_TORQUE_OFF {
                        self.board
                            .update_axis(axis, |state| state.safe_torque_off = Some(true));
                    }
                    findings.extend(self.supervisor.on_emergency(axis, emergency));
                }
            }
            Event::Pdo {
                node_id,
                number,
                data,
                stamp,
            } => {
                if let Some(axis) = self.axis_of(node_id)
                    && let Err(failure) = self.session.on_pdo(axis, number, &data, stamp)
                    && let Some(fault) = failure.fault()
                {
                    findings.push(Finding::Fault(axis, fault));
                }
            }
            Event::DuplicateNode { node_id, evidence } => {
                if let Some(axis) = self.axis_of(node_id) {
                    findings.push(Finding::duplicate(axis, node_id, evidence));
                }
            }
            Event::BusError { report } => {
                tracing::warn!(%report, "can controller");
                self.session.on_report(&report);
                findings.extend(supervisor::on_report(&report));
                if report.has(Class::BUS_OFF) {
                    self.on_bus_off(&report.to_string());
                }
            }
            Event::OtherMaster { sign } => {
                tracing::warn!(?sign, "somebody else commands nodes of this bus");
            }
        }
        // Whoever waits for the time has the data of that time.
        self.session.on_time(now);
        for finding in findings {
            match finding {
                Finding::Fault(axis, fault) => self.on_fault(axis, fault),
                Finding::Started(axis) => {
                    let why = "the drive has just started";
                    self.session.set_up_anew(axis, "UNEXPECTED_BOOT_UP", why);
                }
            }
        }
    }

    fn axis_of(&self, node_id: u8) -> Option<Axis> {
        self.cell
            .axes
            .iter()
            .map(|axis| &axis.spec)
            .find(|spec| spec.node_id == node_id)
            .map(|spec| spec.axis)
    }

    /// Latches a fault, ends every operation, stops every drive. A drive that may have lost its settings is set up anew.
    pub(super) fn on_fault(&mut self, axis: Axis, fault: Fault) {
        if fault.loses_settings() {
            self.supervisor.unwatch(axis);
            self.session.set_up_anew(axis, fault.reason, &fault.detail);
        }
        let is_new = self.supervisor.latch(axis, fault.clone());
        if is_new {
            tracing::error!(%axis, reason = fault.reason, detail = fault.detail, "fault: stopping the drives");
            // In one, so that nobody sees a jaw that is known beside a fault.
            self.board.update(|state| {
                state.axes[axis.index()].fault = Some(fault.clone());
                state.jaw = Jaw::Unknown;
            });
        }
        if is_new || !self.running.is_empty() {
            // A limit switch that is pressed by hand is what commissioning waits for.
            let (going_on, ended): (Vec<Running>, Vec<Running>) = std::mem::take(&mut self.running)
                .into_iter()
                .partition(|running| {
                    fault.reason == "LIMIT_SWITCH"
                        && matches!(&running.command, Command::CommissionSwitches { axis: own, .. } if *own == axis)
                });
            self.running = going_on;
            let failure = Failure::Fault { axis, fault };
            for running in ended {
                let outcome = Outcome::Failed {
                    reason: failure.reason().to_owned(),
                    detail: failure.to_string(),
                };
                self.finish(running, outcome, None);
            }
            self.session.begin_stop();
        }
    }

    /// The controller comes back when a person recovers an axis.
    fn on_bus_off(&mut self, report: &str) {
        self.session.hold("BUS_OFF", report);
        for axis in Axis::ALL {
            self.supervisor.unwatch(axis);
        }
        self.answer_stops(&Err(Refusal::StopNotConfirmed(report.to_owned())));
    }

    pub(super) fn on_bus_lost(&mut self, reason: &'static str, error: &str) {
        tracing::warn!(reason, error, "bus lost");
        let lost: Vec<Axis> = Axis::ALL
            .into_iter()
            .filter(|axis| self.board.is_ready(*axis))
            .collect();
        self.session.disconnect(reason, error);
        for axis in Axis::ALL {
            self.supervisor.unwatch(axis);
        }
        for axis in lost {
            self.on_fault(axis, Fault::new(reason, error));
        }
        self.answer_stops(&Err(Refusal::StopNotConfirmed(error.to_owned())));
    }
}
