//! A bus behind linux-can's `socketcand`, or whatever speaks its protocol: one TCP connection in raw mode.
//!
//! The connection has no task of its own: a frame goes to the socket as it is sent, and the socket is read when the bus
//! is asked for a frame, many frames at once.

mod outbox;
pub mod server;
pub mod text;

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWriteExt, ReadBuf};
use tokio::net::TcpStream;
use tokio::time::timeout;

use self::outbox::Outbox;
use self::text::{Reply, Request, Splitter};
use super::{Address, CanBus, Error, SEND_QUEUE_LEN};
use crate::frame::{Frame, Id, Stamped};

/// How long connecting and opening may take together.
const OPEN_TIMEOUT: Duration = Duration::from_secs(3);
/// What the waiting frames take at most: `< send 1FFFFFFF 8 ff ff ff ff ff ff ff ff >` is the longest.
const UNSENT_MAX: usize = SEND_QUEUE_LEN * 43;

/// Connects, opens the bus and asks for its frames.
pub async fn open(host: &str, port: u16, bus: &str) -> Result<Client, Error> {
    let address = Address::Socketcand {
        host: host.to_owned(),
        port,
        bus: bus.to_owned(),
    };
    let too_slow = |_| Error::Unreachable {
        address: address.clone(),
        detail: format!("no answer within {} s", OPEN_TIMEOUT.as_secs()),
    };
    timeout(OPEN_TIMEOUT, Client::open(host, port, bus, &address))
        .await
        .map_err(too_slow)?
}

/// A participant of the bus. What the socket does not take at once is sent when the bus is next asked for a frame.
#[derive(Debug)]
pub struct Client {
    stream: TcpStream,
    received: Splitter,
    unsent: Outbox,
    ended: Option<Error>,
}

impl Client {
    async fn open(host: &str, port: u16, bus: &str, address: &Address) -> Result<Self, Error> {
        let unreachable = |error: io::Error| Error::Unreachable {
            address: address.clone(),
            detail: error.to_string(),
        };
        let stream = TcpStream::connect((host, port))
            .await
            .map_err(unreachable)?;
        stream.set_nodelay(true).map_err(unreachable)?;
        let mut client = Self {
            stream,
            received: Splitter::default(),
            unsent: Outbox::default(),
            ended: None,
        };
        client.expect(&Reply::Hi, address).await?;
        for request in [Request::Open(bus.to_owned()), Request::RawMode] {
            client
                .stream
                .write_all(request.to_string().as_bytes())
                .await
                .map_err(unreachable)?;
            client.expect(&Reply::Ok, address).await?;
        }
        Ok(client)
    }

    /// Waits for an answer of the handshake; frames that come before it are nobody's yet.
    async fn expect(&mut self, expected: &Reply, address: &Address) -> Result<(), Error> {
        let refused = |detail: String| Error::Handshake {
            address: address.clone(),
            detail,
        };
        loop {
            while let Some(reply) = self
                .take_reply()
                .map_err(|error| refused(error.to_string()))?
            {
                match reply {
                    Reply::Frame(_) => {}
                    reply if reply == *expected => return Ok(()),
                    other => return Err(refused(other.to_string())),
                }
            }
            let read = self.stream.read(self.received.space()).await;
            match read {
                Ok(0) => return Err(refused(Error::SERVER_CLOSED.to_owned())),
                Ok(len) => self.received.filled(len),
                Err(error) => return Err(refused(error.to_string())),
            }
        }
    }

    /// The next reply of those that were read already.
    fn take_reply(&mut self) -> Result<Option<Reply>, text::ParseError> {
        let message = self.received.next_message()?;
        message.map(Reply::parse).transpose()
    }

