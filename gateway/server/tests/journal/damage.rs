//! A file that a crash left half written, or a disk changed: what is read is the state after one of the writes, never
//! a mix of two.

use std::path::{Path, PathBuf};

use arthro_gateway::journal::{self, Place};
use arthro_gateway::procedure::steps::{BiteOutcome, Kind, Step};
use arthro_gateway::procedure::{Procedure, State};
use sqlx::{AnyConnection, Connection as _, Row as _};
use tempfile::TempDir;

use crate::values::{case, done, outcome, procedure, step};

/// Small pages make a record short, so that every byte of it can be tried.
const PAGE_BYTES: usize = 512;
const WAL_HEADER_BYTES: usize = 32;
const FRAME_BYTES: usize = 24 + PAGE_BYTES;

/// The file, its log, where the last record begins in the log, and what was read after each write.
struct Written {
    folder: TempDir,
    database: Vec<u8>,
    log: Vec<u8>,
    last_record: usize,
    states: Vec<String>,
}

impl Written {
    /// A bite, intended and ended: the last record.
    async fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal.sqlite");
        let mut hand = connect(&path).await;
        let setting = format!(
            "PRAGMA page_size = {PAGE_BYTES}; PRAGMA journal_mode = WAL; CREATE TABLE t (x); DROP TABLE t"
        );
        sqlx::raw_sql(sqlx::AssertSqlSafe(setting))
            .execute(&mut hand)
            .await
            .unwrap();
        let journal = journal::open(&Place::File(path.clone()), "test")
            .await
            .unwrap();
        journal.create_case(&case("c")).await.unwrap();
        let mut performed = procedure("p", "c");
        journal.create_procedure(&performed).await.unwrap();
        sqlx::raw_sql("PRAGMA wal_checkpoint(TRUNCATE)")
            .execute(&mut hand)
            .await
            .unwrap();

        let mut states = vec![state(&mut hand).await];
        let bite = step(1, Kind::Bite, Some(0));
        journal.intend("p", &bite).await.unwrap();
        states.push(state(&mut hand).await);
        let log_path = log_of(&path);
        let last_record = std::fs::metadata(&log_path).unwrap().len() as usize;
        performed.state = State::Paused;
        performed.bites_done = 1;
        journal
            .end_step(&performed, &done(&bite), Some(&outcome(0)))
            .await
            .unwrap();
        states.push(state(&mut hand).await);
        let log = std::fs::read(&log_path).unwrap();
        assert!(log.len() > last_record && last_record > WAL_HEADER_BYTES);
        assert_eq!((log.len() - WAL_HEADER_BYTES) % FRAME_BYTES, 0);
        Self {
            database: std::fs::read(&path).unwrap(),
            log,
            last_record,
            states,
            folder,
        }
    }

    fn before(&self) -> &String {
        &self.states[self.states.len() - 2]
    }

    /// A file as a crash leaves it, with this log.
    fn crashed(&self, name: &str, log: &[u8]) -> PathBuf {
        let path = self.folder.path().join(name).with_extension("sqlite");
        std::fs::remove_file(path.with_extension("sqlite-shm")).ok();
        std::fs::write(&path, &self.database).unwrap();
        std::fs::write(log_of(&path), log).unwrap();
        path
    }

    async fn state_after(&self, log: &[u8]) -> String {
        let mut hand = connect(&self.crashed("crashed", log)).await;
        // Nothing here has to survive a second crash.
        sqlx::raw_sql("PRAGMA synchronous = OFF")
            .execute(&mut hand)
            .await
            .unwrap();
        let read = state(&mut hand).await;
        hand.close().await.unwrap();
        read
    }

    /// The log whose last record ends at `end`, followed by zeros of a file that was already longer.
    fn torn(&self, end: usize) -> Vec<u8> {
        let mut log = self.log.clone();
        log[end..].fill(0);
        log
    }
}

fn log_of(path: &Path) -> PathBuf {
    path.with_extension("sqlite-wal")
}

async fn connect(path: &Path) -> AnyConnection {
    sqlx::any::install_default_drivers();
    AnyConnection::connect(&format!("sqlite:{}?mode=rwc", path.display()))
        .await
        .unwrap()
}

/// Everything of procedures, steps and outcomes.
async fn state(hand: &mut AnyConnection) -> String {
    let mut all = String::new();
    for query in [
        "SELECT procedure_id || state || bites_done || next_bite AS row FROM procedures ORDER BY 1",
        "SELECT operation_id || state || detail AS row FROM steps ORDER BY 1",
        "SELECT sequence || jaw AS row FROM bite_outcomes ORDER BY 1",
    ] {
        for row in sqlx::query(query).fetch_all(&mut *hand).await.unwrap() {
            all += &row.try_get::<String, _>("row").unwrap();
            all.push(';');
        }
        all.push('|');
    }
    all
}

#[tokio::test]
async fn a_last_record_that_is_cut_at_any_byte_is_not_there() {
    let written = Written::new().await;
    for end in written.last_record..written.log.len() {
        let cut = written.state_after(&written.log[..end]).await;
        assert_eq!(&cut, written.before(), "cut at byte {end}");
        let torn = written.state_after(&written.torn(end)).await;
        let is_whole = written.torn(end) == written.log;
        if !is_whole {
            assert_eq!(&torn, written.before(), "torn at byte {end}");
        }
    }
    let whole = written.state_after(&written.log).await;
    assert_eq!(Some(&whole), written.states.last());
}

#[tokio::test]
async fn a_last_record_with_any_bit_flipped_is_not_there() {
    let written = Written::new().await;
    for byte in written.last_record..written.log.len() {
        let mut log = written.log.clone();
        log[byte] ^= 1 << (byte % 8);
        let read = written.state_after(&log).await;
        assert_eq!(&read, written.before(), "bit {} of byte {byte}", byte % 8);
    }
}

#[tokio::test]
async fn a_flipped_bit_anywhere_in_the_log_leaves_the_state_after_one_of_the_writes() {
    let written = Written::new().await;
    for byte in (0..written.log.len()).step_by(5) {
        let mut log = written.log.clone();
        log[byte] ^= 1 << (byte % 8);
        let read = written.state_after(&log).await;
        assert!(written.states.contains(&read), "byte {byte}: {read}");
    }
}

#[tokio::test]
async fn a_gateway_that_opens_a_torn_journal_finds_the_step_intended() {
    let written = Written::new().await;
    let frames = (written.last_record..=written.log.len()).step_by(FRAME_BYTES);
    for end in frames.flat_map(|frame| [frame, frame + 1, frame + FRAME_BYTES / 2]) {
        let Some(log) = written.log.get(..end) else {
            continue;
        };
        // A file of its own each time: the gateway before may still be closing its.
        let path = written.crashed(&format!("cut at {end}"), log);
        let journal = journal::open(&Place::File(path), "test").await.unwrap();
        let read: (Vec<Procedure>, Vec<Step>, Vec<BiteOutcome>) = (
            journal.claim_open().await.unwrap(),
            journal.steps("p").await.unwrap(),
            journal.bite_outcomes("p").await.unwrap(),
        );
        let bite = step(1, Kind::Bite, Some(0));
        let is_whole = end == written.log.len();
        let (bites_done, ended, outcomes) = match is_whole {
            true => (1, done(&bite), vec![outcome(0)]),
            false => (0, bite, Vec::new()),
        };
        assert_eq!(read.0[0].bites_done, bites_done, "cut at byte {end}");
        assert_eq!(read.1, [ended], "cut at byte {end}");
        assert_eq!(read.2, outcomes, "cut at byte {end}");
    }
}
