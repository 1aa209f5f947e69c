//! A client of the primary or secondary interface.

use std::{collections::VecDeque, io, time::Duration};

use tokio::{
    net::TcpStream,
    time::{timeout, timeout_at},
};

use super::{
    state::{Configuration, Kinematics},
    wire::{self, MAX_PACKET_BYTES, Message, Packet},
};
use crate::Error;

const SERVICE: &str = "primary";
/// Room for the longest packet and a read behind it.
const CAPACITY: usize = 2 * MAX_PACKET_BYTES;

/// A connection to port 30001 (or 30011, which takes no programs; or 30002 and 30012, which bring no messages).
///
/// It never reconnects, and sends nothing but what [`Primary::send_script`] is given.
pub struct Primary {
    stream: TcpStream,
    /// Received and not read: `start..end`.
    inbox: Box<[u8]>,
    start: usize,
    end: usize,
    /// Accepted, not yet taken by the socket.
    outbox: VecDeque<u8>,
    reply_timeout: Duration,
}

impl Primary {
    /// Connects. The first message is the version of the controller.
    ///
    /// # Errors
    /// No connection within `reply_timeout`.
    pub async fn connect(host: &str, port: u16, reply_timeout: Duration) -> Result<Self, Error> {
        Ok(Self {
            stream: crate::error::connect(SERVICE, host, port, reply_timeout).await?,
            inbox: vec![0; CAPACITY].into_boxed_slice(),
            start: 0,
            end: 0,
            outbox: VecDeque::new(),
            reply_timeout,
        })
    }

    /// Waits for the next message. Cancel safe. Every message comes in order; whoever is too slow for ten states a second
    /// holds up the controller, which drops states then.
    ///
    /// # Errors
    /// Nothing within `silence`, a violated protocol, a broken connection.
    pub async fn next(&mut self, silence: Duration) -> Result<Message, Error> {
        tokio::task::consume_budget().await;
        let deadline = crate::error::deadline(silence);
        loop {
            if let Some(packet) = Packet::first(&self.inbox[self.start..self.end])? {
                self.start += packet.size();
                return Ok(Message::decode(packet)?);
            }
            self.flush()?;
            timeout_at(deadline, self.stream.readable())
                .await
                .map_err(|_| Error::Timeout {
                    what: "message of the primary interface",
                    limit: silence,
                })?
                .map_err(io_error)?;
            self.read()?;
        }
    }

    /// Waits for what tells the arm's make and its calibration, which come when a connection begins.
    ///
    /// # Errors
    /// Not both within the reply timeout, a violated protocol, a broken connection.
    pub async fn identity(&mut self) -> Result<(Configuration, Kinematics), Error> {
        let limit = self.reply_timeout;
        let both = async {
            let (mut configuration, mut kinematics) = (None, None);
            loop {
                if let Message::State(state) = self.next(limit).await? {
                    configuration = state.configuration.or(configuration);
                    kinematics = state.kinematics.or(kinematics);
                }
                if let (Some(configuration), Some(kinematics)) = (configuration, kinematics) {
                    return Ok((configuration, kinematics));
                }
            }
        };
        timeout(limit, both).await.map_err(|_| Error::Timeout {
            what: "configuration and kinematics",
            limit,
        })?
    }

    /// Sends URScript text as it is. The controller does not answer; see `Script`.
    ///
    /// # Errors
    /// A broken connection, or one that takes nothing within the reply timeout.
    pub async fn send_script(&mut self, text: &str) -> Result<(), Error> {
        self.outbox.extend(text.as_bytes());
        let limit = self.reply_timeout;
        while !self.flush()? {
            timeout(limit, self.stream.writable())
                .await
                .map_err(|_| Error::Timeout {
                    what: "space to send a program",
                    limit,
                })?
                .map_err(io_error)?;
        }
        Ok(())
    }

    fn read(&mut self) -> Result<(), Error> {
        self.inbox.copy_within(self.start..self.end, 0);
        self.end -= self.start;
        self.start = 0;
        match self.stream.try_read(&mut self.inbox[self.end..]) {
            Ok(0) => Err(Error::Closed { service: SERVICE }),
            Ok(bytes) => {
                self.end += bytes;
                Ok(())
            }
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(()),
            Err(error) => Err(io_error(error)),
        }
    }

    /// Writes what the socket takes now; true when nothing is left.
    fn flush(&mut self) -> Result<bool, Error> {
        while !self.outbox.is_empty() {
            match self.stream.try_write(self.outbox.make_contiguous()) {
                Ok(bytes) => drop(self.outbox.drain(..bytes)),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(false),
                Err(error) => return Err(io_error(error)),
            }
        }
        Ok(true)
    }
}

impl From<wire::Error> for Error {
    fn from(source: wire::Error) -> Self {
        Self::Primary(source)
    }
}

fn io_error(source: io::Error) -> Error {
    Error::Io {
        service: SERVICE,
        source,
    }
}
