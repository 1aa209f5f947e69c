//! Binds, announces, serves and drains.

use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use tokio::io::AsyncReadExt as _;
use tokio::net::TcpListener;
use tokio::signal::unix::{SignalKind, signal};
use tonic::service::Routes;
use tonic::transport::Server;

use crate::calls::{CallLayer, Limits};
use crate::config::ServerConfig;
use crate::connections::{self, Connections};
use crate::drain::DrainSource;
use crate::host::Reports;
use crate::roles::guard::GuardLayer;
use crate::roles::stops::Stops;
use crate::tls::{Credentials, incoming};
use crate::{BoxError, Service, reflection, run};

/// A client is asked for a sign of life this often, and given up when it gives none for as long: one that reads nothing, too.
const KEEP_ALIVE: Duration = Duration::from_secs(20);
/// Bytes of one upload, and of all of one connection, that may wait for their handlers.
const STREAM_WINDOW_BYTES: u32 = 256 * 1024;
const CONNECTION_WINDOW_BYTES: u32 = 1024 * 1024;
/// Calls of one connection at the same time; a client waits by itself with more.
const STREAMS_A_CONNECTION: u32 = 1024;

/// Serves `routes` until a signal, then drains.
pub(crate) async fn serve<S: Service>(
    config: ServerConfig,
    routes: Routes,
    credentials: Option<Credentials>,
    reports: Reports,
    drain: DrainSource,
    until_stdin_closes: bool,
) -> Result<(), BoxError> {
    let name = S::NAME;
    let services = match S::OFFERS {
        Some(offers) => offers.iter().map(|&service| service.to_owned()).collect(),
        None => reflection::services_of(name)?,
    };
    let (health, health_service) = tonic_health::server::health_reporter();
    for service in &services {
        health
            .set_service_status(service, tonic_health::ServingStatus::Serving)
            .await;
    }
    let routes = reflection::mount(routes, &services)?.add_service(health_service);

    let limits = Limits {
        max_calls: config.max_calls,
        max_streams: config.max_streams,
        default_deadline: Duration::from_secs_f64(config.default_deadline_s),
    };
    let mut server = Server::builder()
        .http2_keepalive_interval(Some(KEEP_ALIVE))
        .http2_keepalive_timeout(Some(KEEP_ALIVE))
        .initial_stream_window_size(STREAM_WINDOW_BYTES)
        .initial_connection_window_size(CONNECTION_WINDOW_BYTES)
        .max_concurrent_streams(STREAMS_A_CONNECTION)
        .layer(GuardLayer {
            certified: credentials.is_some(),
            reports: reports.clone(),
            stops: Arc::new(Stops::default()),
        })
        .layer(CallLayer::new(limits, reports.clone()));
    let listener = TcpListener::bind(config.listen)
        .await
        .map_err(|error| format!("cannot listen on {}: {error}", config.listen))?;
    let address = listener.local_addr()?;
    connections::make_room_for(config.max_connections);
    let connections = Connections::new(listener, config.max_connections);
    run::print_line(&format!(r#"{{"service":"{name}","address":"{address}"}}"#));
    tracing::info!(service = name, %address, tls = config.tls.is_some(), "listening");

    let mut terminate = signal(SignalKind::terminate())?;
    let mut interrupt = signal(SignalKind::interrupt())?;
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let router = server.add_routes(routes);
    let stopped = async {
        stopped.await.ok();
    };
    type Serving = Pin<Box<dyn Future<Output = Result<(), tonic::transport::Error>> + Send>>;
    let mut serving: Serving = match credentials {
        Some(credentials) => {
            let hangup = signal(SignalKind::hangup())?;
            tokio::spawn(credentials.clone().keep_fresh(hangup));
            let incoming = incoming::accept(connections, credentials, reports);
            Box::pin(router.serve_with_incoming_shutdown(incoming, stopped))
        }
        None => Box::pin(router.serve_with_incoming_shutdown(connections, stopped)),
    };
    tokio::select! {
        outcome = &mut serving => return Ok(outcome?),
        _ = terminate.recv() => tracing::info!("terminated: draining"),
        _ = interrupt.recv() => tracing::info!("interrupted: draining"),
        () = stdin_closed(until_stdin_closes) => tracing::info!("standard input closed: draining"),
    }
    for service in &services {
        health
            .set_service_status(service, tonic_health::ServingStatus::NotServing)
            .await;
    }
    drain.start();
    stop.send(()).ok();
    let ending = async {
        let outcome = serving.await;
        drain.released().await;
        outcome
    };
    tokio::select! {
        outcome = ending => Ok(outcome?),
        () = tokio::time::sleep(Duration::from_secs_f64(config.drain_s)) => {
            tracing::warn!(drain_s = config.drain_s, "calls or devices still open after the drain; closing them");
            Ok(())
        }
        _ = terminate.recv() => Ok(()),
        _ = interrupt.recv() => Ok(()),
    }
}

/// Resolves when standard input ends, or never if nobody asked.
async fn stdin_closed(asked: bool) {
    if !asked {
        return std::future::pending().await;
    }
    let mut stdin = tokio::io::stdin();
    let mut buffer = [0_u8; 64];
    while stdin.read(&mut buffer).await.is_ok_and(|count| count > 0) {}
}
