//! Text on its way into a socket.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use tokio::io::AsyncWrite;
use tokio::net::TcpStream;

/// What is to be written. The owner keeps it short.
#[derive(Default, Debug)]
pub(super) struct Outbox {
    text: Vec<u8>,
    sent: usize,
}

impl Outbox {
    /// Where to append.
    pub(super) fn text(&mut self) -> &mut Vec<u8> {
        &mut self.text
    }

    /// How many bytes wait.
    pub(super) fn len(&self) -> usize {
        self.text.len() - self.sent
    }

    /// Gives the socket what it takes at once.
    pub(super) fn try_flush(&mut self, stream: &TcpStream) -> io::Result<()> {
        while self.len() > 0 {
            match stream.try_write(&self.text[self.sent..]) {
                Ok(len) => self.took(len),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Ready when nothing waits any more.
    pub(super) fn poll_flush(
        &mut self,
        stream: &mut TcpStream,
        context: &mut Context<'_>,
    ) -> Poll<io::Result<()>> {
        while self.len() > 0 {
            let waiting = &self.text[self.sent..];
            match ready!(Pin::new(&mut *stream).poll_write(context, waiting))? {
                0 => return Poll::Ready(Err(io::ErrorKind::WriteZero.into())),
                len => self.took(len),
            }
        }
        Poll::Ready(Ok(()))
    }

    fn took(&mut self, len: usize) {
        self.sent += len;
        // What is sent is let go at the end, or when it outweighs what waits.
        if self.sent * 2 >= self.text.len() {
            self.text.drain(..self.sent);
            self.sent = 0;
        }
    }
}
