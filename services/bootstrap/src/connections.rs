//! The connections of a server: bounded in number, and of those that say nothing, none can keep others out.
//!
//! A server at its limit takes a new connection all the same, because a stop may come on it, and closes the one that has been
//! silent for longest; first of all those that have never said enough to be a client. A connection that says nothing is
//! closed after [`GREETING_LIMIT`]; later on HTTP/2's keep-alive asks for signs of life.

use std::collections::HashMap;
use std::io;
use std::pin::Pin;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, ready};
use std::time::Duration;

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::oneshot;
use tokio::time::{Instant, Sleep};
use tokio_stream::Stream;
use tonic::transport::server::{Connected, TcpConnectInfo};

/// A client must have sent HTTP/2's preface and the head of its settings within this time.
const GREETING_LIMIT: Duration = Duration::from_secs(10);
/// The preface is 24 bytes, the head of a frame 9; TLS says more than that before them.
const GREETING_BYTES: usize = 33;
/// When the system refuses a connection, for example for want of file descriptors, it would refuse again at once.
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);
/// File descriptors that a server needs beside its connections: the journal, clients, links to devices.
const OTHER_FILES: u64 = 256;

/// New connections, each with its seat.
#[derive(Debug)]
pub(crate) struct Connections {
    listener: TcpListener,
    seats: Arc<Seats>,
    pause: Option<Pin<Box<Sleep>>>,
}

/// Everybody who is connected.
#[derive(Debug)]
struct Seats {
    most: usize,
    greeting_limit: Duration,
    began: Instant,
    taken: Mutex<Taken>,
}

#[derive(Debug, Default)]
struct Taken {
    next: u64,
    gave_way: u64,
    seats: HashMap<u64, Seat>,
}

#[derive(Debug)]
struct Seat {
    /// When the client was heard last, in milliseconds of the server; 0 until it has greeted.
    heard_ms: Arc<AtomicU64>,
    _give_way: oneshot::Sender<()>,
}

/// One connection.
#[derive(Debug)]
pub(crate) struct Connection {
    stream: TcpStream,
    seats: Arc<Seats>,
    number: u64,
    heard_ms: Arc<AtomicU64>,
    gives_way: oneshot::Receiver<()>,
    greeting: Option<Greeting>,
}

/// What is missing of a greeting, and until when.
#[derive(Debug)]
struct Greeting {
    missing_bytes: usize,
    limit: Pin<Box<Sleep>>,
}

// === impl Connections ===

impl Connections {
    /// At most `most` at the same time.
    pub(crate) fn new(listener: TcpListener, most: usize) -> Self {
        Self::with_limit(listener, most, GREETING_LIMIT)
    }

    fn with_limit(listener: TcpListener, most: usize, greeting_limit: Duration) -> Self {
        Self {
            listener,
            seats: Arc::new(Seats {
                most,
                greeting_limit,
                began: Instant::now(),
                taken: Mutex::default(),
            }),
            pause: None,
        }
    }
}

impl Stream for Connections {
    type Item = io::Result<Connection>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        if let Some(pause) = self.pause.as_mut() {
            ready!(pause.as_mut().poll(context));
            self.pause = None;
        }
        match ready!(self.listener.poll_accept(context)) {
            Ok((stream, _)) => Poll::Ready(Some(
                stream.set_nodelay(true).map(|()| self.seats.seat(stream)),
            )),
            Err(error) => {
                tracing::warn!(%error, "a connection could not be accepted");
                self.pause = Some(Box::pin(tokio::time::sleep(ACCEPT_PAUSE)));
                Poll::Ready(Some(Err(error)))
            }
        }
    }
}

/// Lets this process open as many files as so many connections need, as far as the system grants it.
pub(crate) fn make_room_for(connections: usize) {
    let needed = OTHER_FILES + connections as u64;
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    let granted = maximum.map_or(needed, |maximum| maximum.min(needed));
    if current.is_none_or(|current| current >= granted) {
        return;
    }
    let wanted = Rlimit {
        current: Some(granted),
        maximum,
    };
    if let Err(error) = setrlimit(Resource::Nofile, wanted) {
        tracing::warn!(%error, needed, "the limit of open files could not be raised");
    }
    if granted < needed {
        tracing::warn!(
            granted,
            needed,
            "fewer files may be opened than server.max_connections needs"
        );
    }
}

// === impl Seats ===

impl Seats {
    fn seat(self: &Arc<Self>, stream: TcpStream) -> Connection {
        let heard_ms = Arc::new(AtomicU64::new(0));
        let (give_way, gives_way) = oneshot::channel();
        let mut taken = self.taken();
        if taken.seats.len() >= self.most {
            taken.free_one(self.most);
        }
        let number = taken.next;
        taken.next += 1;
        taken.seats.insert(
            number,
            Seat {
                heard_ms: heard_ms.clone(),
                _give_way: give_way,
            },
        );
        drop(taken);
        Connection {
            stream,
            seats: self.clone(),
            number,
            heard_ms,
            gives_way,
            greeting: Some(Greeting {
                missing_bytes: GREETING_BYTES,
                limit: Box::pin(tokio::time::sleep(self.greeting_limit)),
            }),
        }
    }

    fn taken(&self) -> MutexGuard<'_, Taken> {
        // Nothing panics while it is held, and what it guards is whole at any time.
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Never 0.
    fn now_ms(&self) -> u64 {
        u64::try_from(self.began.elapsed().as_millis()).map_or(u64::MAX, |ms| ms + 1)
    }
}

