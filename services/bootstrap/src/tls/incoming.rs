//! Accepts connections: many handshakes at the same time, none of which can hold up another.
//!
//! A handshake has a time limit. At most [`HANDSHAKES_MAX`] are under way; a further one takes the place of the oldest, because
//! an honest one takes milliseconds and whoever opens connections and says nothing is the oldest soon.

use std::collections::VecDeque;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::sync::mpsc;
use tokio::task::AbortHandle;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;
use tokio_stream::StreamExt as _;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::server::{Connected, TcpConnectInfo};

use super::certificate::Certified;
use super::credentials::Credentials;
use crate::connections::{self, Connections};
use crate::host::{RefusedCall, Reports};

/// Handshakes under way at the same time.
const HANDSHAKES_MAX: usize = 256;
/// A handshake ends within this time or not at all.
const HANDSHAKE_LIMIT: Duration = Duration::from_secs(5);
/// The reason of a handshake that failed.
pub(crate) const HANDSHAKE_REFUSED: &str = "HANDSHAKE_REFUSED";

/// A connection whose client is known.
#[derive(Debug)]
pub(crate) struct Connection {
    stream: TlsStream<connections::Connection>,
    peer: Peer,
}

/// Who is at the other end of a connection; found in the extensions of its requests.
#[derive(Clone, Debug)]
pub(crate) struct Peer {
    pub certified: Arc<Certified>,
    pub address: TcpConnectInfo,
}

/// Accepts until the stream is dropped.
pub(crate) fn accept(
    mut incoming: Connections,
    credentials: Credentials,
    reports: Reports,
) -> ReceiverStream<io::Result<Connection>> {
    let (accepted, connections) = mpsc::channel(16);
    tokio::spawn(async move {
        let mut handshakes = Handshakes::default();
        loop {
            let stream = tokio::select! {
                () = accepted.closed() => break,
                stream = incoming.next() => stream,
            };
            match stream {
                Some(Ok(stream)) => {
                    let address = stream.connect_info().remote_addr();
                    let (credentials, reports) = (credentials.clone(), reports.clone());
                    let accepted = accepted.clone();
                    handshakes.begin(async move {
                        match shake(stream, &credentials).await {
                            // Nobody takes it any more when the server is going down.
                            Ok(connection) => drop(accepted.send(Ok(connection)).await),
                            Err(error) => reports.refused(refusal(address, &error)),
                        }
                    });
                }
                // It has said so, and goes on.
                Some(Err(_)) => {}
                None => break,
            }
        }
    });
    ReceiverStream::new(connections)
}

async fn shake(
    stream: connections::Connection,
    credentials: &Credentials,
) -> io::Result<Connection> {
    let address = stream.connect_info();
    let acceptor = TlsAcceptor::from(Arc::clone(&credentials.material().server));
    let stream = tokio::time::timeout(HANDSHAKE_LIMIT, acceptor.accept(stream)).await??;
    let shown = stream.get_ref().1.peer_certificates();
    let certificate = shown
        .and_then(<[_]>::first)
        .ok_or_else(|| io::Error::other("the client has shown no certificate"))?;
    let certified = Arc::new(Certified::read(certificate).map_err(io::Error::other)?);
    Ok(Connection {
        stream,
        peer: Peer { certified, address },
    })
}

fn refusal(address: Option<SocketAddr>, error: &io::Error) -> RefusedCall {
    RefusedCall {
        caller: None,
        peer: address,
        method: String::new(),
        reason: HANDSHAKE_REFUSED.to_owned(),
        message: format!("no handshake: {error}"),
    }
}

/// The handshakes under way, oldest first.
#[derive(Debug, Default)]
struct Handshakes(VecDeque<AbortHandle>);

// === impl Handshakes ===

impl Handshakes {
    fn begin(&mut self, handshake: impl Future<Output = ()> + Send + 'static) {
        self.0.retain(|handshake| !handshake.is_finished());
        if self.0.len() >= HANDSHAKES_MAX
            && let Some(oldest) = self.0.pop_front()
        {
            oldest.abort();
        }
        self.0.push_back(tokio::spawn(handshake).abort_handle());
    }
}

// === impl Connection ===

impl Connected for Connection {
    type ConnectInfo = Peer;

    fn connect_info(&self) -> Peer {
        self.peer.clone()
    }
}

impl AsyncRead for Connection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
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
        buffers: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write_vectored(context, buffers)
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
