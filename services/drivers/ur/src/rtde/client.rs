//! An RTDE client for any recipe: negotiation, setup, and the newest state under backlog.

mod setup;

use std::{collections::VecDeque, io, time::Duration};

use tokio::{
    net::TcpStream,
    time::{Instant, timeout, timeout_at},
};

pub use setup::{InputRecipe, OutputRecipe, Publication};

use super::{
    inbox::{Inbox, Wanted},
    recipe::{Inputs, Outputs},
    sample::{Sample, Subscription},
    version::ControllerVersion,
    wire::{self, Reply, Request, Value, Version},
};
use crate::Error;

pub(super) const SERVICE: &str = "rtde";
/// What the system may keep for us unread. A state that waits is worth less with every cycle: what does not fit stays
/// with the controller, which sends newer ones instead.
const RECEIVE_BUFFER_BYTES: u32 = 128 * 1024;
/// Reads in one `newest` before the state at hand counts as the newest: a flooding controller cannot hold us for ever.
/// All of them together take more than the system keeps.
pub(super) const READS_AT_ONCE: usize = 8;

/// A connection to port 30004. Not started until [`Client::start`].
///
/// It never reconnects: after an error it is of no more use, and whoever makes a new one decides what that means. Inputs
/// keep their last values in the controller when a connection ends.
pub struct Client {
    pub(super) stream: TcpStream,
    /// Received, not yet cut into frames.
    pub(super) inbox: Inbox,
    /// Encoded, not yet taken by the socket.
    outbox: VecDeque<u8>,
    /// Fields of the newest data package.
    data: Vec<u8>,
    pub(super) version: Version,
    controller: ControllerVersion,
    reply_timeout: Duration,
}

impl Client {
    /// Connects, agrees on version 2 of the protocol or else on 1, and asks for the controller's version.
    ///
    /// # Errors
    /// No connection, no answer within `reply_timeout`, a controller that has neither version, or one whose RTDE is known
    /// to be wrong ([`Error::TooOld`]).
    pub async fn connect(host: &str, port: u16, reply_timeout: Duration) -> Result<Self, Error> {
        let stream = crate::error::connect_with_buffer(
            SERVICE,
            host,
            port,
            reply_timeout,
            RECEIVE_BUFFER_BYTES,
        )
        .await?;
        let mut client = Self {
            stream,
            inbox: Inbox::default(),
            outbox: VecDeque::new(),
            data: Vec::new(),
            version: Version::V1,
            controller: ControllerVersion::new([0; 4]),
            reply_timeout,
        };
        if client.accepts(2).await? {
            client.version = Version::V2;
        } else if !client.accepts(1).await? {
            return Err(Error::Refused {
                request: "rtde protocol versions 2 and 1".into(),
                answer: "not accepted".into(),
            });
        }
        client.controller = ControllerVersion::new(client.controller_version().await?);
        if !client.controller.has_sound_rtde() {
            return Err(Error::TooOld {
                what: "rtde",
                found: client.controller,
                needs: "3.2.19171",
            });
        }
        Ok(client)
    }

    async fn accepts(&mut self, version: u16) -> Result<bool, Error> {
        let request = Request::ProtocolVersion(version);
        match self
            .ask(request, "answer to the rtde protocol version")
            .await?
        {
            Reply::ProtocolVersion { accepted } => Ok(accepted),
            answer => Err(refused("rtde protocol version", &answer)),
        }
    }

    /// The protocol in use.
    pub fn protocol(&self) -> Version {
        self.version
    }

    /// The software of the controller, as it answered when connected.
    pub fn controller(&self) -> ControllerVersion {
        self.controller
    }

    /// major, minor, bugfix, build of the controller software.
    ///
    /// # Errors
    /// Connection failures.
    pub async fn controller_version(&mut self) -> Result<[u32; 4], Error> {
        match self
            .ask(Request::ControllerVersion, "controller version")
            .await?
        {
            Reply::ControllerVersion(parts) => Ok(parts),
            answer => Err(refused("controller version", &answer)),
        }
    }

    /// Lets the outputs flow.
    ///
    /// # Errors
    /// Refused (no output recipe yet), or connection failures.
    pub async fn start(&mut self) -> Result<(), Error> {
        match self.ask(Request::Start, "answer to start").await? {
            Reply::Start { accepted: true } => Ok(()),
            answer => Err(refused("start", &answer)),
        }
    }

