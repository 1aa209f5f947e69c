//! The RTDE server: one recipe of outputs and any number of recipes of inputs for each connection, and the gate that lets
//! controlling clients keep pace with a clock faster than theirs.

mod inputs;

use std::{
    collections::HashMap,
    io,
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering},
    },
    time::Duration,
};

use tokio::{
    sync::Notify,
    time::{Instant, timeout_at},
};
use ur_link::rtde::wire::{self, Frame, Reply, Request, Type, Version};

use self::inputs::{Recipe, Warnings};
use super::{Shared, lock, outlet::Outlet};
use crate::ur5::{
    Controller, Input, Output, Series, Teller, Version as Software, link_fault::Place,
};

/// Recipes of inputs of one connection.
const MAX_INPUT_RECIPES: usize = 255;

/// Packages a second in version 1 of the protocol.
const V1_RATE_HZ: f64 = 125.0;

/// All RTDE connections.
#[derive(Debug)]
pub(super) struct Hub {
    clients: Mutex<Vec<Arc<Client>>>,
    /// Which connection writes an input.
    claims: Mutex<HashMap<Input, u64>>,
    cycle: AtomicU64,
    next_client: AtomicU64,
    unanswered_frames: u32,
    answered: Notify,
}

#[derive(Debug)]
struct Client {
    number: u64,
    outlet: Arc<Outlet>,
    session: Mutex<Session>,
    /// Answers frames with inputs.
    attentive: AtomicBool,
    /// Frames sent to an attentive client that it has not answered.
    unanswered: AtomicU32,
}

#[derive(Debug, Default)]
struct Session {
    version: Version,
    outputs: Option<Outputs>,
    inputs: Vec<Arc<Recipe>>,
    started: bool,
    warnings: Warnings,
}

#[derive(Debug)]
struct Outputs {
    fields: Vec<Output>,
    /// Where their numbers are in a frame.
    places: Vec<Place>,
    /// A package each so many cycles.
    every: u64,
}

impl Hub {
    pub(super) fn new(unanswered_frames: u32) -> Self {
        Self {
            clients: Mutex::default(),
            claims: Mutex::default(),
            cycle: AtomicU64::new(0),
            next_client: AtomicU64::new(1),
            unanswered_frames,
            answered: Notify::new(),
        }
    }

    pub(super) fn send(&self, controller: &Controller) {
        let cycle = self.cycle.fetch_add(1, Ordering::Relaxed);
        let mut packet = Vec::with_capacity(1024);
        for client in lock(&self.clients).iter() {
            let session = lock(&client.session);
            let Some(outputs) = session.outputs.as_ref().filter(|_| session.started) else {
                continue;
            };
            if !cycle.is_multiple_of(outputs.every) {
                continue;
            }
            packet.clear();
            let recipe = (session.version == Version::V2).then_some(1);
            wire::data_frame(&mut packet, recipe, |out| {
                outputs
                    .fields
                    .iter()
                    .for_each(|field| field.read(controller).encode(out));
            });
            // Counted before it is sent: the answer may be here before the next line.
            let awaited = client.attentive.load(Ordering::Acquire);
            client
                .unanswered
                .fetch_add(u32::from(awaited), Ordering::AcqRel);
            if !client.outlet.offer(&packet, &outputs.places) && awaited {
                client.one_less_unanswered();
            }
        }
    }

    pub(super) async fn wait(&self, bound: Duration) {
        if !self.is_awaited() {
            return;
        }
        let deadline = Instant::now() + bound;
        loop {
            let mut answered = std::pin::pin!(self.answered.notified());
            answered.as_mut().enable();
            if !self.is_awaited() {
                return;
            }
            if timeout_at(deadline, answered).await.is_err() {
                break;
            }
        }
        for client in lock(&self.clients)
            .iter()
            .filter(|client| self.lags(client))
        {
            client.attentive.store(false, Ordering::Release);
            client.unanswered.store(0, Ordering::Release);
        }
    }

