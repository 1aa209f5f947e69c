//! Log lines on standard error, for people or as JSON.

use tracing_subscriber::EnvFilter;

use crate::BoxError;
use crate::config::{LogFormat, ServerConfig};

/// Installs the process' subscriber. A second call in one process changes nothing.
pub(crate) fn install(server: &ServerConfig) -> Result<(), BoxError> {
    let filter = EnvFilter::try_new(&server.log_filter)
        .map_err(|error| format!("server.log_filter {:?}: {error}", server.log_filter))?;
    let builder = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr);
    // Already installed means that somebody embeds this server and logs in their own way.
    match server.log {
        LogFormat::Human => builder.try_init().ok(),
        LogFormat::Json => builder.json().flatten_event(true).try_init().ok(),
    };
    Ok(())
}
