//! A site with an authority, a server of its own, and visitors with all sorts of certificates.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use hyper_util::rt::TokioIo;
use rcgen::string::Ia5String;
use rcgen::{
    BasicConstraints, CertificateParams, CertifiedIssuer, ExtendedKeyUsagePurpose, IsCa, KeyPair,
    SanType, date_time_ymd,
};
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName};
use rustls::{ClientConfig, RootCertStore, SupportedProtocolVersion};
use tempfile::TempDir;
use time::OffsetDateTime;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::broadcast;
use tokio_rustls::TlsConnector;
use tonic::service::Routes;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::{Channel, Endpoint};
use tonic::{Status, Streaming};
use tonic_health::pb::health_client::HealthClient;
use tonic_health::pb::{HealthCheckRequest, HealthCheckResponse};
use tower::service_fn;

use crate::config::TlsConfig;
use crate::connections::Connections;
use crate::host::{Host, RefusedCall};
use crate::identity::{Caller, Role};
use crate::roles::guard::GuardLayer;
use crate::tls::{Credentials, certificate, incoming};

/// An authority and a folder for what it has made.
pub struct Site {
    folder: TempDir,
    authority: CertifiedIssuer<'static, KeyPair>,
}

/// Whom a certificate names, and what is wrong with it.
pub struct Holder {
    uris: Vec<String>,
    not_before: OffsetDateTime,
    not_after: OffsetDateTime,
    usages: Vec<ExtendedKeyUsagePurpose>,
    self_signed: bool,
}

/// A server that answers health checks.
pub struct Server {
    address: SocketAddr,
    credentials: Credentials,
    host: Host,
    last_caller: Arc<Mutex<Option<Caller>>>,
    serving: tokio::task::JoinHandle<()>,
}

/// Somebody who connects.
pub struct Visitor {
    config: Arc<ClientConfig>,
}

// === impl Site ===

impl Site {
    pub fn new() -> Self {
        let mut params = CertificateParams::default();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let key = KeyPair::generate().unwrap();
        let site = Self {
            folder: tempfile::tempdir().unwrap(),
            authority: CertifiedIssuer::self_signed(params, key).unwrap(),
        };
        std::fs::write(site.folder.path().join("ca.pem"), site.authority.pem()).unwrap();
        site
    }

    pub async fn server(&self) -> Server {
        self.server_as(Holder::new("server", Role::Service)).await
    }

    pub async fn server_as(&self, holder: Holder) -> Server {
        let files = self.files("server");
        self.write(&files, holder);
        Server::start(&files).await
    }

    fn files(&self, name: &str) -> TlsConfig {
        let path = |end: &str| self.folder.path().join(format!("{name}{end}"));
        TlsConfig {
            certificate: path(".pem"),
            key: path(".key"),
            client_ca: self.folder.path().join("ca.pem"),
        }
    }

    pub fn files_of(&self, holder: Holder) -> TlsConfig {
        let files = self.files("holder");
        self.write(&files, holder);
        files
    }

    pub fn write(&self, files: &TlsConfig, holder: Holder) {
        let (certificate, key) = self.issue(holder);
        replace(&files.key, &key);
        replace(&files.certificate, &certificate);
    }

    pub fn damage_server_key(&self) {
        replace(&self.files("server").key, "no key");
    }

    pub fn renew_server(&self) {
        self.write(&self.files("server"), Holder::new("server", Role::Service));
    }

    /// Puts this site's authority and a server certificate of it in the place of another's.
    pub fn write_server_files(&self, other: &Site) {
        let files = other.files("server");
        self.write(&files, Holder::new("server", Role::Service));
        replace(&files.client_ca, &self.authority.pem());
    }

