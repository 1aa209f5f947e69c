//! A journal that writes slowly, or no more: no step is commanded that does not stand in it, and a stop waits for
//! nothing.

use std::fs::File;
use std::io::{ErrorKind, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::Ordering;
use std::time::Duration;

use arthro_gateway::journal::Place;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::{ProcedureState, RecoveryAction};
use sqlx::{AssertSqlSafe, Connection as _, SqliteConnection};
use tokio::time::Instant;

use super::bench::{Bench, config, reason};
use super::fakes::World;
use super::postgres::as_nobody;
use super::process::{Gateway, may_mount};

/// Long against anything that waits for no disk.
const SLOW: Duration = Duration::from_secs(1);

/// A second hand on the journal's file.
async fn hand(bench: &Bench) -> SqliteConnection {
    let path: PathBuf = match &bench.world.journal {
        Place::File(path) => path.clone(),
        Place::Postgres(_) => panic!("the bench keeps a file"),
    };
    SqliteConnection::connect(&format!("sqlite:{}", path.display()))
        .await
        .unwrap()
}

/// From here on nothing can be written to a table, as on a disk that is full.
async fn fill(hand: &mut SqliteConnection, table: &str, change: &str) {
    let trigger = AssertSqlSafe(format!(
        "CREATE TRIGGER full_{table} BEFORE {change} ON {table} \
         BEGIN SELECT RAISE(ABORT, 'database or disk is full'); END"
    ));
    sqlx::raw_sql(trigger).execute(hand).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn while_a_write_takes_a_second_nothing_is_commanded_and_a_stop_is_not_held_up() {
    let mut bench = Bench::new().await;
    bench.world.hold("INSERT FORCEPS");
    let procedure_id = bench.started().await;
    bench.world.arrived("INSERT FORCEPS", 1).await;
    let commands = bench.world.commands();

    let mut hand = hand(&bench).await;
    sqlx::raw_sql("BEGIN IMMEDIATE")
        .execute(&mut hand)
        .await
        .unwrap();
    let locked_at = Instant::now();
    bench.world.let_go();
    // The insertion has ended, its end cannot be written, and the bite must not come.
    tokio::time::sleep_until(locked_at + SLOW).await;
    assert_eq!(bench.world.commands(), commands);

    let stops = *bench.world.stops.borrow();
    let request = proto::StopProcedureRequest {
        wait_for_devices: true,
        ..Default::default()
    };
    bench.procedures.stop_procedure(request).await.unwrap();
    assert!(*bench.world.stops.borrow() > stops);
    assert_eq!(bench.world.commands(), commands, "the write still waits");

    sqlx::raw_sql("ROLLBACK").execute(&mut hand).await.unwrap();
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "STOPPED");
    assert_eq!(bench.world.commands(), commands);
}

#[tokio::test(flavor = "multi_thread")]
async fn slow_writes_make_a_procedure_slow_and_nothing_else() {
    let mut bench = Bench::new().await;
    let mut hand = hand(&bench).await;
    let (case_id, digest) = bench.approved().await;
    sqlx::raw_sql("BEGIN IMMEDIATE")
        .execute(&mut hand)
        .await
        .unwrap();
    let mut procedures = bench.procedures.clone();
    let starting = tokio::spawn(async move {
        let request = proto::StartProcedureRequest {
            case_id,
            plan_digest: digest,
            operator: "operator".to_owned(),
        };
        procedures.start_procedure(request).await
    });
    tokio::time::sleep(SLOW).await;
    assert!(bench.world.commands().is_empty());
    sqlx::raw_sql("ROLLBACK").execute(&mut hand).await.unwrap();
    let started = starting.await.unwrap().unwrap().into_inner();
    let procedure_id = started.procedure.unwrap().procedure_id;
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    assert!(bench.world.unjournalled.lock().unwrap().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_full_disk_refuses_the_start_before_anything_moves() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    fill(&mut hand(&bench).await, "procedures", "INSERT").await;
    let start = bench.start(&case_id, &digest).await;
    assert_eq!(reason(start), "JOURNAL_FAILED");
    assert!(bench.world.commands().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_full_disk_halts_before_the_first_step_that_cannot_be_written() {
    let mut bench = Bench::new().await;
    bench.world.hold("INSERT FORCEPS");
    let procedure_id = bench.started().await;
    bench.world.arrived("INSERT FORCEPS", 1).await;
    let commands = bench.world.commands();
    let stops = *bench.world.stops.borrow();
    fill(&mut hand(&bench).await, "steps", "INSERT").await;
    bench.world.let_go();
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "JOURNAL_FAILED");
    assert!(
        procedure.detail.contains("disk is full"),
        "{}",
        procedure.detail
    );
    assert_eq!(bench.world.commands(), commands);
    assert!(*bench.world.stops.borrow() > stops);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_end_that_cannot_be_written_halts_and_is_found_after_a_restart() {
    let mut bench = Bench::new().await;
    bench.world.hold("BITE");
    let procedure_id = bench.started().await;
    bench.world.arrived("BITE", 1).await;
    let commands = bench.world.commands();
    fill(&mut hand(&bench).await, "steps", "UPDATE").await;
    bench.world.let_go();
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "JOURNAL_FAILED");
    assert_eq!(bench.world.commands(), commands);

    let mut hand = hand(&bench).await;
    bench.kill().await;
    sqlx::raw_sql("DROP TRIGGER full_steps")
        .execute(&mut hand)
        .await
        .unwrap();
    bench.restart(|_| {}).await;
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    // The bite was taken, its end is not in the journal: nobody but the operator can tell.
    let step = procedure.step.unwrap();
    assert_eq!(step.state(), proto::StepState::InDoubt);
    assert_eq!(procedure.bites_done, 0);
    assert_eq!(bench.world.count("BITE"), 1);
}

/// From here on no file of the process may grow or be written beyond so many bytes.
fn limit_files(gateway: &Gateway, bytes: &str) {
    let limited = Command::new("prlimit")
        .arg(format!("--pid={}", gateway.pid()))
        .arg(format!("--fsize={bytes}:"))
        .status()
        .unwrap();
    assert!(limited.success());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_disk_that_takes_no_byte_halts_everything_and_one_that_takes_them_again_lets_it_be_recovered()
 {
    let folder = tempfile::tempdir().unwrap();
    let journal = Place::File(folder.path().join("journal.sqlite"));
    let world = World::new(journal.clone());
    let config = config(journal, &world).await;
    let mut gateway = Gateway::start("gateway", &config, &world).await;
    let (case_id, digest) = gateway.bench.approved().await;
    limit_files(&gateway, "0");
    let start = gateway.bench.start(&case_id, &digest).await;
    // The audit lies on the same disk, and a command stands there first.
    assert_eq!(reason(start), "AUDIT_FAILED");
    assert!(world.commands().is_empty());

    limit_files(&gateway, "unlimited");
    world.hold("INSERT FORCEPS");
    let procedure_id = gateway.bench.start(&case_id, &digest).await.unwrap();
    world.arrived("INSERT FORCEPS", 1).await;
    let commands = world.commands();
    let stops = *world.stops.borrow();
    limit_files(&gateway, "0");
    world.let_go();
    let procedure = gateway
        .tells(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "JOURNAL_FAILED");
    assert_eq!(world.commands(), commands);
    assert!(*world.stops.borrow() > stops);
    let recovery = gateway
        .bench
        .recover(&procedure_id, RecoveryAction::Withdraw)
        .await;
    assert_eq!(reason(recovery), "AUDIT_FAILED");
    assert_eq!(world.commands(), commands);
    gateway.stop().await.unwrap();

    limit_files(&gateway, "unlimited");
    gateway
        .bench
        .recover(&procedure_id, RecoveryAction::Withdraw)
        .await
        .unwrap();
    gateway.tells(&procedure_id, ProcedureState::Aborted).await;
    assert!(world.unjournalled.lock().unwrap().is_empty());
}

/// Writes until the disk is full; the file that filled it.
fn fill_disk(gateway: &Gateway, at: &Path) -> PathBuf {
    let seen_by_it = format!("/proc/{}/root{}", gateway.pid(), at.display());
    let filler = PathBuf::from(seen_by_it).join("filler");
    let mut file = File::create(&filler).unwrap();
    let full = loop {
        if let Err(full) = file.write_all(&[0; 4096]) {
            break full;
        }
    };
    assert_eq!(full.kind(), ErrorKind::StorageFull);
    filler
}

#[tokio::test(flavor = "multi_thread")]
async fn a_disk_without_space_halts_before_what_it_cannot_hold_and_loses_nothing() {
    if !may_mount() {
        println!("skipped: no process may mount here");
        return;
    }
    let disk = tempfile::tempdir().unwrap();
    let journal = Place::File(disk.path().join("journal.sqlite"));
    let world = World::new(journal.clone());
    // It lies where only the gateway sees it.
    world.reads_journal.store(false, Ordering::Relaxed);
    let config = config(journal, &world).await;
    let mut gateway = Gateway::start_with_disk(&config, &world, disk.path(), 8192).await;
    let (case_id, digest) = gateway.bench.approved().await;
    world.hold("INSERT FORCEPS");
    let procedure_id = gateway.bench.start(&case_id, &digest).await.unwrap();
    world.arrived("INSERT FORCEPS", 1).await;
    let stops = *world.stops.borrow();
    let filler = fill_disk(&gateway, disk.path());
    world.let_go();
    let procedure = gateway
        .tells(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "JOURNAL_FAILED");
    assert!(*world.stops.borrow() > stops);
    let commands = world.commands();
    gateway.stop().await.unwrap();
    let recovery = gateway
        .bench
        .recover(&procedure_id, RecoveryAction::RepeatBite)
        .await;
    assert!(recovery.is_err(), "{recovery:?}");
    assert_eq!(world.commands(), commands);

    std::fs::remove_file(filler).unwrap();
    let bites = gateway.bench.report(&procedure_id).await.bites.len();
    assert_eq!(world.count("BITE"), bites, "every bite is written");
    gateway
        .bench
        .recover(&procedure_id, RecoveryAction::RepeatBite)
        .await
        .unwrap();
    gateway
        .tells(&procedure_id, ProcedureState::Completed)
        .await;
    assert_eq!(world.count("BITE"), 3);
}

#[test]
fn a_folder_that_cannot_be_written_keeps_the_gateway_from_starting() {
    let folder = tempfile::tempdir().unwrap();
    // A copy, since whoever runs it may not see the original.
    let program = folder.path().join("arthro-gateway");
    std::fs::copy(env!("CARGO_BIN_EXE_arthro-gateway"), &program).unwrap();
    std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o555)).unwrap();
    let journal = folder.path().join("journal.sqlite");
    let started = as_nobody(&program)
        .args(["--listen", "127.0.0.1:0", "--until-stdin-closes", "--set"])
        .arg(format!("journal={:?}", journal.display().to_string()))
        .current_dir("/")
        .stdin(std::process::Stdio::null())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&started.stderr);
    assert_eq!(started.status.code(), Some(69), "{said}");
    assert!(said.contains("cannot be written"), "{said}");
    std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o755)).unwrap();
}
