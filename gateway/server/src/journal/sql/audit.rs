//! The audit's table. Rows are only ever added; whoever tries otherwise through the database meets a trigger. Writes are
//! not fenced: a gateway that is not in command refuses and stops, and that is recorded too.

use sqlx::any::AnyRow;
use sqlx::{AnyConnection, AnyPool, Connection as _, Row as _};

use super::{Dialect, rows};
use crate::approval::Digest;
use crate::audit::entry::{Entry, GENESIS, Kind, Link, Tail, Who};
use crate::audit::key::KeyId;
use crate::audit::read::Entries;
use crate::journal::{AuditFilter, AuditRow, JournalError};

const INSERT: &str = "INSERT INTO audit (sequence, previous, at_ms, kind, name, role, peer, stated, method, case_id, \
     procedure_id, request_digest, plan_digest, answers, code, reason, detail, hash, key_id, signature) \
     VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14, $15, $16, $17, $18, $19, $20)";

/// An empty text in a filter matches everything.
const SELECT: &str = "SELECT * FROM audit WHERE sequence >= $1 AND sequence <= $2 AND ($3 = '' OR kind = $4) \
     AND ($5 = '' OR name = $6 OR stated = $7) AND ($8 = '' OR case_id = $9) AND ($10 = '' OR procedure_id = $11) \
     AND at_ms >= $12 AND at_ms <= $13";

/// It stops a mistake; whoever means harm is found by the chain.
const APPEND_ONLY_IN_SQLITE: &str = "CREATE TRIGGER IF NOT EXISTS audit_is_not_changed BEFORE UPDATE ON audit \
     BEGIN SELECT RAISE(ABORT, 'the audit is append only'); END; \
     CREATE TRIGGER IF NOT EXISTS audit_is_not_deleted BEFORE DELETE ON audit \
     BEGIN SELECT RAISE(ABORT, 'the audit is append only'); END";
/// The lock keeps two gateways that start at once apart.
const APPEND_ONLY_IN_POSTGRES: &str = "DO $guard$ BEGIN \
     PERFORM pg_advisory_xact_lock(7220105); \
     IF NOT EXISTS (SELECT 1 FROM pg_trigger \
         WHERE tgname = 'audit_is_append_only' AND tgrelid = 'audit'::regclass) THEN \
       CREATE OR REPLACE FUNCTION audit_is_append_only() RETURNS trigger LANGUAGE plpgsql AS \
         'BEGIN RAISE EXCEPTION ''the audit is append only''; END'; \
       CREATE TRIGGER audit_is_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON audit \
         FOR EACH STATEMENT EXECUTE FUNCTION audit_is_append_only(); \
     END IF; END $guard$";

/// Has the database itself refuse what no gateway does.
pub async fn guard(pool: &AnyPool, dialect: Dialect) -> Result<(), sqlx::Error> {
    let triggers = match dialect {
        Dialect::Sqlite => APPEND_ONLY_IN_SQLITE,
        Dialect::Postgres => APPEND_ONLY_IN_POSTGRES,
    };
    sqlx::raw_sql(triggers).execute(pool).await?;
    Ok(())
}

/// Keeps gateways on one server apart while one of them appends; whoever waits is served in turn.
const LOCK_IN_POSTGRES: &str = "SELECT pg_advisory_xact_lock(7220106)";

/// Adds what `link` makes of the chain's end, all or none. An SQLite file has one connection that writes.
pub async fn append(
    pool: &AnyPool,
    dialect: Dialect,
    link: &(dyn Fn(Tail) -> Vec<Link> + Sync),
) -> Result<(), JournalError> {
    let mut connection = pool.acquire().await?;
    // On an SQLite file a transaction that read before it writes does not wait for its turn to write.
    let known = match dialect {
        Dialect::Sqlite => Some(tail(&mut connection).await?),
        Dialect::Postgres => None,
    };
    let mut transaction = connection.begin().await?;
    let end = match known {
        Some(end) => end,
        None => {
            sqlx::raw_sql(LOCK_IN_POSTGRES)
                .execute(&mut *transaction)
                .await?;
            tail(&mut transaction).await?
        }
    };
    let links = link(end);
    for link in &links {
        let entry = &link.entry;
        sqlx::query(INSERT)
            .bind(rows::integer(link.sequence))
            .bind(link.previous.as_bytes().to_vec())
            .bind(entry.at_ms)
            .bind(entry.kind.as_str())
            .bind(&entry.who.name)
            .bind(&entry.who.role)
            .bind(&entry.who.peer)
            .bind(&entry.stated)
            .bind(&entry.method)
            .bind(&entry.case_id)
            .bind(&entry.procedure_id)
            .bind(bytes(entry.request))
            .bind(bytes(entry.plan))
            .bind(rows::integer(entry.answers))
            .bind(&entry.code)
            .bind(&entry.reason)
            .bind(&entry.detail)
            .bind(link.hash.as_bytes().to_vec())
            .bind(link.key.as_str())
            .bind(link.signature.to_vec())
            .execute(&mut *transaction)
            .await?;
    }
    Ok(transaction.commit().await?)
}

