//! Where a test keeps its journal: a file, or a database.

use std::sync::Arc;

use arthro_gateway::journal::{self, Journal, JournalError, Place};
use tempfile::TempDir;

use super::postgres::Database;

pub enum Store {
    Sqlite(TempDir),
    Postgres(Database),
}

impl Store {
    pub fn sqlite() -> Self {
        Self::Sqlite(tempfile::tempdir().unwrap())
    }

    pub async fn postgres() -> Self {
        Self::Postgres(Database::new().await)
    }

    pub fn place(&self) -> Place {
        match self {
            Self::Sqlite(folder) => Place::File(folder.path().join("journal.sqlite")),
            Self::Postgres(database) => Place::Postgres(database.address()),
        }
    }

    pub async fn try_open(&self, name: &str) -> Result<Arc<dyn Journal>, JournalError> {
        journal::open(&self.place(), name).await
    }

    pub async fn open(&self) -> Arc<dyn Journal> {
        self.try_open("gateway of the test").await.unwrap()
    }

    /// As a gateway does that is told to end, and is started again.
    pub async fn reopen(&self, journal: Arc<dyn Journal>) -> Arc<dyn Journal> {
        journal.leave().await.unwrap();
        drop(journal);
        self.open().await
    }
}

/// Each function becomes two tests: one on SQLite, one on PostgreSQL.
macro_rules! on_both {
    ($($statement:ident,)*) => {
        mod on_sqlite {
            use crate::store::Store;
            $(#[tokio::test]
            async fn $statement() {
                super::$statement(Store::sqlite()).await;
            })*
        }
        mod on_postgres {
            use crate::store::Store;
            $(#[tokio::test]
            async fn $statement() {
                super::$statement(Store::postgres().await).await;
            })*
        }
    };
}

pub(crate) use on_both;
