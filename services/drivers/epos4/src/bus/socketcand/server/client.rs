//! One client of the server: its handshake, then both directions in one task.

use std::future::poll_fn;
use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWriteExt, ReadBuf};
use tokio::net::TcpStream;
use tokio::time::{Instant, Sleep, sleep, timeout};

use super::super::outbox::Outbox;
use super::super::text::{self, ParseError, Reply, Request, Splitter};
use super::Buses;
use crate::bus::{self, CanBus};

/// How long frames are held back after the answer to `< rawmode >`, wall clock: the client must have read that answer.
pub(super) const HOLD_BACK: Duration = Duration::from_millis(50);
/// A client that takes nothing for this long is dropped, wall clock.
const WRITE_TIMEOUT: Duration = Duration::from_secs(2);
/// A client that does not finish its handshake in this time is dropped, wall clock.
const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(10);
/// Frames are joined to one write up to this size. Beyond it they wait in the queue of the bus.
const WRITE_BYTES: usize = 8192;

/// Until the client leaves.
pub(super) async fn serve(stream: TcpStream, buses: &impl Buses) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let mut handshake = Handshake {
        stream,
        requests: Splitter::default(),
    };
    let bus = timeout(HANDSHAKE_TIMEOUT, handshake.run(buses))
        .await
        .map_err(|_| io::Error::other("it did not finish the handshake"))??;
    let Some(bus) = bus else { return Ok(()) };
    let mut raw_mode = RawMode {
        stream: handshake.stream,
        requests: handshake.requests,
        bus,
        unsent: Outbox::default(),
        writing: Writing::HeldBack,
        timer: Box::pin(sleep(HOLD_BACK)),
    };
    poll_fn(|context| raw_mode.poll(context)).await
}

struct Handshake {
    stream: TcpStream,
    requests: Splitter,
}

impl Handshake {
    /// Until `< rawmode >` is answered; none if the client left.
    async fn run(&mut self, buses: &impl Buses) -> io::Result<Option<Box<dyn CanBus>>> {
        self.answer(Reply::Hi).await?;
        let mut opened = None;
        loop {
            while let Some(message) = self.requests.next_message().map_err(broken)? {
                let reply = match Request::parse(message) {
                    Ok(Request::Open(bus)) if buses.knows(&bus) => {
                        opened = Some(bus);
                        Reply::Ok
                    }
                    Ok(Request::Open(_)) => refusal("could not open bus"),
                    Ok(Request::RawMode) => match opened.as_deref().map(|bus| buses.attach(bus)) {
                        Some(Some(bus)) => {
                            // Attached before it is answered: who has read the answer misses nothing.
                            self.answer(Reply::Ok).await?;
                            return Ok(Some(bus));
                        }
                        Some(None) => refusal("could not open bus"),
                        None => refusal("no bus in raw mode"),
                    },
                    Ok(Request::Echo) => Reply::Echo,
                    Ok(Request::Send(_)) => refusal("no bus in raw mode"),
                    Err(error) => refused(&error),
                };
                self.answer(reply).await?;
            }
            let len = self.stream.read(self.requests.space()).await?;
            if len == 0 {
                return Ok(None);
            }
            self.requests.filled(len);
        }
    }

    async fn answer(&mut self, reply: Reply) -> io::Result<()> {
        self.stream.write_all(reply.to_string().as_bytes()).await
    }
}

struct RawMode {
    stream: TcpStream,
    requests: Splitter,
    bus: Box<dyn CanBus>,
    unsent: Outbox,
    writing: Writing,
    /// The end of [`Writing::HeldBack`] or [`Writing::Blocked`].
    timer: Pin<Box<Sleep>>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Writing {
    /// The client reads the end of the handshake.
    HeldBack,
    /// Whatever there is.
    Free,
    /// The client takes nothing. It is dropped when that lasts.
    Blocked,
}

impl RawMode {
    /// Does all that can be done now. Ready when the client is gone.
    fn poll(&mut self, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        loop {
            self.take_frames(context)?;
            // A client that does not read is not heard either: its answers would have no end.
            let full = self.unsent.len() >= WRITE_BYTES;
            // All requests that are there are answered by one write.
            if !full && self.take_request()? {
                continue;
            }
            self.write(context)?;
            match (full, self.unsent.len() >= WRITE_BYTES) {
                (true, false) => continue,
                (_, true) => return Poll::Pending,
                (false, false) => {}
            }
            let mut space = ReadBuf::new(self.requests.space());
            ready!(Pin::new(&mut self.stream).poll_read(context, &mut space))?;
            let len = space.filled().len();
            if len == 0 {
                return Poll::Ready(Ok(()));
            }
            self.requests.filled(len);
        }
    }

    /// Takes what is on the bus, up to one write.
    fn take_frames(&mut self, context: &mut Context<'_>) -> io::Result<()> {
        while self.unsent.len() < WRITE_BYTES
            && let Poll::Ready(received) = self.bus.poll_receive(context)
        {
            let stamped = received.map_err(io::Error::other)?;
            text::write_frame(&stamped, self.unsent.text());
        }
        Ok(())
    }

    /// Carries out one request; whether there was one.
    fn take_request(&mut self) -> io::Result<bool> {
        let Some(message) = self.requests.next_message().map_err(broken)? else {
            return Ok(false);
        };
        let reply = match Request::parse(message) {
            Ok(Request::Send(frame)) => match self.bus.send(frame) {
                Ok(()) => return Ok(true),
                Err(bus::Error::Closed(why)) => return Err(io::Error::other(why)),
                Err(error) => refusal(&error.to_string()),
            },
            Ok(Request::Echo) => Reply::Echo,
            Ok(Request::Open(_) | Request::RawMode) => Reply::Ok,
            Err(error) => refused(&error),
        };
        reply.write(self.unsent.text());
        Ok(true)
    }

    fn write(&mut self, context: &mut Context<'_>) -> io::Result<()> {
        if self.writing == Writing::HeldBack {
            if self.timer.as_mut().poll(context).is_pending() {
                return Ok(());
            }
            self.writing = Writing::Free;
        }
        let before = self.unsent.len();
        if let Poll::Ready(written) = self.unsent.poll_flush(&mut self.stream, context) {
            self.writing = Writing::Free;
            return written;
        }
        if self.writing == Writing::Free || self.unsent.len() < before {
            self.writing = Writing::Blocked;
            self.timer.as_mut().reset(Instant::now() + WRITE_TIMEOUT);
        }
        match self.timer.as_mut().poll(context) {
            Poll::Pending => Ok(()),
            Poll::Ready(()) => Err(io::Error::other("it does not read")),
        }
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
