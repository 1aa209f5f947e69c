//! Configuration: defaults, then a TOML file, then the environment, then flags; the later one wins.
//!
//! The file has one section a service, so that one file describes a whole cell. Environment
//! variables are `ARTHRO_<SERVICE>__<KEY>`, with `__` between the levels of nested keys. An unknown
//! key is an error: a typing mistake in a limit must not pass silently.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;

use figment::Figment;
use figment::providers::{Env, Format, Serialized, Toml};
use figment::value::{Dict, Value};
use serde::{Deserialize, Serialize};

use crate::{BoxError, Service};

/// No server is asked for more calls, connections or streams at the same time.
const COUNT_MAX: usize = 1_000_000;

/// The `server` part of every service's section.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ServerConfig {
    /// Where to listen; port 0 takes a free one, which is announced on standard output.
    pub listen: SocketAddr,
    /// Log lines for people or as JSON.
    pub log: LogFormat,
    /// What to log, in the syntax of `tracing-subscriber`'s `EnvFilter`.
    pub log_filter: String,
    /// Calls that may be worked on at the same time; more are refused with RESOURCE_EXHAUSTED.
    pub max_calls: usize,
    /// Connections at the same time. One more is taken, and the one that has been silent for longest is closed.
    pub max_connections: usize,
    /// Answers that may be open at the same time, idle watches among them; more are refused with RESOURCE_EXHAUSTED.
    pub max_streams: usize,
    /// Deadline of calls that bring none, s. Streams that only watch are not bounded by it.
    pub default_deadline_s: f64,
    /// How long open calls may go on once the shutdown began, s.
    pub drain_s: f64,
    /// Certificates, by which both sides of every connection are known; without them only loopback addresses may be bound.
    pub tls: Option<TlsConfig>,
}

/// Files of a TLS identity, PEM. They may be replaced at any time; the next connection uses them.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TlsConfig {
    /// The own certificate chain; it names a holder and a role.
    pub certificate: PathBuf,
    /// Its private key.
    pub key: PathBuf,
    /// The authorities that certificates of others must come from: those of clients, and of servers that this one calls.
    pub client_ca: PathBuf,
}

/// How log lines look.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum LogFormat {
    /// For a terminal.
    Human,
    /// One JSON object a line.
    Json,
}

impl Default for ServerConfig {
    fn default() -> Self {
        Self {
            listen: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 0),
            log: LogFormat::Human,
            log_filter: "info".to_owned(),
            max_calls: 256,
            max_connections: 1024,
            max_streams: 16_384,
            default_deadline_s: 600.0,
            drain_s: 3.0,
            tls: None,
        }
    }
}

/// Where the configuration of one start comes from.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Sources {
    /// Configuration file (TOML, one section a service).
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Address to listen on; port 0 takes a free one.
    #[arg(long, value_name = "ADDRESS")]
    pub listen: Option<SocketAddr>,
    /// Sets one key of the service's section, e.g. --set server.max_calls=64 (TOML value).
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Form of the log lines.
    #[arg(long, value_enum)]
    pub log: Option<LogFormat>,
}

/// What a start was configured with.
#[derive(Debug)]
pub(crate) struct Loaded<C> {
    pub server: ServerConfig,
    pub service: C,
}

/// Reads the section of `S` from all sources.
///
/// # Errors
/// A missing file, a syntax error, an unknown key or a value of the wrong type, named.
pub(crate) fn load<S: Service>(sources: &Sources) -> Result<Loaded<S::Config>, BoxError> {
    let mut section = section_from_file_and_environment::<S>(sources)?;
    let server_value = section.remove("server").unwrap_or(Value::from(Dict::new()));
    let server_defaults = ServerConfig {
        listen: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), S::DEFAULT_PORT),
        ..ServerConfig::default()
    };
    let mut server: ServerConfig = Figment::from(Serialized::defaults(server_defaults))
        .merge(Serialized::defaults(server_value))
        .extract()
        .map_err(|error| format!("[{}.server]: {error}", S::NAME))?;
    if let Some(listen) = sources.listen {
        server.listen = listen;
    }
    if let Some(log) = sources.log {
        server.log = log;
    }
    check(&server)?;
    let service = Figment::from(Serialized::defaults(S::Config::default()))
        .merge(Serialized::defaults(Value::from(section)))
        .extract()
        .map_err(|error| format!("[{}]: {error}", S::NAME))?;
    Ok(Loaded { server, service })
}

fn section_from_file_and_environment<S: Service>(sources: &Sources) -> Result<Dict, BoxError> {
    let mut figment = Figment::new();
    if let Some(path) = &sources.config {
        if !path.is_file() {
            return Err(format!("configuration file {} does not exist", path.display()).into());
        }
        figment = figment.merge(Toml::file_exact(path));
    }
    let mut section = match figment.find_value(S::NAME) {
        Ok(Value::Dict(_, section)) => section,
        Ok(_) => return Err(format!("[{}] is not a section", S::NAME).into()),
        // An unreadable file and an absent section both end up here; only the first is an error.
        Err(_) => {
            figment.extract::<Dict>().map_err(Box::new)?;
            Dict::new()
        }
    };
    let prefix = format!("ARTHRO_{}__", S::NAME.to_uppercase());
    let mut overrides = Figment::from(Serialized::defaults(Value::from(std::mem::take(
        &mut section,
    ))))
    .merge(Env::prefixed(&prefix).split("__"));
    for assignment in &sources.set {
        let (key, value) = assignment
            .split_once('=')
            .ok_or_else(|| format!("--set {assignment}: expected KEY=VALUE"))?;
        let parsed: Value = match toml::from_str::<toml::Table>(&format!("value = {value}")) {
            Ok(table) => Value::serialize(&table["value"])?,
            // Not a TOML value: take it as a bare string, so that quotes are not needed in a shell.
            Err(_) => Value::from(value),
        };
        overrides = overrides.merge((key, parsed));
    }
    Ok(overrides.extract()?)
}

fn check(server: &ServerConfig) -> Result<(), BoxError> {
    if server.tls.is_none() && !server.listen.ip().is_loopback() {
        return Err(format!(
            "server.listen {} is not a loopback address; without server.tls only loopback may be bound",
            server.listen
        )
        .into());
    }
    for (key, value) in [
        ("drain_s", server.drain_s),
        ("default_deadline_s", server.default_deadline_s),
    ] {
        if !(0.0..=86_400.0).contains(&value) {
            return Err(format!("server.{key} is {value}; it must be within 0 .. 86400").into());
        }
    }
    for (key, value) in [
        ("max_calls", server.max_calls),
        ("max_connections", server.max_connections),
        ("max_streams", server.max_streams),
    ] {
        if !(1..=COUNT_MAX).contains(&value) {
            return Err(
                format!("server.{key} is {value}; it must be within 1 .. {COUNT_MAX}").into(),
            );
        }
    }
    Ok(())
}

/// The effective configuration as the TOML file that would give it.
pub(crate) fn dump<S: Service>(loaded: &Loaded<S::Config>) -> Result<String, BoxError> {
    let mut section = toml::Table::try_from(&loaded.service)?;
    section.insert("server".to_owned(), toml::Value::try_from(&loaded.server)?);
    let mut file = toml::Table::new();
    file.insert(S::NAME.to_owned(), toml::Value::Table(section));
    Ok(toml::to_string(&file)?)
}