    fn poll_frame(&mut self, context: &mut Context<'_>) -> Poll<Result<Stamped, Error>> {
        // A server that waits for its frames to be read must not keep ours from going, nor the other way round.
        if let Poll::Ready(Err(error)) = self.unsent.poll_flush(&mut self.stream, context) {
            return Poll::Ready(Err(closed(&error)));
        }
        loop {
            while let Some(reply) = self.take_reply().map_err(|error| closed(&error))? {
                match reply {
                    Reply::Frame(frame) => return Poll::Ready(Ok(frame)),
                    Reply::Error(words) => {
                        let why = format!("the server refused: {words}");
                        return Poll::Ready(Err(Error::Closed(why)));
                    }
                    Reply::Hi | Reply::Ok | Reply::Echo => {}
                }
            }
            let mut space = ReadBuf::new(self.received.space());
            ready!(Pin::new(&mut self.stream).poll_read(context, &mut space))
                .map_err(|error| closed(&error))?;
            let len = space.filled().len();
            if len == 0 {
                return Poll::Ready(Err(Error::Closed(Error::SERVER_CLOSED.to_owned())));
            }
            self.received.filled(len);
        }
    }
}

impl CanBus for Client {
    fn send(&mut self, frame: Frame) -> Result<(), Error> {
        if let Some(error) = &self.ended {
            return Err(error.clone());
        }
        if let Id::Error(_) = frame.id() {
            return Err(Error::NotSendable(frame));
        }
        if self.unsent.len() > UNSENT_MAX {
            return Err(Error::QueueFull);
        }
        text::write_send(&frame, self.unsent.text());
        // That the connection is gone is told by the reading side, which knows why.
        self.unsent.try_flush(&self.stream).ok();
        Ok(())
    }

    fn poll_receive(&mut self, context: &mut Context<'_>) -> Poll<Result<Stamped, Error>> {
        if let Some(error) = &self.ended {
            return Poll::Ready(Err(error.clone()));
        }
        let received = ready!(self.poll_frame(context));
        if let Err(error) = &received {
            self.ended = Some(error.clone());
        }
        Poll::Ready(received)
    }
}

fn closed(error: &dyn std::error::Error) -> Error {
    Error::Closed(error.to_string())
}

#[cfg(test)]
mod tests {
    use tokio::net::TcpListener;

    use super::*;
    use crate::bus::CanBus;

    /// Plays a server that answers each expected text with another.
    async fn serve(
        script: &'static [(&'static str, &'static str)],
    ) -> (u16, tokio::task::JoinHandle<()>) {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = listener.local_addr().unwrap().port();
        let server = tokio::spawn(async move {
            let (mut stream, _) = listener.accept().await.unwrap();
            for (expected, answer) in script {
                let mut received = vec![0; expected.len()];
                stream.read_exact(&mut received).await.unwrap();
                assert_eq!(String::from_utf8(received).unwrap(), *expected);
                stream.write_all(answer.as_bytes()).await.unwrap();
            }
        });
        (port, server)
    }

    #[tokio::test]
    async fn frames_pass_both_ways_even_when_one_comes_with_the_last_ok() {
        let (port, server) = serve(&[
            ("", "< hi >"),
            ("< open can0 >", "< ok >"),
            ("< rawmode >", "< ok >< frame 701 1.500000 05 >"),
            (
                "< send 000 2 1 1 >",
                "< frame 081 1.600000 1186800000000000 >",
            ),
        ])
        .await;
        let mut bus: Box<dyn CanBus> = Box::new(open("127.0.0.1", port, "can0").await.unwrap());
        let heartbeat = bus.receive().await.unwrap();
        assert_eq!(
            heartbeat,
            Stamped {
                frame: Frame::standard(0x701, [5]),
                stamp: Duration::from_millis(1500)
            }
        );
        bus.send(Frame::standard(0x000, [1, 1])).unwrap();
        assert_eq!(bus.receive().await.unwrap().frame.cob_id(), Some(0x081));
        assert_eq!(
            bus.receive().await,
            Err(Error::Closed("the server closed it".to_owned()))
        );
        server.await.unwrap();
    }

