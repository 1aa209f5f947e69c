//! What mutual TLS costs: `cargo run --release -p arthro-bootstrap --example tls_latency [FOLDER]`.
//!
//! Two servers of the house that have nothing but their health, one with TLS and one without, in this process. Each of many
//! connections is opened, asked once and closed; then one connection is asked again and again. Prints p50 and p99. With a
//! FOLDER the certificates are kept there and the servers go on until the program is ended, for other clients.

use std::error::Error;
use std::net::SocketAddr;
use std::path::Path;
use std::time::{Duration, Instant};

use arthro_bootstrap::config::TlsConfig;
use arthro_bootstrap::tls::{Credentials, Dial, certificate};
use arthro_bootstrap::{BoxError, Host, Role, Service};
use rcgen::string::Ia5String;
use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, IsCa, KeyPair, SanType};
use tonic::service::Routes;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_client::HealthClient;

const CONNECTIONS: usize = 500;
const CALLS: usize = 5000;

/// A server with nothing but its health.
struct Healthy;

impl Service for Healthy {
    const NAME: &'static str = "healthy";
    const DEFAULT_PORT: u16 = 0;
    const OFFERS: Option<&'static [&'static str]> = Some(&[]);
    type Config = std::collections::BTreeMap<String, String>;

    async fn build(_config: Self::Config, _host: Host) -> Result<Routes, BoxError> {
        Ok(Routes::default())
    }
}

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let kept = std::env::args().nth(1);
    let temporary = tempfile::tempdir()?;
    let folder = kept.as_deref().map_or(temporary.path(), Path::new);
    let authority = authority(folder)?;
    let server = issue(folder, &authority, "healthy", Role::Service)?;
    let viewer = Credentials::read(&issue(folder, &authority, "viewer", Role::Viewer)?)?;

    let plain = serve(None)?;
    let secure = serve(Some(&server))?;
    measure("http", &format!("http://{plain}"), None).await?;
    measure("https", &format!("https://{secure}"), Some(&viewer)).await?;
    if kept.is_some() {
        println!("serving at {secure}");
        tokio::signal::ctrl_c().await?;
    }
    Ok(())
}

async fn measure(
    what: &str,
    url: &str,
    credentials: Option<&Credentials>,
) -> Result<(), Box<dyn Error>> {
    let ask = HealthCheckRequest::default;
    let mut opened = Vec::with_capacity(CONNECTIONS);
    // The server may still be on its way up.
    while Dial::to(url, credentials)?.connect().await.is_err() {
        tokio::task::yield_now().await;
    }
    for _ in 0..CONNECTIONS {
        let began = Instant::now();
        let channel = Dial::to(url, credentials)?.connect().await?;
        HealthClient::new(channel).check(ask()).await?;
        opened.push(began.elapsed());
    }
    tell(&format!("{what}: connection and first call"), &mut opened);
    let mut health = HealthClient::new(Dial::to(url, credentials)?.connect().await?);
    let mut called = Vec::with_capacity(CALLS);
    for _ in 0..CALLS {
        let began = Instant::now();
        health.check(ask()).await?;
        called.push(began.elapsed());
    }
    tell(&format!("{what}: call"), &mut called);
    Ok(())
}

fn tell(what: &str, times: &mut [Duration]) {
    times.sort_unstable();
    let at = |share: usize| times[(times.len() - 1) * share / 100].as_micros();
    println!("{what}: p50 {} us, p99 {} us", at(50), at(99));
}

/// Runs a server beside this program; it ends with it.
fn serve(tls: Option<&TlsConfig>) -> Result<SocketAddr, Box<dyn Error>> {
    let address = std::net::TcpListener::bind("127.0.0.1:0")?.local_addr()?;
    let mut flags = vec!["healthy".to_owned(), format!("--listen={address}")];
    for (key, path) in tls.iter().flat_map(|files| {
        [
            ("certificate", &files.certificate),
            ("key", &files.key),
            ("client_ca", &files.client_ca),
        ]
    }) {
        let path = path.display();
        flags.push(format!("--set=server.tls.{key}=\"{path}\""));
    }
    std::thread::spawn(move || arthro_bootstrap::run::<Healthy>(flags.into_iter().map(Into::into)));
    Ok(address)
}

fn authority(folder: &Path) -> Result<CertifiedIssuer<'static, KeyPair>, Box<dyn Error>> {
    let mut params = CertificateParams::default();
    params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
    let authority = CertifiedIssuer::self_signed(params, KeyPair::generate()?)?;
    std::fs::write(folder.join("ca.pem"), authority.pem())?;
    Ok(authority)
}

fn issue(
    folder: &Path,
    authority: &CertifiedIssuer<'static, KeyPair>,
    name: &str,
    role: Role,
) -> Result<TlsConfig, Box<dyn Error>> {
    let mut params = CertificateParams::new(["localhost".to_owned(), "127.0.0.1".to_owned()])?;
    for uri in certificate::uris(name, role).ok_or("no name")? {
        let uri = Ia5String::try_from(uri.as_str())?;
        params.subject_alt_names.push(SanType::URI(uri));
    }
    let key = KeyPair::generate()?;
    let files = TlsConfig {
        certificate: folder.join(format!("{name}.pem")),
        key: folder.join(format!("{name}.key")),
        client_ca: folder.join("ca.pem"),
    };
    std::fs::write(&files.certificate, params.signed_by(&key, authority)?.pem())?;
    std::fs::write(&files.key, key.serialize_pem())?;
    Ok(files)
}
