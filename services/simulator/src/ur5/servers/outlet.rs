//! Writes packets to a client without waiting and without a growing queue.

use std::{
    collections::VecDeque,
    io,
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
};

use tokio::{net::TcpStream, sync::Notify};

use super::{links::Links, lock};
use crate::ur5::link_fault::{Fate, Place, Service};

/// Answers that wait for a client that does not read; one that lets more pile up is let go.
const MAX_PENDING_BYTES: usize = 256 * 1024;
/// Packets that a fault delays; what goes beyond is lost.
const MAX_HELD_BYTES: usize = 4 * 1024 * 1024;

/// The writing side of a connection.
#[derive(Debug)]
pub struct Outlet {
    stream: TcpStream,
    service: Service,
    links: Arc<Links>,
    queue: Mutex<Queue>,
    is_reset: AtomicBool,
    woken: Notify,
}

#[derive(Debug, Default)]
struct Queue {
    /// Accepted, not yet taken by the socket.
    pending: Vec<u8>,
    /// Delayed by a fault until a time of the controller, s.
    held: VecDeque<(f64, Vec<u8>)>,
    held_bytes: usize,
    /// Kept back by a fault until the next packet has gone.
    overtaken: Option<Vec<u8>>,
}

/// How much a packet is worth when the client does not take it now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Worth {
    /// Nothing: a newer one will come.
    OnlyNow,
    /// It must arrive.
    Always,
}

impl Outlet {
    /// Over this connection.
    pub fn new(stream: TcpStream, service: Service, links: &Arc<Links>) -> Arc<Self> {
        let outlet = Arc::new(Self {
            stream,
            service,
            links: links.clone(),
            queue: Mutex::default(),
            is_reset: AtomicBool::new(false),
            woken: Notify::new(),
        });
        links.enter(&outlet);
        outlet
    }

    /// Whose connection it is.
    pub fn service(&self) -> Service {
        self.service
    }

    /// Sends a packet that is worth nothing later: dropped when an earlier one is not gone yet. True when it was taken.
    pub fn offer(&self, packet: &[u8], places: &[Place]) -> bool {
        let sent = if self.links.has_faults() {
            self.meet_faults(packet, places, Worth::OnlyNow)
        } else {
            self.send(&mut lock(&self.queue), packet, Worth::OnlyNow)
        };
        sent.unwrap_or(false)
    }

    /// Sends bytes that must arrive, in order with the packets.
    ///
    /// # Errors
    /// The connection is broken, or the client does not read.
    pub fn queue(&self, bytes: &[u8]) -> io::Result<()> {
        if self.links.has_faults() {
            self.meet_faults(bytes, &[], Worth::Always)?;
        } else {
            self.send(&mut lock(&self.queue), bytes, Worth::Always)?;
        }
        Ok(())
    }