    fn is_awaited(&self) -> bool {
        lock(&self.clients).iter().any(|client| self.lags(client))
    }

    fn lags(&self, client: &Client) -> bool {
        client.attentive.load(Ordering::Acquire)
            && client.unanswered.load(Ordering::Acquire) > self.unanswered_frames
    }

    /// The types of these inputs for a client, which are its own from now on unless one is refused.
    fn claim(
        &self,
        client: u64,
        software: Software,
        names: &[String],
    ) -> (Vec<(Input, Type)>, Vec<Type>) {
        let mut claims = lock(&self.claims);
        let inputs: Vec<_> = names
            .iter()
            .map(|name| Input::from_name(name).filter(|input| software.has(input.since())))
            .collect();
        let types: Vec<_> = inputs
            .iter()
            .map(|input| match input {
                None => Type::NotFound,
                Some(input) if claims.get(input).is_some_and(|owner| *owner != client) => {
                    Type::InUse
                }
                Some(input) => input.kind(),
            })
            .collect();
        if types.iter().all(|kind| kind.is_field()) {
            claims.extend(inputs.iter().flatten().map(|input| (*input, client)));
        }
        (
            inputs
                .into_iter()
                .flatten()
                .zip(types.iter().copied())
                .collect(),
            types,
        )
    }
}

pub(super) async fn converse(
    outlet: Arc<Outlet>,
    controller: Shared,
    hub: Arc<Hub>,
) -> io::Result<()> {
    let client = Arc::new(Client {
        number: hub.next_client.fetch_add(1, Ordering::Relaxed),
        outlet,
        session: Mutex::default(),
        attentive: AtomicBool::new(false),
        unanswered: AtomicU32::new(0),
    });
    lock(&hub.clients).push(client.clone());
    let member = Member { hub, client };
    let (hub, client) = (&member.hub, &member.client);
    let mut buffer = vec![0; 16 * 1024];
    let mut inbox = Vec::new();
    loop {
        let received = client.outlet.read(&mut buffer).await?;
        if received == 0 {
            return Ok(());
        }
        inbox.extend_from_slice(&buffer[..received]);
        let mut used = 0;
        while let Some(frame) = Frame::first(&inbox[used..]).map_err(violation)? {
            used += frame.size();
            let mut payload = frame.payload.to_vec();
            if client.outlet.takes(&mut payload) {
                let frame = Frame {
                    kind: frame.kind,
                    payload: &payload,
                };
                client.answer(frame, hub, &controller)?;
            }
        }
        inbox.drain(..used);
        client.outlet.flush().await?;
    }
}

impl Client {
    fn answer(&self, frame: Frame<'_>, hub: &Hub, controller: &Shared) -> io::Result<()> {
        if frame.is_data() {
            self.write_inputs(frame.payload, hub, controller);
            return Ok(());
        }
        let version = lock(&self.session).version;
        let request = Request::decode(frame, version).map_err(violation)?;
        // The clock locks the controller before a session, so nobody may do it the other way round.
        let (software, series, told) = {
            let controller = lock(controller);
            let config = &controller.robot.config;
            (
                config.software(),
                config.series,
                controller.told_version(Teller::Rtde),
            )
        };
        let mut session = lock(&self.session);
        let reply = match request {
            Request::ProtocolVersion(wanted) => {
                let accepted = match wanted {
                    1 => Some(Version::V1),
                    2 => Some(Version::V2),
                    _ => None,
                };
                session.version = accepted.unwrap_or(version);
                Reply::ProtocolVersion {
                    accepted: accepted.is_some(),
                }
            }
            Request::ControllerVersion => Reply::ControllerVersion(told.0),
            Request::Text(text) => {
                tracing::debug!(message_text = %text.message, "rtde client says");
                return Ok(());
            }
            Request::SetupOutputs {
                frequency_hz,
                names,
            } => session.setup_outputs(software, series, frequency_hz, &names),
            Request::SetupInputs { names } => {
                let (inputs, types) = hub.claim(self.number, software, &names);
                let usable = types.iter().all(|kind| kind.is_field())
                    && session.inputs.len() < MAX_INPUT_RECIPES;
                if usable {
                    session.inputs.push(inputs.into());
                }
                Reply::SetupInputs {
                    recipe: if usable {
                        session.inputs.len() as u8
                    } else {
                        0
                    },
                    types,
                }
            }
            Request::Start => {
                session.started = session.outputs.is_some();
                Reply::Start {
                    accepted: session.started,
                }
            }
            Request::Pause => {
                session.started = false;
                self.attentive.store(false, Ordering::Release);
                Reply::Pause { accepted: true }
            }
            // Taken above, without a copy of its fields.
            Request::Data { .. } => return Ok(()),
        };
        let mut bytes = Vec::new();
        reply.encode(version, &mut bytes);
        // Still under the session's lock: data packages must not overtake the answer to a start.
        self.outlet.queue(&bytes)
    }

