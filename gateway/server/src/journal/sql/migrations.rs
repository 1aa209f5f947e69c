//! One set of migrations for both databases. They are written for SQLite; PostgreSQL gets them with the names of its
//! types, and without the word STRICT, which it does not need.

use sqlx::migrate::{MigrateError, Migration, Migrator};
use sqlx::{AnyPool, AssertSqlSafe, SqlSafeStr as _};

use super::Dialect;

static WRITTEN: Migrator = sqlx::migrate!("./migrations");

/// SQLite's word and PostgreSQL's. Other types are not used.
const TYPES: [(&str, &str); 4] = [
    ("INTEGER", "BIGINT"),
    ("REAL", "DOUBLE PRECISION"),
    ("BLOB", "BYTEA"),
    ("STRICT", ""),
];

/// Brings the tables up to date.
pub async fn migrate(pool: &AnyPool, dialect: Dialect) -> Result<(), MigrateError> {
    match dialect {
        Dialect::Sqlite => WRITTEN.run(pool).await,
        Dialect::Postgres => translated().run(pool).await,
    }
}

fn translated() -> Migrator {
    let migrations = WRITTEN
        .iter()
        .map(|written| {
            Migration::new(
                written.version,
                written.description.clone(),
                written.migration_type,
                AssertSqlSafe(for_postgres(written.sql.as_str())).into_sql_str(),
                written.no_tx,
            )
        })
        .collect();
    Migrator::with_migrations(migrations)
}

/// Words outside of texts, quoted names and comments are translated, everything else stays.
fn for_postgres(sqlite: &str) -> String {
    let mut translated = String::with_capacity(sqlite.len());
    let mut rest = sqlite;
    while let Some(first) = rest.chars().next() {
        let length = match first {
            '\'' | '"' => quoted(rest, first),
            '-' if rest.starts_with("--") => rest.find('\n').unwrap_or(rest.len()),
            letter if is_of_word(letter) => rest
                .find(|character| !is_of_word(character))
                .unwrap_or(rest.len()),
            other => other.len_utf8(),
        };
        let (token, after) = rest.split_at(length);
        let word = TYPES.iter().find(|(ours, _)| *ours == token);
        translated.push_str(word.map_or(token, |(_, theirs)| theirs));
        rest = after;
    }
    translated
}

/// Bytes of a quoted text from its first to its last quote; a doubled quote begins the next one.
fn quoted(text: &str, quote: char) -> usize {
    text[1..].find(quote).map_or(text.len(), |end| end + 2)
}

fn is_of_word(character: char) -> bool {
    character.is_alphanumeric() || character == '_'
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_are_translated_and_nothing_else() {
        let sqlite = "CREATE TABLE t ( -- STRICT about REAL things\n  \
             a INTEGER, b REAL CHECK (b <> 0.5), c BLOB, REALM TEXT DEFAULT 'it''s a BLOB'\n) STRICT;\n";
        let postgres = "CREATE TABLE t ( -- STRICT about REAL things\n  \
             a BIGINT, b DOUBLE PRECISION CHECK (b <> 0.5), c BYTEA, REALM TEXT DEFAULT 'it''s a BLOB'\n) ;\n";
        assert_eq!(for_postgres(sqlite), postgres);
    }

    #[test]
    fn an_unfinished_text_is_left_as_it_is() {
        assert_eq!(for_postgres("SELECT 'REAL"), "SELECT 'REAL");
        assert_eq!(for_postgres("REAL -- REAL"), "DOUBLE PRECISION -- REAL");
    }
}
