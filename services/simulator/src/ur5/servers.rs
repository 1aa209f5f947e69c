//! The network services of a simulated controller, on their standard ports or others.
//!
//! The clock is elsewhere: whoever ticks the [`Controller`] calls [`Servers::ticked`] after each cycle, which sends what
//! that cycle owes to every client, and [`Servers::wait_for_clients`] before the next when the cell runs faster than
//! real time.

mod dashboard;
mod links;
mod outlet;
mod rtde;
mod script;

use std::{
    io,
    net::{IpAddr, Ipv4Addr, SocketAddr},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use tokio::{
    net::{TcpListener, TcpStream},
    task::JoinSet,
};

use super::{
    Controller,
    link_fault::{Kind, Service},
};

pub use links::Links;

use outlet::Outlet;

/// A controller that the clock, the network and the cell share.
pub type Shared = Arc<Mutex<Controller>>;

/// Connections one service holds at once; more are closed as they come.
const MAX_CONNECTIONS: usize = 32;

/// Where and how to serve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServerOptions {
    /// Foreign clients cannot be told other ports, so two arms are two addresses.
    pub bind: IpAddr,
    /// Port of each service.
    pub ports: Ports,
    /// In lock step: RTDE frames that a controlling client may leave unanswered. 0 makes every answer arrive before the
    /// next cycle.
    pub unanswered_frames: u32,
}

impl Default for ServerOptions {
    fn default() -> Self {
        Self {
            bind: IpAddr::V4(Ipv4Addr::LOCALHOST),
            ports: Ports::default(),
            unanswered_frames: 0,
        }
    }
}

/// A port for each service; 0 takes any free one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ports {
    /// Dashboard server.
    pub dashboard: u16,
    /// Primary interface.
    pub primary: u16,
    /// Secondary interface.
    pub secondary: u16,
    /// Realtime interface.
    pub realtime: u16,
    /// RTDE.
    pub rtde: u16,
    /// Primary interface that takes no programs.
    pub primary_read_only: u16,
    /// Secondary interface that takes no programs.
    pub secondary_read_only: u16,
    /// Realtime interface that takes no programs.
    pub realtime_read_only: u16,
}

impl Ports {
    /// Any free ones.
    pub const FREE: Self = Self {
        dashboard: 0,
        primary: 0,
        secondary: 0,
        realtime: 0,
        rtde: 0,
        primary_read_only: 0,
        secondary_read_only: 0,
        realtime_read_only: 0,
    };
}

impl Default for Ports {
    fn default() -> Self {
        Self {
            dashboard: 29999,
            primary: 30001,
            secondary: 30002,
            realtime: 30003,
            rtde: 30004,
            primary_read_only: 30011,
            secondary_read_only: 30012,
            realtime_read_only: 30013,
        }
    }
}

/// Where the services are bound.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Addresses {
    /// Dashboard server.
    pub dashboard: SocketAddr,
    /// Primary interface.
    pub primary: SocketAddr,
    /// Secondary interface.
    pub secondary: SocketAddr,
    /// Realtime interface.
    pub realtime: SocketAddr,
    /// RTDE.
    pub rtde: SocketAddr,
    /// Primary interface that takes no programs.
    pub primary_read_only: SocketAddr,
    /// Secondary interface that takes no programs.
    pub secondary_read_only: SocketAddr,
    /// Realtime interface that takes no programs.
    pub realtime_read_only: SocketAddr,
}

