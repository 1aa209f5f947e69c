//! What the devices measure, as it comes. A stream that breaks is opened again for as long as anybody listens.

use std::future::Future;
use std::time::Duration;

use arthro_proto::{instrument, motion};
use tokio::sync::mpsc;
use tonic::Streaming;

use crate::clients::{Clients, Failure};

/// Period of the states, s. The arms' is in their controllers' time.
const PERIOD_S: f64 = 0.02;
/// States that wait to be recorded; older ones wait at the service.
const WAITING: usize = 16;
/// A stream that broke is opened again after this time.
const RETRY_EVERY: Duration = Duration::from_millis(500);

/// What a device sent.
pub(super) enum Seen {
    Cell(motion::v1::GetCellResponse),
    AxisList(instrument::v1::ListAxesResponse),
    Arms(motion::v1::WatchStateResponse),
    Axes(instrument::v1::WatchStateResponse),
    /// A device cannot be seen: which, and why. Said once until it is back.
    Lost(&'static str, String),
}

/// Both devices' states; they are followed until this is dropped.
pub(super) struct Feeds {
    seen: mpsc::Receiver<Seen>,
    _tasks: tokio::task::JoinSet<()>,
}

impl Feeds {
    pub fn open(clients: &Clients) -> Self {
        let (sender, seen) = mpsc::channel(WAITING);
        let mut tasks = tokio::task::JoinSet::new();
        let motion = clients.motion.clone();
        tasks.spawn(follow("MOTION_UNSEEN", sender.clone(), move |sender| {
            let motion = motion.clone();
            async move {
                let cell = motion.describe().await?;
                sender.send(Seen::Cell(cell)).await.ok();
                pass_on(motion.watch(PERIOD_S).await?, &sender, Seen::Arms).await
            }
        }));
        let instrument = clients.instrument.clone();
        tasks.spawn(follow("INSTRUMENT_UNSEEN", sender, move |sender| {
            let instrument = instrument.clone();
            async move {
                let axes = instrument.describe().await?;
                sender.send(Seen::AxisList(axes)).await.ok();
                pass_on(instrument.watch(PERIOD_S).await?, &sender, Seen::Axes).await
            }
        }));
        Self {
            seen,
            _tasks: tasks,
        }
    }

    /// The next thing seen. Cancel-safe.
    pub async fn next(&mut self) -> Seen {
        match self.seen.recv().await {
            Some(seen) => seen,
            // The tasks end only with this.
            None => std::future::pending().await,
        }
    }
}

/// Watches again and again, and says when that fails.
async fn follow<F>(
    lost: &'static str,
    sender: mpsc::Sender<Seen>,
    watch: impl Fn(mpsc::Sender<Seen>) -> F,
) where
    F: Future<Output = Result<(), Failure>>,
{
    let mut told = String::new();
    while !sender.is_closed() {
        let began = tokio::time::Instant::now();
        let why = match watch(sender.clone()).await {
            Ok(()) => "the stream of states ended".to_owned(),
            Err(failure) => failure.to_string(),
        };
        // What worked for a while and breaks again is news.
        if told != why || began.elapsed() > RETRY_EVERY {
            told.clone_from(&why);
            sender.send(Seen::Lost(lost, why)).await.ok();
        }
        tokio::time::sleep(RETRY_EVERY).await;
    }
}

async fn pass_on<M>(
    mut states: Streaming<M>,
    sender: &mpsc::Sender<Seen>,
    seen: impl Fn(M) -> Seen,
) -> Result<(), Failure> {
    // Why a stream of states broke is told by the attempt to open it again.
    while let Ok(Some(state)) = states.message().await {
        if sender.send(seen(state)).await.is_err() {
            break;
        }
    }
    Ok(())
}
