//! Serves a [`Bus`] by linux-can's `socketcand` protocol in raw mode to many clients at once.
//!
//! Frames carry the cell's time as their stamp. Clients compare a whole segment with `< ok >`, so each answer of the
//! handshake goes out alone and frames are held back for a moment after the last one.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use epos4_link::bus::socketcand::text::{ParseError, Reply, Request, Splitter};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};

use super::bus::{Bus, Member};

/// A running server. Ends with all its connections when dropped.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    connections: tokio::task::AbortHandle,
}

/// Real masters on one bus are few.
const CLIENTS_MAX: usize = 64;
/// How long frames are held back after the answer to `< rawmode >`, wall clock: the client must have read that answer.
const HOLD_BACK: Duration = Duration::from_millis(50);
/// A client that takes nothing for this long is dropped, wall clock.
const WRITE_TIMEOUT: Duration = Duration::from_secs(5);
/// A client that does not finish its handshake in this time is dropped, wall clock.
const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(10);
/// Frames are joined to one write up to this size.
const WRITE_BYTES: usize = 8192;
/// Answers to a client that it has not read.
const REPLIES_MAX: usize = 16;

/// Listens at `bind` and serves the bus.
pub async fn serve(bind: SocketAddr, bus: Arc<Bus>) -> io::Result<Server> {
    let listener = TcpListener::bind(bind).await?;
    let address = listener.local_addr()?;
    let connections = tokio::spawn(accept(listener, bus)).abort_handle();
    Ok(Server {
        address,
        connections,
    })
}

impl Server {
    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.connections.abort();
    }
}

async fn accept(listener: TcpListener, bus: Arc<Bus>) {
    let mut clients = JoinSet::new();
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            Some(_) = clients.join_next() => continue,
        };
        match accepted {
            Ok((_, peer)) if clients.len() >= CLIENTS_MAX => {
                tracing::warn!(%peer, clients = CLIENTS_MAX, "too many can clients, connection refused");
            }
            Ok((stream, peer)) => {
                let bus = Arc::clone(&bus);
                clients.spawn(async move {
                    match serve_client(stream, &bus).await {
                        Ok(()) => tracing::debug!(%peer, "can client left"),
                        Err(error) => tracing::info!(%peer, %error, "can client dropped"),
                    }
                });
            }
            Err(error) => {
                tracing::warn!(%error, "cannot accept a can client");
                sleep(HOLD_BACK).await;
            }
        }
    }
}

async fn serve_client(stream: TcpStream, bus: &Arc<Bus>) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let (read, write) = stream.into_split();
    let mut client = Client {
        read,
        splitter: Splitter::default(),
        write,
    };
    let early = timeout(HANDSHAKE_TIMEOUT, client.handshake())
        .await
        .map_err(io::Error::from)??;
    let Some(early) = early else { return Ok(()) };
    let member = bus.join();
    client
        .write
        .write_all(Reply::Ok.to_string().as_bytes())
        .await?;
    client.raw_mode(member, early).await
}

struct Client {
    read: OwnedReadHalf,
    splitter: Splitter,
    write: OwnedWriteHalf,
}

impl Client {
    /// Until `< rawmode >`, whose answer is left to the caller. What came in the same segment after it is returned;
    /// none if the client left.
    async fn handshake(&mut self) -> io::Result<Option<Vec<String>>> {
        self.answer(&Reply::Hi).await?;
        let mut open = false;
        let mut buffer = [0; 1024];
        loop {
            let len = self.read.read(&mut buffer).await?;
            if len == 0 {
                return Ok(None);
            }
            let mut messages = self
                .splitter
                .push(&buffer[..len])
                .map_err(broken)?
                .into_iter();
            while let Some(message) = messages.next() {
                match Request::parse(&message) {
                    Ok(Request::Open(_)) => {
                        open = true;
                        self.answer(&Reply::Ok).await?;
                    }
                    Ok(Request::RawMode) if open => return Ok(Some(messages.collect())),
                    Ok(Request::Echo) => self.answer(&Reply::Echo).await?,
                    Ok(Request::RawMode | Request::Send(_)) => {
                        self.answer(&refusal("no bus in raw mode")).await?
                    }
                    Err(error) => self.answer(&refused(&error)).await?,
                }
            }
        }
    }

    async fn answer(&mut self, reply: &Reply) -> io::Result<()> {
        self.write.write_all(reply.to_string().as_bytes()).await
    }

    /// Both directions until one ends.
    async fn raw_mode(self, member: Member, early: Vec<String>) -> io::Result<()> {
        let (replies, unsent) = mpsc::channel(REPLIES_MAX);
        let Self {
            read,
            splitter,
            write,
        } = self;
        let sender = member.sender();
        tokio::select! {
            ended = hear_client(read, splitter, early, &sender, replies) => ended,
            ended = tell_client(write, member, unsent) => ended,
        }
    }
}

/// Puts the client's frames on the bus.
async fn hear_client(
    mut read: OwnedReadHalf,
    mut splitter: Splitter,
    early: Vec<String>,
    sender: &super::bus::Sender,
    replies: mpsc::Sender<Reply>,
) -> io::Result<()> {
    let mut messages = early;
    let mut buffer = [0; 4096];
    loop {
        for message in messages {
            let reply = match Request::parse(&message) {
                Ok(Request::Send(frame)) => {
                    sender.send(&frame);
                    continue;
                }
                Ok(Request::Echo) => Reply::Echo,
                Ok(Request::Open(_) | Request::RawMode) => Reply::Ok,
                Err(error) => refused(&error),
            };
            if replies.send(reply).await.is_err() {
                return Ok(());
            }
        }
        let len = read.read(&mut buffer).await?;
        if len == 0 {
            return Ok(());
        }
        messages = splitter.push(&buffer[..len]).map_err(broken)?;
    }
}

/// Writes what is on the bus to the client.
async fn tell_client(
    mut write: OwnedWriteHalf,
    mut member: Member,
    mut replies: mpsc::Receiver<Reply>,
) -> io::Result<()> {
    sleep(HOLD_BACK).await;
    loop {
        let mut text = tokio::select! {
            frame = member.heard() => match frame {
                Some(frame) => Reply::Frame(frame).to_string(),
                None => return Err(io::Error::other("too slow to read the bus")),
            },
            Some(reply) = replies.recv() => reply.to_string(),
        };
        while text.len() < WRITE_BYTES
            && let Some(frame) = member.try_heard()
        {
            text.push_str(&Reply::Frame(frame).to_string());
        }
        timeout(WRITE_TIMEOUT, write.write_all(text.as_bytes()))
            .await
            .map_err(io::Error::from)??;
    }
}

fn refused(error: &ParseError) -> Reply {
    match error {
        ParseError::UnknownCommand(_) => refusal("unknown command"),
        ParseError::Malformed { part, .. } => refusal(part),
        ParseError::TooLong => refusal("message too long"),
    }
}

fn refusal(words: &str) -> Reply {
    Reply::Error(words.to_owned())
}

fn broken(error: ParseError) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, error)
}

#[cfg(test)]
mod tests;