impl Addresses {
    /// Each with its name.
    pub fn named(&self) -> [(&'static str, SocketAddr); 8] {
        [
            ("dashboard", self.dashboard),
            ("primary", self.primary),
            ("secondary", self.secondary),
            ("realtime", self.realtime),
            ("rtde", self.rtde),
            ("primary_read_only", self.primary_read_only),
            ("secondary_read_only", self.secondary_read_only),
            ("realtime_read_only", self.realtime_read_only),
        ]
    }
}

/// Running services; dropping them ends all connections.
#[derive(Debug)]
pub struct Servers {
    controller: Shared,
    addresses: Addresses,
    rtde: Arc<rtde::Hub>,
    scripts: Arc<script::Hub>,
    links: Arc<Links>,
    _tasks: JoinSet<()>,
}

/// Binds all services and serves them until the result is dropped.
///
/// # Errors
/// A port that cannot be bound.
pub async fn serve(controller: Shared, options: ServerOptions) -> io::Result<Servers> {
    let ServerOptions {
        bind,
        ports,
        unanswered_frames,
    } = options;
    let listen = |port| TcpListener::bind((bind, port));
    let dashboard = listen(ports.dashboard).await?;
    let rtde = listen(ports.rtde).await?;
    let scripted = [
        (Service::Primary, listen(ports.primary).await?),
        (Service::Secondary, listen(ports.secondary).await?),
        (Service::Realtime, listen(ports.realtime).await?),
        (
            Service::PrimaryReadOnly,
            listen(ports.primary_read_only).await?,
        ),
        (
            Service::SecondaryReadOnly,
            listen(ports.secondary_read_only).await?,
        ),
        (
            Service::RealtimeReadOnly,
            listen(ports.realtime_read_only).await?,
        ),
    ];
    let [
        primary,
        secondary,
        realtime,
        primary_read_only,
        secondary_read_only,
        realtime_read_only,
    ] = scripted
        .each_ref()
        .map(|(_, listener)| listener.local_addr());
    let addresses = Addresses {
        dashboard: dashboard.local_addr()?,
        primary: primary?,
        secondary: secondary?,
        realtime: realtime?,
        rtde: rtde.local_addr()?,
        primary_read_only: primary_read_only?,
        secondary_read_only: secondary_read_only?,
        realtime_read_only: realtime_read_only?,
    };
    let links = Arc::new(Links::default());
    let rtde_hub = Arc::new(rtde::Hub::new(unanswered_frames));
    let script_hub = Arc::new(script::Hub::default());
    let mut tasks = JoinSet::new();
    tasks.spawn(accept(dashboard, Service::Dashboard, links.clone(), {
        let controller = controller.clone();
        move |outlet| dashboard::converse(outlet, controller.clone())
    }));
    for (service, listener) in scripted {
        let (controller, hub) = (controller.clone(), script_hub.clone());
        tasks.spawn(accept(listener, service, links.clone(), move |outlet| {
            script::converse(outlet, controller.clone(), hub.clone())
        }));
    }
    tasks.spawn(accept(rtde, Service::Rtde, links.clone(), {
        let (controller, hub) = (controller.clone(), rtde_hub.clone());
        move |outlet| rtde::converse(outlet, controller.clone(), hub.clone())
    }));
    Ok(Servers {
        controller,
        addresses,
        rtde: rtde_hub,
        scripts: script_hub,
        links,
        _tasks: tasks,
    })
}

impl Servers {
    /// Where the services are bound.
    pub fn addresses(&self) -> Addresses {
        self.addresses
    }

    /// Sends what the cycle just ticked owes to the clients. A client that is slow to read misses packets and gets the
    /// newest once it can take it, as from the real controller.
    pub fn ticked(&self) {
        let controller = lock(&self.controller);
        self.links.ticked(controller.timestamp_s());
        self.rtde.send(&controller);
        self.scripts.send(&controller);
    }

    /// What can be done to the connections.
    pub fn links(&self) -> &Arc<Links> {
        &self.links
    }

    /// Lock step: waits until every client that answers RTDE frames with inputs has answered, at most for `bound`. One
    /// that does not answer in time is not waited for until its next input.
    pub async fn wait_for_clients(&self, bound: Duration) {
        self.rtde.wait(bound).await;
    }
}

/// Takes connections; all of them end with the task.
async fn accept<F>(
    listener: TcpListener,
    service: Service,
    links: Arc<Links>,
    converse: impl Fn(Arc<Outlet>) -> F,
) where
    F: Future<Output = io::Result<()>> + Send + 'static,
{
    let mut conversations = JoinSet::new();
    loop {
        tokio::select! {
            accepted = listener.accept() => match accepted {
                Ok((stream, peer)) if conversations.len() < MAX_CONNECTIONS => {
                    if stream.set_nodelay(true).is_err() {
                        continue;
                    }
                    if links.meets(service, &Kind::Reset) {
                        // Dropped with unsent and unread bytes forgotten: the client sees a reset.
                        stream.set_zero_linger().ok();
                        continue;
                    }
                    if links.meets(service, &Kind::HalfOpen) {
                        conversations.spawn(ignore(stream));
                        continue;
                    }
                    let conversation = converse(Outlet::new(stream, service, &links));
                    conversations.spawn(async move {
                        if let Err(error) = conversation.await {
                            tracing::debug!(%peer, %error, "connection ended");
                        }
                    });
                }
                Ok((_, peer)) => tracing::warn!(%peer, "too many connections"),
                Err(error) => {
                    // Out of descriptors, usually: some will be free again.
                    tracing::warn!(%error, "cannot accept a connection");
                    tokio::time::sleep(Duration::from_millis(50)).await;
                }
            },
            Some(_) = conversations.join_next() => {}
        }
    }
}

/// A connection that nobody answers, until the client gives up.
async fn ignore(stream: TcpStream) {
    let mut buffer = [0; 4096];
    while stream.readable().await.is_ok() {
        match stream.try_read(&mut buffer) {
            Ok(0) => return,
            Err(error) if error.kind() != io::ErrorKind::WouldBlock => return,
            _ => {}
        }
    }
}

/// A thread that panicked while it held a lock left values that are whole all the same: every method restores them.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
