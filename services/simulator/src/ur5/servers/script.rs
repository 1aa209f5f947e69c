//! The interfaces that take URScript, and their read-only twins that do not: primary and secondary with the robot state ten
//! times a second, realtime with a packet each cycle.

use std::{
    io,
    sync::{
        Arc, Mutex,
        atomic::{AtomicU64, Ordering},
    },
};

use super::{Shared, lock, outlet::Outlet};
use crate::ur5::{Controller, link_fault::Service, primary::Detail, urscript::Upload};

/// Cycles between two robot states: 10 Hz.
const STATE_EVERY_S: f64 = 0.1;

/// All connections of these interfaces.
#[derive(Debug, Default)]
pub(super) struct Hub {
    clients: Mutex<Vec<Arc<Client>>>,
    /// Number of the last state period that was sent.
    period: AtomicU64,
}

#[derive(Debug)]
struct Client {
    outlet: Arc<Outlet>,
    /// Number of the next message to send.
    next_message: AtomicU64,
}

impl Hub {
    pub(super) fn send(&self, controller: &Controller) {
        let clients = lock(&self.clients);
        if clients.is_empty() {
            return;
        }
        let period =
            ((controller.timestamp_s() + 0.5 * controller.step_s()) / STATE_EVERY_S) as u64;
        let state_due = self.period.swap(period, Ordering::Relaxed) != period;
        let (mut realtime, mut state) = (Vec::new(), Vec::new());
        for client in clients.iter() {
            if is_realtime(client.outlet.service()) {
                if realtime.is_empty() {
                    controller.encode_realtime(&mut realtime);
                }
                client.outlet.offer(&realtime, &[]);
            } else if state_due {
                if state.is_empty() {
                    controller.encode_state(Detail::State, &mut state);
                }
                client.outlet.offer(&state, &[]);
                client.send_messages(controller);
            }
        }
    }
}

impl Client {
    /// Messages that do not get through are tried again in the next period, as long as they are kept.
    fn send_messages(&self, controller: &Controller) {
        let next = self.next_message.load(Ordering::Relaxed);
        let told = matches!(
            self.outlet.service(),
            Service::Primary | Service::PrimaryReadOnly
        );
        if !told || next == controller.robot.log.next() {
            return;
        }
        let mut messages = Vec::new();
        let after = controller.encode_messages(next, &mut messages);
        if self.outlet.offer(&messages, &[]) {
            self.next_message.store(after, Ordering::Relaxed);
        }
    }
}

pub(super) async fn converse(
    outlet: Arc<Outlet>,
    controller: Shared,
    hub: Arc<Hub>,
) -> io::Result<()> {
    let client = {
        let controller = lock(&controller);
        let next_message = AtomicU64::new(controller.robot.log.next());
        let client = Arc::new(Client {
            outlet,
            next_message,
        });
        if !is_realtime(client.outlet.service()) {
            let (mut version, mut state) = (Vec::new(), Vec::new());
            controller.encode_version(&mut version);
            controller.encode_state(Detail::WithConfiguration, &mut state);
            client.outlet.queue(&version)?;
            client.outlet.queue(&state)?;
        }
        client
    };
    lock(&hub.clients).push(client.clone());
    let _member = Member {
        hub,
        client: client.clone(),
    };
    client.outlet.flush().await?;
    let mut upload = Upload::default();
    let mut buffer = vec![0; 16 * 1024];
    loop {
        let received = client.outlet.read(&mut buffer).await?;
        if received == 0 {
            upload
                .finish()
                .iter()
                .for_each(|program| load(&controller, program));
            return Ok(());
        }
        let text = &mut buffer[..received];
        if is_read_only(client.outlet.service()) || !client.outlet.takes(text) {
            continue;
        }
        let Some(programs) = upload.feed(text) else {
            return Err(io::Error::other("program is too long"));
        };
        programs
            .iter()
            .for_each(|program| load(&controller, program));
    }
}

fn is_realtime(service: Service) -> bool {
    matches!(service, Service::Realtime | Service::RealtimeReadOnly)
}

fn is_read_only(service: Service) -> bool {
    matches!(
        service,
        Service::PrimaryReadOnly | Service::SecondaryReadOnly | Service::RealtimeReadOnly
    )
}

/// There is no answer on the socket; errors go out as messages on the primary interface.
fn load(controller: &Shared, program: &str) {
    if let Err(error) = lock(controller).load_program(program) {
        tracing::warn!(%error, "program refused");
    }
}

/// Takes the client off the list however its connection ends.
struct Member {
    hub: Arc<Hub>,
    client: Arc<Client>,
}

impl Drop for Member {
    fn drop(&mut self) {
        lock(&self.hub.clients).retain(|client| !Arc::ptr_eq(client, &self.client));
    }
}