    fn issue(&self, holder: Holder) -> (String, String) {
        let mut params = CertificateParams::new(vec!["localhost".to_owned()]).unwrap();
        let uris = holder
            .uris
            .iter()
            .map(|uri| Ia5String::try_from(uri.as_str()).unwrap());
        params.subject_alt_names.extend(uris.map(SanType::URI));
        params.not_before = holder.not_before;
        params.not_after = holder.not_after;
        params.extended_key_usages = holder.usages;
        let key = KeyPair::generate().unwrap();
        let certificate = if holder.self_signed {
            params.self_signed(&key)
        } else {
            params.signed_by(&key, &self.authority)
        };
        (certificate.unwrap().pem(), key.serialize_pem())
    }

    pub fn visitor(&self, holder: Holder) -> Visitor {
        self.visitor_by(holder, &rustls::version::TLS13)
    }

    pub fn visitor_by(
        &self,
        holder: Holder,
        version: &'static SupportedProtocolVersion,
    ) -> Visitor {
        let (certificate, key) = self.issue(holder);
        let certificate = CertificateDer::from_pem_slice(certificate.as_bytes()).unwrap();
        let key = PrivateKeyDer::from_pem_slice(key.as_bytes()).unwrap();
        let config = self
            .client(version)
            .with_client_auth_cert(vec![certificate], key);
        Visitor::new(config.unwrap())
    }

    pub fn anonymous(&self, version: &'static SupportedProtocolVersion) -> Visitor {
        Visitor::new(self.client(version).with_no_client_auth())
    }

    fn client(
        &self,
        version: &'static SupportedProtocolVersion,
    ) -> rustls::ConfigBuilder<ClientConfig, rustls::client::WantsClientCert> {
        let mut roots = RootCertStore::empty();
        roots.add(self.authority.der().clone()).unwrap();
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        ClientConfig::builder_with_provider(provider)
            .with_protocol_versions(&[version])
            .unwrap()
            .with_root_certificates(roots)
    }
}

/// As a careful tool does it: at once, whatever reads at the same time.
fn replace(path: &PathBuf, text: &str) {
    let new = path.with_extension("new");
    std::fs::write(&new, text).unwrap();
    std::fs::rename(new, path).unwrap();
}

// === impl Holder ===

impl Holder {
    pub fn new(name: &str, role: Role) -> Self {
        let now = OffsetDateTime::now_utc();
        let mut usages = vec![ExtendedKeyUsagePurpose::ClientAuth];
        if role == Role::Service {
            usages.push(ExtendedKeyUsagePurpose::ServerAuth);
        }
        Self {
            uris: certificate::uris(name, role).unwrap().to_vec(),
            not_before: now - Duration::from_secs(60),
            not_after: now + Duration::from_secs(3600),
            usages,
            self_signed: false,
        }
    }

    pub fn uris(self, uris: &[&str]) -> Self {
        let uris = uris.iter().map(|uri| (*uri).to_owned()).collect();
        Self { uris, ..self }
    }

    pub fn and_uri(mut self, uri: &str) -> Self {
        self.uris.push(uri.to_owned());
        self
    }

    pub fn expired(self) -> Self {
        Self {
            not_before: date_time_ymd(2020, 1, 1),
            not_after: date_time_ymd(2021, 1, 1),
            ..self
        }
    }

    pub fn not_yet_valid(self) -> Self {
        let tomorrow = OffsetDateTime::now_utc() + Duration::from_secs(24 * 3600);
        Self {
            not_before: tomorrow,
            not_after: tomorrow + Duration::from_secs(3600),
            ..self
        }
    }

    pub fn for_seconds(self, seconds: u64) -> Self {
        let not_after = OffsetDateTime::now_utc() + Duration::from_secs(seconds);
        Self { not_after, ..self }
    }

    pub fn for_servers_only(self) -> Self {
        let usages = vec![ExtendedKeyUsagePurpose::ServerAuth];
        Self { usages, ..self }
    }

    pub fn self_signed(self) -> Self {
        Self {
            self_signed: true,
            ..self
        }
    }
}

// === impl Server ===

