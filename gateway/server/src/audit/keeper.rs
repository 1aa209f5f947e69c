//! The owner of the chain: takes entries in the order in which they come, chains and signs them, writes as many as wait in
//! one go, and then their head.
//!
//! [`Audit`] is the handle that clones cheaply. [`Audit::record`] returns when the entry is on the disk; [`Audit::note`]
//! returns at once, for what may not be delayed, and keeps the order. A note that cannot be written waits and is tried
//! again; a record that cannot be written is an error, and then nothing is done.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::{mpsc, oneshot};
use tokio::time::{Interval, MissedTickBehavior, interval};

use super::entry::{Entry, Kind, Link, Tail, Who};
use super::heads::HeadsFile;
use super::key::{PublicKey, SigningKey};
use super::verify::Head;
use crate::error::chain;
use crate::journal::Journal;
use crate::wall_clock::now_ms;

/// Entries on their way to the owner.
const QUEUE: usize = 4096;
/// Entries written in one go.
const BATCH: usize = 256;
/// Notes that wait for a journal that cannot be written.
const WAITING_MOST: usize = 16_384;
/// How often notes that could not be written are tried again.
const RETRY: Duration = Duration::from_secs(1);

/// The audit of this gateway.
#[derive(Clone)]
pub struct Audit(Arc<Shared>);

struct Shared {
    queue: mpsc::Sender<Item>,
    /// Notes that found the queue full.
    lost: Arc<AtomicU64>,
    journal: Arc<dyn Journal>,
    keys: Vec<PublicKey>,
    heads: PathBuf,
}

/// How the chain is kept.
#[derive(Debug)]
pub struct Options {
    /// What signs.
    pub key: SigningKey,
    /// Keys of other gateways that write the same chain.
    pub trusted: Vec<PublicKey>,
    /// The file of heads.
    pub heads: PathBuf,
    /// How often the file of heads is put on the disk.
    pub heads_sync: Duration,
}

/// The audit cannot be written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the audit cannot be written: {0}")]
pub struct AuditFailed(String);

/// Where an entry stands in the chain, once it does; 0 before.
#[derive(Clone, Debug, Default)]
pub struct Place(Arc<AtomicU64>);

struct Item {
    entry: Entry,
    /// Told where this entry stands.
    begins: Option<Place>,
    /// The entry that this one ends.
    answers: Option<Place>,
    /// Told when this entry is on the disk.
    done: Option<oneshot::Sender<Result<(), AuditFailed>>>,
}

struct Keeper {
    journal: Arc<dyn Journal>,
    key: SigningKey,
    heads: HeadsFile,
    waiting: VecDeque<Item>,
    lost: Arc<AtomicU64>,
}

// === impl Audit ===

impl Audit {
    /// Goes on where the journal's chain ends.
    pub async fn open(journal: Arc<dyn Journal>, options: Options) -> Result<Self, AuditFailed> {
        let heads = HeadsFile::open(&options.heads).await.map_err(failed)?;
        let (queue, items) = mpsc::channel(QUEUE);
        let lost = Arc::new(AtomicU64::new(0));
        let mut keys = options.trusted;
        keys.push(options.key.public().clone());
        let keeper = Keeper {
            journal: journal.clone(),
            key: options.key,
            heads,
            waiting: VecDeque::new(),
            lost: lost.clone(),
        };
        tokio::spawn(keeper.run(items, options.heads_sync));
        Ok(Self(Arc::new(Shared {
            queue,
            lost,
            journal,
            keys,
            heads: options.heads,
        })))
    }

    /// Writes an entry, which is on the disk when this returns; where it stands.
    pub async fn record(&self, entry: Entry) -> Result<Place, AuditFailed> {
        let place = Place::default();
        let (done, written) = oneshot::channel();
        let item = Item {
            entry: entry.cut(),
            begins: Some(place.clone()),
            answers: None,
            done: Some(done),
        };
        let gone = || AuditFailed("its owner is gone".to_owned());
        self.0.queue.send(item).await.map_err(|_| gone())?;
        written.await.map_err(|_| gone())??;
        Ok(place)
    }

    /// Has an entry written, without waiting for it; where it will stand.
    pub fn note(&self, entry: Entry) -> Place {
        self.pass(entry, None)
    }

    /// The same for an entry that ends another one.
    pub fn note_end(&self, entry: Entry, of: Place) {
        self.pass(entry, Some(of));
    }

    /// The keys whose signatures count.
    pub fn keys(&self) -> &[PublicKey] {
        &self.0.keys
    }

    /// The file of heads.
    pub fn heads(&self) -> &PathBuf {
        &self.0.heads
    }

    /// Where the entries are.
    pub fn journal(&self) -> &Arc<dyn Journal> {
        &self.0.journal
    }

    fn pass(&self, entry: Entry, answers: Option<Place>) -> Place {
        let place = Place::default();
        let item = Item {
            entry: entry.cut(),
            begins: Some(place.clone()),
            answers,
            done: None,
        };
        if self.0.queue.try_send(item).is_err() {
            self.0.lost.fetch_add(1, Ordering::Relaxed);
        }
        place
    }
}

// === impl Place ===

impl Place {
    /// The entry's number; 0 when it does not stand in the chain.
    pub fn sequence(&self) -> u64 {
        self.0.load(Ordering::Acquire)
    }

    fn set(&self, sequence: u64) {
        self.0.store(sequence, Ordering::Release);
    }
}

// === impl Keeper ===

