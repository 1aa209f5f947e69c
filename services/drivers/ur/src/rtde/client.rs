//! An RTDE v2 client for any recipe: negotiation, setup, and the newest state under backlog.

use std::{collections::VecDeque, io, time::Duration};

use tokio::{
    net::TcpStream,
    time::{Instant, timeout, timeout_at},
};

use super::wire::{self, Frame, Reply, Request, Type, Value, Version};
use crate::Error;

const SERVICE: &str = "rtde";
/// Space that is free for each read.
const READ_BYTES: usize = 16 * 1024;
/// Reads in one `newest` before the state at hand counts as the newest: a flooding controller cannot hold us for ever.
const READS_AT_ONCE: usize = 64;

/// A connection to port 30004. Not started until [`Client::start`].
pub struct Client {
    stream: TcpStream,
    /// Received, not yet cut into frames; at most one incomplete frame stays between calls.
    inbox: Vec<u8>,
    /// Encoded, not yet taken by the socket.
    outbox: VecDeque<u8>,
    /// Payload of the newest data package.
    data: Vec<u8>,
    version: Version,
    reply_timeout: Duration,
}

/// The fields a controller sends us, in order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputRecipe {
    /// As the controller numbers it.
    pub id: u8,
    /// One for each field.
    pub types: Vec<Type>,
}

/// The fields we send a controller, in order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputRecipe {
    /// As the controller numbers it.
    pub id: u8,
    /// One for each field.
    pub types: Vec<Type>,
}

impl Client {
    /// Connects and agrees on version 2.
    ///
    /// # Errors
    /// No connection, no answer within `reply_timeout`, or a controller that has only version 1.
    pub async fn connect(host: &str, port: u16, reply_timeout: Duration) -> Result<Self, Error> {
        let stream = crate::error::connect(SERVICE, host, port, reply_timeout).await?;
        let mut client = Self {
            stream,
            inbox: Vec::new(),
            outbox: VecDeque::new(),
            data: Vec::new(),
            version: Version::V1,
            reply_timeout,
        };
        match client
            .ask(
                Request::ProtocolVersion(2),
                "answer to the rtde protocol version",
            )
            .await?
        {
            Reply::ProtocolVersion { accepted: true } => client.version = Version::V2,
            answer => return Err(refused("rtde protocol version 2", &answer)),
        }
        Ok(client)
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

    /// Asks for these fields, `frequency_hz` times a second.
    ///
    /// # Errors
    /// [`Error::Field`] when one is missing or of another type; connection failures.
    pub async fn setup_outputs(
        &mut self,
        frequency_hz: f64,
        fields: &[(&str, Type)],
    ) -> Result<OutputRecipe, Error> {
        let request = Request::SetupOutputs {
            frequency_hz: Some(frequency_hz),
            names: names(fields),
        };
        match self.ask(request, "answer to the output recipe").await? {
            Reply::SetupOutputs { recipe, types } => {
                check(fields, &types)?;
                Ok(OutputRecipe {
                    id: recipe.unwrap_or_default(),
                    types,
                })
            }
            answer => Err(refused("output recipe", &answer)),
        }
    }

    /// Claims these inputs.
    ///
    /// # Errors
    /// [`Error::Field`] when one is missing, taken by another client or of another type; connection failures.
    pub async fn setup_inputs(&mut self, fields: &[(&str, Type)]) -> Result<InputRecipe, Error> {
        match self
            .ask(
                Request::SetupInputs {
                    names: names(fields),
                },
                "answer to the input recipe",
            )
            .await?
        {
            Reply::SetupInputs { recipe, types } => {
                check(fields, &types)?;
                Ok(InputRecipe { id: recipe, types })
            }
            answer => Err(refused("input recipe", &answer)),
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
    /// Cancel safe.
    ///
    /// # Errors
    /// Nothing within `silence`, a violated protocol, a broken connection.
    pub async fn newest(
        &mut self,
        recipe: &OutputRecipe,
        silence: Duration,
    ) -> Result<&[u8], Error> {
        let deadline = Instant::now() + silence;
        let mut fresh = self.sort(recipe)?;
        while !fresh {
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
            for _ in 0..READS_AT_ONCE {
                if !self.read_some()? {
                    break;
                }
                fresh |= self.sort(recipe)?;
            }
        }
        Ok(&self.data)
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

    /// The next package that is neither state nor log.
    async fn reply(&mut self) -> Result<Reply, Error> {
        loop {
            while let Some(frame) = Frame::first(&self.inbox)? {
                let size = frame.size();
                let reply = Reply::decode(frame, self.version)?;
                self.inbox.drain(..size);
                match reply {
                    Reply::Data { .. } => {}
                    Reply::Text(text) => log(&text),
                    reply => return Ok(reply),
                }
            }
            self.stream.readable().await.map_err(io_error)?;
            self.read_some()?;
        }
    }

    /// Cuts the inbox into frames and keeps the newest data package of the recipe. True when there was one.
    fn sort(&mut self, recipe: &OutputRecipe) -> Result<bool, Error> {
        let mut fresh = false;
        let mut used = 0;
        while let Some(frame) = Frame::first(&self.inbox[used..])? {
            used += frame.size();
            if frame.is_data() {
                if let [id, fields @ ..] = frame.payload
                    && recipe.id == *id
                {
                    self.data.clear();
                    self.data.extend_from_slice(fields);
                    fresh = true;
                }
            } else if let Reply::Text(text) = Reply::decode(frame, self.version)? {
                log(&text);
            }
        }
        self.inbox.drain(..used);
        Ok(fresh)
    }

    /// One read without waiting; false when there is nothing.
    fn read_some(&mut self) -> Result<bool, Error> {
        let filled = self.inbox.len();
        self.inbox.resize(filled + READ_BYTES, 0);
        let outcome = self.stream.try_read(&mut self.inbox[filled..]);
        self.inbox
            .truncate(filled + outcome.as_ref().map_or(0, |bytes| *bytes));
        match outcome {
            Ok(0) => Err(Error::Closed { service: SERVICE }),
            Ok(_) => Ok(true),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(false),
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

fn names(fields: &[(&str, Type)]) -> Vec<String> {
    fields.iter().map(|(name, _)| (*name).to_owned()).collect()
}

fn check(fields: &[(&str, Type)], answers: &[Type]) -> Result<(), Error> {
    if answers.len() != fields.len() {
        let answer = format!("{} types for {} names", answers.len(), fields.len());
        return Err(Error::Refused {
            request: "recipe".into(),
            answer,
        });
    }
    match fields
        .iter()
        .zip(answers)
        .find(|((_, wanted), answer)| wanted != *answer)
    {
        Some(((name, wanted), answer)) => Err(Error::Field {
            name: (*name).to_owned(),
            answer: *answer,
            wanted: *wanted,
        }),
        None => Ok(()),
    }
}

fn refused(request: &str, answer: &Reply) -> Error {
    Error::Refused {
        request: request.to_owned(),
        answer: format!("{answer:?}"),
    }
}

fn log(text: &wire::Text) {
    tracing::info!(message_text = %text.message, source = %text.source, level = text.level, "controller says");
}

fn io_error(source: io::Error) -> Error {
    Error::Io {
        service: SERVICE,
        source,
    }
}
