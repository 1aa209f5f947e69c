//! Writes packets to a client without waiting and without a growing queue.

use std::{io, sync::Mutex};

use tokio::net::TcpStream;

use super::lock;

/// Answers that wait for a client that does not read; one that lets more pile up is let go.
const MAX_PENDING_BYTES: usize = 256 * 1024;

/// The writing side of a connection.
#[derive(Debug)]
pub struct Outlet {
    stream: TcpStream,
    /// Accepted, not yet taken by the socket.
    pending: Mutex<Vec<u8>>,
}

impl Outlet {
    /// Over this connection.
    pub fn new(stream: TcpStream) -> Self {
        Self {
            stream,
            pending: Mutex::new(Vec::new()),
        }
    }

    /// Sends a packet that is worth nothing later: dropped when an earlier one is not gone yet. True when it was taken.
    pub fn offer(&self, packet: &[u8]) -> bool {
        let mut pending = lock(&self.pending);
        if self.write_pending(&mut pending).is_err() || !pending.is_empty() {
            return false;
        }
        match self.stream.try_write(packet) {
            Ok(written) => {
                pending.extend_from_slice(&packet[written..]);
                true
            }
            Err(_) => false,
        }
    }

    /// Sends bytes that must arrive, in order with the packets.
    ///
    /// # Errors
    /// The connection is broken, or the client does not read.
    pub fn queue(&self, bytes: &[u8]) -> io::Result<()> {
        let mut pending = lock(&self.pending);
        if pending.len() + bytes.len() > MAX_PENDING_BYTES {
            return Err(io::Error::other("client does not read"));
        }
        pending.extend_from_slice(bytes);
        self.write_pending(&mut pending)
    }

    /// Waits until the client sent something, and takes it. 0 bytes: it will send no more.
    ///
    /// # Errors
    /// The connection is broken.
    pub async fn read(&self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            self.stream.readable().await?;
            match self.stream.try_read(buffer) {
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                outcome => return outcome,
            }
        }
    }

    /// Waits until all that was queued is gone.
    ///
    /// # Errors
    /// The connection is broken.
    pub async fn flush(&self) -> io::Result<()> {
        loop {
            {
                let mut pending = lock(&self.pending);
                self.write_pending(&mut pending)?;
                if pending.is_empty() {
                    return Ok(());
                }
            }
            self.stream.writable().await?;
        }
    }

    fn write_pending(&self, pending: &mut Vec<u8>) -> io::Result<()> {
        while !pending.is_empty() {
            match self.stream.try_write(pending) {
                Ok(written) => drop(pending.drain(..written)),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}
