//! Reads a whole chain, page by page, and checks it: from the journal of a running gateway, from a journal file beside
//! which nothing runs, or from an export.

use std::io::BufRead;

use super::entry::{Link, Tail};
use super::key::PublicKey;
use super::lines;
use super::verify::{Defect, Head, Verifier};
use crate::journal::{AuditFilter, AuditRow, Journal, JournalError};

/// Entries read in one go.
const PAGE: u32 = 500;

/// Where entries are read from.
#[tonic::async_trait]
pub trait Entries: Send + Sync {
    /// At most `limit` of those that the filter lets through.
    async fn entries(
        &self,
        filter: &AuditFilter,
        limit: u32,
    ) -> Result<Vec<AuditRow>, JournalError>;
}

#[tonic::async_trait]
impl Entries for dyn Journal + '_ {
    async fn entries(
        &self,
        filter: &AuditFilter,
        limit: u32,
    ) -> Result<Vec<AuditRow>, JournalError> {
        self.audit(filter, limit).await
    }
}

/// The entries in order, page by page.
pub struct Pages<'a, E: ?Sized> {
    source: &'a E,
    filter: AuditFilter,
}

/// The check of a journal's chain, page by page.
pub struct JournalCheck<'a, E: ?Sized> {
    pages: Pages<'a, E>,
    verifier: Verifier,
}

/// What a check found: the end of a chain that is whole, or the first defect.
pub type Verdict = Result<Tail, Defect>;

// === impl Pages ===

impl<'a, E: Entries + ?Sized> Pages<'a, E> {
    /// Those that the filter lets through.
    pub fn new(source: &'a E, filter: AuditFilter) -> Self {
        Self { source, filter }
    }

    /// The next page; empty when there is no more.
    pub async fn next(&mut self) -> Result<Vec<AuditRow>, JournalError> {
        let rows = self.source.entries(&self.filter, PAGE).await?;
        if let Some(last) = rows.last() {
            self.filter.first = last.sequence + 1;
        }
        Ok(rows)
    }
}

// === impl JournalCheck ===

impl<'a, E: Entries + ?Sized> JournalCheck<'a, E> {
    /// Of a journal's chain, against these keys and heads.
    pub fn new(source: &'a E, keys: Vec<PublicKey>, heads: Vec<Head>) -> Self {
        Self {
            pages: Pages::new(source, AuditFilter::default()),
            verifier: Verifier::new(keys, heads),
        }
    }

    /// The last entry that was found good.
    pub fn checked(&self) -> u64 {
        self.verifier.tail().sequence
    }

    /// Checks the next page; the verdict once there is one.
    pub async fn next(&mut self) -> Result<Option<Verdict>, JournalError> {
        let rows = self.pages.next().await?;
        if rows.is_empty() {
            return Ok(Some(self.verifier.finish()));
        }
        for row in rows {
            let checked = match &row.link {
                Ok(link) => self.verifier.next(link),
                Err(problem) => Err(self.verifier.unreadable(problem.clone())),
            };
            if let Err(defect) = checked {
                return Ok(Some(Err(defect)));
            }
        }
        Ok(None)
    }

    /// Checks all of it.
    pub async fn run(mut self) -> Result<Verdict, JournalError> {
        loop {
            if let Some(verdict) = self.next().await? {
                return Ok(verdict);
            }
        }
    }
}

/// Checks an export, which may be longer than the memory.
pub fn check_export(
    export: impl BufRead,
    keys: Vec<PublicKey>,
    heads: Vec<Head>,
) -> std::io::Result<Verdict> {
    let mut verifier = Verifier::new(keys, heads);
    for line in export.split(b'\n') {
        let line = line?;
        let checked = match read_line(&line) {
            Ok(link) => verifier.next(&link),
            Err(problem) => Err(verifier.unreadable(problem)),
        };
        if let Err(defect) = checked {
            return Ok(Err(defect));
        }
    }
    Ok(verifier.finish())
}

fn read_line(line: &[u8]) -> Result<Link, String> {
    let text = std::str::from_utf8(line).map_err(|error| error.to_string())?;
    lines::read_entry(text).map_err(|error| error.to_string())
}
