//! The three interfaces that take URScript: primary and secondary with the robot state ten times a second, realtime with
//! a packet each cycle.

use std::{
    io,
    sync::{
        Arc, Mutex,
        atomic::{AtomicU64, Ordering},
    },
};

use tokio::net::TcpStream;

use super::{Shared, lock, outlet::Outlet};
use crate::ur5::{Controller, primary::Detail, urscript::Upload};

/// Cycles between two robot states: 10 Hz.
const STATE_EVERY_S: f64 = 0.1;

/// What a connection is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Interface {
    /// State and messages.
    Primary,
    /// State.
    Secondary,
    /// Realtime packets.
    Realtime,
}

/// All connections of the three interfaces.
#[derive(Debug, Default)]
pub(super) struct Hub {
    clients: Mutex<Vec<Arc<Client>>>,
    /// Number of the last state period that was sent.
    period: AtomicU64,
}

#[derive(Debug)]
struct Client {
    interface: Interface,
    outlet: Outlet,
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
            if client.interface == Interface::Realtime {
                if realtime.is_empty() {
                    controller.encode_realtime(&mut realtime);
                }
                client.outlet.offer(&realtime);
            } else if state_due {
                if state.is_empty() {
                    controller.encode_state(Detail::State, &mut state);
                }
                client.outlet.offer(&state);
                client.send_messages(controller);
            }
        }
    }
}

impl Client {
    /// Messages that do not get through are tried again in the next period, as long as they are kept.
    fn send_messages(&self, controller: &Controller) {
        let next = self.next_message.load(Ordering::Relaxed);
        if self.interface != Interface::Primary || next == controller.robot.log.next() {
            return;
        }
        let mut messages = Vec::new();
        let after = controller.encode_messages(next, &mut messages);
        if self.outlet.offer(&messages) {
            self.next_message.store(after, Ordering::Relaxed);
        }
    }
}

pub(super) async fn converse(
    stream: TcpStream,
    interface: Interface,
    controller: Shared,
    hub: Arc<Hub>,
) -> io::Result<()> {
    let client = {
        let controller = lock(&controller);
        let next_message = AtomicU64::new(controller.robot.log.next());
        let client = Arc::new(Client {
            interface,
            outlet: Outlet::new(stream),
            next_message,
        });
        if interface != Interface::Realtime {
            let mut greeting = Vec::new();
            controller.encode_version(&mut greeting);
            controller.encode_state(Detail::WithConfiguration, &mut greeting);
            client.outlet.queue(&greeting)?;
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
        let Some(programs) = upload.feed(&buffer[..received]) else {
            return Err(io::Error::other("program is too long"));
        };
        programs
            .iter()
            .for_each(|program| load(&controller, program));
    }
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
