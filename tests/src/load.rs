//! A gateway under load: hundreds who watch and ask, thousands of idle streams, readers that do not read, uploads that do not
//! end and connections that do not speak, and among them somebody who stops.
//!
//! ```ignore
//! let crowd = Crowd::of(&gateway, &procedure_id);
//! let asking = crowd.ask(100, None).await;
//! let watching = crowd.watch(200, 0.02).await;
//! // ... stop, and look at the clock ...
//! println!("{}", asking.end().await);
//! ```

mod http2;
mod latencies;
mod memory;
mod stopping;
mod uploads;
mod withholding;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use arthro_proto::gateway::v1::procedure_service_client::ProcedureServiceClient;
use arthro_proto::gateway::v1::{GetProcedureRequest, WatchProcedureRequest};
use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;
use tokio::time::{Interval, MissedTickBehavior, interval_at};
use tonic::transport::{Channel, Endpoint};

pub use latencies::Latencies;
pub use memory::{Resident, resident_bytes};
pub use stopping::{Stopper, Stops};
pub use uploads::{Lie, Uploads, upload};
pub use withholding::Withholding;

/// Makes clients of one gateway that are interested in one procedure.
#[derive(Clone, Debug)]
pub struct Crowd {
    gateway: String,
    procedure_id: String,
}

/// Clients that ask for the procedure, each on a connection of its own.
#[derive(Debug)]
pub struct Asking {
    end: watch::Sender<bool>,
    clients: JoinSet<Vec<f64>>,
    refused: Arc<AtomicU64>,
    began: Instant,
}

/// What askers found.
#[derive(Debug)]
pub struct Asked {
    /// Answers a second, all together.
    pub answers_s: f64,
    /// Of each answer.
    pub latencies: Latencies,
    /// Answers that were errors.
    pub refused: u64,
}

/// Clients that watch.
#[derive(Debug)]
pub struct Watching {
    clients: JoinSet<()>,
    received: Arc<AtomicU64>,
    ended: Arc<AtomicU64>,
}

// === impl Crowd ===

impl Crowd {
    /// Around a gateway's procedure.
    pub fn of(gateway: &str, procedure_id: &str) -> Self {
        Self {
            gateway: gateway.to_owned(),
            procedure_id: procedure_id.to_owned(),
        }
    }

    /// Where the gateway listens, host:port.
    fn address(&self) -> &str {
        self.gateway
            .strip_prefix("http://")
            .unwrap_or(&self.gateway)
    }

    async fn connected(&self) -> ProcedureServiceClient<Channel> {
        let channel = Endpoint::from_shared(self.gateway.clone())
            .expect("an announced address is valid")
            .tcp_nodelay(true)
            .connect()
            .await
            .expect("the gateway takes a connection");
        ProcedureServiceClient::new(channel)
    }

    /// So many who ask, each once a `period` if it is answered in time; without one each asks as fast as it is answered.
    pub async fn ask(&self, clients: usize, period: Option<Duration>) -> Asking {
        let (end, ended) = watch::channel(false);
        let refused = Arc::new(AtomicU64::new(0));
        let mut asking = JoinSet::new();
        let began = tokio::time::Instant::now();
        for place in 0..clients as u32 {
            let client = self.connected().await;
            let turns = period.map(|period| {
                // One after the other, not all at once.
                let mut turns = interval_at(began + period * place / clients as u32, period);
                turns.set_missed_tick_behavior(MissedTickBehavior::Skip);
                turns
            });
            asking.spawn(ask(
                client,
                turns,
                self.procedure_id.clone(),
                ended.clone(),
                refused.clone(),
            ));
        }
        Asking {
            end,
            clients: asking,
            refused,
            began: Instant::now(),
        }
    }

    /// So many who watch, each on a connection of its own.
    pub async fn watch(&self, clients: usize, period_s: f64) -> Watching {
        self.watch_over(clients, clients, period_s).await
    }

    /// So many streams over so many connections. Resolves when each has been told the state once.
    pub async fn watch_over(&self, streams: usize, connections: usize, period_s: f64) -> Watching {
        let mut connected = Vec::with_capacity(connections);
        for _ in 0..connections {
            connected.push(self.connected().await);
        }
        let received = Arc::new(AtomicU64::new(0));
        let ended = Arc::new(AtomicU64::new(0));
        let (first, mut firsts) = mpsc::unbounded_channel();
        let mut clients = JoinSet::new();
        for number in 0..streams {
            let request = WatchProcedureRequest {
                procedure_id: self.procedure_id.clone(),
                period_s,
            };
            clients.spawn(watch(
                connected[number % connections].clone(),
                request,
                received.clone(),
                ended.clone(),
                first.clone(),
            ));
            // Not more at once than a gateway takes calls.
            if number % 64 == 63 {
                for _ in 0..64 {
                    firsts.recv().await;
                }
            }
        }
        drop(first);
        while firsts.recv().await.is_some() {}
        Watching {
            clients,
            received,
            ended,
        }
    }
}

async fn ask(
    mut client: ProcedureServiceClient<Channel>,
    mut turns: Option<Interval>,
    procedure_id: String,
    ended: watch::Receiver<bool>,
    refused: Arc<AtomicU64>,
) -> Vec<f64> {
    let mut latencies_ms = Vec::new();
    while !*ended.borrow() {
        if let Some(turns) = &mut turns {
            turns.tick().await;
        }
        let request = GetProcedureRequest {
            procedure_id: procedure_id.clone(),
        };
        let asked = Instant::now();
        match client.get_procedure(request).await {
            Ok(_) => latencies_ms.push(asked.elapsed().as_secs_f64() * 1e3),
            Err(_) => {
                refused.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
    latencies_ms
}

/// `first` is dropped with the first state, or when there is none.
async fn watch(
    mut client: ProcedureServiceClient<Channel>,
    request: WatchProcedureRequest,
    received: Arc<AtomicU64>,
    ended: Arc<AtomicU64>,
    first: mpsc::UnboundedSender<()>,
) {
    let mut first = Some(first);
    if let Ok(answer) = client.watch_procedure(request).await {
        let mut states = answer.into_inner();
        while let Ok(Some(_)) = states.message().await {
            received.fetch_add(1, Ordering::Relaxed);
            if let Some(first) = first.take() {
                first.send(()).ok();
            }
        }
    }
    if let Some(first) = first {
        first.send(()).ok();
    }
    ended.fetch_add(1, Ordering::Relaxed);
}

// === impl Asking ===

impl Asking {
    /// Ends them and tells what they found.
    pub async fn end(mut self) -> Asked {
        self.end.send_replace(true);
        let lasted_s = self.began.elapsed().as_secs_f64();
        let mut all_ms = Vec::new();
        while let Some(latencies_ms) = self.clients.join_next().await {
            all_ms.extend(latencies_ms.expect("a client does not panic"));
        }
        Asked {
            answers_s: all_ms.len() as f64 / lasted_s,
            latencies: Latencies::of(all_ms),
            refused: self.refused.load(Ordering::Relaxed),
        }
    }
}

// === impl Watching ===

impl Watching {
    /// States received so far, all together.
    pub fn received(&self) -> u64 {
        self.received.load(Ordering::Relaxed)
    }

    /// Streams that ended before they were dropped.
    pub fn ended(&self) -> u64 {
        self.ended.load(Ordering::Relaxed)
    }

    /// Streams that go on.
    pub fn open(&self) -> usize {
        self.clients.len() - usize::try_from(self.ended()).unwrap_or(usize::MAX)
    }
}
