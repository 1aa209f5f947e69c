//! The node on the network: its NMT state, its own heartbeat, and the heartbeats that it waits for.

use std::time::Duration;

use epos4_link::canopen::heartbeat::{self, Consumer, Event};
use epos4_link::canopen::nmt::{Command, State};
use epos4_link::frame::Frame;

use super::objects::Objects;
use epos4_link::objects;

/// NMT and heartbeats.
#[derive(Clone, Debug)]
pub struct Network {
    state: State,
    /// When the last heartbeat was due.
    heartbeat_due_s: f64,
    consumers: [Watch; 2],
}

/// One entry of object 0x1016.
#[derive(Clone, Debug, Default)]
struct Watch {
    /// The entry as last seen: a new one starts anew.
    entry: i64,
    /// Unset while the entry is off.
    watched: Option<(u8, Consumer)>,
    timeout_s: f64,
    /// When the last heartbeat came, until it is missed.
    heard_s: Option<f64>,
}

/// The cell's clock is a sum of steps.
const CLOCK_ROUNDING_S: f64 = 1e-6;

impl Network {
    /// Powered up, not yet on the bus.
    #[must_use]
    pub fn new() -> Self {
        Self {
            state: State::BootUp,
            heartbeat_due_s: 0.0,
            consumers: Default::default(),
        }
    }

    /// NMT state.
    #[must_use]
    pub fn state(&self) -> State {
        self.state
    }

    /// Obeys a change of state. Resets are the node's own affair.
    pub fn obey(&mut self, command: Command) {
        self.state = match command {
            _ if self.state == State::BootUp => State::BootUp,
            Command::Start => State::Operational,
            Command::Stop => State::Stopped,
            Command::EnterPreOperational => State::PreOperational,
            Command::ResetNode | Command::ResetCommunication => State::BootUp,
        };
    }

    /// Does what 0x1029 says after a communication error.
    pub fn on_communication_error(&mut self, objects: &Objects) {
        if self.state != State::Operational {
            return;
        }
        match objects.get(objects::COMMUNICATION_ERROR_BEHAVIOUR.address) {
            0 => self.state = State::PreOperational,
            2 => self.state = State::Stopped,
            _ => {}
        }
    }

    /// Takes a heartbeat of another node.
    pub fn on_heartbeat(&mut self, from: u8, state: State, now_s: f64) {
        for watch in &mut self.consumers {
            if let Some((node_id, consumer)) = &mut watch.watched
                && *node_id == from
            {
                consumer.on_heartbeat(state, stamp(now_s));
                watch.heard_s = Some(now_s);
            }
        }
    }

    /// How long until a heartbeat that is waited for counts as missed; none when none is.
    #[must_use]
    pub fn patience_s(&self, now_s: f64) -> Option<f64> {
        self.consumers
            .iter()
            .filter_map(|watch| Some(watch.heard_s? + watch.timeout_s - now_s))
            .reduce(f64::min)
    }

    /// Boot-up message or heartbeat, when due.
    pub fn due(&mut self, node_id: u8, objects: &Objects, now_s: f64) -> Option<Frame> {
        if self.state == State::BootUp {
            self.state = State::PreOperational;
            self.heartbeat_due_s = now_s;
            return Some(heartbeat::encode(node_id, State::BootUp));
        }
        let period_s = objects.get(objects::PRODUCER_HEARTBEAT.address) as f64 / 1000.0;
        let late_s = now_s - (self.heartbeat_due_s + period_s);
        if period_s == 0.0 || late_s < -CLOCK_ROUNDING_S {
            return None;
        }
        // The period does not drift with the steps of the cell, but what was missed is not made up for.
        self.heartbeat_due_s = if late_s < period_s {
            self.heartbeat_due_s + period_s
        } else {
            now_s
        };
        Some(heartbeat::encode(node_id, self.state))
    }

    /// Whether a heartbeat that is waited for has stayed out, told once.
    pub fn lost_a_heartbeat(&mut self, objects: &Objects, now_s: f64) -> bool {
        let entries = [
            objects.get(objects::CONSUMER_HEARTBEAT_1.address),
            objects.get(objects::CONSUMER_HEARTBEAT_2.address),
        ];
        let mut lost = false;
        for (watch, entry) in self.consumers.iter_mut().zip(entries) {
            if watch.entry != entry {
                *watch = Watch::of(entry);
            }
            if let Some((_, consumer)) = &mut watch.watched {
                let missed = matches!(consumer.on_time(stamp(now_s)), Some(Event::Lost { .. }));
                if missed {
                    watch.heard_s = None;
                }
                lost |= missed;
            }
        }
        lost
    }
}

impl Watch {
    /// Node id in bits 16 to 22, milliseconds in bits 0 to 15.
    fn of(entry: i64) -> Self {
        let (node_id, timeout_ms) = ((entry >> 16 & 0x7F) as u8, (entry & 0xFFFF) as u64);
        let watched = (node_id != 0 && timeout_ms != 0)
            .then(|| (node_id, Consumer::new(Duration::from_millis(timeout_ms))));
        Self {
            entry,
            watched,
            timeout_s: timeout_ms as f64 / 1000.0,
            heard_s: None,
        }
    }
}

fn stamp(now_s: f64) -> Duration {
    Duration::try_from_secs_f64(now_s).unwrap_or_default()
}