impl Server {
    async fn start(files: &TlsConfig) -> Self {
        let credentials = Credentials::read(files).unwrap();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let host = Host::alone();
        let guard = GuardLayer {
            certified: true,
            reports: host.reports(),
            stops: Arc::default(),
        };
        let last_caller: Arc<Mutex<Option<Caller>>> = Arc::default();
        let seen = last_caller.clone();
        let noting = move |request: tonic::Request<()>| {
            *seen.lock().unwrap() = Some(Caller::of(request.extensions()));
            Ok(request)
        };
        let (_, health) = tonic_health::server::health_reporter();
        let router = tonic::transport::Server::builder()
            .layer(guard)
            .add_routes(Routes::new(InterceptedService::new(health, noting)));
        let connections = incoming::accept(
            Connections::new(listener, 1024),
            credentials.clone(),
            host.reports(),
        );
        let serving = tokio::spawn(async move {
            router.serve_with_incoming(connections).await.unwrap();
        });
        Self {
            address,
            credentials,
            host,
            last_caller,
            serving,
        }
    }

    pub fn address(&self) -> SocketAddr {
        self.address
    }

    pub fn endpoint(&self) -> Endpoint {
        Endpoint::from_shared(format!("http://{}", self.address)).unwrap()
    }

    pub fn credentials(&self) -> &Credentials {
        &self.credentials
    }

    pub fn refusals(&self) -> broadcast::Receiver<RefusedCall> {
        self.host.refusals()
    }

    /// Who made the last call that the service itself has seen.
    pub fn last_caller(&self) -> Option<Caller> {
        self.last_caller.lock().unwrap().clone()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.serving.abort();
    }
}

// === impl Visitor ===

impl Visitor {
    fn new(mut config: ClientConfig) -> Self {
        config.alpn_protocols = vec![b"h2".to_vec()];
        Self {
            config: Arc::new(config),
        }
    }

    /// The same visitor, who believes the servers of another site.
    pub fn trusting(self, site: &Site) -> Self {
        let resolver = self.config.client_auth_cert_resolver.clone();
        let builder = site.client(&rustls::version::TLS13);
        Self::new(builder.with_client_cert_resolver(resolver))
    }

    /// A channel that connects when first used.
    pub fn channel(&self, server: &Server) -> Channel {
        let (config, address) = (self.config.clone(), server.address);
        let connect = service_fn(move |_| {
            let config = config.clone();
            async move {
                let stream = TcpStream::connect(address).await?;
                let name = ServerName::try_from("localhost").unwrap();
                let connector = TlsConnector::from(config);
                connector.connect(name, stream).await.map(TokioIo::new)
            }
        });
        server.endpoint().connect_with_connector_lazy(connect)
    }

    /// One call over a connection of its own.
    pub async fn checks_health(&self, server: &Server) -> Result<(), Status> {
        health(&self.channel(server)).await
    }
}

/// Asks for the server's health.
pub async fn health(channel: &Channel) -> Result<(), Status> {
    let request = HealthCheckRequest::default();
    HealthClient::new(channel.clone())
        .check(request)
        .await
        .map(drop)
}

/// Watches the server's health.
pub async fn watch_health(channel: &Channel) -> Result<Streaming<HealthCheckResponse>, Status> {
    let request = HealthCheckRequest::default();
    let answer = HealthClient::new(channel.clone()).watch(request).await?;
    Ok(answer.into_inner())
}

/// Calls any method with an empty message.
pub async fn call(channel: &Channel, method: &str) -> Result<(), Status> {
    let mut client = tonic::client::Grpc::new(channel.clone());
    client
        .ready()
        .await
        .map_err(|error| Status::unknown(error.to_string()))?;
    let path = format!("/{method}").parse().unwrap();
    let codec = tonic_prost::ProstCodec::<(), ()>::default();
    client
        .unary(tonic::Request::new(()), path, codec)
        .await
        .map(drop)
}
