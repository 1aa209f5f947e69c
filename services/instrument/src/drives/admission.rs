//! Whether a command is taken, and how it begins.

use arthro_authority::{Begin, Operation};
use tokio::sync::watch;

use super::board::Readiness;
use super::commands::{Authorization, Command, Report, Ticket};
use super::link::Link;
use super::motion::{self, Running};
use super::{Drives, Work};
use crate::axis::Axis;
use crate::bite::Jaw;
use crate::error::Refusal;

impl Drives {
    pub(super) fn on_command(
        &mut self,
        authorization: &Authorization,
        command: Command,
    ) -> Result<Ticket, Refusal> {
        let Authorization {
            fencing_token,
            operation_id,
        } = authorization;
        self.leases.check(*fencing_token, self.now())?;
        let fingerprint = format!("{command:?}");
        if self.operations.get(operation_id).is_none() {
            self.admit(&command)?;
        }
        match self
            .operations
            .begin(operation_id, fingerprint.as_bytes())?
        {
            Begin::Repeated(operation) => Ok(self.repeated(operation)),
            Begin::New => self.begin(operation_id, command),
        }
    }

    fn repeated(&self, operation: Operation) -> Ticket {
        let running = self
            .running
            .iter()
            .find(|running| running.id == operation.id);
        let reports = match running {
            Some(running) => running.reports.subscribe(),
            None => {
                let ended = self.ended.get(&operation.id).cloned();
                watch::channel(ended.unwrap_or_else(|| Report::of(operation))).1
            }
        };
        Ticket {
            reports,
            repeated: true,
        }
    }

    /// Whether the state of the drives allows the command.
    fn admit(&self, command: &Command) -> Result<(), Refusal> {
        if self.session.is_stopping() {
            return Err(Refusal::Stopping);
        }
        if let Command::Write { address, .. } = command
            && motion::is_reserved(*address)
        {
            return Err(Refusal::ObjectReserved(*address));
        }
        if let Command::CommissionSwitches { axis, .. } = command
            && self.cell.axes[axis.index()].switches.is_empty()
        {
            return Err(Refusal::NoSwitches { axis: *axis });
        }
        let state = self.board.snapshot();
        for axis in command.axes() {
            let axis_state = &state.axes[axis.index()];
            if let Some(operation_id) = &axis_state.operation_id {
                return Err(Refusal::AxisMoving {
                    axis: *axis,
                    operation_id: operation_id.clone(),
                });
            }
            // A fault says more than that a drive is not there, which may be its consequence.
            if command.moves()
                && let Some(fault) = self.supervisor.fault(*axis)
            {
                return Err(Refusal::AxisFaulted {
                    axis: *axis,
                    fault: fault.clone(),
                });
            }
            // A recovery waits for its drive.
            if !matches!(command, Command::Recover(_)) {
                self.link(*axis)?;
            }
            if command.needs_reference() && !axis_state.is_homed() {
                return Err(Refusal::NotHomed { axis: *axis });
            }
        }
        Ok(())
    }

    fn begin(&mut self, operation_id: &str, command: Command) -> Result<Ticket, Refusal> {
        let operation = self
            .operations
            .get(operation_id)
            .cloned()
            .ok_or(Refusal::ShuttingDown)?;
        let (reports, watcher) = watch::channel(Report::of(operation));
        let work = self.work(&command, reports.clone())?;
        tracing::info!(operation = operation_id, ?command, "operation begins");
        self.board.update(|state| {
            for axis in command.axes() {
                let axis = &mut state.axes[axis.index()];
                axis.operation_id = Some(operation_id.to_owned());
                axis.moving = command.moves();
            }
            if command.moves() && command.axes().contains(&Axis::ForcepsFeed) {
                state.jaw = Jaw::Moving;
            }
        });
        self.running.push(Running {
            id: operation_id.to_owned(),
            command,
            reports,
            future: work,
        });
        Ok(Ticket {
            reports: watcher,
            repeated: false,
        })
    }

    fn work(&mut self, command: &Command, reports: watch::Sender<Report>) -> Result<Work, Refusal> {
        let cell = self.cell.clone();
        if let Command::Recover(axes) = command {
            self.prepare_recovery(axes);
            let (links, board) = (self.session.links(), self.board.clone());
            let command = command.clone();
            return Ok(Box::pin(async move {
                let links = links.ready(&board, command.axes()).await?;
                motion::carry_out(cell, command, links, reports).await
            }));
        }
        let links = command.axes().iter().map(|axis| self.link(*axis));
        let links = links.collect::<Result<Vec<Link>, Refusal>>()?;
        Ok(motion::carry_out(cell, command.clone(), links, reports))
    }

    /// A person has seen the faults: a bus that was left is joined again, and a drive that is another is accepted.
    fn prepare_recovery(&mut self, axes: &[Axis]) {
        for axis in axes {
            self.board.update_axis(*axis, |state| {
                if let Readiness::NotReady {
                    reason: "WRONG_NODE",
                    ..
                } = state.readiness
                {
                    state.identity = None;
                }
            });
        }
        self.session.recover();
    }

    pub(super) fn link(&self, axis: Axis) -> Result<Link, Refusal> {
        self.session
            .link(axis)
            .map_err(|why| Refusal::AxisNotReady { axis, why })
    }
}
