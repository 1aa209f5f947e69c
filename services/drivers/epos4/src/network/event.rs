//! What nodes and bus report by themselves.

use std::time::Duration;

use crate::canopen::emcy::Emergency;
use crate::canopen::{nmt, pdo};
use crate::frame::error::Report;

/// A report. Stamps are the time of the bus.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Event {
    /// A node lives.
    Heartbeat {
        /// Which node.
        node_id: u8,
        /// Its state.
        state: nmt::State,
        /// When.
        stamp: Duration,
    },
    /// An error of a node appeared or went.
    Emergency {
        /// Which node.
        node_id: u8,
        /// What it says.
        emergency: Emergency,
    },
    /// Process data of a node.
    Pdo {
        /// Which node.
        node_id: u8,
        /// Which of its TPDOs, 1 to 4.
        number: u8,
        /// Its bytes; [`pdo::Mapping::value`] reads them.
        data: pdo::Data,
        /// When.
        stamp: Duration,
    },
    /// The controller reports an error of the bus.
    BusError {
        /// What it says.
        report: Report,
    },
    /// More than one node has this number.
    DuplicateNode {
        /// Which number.
        node_id: u8,
        /// What gave it away.
        evidence: Evidence,
    },
    /// Somebody else commands nodes of this bus. Told once for each sign.
    OtherMaster {
        /// What gave it away.
        sign: Sign,
    },
}

/// What gives two nodes of one number away.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Evidence {
    /// Heartbeats come about twice as often as one node sends them.
    Heartbeats,
    /// A second answer came to one request.
    SecondAnswer,
}

/// What gives another master away.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Sign {
    /// An SDO request that is not ours.
    SdoRequest,
    /// An NMT command that is not ours.
    NmtCommand,
    /// A heartbeat under our own node id.
    Heartbeat,
}
