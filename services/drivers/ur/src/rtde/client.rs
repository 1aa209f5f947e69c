//! An RTDE client for any recipe: negotiation, setup, and the newest state under backlog.

use std::{collections::VecDeque, io, marker::PhantomData, time::Duration};

use tokio::{
    net::TcpStream,
    time::{Instant, timeout, timeout_at},
};

use super::{
    fields,
    inbox::{Inbox, Wanted},
    recipe::{Inputs, Outputs},
    sample::{Sample, Subscription},
    version::ControllerVersion,
    wire::{self, MAX_NAMES_BYTES, Reply, Request, Type, Value, Version},
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

impl OutputRecipe {
    pub(super) fn wanted(&self, version: Version) -> Wanted {
        Wanted {
            version,
            recipe: self.id,
            payload_bytes: self.types.iter().map(|kind| kind.bytes()).sum(),
        }
    }
}

/// A typed input recipe that a controller accepted.
#[derive(Debug)]
pub struct Publication<I> {
    pub(super) id: u8,
    inputs: PhantomData<I>,
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

    /// Asks for these fields, `frequency_hz` times a second; 0 is every control cycle. Version 1 knows only that.
    ///
    /// # Errors
    /// [`Error::Value`] for a rate that the controller does not have, [`Error::Field`] or [`Error::FieldSince`] when a
    /// field is missing or of another type; connection failures.
    pub async fn setup_outputs(
        &mut self,
        frequency_hz: f64,
        fields: &[(&str, Type)],
    ) -> Result<OutputRecipe, Error> {
        let frequency_hz = self.frequency_hz(frequency_hz)?;
        let request = Request::SetupOutputs {
            frequency_hz: (self.version == Version::V2).then_some(frequency_hz),
            names: names(fields)?,
        };
        match self.ask(request, "answer to the output recipe").await? {
            Reply::SetupOutputs { recipe, types } => {
                self.check(fields, &types, fields::output)?;
                if recipe == Some(0) {
                    return Err(unusable("output recipe"));
                }
                Ok(OutputRecipe {
                    id: recipe.unwrap_or_default(),
                    types,
                })
            }
            answer => Err(refused("output recipe", &answer)),
        }
    }

    /// Asks for the fields of `S` as [`Client::setup_outputs`] does, and for the timestamp, by which freshness is judged.
    ///
    /// # Errors
    /// As [`Client::setup_outputs`].
    pub async fn subscribe<S: Outputs>(
        &mut self,
        frequency_hz: f64,
    ) -> Result<Subscription<S>, Error> {
        let recipe = self
            .setup_outputs(frequency_hz, &Subscription::<S>::fields())
            .await?;
        let every = self.cycles_between(self.frequency_hz(frequency_hz)?);
        Ok(Subscription::new(
            recipe,
            self.controller.max_frequency_hz() / every,
        ))
    }

    /// Claims the inputs of `I`.
    ///
    /// # Errors
    /// As [`Client::setup_inputs`].
    pub async fn publish<I: Inputs>(&mut self) -> Result<Publication<I>, Error> {
        let recipe = self.setup_inputs(I::FIELDS).await?;
        Ok(Publication {
            id: recipe.id,
            inputs: PhantomData,
        })
    }

    /// The rate to ask for: 0 is the highest.
    fn frequency_hz(&self, wanted_hz: f64) -> Result<f64, Error> {
        let max_hz = self.controller.max_frequency_hz();
        let (allowed, limit) = match (self.version, self.controller.is_cb3()) {
            (Version::V1, _) => (max_hz..=max_hz, "0, or every cycle: rtde version 1"),
            (Version::V2, true) => (f64::MIN_POSITIVE..=max_hz, "0 to 125: CB3"),
            (Version::V2, false) => (f64::MIN_POSITIVE..=max_hz, "0 to 500: e-Series"),
        };
        if wanted_hz == 0.0 {
            Ok(max_hz)
        } else if allowed.contains(&wanted_hz) {
            Ok(wanted_hz)
        } else {
            Err(Error::Value {
                field: "frequency_hz",
                value: wanted_hz,
                limit,
            })
        }
    }

    /// A controller sends in every n-th cycle.
    fn cycles_between(&self, frequency_hz: f64) -> f64 {
        (self.controller.max_frequency_hz() / frequency_hz)
            .round()
            .max(1.0)
    }

    /// Claims these inputs.
    ///
    /// # Errors
    /// [`Error::Field`] or [`Error::FieldSince`] when one is missing, taken by another client (`IN_USE`) or of another
    /// type; connection failures.
    pub async fn setup_inputs(&mut self, fields: &[(&str, Type)]) -> Result<InputRecipe, Error> {
        match self
            .ask(
                Request::SetupInputs {
                    names: names(fields)?,
                },
                "answer to the input recipe",
            )
            .await?
        {
            Reply::SetupInputs { recipe, types } => {
                self.check(fields, &types, fields::input)?;
                if recipe == 0 {
                    return Err(unusable("input recipe"));
                }
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

fn names(fields: &[(&str, Type)]) -> Result<Vec<String>, Error> {
    let bytes = fields.iter().map(|(name, _)| name.len() + 1).sum::<usize>();
    if bytes > MAX_NAMES_BYTES {
        return Err(Error::Wire(wire::Error::Names(bytes)));
    }
    Ok(fields.iter().map(|(name, _)| (*name).to_owned()).collect())
}

impl Client {
    fn check(
        &self,
        fields: &[(&str, Type)],
        answers: &[Type],
        known: fn(&str) -> Option<fields::Field>,
    ) -> Result<(), Error> {
        if answers.len() != fields.len() {
            let answer = format!("{} types for {} names", answers.len(), fields.len());
            return Err(Error::Refused {
                request: "recipe".into(),
                answer,
            });
        }
        let mut answered = fields.iter().zip(answers);
        let Some(((name, wanted), answer)) =
            answered.find(|((_, wanted), answer)| wanted != *answer)
        else {
            return Ok(());
        };
        match known(name).and_then(|field| field.since) {
            Some(since) if *answer == Type::NotFound && !self.controller.has(&since) => {
                Err(Error::FieldSince {
                    name: (*name).to_owned(),
                    since,
                    found: self.controller,
                })
            }
            _ => Err(Error::Field {
                name: (*name).to_owned(),
                answer: *answer,
                wanted: *wanted,
            }),
        }
    }
}

fn unusable(request: &str) -> Error {
    Error::Refused {
        request: request.to_owned(),
        answer: "recipe 0".into(),
    }
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
