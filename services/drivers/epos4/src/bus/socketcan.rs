//! A CAN interface of this machine through the Linux kernel. Frames carry the kernel's receive stamp, and what the
//! controller reports comes among them as error frames.
//!
//! The socket has no task of its own: a frame goes to the kernel as it is sent, and the socket is read when the bus is
//! asked for a frame. What the kernel does not take at once waits, in order, and is tried again for a moment.

pub mod netlink;

use std::collections::VecDeque;
use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::{Duration, SystemTime};

use socketcan::{CanFrame, CanSocket, EmbeddedFrame, Frame as _, Socket, SocketOptions};
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;
use tokio::time::{Instant, Sleep, sleep};

use super::{Address, CanBus, Error, SEND_PATIENCE, SEND_QUEUE_LEN};
use crate::frame::{Frame, Id, Stamped};

/// What waits is tried again after this: the time of some eight frames at 1 Mbit/s, which is most of the queue that
/// an interface has by default. A full interface does not tell when it has room again.
const RETRY: Duration = Duration::from_millis(1);
/// Bytes of received frames that the kernel keeps for us, some thousand frames, where its limit allows.
const RECEIVE_BUFFER: usize = 1 << 20;

/// A participant of the bus of an interface.
#[derive(Debug)]
pub struct Interface {
    name: String,
    socket: AsyncFd<CanSocket>,
    unsent: Unsent,
    ended: Option<Error>,
}

/// Frames that the kernel has not taken.
#[derive(Debug)]
struct Unsent {
    frames: VecDeque<Frame>,
    retry: Pin<Box<Sleep>>,
    /// When the first of them began to wait.
    since: Instant,
}

/// Opens an interface such as `can0`, which must be up.
pub fn open(interface: &str) -> Result<Interface, Error> {
    let opened = || -> io::Result<AsyncFd<CanSocket>> {
        let socket = CanSocket::open(interface)?;
        socket.set_nonblocking(true)?;
        socket.set_recv_timestamp(true)?;
        socket.set_error_filter_accept_all()?;
        socket
            .as_raw_socket()
            .set_recv_buffer_size(RECEIVE_BUFFER)?;
        // An interface that is down is opened all the same, and tells so only here.
        match socket.as_raw_socket().take_error()? {
            Some(error) => Err(error),
            None => watch(socket),
        }
    };
    let socket = opened().map_err(|error| Error::Unreachable {
        address: Address::SocketCan {
            interface: interface.to_owned(),
        },
        detail: detail(&error),
    })?;
    Ok(Interface {
        name: interface.to_owned(),
        socket,
        unsent: Unsent {
            frames: VecDeque::new(),
            retry: Box::pin(sleep(Duration::ZERO)),
            since: Instant::now(),
        },
        ended: None,
    })
}

/// What tokio has instead of this is an `unsafe fn`, for types whose descriptor may change or close while it is watched.
/// The socket owns its descriptor and gives it to nobody.
#[expect(
    deprecated,
    reason = "the other way is unsafe, and this type needs none of it"
)]
fn watch(socket: CanSocket) -> io::Result<AsyncFd<CanSocket>> {
    // Not for room to send: the kernel would wake us for every frame that is on its way.
    AsyncFd::with_interest(socket, Interest::READABLE | Interest::ERROR)
}

impl Interface {
    /// Whether the kernel took the frame.
    fn write(&self, frame: &Frame) -> Result<bool, Error> {
        let frame = to_kernel(frame).ok_or(Error::NotSendable(*frame))?;
        match self.socket.get_ref().write_frame(&frame) {
            Ok(()) => Ok(true),
            Err(error) if is_full(&error) => Ok(false),
            Err(error) => Err(self.closed(&error)),
        }
    }

    /// Tries what waits again; ready when that failed for good.
    fn poll_unsent(&mut self, context: &mut Context<'_>) -> Poll<Error> {
        while let Some(frame) = self.unsent.frames.front() {
            ready!(self.unsent.retry.as_mut().poll(context));
            match self.write(frame) {
                Ok(true) => {
                    self.unsent.frames.pop_front();
                    self.unsent.since = Instant::now();
                }
                Ok(false) if self.unsent.since.elapsed() > SEND_PATIENCE => {
                    return Poll::Ready(Error::QueueFull);
                }
                Ok(false) => self.unsent.retry.as_mut().reset(Instant::now() + RETRY),
                Err(error) => return Poll::Ready(error),
            }
        }
        Poll::Pending
    }

    fn poll_frame(&mut self, context: &mut Context<'_>) -> Poll<Result<Stamped, Error>> {
        loop {
            let mut readable = ready!(self.socket.poll_read_ready(context))
                .map_err(|error| self.closed(&error))?;
            let read = readable.try_io(|socket| socket.get_ref().read_frame_with_timestamp());
            let Ok(read) = read else { continue };
            let (frame, received_at) = read.map_err(|error| self.closed(&error))?;
            let Some(frame) = from_kernel(&frame) else {
                continue;
            };
            let stamp = received_at
                .duration_since(SystemTime::UNIX_EPOCH)
                .unwrap_or_default();
            return Poll::Ready(Ok(Stamped { frame, stamp }));
        }
    }

