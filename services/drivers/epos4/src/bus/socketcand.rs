//! A bus behind linux-can's `socketcand`, or whatever speaks its protocol: one TCP connection in raw mode.

pub mod text;

use std::collections::VecDeque;
use std::io;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::sync::mpsc;
use tokio::time::timeout;

use self::text::{Reply, Request, Splitter};
use super::{Address, Error, Queued, queues};
use crate::frame::{Frame, Stamped};

/// How long connecting and opening may take together.
const OPEN_TIMEOUT: Duration = Duration::from_secs(3);

/// Connects, opens the bus and asks for its frames.
pub async fn open(host: &str, port: u16, bus: &str) -> Result<Queued, Error> {
    let address = Address::Socketcand {
        host: host.to_owned(),
        port,
        bus: bus.to_owned(),
    };
    let too_slow = |_| Error::Unreachable {
        address: address.clone(),
        detail: format!("no answer within {} s", OPEN_TIMEOUT.as_secs()),
    };
    let mut connection = timeout(OPEN_TIMEOUT, Connection::open(&address))
        .await
        .map_err(too_slow)??;
    let (near, mut far) = queues();
    tokio::spawn(async move {
        // Both directions go on at once: a server that waits for its frames to be read must not keep ours from going.
        let why = tokio::select! {
            error = connection.reader.forward(&far.incoming) => error,
            error = forward_outgoing(&mut far.outgoing, &mut connection.writer) => error,
        };
        // Nobody listens any more when the near end is dropped.
        far.incoming.send(Err(why)).await.ok();
    });
    Ok(near)
}

struct Connection {
    reader: Reader,
    writer: OwnedWriteHalf,
}

impl Connection {
    async fn open(address: &Address) -> Result<Self, Error> {
        let Address::Socketcand { host, port, bus } = address else {
            return Err(Error::BadAddress {
                address: address.to_string(),
                problem: "not a socketcand address",
            });
        };
        let unreachable = |error: io::Error| Error::Unreachable {
            address: address.clone(),
            detail: error.to_string(),
        };
        let stream = TcpStream::connect((host.as_str(), *port))
            .await
            .map_err(unreachable)?;
        stream.set_nodelay(true).map_err(unreachable)?;
        let (read, mut writer) = stream.into_split();
        let mut reader = Reader {
            stream: read,
            splitter: Splitter::default(),
            replies: VecDeque::new(),
        };
        reader.expect(&Reply::Hi, address).await?;
        for request in [Request::Open(bus.clone()), Request::RawMode] {
            writer
                .write_all(request.to_string().as_bytes())
                .await
                .map_err(unreachable)?;
            reader.expect(&Reply::Ok, address).await?;
        }
        Ok(Self { reader, writer })
    }
}

async fn forward_outgoing(
    frames: &mut mpsc::Receiver<Frame>,
    writer: &mut OwnedWriteHalf,
) -> Error {
    while let Some(frame) = frames.recv().await {
        let message = Request::Send(frame).to_string();
        if let Err(error) = writer.write_all(message.as_bytes()).await {
            return closed(&error);
        }
    }
    Error::Closed("it was closed from here".to_owned())
}

/// Reads replies, however the segments fall.
struct Reader {
    stream: OwnedReadHalf,
    splitter: Splitter,
    replies: VecDeque<Reply>,
}

impl Reader {
    async fn next(&mut self) -> Result<Reply, Error> {
        loop {
            if let Some(reply) = self.replies.pop_front() {
                return Ok(reply);
            }
            let mut segment = [0; 4096];
            let len = self
                .stream
                .read(&mut segment)
                .await
                .map_err(|error| closed(&error))?;
            if len == 0 {
                return Err(Error::Closed("the server closed it".to_owned()));
            }
            for message in self
                .splitter
                .push(&segment[..len])
                .map_err(|error| closed(&error))?
            {
                self.replies
                    .push_back(Reply::parse(&message).map_err(|error| closed(&error))?);
            }
        }
    }

    /// Waits for an answer of the handshake; frames that come before it are nobody's yet.
    async fn expect(&mut self, expected: &Reply, address: &Address) -> Result<(), Error> {
        loop {
            match self.next().await {
                Ok(reply) if reply == *expected => return Ok(()),
                Ok(Reply::Frame(_)) => {}
                Ok(other) => {
                    return Err(Error::Handshake {
                        address: address.clone(),
                        detail: other.to_string(),
                    });
                }
                Err(error) => {
                    return Err(Error::Handshake {
                        address: address.clone(),
                        detail: error.to_string(),
                    });
                }
            }
        }
    }

    async fn forward(&mut self, frames: &mpsc::Sender<Result<Stamped, Error>>) -> Error {
        loop {
            match self.next().await {
                Ok(Reply::Frame(frame)) => {
                    if frames.send(Ok(frame)).await.is_err() {
                        return Error::Closed("it was closed from here".to_owned());
                    }
                }
                Ok(Reply::Error(words)) => {
                    return Error::Closed(format!("the server refused: {words}"));
                }
                Ok(Reply::Hi | Reply::Ok | Reply::Echo) => {}
                Err(error) => return error,
            }
        }
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