    /// Waits until the client sent something, and takes it. 0 bytes: it will send no more.
    ///
    /// # Errors
    /// The connection is broken, or a fault resets it.
    pub async fn read(&self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            let woken = self.woken.notified();
            if self.is_reset.load(Ordering::Acquire) {
                self.stream.set_zero_linger()?;
                return Err(io::Error::other("reset by a fault"));
            }
            tokio::select! {
                ready = self.stream.readable() => ready?,
                () = woken => continue,
            }
            match self.stream.try_read(buffer) {
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                outcome => return outcome,
            }
        }
    }

    /// Whether a packet from the client is taken in; a fault may change it.
    pub fn takes(&self, packet: &mut [u8]) -> bool {
        !self.links.has_faults() || self.links.incoming(self.service, packet)
    }

    /// Waits until all that was queued is gone, or a fault keeps it.
    ///
    /// # Errors
    /// The connection is broken.
    pub async fn flush(&self) -> io::Result<()> {
        loop {
            {
                let mut queue = lock(&self.queue);
                self.write_pending(&mut queue)?;
                if queue.pending.is_empty() {
                    return Ok(());
                }
                if self.is_kept() {
                    self.links.hold();
                    return Ok(());
                }
            }
            tokio::select! {
                ready = self.stream.writable() => ready?,
                () = self.woken.notified() => {}
            }
        }
    }

    /// Ends the connection with a reset.
    pub(super) fn reset(&self) {
        self.is_reset.store(true, Ordering::Release);
        self.woken.notify_waiters();
        // One that is about to wait finds the permit.
        self.woken.notify_one();
    }

    /// Sends what is due and what a cleared fault has kept.
    pub(super) fn release(&self, now_s: f64) {
        let mut queue = lock(&self.queue);
        while let Some((_, packet)) = queue.held.pop_front_if(|(due_s, _)| *due_s <= now_s) {
            queue.held_bytes -= packet.len();
            // A client that does not read loses what was delayed for it.
            let _ = self.send(&mut queue, &packet, Worth::Always);
        }
        if self.write_pending(&mut queue).is_ok() {
            let is_empty = queue.held.is_empty() && queue.pending.is_empty();
            if !is_empty {
                self.links.hold();
            }
        }
    }

    fn meet_faults(&self, packet: &[u8], places: &[Place], worth: Worth) -> io::Result<bool> {
        if self.is_kept() {
            let mut queue = lock(&self.queue);
            self.links.hold();
            return match worth {
                // Counted as lost by the faults.
                Worth::OnlyNow => {
                    drop(queue);
                    self.links
                        .outgoing(self.service, &mut packet.to_vec(), places);
                    Ok(false)
                }
                Worth::Always => self.append(&mut queue, packet).map(|()| true),
            };
        }
        let mut packet = packet.to_vec();
        let fate = self.links.outgoing(self.service, &mut packet, places);
        let mut queue = lock(&self.queue);
        match fate {
            Fate::Send => {
                let sent = self.send(&mut queue, &packet, worth)?;
                if let Some(late) = queue.overtaken.take() {
                    self.send(&mut queue, &late, Worth::Always)?;
                }
                Ok(sent)
            }
            Fate::Lose => Ok(false),
            Fate::AfterNext => {
                // Only one waits: a second one lets the first go.
                if let Some(earlier) = queue.overtaken.replace(packet) {
                    self.send(&mut queue, &earlier, Worth::Always)?;
                }
                Ok(false)
            }
            Fate::At(due_s) => {
                if queue.held_bytes + packet.len() <= MAX_HELD_BYTES {
                    queue.held_bytes += packet.len();
                    queue.held.push_back((due_s, packet));
                    self.links.hold();
                }
                Ok(false)
            }
        }
    }

    fn is_kept(&self) -> bool {
        self.links.stalls(self.service)
    }

    fn send(&self, queue: &mut Queue, packet: &[u8], worth: Worth) -> io::Result<bool> {
        if worth == Worth::Always {
            self.append(queue, packet)?;
            self.write_pending(queue)?;
            return Ok(true);
        }
        self.write_pending(queue)?;
        if !queue.pending.is_empty() {
            return Ok(false);
        }
        match self.stream.try_write(packet) {
            Ok(written) => {
                queue.pending.extend_from_slice(&packet[written..]);
                Ok(true)
            }
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(false),
            Err(error) => Err(error),
        }
    }

    fn append(&self, queue: &mut Queue, packet: &[u8]) -> io::Result<()> {
        if queue.pending.len() + packet.len() > MAX_PENDING_BYTES {
            return Err(io::Error::other("client does not read"));
        }
        queue.pending.extend_from_slice(packet);
        Ok(())
    }

    fn write_pending(&self, queue: &mut Queue) -> io::Result<()> {
        if self.is_kept() {
            return Ok(());
        }
        while !queue.pending.is_empty() {
            match self.stream.try_write(&queue.pending) {
                Ok(written) => drop(queue.pending.drain(..written)),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}
