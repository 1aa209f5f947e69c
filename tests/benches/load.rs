//! A gateway under load, on a whole simulated cell in real time: how fast it answers those who ask, how soon it acknowledges a
//! stop and an abort, and how much memory it holds, with one more burden in each row.
//!
//! `tests/run load [--seconds N] [--calls N]`: `--calls` is how many status calls a second all askers make together; without
//! it each asks as fast as it is answered. It measures and holds to no limit; the table goes to standard output, and one line of JSON
//! after it.
#![allow(
    clippy::panic,
    clippy::print_stdout,
    reason = "a bench says on standard output what it measured, and by panicking why it could not"
)]

use std::time::{Duration, Instant};

use arthro_proto::gateway::v1::procedure_service_client::ProcedureServiceClient;
use arthro_proto::gateway::v1::{
    ProcedureState, RecoverProcedureRequest, RecoveryAction, StartProcedureRequest, StepKind,
    WatchProcedureRequest, WatchProcedureResponse,
};
use arthro_tests::Cell;
use arthro_tests::load::{
    Asked, Crowd, Latencies, Resident, Stopper, Stops, Uploads, resident_bytes,
};
use rustix::process::{Resource, Rlimit, getrlimit, nice, setrlimit};
use serde_json::{Value, json};
use tonic::Streaming;
use tonic::transport::Channel;

const WATCHERS: usize = 200;
const WATCH_PERIOD_S: f64 = 0.02;
const ASKERS: usize = 100;
/// Idle streams go over so many connections.
const IDLE_CONNECTIONS: usize = 250;
/// An idle watcher is told the state once a minute.
const IDLE_PERIOD_S: f64 = 60.0;
const ABORTING: Duration = Duration::from_secs(3);
/// Interrupted more often, a withdrawal has another cause than the load.
const WITHDRAWALS_MAX: usize = 5;
/// Of the crowd's threads beside the cell's.
const CROWD_NICENESS: i32 = 5;
const MIB: f64 = 1024.0 * 1024.0;

/// What one row of the table has beside the one before.
#[derive(Clone, Copy, Debug, Default)]
struct Burden {
    name: &'static str,
    watchers: usize,
    askers: usize,
    idle_streams: usize,
    slow_readers: usize,
    uploads: usize,
    mute: usize,
}

/// One row.
struct Row {
    name: &'static str,
    asked: Asked,
    states_s: f64,
    watches_ended: u64,
    aborts: Latencies,
    stops: Stops,
    most_bytes: u64,
    uploads_refused: u64,
    uploads_strange: u64,
}

fn burdens() -> Vec<Burden> {
    let quiet = Burden {
        name: "nobody else",
        ..Burden::default()
    };
    let crowd = Burden {
        name: "200 watch at 50 Hz, 100 ask",
        watchers: WATCHERS,
        askers: ASKERS,
        ..quiet
    };
    let idle = Burden {
        name: "+ 10,000 idle streams",
        idle_streams: 10_000,
        ..crowd
    };
    let slow = Burden {
        name: "+ 200 who never read",
        slow_readers: 200,
        ..idle
    };
    let uploads = Burden {
        name: "+ 4 uploads of 4 GiB",
        uploads: 4,
        ..slow
    };
    let mute = Burden {
        name: "+ 400 halves of prefaces and headers",
        mute: 400,
        ..uploads
    };
    vec![quiet, crowd, idle, slow, uploads, mute]
}

fn main() {
    // The crowd stands for other machines: what shares this one with it goes first.
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .on_thread_start(|| {
            nice(CROWD_NICENESS).ok();
        })
        .build()
        .expect("a runtime");
    // On this thread, whose niceness the cell inherits.
    runtime.block_on(measure_all());
}

