//! The newest state without an executor: a thread that waits in the socket itself is woken once, which a task that is
//! woken by an executor that is woken by the kernel is not.

use std::{
    io::{self, Read, Write},
    net::{Shutdown, TcpStream},
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    thread::JoinHandle,
    time::{Duration, Instant},
};

use super::{
    client::{Client, Publication, READS_AT_ONCE, SERVICE, io_error, log},
    inbox::{Inbox, Wanted},
    recipe::{Inputs, Outputs},
    sample::{Sample, Subscription},
    wire,
};
use crate::Error;

/// A started connection whose states a thread waits for.
///
/// ```no_run
/// use std::time::Duration;
/// use ur_link::rtde::Reader;
///
/// ur_link::outputs! { struct Joints { actual_q: [f64; 6] } }
///
/// # fn main() -> Result<(), ur_link::Error> {
/// let mut reader = Reader::<Joints>::connect("192.168.0.10", 30004, 0.0, Duration::from_secs(2))?;
/// loop {
///     let sample = reader.next(Duration::from_millis(100))?;
///     println!("{:?}, {} missed, {:?} old", sample.state.actual_q, sample.skipped, sample.age());
/// }
/// # }
/// ```
#[derive(Debug)]
pub struct Reader<S> {
    stream: TcpStream,
    inbox: Inbox,
    data: Vec<u8>,
    wanted: Wanted,
    subscription: Subscription<S>,
    /// What the socket waits at most.
    patience: Option<Duration>,
}

/// The sending side of a connection that a [`Reader`] reads.
#[derive(Debug)]
pub struct Writer {
    stream: TcpStream,
    outbox: Vec<u8>,
}

impl Client {
    /// Starts the flow of outputs and leaves the connection to blocking calls.
    ///
    /// # Errors
    /// As [`Client::start`].
    pub async fn into_blocking<S: Outputs>(
        mut self,
        subscription: Subscription<S>,
    ) -> Result<(Reader<S>, Writer), Error> {
        self.start().await?;
        let wanted = subscription.wanted(self.version);
        let stream = self.stream.into_std().map_err(io_error)?;
        stream.set_nonblocking(false).map_err(io_error)?;
        let writer = Writer {
            stream: stream.try_clone().map_err(io_error)?,
            outbox: Vec::new(),
        };
        let reader = Reader {
            stream,
            inbox: self.inbox,
            data: Vec::new(),
            wanted,
            subscription,
            patience: None,
        };
        Ok((reader, writer))
    }
}

impl<S: Outputs> Reader<S> {
    /// Connects, subscribes and starts, without an executor of the caller's: for programs that only read.
    /// `frequency_hz` is that of [`Client::setup_outputs`].
    ///
    /// # Errors
    /// As [`Client::connect`], [`Client::subscribe`] and [`Client::start`].
    pub fn connect(
        host: &str,
        port: u16,
        frequency_hz: f64,
        reply_timeout: Duration,
    ) -> Result<Self, Error> {
        let connect = async {
            let mut client = Client::connect(host, port, reply_timeout).await?;
            let subscription = client.subscribe(frequency_hz).await?;
            Ok(client.into_blocking(subscription).await?.0)
        };
        // On a thread of its own, since an executor must not be started from within another.
        std::thread::scope(|scope| {
            let thread = scope.spawn(|| {
                tokio::runtime::Builder::new_current_thread()
                    .enable_all()
                    .build()
                    .map_err(io_error)?
                    .block_on(connect)
            });
            thread
                .join()
                .unwrap_or(Err(Error::Closed { service: SERVICE }))
        })
    }

    /// Waits for a state that is newer than the last, and gives the newest there is.
    ///
    /// # Errors
    /// No new state within `silence` (> 0), a timestamp that is not a number, a violated protocol, a broken connection.
    pub fn next(&mut self, silence: Duration) -> Result<Sample<S>, Error> {
        let began = Instant::now();
        let mut left = silence;
        loop {
            let packages = self.receive(left, silence)?;
            if packages > 0
                && let Some(sample) = self.subscription.sample(&self.data, packages)?
            {
                return Ok(sample);
            }
            left = silence.saturating_sub(began.elapsed());
        }
    }

    /// Reads on a thread of its own and keeps the newest sample for everybody.
    ///
    /// # Errors
    /// No thread or no second handle of the socket.
    pub fn keep_latest(mut self, silence: Duration) -> Result<Latest<S>, Error> {
        let stream = self.stream.try_clone().map_err(io_error)?;
        let shared = Arc::new(Shared {
            slot: Mutex::new(Slot {
                sample: None,
                ended: None,
                waiting: 0,
            }),
            newer: Condvar::new(),
        });
        let theirs = shared.clone();
        let thread = std::thread::Builder::new()
            .name("rtde".into())
            .spawn(move || {
                loop {
                    let next = self.next(silence);
                    let mut slot = theirs.slot();
                    let over = next.is_err();
                    match next {
                        Ok(sample) => slot.sample = Some(sample),
                        Err(error) => slot.ended = Some(Some(error)),
                    }
                    let waiting = slot.waiting > 0;
                    drop(slot);
                    if waiting || over {
                        theirs.newer.notify_all();
                    }
                    if over {
                        return;
                    }
                }
            })
            .map_err(io_error)?;
        Ok(Latest {
            shared,
            stream,
            thread: Some(thread),
        })
    }

