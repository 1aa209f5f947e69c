//! Two gateways on one PostgreSQL, as processes that are killed and halted: exactly one commands, and the other takes
//! over what is open, as interrupted. And one whose PostgreSQL dies.

use std::sync::Arc;
use std::time::{Duration, Instant};

use arthro_gateway::journal::Place;
use arthro_proto::gateway::v1::{
    ProcedureState, RecoveryAction, StepKind, StepState, StopProcedureRequest,
};

use super::bench::{Bench, audit_in, config, reason};
use super::fakes::{PATIENCE, World};
use super::postgres::Database;
use super::process::Gateway;

/// Asked of the other gateway after the death of the one in command.
const TAKEOVER_LIMIT: Duration = Duration::from_secs(5);

struct Pair {
    world: Arc<World>,
    first: Gateway,
    second: Gateway,
    _database: Database,
}

impl Pair {
    /// The first is in command, the second on standby.
    async fn new() -> Self {
        let database = Database::new().await;
        let world = World::new(Place::Postgres(database.address()));
        let config = config(Place::Postgres(database.address()), &world).await;
        Self {
            first: Gateway::start("first", &config, &world).await,
            second: Gateway::start("second", &config, &world).await,
            world,
            _database: database,
        }
    }

    /// The first performs a procedure, and the jaw of its first bite closes.
    async fn in_mid_bite() -> (Self, String) {
        let mut pair = Self::new().await;
        pair.world.hold("BITE");
        let procedure_id = pair.first.bench.started().await;
        pair.world.arrived("BITE", 1).await;
        (pair, procedure_id)
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn of_two_gateways_exactly_one_commands() {
    let mut pair = Pair::new().await;
    let (case_id, digest) = pair.first.bench.approved().await;
    let case = pair.second.bench.get(&case_id).await;
    assert_eq!(case, pair.first.bench.get(&case_id).await);

    let refused = pair.second.bench.start(&case_id, &digest).await;
    let refusal = refused.as_ref().unwrap_err();
    assert_eq!(refusal.code(), tonic::Code::FailedPrecondition);
    assert!(
        refusal.message().contains("in command is \"first\""),
        "{refusal:?}"
    );
    assert_eq!(reason(refused), "NOT_IN_COMMAND");
    let approving = pair.second.bench.approve(&case_id, &digest).await;
    assert_eq!(reason(approving), "NOT_IN_COMMAND");
    assert!(pair.world.commands().is_empty());

    let procedure_id = pair.first.bench.start(&case_id, &digest).await.unwrap();
    pair.first
        .bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    pair.second
        .tells(&procedure_id, ProcedureState::Completed)
        .await;
    assert!(pair.world.unjournalled.lock().unwrap().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_standby_stops_what_the_other_commands() {
    let (mut pair, procedure_id) = Pair::in_mid_bite().await;
    pair.second.stop().await.unwrap();
    let procedure = pair
        .first
        .bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.step.unwrap().state(), StepState::InDoubt);
}

#[tokio::test(flavor = "multi_thread")]
async fn when_the_one_in_command_is_killed_the_other_takes_over_as_interrupted() {
    let (mut pair, procedure_id) = Pair::in_mid_bite().await;
    let before = pair.world.commands();
    let killed_at = Instant::now();
    pair.first.signal("KILL");
    let procedure = pair
        .second
        .tells(&procedure_id, ProcedureState::Interrupted)
        .await;
    let took = killed_at.elapsed();
    println!("took over {took:?} after the kill");
    assert!(took <= TAKEOVER_LIMIT, "took over after {took:?}");
    assert_eq!(procedure.reason, "GATEWAY_REPLACED");
    let step = procedure.step.unwrap();
    assert_eq!(
        (step.kind(), step.state()),
        (StepKind::Bite, StepState::InDoubt)
    );
    assert_eq!(pair.world.commands(), before, "nothing moves by itself");

    pair.world.let_go();
    let second = &mut pair.second.bench;
    second
        .recover(&procedure_id, RecoveryAction::MarkDone)
        .await
        .unwrap();
    second
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    assert_eq!(pair.world.count("BITE"), 3);
    assert!(pair.world.unjournalled.lock().unwrap().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_gateway_that_was_halted_and_comes_back_commands_no_more() {
    let (mut pair, procedure_id) = Pair::in_mid_bite().await;
    let halted_at = Instant::now();
    pair.first.signal("STOP");
    pair.second
        .tells(&procedure_id, ProcedureState::Interrupted)
        .await;
    let took = halted_at.elapsed();
    println!("took over {took:?} after the halt");
    assert!(took <= TAKEOVER_LIMIT, "took over after {took:?}");
    let taken_over = pair.second.bench.report(&procedure_id).await;
    let commands = pair.world.commands();

    // The jaw's answer waits for the first: what it would write and command next is the fenced part.
    pair.world.let_go();
    pair.first.signal("CONT");
    let again = pair
        .first
        .bench
        .recover(&procedure_id, RecoveryAction::RepeatBite)
        .await;
    let word = reason(again);
    assert!(word == "NOT_IN_COMMAND" || word == "FENCED", "{word}");
    pair.first
        .tells(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(pair.world.commands(), commands);
    assert_eq!(pair.second.bench.report(&procedure_id).await, taken_over);
    assert_eq!(pair.first.bench.report(&procedure_id).await, taken_over);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_gateway_that_is_told_to_end_hands_over_at_once() {
    let (mut pair, procedure_id) = Pair::in_mid_bite().await;
    pair.first.tell_to_end();
    let procedure = pair
        .second
        .tells(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "GATEWAY_STOPPING");
    pair.world.let_go();
    let until = Instant::now() + PATIENCE;
    let recovered = loop {
        let answer = pair
            .second
            .bench
            .recover(&procedure_id, RecoveryAction::Withdraw)
            .await;
        match answer {
            Err(refusal)
                if Instant::now() < until
                    && reason::<()>(Err(refusal.clone())) == "NOT_IN_COMMAND" =>
            {
                tokio::task::yield_now().await;
            }
            answer => break answer,
        }
    };
    recovered.unwrap();
    pair.second
        .bench
        .reaches(&procedure_id, ProcedureState::Aborted)
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn when_the_database_dies_nothing_is_commanded_before_it_is_back_and_an_operator_decides() {
    let mut database = Database::alone().await;
    let journal = Place::Postgres(database.address());
    let folder = tempfile::tempdir().unwrap();
    let audit = audit_in(folder.path());
    let mut bench = Bench::on(journal, folder, |config| config.audit = audit).await;
    bench.world.hold("INSERT FORCEPS");
    let procedure_id = bench.started().await;
    bench.world.arrived("INSERT FORCEPS", 1).await;
    let commands = bench.world.commands();

    database.die();
    // The insertion ends, and that cannot be written.
    bench.world.let_go();
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "JOURNAL_FAILED");
    let request = StopProcedureRequest {
        wait_for_devices: true,
        ..Default::default()
    };
    let stopped = bench.procedures.stop_procedure(request).await;
    stopped.expect("a stop needs no database");
    let decided = bench
        .recover(&procedure_id, RecoveryAction::RepeatBite)
        .await;
    assert!(decided.is_err(), "{decided:?}");
    assert_eq!(bench.world.commands(), commands);

    database.come_back();
    let until = Instant::now() + PATIENCE;
    while let Err(refusal) = bench
        .recover(&procedure_id, RecoveryAction::RepeatBite)
        .await
    {
        assert!(Instant::now() < until, "still refused: {refusal:?}");
        assert_eq!(bench.world.commands(), commands);
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    assert_eq!(bench.world.count("BITE"), 3);
    assert!(bench.world.unjournalled.lock().unwrap().is_empty());
}
