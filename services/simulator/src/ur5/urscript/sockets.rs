//! Sockets of a program. The network is an argument: an arm that is not on one reaches nobody.

use std::{collections::BTreeMap, fmt, sync::Arc};

/// Sockets that one program may hold at once.
const MAX_SOCKETS: usize = 16;
/// Bytes received and not read yet, per socket; more waits with its sender.
const MAX_RECEIVED: usize = 64 * 1024;

/// Opens connections.
pub trait Network: fmt::Debug + Send + Sync {
    /// Begins to connect; never waits.
    ///
    /// # Errors
    /// An address that is none, or that programs may not reach.
    fn connect(&self, host: &str, port: u16) -> Result<Box<dyn Connection>, String>;
}

/// A connection of a program. None of its methods waits.
pub trait Connection: fmt::Debug + Send {
    /// How it is.
    fn state(&mut self) -> State;
    /// Appends at most so many bytes that have arrived.
    fn receive(&mut self, into: &mut Vec<u8>, at_most: usize);
    /// Sends all of it. False when the connection is gone or the other side does not take it.
    fn send(&mut self, bytes: &[u8]) -> bool;
}

/// State of a [`Connection`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Not open yet.
    Connecting,
    /// Open, until the other side closes and all its bytes are received.
    Open,
    /// Refused, closed or broken.
    Closed,
}

/// No network.
#[derive(Clone, Copy, Debug)]
pub struct Isolated;

impl Network for Isolated {
    fn connect(&self, _: &str, _: u16) -> Result<Box<dyn Connection>, String> {
        Err("this controller is on no network".to_owned())
    }
}

/// What a program has opened, by name.
#[derive(Debug)]
pub struct Sockets {
    network: Arc<dyn Network>,
    open: BTreeMap<Arc<str>, Socket>,
}

/// One of them.
#[derive(Debug)]
pub struct Socket {
    connection: Box<dyn Connection>,
    received: Vec<u8>,
}

impl Sockets {
    /// None yet.
    pub fn new(network: Arc<dyn Network>) -> Self {
        Self {
            network,
            open: BTreeMap::new(),
        }
    }

    /// Begins to open a socket; one of this name is closed.
    ///
    /// # Errors
    /// Too many sockets, or an address that cannot be reached.
    pub fn open(&mut self, name: &str, host: &str, port: u16) -> Result<(), String> {
        self.open.remove(name);
        if self.open.len() >= MAX_SOCKETS {
            return Err(format!("more than {MAX_SOCKETS} sockets"));
        }
        let socket = Socket {
            connection: self.network.connect(host, port)?,
            received: Vec::new(),
        };
        self.open.insert(Arc::from(name), socket);
        Ok(())
    }

    /// Closes one, if it is there.
    pub fn close(&mut self, name: &str) {
        self.open.remove(name);
    }

    /// The socket of this name with all that has arrived for it.
    pub fn get(&mut self, name: &str) -> Option<&mut Socket> {
        let socket = self.open.get_mut(name)?;
        let room = MAX_RECEIVED.saturating_sub(socket.received.len());
        socket.connection.receive(&mut socket.received, room);
        Some(socket)
    }
}

impl Socket {
    /// How its connection is.
    pub fn state(&mut self) -> State {
        self.connection.state()
    }

    /// Nothing more can arrive.
    pub fn is_exhausted(&mut self) -> bool {
        self.received.len() >= MAX_RECEIVED || self.state() == State::Closed
    }

    /// What has arrived and is not taken yet.
    pub fn received(&self) -> &[u8] {
        &self.received
    }

    /// Takes the first bytes of what has arrived.
    pub fn take(&mut self, bytes: usize) -> Vec<u8> {
        let rest = self.received.split_off(bytes.min(self.received.len()));
        std::mem::replace(&mut self.received, rest)
    }

    /// Sends all of it.
    pub fn send(&mut self, bytes: &[u8]) -> bool {
        self.state() == State::Open && self.connection.send(bytes)
    }
}
