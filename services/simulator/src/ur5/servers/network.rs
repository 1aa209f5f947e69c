//! Sockets that programs open, over TCP. Connecting happens on a thread of its own, so that a host that does not answer
//! does not hold up the controller.

use std::{
    io::{ErrorKind, Read, Write},
    net::{IpAddr, Ipv4Addr, SocketAddr, TcpStream},
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
        mpsc,
    },
    time::Duration,
};

use crate::ur5::{
    config::ScriptNetwork,
    urscript::{Connection, Network, State},
};

/// Connections being opened at once.
const MAX_CONNECTING: usize = 16;
/// The program has given up by then.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(3);

/// The network of the machine, as far as programs may use it.
#[derive(Debug)]
pub(super) struct Tcp {
    reach: ScriptNetwork,
    connecting: Arc<AtomicUsize>,
}

impl Tcp {
    pub(super) fn new(reach: ScriptNetwork) -> Self {
        Self {
            reach,
            connecting: Arc::new(AtomicUsize::new(0)),
        }
    }

    /// Programs name IP addresses; of names only that of this machine is known.
    fn address(&self, host: &str) -> Result<IpAddr, String> {
        let address = if host == "localhost" {
            IpAddr::V4(Ipv4Addr::LOCALHOST)
        } else {
            host.parse()
                .map_err(|_| format!("{host:?} is no IP address"))?
        };
        match self.reach {
            ScriptNetwork::Any => Ok(address),
            ScriptNetwork::Loopback if address.is_loopback() => Ok(address),
            ScriptNetwork::Loopback => Err(format!("{address} is not on this machine")),
            ScriptNetwork::None => Err("this controller is on no network".to_owned()),
        }
    }
}

impl Network for Tcp {
    fn connect(&self, host: &str, port: u16) -> Result<Box<dyn Connection>, String> {
        let address = SocketAddr::new(self.address(host)?, port);
        if self.connecting.fetch_add(1, Ordering::Relaxed) >= MAX_CONNECTING {
            self.connecting.fetch_sub(1, Ordering::Relaxed);
            return Err(format!(
                "more than {MAX_CONNECTING} connections being opened"
            ));
        }
        let (sender, receiver) = mpsc::channel();
        let connecting = self.connecting.clone();
        std::thread::spawn(move || {
            let opened = TcpStream::connect_timeout(&address, CONNECT_TIMEOUT).and_then(|stream| {
                stream.set_nodelay(true)?;
                stream.set_nonblocking(true)?;
                Ok(stream)
            });
            connecting.fetch_sub(1, Ordering::Relaxed);
            // The program may have closed the socket by now.
            let _ = sender.send(opened.ok());
        });
        Ok(Box::new(Link::Connecting(receiver)))
    }
}

#[derive(Debug)]
enum Link {
    Connecting(mpsc::Receiver<Option<TcpStream>>),
    Open(TcpStream),
    Closed,
}

impl Link {
    fn settle(&mut self) {
        if let Self::Connecting(receiver) = self {
            match receiver.try_recv() {
                Ok(Some(stream)) => *self = Self::Open(stream),
                Ok(None) | Err(mpsc::TryRecvError::Disconnected) => *self = Self::Closed,
                Err(mpsc::TryRecvError::Empty) => {}
            }
        }
    }
}

impl Connection for Link {
    fn state(&mut self) -> State {
        self.settle();
        match self {
            Self::Connecting(_) => State::Connecting,
            Self::Open(_) => State::Open,
            Self::Closed => State::Closed,
        }
    }

    fn receive(&mut self, into: &mut Vec<u8>, at_most: usize) {
        self.settle();
        let Self::Open(stream) = self else {
            return;
        };
        let mut buffer = [0; 4096];
        let mut room = at_most;
        while room > 0 {
            let wanted = room.min(buffer.len());
            match stream.read(&mut buffer[..wanted]) {
                Ok(0) => {
                    *self = Self::Closed;
                    return;
                }
                Ok(received) => {
                    into.extend_from_slice(&buffer[..received]);
                    room -= received;
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => {
                    *self = Self::Closed;
                    return;
                }
            }
        }
    }

    fn send(&mut self, bytes: &[u8]) -> bool {
        self.settle();
        let Self::Open(stream) = self else {
            return false;
        };
        // Half a message is worse than none: a peer that does not read loses the connection.
        let sent = stream.write_all(bytes).is_ok();
        if !sent {
            *self = Self::Closed;
        }
        sent
    }
}
