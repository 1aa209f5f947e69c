//! A bad network between an RTDE client and its controller: a proxy that passes frames on until it is told to lose,
//! hold, spoil, swap or repeat them, or to break the connection.

use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio::task::{JoinHandle, JoinSet};

/// Most bytes taken in one read.
const READ_BYTES: usize = 16 * 1024;

/// Which way a fault strikes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// States on their way to the client.
    ToClient,
    /// Commands on their way to the controller.
    ToController,
}

/// What the network does wrong from now on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// Nothing.
    None,
    /// So many data frames get lost.
    Drop(Way, usize),
    /// Nothing passes; it all comes at once when the fault is over.
    Stall(Way),
    /// Both ends see the connection reset, and new ones too.
    Reset,
    /// Both ends see the connection closed, and new ones too.
    Close,
    /// Connections stay open and are made, and nothing passes; when the fault is over they are reset.
    HalfOpen,
    /// One byte of so many data frames is another.
    Corrupt(Way, usize),
    /// So many pairs of data frames come in the wrong order.
    Reorder(Way, usize),
    /// So many data frames come twice.
    Duplicate(Way, usize),
    /// Half a data frame, then the connection is reset.
    Truncate(Way),
}

/// A running proxy; dropping it ends all connections.
#[derive(Debug)]
pub struct Proxy {
    address: SocketAddr,
    fault: watch::Sender<Fault>,
    task: JoinHandle<()>,
}

impl Proxy {
    /// Before this controller, on a free port. `seed` decides which bytes are spoilt.
    pub async fn before(controller: SocketAddr, seed: u64) -> io::Result<Self> {
        let listener = TcpListener::bind(("127.0.0.1", 0)).await?;
        let address = listener.local_addr()?;
        let (fault, faults) = watch::channel(Fault::None);
        let task = tokio::spawn(async move {
            let mut connections = JoinSet::new();
            for number in seed.. {
                let Ok((client, _)) = listener.accept().await else {
                    return;
                };
                let rng = ChaCha8Rng::seed_from_u64(number);
                connections.spawn(carry(client, controller, faults.clone(), rng));
                while connections.try_join_next().is_some() {}
            }
        });
        Ok(Self {
            address,
            fault,
            task,
        })
    }

    /// Where clients connect.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// From now on, until the next one.
    pub fn strike(&self, fault: Fault) {
        self.fault.send_replace(fault);
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// One direction of a connection.
#[derive(Default)]
struct Lane {
    inbox: Vec<u8>,
    /// Whole frames that wait for the end of a stall, or for the frame that overtakes them.
    held: Vec<u8>,
    /// Frames that the present fault still strikes.
    left: usize,
}

/// What is to be done with a connection after a frame.
enum After {
    GoOn,
    Reset,
}

async fn carry(
    client: TcpStream,
    controller: SocketAddr,
    mut faults: watch::Receiver<Fault>,
    mut rng: ChaCha8Rng,
) -> io::Result<()> {
    let mut fault = *faults.borrow_and_update();
    match fault {
        Fault::Reset => return reset(&client),
        Fault::Close => return Ok(()),
        Fault::HalfOpen => {
            faults.changed().await.ok();
            return reset(&client);
        }
        _ => {}
    }
    let server = TcpStream::connect(controller).await?;
    client.set_nodelay(true)?;
    server.set_nodelay(true)?;
    let mut lanes = [Lane::default(), Lane::default()];
    loop {
        let stalled = |way| fault == Fault::HalfOpen || fault == Fault::Stall(way);
        tokio::select! {
            changed = faults.changed() => {
                let before = fault;
                fault = *faults.borrow_and_update();
                if changed.is_err() || before == Fault::HalfOpen || fault == Fault::Reset {
                    reset(&client)?;
                    return reset(&server);
                }
                if fault == Fault::Close {
                    return Ok(());
                }
                for (lane, (way, to)) in
                    lanes.iter_mut().zip([(Way::ToClient, &client), (Way::ToController, &server)])
                {
                    lane.left = fault.frames(way);
                    let held = std::mem::take(&mut lane.held);
                    write(to, &held).await?;
                }
            }
            ready = server.readable(), if !stalled(Way::ToClient) => {
                ready?;
                if let After::Reset =
                    lanes[0].pass(&server, &client, fault, &mut rng).await?
                {
                    reset(&client)?;
                    return reset(&server);
                }
            }
            ready = client.readable(), if !stalled(Way::ToController) => {
                ready?;
                if let After::Reset =
                    lanes[1].pass(&client, &server, fault, &mut rng).await?
                {
                    reset(&client)?;
                    return reset(&server);
                }
            }
        }
    }
}

impl Fault {
    /// Frames that it strikes on this way.
    fn frames(self, on: Way) -> usize {
        match self {
            Self::Drop(way, frames)
            | Self::Corrupt(way, frames)
            | Self::Reorder(way, frames)
            | Self::Duplicate(way, frames)
                if way == on =>
            {
                frames
            }
            Self::Truncate(way) if way == on => 1,
            _ => 0,
        }
    }
}

impl Lane {
    /// Reads what is there and passes it on, as the fault has it.
    async fn pass(
        &mut self,
        from: &TcpStream,
        to: &TcpStream,
        fault: Fault,
        rng: &mut ChaCha8Rng,
    ) -> io::Result<After> {
        let mut bytes = vec![0; READ_BYTES];
        match from.try_read(&mut bytes) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(read) => self.inbox.extend_from_slice(&bytes[..read]),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(After::GoOn),
            Err(error) => return Err(error),
        }
        let mut out = Vec::new();
        let mut after = After::GoOn;
        while let Some(mut frame) = self.take_frame() {
            if frame[2] != b'U' || self.left == 0 {
                out.append(&mut frame);
                out.append(&mut self.held);
                continue;
            }
            match fault {
                Fault::Drop(..) => self.left -= 1,
                Fault::Corrupt(..) => {
                    self.left -= 1;
                    let at = rng.random_range(0..frame.len());
                    frame[at] ^= rng.random_range(1..=255_u8);
                    out.append(&mut frame);
                }
                Fault::Duplicate(..) => {
                    self.left -= 1;
                    out.extend_from_slice(&frame);
                    out.append(&mut frame);
                }
                Fault::Reorder(..) if self.held.is_empty() => self.held = frame,
                Fault::Reorder(..) => {
                    self.left -= 1;
                    out.append(&mut frame);
                    out.append(&mut self.held);
                }
                Fault::Truncate(..) => {
                    out.extend_from_slice(&frame[..frame.len() / 2]);
                    after = After::Reset;
                    break;
                }
                _ => out.append(&mut frame),
            }
        }
        write(to, &out).await?;
        Ok(after)
    }

    fn take_frame(&mut self) -> Option<Vec<u8>> {
        let size = usize::from(u16::from_be_bytes([
            *self.inbox.first()?,
            *self.inbox.get(1)?,
        ]));
        if self.inbox.len() < size.max(3) {
            return None;
        }
        Some(self.inbox.drain(..size.max(3)).collect())
    }
}

async fn write(to: &TcpStream, mut bytes: &[u8]) -> io::Result<()> {
    while !bytes.is_empty() {
        to.writable().await?;
        match to.try_write(bytes) {
            Ok(written) => bytes = &bytes[written..],
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// The other end sees a reset once the stream is dropped.
fn reset(stream: &TcpStream) -> io::Result<()> {
    #[expect(deprecated, reason = "a linger of zero does not block")]
    stream.set_linger(Some(Duration::ZERO))
}
