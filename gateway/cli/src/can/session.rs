//! A bus in use by one command: the network runs beside it, every received frame can be listened to, and another
//! master on the bus is noticed.

use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use epos4_link::bus::{self, CanBus};
use epos4_link::canopen::{heartbeat, nmt};
use epos4_link::frame::{Frame, Stamped};
use epos4_link::network::{self, Network, Node, Nodes, Options};
use tokio::sync::broadcast;
use tokio::task::JoinHandle;
use tokio::time::{Instant, timeout_at};

use super::{bus_failure, sdo_failure};
use crate::arguments::Can;
use crate::exit::Failure;
use crate::output::Output;

/// The node id under which the instrument service sends heartbeats unless it is configured otherwise.
const HOST_NODE_ID: u8 = 127;
/// How long the bus is listened to before anything is sent. A host sends a heartbeat every 100 ms.
const LISTEN_FIRST: Duration = Duration::from_millis(150);
/// How many frames a listener may lag behind.
const HEARD_LEN: usize = 4096;

/// A bus in use.
pub struct Session {
    nodes: Nodes,
    heard: broadcast::Sender<Stamped>,
    broken: Arc<Mutex<Option<bus::Error>>>,
    carrying: JoinHandle<()>,
    other_master: Option<String>,
}

impl Session {
    /// Opens the bus, listens for a moment, and warns when somebody else commands there.
    pub async fn open(can: &Can, output: &Output) -> Result<Self, Failure> {
        let bus = bus::connect(&can.bus)
            .await
            .map_err(|error| bus_failure(&error))?;
        let (heard, mut listening) = broadcast::channel(HEARD_LEN);
        let listened = Listened {
            bus,
            heard: heard.clone(),
        };
        let options = Options {
            sdo_timeout: Duration::from_millis(can.answer_ms),
            ..Options::default()
        };
        let (mut network, nodes) = Network::new(Box::new(listened), options);
        let broken = Arc::new(Mutex::new(None));
        let carried = Arc::clone(&broken);
        let carrying = tokio::spawn(async move {
            loop {
                if let Err(error) = network.next_event().await {
                    *carried.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                    return;
                }
            }
        });
        let other_master = other_master(&mut listening).await;
        if let Some(sign) = &other_master {
            output.note(format!(
                "arthro: another master is on {}: {sign}. Answers to two SDO clients collide: stop the other one, or \
                 expect its requests and these to fail.",
                can.bus
            ));
        }
        Ok(Self {
            nodes,
            heard,
            broken,
            carrying,
            other_master,
        })
    }

    /// A node by its number.
    pub fn node(&self, node_id: u8) -> Node {
        self.nodes.node(node_id)
    }

    /// All of them.
    pub fn nodes(&self) -> &Nodes {
        &self.nodes
    }

    /// Every frame from now on.
    pub fn listen(&self) -> broadcast::Receiver<Stamped> {
        self.heard.subscribe()
    }

    /// What told of another master.
    pub fn other_master(&self) -> Option<&str> {
        self.other_master.as_deref()
    }

    /// Why a transfer failed; the reason of the bus when that is what broke.
    pub fn failure(&self, error: &network::Error) -> Failure {
        let broken = self.broken.lock().unwrap_or_else(PoisonError::into_inner);
        match (error, broken.as_ref()) {
            (network::Error::Gone, Some(cause)) => bus_failure(cause),
            _ => sdo_failure(error),
        }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.carrying.abort();
    }
}

/// The first sign of another master in what is heard before anything was sent.
async fn other_master(listening: &mut broadcast::Receiver<Stamped>) -> Option<String> {
    let until = Instant::now() + LISTEN_FIRST;
    while let Ok(Ok(Stamped { frame, .. })) = timeout_at(until, listening.recv()).await {
        if let Some(sign) = sign_of_master(&frame) {
            return Some(sign);
        }
    }
    None
}

/// What only a master sends. Own frames are not received.
fn sign_of_master(frame: &Frame) -> Option<String> {
    match (frame.cob_id()?, heartbeat::decode(frame)) {
        (_, Some((HOST_NODE_ID, _))) => Some(format!(
            "node {HOST_NODE_ID} sends heartbeats, as the instrument service does"
        )),
        (cob_id @ 0x601..=0x67F, _) => {
            Some(format!("somebody asks node {} by SDO", cob_id - 0x600))
        }
        (nmt::COB_ID, _) => Some("somebody sends NMT commands".to_owned()),
        (0x080, _) => Some("somebody sends SYNC".to_owned()),
        _ => None,
    }
}

/// A bus whose received frames others hear too.
struct Listened {
    bus: Box<dyn CanBus>,
    heard: broadcast::Sender<Stamped>,
}

impl CanBus for Listened {
    fn send(&mut self, frame: Frame) -> Result<(), bus::Error> {
        self.bus.send(frame)
    }

    fn poll_receive(&mut self, context: &mut Context<'_>) -> Poll<Result<Stamped, bus::Error>> {
        let received = self.bus.poll_receive(context);
        if let Poll::Ready(Ok(stamped)) = &received {
            // Nobody listens between two commands.
            self.heard.send(*stamped).ok();
        }
        received
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_master_is_known_by_what_nodes_do_not_send() {
        let host = heartbeat::encode(HOST_NODE_ID, nmt::State::Operational);
        let ask = Frame::standard(0x602, [0x40, 0x41, 0x60, 0, 0, 0, 0, 0]);
        let order = nmt::encode(nmt::Command::Start, nmt::Target::All);
        for frame in [host, ask, order, Frame::standard(0x080, [])] {
            assert!(sign_of_master(&frame).is_some(), "{frame:?}");
        }
        let drive = heartbeat::encode(1, nmt::State::Operational);
        let answer = Frame::standard(0x582, [0x4B, 0x41, 0x60, 0, 0x40, 2, 0, 0]);
        let emergency = Frame::standard(0x082, [0x11, 0x86, 0x80, 0, 0, 0, 0, 0]);
        for frame in [drive, answer, emergency, Frame::standard(0x182, [0x40, 2])] {
            assert_eq!(sign_of_master(&frame), None, "{frame:?}");
        }
    }
}
