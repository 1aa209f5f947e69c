//! Puts a [`Bus`] on a CAN interface or behind another `socketcand`: one member of the simulated bus, and one participant
//! of the other, carry frames both ways.
//!
//! Neither end hears its own frames, so nothing comes back. A report of the interface's own controller is no frame of
//! the bus: a real drive would not see it either, so it is logged and goes no further.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use epos4_link::bus::{self, CanBus, Error};
use epos4_link::frame::{Frame, Id};
use tokio::task::JoinHandle;
use tokio::time::sleep;

use super::bus::{Bus, Member};

/// A carried connection. Ends when dropped.
#[derive(Debug)]
pub struct Wire {
    carrying: JoinHandle<Error>,
}

/// How long a full send queue is left alone before its frame is tried again, wall clock. Frames wait in the member's
/// queue meanwhile, which is bounded.
const RETRY: Duration = Duration::from_millis(1);

/// Connects the bus with the one at this address, such as `socketcan:can0`.
///
/// # Errors
/// When the address is none or nobody is there.
pub async fn join(bus: &Arc<Bus>, address: &str) -> Result<Wire, Error> {
    let wire = bus::connect(address).await?;
    let member = bus.join();
    let address = address.to_owned();
    let carrying = tokio::spawn(async move {
        let Err(error) = carry(member, wire).await;
        tracing::error!(address, %error, "the simulated drives are off the bus");
        error
    });
    Ok(Wire { carrying })
}

impl Wire {
    /// Why frames are no longer carried, once they are not.
    pub async fn ended(&mut self) -> Error {
        match (&mut self.carrying).await {
            Ok(error) => error,
            Err(ended) => Error::Closed(ended.to_string()),
        }
    }
}

impl Drop for Wire {
    fn drop(&mut self) {
        self.carrying.abort();
    }
}

async fn carry(mut member: Member, mut wire: Box<dyn CanBus>) -> Result<Infallible, Error> {
    let drives = member.sender();
    let mut refused: Option<Frame> = None;
    loop {
        tokio::select! {
            received = wire.receive() => match received?.frame {
                frame if matches!(frame.id(), Id::Error(_)) => {
                    tracing::warn!(?frame, "the controller of the interface reports an error");
                }
                frame => drives.send(&frame),
            },
            () = sleep(RETRY), if refused.is_some() => {
                if let Some(frame) = refused.take() {
                    refused = send(&mut wire, frame)?;
                }
            }
            heard = member.heard(), if refused.is_none() => {
                let heard = heard.ok_or_else(|| Error::Closed("the interface takes too few frames".to_owned()))?;
                // What a simulated controller reports concerns this end alone: the hosts beyond have their own.
                if !matches!(heard.frame.id(), Id::Error(_)) {
                    refused = send(&mut wire, heard.frame)?;
                }
            }
        }
    }
}

/// The frame again when it has to wait.
fn send(wire: &mut Box<dyn CanBus>, frame: Frame) -> Result<Option<Frame>, Error> {
    match wire.send(frame) {
        Ok(()) => Ok(None),
        Err(Error::QueueFull) => Ok(Some(frame)),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use std::net::SocketAddr;
    use std::task::{Context, Waker};

    use epos4_link::bus::CanBus as _;
    use epos4_link::bus::socketcand::server::Server;

    use super::*;
    use crate::epos4::{Drives, Node, NodeConfig, socketcand};

    /// A bus without drives, and the server that carries it.
    async fn bare_bus() -> (Arc<Bus>, Server, String) {
        let bus = Bus::new(Drives::new(Vec::new()));
        let bind = SocketAddr::from(([127, 0, 0, 1], 0));
        let server = socketcand::serve(bind, Arc::clone(&bus)).await.unwrap();
        let address = format!("socketcand://{}/can0", server.address());
        (bus, server, address)
    }

    /// A bus with a drive that has started.
    fn one_drive() -> Arc<Bus> {
        let bus = Bus::new(Drives::new(vec![Node::new(NodeConfig::new(1, 7))]));
        bus.tick(1.0, 1.0, &[]);
        bus
    }

    #[tokio::test]
    async fn a_master_beyond_the_wire_talks_to_the_drives_and_nothing_echoes() {
        let (far, _server, address) = bare_bus().await;
        let near = one_drive();
        let _wire = join(&near, &address).await.unwrap();
        let mut master = far.join();
        let mut neighbour = near.join();

        let read_device_type = Frame::standard(0x601, [0x40, 0x00, 0x10, 0, 0, 0, 0, 0]);
        let answer = Frame::standard(0x581, [0x43, 0x00, 0x10, 0, 0x92, 0x01, 0x02, 0x00]);
        for _ in 0..2 {
            master.sender().send(&read_device_type);
            assert_eq!(master.heard().await.unwrap().frame, answer);
        }
        // An echo of either would stand between them.
        for expected in [read_device_type, answer, read_device_type, answer] {
            assert_eq!(neighbour.heard().await.unwrap().frame, expected);
        }
        for member in [&mut master, &mut neighbour] {
            let mut context = Context::from_waker(Waker::noop());
            assert!(member.poll_receive(&mut context).is_pending());
        }
    }

    #[tokio::test]
    async fn more_frames_than_the_interface_queues_arrive_in_order() {
        let (far, _server, address) = bare_bus().await;
        let near = one_drive();
        let _wire = join(&near, &address).await.unwrap();
        let mut listener = far.join();
        let sender = near.join();
        let frames =
            (0..20 * bus::SEND_QUEUE_LEN).map(|i| Frame::standard(0x123, (i as u32).to_le_bytes()));
        let frames: Vec<Frame> = frames.collect();
        for frame in &frames {
            sender.sender().send(frame);
        }
        for frame in frames {
            assert_eq!(listener.heard().await.unwrap().frame, frame);
        }
    }

    #[tokio::test]
    async fn a_lost_wire_is_told() {
        let (_far, server, address) = bare_bus().await;
        let mut wire = join(&one_drive(), &address).await.unwrap();
        drop(server);
        assert!(matches!(wire.ended().await, Error::Closed(_)));
    }

    #[tokio::test]
    async fn an_address_that_is_no_bus_is_refused() {
        let error = join(&one_drive(), "can0").await.unwrap_err();
        assert!(matches!(error, Error::BadAddress { .. }), "{error}");
    }
}