    /// An interface that goes down or away has nothing to read: epoll tells an error alone, which counts as the end of
    /// writing.
    fn poll_error(&self, context: &mut Context<'_>) -> Poll<Error> {
        loop {
            let ended = ready!(self.socket.poll_write_ready(context));
            let mut ended = match ended {
                Ok(ended) => ended,
                Err(error) => return Poll::Ready(self.closed(&error)),
            };
            match self.socket.get_ref().as_raw_socket().take_error() {
                Ok(None) => ended.clear_ready(),
                Ok(Some(error)) | Err(error) => return Poll::Ready(self.closed(&error)),
            }
        }
    }

    fn closed(&self, error: &io::Error) -> Error {
        Error::Closed(format!("{}: {}", self.name, detail(error)))
    }
}

impl CanBus for Interface {
    fn send(&mut self, frame: Frame) -> Result<(), Error> {
        if let Some(error) = &self.ended {
            return Err(error.clone());
        }
        if self.unsent.frames.is_empty() {
            if self.write(&frame)? {
                return Ok(());
            }
            self.unsent.since = Instant::now();
            self.unsent.retry.as_mut().reset(Instant::now() + RETRY);
        }
        if self.unsent.frames.len() >= SEND_QUEUE_LEN {
            return Err(Error::QueueFull);
        }
        self.unsent.frames.push_back(frame);
        Ok(())
    }

    fn poll_receive(&mut self, context: &mut Context<'_>) -> Poll<Result<Stamped, Error>> {
        if let Some(error) = &self.ended {
            return Poll::Ready(Err(error.clone()));
        }
        // What was received comes first: it may tell why nothing can be sent.
        let received = match self.poll_frame(context) {
            Poll::Ready(received) => received,
            Poll::Pending => match self.poll_error(context) {
                Poll::Ready(error) => Err(error),
                Poll::Pending => Err(ready!(self.poll_unsent(context))),
            },
        };
        if let Err(error) = &received {
            self.ended = Some(error.clone());
        }
        Poll::Ready(received)
    }
}

// Errors of `errno.h`, which are the same on all of Linux but MIPS, SPARC and others that no EPOS master is made of.
const ENODEV: i32 = 19;
const ENETDOWN: i32 = 100;
/// The interface's own queue is full, because nobody acknowledges or the bus is off.
const ENOBUFS: i32 = 105;

/// Whether the kernel cannot take a frame now.
fn is_full(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::WouldBlock || error.raw_os_error() == Some(ENOBUFS)
}

fn detail(error: &io::Error) -> String {
    match error.raw_os_error() {
        Some(ENETDOWN) => "the interface is down, bring it up with ip link set up".to_owned(),
        Some(ENODEV) => "there is no such interface, or not any more".to_owned(),
        _ => error.to_string(),
    }
}

fn from_kernel(frame: &CanFrame) -> Option<Frame> {
    match frame {
        CanFrame::Data(data) if data.is_extended() => {
            Frame::new(Id::extended(data.raw_id()), data.data())
        }
        CanFrame::Data(data) => Frame::new(Id::standard(data.raw_id() as u16), data.data()),
        CanFrame::Error(error) => Frame::new(Id::Error(error.error_bits()), error.data()),
        CanFrame::Remote(_) => None,
    }
}

/// None for an error frame, which is a report and cannot be sent.
fn to_kernel(frame: &Frame) -> Option<CanFrame> {
    let id: socketcan::Id = match frame.id() {
        Id::Standard(id) => socketcan::StandardId::new(id)?.into(),
        Id::Extended(id) => socketcan::ExtendedId::new(id)?.into(),
        Id::Error(_) => return None,
    };
    CanFrame::new(id, frame.data())
}

#[cfg(test)]
mod tests {
    use socketcan::CanErrorFrame;

    use super::*;
    use crate::frame::error::{ControllerState, Report};

    #[test]
    fn frames_survive_the_kernels_form() {
        for frame in [
            Frame::standard(0x601, [1, 2, 3]),
            Frame::standard(0x080, []),
        ] {
            assert_eq!(from_kernel(&to_kernel(&frame).unwrap()), Some(frame));
        }
        let extended = Frame::new(Id::extended(0x12345), &[9; 8]).unwrap();
        assert_eq!(from_kernel(&to_kernel(&extended).unwrap()), Some(extended));
    }

    #[test]
    fn error_frames_keep_their_details_and_are_not_sent() {
        let kernels = CanErrorFrame::new_error(0x204, &[0, 0x20, 0, 0, 0, 0, 130, 7]).unwrap();
        let frame = from_kernel(&CanFrame::Error(kernels)).unwrap();
        let report = Report::decode(&frame).unwrap();
        assert_eq!(report.state(), Some(ControllerState::ErrorPassive));
        assert_eq!(
            report.counters().map(|counters| counters.transmit),
            Some(130)
        );
        assert_eq!(to_kernel(&frame).map(|_| ()), None);
    }

    #[test]
    fn a_full_or_absent_interface_is_told_from_others() {
        assert!(is_full(&io::Error::from_raw_os_error(ENOBUFS)));
        assert!(is_full(&io::ErrorKind::WouldBlock.into()));
        assert!(!is_full(&io::Error::from_raw_os_error(ENETDOWN)));
        assert!(detail(&io::Error::from_raw_os_error(ENETDOWN)).contains("is down"));
        assert!(detail(&io::Error::from_raw_os_error(ENODEV)).contains("no such interface"));
    }

    #[tokio::test]
    async fn an_absent_interface_is_told_by_name() {
        let error = open("nocan9").unwrap_err();
        assert!(
            error
                .to_string()
                .starts_with("cannot reach socketcan:nocan9: "),
            "{error}"
        );
    }
}
