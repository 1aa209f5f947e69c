//! What writing a step costs: `cargo bench --workspace --bench journal`, on SQLite in a folder of `target/` and
//! on a PostgreSQL server of its own. It measures and holds to no limit.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a program of the developers, which ends where it cannot measure"
)]

#[path = "../tests/shared/postgres.rs"]
mod postgres;
#[path = "../tests/journal/values.rs"]
#[allow(dead_code, reason = "shared with the tests, which use all of it")]
mod values;

use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::path::Path;
use std::time::{Duration, Instant};

use arthro_gateway::journal::{self, Place};
use arthro_gateway::procedure::steps::Kind;

use values::{case, done, outcome, procedure, step};

/// Steps of each measurement, each written twice.
const STEPS: u32 = 1000;
/// About what SQLite's log grows by with a step's intention.
const RECORD_BYTES: usize = 16 * 1024;

#[tokio::main]
async fn main() {
    println!("| database | write | p50 ms | p99 ms | slowest ms |");
    println!("|---|---|---|---|---|");
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    measure_disk(folder.path());
    measure("SQLite", Place::File(folder.path().join("journal.sqlite"))).await;
    let database = postgres::Database::new().await;
    measure("PostgreSQL", Place::Postgres(database.address())).await;
}

/// What the disk alone takes, which no journal on it can be faster than.
fn measure_disk(folder: &Path) {
    let file = File::create(folder.join("written")).unwrap();
    // SQLite's log is written over from its start once it has its length.
    file.write_all_at(&vec![0xA5; RECORD_BYTES * 256], 0)
        .unwrap();
    file.sync_all().unwrap();
    let mut times = Vec::new();
    for record in 0..STEPS as usize {
        let began = Instant::now();
        let offset = record % 256 * RECORD_BYTES;
        file.write_all_at(&[0xA5; RECORD_BYTES], offset as u64)
            .unwrap();
        file.sync_data().unwrap();
        times.push(began.elapsed());
    }
    print("none", "a record written in place and synced", times);
}

async fn measure(name: &str, place: Place) {
    let journal = journal::open(&place, "bench").await.unwrap();
    journal.create_case(&case("c")).await.unwrap();
    let procedure = procedure("p", "c");
    journal.create_procedure(&procedure).await.unwrap();
    let mut intended = Vec::new();
    let mut ended = Vec::new();
    let mut both = Vec::new();
    for sequence in 1..=STEPS {
        let step = step(sequence, Kind::Bite, Some(sequence));
        let began = Instant::now();
        journal.intend("p", &step).await.unwrap();
        let between = Instant::now();
        journal
            .end_step(&procedure, &done(&step), Some(&outcome(sequence)))
            .await
            .unwrap();
        intended.push(between - began);
        ended.push(between.elapsed());
        both.push(began.elapsed());
    }
    print(name, "a step's intention", intended);
    print(name, "a step's end, with outcome", ended);
    print(name, "both: a step's journal time", both);
    journal.leave().await.unwrap();
}

fn print(name: &str, write: &str, mut times: Vec<Duration>) {
    times.sort();
    let at = |share: f64| {
        let index = ((times.len() - 1) as f64 * share).round() as usize;
        times[index].as_secs_f64() * 1e3
    };
    println!(
        "| {name} | {write} | {:.3} | {:.3} | {:.3} |",
        at(0.5),
        at(0.99),
        at(1.0)
    );
}
