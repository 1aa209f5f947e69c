//! The master of a CANopen network: sends the SDO requests of any number of callers, one at a time to each node, sends its
//! own heartbeat and SYNC, and tells what the nodes report by themselves.
//!
//! The network does not run by itself. Its owner calls [`Network::next_event`] again and again; the [`Node`] handles
//! make progress only then. An owner that drops the future of a caller thus knows that nothing of it is sent any more
//! beyond the one request that is on the bus already.

mod duplicates;
mod error;
mod event;
mod lane;
mod load;
mod node;
mod orders;
mod pace;
mod scan;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::time::{Instant, sleep_until};

use crate::bus::{self, CanBus};
use crate::canopen::emcy::Emergency;
use crate::canopen::{heartbeat, nmt, pdo, sdo, sync};
use crate::frame::error::Report;
use crate::frame::{Frame, Stamped};
use crate::objects;

pub use self::error::Error;
pub use self::event::{Event, Evidence, Sign};
pub use self::load::{Load, worst_case_bits};
pub use self::node::{Node, Nodes};
pub use self::scan::{Found, Identity};

use self::duplicates::Duplicates;
use self::lane::{Lane, LaneStep, Sdo};
use self::orders::{Order, Orders};
use self::pace::Pace;

/// How many requests wait to be taken over by the network.
const REQUEST_QUEUE_LEN: usize = 64;
/// How many requests wait for one node.
const LANE_LEN: usize = 64;
/// Two nodes of one number are told again after this much bus time.
const DUPLICATE_PAUSE: Duration = Duration::from_secs(1);

/// What the network does by itself, and how long it waits.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Options {
    /// How long each SDO answer is waited for. An answer is a matter of wire and firmware and not of motion: this is real
    /// time, also where the bus carries the time of a simulated cell.
    pub sdo_timeout: Duration,
    /// Node id and period of the own heartbeat, by the time of the bus or by real time, whichever comes first.
    pub heartbeat: Option<(u8, Duration)>,
    /// Period of SYNC, likewise.
    pub sync: Option<Duration>,
    /// The period that the nodes' heartbeats are set to: with it two nodes of one number are told.
    pub node_heartbeat: Option<Duration>,
    /// Of the bus, bits a second: what its load is measured against.
    pub bit_rate: u32,
}

/// The network; see the module.
pub struct Network {
    bus: Box<dyn CanBus>,
    requests: mpsc::Receiver<Request>,
    lanes: BTreeMap<u8, Lane>,
    orders: Orders,
    options: Options,
    heartbeat: Option<(u8, Pace)>,
    sync: Option<Pace>,
    duplicates: Option<Duplicates>,
    duplicates_told: BTreeMap<u8, Duration>,
    signs_told: BTreeSet<Sign>,
    events: VecDeque<Event>,
    load: Load,
    now: Duration,
    heard_at: Instant,
}

/// A value and when it was read, on the clock of the bus.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Reading<T> {
    /// The value.
    pub value: T,
    /// When the answer was on the bus.
    pub stamp: Duration,
}

/// Whether a request waits for those before it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Priority {
    /// After those before it.
    Normal,
    /// Before everything that is not on the bus yet: for quick stop.
    Urgent,
}

#[derive(Debug)]
enum Request {
    Sdo(u8, Priority, Box<Sdo>),
    Nmt(nmt::Command, nmt::Target),
    /// An NMT command whose end is waited for.
    Order(nmt::Command, Order),
    Frame(Frame),
}

// === impl Options ===

impl Default for Options {
    /// 1 s for an answer, nothing sent by itself, 1 Mbit/s.
    fn default() -> Self {
        Self {
            sdo_timeout: Duration::from_secs(1),
            heartbeat: None,
            sync: None,
            node_heartbeat: None,
            bit_rate: 1_000_000,
        }
    }
}

// === impl Network ===