impl Taken {
    /// Of those that were silent equally long, the one that came first.
    fn free_one(&mut self, most: usize) {
        let longest_silent = self
            .seats
            .iter()
            .min_by_key(|(number, seat)| (seat.heard_ms.load(Ordering::Relaxed), **number))
            .map(|(number, _)| *number);
        if let Some(number) = longest_silent {
            // Dropping the seat is what tells the connection.
            self.seats.remove(&number);
            self.gave_way += 1;
        }
        if self.gave_way.is_power_of_two() {
            tracing::warn!(
                max_connections = most,
                so_far = self.gave_way,
                "at the limit of connections: the one silent for longest gave way to a new one"
            );
        }
    }
}

// === impl Connection ===

impl Connection {
    fn heard(&mut self, bytes: usize) {
        if let Some(greeting) = &mut self.greeting {
            greeting.missing_bytes = greeting.missing_bytes.saturating_sub(bytes);
            if greeting.missing_bytes > 0 {
                return;
            }
            self.greeting = None;
        }
        self.heard_ms.store(self.seats.now_ms(), Ordering::Relaxed);
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.seats.taken().seats.remove(&self.number);
    }
}

impl Connected for Connection {
    type ConnectInfo = TcpConnectInfo;

    fn connect_info(&self) -> TcpConnectInfo {
        self.stream.connect_info()
    }
}

impl AsyncRead for Connection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if Pin::new(&mut self.gives_way).poll(context).is_ready() {
            return Poll::Ready(Err(io::ErrorKind::ConnectionAborted.into()));
        }
        let before = buffer.filled().len();
        match Pin::new(&mut self.stream).poll_read(context, buffer) {
            Poll::Ready(Ok(())) => {
                let read = buffer.filled().len() - before;
                if read > 0 {
                    self.heard(read);
                }
                Poll::Ready(Ok(()))
            }
            Poll::Ready(Err(error)) => Poll::Ready(Err(error)),
            Poll::Pending => {
                if let Some(greeting) = &mut self.greeting {
                    ready!(greeting.limit.as_mut().poll(context));
                    return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
                }
                Poll::Pending
            }
        }
    }
}

impl AsyncWrite for Connection {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write_vectored(context, slices)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use std::net::SocketAddr;

    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
    use tokio_stream::StreamExt as _;

    use super::*;

    async fn listening(most: usize) -> (Connections, SocketAddr) {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        (Connections::new(listener, most), address)
    }

    async fn connected(server: &mut Connections, at: SocketAddr) -> (Connection, TcpStream) {
        let client = TcpStream::connect(at).await.unwrap();
        (server.next().await.unwrap().unwrap(), client)
    }

    /// A client that has greeted, heard by the server.
    async fn greeted(server: &mut Connections, at: SocketAddr) -> (Connection, TcpStream) {
        let (mut connection, mut client) = connected(server, at).await;
        client.write_all(&[1; GREETING_BYTES]).await.unwrap();
        connection
            .read_exact(&mut [0; GREETING_BYTES])
            .await
            .unwrap();
        (connection, client)
    }

    async fn is_closed(connection: &mut Connection) -> bool {
        match connection.read(&mut [0; 1]).await {
            Err(error) => error.kind() == io::ErrorKind::ConnectionAborted,
            Ok(_) => false,
        }
    }

    #[tokio::test]
    async fn at_the_limit_the_one_who_never_greeted_gives_way_though_it_came_last() {
        let (mut server, at) = listening(2).await;
        let (mut first, mut client) = greeted(&mut server, at).await;
        let (mut mute, _silent) = connected(&mut server, at).await;
        let (mut third, mut newest) = connected(&mut server, at).await;
        assert!(is_closed(&mut mute).await);
        for (connection, client) in [(&mut first, &mut client), (&mut third, &mut newest)] {
            client.write_all(b"x").await.unwrap();
            assert_eq!(connection.read(&mut [0; 1]).await.unwrap(), 1);
        }
    }

    #[tokio::test]
    async fn at_the_limit_the_one_who_was_silent_longest_gives_way() {
        let (mut server, at) = listening(2).await;
        let (mut first, mut client) = greeted(&mut server, at).await;
        let (mut second, _silent) = greeted(&mut server, at).await;
        let heard = first.heard_ms.load(Ordering::Relaxed);
        // The server's clock counts milliseconds.
        while first.heard_ms.load(Ordering::Relaxed) <= heard {
            client.write_all(b"x").await.unwrap();
            first.read_exact(&mut [0; 1]).await.unwrap();
        }
        let _third = connected(&mut server, at).await;
        assert!(is_closed(&mut second).await);
        client.write_all(b"x").await.unwrap();
        assert_eq!(first.read(&mut [0; 1]).await.unwrap(), 1);
    }

    #[tokio::test]
    async fn a_connection_that_ends_leaves_its_seat() {
        let (mut server, at) = listening(1).await;
        let (first, _client) = greeted(&mut server, at).await;
        drop(first);
        let (mut second, mut client) = connected(&mut server, at).await;
        assert_eq!(server.seats.taken().seats.len(), 1);
        client.write_all(b"x").await.unwrap();
        assert_eq!(second.read(&mut [0; 1]).await.unwrap(), 1);
    }

    #[tokio::test]
    async fn half_a_preface_is_given_up() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let at = listener.local_addr().unwrap();
        let mut server = Connections::with_limit(listener, 1, Duration::from_millis(20));
        let (mut connection, mut client) = connected(&mut server, at).await;
        client.write_all(b"PRI * HTTP/2").await.unwrap();
        connection.read_exact(&mut [0; 12]).await.unwrap();
        let error = connection.read(&mut [0; 1]).await.unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
    }
}
