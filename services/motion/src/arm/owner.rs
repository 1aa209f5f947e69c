//! The owner of an arm: keeps the link, and for each state it receives judges, decides and sends one
//! command.

use std::sync::Arc;

use tokio::sync::{mpsc, watch};
use ur_link::{Command, RobotLink, State};

use super::pilot::Pilot;
use super::{ArmOptions, Connect, Published, Request, StopOrder};
use crate::command::Commander;
use crate::error::Error;

/// The task that owns an arm.
pub struct Owner<C> {
    connector: C,
    requests: mpsc::Receiver<Request>,
    stop_orders: watch::Receiver<StopOrder>,
    publish: watch::Sender<Published>,
    stops_served: u64,
    pilot: Pilot,
}

impl<C: Connect> Owner<C> {
    pub(super) fn new(
        options: Arc<ArmOptions>,
        connector: C,
        commander: Commander,
        requests: mpsc::Receiver<Request>,
        stop_orders: watch::Receiver<StopOrder>,
        publish: watch::Sender<Published>,
    ) -> Self {
        Self {
            connector,
            requests,
            stop_orders,
            publish,
            stops_served: 0,
            pilot: Pilot::new(options, commander),
        }
    }

    /// Runs until every handle is gone. Connects again whenever the link is lost, and moves nothing then.
    pub async fn run(mut self) {
        let name = self.pilot.options.name;
        let address = self.pilot.options.address.clone();
        while let Some(link) = self.connect().await {
            tracing::info!(arm = name, address, "controller connected");
            let Some(error) = self.drive(link).await else {
                return;
            };
            tracing::warn!(arm = name, address, error = %chain(&error), "link to the controller lost");
            self.pilot.lose_link(&error);
            self.publish();
        }
    }

    /// Tries until a link is up; refuses what is asked meanwhile. None when every handle is gone.
    async fn connect(&mut self) -> Option<C::Link> {
        loop {
            let Self {
                connector,
                requests,
                stop_orders,
                publish,
                stops_served,
                pilot,
            } = self;
            let reconnect = pilot.options.reconnect;
            let attempt = async {
                let outcome = connector.connect().await;
                if outcome.is_err() {
                    tokio::time::sleep(reconnect).await;
                }
                outcome
            };
            tokio::pin!(attempt);
            let outcome = loop {
                tokio::select! {
                    outcome = &mut attempt => break outcome,
                    request = requests.recv() => request?.refuse(&pilot.commander, pilot.not_connected()),
                    changed = stop_orders.changed() => {
                        changed.ok()?;
                        *stops_served = stop_orders.borrow_and_update().number;
                        publish.send_modify(|published| published.stops_served = *stops_served);
                    }
                }
            };
            match outcome {
                Ok(link) => return Some(link),
                // The same error again and again is told once.
                Err(error) if pilot.note_no_link(&error) => {
                    let error = chain(&error);
                    tracing::warn!(arm = pilot.options.name, error, "no link to the controller");
                }
                Err(_) => {}
            }
        }
    }

    /// One command for each state, until the link fails. None when every handle is gone and the arm stands.
    async fn drive(&mut self, mut link: C::Link) -> Option<ur_link::Error> {
        self.pilot.begin_link(link.period_s());
        loop {
            let state = match self.next_state(&mut link).await {
                Ok(state) => state,
                Err(error) => return Some(error),
            };
            let command = self.cycle(&state);
            if let Err(error) = link.send(&command).await {
                return Some(error);
            }
            self.publish();
            if self.requests.is_closed() && self.requests.is_empty() && self.pilot.is_standing() {
                return None;
            }
            if self.pilot.program_is_missing(&state) {
                return Some(ur_link::Error::Closed {
                    service: "program on the controller",
                });
            }
        }
    }

    /// The next state. A link that falls silent while the arm moves is told to stop, once, and then waited for: it fails
    /// by itself when it stays silent.
    async fn next_state(&mut self, link: &mut C::Link) -> Result<State, ur_link::Error> {
        let silence = self.pilot.options.silence;
        if let Ok(outcome) = tokio::time::timeout(silence, link.next_state()).await {
            return outcome;
        }
        if let Some(command) = self.pilot.fall_silent() {
            link.send(&command).await?;
            self.publish();
        }
        link.next_state().await
    }

    fn cycle(&mut self, state: &State) -> Command {
        self.pilot.observe(state);
        if self.requests.is_closed() {
            self.pilot
                .stop("SHUTTING_DOWN", "the service is shutting down");
        }
        let stopped = self.stop_orders.has_changed().unwrap_or(false);
        if stopped {
            let order = self.stop_orders.borrow_and_update().clone();
            tracing::info!(
                arm = self.pilot.options.name,
                reason = order.reason,
                "stop requested"
            );
            self.pilot.stop("STOP_REQUESTED", &order.reason);
            self.stops_served = order.number;
        }
        while let Ok(request) = self.requests.try_recv() {
            if stopped {
                request.refuse(&self.pilot.commander, Error::Stopped);
            } else {
                self.pilot.serve(request);
            }
        }
        self.pilot.command(state)
    }

    fn publish(&mut self) {
        self.publish.send_modify(|published| {
            published.connected = self.pilot.latest.is_some();
            published.portal = self.pilot.portal;
            published.stops_served = self.stops_served;
            if let Some(state) = self.pilot.state() {
                published.state = Some(state);
            } else if let Some(last) = &mut published.state {
                last.connected = false;
                last.operation_id = None;
                last.fault = self.pilot.fault.clone();
            }
        });
        for answer in self.pilot.answers.drain(..) {
            answer.give();
        }
    }
}

/// An error and everything beneath it.
pub(super) fn chain(error: &ur_link::Error) -> String {
    let mut text = error.to_string();
    let mut source = std::error::Error::source(error);
    while let Some(cause) = source {
        text = format!("{text}: {cause}");
        source = cause.source();
    }
    text
}
