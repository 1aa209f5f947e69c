//! The network services of a simulated controller, on their standard ports or others.
//!
//! The clock is elsewhere: whoever ticks the [`Controller`] calls [`Servers::ticked`] after each cycle, which sends what
//! that cycle owes to every client, and [`Servers::wait_for_clients`] before the next when the cell runs faster than
//! real time.

mod dashboard;
mod network;
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

use super::Controller;

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
}

impl Ports {
    /// Any free ones.
    pub const FREE: Self = Self {
        dashboard: 0,
        primary: 0,
        secondary: 0,
        realtime: 0,
        rtde: 0,
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
}

/// Running services; dropping them ends all connections.
#[derive(Debug)]
pub struct Servers {
    controller: Shared,
    addresses: Addresses,
    rtde: Arc<rtde::Hub>,
    scripts: Arc<script::Hub>,
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
    let dashboard = TcpListener::bind((bind, ports.dashboard)).await?;
    let primary = TcpListener::bind((bind, ports.primary)).await?;
    let secondary = TcpListener::bind((bind, ports.secondary)).await?;
    let realtime = TcpListener::bind((bind, ports.realtime)).await?;
    let rtde = TcpListener::bind((bind, ports.rtde)).await?;
    let addresses = Addresses {
        dashboard: dashboard.local_addr()?,
        primary: primary.local_addr()?,
        secondary: secondary.local_addr()?,
        realtime: realtime.local_addr()?,
        rtde: rtde.local_addr()?,
    };
    {
        let mut controller = lock(&controller);
        let reach = controller.robot.config.script_network;
        controller.robot.network = Arc::new(network::Tcp::new(reach));
    }
    let rtde_hub = Arc::new(rtde::Hub::new(unanswered_frames));
    let script_hub = Arc::new(script::Hub::default());
    let mut tasks = JoinSet::new();
    tasks.spawn(accept(dashboard, {
        let controller = controller.clone();
        move |stream| dashboard::converse(stream, controller.clone())
    }));
    for (listener, interface) in [
        (primary, script::Interface::Primary),
        (secondary, script::Interface::Secondary),
        (realtime, script::Interface::Realtime),
    ] {
        let (controller, hub) = (controller.clone(), script_hub.clone());
        tasks.spawn(accept(listener, move |stream| {
            script::converse(stream, interface, controller.clone(), hub.clone())
        }));
    }
    tasks.spawn(accept(rtde, {
        let (controller, hub) = (controller.clone(), rtde_hub.clone());
        move |stream| rtde::converse(stream, controller.clone(), hub.clone())
    }));
    Ok(Servers {
        controller,
        addresses,
        rtde: rtde_hub,
        scripts: script_hub,
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
        self.rtde.send(&controller);
        self.scripts.send(&controller);
    }

    /// Lock step: waits until every client that answers RTDE frames with inputs has answered, at most for `bound`. One
    /// that does not answer in time is not waited for until its next input.
    pub async fn wait_for_clients(&self, bound: Duration) {
        self.rtde.wait(bound).await;
    }
}

/// Takes connections; all of them end with the task.
async fn accept<F>(listener: TcpListener, converse: impl Fn(TcpStream) -> F)
where
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
                    let conversation = converse(stream);
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

/// A thread that panicked while it held a lock left values that are whole all the same: every method restores them.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