    /// Receives what there is, waiting for the first byte. Gives the number of packages.
    fn receive(&mut self, left: Duration, silence: Duration) -> Result<u64, Error> {
        let mut packages = self.take_newest()?;
        if packages == 0 {
            if left.is_zero() {
                return Err(silent(silence));
            }
            if self.patience != Some(left) {
                self.stream.set_read_timeout(Some(left)).map_err(io_error)?;
                self.patience = Some(left);
            }
        }
        let mut waiting = packages == 0;
        for _ in 0..READS_AT_ONCE {
            let space = self.inbox.space();
            let room = space.len();
            let read = if waiting {
                self.stream.read(space)
            } else {
                without_waiting(&mut self.stream, space)
            };
            waiting = false;
            match read {
                Ok(0) if packages > 0 => break,
                Ok(0) => return Err(Error::Closed { service: SERVICE }),
                Ok(bytes) => {
                    self.inbox.received(bytes);
                    packages += self.take_newest()?;
                    // A read that leaves room took all there was.
                    if bytes < room {
                        break;
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => break,
                // A socket that waited long enough says this too.
                Err(error)
                    if matches!(
                        error.kind(),
                        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut
                    ) =>
                {
                    break;
                }
                Err(_) if packages > 0 => break,
                Err(error) => return Err(io_error(error)),
            }
        }
        Ok(packages)
    }

    fn take_newest(&mut self) -> Result<u64, Error> {
        Ok(self
            .inbox
            .take_newest(&self.wanted, &mut self.data, |text| log(&text))?)
    }
}

fn without_waiting(stream: &mut TcpStream, space: &mut [u8]) -> io::Result<usize> {
    stream.set_nonblocking(true)?;
    let read = stream.read(space);
    stream.set_nonblocking(false)?;
    read
}

fn silent(limit: Duration) -> Error {
    Error::Timeout {
        what: "rtde state",
        limit,
    }
}

impl Writer {
    /// Sends the inputs of `I`; waits while the controller takes nothing.
    ///
    /// # Errors
    /// A broken connection.
    pub fn put<I: Inputs>(
        &mut self,
        publication: &Publication<I>,
        inputs: &I,
    ) -> Result<(), Error> {
        self.outbox.clear();
        wire::data_frame(&mut self.outbox, Some(publication.id), |out| {
            inputs.encode(out)
        });
        let mut rest = &self.outbox[..];
        while !rest.is_empty() {
            match self.stream.write(rest) {
                Ok(0) => return Err(Error::Closed { service: SERVICE }),
                Ok(bytes) => rest = &rest[bytes..],
                // The reader looks for more without waiting, and both handles share that mode of the socket.
                Err(error)
                    if matches!(
                        error.kind(),
                        io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted
                    ) =>
                {
                    std::thread::yield_now();
                }
                Err(error) => return Err(io_error(error)),
            }
        }
        Ok(())
    }
}

/// The newest sample of a connection that a thread reads. Dropping it ends thread and connection.
#[derive(Debug)]
pub struct Latest<S> {
    shared: Arc<Shared<S>>,
    stream: TcpStream,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Shared<S> {
    slot: Mutex<Slot<S>>,
    newer: Condvar,
}

#[derive(Debug)]
struct Slot<S> {
    sample: Option<Sample<S>>,
    /// Why the thread ended; the error is handed out once.
    ended: Option<Option<Error>>,
    waiting: usize,
}

impl<S> Shared<S> {
    fn slot(&self) -> MutexGuard<'_, Slot<S>> {
        // Nothing that is done under the lock can leave it half done.
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<S: Outputs> Latest<S> {
    /// The newest sample; `None` before the first. Its [`age`](Sample::age) goes on growing when no more come, and its
    /// number tells how many states came since another one.
    pub fn newest(&self) -> Option<Sample<S>> {
        self.shared.slot().sample
    }

    /// Waits for a sample after that of this number (0: any). Its `skipped` counts from there.
    ///
    /// # Errors
    /// None within `limit`; what ended the reading, once, and [`Error::Closed`] after that.
    pub fn newer_than(&self, number: u64, limit: Duration) -> Result<Sample<S>, Error> {
        let mut slot = self.shared.slot();
        slot.waiting += 1;
        let (mut slot, _) = self
            .shared
            .newer
            .wait_timeout_while(slot, limit, |slot| {
                slot.newer_than(number).is_none() && slot.ended.is_none()
            })
            .unwrap_or_else(PoisonError::into_inner);
        slot.waiting -= 1;
        if let Some(sample) = slot.newer_than(number) {
            return Ok(sample);
        }
        match &mut slot.ended {
            Some(ended) => Err(ended.take().unwrap_or(Error::Closed { service: SERVICE })),
            None => Err(silent(limit)),
        }
    }
}

impl<S: Copy> Slot<S> {
    fn newer_than(&self, number: u64) -> Option<Sample<S>> {
        let sample = self.sample.filter(|sample| sample.number > number)?;
        // The first sample ever replaced none.
        let skipped = if number == 0 {
            0
        } else {
            sample.number - number - 1
        };
        Some(Sample { skipped, ..sample })
    }
}

impl<S> Drop for Latest<S> {
    fn drop(&mut self) {
        // Wakes the thread; fails only where the connection is gone, which ended the thread already.
        let _ = self.stream.shutdown(Shutdown::Both);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