impl Keeper {
    async fn run(mut self, mut items: mpsc::Receiver<Item>, heads_sync: Duration) {
        let mut fresh = Vec::with_capacity(BATCH);
        let mut retry = every(RETRY);
        let mut sync = every(heads_sync);
        loop {
            tokio::select! {
                count = items.recv_many(&mut fresh, BATCH) => if count == 0 {
                    break;
                },
                _ = retry.tick(), if !self.waiting.is_empty() => {}
                _ = sync.tick() => {
                    if let Err(error) = self.heads.sync().await {
                        tracing::error!(error = chain(&error), "the heads of the audit are not on the disk");
                    }
                    continue;
                }
            }
            self.waiting.extend(fresh.drain(..));
            self.tell_of_lost();
            self.write_waiting().await;
        }
        self.heads.sync().await.ok();
    }

    /// What found no room is told of, where it would have stood.
    fn tell_of_lost(&mut self) {
        let mut lost = self.lost.swap(0, Ordering::Relaxed);
        while self.waiting.len() > WAITING_MOST {
            // The oldest stay: they are how it began.
            if let Some(Item {
                done: Some(done), ..
            }) = self.waiting.pop_back()
            {
                done.send(Err(AuditFailed("too many entries wait".to_owned())))
                    .ok();
            }
            lost += 1;
        }
        if lost == 0 {
            return;
        }
        tracing::error!(lost, "entries of the audit found no room");
        let mut entry = Entry::new(now_ms(), Kind::Alarm, Who::gateway());
        entry.reason = "AUDIT_ENTRIES_LOST".to_owned();
        entry.detail = format!("{lost} entries found no room before this one");
        self.waiting.push_back(Item {
            entry,
            begins: None,
            answers: None,
            done: None,
        });
    }

    async fn write_waiting(&mut self) {
        while !self.waiting.is_empty() {
            let count = self.waiting.len().min(BATCH);
            let batch: Vec<Item> = self.waiting.drain(..count).collect();
            let last = match self.write(&batch).await {
                Ok(last) => last,
                Err(error) => {
                    tracing::error!(%error, "commands are refused until it can be");
                    self.give_up(batch, &error);
                    return;
                }
            };
            let lasting = batch.iter().any(|item| lasting(item.entry.kind));
            let kept = self.keep_head(&last, lasting).await;
            if let Err(error) = &kept {
                tracing::error!(%error, "commands are refused until it can be");
            }
            for done in batch.into_iter().filter_map(|item| item.done) {
                done.send(kept.clone()).ok();
            }
        }
    }

    /// The entries stand in the chain by now; without their head they could be cut off again.
    async fn keep_head(&mut self, head: &Head, lasting: bool) -> Result<(), AuditFailed> {
        self.heads.append(head).await.map_err(failed)?;
        if lasting {
            self.heads.sync().await.map_err(failed)?;
        }
        Ok(())
    }

    /// Whoever waits is told; what nobody waits for stays, in its order.
    fn give_up(&mut self, batch: Vec<Item>, error: &AuditFailed) {
        let all = batch.into_iter().chain(self.waiting.drain(..));
        let mut stays = VecDeque::new();
        for item in all {
            if let Some(begins) = &item.begins {
                begins.set(0);
            }
            match item.done {
                Some(done) => {
                    done.send(Err(error.clone())).ok();
                }
                None => stays.push_back(item),
            }
        }
        self.waiting = stays;
    }

    /// Writes the batch after the chain's end, which another gateway may have moved; the chain's head then.
    async fn write(&mut self, batch: &[Item]) -> Result<Head, AuditFailed> {
        let links = Mutex::new(Vec::new());
        let link_to = |tail| {
            let linked = self.link(batch, tail);
            links
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .clone_from(&linked);
            linked
        };
        let appended = self.journal.append_audit(&link_to).await;
        let links = links.into_inner().unwrap_or_else(PoisonError::into_inner);
        let last = links.last();
        match (appended, last) {
            (Ok(()), Some(last)) => Ok(Head::from(last)),
            // A write that failed may still have been written.
            (Err(error), Some(last)) => {
                let written = self.journal.audit_hash(last.sequence).await;
                match written.map_err(failed)? == Some(last.hash) {
                    true => Ok(Head::from(last)),
                    false => Err(failed(error)),
                }
            }
            (Err(error), None) => Err(failed(error)),
            (Ok(()), None) => Err(AuditFailed("nothing was written".to_owned())),
        }
    }

    fn link(&self, batch: &[Item], mut tail: Tail) -> Vec<Link> {
        let link = |item: &Item| {
            let mut entry = item.entry.clone();
            if let Some(place) = &item.answers {
                entry.answers = place.sequence();
            }
            let link = self.key.link(tail, entry);
            if let Some(place) = &item.begins {
                place.set(link.sequence);
            }
            tail = Tail::from(&link);
            link
        };
        batch.iter().map(link).collect()
    }
}

/// Whether the head goes to the disk with the entry: these must not be cut off again.
fn lasting(kind: Kind) -> bool {
    matches!(
        kind,
        Kind::Approval | Kind::Decision | Kind::Procedure | Kind::Start | Kind::End
    )
}

fn every(period: Duration) -> Interval {
    let mut interval = interval(period);
    interval.set_missed_tick_behavior(MissedTickBehavior::Delay);
    interval
}

fn failed(error: impl std::error::Error + 'static) -> AuditFailed {
    AuditFailed(chain(&error))
}