    fn one_less_unanswered(&self) {
        let less = |unanswered: u32| Some(unanswered.saturating_sub(1));
        let _ = self
            .unanswered
            .fetch_update(Ordering::AcqRel, Ordering::Acquire, less);
    }

    fn answered(&self, hub: &Hub) {
        self.one_less_unanswered();
        self.attentive.store(true, Ordering::Release);
        hub.answered.notify_waiters();
    }
}

impl Session {
    fn setup_outputs(
        &mut self,
        software: Software,
        series: Series,
        frequency_hz: Option<f64>,
        names: &[String],
    ) -> Reply {
        let found: Vec<_> = names
            .iter()
            .map(|name| Output::from_name(name, software))
            .collect();
        let types: Vec<_> = found
            .iter()
            .map(|field| field.map_or(Type::NotFound, |(_, kind)| kind))
            .collect();
        let usable = !found.is_empty() && found.iter().all(Option::is_some);
        self.started = false;
        self.outputs = usable.then(|| Outputs {
            fields: found.iter().flatten().map(|(field, _)| *field).collect(),
            places: places(self.version, names, &types),
            every: cycles_between(series, frequency_hz),
        });
        Reply::SetupOutputs {
            recipe: (self.version == Version::V2).then_some(u8::from(usable)),
            types,
        }
    }
}

/// Where the numbers of a data package are.
fn places(version: Version, names: &[String], types: &[Type]) -> Vec<Place> {
    let mut offset = wire::HEADER_BYTES + usize::from(version == Version::V2);
    let mut place = |(name, kind): (&String, &Type)| {
        let start = offset;
        offset += kind.bytes();
        Place {
            field: name.clone(),
            offset: start,
            doubles: match kind {
                Type::Double => 1,
                Type::Vector3D => 3,
                Type::Vector6D => 6,
                _ => 0,
            },
        }
    };
    names.iter().zip(types).map(&mut place).collect()
}

/// The controller sends every n-th cycle; 0 asks for all. Version 1 names no frequency and gets 125 Hz.
fn cycles_between(series: Series, frequency_hz: Option<f64>) -> u64 {
    let wanted_hz = frequency_hz.unwrap_or(V1_RATE_HZ);
    if wanted_hz > 0.0 {
        (1.0 / (series.step_s() * wanted_hz))
            .round()
            .clamp(1.0, 1e6) as u64
    } else {
        1
    }
}

fn violation(error: wire::Error) -> io::Error {
    io::Error::other(error)
}

/// Takes the client off the list and frees its inputs however its connection ends.
struct Member {
    hub: Arc<Hub>,
    client: Arc<Client>,
}

impl Drop for Member {
    fn drop(&mut self) {
        lock(&self.hub.clients).retain(|client| !Arc::ptr_eq(client, &self.client));
        lock(&self.hub.claims).retain(|_, owner| *owner != self.client.number);
        self.hub.answered.notify_waiters();
    }
}
