//! A bus within the process: every frame that one port sends, all other ports receive.

use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::sync::mpsc;

use super::{CanBus, Error, RECEIVE_QUEUE_LEN};
use crate::frame::{Frame, Stamped};

/// A bus. Clones are the same bus.
#[derive(Clone)]
pub struct Bus {
    clock: Arc<dyn Fn() -> Duration + Send + Sync>,
    ports: Arc<Mutex<Vec<Listener>>>,
}

struct Listener {
    id: u64,
    frames: mpsc::Sender<Stamped>,
}

/// A participant of a bus.
#[derive(Debug)]
pub struct Port {
    bus: Bus,
    id: u64,
    frames: mpsc::Receiver<Stamped>,
}

impl Bus {
    /// A bus whose frames are stamped with this clock.
    pub fn new(clock: impl Fn() -> Duration + Send + Sync + 'static) -> Self {
        Self {
            clock: Arc::new(clock),
            ports: Arc::default(),
        }
    }

    /// A new participant.
    pub fn attach(&self) -> Port {
        let (sender, frames) = mpsc::channel(RECEIVE_QUEUE_LEN);
        let mut ports = self.ports();
        let id = ports.last().map_or(0, |last| last.id + 1);
        ports.push(Listener { id, frames: sender });
        Port {
            bus: self.clone(),
            id,
            frames,
        }
    }

    /// A port that does not read is cut off, as a bus waits for nobody; it learns so by [`Error::Closed`].
    fn broadcast(&self, from: u64, frame: Frame) {
        let mut ports = self.ports();
        // Stamped under the lock, so that stamps grow in the order of the frames.
        let stamped = Stamped {
            frame,
            stamp: (self.clock)(),
        };
        ports.retain(|port| port.id == from || port.frames.try_send(stamped).is_ok());
    }

    fn ports(&self) -> MutexGuard<'_, Vec<Listener>> {
        // The list is whole between any two of its operations.
        self.ports.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl fmt::Debug for Bus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Bus")
            .field("ports", &self.ports().len())
            .finish_non_exhaustive()
    }
}

impl CanBus for Port {
    fn send(&mut self, frame: Frame) -> Result<(), Error> {
        self.bus.broadcast(self.id, frame);
        Ok(())
    }

    fn poll_receive(&mut self, context: &mut Context<'_>) -> Poll<Result<Stamped, Error>> {
        let received = self.frames.poll_recv(context);
        received.map(|frame| {
            frame.ok_or_else(|| Error::Closed("this port did not read and was cut off".to_owned()))
        })
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        self.bus.ports().retain(|port| port.id != self.id);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn the_others_receive_a_frame_and_the_sender_does_not() {
        let bus = Bus::new(|| Duration::from_secs(7));
        let [mut a, mut b, mut c] = [(); 3].map(|()| Box::new(bus.attach()) as Box<dyn CanBus>);
        let frame = Frame::standard(0x601, [0x40, 0x41, 0x60, 0, 0, 0, 0, 0]);
        a.send(frame).unwrap();
        let stamped = Stamped {
            frame,
            stamp: Duration::from_secs(7),
        };
        assert_eq!(b.receive().await, Ok(stamped));
        assert_eq!(c.receive().await, Ok(stamped));
        b.send(frame).unwrap();
        assert_eq!(a.receive().await, Ok(stamped));
        drop(c);
        a.send(frame).unwrap();
        assert_eq!(b.receive().await, Ok(stamped));
    }

    #[tokio::test]
    async fn a_port_that_does_not_read_is_cut_off_and_told() {
        let bus = Bus::new(Duration::default);
        let (mut sender, mut sleeper) = (bus.attach(), Box::new(bus.attach()) as Box<dyn CanBus>);
        for _ in 0..=RECEIVE_QUEUE_LEN {
            sender.send(Frame::standard(1, [])).unwrap();
        }
        for _ in 0..RECEIVE_QUEUE_LEN {
            sleeper.receive().await.unwrap();
        }
        assert!(matches!(sleeper.receive().await, Err(Error::Closed(_))));
    }
}
