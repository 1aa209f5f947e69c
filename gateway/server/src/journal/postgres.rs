//! The journal in a PostgreSQL database, which several gateways share: one is in command, the others
//! read and wait.

use std::sync::Arc;
use std::time::Duration;

use sqlx::any::AnyPoolOptions;
use sqlx::{AnyConnection, AnyPool, Connection as _};

use super::sql::{Dialect, Pools, SqlJournal, Take, keep, migrate};
use super::{JournalError, Place};

/// Connections that write.
const WRITERS: u32 = 2;
/// Connections that only read.
const READERS: u32 = 4;
/// A server that gives no connection for so long is away.
const ACQUIRE_TIMEOUT: Duration = Duration::from_secs(3);
/// What every connection is told. A returned write is on the disk. A gateway that is halted within a write holds the
/// command row; after a second the server lets go of it, so that another gateway can take command.
const WRITER: &str = "SET synchronous_commit = on; SET idle_in_transaction_session_timeout = 1000; \
     SET lock_timeout = 2000; SET statement_timeout = 10000";
const READER: &str = "SET default_transaction_read_only = on; SET statement_timeout = 10000";

/// Connects, brings the tables up to date, takes command if nobody has it, and keeps it or waits for it from then on.
pub async fn open(server: &str, name: &str) -> Result<Arc<SqlJournal>, JournalError> {
    let failed = |error: sqlx::Error| unusable(server, error.to_string());
    check(server).await?;
    let writer = pool(WRITERS, server, WRITER).await.map_err(failed)?;
    migrate(&writer, Dialect::Postgres)
        .await
        .map_err(|error| unusable(server, error.to_string()))?;
    let pools = Pools {
        writer,
        readers: pool(READERS, server, READER).await.map_err(failed)?,
        keeper: pool(1, server, WRITER).await.map_err(failed)?,
    };
    let journal = Arc::new(SqlJournal::new(pools, Dialect::Postgres, None));
    journal.take_command(name, Take::WhenFree).await?;
    tokio::spawn(keep(Arc::downgrade(&journal), name.to_owned()));
    Ok(journal)
}

/// Whether the server answers, and keeps what it says it has written.
async fn check(server: &str) -> Result<(), JournalError> {
    let unusable = |problem| unusable(server, problem);
    let failed = |error: sqlx::Error| unusable(error.to_string());
    // Again and again is the same as once.
    sqlx::any::install_default_drivers();
    // A pool would try again what cannot succeed.
    let connecting = AnyConnection::connect(server);
    let mut connection = tokio::time::timeout(ACQUIRE_TIMEOUT, connecting)
        .await
        .map_err(|_| unusable(format!("no answer within {} s", ACQUIRE_TIMEOUT.as_secs())))?
        .map_err(failed)?;
    for promise in ["fsync", "full_page_writes"] {
        let kept: String = sqlx::query_scalar("SELECT current_setting($1)")
            .bind(promise)
            .fetch_one(&mut connection)
            .await
            .map_err(failed)?;
        if kept != "on" {
            return Err(unusable(format!(
                "{promise} is {kept}; must be on, or a written step may be lost"
            )));
        }
    }
    connection.close().await.map_err(failed)
}

fn unusable(server: &str, problem: String) -> JournalError {
    JournalError::Server {
        place: Place::Postgres(server.to_owned()).to_string(),
        problem,
    }
}

async fn pool(connections: u32, server: &str, setting: &'static str) -> sqlx::Result<AnyPool> {
    AnyPoolOptions::new()
        .max_connections(connections)
        .acquire_timeout(ACQUIRE_TIMEOUT)
        .after_connect(move |connection, _| {
            Box::pin(async move {
                sqlx::raw_sql(setting).execute(connection).await?;
                Ok(())
            })
        })
        .connect(server)
        .await
}
