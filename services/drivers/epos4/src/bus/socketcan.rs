//! A CAN interface of this machine through the Linux kernel. Frames carry the kernel's receive stamp.

use std::io;
use std::time::{Duration, SystemTime};

use socketcan::tokio::CanSocket;
use socketcan::{CanFrame, EmbeddedFrame, Frame as _, SocketOptions};
use tokio::sync::mpsc;

use super::{Address, Error, Queued, queues};
use crate::frame::{Frame, Id, Stamped};

/// "No buffer space available": the interface's own queue is full, because nobody acknowledges or the bus is off.
const ENOBUFS: i32 = 105;
/// How long a full interface is waited for, a millisecond a try.
const ENOBUFS_TRIES: u32 = 100;

/// Opens an interface such as `can0`, which must be up.
pub fn open(interface: &str) -> Result<Queued, Error> {
    let unreachable = |error: io::Error| Error::Unreachable {
        address: Address::SocketCan {
            interface: interface.to_owned(),
        },
        detail: error.to_string(),
    };
    let socket = CanSocket::open(interface).map_err(unreachable)?;
    socket.set_recv_timestamp(true).map_err(unreachable)?;
    socket.set_error_filter_accept_all().map_err(unreachable)?;
    let (near, mut far) = queues();
    tokio::spawn(async move {
        let why = tokio::select! {
            error = forward_incoming(&socket, &far.incoming) => error,
            error = forward_outgoing(&mut far.outgoing, &socket) => error,
        };
        // Nobody listens any more when the near end is dropped.
        far.incoming.send(Err(why)).await.ok();
    });
    Ok(near)
}

async fn forward_incoming(
    socket: &CanSocket,
    frames: &mpsc::Sender<Result<Stamped, Error>>,
) -> Error {
    loop {
        let (frame, received_at) = match socket.read_frame_with_timestamp().await {
            Ok(received) => received,
            Err(error) => return Error::Closed(error.to_string()),
        };
        let Some(frame) = from_kernel(&frame) else {
            continue;
        };
        let stamp = received_at
            .duration_since(SystemTime::UNIX_EPOCH)
            .unwrap_or_default();
        if frames.send(Ok(Stamped { frame, stamp })).await.is_err() {
            return Error::Closed("it was closed from here".to_owned());
        }
    }
}

async fn forward_outgoing(frames: &mut mpsc::Receiver<Frame>, socket: &CanSocket) -> Error {
    while let Some(frame) = frames.recv().await {
        // An error frame is a report and cannot be sent.
        let Some(frame) = to_kernel(&frame) else {
            continue;
        };
        if let Err(error) = write(socket, frame).await {
            return Error::Closed(error.to_string());
        }
    }
    Error::Closed("it was closed from here".to_owned())
}

async fn write(socket: &CanSocket, frame: CanFrame) -> io::Result<()> {
    let mut tries = 0;
    loop {
        match socket.write_frame(frame).await {
            Err(error) if error.raw_os_error() == Some(ENOBUFS) && tries < ENOBUFS_TRIES => {
                tries += 1;
                tokio::time::sleep(Duration::from_millis(1)).await;
            }
            written => return written,
        }
    }
}

fn from_kernel(frame: &CanFrame) -> Option<Frame> {
    match frame {
        CanFrame::Data(data) if data.is_extended() => {
            Frame::new(Id::extended(data.raw_id()), data.data())
        }
        CanFrame::Data(data) => Frame::new(Id::standard(data.raw_id() as u16), data.data()),
        CanFrame::Error(error) => Frame::new(Id::Error(error.error_bits()), &[]),
        CanFrame::Remote(_) => None,
    }
}

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
    use super::*;

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