async fn measure_all() {
    let lasting = Duration::from_secs_f64(given("--seconds").unwrap_or(15.0));
    let asking_period = given("--calls").map(|calls_s| ASKERS as f64 / calls_s);
    let asking_period = asking_period.map(Duration::from_secs_f64);
    let cell = Cell::up_with(&["--time-scale", "1"]).await;
    allow_many_files();
    let (case_id, digest) = cell.approved_case().await;
    let gateway = cell.at.processes["gateway"];
    let before = resident_bytes(gateway);
    let mut rows = Vec::new();
    for burden in burdens() {
        let row = measure(&cell, &case_id, &digest, burden, lasting, asking_period).await;
        println!("{}", row.text());
        rows.push(row);
    }
    tokio::time::sleep(Duration::from_secs(2)).await;
    let after = resident_bytes(gateway);
    println!(
        "gateway: {:.0} MiB before, {:.0} MiB after",
        before as f64 / MIB,
        after as f64 / MIB
    );
    let result = json!({
        "rows": rows.iter().map(Row::json).collect::<Vec<_>>(),
        "resident_before_bytes": before,
        "resident_after_bytes": after,
    });
    println!("{result}");
    cell.teardown().await;
}

/// The number that follows an option.
fn given(option: &str) -> Option<f64> {
    let arguments: Vec<String> = std::env::args().collect();
    arguments
        .windows(2)
        .find(|pair| pair[0] == option)
        .map(|pair| match pair[1].parse() {
            Ok(number) if number > 0.0 => number,
            _ => panic!("{option} takes a number above 0"),
        })
}

/// Two thousand connections need more than a shell allows; the gateway does the same for itself.
fn allow_many_files() {
    let Rlimit { maximum, .. } = getrlimit(Resource::Nofile);
    let limit = Rlimit {
        current: maximum,
        maximum,
    };
    setrlimit(Resource::Nofile, limit).expect("a process may use what the system grants it");
}

async fn measure(
    cell: &Cell,
    case_id: &str,
    digest: &str,
    burden: Burden,
    lasting: Duration,
    asking_period: Option<Duration>,
) -> Row {
    let mut procedures = cell.procedures().await;
    let procedure_id = start(&mut procedures, case_id, digest).await;
    let crowd = Crowd::of(cell.url("gateway"), &procedure_id);
    let resident = Resident::of(cell.at.processes["gateway"]);

    let slow = crowd
        .watch_without_reading(burden.slow_readers, WATCH_PERIOD_S)
        .await;
    let idle = crowd
        .watch_over(burden.idle_streams, IDLE_CONNECTIONS, IDLE_PERIOD_S)
        .await;
    let watching = crowd.watch(burden.watchers, WATCH_PERIOD_S).await;
    let prefaces = crowd.begin_prefaces(burden.mute / 2).await;
    let headers = crowd.begin_headers(burden.mute / 2).await;
    let uploads = Uploads::to(cell.url("gateway"), case_id, burden.uploads).await;
    let asking = crowd.ask(burden.askers, asking_period).await;

    let (began, received) = (Instant::now(), watching.received());
    let stopper = Stopper::at(cell);
    let stops = stopper
        .stop_for(lasting)
        .await
        .expect("a stop gets through");
    let states_s = (watching.received() - received) as f64 / began.elapsed().as_secs_f64();
    let watches_ended = watching.ended() + idle.ended();
    // Interrupted by the stops, it withdraws, which is what an abort can be asked of.
    withdraw(&mut procedures, &procedure_id).await;
    let aborts = stopper
        .abort_for(&procedure_id, ABORTING)
        .await
        .expect("an abort is answered");
    let row = Row {
        name: burden.name,
        asked: asking.end().await,
        states_s,
        watches_ended,
        aborts,
        stops,
        most_bytes: resident.most_bytes(),
        uploads_refused: uploads.refused(),
        uploads_strange: uploads.strange(),
    };
    drop((slow, idle, watching, prefaces, headers, uploads));
    ended(&mut procedures, procedure_id).await;
    row
}

