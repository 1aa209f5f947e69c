//! Network management: the master's commands and the states of a node (CiA 301, 7.2.8).

use std::fmt;

use crate::frame::Frame;

/// COB-ID of the commands.
pub const COB_ID: u16 = 0x000;

/// What the master orders one node, or all of them.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Command {
    /// To OPERATIONAL.
    Start,
    /// To STOPPED.
    Stop,
    /// To PRE-OPERATIONAL.
    EnterPreOperational,
    /// Like a power cycle.
    ResetNode,
    /// Restarts the communication alone.
    ResetCommunication,
}

impl Command {
    /// What the node tells when it has obeyed.
    pub const fn outcome(self) -> State {
        match self {
            Self::Start => State::Operational,
            Self::Stop => State::Stopped,
            Self::EnterPreOperational => State::PreOperational,
            Self::ResetNode | Self::ResetCommunication => State::BootUp,
        }
    }
}

/// Whom a command is for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Target {
    /// Every node of the bus.
    All,
    /// One node, 1 to 127.
    Node(u8),
}

impl Target {
    /// Whether this node is meant.
    pub fn includes(self, node_id: u8) -> bool {
        match self {
            Self::All => true,
            Self::Node(id) => id == node_id,
        }
    }
}

/// The frame of a command.
pub const fn encode(command: Command, target: Target) -> Frame {
    let specifier = match command {
        Command::Start => 0x01,
        Command::Stop => 0x02,
        Command::EnterPreOperational => 0x80,
        Command::ResetNode => 0x81,
        Command::ResetCommunication => 0x82,
    };
    let node_id = match target {
        Target::All => 0,
        Target::Node(id) => id,
    };
    Frame::standard(COB_ID, [specifier, node_id])
}

/// The command in a frame; `None` when it is none.
pub fn decode(frame: &Frame) -> Option<(Command, Target)> {
    if frame.cob_id() != Some(COB_ID) {
        return None;
    }
    let &[specifier, node_id] = frame.data() else {
        return None;
    };
    let command = match specifier {
        0x01 => Command::Start,
        0x02 => Command::Stop,
        0x80 => Command::EnterPreOperational,
        0x81 => Command::ResetNode,
        0x82 => Command::ResetCommunication,
        _ => return None,
    };
    Some((
        command,
        if node_id == 0 {
            Target::All
        } else {
            Target::Node(node_id)
        },
    ))
}

/// The state of a node, as its heartbeat says.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum State {
    /// The node has just started.
    BootUp,
    /// Nothing but NMT and heartbeat.
    Stopped,
    /// All services.
    Operational,
    /// No process data.
    PreOperational,
}

impl State {
    /// The state's code in a heartbeat.
    pub const fn code(self) -> u8 {
        match self {
            Self::BootUp => 0x00,
            Self::Stopped => 0x04,
            Self::Operational => 0x05,
            Self::PreOperational => 0x7F,
        }
    }

    /// From the code in a heartbeat; bit 7 belongs to node guarding and is ignored.
    pub const fn from_code(code: u8) -> Option<Self> {
        match code & 0x7F {
            0x00 => Some(Self::BootUp),
            0x04 => Some(Self::Stopped),
            0x05 => Some(Self::Operational),
            0x7F => Some(Self::PreOperational),
            _ => None,
        }
    }
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::BootUp => "BOOT_UP",
            Self::Stopped => "STOPPED",
            Self::Operational => "OPERATIONAL",
            Self::PreOperational => "PRE_OPERATIONAL",
        })
    }
}