impl Network {
    /// The network on a bus, and the way to its nodes.
    pub fn new(bus: Box<dyn CanBus>, options: Options) -> (Self, Nodes) {
        let (sender, requests) = mpsc::channel(REQUEST_QUEUE_LEN);
        let network = Self {
            bus,
            requests,
            lanes: BTreeMap::new(),
            orders: Orders::default(),
            options,
            heartbeat: options
                .heartbeat
                .map(|(node_id, period)| (node_id, Pace::new(period))),
            sync: options.sync.map(Pace::new),
            duplicates: options.node_heartbeat.map(Duplicates::new),
            duplicates_told: BTreeMap::new(),
            signs_told: BTreeSet::new(),
            events: VecDeque::new(),
            load: Load::new(options.bit_rate),
            now: Duration::ZERO,
            heard_at: Instant::now(),
        };
        (network, Nodes::new(sender))
    }

    /// The stamp of the newest frame.
    pub fn now(&self) -> Duration {
        self.now
    }

    /// When the newest frame came, in real time; at first when the network was made.
    pub fn heard_at(&self) -> Instant {
        self.heard_at
    }

    /// How busy the bus is.
    pub fn load(&self) -> &Load {
        &self.load
    }

    /// Serves the nodes' handles until something is reported. An error is final. Nothing is lost when the future is
    /// dropped.
    pub async fn next_event(&mut self) -> Result<Event, bus::Error> {
        loop {
            // Also where frames come without pause, own frames and time-outs have their turn.
            self.on_time(Instant::now())?;
            if let Some(event) = self.events.pop_front() {
                return Ok(event);
            }
            let deadline = self.deadline();
            tokio::select! {
                biased;
                Some(request) = self.requests.recv() => self.on_request(request)?,
                received = self.bus.receive() => self.on_frame(received?)?,
                () = sleep_until(deadline.unwrap_or_else(Instant::now)), if deadline.is_some() => {}
            }
        }
    }

    /// When something is due by real time.
    fn deadline(&self) -> Option<Instant> {
        let lanes = self.lanes.values().filter_map(Lane::deadline);
        let heartbeat = self
            .heartbeat
            .as_ref()
            .and_then(|(_, pace)| pace.deadline());
        let sync = self.sync.as_ref().and_then(Pace::deadline);
        lanes
            .chain(self.orders.deadline())
            .chain(heartbeat)
            .chain(sync)
            .min()
    }

    fn send(&mut self, frame: Frame) -> Result<(), bus::Error> {
        self.bus.send(frame)?;
        self.load.on_sent(&frame, self.now);
        Ok(())
    }

    fn on_time(&mut self, now: Instant) -> Result<(), bus::Error> {
        if let Some((node_id, pace)) = &mut self.heartbeat
            && pace.is_due(self.now, now)
        {
            let frame = heartbeat::encode(*node_id, nmt::State::Operational);
            self.send(frame)?;
        }
        if let Some(pace) = &mut self.sync
            && pace.is_due(self.now, now)
        {
            self.send(sync::encode())?;
        }
        self.orders.on_time(now);
        let due: Vec<u8> = self
            .lanes
            .iter()
            .filter(|(_, lane)| lane.deadline().is_some_and(|deadline| deadline <= now))
            .map(|(node_id, _)| *node_id)
            .collect();
        for node_id in due {
            self.in_lane(node_id, |lane| lane.on_time(now))?;
        }
        Ok(())
    }

    fn on_request(&mut self, request: Request) -> Result<(), bus::Error> {
        match request {
            Request::Frame(frame) => self.send(frame),
            Request::Nmt(command, target) => self.command(command, target),
            Request::Order(command, order) => {
                self.command(command, nmt::Target::Node(order.node_id))?;
                self.orders.begin(order);
                Ok(())
            }
            Request::Sdo(node_id, priority, sdo) => {
                if sdo.address == objects::PRODUCER_HEARTBEAT.address {
                    self.expect_heartbeats_anew(nmt::Target::Node(node_id));
                }
                self.in_lane(node_id, |lane| lane.on_request(priority, *sdo))
            }
        }
    }

    fn command(&mut self, command: nmt::Command, target: nmt::Target) -> Result<(), bus::Error> {
        self.expect_heartbeats_anew(target);
        self.send(nmt::encode(command, target))
    }

