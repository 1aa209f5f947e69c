//! From the command line to a running server and down again.

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser};

use crate::config::{self, Sources, TlsConfig};
use crate::host::Host;
use crate::identity::Role;
use crate::tls::Credentials;
use crate::{BoxError, Service, serve, telemetry};

/// How a server's process ends (codes of sysexits.h).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExitStatus {
    /// Drained after a signal.
    Done,
    /// Wrong flags or configuration (64).
    Usage,
    /// A device, file or port kept it from starting (69).
    Unavailable,
}

impl From<ExitStatus> for ExitCode {
    fn from(status: ExitStatus) -> Self {
        match status {
            ExitStatus::Done => Self::SUCCESS,
            ExitStatus::Usage => Self::from(64),
            ExitStatus::Unavailable => Self::from(69),
        }
    }
}

/// Flags of every server.
#[derive(Debug, Parser)]
#[command(version)]
struct Flags {
    #[command(flatten)]
    sources: Sources,
    /// Prints the effective configuration as TOML and exits.
    #[arg(long)]
    dump_config: bool,
    /// Drains when standard input closes, so that a server never outlives what started it.
    #[arg(long)]
    until_stdin_closes: bool,
}

/// The whole `main` of a server.
pub fn main<S: Service>() -> ExitCode {
    run::<S>(std::env::args_os()).into()
}

/// Runs a server with these arguments, the first being the program's name.
pub fn run<S: Service>(arguments: impl IntoIterator<Item = OsString>) -> ExitStatus {
    let command = Flags::command().name(S::NAME).after_help(S::HELP_AFTER);
    let flags = match command
        .try_get_matches_from(arguments)
        .and_then(|matches| Flags::from_arg_matches(&matches))
    {
        Ok(flags) => flags,
        Err(error) => {
            // Help and version come this way too; a closed terminal is no reason to fail.
            error.print().ok();
            return if error.use_stderr() {
                ExitStatus::Usage
            } else {
                ExitStatus::Done
            };
        }
    };
    let loaded = match config::load::<S>(&flags.sources) {
        Ok(loaded) => loaded,
        Err(error) => return fail::<S>(ExitStatus::Usage, &error),
    };
    if flags.dump_config {
        return match config::dump::<S>(&loaded) {
            Ok(text) => {
                print_line(text.trim_end());
                ExitStatus::Done
            }
            Err(error) => fail::<S>(ExitStatus::Usage, &error),
        };
    }
    if let Err(error) = telemetry::install(&loaded.server) {
        return fail::<S>(ExitStatus::Usage, &error);
    }
    let runtime = match tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
    {
        Ok(runtime) => runtime,
        Err(error) => return fail::<S>(ExitStatus::Unavailable, &error.into()),
    };
    let outcome = runtime.block_on(start::<S>(loaded, flags.until_stdin_closes));
    // Owner tasks may hold blocking work; the process must not wait for it.
    runtime.shutdown_background();
    match outcome {
        Ok(()) => ExitStatus::Done,
        Err(error) => fail::<S>(ExitStatus::Unavailable, &error),
    }
}

async fn start<S: Service>(
    loaded: config::Loaded<S::Config>,
    until_stdin_closes: bool,
) -> Result<(), BoxError> {
    let server = loaded.server;
    let credentials = match &server.tls {
        Some(files) => Some(own_credentials(files)?),
        None => None,
    };
    let (source, host) = Host::channel(credentials.clone());
    let reports = host.reports();
    let routes = Box::pin(S::build(loaded.service, host)).await?;
    Box::pin(serve::serve::<S>(
        server,
        routes,
        credentials,
        reports,
        source,
        until_stdin_closes,
    ))
    .await
}

fn own_credentials(files: &TlsConfig) -> Result<Credentials, BoxError> {
    let credentials = Credentials::read(files)?;
    let holder = credentials.holder();
    if holder.role != Role::Service {
        return Err(format!(
            "server.tls.certificate {} carries the role {}; a server's must carry service",
            files.certificate.display(),
            holder.role
        )
        .into());
    }
    Ok(credentials)
}

fn fail<S: Service>(status: ExitStatus, error: &BoxError) -> ExitStatus {
    // Telemetry may not be up, and a person is reading: print plainly, with every cause.
    let mut text = format!("arthro-{}: {error}", S::NAME);
    let mut cause = error.source();
    while let Some(inner) = cause {
        text.push_str(&format!(": {inner}"));
        cause = inner.source();
    }
    use std::io::Write as _;
    writeln!(std::io::stderr(), "{text}").ok();
    status
}

/// Standard output carries what programs read: the dumped configuration and the announced address.
pub(crate) fn print_line(line: &str) {
    use std::io::Write as _;
    let mut out = std::io::stdout();
    writeln!(out, "{line}").and_then(|()| out.flush()).ok();
}
