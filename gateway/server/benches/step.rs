//! What a step costs beside the devices' own motion: `cargo bench --workspace --bench step`. Whole procedures run
//! against stand-ins of the services that have done at once whatever they are told, over loopback, with the journal on
//! SQLite in a folder of `target/`. It measures and holds to no limit.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    dead_code,
    reason = "a program of the developers, which ends where it cannot measure; it shares the tests' stand-ins, which use all of them"
)]

#[path = "../tests/gateway"]
mod gateway {
    pub mod bench;
    pub mod fakes;
}

use std::sync::atomic::Ordering;
use std::time::Instant;

use arthro_proto::gateway::v1::ProcedureState;

use gateway::bench::Bench;

const PROCEDURES: usize = 51;

#[tokio::main]
async fn main() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let journal = folder.path().join("gateway.sqlite");
    let mut bench = Bench::with(|config| config.journal = journal.into()).await;
    bench.world.reads_journal.store(false, Ordering::Relaxed);
    let mut times_ms = Vec::new();
    let mut steps = 0;
    for _ in 0..PROCEDURES {
        let (case_id, digest) = bench.approved().await;
        let began = Instant::now();
        let procedure_id = bench.start(&case_id, &digest).await.unwrap();
        bench
            .reaches(&procedure_id, ProcedureState::Completed)
            .await;
        let taken = began.elapsed();
        steps = bench.report(&procedure_id).await.steps.len();
        times_ms.push(taken.as_secs_f64() * 1e3 / steps as f64);
    }
    times_ms.sort_by(f64::total_cmp);
    println!("| a step of {steps}, over {PROCEDURES} procedures | ms |");
    println!("|---|---|");
    println!("| median procedure | {:.3} |", times_ms[PROCEDURES / 2]);
    println!("| slowest procedure | {:.3} |", times_ms[PROCEDURES - 1]);
}