    fn expect_heartbeats_anew(&mut self, target: nmt::Target) {
        if let Some(duplicates) = &mut self.duplicates {
            match target {
                nmt::Target::All => duplicates.forget_all(),
                nmt::Target::Node(node_id) => duplicates.forget(node_id),
            }
        }
    }

    fn on_frame(&mut self, Stamped { frame, stamp }: Stamped) -> Result<(), bus::Error> {
        self.now = stamp;
        self.heard_at = Instant::now();
        self.load.on_received(&frame, stamp);
        if let Some(report) = Report::decode(&frame) {
            self.events.push_back(Event::BusError { report });
            return Ok(());
        }
        if let Some((node_id, state)) = heartbeat::decode(&frame) {
            return self.on_heartbeat(node_id, state, stamp);
        }
        if let Some((node_id, emergency)) = Emergency::decode(&frame) {
            let event = Event::Emergency { node_id, emergency };
            self.events.push_back(event);
            return Ok(());
        }
        if let Some((node_id, number, data)) = pdo::decode(&frame) {
            self.events.push_back(Event::Pdo {
                node_id,
                number,
                data,
                stamp,
            });
            return Ok(());
        }
        if nmt::decode(&frame).is_some() {
            self.tell_other_master(Sign::NmtCommand);
        }
        let Some(cob_id) = frame.cob_id() else {
            return Ok(());
        };
        let Ok(bytes) = <[u8; 8]>::try_from(frame.data()) else {
            return Ok(());
        };
        if let Some(node_id) = sdo::responding_node(cob_id) {
            return self.in_lane(node_id, |lane| lane.on_response(bytes, stamp));
        }
        if let Some(node_id) = sdo::requested_node(cob_id) {
            self.tell_other_master(Sign::SdoRequest);
            return self.in_lane(node_id, |lane| lane.on_foreign_request(bytes));
        }
        Ok(())
    }

    fn on_heartbeat(
        &mut self,
        node_id: u8,
        state: nmt::State,
        stamp: Duration,
    ) -> Result<(), bus::Error> {
        if self
            .heartbeat
            .as_ref()
            .is_some_and(|(own, _)| *own == node_id)
        {
            self.tell_other_master(Sign::Heartbeat);
        }
        self.events.push_back(Event::Heartbeat {
            node_id,
            state,
            stamp,
        });
        self.orders.on_heartbeat(node_id, state, stamp);
        if let Some(duplicates) = &mut self.duplicates
            && duplicates.on_heartbeat(node_id, state, stamp)
        {
            self.tell_duplicate(node_id, Evidence::Heartbeats);
        }
        if state == nmt::State::BootUp && self.lanes.contains_key(&node_id) {
            return self.in_lane(node_id, Lane::on_restart);
        }
        Ok(())
    }

    /// Lets a node's lane act and sends what it has to send.
    fn in_lane(
        &mut self,
        node_id: u8,
        act: impl FnOnce(&mut Lane) -> LaneStep,
    ) -> Result<(), bus::Error> {
        let options = self.options;
        let lane = self
            .lanes
            .entry(node_id)
            .or_insert_with(|| Lane::new(node_id, options.sdo_timeout, options.bit_rate));
        let LaneStep {
            frames,
            second_answer,
        } = act(lane);
        for frame in frames {
            self.send(frame)?;
        }
        if second_answer {
            self.tell_duplicate(node_id, Evidence::SecondAnswer);
        }
        Ok(())
    }

    fn tell_duplicate(&mut self, node_id: u8, evidence: Evidence) {
        let told = self.duplicates_told.get(&node_id);
        if told.is_some_and(|told| self.now.abs_diff(*told) < DUPLICATE_PAUSE) {
            return;
        }
        self.duplicates_told.insert(node_id, self.now);
        self.events
            .push_back(Event::DuplicateNode { node_id, evidence });
    }

    fn tell_other_master(&mut self, sign: Sign) {
        if self.signs_told.insert(sign) {
            self.events.push_back(Event::OtherMaster { sign });
        }
    }
}

#[cfg(test)]
mod tests;