    /// Ends the flow of outputs; those under way are dropped.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn pause(&mut self) -> Result<(), Error> {
        match self.ask(Request::Pause, "answer to pause").await? {
            Reply::Pause { accepted: true } => Ok(()),
            answer => Err(refused("pause", &answer)),
        }
    }

    /// Waits for a data package and gives the fields of the newest one, which [`wire::take_values`] decodes.
    /// Cancel safe. Whether the state is newer than the last one is for the caller to see; [`Client::sample`] sees to it.
    ///
    /// # Errors
    /// Nothing within `silence`, a violated protocol, a broken connection.
    pub async fn newest(
        &mut self,
        recipe: &OutputRecipe,
        silence: Duration,
    ) -> Result<&[u8], Error> {
        let deadline = crate::error::deadline(silence);
        self.receive(&recipe.wanted(self.version), deadline, silence)
            .await?;
        Ok(&self.data)
    }

    /// Waits for a state that is newer than the last sample, and gives the newest there is. Cancel safe.
    ///
    /// # Errors
    /// No new state within `silence`, a timestamp that is not a number, a violated protocol, a broken connection.
    pub async fn sample<S: Outputs>(
        &mut self,
        subscription: &mut Subscription<S>,
        silence: Duration,
    ) -> Result<Sample<S>, Error> {
        let deadline = crate::error::deadline(silence);
        let wanted = subscription.wanted(self.version);
        loop {
            let packages = self.receive(&wanted, deadline, silence).await?;
            if let Some(sample) = subscription.sample(&self.data, packages)? {
                return Ok(sample);
            }
        }
    }

    async fn receive(
        &mut self,
        wanted: &Wanted,
        deadline: Instant,
        silence: Duration,
    ) -> Result<u64, Error> {
        // A flooding controller never lets us wait: other tasks must run all the same.
        tokio::task::consume_budget().await;
        loop {
            // Packages that came behind an answer may be in the inbox already, but newer ones in the socket.
            let mut packages = self.take_newest(wanted)?;
            for _ in 0..READS_AT_ONCE {
                let read = self.read_some();
                match read {
                    Ok(Read::Nothing) => break,
                    Ok(Read::Everything) => {
                        packages += self.take_newest(wanted)?;
                        break;
                    }
                    Ok(Read::Full) => packages += self.take_newest(wanted)?,
                    // What came before the end counts; the next call tells of the end.
                    Err(_) if packages > 0 => break,
                    Err(error) => return Err(error),
                }
            }
            if packages > 0 {
                return Ok(packages);
            }
            self.flush()?;
            match timeout_at(deadline, self.stream.readable()).await {
                Ok(ready) => ready.map_err(io_error)?,
                Err(_) => {
                    return Err(Error::Timeout {
                        what: "rtde state",
                        limit: silence,
                    });
                }
            }
        }
    }

    fn take_newest(&mut self, wanted: &Wanted) -> Result<u64, Error> {
        Ok(self
            .inbox
            .take_newest(wanted, &mut self.data, |text| log(&text))?)
    }

    /// Sends the inputs of `I`. Cancel safe: what was begun is completed before the next package.
    ///
    /// # Errors
    /// A broken connection, or one that takes nothing within the reply timeout.
    pub async fn put<I: Inputs>(
        &mut self,
        publication: &Publication<I>,
        inputs: &I,
    ) -> Result<(), Error> {
        let mut bytes = Vec::with_capacity(128);
        wire::data_frame(&mut bytes, Some(publication.id), |out| inputs.encode(out));
        self.outbox.extend(bytes);
        self.drain().await
    }

    /// Sends one input package. Cancel safe: what was begun is completed before the next package.
    ///
    /// # Errors
    /// Values that do not match the recipe, a broken connection, or one that takes nothing within the reply timeout.
    pub async fn send(&mut self, recipe: &InputRecipe, values: &[Value]) -> Result<(), Error> {
        if !values
            .iter()
            .map(Value::kind)
            .eq(recipe.types.iter().copied())
        {
            return Err(Error::Refused {
                request: "input package".into(),
                answer: "its types differ from the recipe".into(),
            });
        }
        let mut bytes = Vec::with_capacity(128);
        wire::data_frame(&mut bytes, Some(recipe.id), |out| {
            values.iter().for_each(|value| value.encode(out))
        });
        self.outbox.extend(bytes);
        self.drain().await
    }

    async fn ask(&mut self, request: Request, what: &'static str) -> Result<Reply, Error> {
        let mut bytes = Vec::new();
        request.encode(self.version, &mut bytes);
        self.outbox.extend(bytes);
        self.drain().await?;
        let limit = self.reply_timeout;
        timeout(limit, self.reply())
            .await
            .map_err(|_| Error::Timeout { what, limit })?
    }

    /// The next package that is neither state nor log: states may be under way when a pause is answered.
    async fn reply(&mut self) -> Result<Reply, Error> {
        loop {
            while let Some(frame) = self.inbox.next()? {
                if frame.is_data() {
                    continue;
                }
                match Reply::decode(frame, self.version)? {
                    Reply::Text(text) => log(&text),
                    reply => return Ok(reply),
                }
            }
            self.stream.readable().await.map_err(io_error)?;
            self.read_some()?;
        }
    }

    /// One read without waiting.
    fn read_some(&mut self) -> Result<Read, Error> {
        let space = self.inbox.space();
        let room = space.len();
        match self.stream.try_read(space) {
            Ok(0) => Err(Error::Closed { service: SERVICE }),
            Ok(bytes) => {
                self.inbox.received(bytes);
                Ok(if bytes < room {
                    Read::Everything
                } else {
                    Read::Full
                })
            }
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(Read::Nothing),
            Err(error) => Err(io_error(error)),
        }
    }

    async fn drain(&mut self) -> Result<(), Error> {
        let limit = self.reply_timeout;
        while !self.flush()? {
            let ready = timeout(limit, self.stream.writable()).await;
            ready
                .map_err(|_| Error::Timeout {
                    what: "space to send to rtde",
                    limit,
                })?
                .map_err(io_error)?;
        }
        Ok(())
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

/// What one read brought.
enum Read {
    Nothing,
    /// All that the socket had.
    Everything,
    /// As much as there was room for; there may be more.
    Full,
}

fn refused(request: &str, answer: &Reply) -> Error {
    Error::Refused {
        request: request.to_owned(),
        answer: format!("{answer:?}"),
    }
}

pub(super) fn log(text: &wire::Text) {
    tracing::info!(message_text = %text.message, source = %text.source, level = text.level, "controller says");
}

pub(super) fn io_error(source: io::Error) -> Error {
    Error::Io {
        service: SERVICE,
        source,
    }
}
