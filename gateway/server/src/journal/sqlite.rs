//! The journal in one SQLite file: write-ahead log, `synchronous=FULL`, so that a returned write is
//! on the disk; one connection writes, and a lock file beside it keeps a second gateway out.

use std::fmt::Write as _;
use std::fs::{File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};

use sqlx::any::AnyPoolOptions;
use sqlx::{AnyConnection, AnyPool, Connection as _};

use super::JournalError;
use super::sql::{AuditFile, Dialect, Pools, SqlJournal, Take, guard, migrate};

/// Connections that only read.
const READERS: u32 = 4;
/// What every connection is told. A reader may hold the file for 5 s before a write gives up.
const WRITER: &str = "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA foreign_keys = ON; \
     PRAGMA busy_timeout = 5000";
const READER: &str = "PRAGMA query_only = ON; PRAGMA busy_timeout = 5000";

/// Opens the file, creates it if it is absent, and brings its tables up to date. The file belongs to this gateway,
/// which is in command, until the journal is dropped.
pub async fn open(path: &Path, name: &str) -> Result<SqlJournal, JournalError> {
    let lock = lock(path)?;
    let unusable = |problem: String| JournalError::Unusable {
        path: path.to_owned(),
        problem,
    };
    let address = address(path).map_err(&unusable)?;
    let for_writing = format!("{address}?mode=rwc");
    // A pool would try again what cannot succeed.
    let damage = damage(&for_writing)
        .await
        .map_err(|error| unusable(error.to_string()))?;
    if damage != "ok" {
        return Err(unusable(damage));
    }
    let writer = pool(1, &for_writing, WRITER)
        .await
        .map_err(|error| unusable(error.to_string()))?;
    migrate(&writer, Dialect::Sqlite)
        .await
        .map_err(|error| unusable(error.to_string()))?;
    guard(&writer, Dialect::Sqlite)
        .await
        .map_err(|error| unusable(error.to_string()))?;
    let readers = pool(READERS, &format!("{address}?mode=ro"), READER)
        .await
        .map_err(|error| unusable(error.to_string()))?;
    let pools = Pools {
        keeper: writer.clone(),
        writer,
        readers,
    };
    let journal = SqlJournal::new(pools, Dialect::Sqlite, Some(lock));
    journal.take_command(name, Take::AtOnce).await?;
    Ok(journal)
}

/// What a look at every page finds: "ok", or the first damage.
async fn damage(address: &str) -> sqlx::Result<String> {
    // Again and again is the same as once.
    sqlx::any::install_default_drivers();
    let mut connection = AnyConnection::connect(address).await?;
    sqlx::raw_sql(WRITER).execute(&mut connection).await?;
    let damage = sqlx::query_scalar("PRAGMA quick_check(1)")
        .fetch_one(&mut connection)
        .await?;
    connection.close().await?;
    Ok(damage)
}

/// The audit in the file at `path`, which must be there. A gateway may be running on it.
pub async fn audit(path: &Path) -> Result<AuditFile, JournalError> {
    let unusable = |problem: String| JournalError::Unusable {
        path: path.to_owned(),
        problem,
    };
    let address = address(path).map_err(&unusable)?;
    // Again and again is the same as once.
    sqlx::any::install_default_drivers();
    let pool = pool(1, &format!("{address}?mode=ro"), READER).await;
    pool.map(AuditFile::new)
        .map_err(|error| unusable(error.to_string()))
}

async fn pool(connections: u32, address: &str, setting: &'static str) -> sqlx::Result<AnyPool> {
    AnyPoolOptions::new()
        .max_connections(connections)
        .idle_timeout(None)
        .max_lifetime(None)
        .after_connect(move |connection, _| {
            Box::pin(async move {
                sqlx::raw_sql(setting).execute(connection).await?;
                Ok(())
            })
        })
        .after_release(|connection, _| {
            Box::pin(async move {
                // A write that a full disk ended cannot be taken back either: sqlx then holds its transaction for open,
                // though the database has ended it, and the connection is of no more use.
                connection.ping().await?;
                Ok(!connection.is_in_transaction())
            })
        })
        .connect(address)
        .await
}

/// The path as an address: absolute, and every byte that means something in an address written as %xx.
fn address(path: &Path) -> Result<String, String> {
    let absolute = std::path::absolute(path).map_err(|error| error.to_string())?;
    let text = absolute
        .to_str()
        .ok_or_else(|| "its path is not UTF-8".to_owned())?;
    let mut address = "sqlite://".to_owned();
    for byte in text.bytes() {
        if byte.is_ascii_alphanumeric() || b"/._-".contains(&byte) {
            address.push(char::from(byte));
        } else {
            write!(address, "%{byte:02X}").map_err(|error| error.to_string())?;
        }
    }
    Ok(address)
}
/// Takes the file `<journal>.lock`, and so makes sure that the folder can be written.
fn lock(path: &Path) -> Result<File, JournalError> {
    let unwritable = |source| JournalError::Unwritable {
        path: path.to_owned(),
        source,
    };
    let mut lock_path = path.as_os_str().to_owned();
    lock_path.push(".lock");
    let lock = OpenOptions::new()
        .create(true)
        .truncate(false)
        .write(true)
        .open(PathBuf::from(lock_path))
        .map_err(unwritable)?;
    match lock.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            return Err(JournalError::InUse {
                path: path.to_owned(),
            });
        }
        Err(TryLockError::Error(error)) => return Err(unwritable(error)),
    }
    // SQLite opens a file that it may not write read-only without a word.
    if path.exists() {
        OpenOptions::new()
            .append(true)
            .open(path)
            .map_err(unwritable)?;
    }
    Ok(lock)
}