/// A procedure that is under way to its first bite: homed, so that it can be withdrawn.
async fn start(
    procedures: &mut ProcedureServiceClient<Channel>,
    case_id: &str,
    digest: &str,
) -> String {
    let request = StartProcedureRequest {
        case_id: case_id.to_owned(),
        plan_digest: digest.to_owned(),
        operator: "load".to_owned(),
    };
    let answer = procedures.start_procedure(request).await;
    let procedure = answer.expect("an approved plan starts").into_inner();
    let procedure_id = procedure
        .procedure
        .expect("a procedure comes back")
        .procedure_id;
    let mut states = watched(procedures, &procedure_id).await;
    while let Some(state) = states.message().await.expect("the watch goes on") {
        let step = state.procedure.and_then(|procedure| procedure.step);
        if step.is_some_and(|step| step.kind() == StepKind::View) {
            return procedure_id;
        }
    }
    panic!("procedure {procedure_id} ended before its first bite");
}

async fn watched(
    procedures: &mut ProcedureServiceClient<Channel>,
    procedure_id: &str,
) -> Streaming<WatchProcedureResponse> {
    let request = WatchProcedureRequest {
        procedure_id: procedure_id.to_owned(),
        ..WatchProcedureRequest::default()
    };
    let answer = procedures.watch_procedure(request).await;
    answer.expect("it can be watched").into_inner()
}

async fn withdraw(procedures: &mut ProcedureServiceClient<Channel>, procedure_id: &str) {
    let request = RecoverProcedureRequest {
        procedure_id: procedure_id.to_owned(),
        action: RecoveryAction::Withdraw.into(),
        operator: "load".to_owned(),
        acknowledge: true,
        recover_faults: true,
    };
    procedures
        .recover_procedure(request)
        .await
        .expect("a stopped procedure is withdrawn");
}

/// Resolves when the procedure has ended, so that the next can start. Where the crowd has kept the arms'
/// control from its processor the withdrawal was interrupted, and is asked for again.
async fn ended(procedures: &mut ProcedureServiceClient<Channel>, procedure_id: String) {
    for _ in 0..WITHDRAWALS_MAX {
        let mut states = watched(procedures, &procedure_id).await;
        while let Some(state) = states.message().await.expect("the watch goes on") {
            let procedure = state.procedure.expect("a state has its procedure");
            match procedure.state() {
                ProcedureState::Aborted | ProcedureState::Completed => return,
                ProcedureState::Interrupted => {
                    withdraw(procedures, &procedure_id).await;
                    break;
                }
                _ => {}
            }
        }
    }
    panic!("procedure {procedure_id} cannot be withdrawn");
}

// === impl Row ===

impl Row {
    fn text(&self) -> String {
        format!(
            "| {} | {:.0} | {} | {:.0} | {} | {} | {} | {} | {:.0} | refused {}, watches ended {}, uploads refused {}, \
             otherwise {} |",
            self.name,
            self.asked.answers_s,
            self.asked.latencies,
            self.states_s,
            self.aborts,
            self.stops.gateway,
            self.stops.motion,
            self.stops.instrument,
            self.most_bytes as f64 / MIB,
            self.asked.refused,
            self.watches_ended,
            self.uploads_refused,
            self.uploads_strange,
        )
    }

    fn json(&self) -> Value {
        let latencies = |latencies: &Latencies| {
            json!({
                "p50_ms": latencies.quantile_ms(0.5),
                "p99_ms": latencies.quantile_ms(0.99),
                "max_ms": latencies.max_ms(),
                "count": latencies.count(),
            })
        };
        json!({
            "burden": self.name,
            "status_s": self.asked.answers_s,
            "status": latencies(&self.asked.latencies),
            "status_refused": self.asked.refused,
            "states_s": self.states_s,
            "watches_ended": self.watches_ended,
            "abort": latencies(&self.aborts),
            "stop": latencies(&self.stops.gateway),
            "motion_stop": latencies(&self.stops.motion),
            "instrument_stop": latencies(&self.stops.instrument),
            "resident_most_bytes": self.most_bytes,
            "uploads_refused": self.uploads_refused,
            "uploads_otherwise": self.uploads_strange,
        })
    }
}