    #[tokio::test]
    async fn answers_may_be_cut_at_every_byte() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = listener.local_addr().unwrap().port();
        tokio::spawn(async move {
            let (mut stream, _) = listener.accept().await.unwrap();
            stream.set_nodelay(true).unwrap();
            for (request, answer) in [
                ("", "< hi >"),
                ("< open can0 >", "< ok >"),
                ("< rawmode >", "< ok >< frame 701 1.500000 05 >"),
            ] {
                stream
                    .read_exact(&mut vec![0; request.len()])
                    .await
                    .unwrap();
                for byte in answer.as_bytes().chunks(1) {
                    stream.write_all(byte).await.unwrap();
                    tokio::task::yield_now().await;
                }
            }
        });
        let mut bus: Box<dyn CanBus> = Box::new(open("127.0.0.1", port, "can0").await.unwrap());
        assert_eq!(bus.receive().await.unwrap().frame.cob_id(), Some(0x701));
    }

    #[tokio::test]
    async fn frames_wait_for_a_server_that_does_not_read_up_to_a_bound() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = listener.local_addr().unwrap().port();
        let (all_sent, awaited) = tokio::sync::oneshot::channel::<usize>();
        let server = tokio::spawn(async move {
            let (mut stream, _) = listener.accept().await.unwrap();
            stream.write_all(b"< hi >").await.unwrap();
            for request in ["< open can0 >", "< rawmode >"] {
                stream
                    .read_exact(&mut vec![0; request.len()])
                    .await
                    .unwrap();
                stream.write_all(b"< ok >").await.unwrap();
            }
            let frames = awaited.await.unwrap();
            let mut text = vec![0; frames * "< send 080 0  >".len()];
            stream.read_exact(&mut text).await.unwrap();
            stream.write_all(b"< frame 701 1.5 05 >").await.unwrap();
            text
        });
        let mut client = open("127.0.0.1", port, "can0").await.unwrap();
        let mut frames = 0;
        loop {
            match client.send(Frame::standard(0x080, [])) {
                Ok(()) => frames += 1,
                Err(error) => {
                    assert_eq!(error, Error::QueueFull);
                    break;
                }
            }
            assert!(frames < 50_000_000);
        }
        all_sent.send(frames).unwrap();
        let mut bus: Box<dyn CanBus> = Box::new(client);
        assert_eq!(bus.receive().await.unwrap().frame.cob_id(), Some(0x701));
        let text = server.await.unwrap();
        assert_eq!(text, b"< send 080 0  >".repeat(frames));
    }

    #[tokio::test]
    async fn a_report_is_received_and_not_sent() {
        let (port, _) = serve(&[
            ("", "< hi >"),
            ("< open can0 >", "< ok >"),
            ("< rawmode >", "< ok >< error 040 2.5 >"),
        ])
        .await;
        let mut bus: Box<dyn CanBus> = Box::new(open("127.0.0.1", port, "can0").await.unwrap());
        let report = bus.receive().await.unwrap().frame;
        assert_eq!(report.id(), Id::Error(Id::ERROR_BUS_OFF));
        assert_eq!(bus.send(report), Err(Error::NotSendable(report)));
    }

    #[tokio::test]
    async fn a_refused_bus_is_told_with_the_servers_words() {
        let (port, _) = serve(&[
            ("", "< hi >"),
            ("< open can7 >", "< error could not open bus >"),
        ])
        .await;
        let error = open("127.0.0.1", port, "can7").await.unwrap_err();
        assert!(
            matches!(&error, Error::Handshake { detail, .. } if detail.contains("could not open bus")),
            "{error}"
        );
    }

    #[tokio::test]
    async fn an_absent_server_is_told_with_its_address() {
        let unused = TcpListener::bind("127.0.0.1:0")
            .await
            .unwrap()
            .local_addr()
            .unwrap();
        let error = open("127.0.0.1", unused.port(), "can0").await.unwrap_err();
        assert!(
            error
                .to_string()
                .contains(&format!("socketcand://127.0.0.1:{}/can0", unused.port())),
            "{error}"
        );
    }
}
