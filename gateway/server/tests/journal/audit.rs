//! The audit as the databases keep it: one chain, whoever writes it.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use arthro_gateway::audit::entry::Tail;
use arthro_gateway::audit::key::{PublicKey, SigningKey};
use arthro_gateway::audit::read::JournalCheck;
use arthro_gateway::audit::verify::{Defect, Head};
use arthro_gateway::audit::{Audit, Entry, Kind, Options, Who, heads};
use arthro_gateway::journal::{AuditFilter, Journal};
use tempfile::TempDir;

use crate::store::{Store, on_both};

/// No event of a test takes longer.
const PATIENCE: Duration = Duration::from_secs(60);

on_both! {
    two_gateways_write_one_chain,
    the_next_gateway_goes_on_where_the_chain_ends,
    what_was_recorded_is_neither_changed_nor_deleted_nor_written_twice,
}

/// One gateway's part in the audit.
struct Writer {
    audit: Audit,
    public: PublicKey,
    heads: PathBuf,
}

impl Writer {
    async fn new(journal: Arc<dyn Journal>, folder: &Path, name: &str) -> Self {
        let key = SigningKey::fleeting().unwrap();
        let public = key.public().clone();
        let heads = folder.join(name);
        let options = Options {
            key,
            trusted: Vec::new(),
            heads: heads.clone(),
            heads_sync: Duration::from_secs(1),
        };
        Self {
            audit: Audit::open(journal, options).await.unwrap(),
            public,
            heads,
        }
    }

    async fn record(&self, entries: usize) {
        for index in 0..entries {
            let mut entry = Entry::new(1, Kind::Command, Who::gateway());
            // What a text may hold, and what PostgreSQL's cannot.
            entry.detail = format!("é {index}\0");
            self.audit.record(entry).await.unwrap();
        }
    }

    fn heads(&self) -> Vec<Head> {
        heads::parse(&std::fs::read_to_string(&self.heads).unwrap()).unwrap()
    }
}

async fn check(journal: &dyn Journal, writers: &[Writer]) -> Result<Tail, Defect> {
    let keys = writers.iter().map(|writer| writer.public.clone()).collect();
    let heads = writers.iter().flat_map(Writer::heads).collect();
    JournalCheck::new(journal, keys, heads).run().await.unwrap()
}

async fn two_gateways_write_one_chain(store: Store) {
    const EACH: usize = 120;
    let folder = TempDir::new().unwrap();
    let first = store.open().await;
    // A file has one gateway; its two writers then share the connection and nothing else.
    let second = match &store {
        Store::Sqlite(_) => first.clone(),
        Store::Postgres(_) => store.try_open("the standby").await.unwrap(),
    };
    let writers = [
        Writer::new(first.clone(), folder.path(), "first").await,
        Writer::new(second, folder.path(), "second").await,
    ];
    let writing = async { tokio::join!(writers[0].record(EACH), writers[1].record(EACH)) };
    tokio::time::timeout(PATIENCE, writing).await.unwrap();
    let tail = check(first.as_ref(), &writers).await.unwrap();
    assert_eq!(tail.sequence, 2 * EACH as u64);
    let rows = first.audit(&AuditFilter::default(), 1000).await.unwrap();
    let key = |index: usize| rows[index].link.as_ref().unwrap().key.clone();
    let changes = (1..rows.len()).filter(|&index| key(index) != key(index - 1));
    println!(
        "the writer of {} entries changed {} times",
        rows.len(),
        changes.count()
    );
}

async fn the_next_gateway_goes_on_where_the_chain_ends(store: Store) {
    let folder = TempDir::new().unwrap();
    let journal = store.open().await;
    let before = Writer::new(journal.clone(), folder.path(), "before").await;
    before.record(3).await;
    let journal = match store {
        // The first writer's task keeps the file from being opened anew.
        Store::Sqlite(_) => journal,
        Store::Postgres(_) => store.reopen(journal).await,
    };
    let after = Writer::new(journal.clone(), folder.path(), "after").await;
    after.record(3).await;
    let tail = check(journal.as_ref(), &[before, after]).await.unwrap();
    assert_eq!(tail.sequence, 6);
}

async fn what_was_recorded_is_neither_changed_nor_deleted_nor_written_twice(store: Store) {
    let folder = TempDir::new().unwrap();
    let journal = store.open().await;
    let writer = Writer::new(journal.clone(), folder.path(), "heads").await;
    writer.record(2).await;
    let rows = journal.audit(&AuditFilter::default(), 10).await.unwrap();
    let last = rows[1].link.clone().unwrap();
    assert!(journal.append_audit(&|_| vec![last.clone()]).await.is_err());
    for statement in ["UPDATE audit SET detail = 'x'", "DELETE FROM audit"] {
        let refused = store.execute(statement).await.unwrap_err();
        assert!(refused.to_string().contains("append only"), "{refused}");
    }
    let tail = check(journal.as_ref(), &[writer]).await.unwrap();
    assert_eq!(tail.sequence, 2);
}