/// Where the chain ends.
async fn tail(connection: &mut AnyConnection) -> Result<Tail, JournalError> {
    let row = sqlx::query("SELECT sequence, hash FROM audit ORDER BY sequence DESC LIMIT 1")
        .fetch_optional(connection)
        .await?;
    let Some(row) = row else {
        return Ok(Tail::EMPTY);
    };
    Ok(Tail {
        sequence: row.try_get::<i64, _>("sequence")?.unsigned_abs(),
        // A damaged end is found by whoever checks; the chain goes on all the same.
        hash: digest(&row.try_get::<Vec<u8>, _>("hash")?).unwrap_or(GENESIS),
    })
}

/// The hash of one entry.
pub async fn hash(pool: &AnyPool, sequence: u64) -> Result<Option<Digest>, JournalError> {
    let hash: Option<Vec<u8>> = sqlx::query_scalar("SELECT hash FROM audit WHERE sequence = $1")
        .bind(rows::integer(sequence))
        .fetch_optional(pool)
        .await?;
    Ok(hash.as_deref().and_then(digest))
}

/// The audit in a journal file: read and never written, a gateway may be running on it.
#[derive(Debug)]
pub struct AuditFile(AnyPool);

impl AuditFile {
    /// Of a pool that only reads.
    pub(in crate::journal) fn new(pool: AnyPool) -> Self {
        Self(pool)
    }
}

#[tonic::async_trait]
impl Entries for AuditFile {
    async fn entries(
        &self,
        filter: &AuditFilter,
        limit: u32,
    ) -> Result<Vec<AuditRow>, JournalError> {
        select(&self.0, filter, limit).await
    }
}

/// At most `limit` of the entries that the filter lets through.
pub async fn select(
    pool: &AnyPool,
    filter: &AuditFilter,
    limit: u32,
) -> Result<Vec<AuditRow>, JournalError> {
    let order = match filter.newest_first {
        true => "DESC",
        false => "ASC",
    };
    let query = sqlx::AssertSqlSafe(format!("{SELECT} ORDER BY sequence {order} LIMIT {limit}"));
    let kind = filter.kind.map_or("", Kind::as_str);
    let mut query = sqlx::query(query)
        .bind(rows::integer(filter.first))
        .bind(rows::integer(filter.last));
    for (text, times) in [
        (kind, 2),
        (filter.name.as_str(), 3),
        (filter.case_id.as_str(), 2),
        (filter.procedure_id.as_str(), 2),
    ] {
        for _ in 0..times {
            query = query.bind(text);
        }
    }
    let rows = query
        .bind(filter.from_ms)
        .bind(filter.to_ms)
        .fetch_all(pool)
        .await?;
    rows.iter().map(row).collect()
}

fn row(row: &AnyRow) -> Result<AuditRow, JournalError> {
    let sequence = row.try_get::<i64, _>("sequence")?.unsigned_abs();
    Ok(AuditRow {
        sequence,
        link: link(row, sequence).map_err(|problem| problem.to_string()),
    })
}

/// What cannot be read is handed on as it is: it is the check's to say what that means.
fn link(row: &AnyRow, sequence: u64) -> Result<Link, Box<dyn std::error::Error>> {
    let kind: String = row.try_get("kind")?;
    let digest_of = |column: &str| -> Result<Digest, Box<dyn std::error::Error>> {
        let bytes: Vec<u8> = row.try_get(column)?;
        Ok(digest(&bytes)
            .ok_or_else(|| format!("{column} has {} bytes instead of 32", bytes.len()))?)
    };
    let optional = |column: &str| -> Result<Option<Digest>, Box<dyn std::error::Error>> {
        let bytes: Vec<u8> = row.try_get(column)?;
        match bytes.is_empty() {
            true => Ok(None),
            false => digest_of(column).map(Some),
        }
    };
    let signature: Vec<u8> = row.try_get("signature")?;
    Ok(Link {
        sequence,
        previous: digest_of("previous")?,
        entry: Entry {
            at_ms: row.try_get("at_ms")?,
            kind: Kind::parse(&kind).ok_or_else(|| format!("kind is {kind:?}"))?,
            who: Who {
                name: row.try_get("name")?,
                role: row.try_get("role")?,
                peer: row.try_get("peer")?,
            },
            stated: row.try_get("stated")?,
            method: row.try_get("method")?,
            case_id: row.try_get("case_id")?,
            procedure_id: row.try_get("procedure_id")?,
            request: optional("request_digest")?,
            plan: optional("plan_digest")?,
            answers: u64::try_from(row.try_get::<i64, _>("answers")?)?,
            code: row.try_get("code")?,
            reason: row.try_get("reason")?,
            detail: row.try_get("detail")?,
        },
        hash: digest_of("hash")?,
        key: KeyId::from_text(row.try_get::<String, _>("key_id")?),
        signature: signature.try_into().map_err(|bytes: Vec<u8>| {
            format!("signature has {} bytes instead of 64", bytes.len())
        })?,
    })
}

fn bytes(digest: Option<Digest>) -> Vec<u8> {
    digest.map_or_else(Vec::new, |digest| digest.as_bytes().to_vec())
}

fn digest(bytes: &[u8]) -> Option<Digest> {
    bytes.try_into().ok().map(Digest::from_bytes)
}
