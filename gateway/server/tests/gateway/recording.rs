//! Recordings of procedures, and what a replay shows of them.

use std::path::{Path, PathBuf};

use arthro_bootstrap::{Host, Service as _, status};
use arthro_gateway::recording::read::Lines;
use arthro_gateway::recording::summary::Summary;
use arthro_gateway::recording::topics::Topic;
use arthro_gateway::replay;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::procedure_service_client::ProcedureServiceClient;
use arthro_proto::gateway::v1::recording_service_client::RecordingServiceClient;
use arthro_proto::instrument::v1::instrument_service_client::InstrumentServiceClient;
use arthro_proto::motion::v1 as motion;
use arthro_proto::motion::v1::motion_service_client::MotionServiceClient;
use tempfile::TempDir;
use tonic::transport::Channel;
use tonic::transport::server::TcpIncoming;

use super::bench::{Bench, reason};
use super::fakes::PATIENCE;

/// A gateway that records, and where.
async fn recording() -> (Bench, TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_owned();
    let bench = Bench::with(|config| config.recordings = Some(path)).await;
    (bench, folder)
}

/// Resolves when there are as many recordings, the last one with its end.
async fn at_rest(bench: &Bench, folder: &Path, count: usize) {
    let rest = async {
        loop {
            let files = files(folder);
            if files.len() == count && Summary::of(&files[count - 1]).is_ok_and(|last| last.whole) {
                return;
            }
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(PATIENCE, rest).await.unwrap();
    let mut recorder = RecordingServiceClient::new(bench.channel.clone());
    let request = proto::GetRecorderRequest {};
    let state = recorder.get_recorder(request).await.unwrap().into_inner();
    assert!(state.configured);
    assert_eq!(
        (state.dropped_messages, state.alarm_reason.as_str()),
        (0, "")
    );
}

/// The recordings of the folder in order.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| {
            path.extension()
                .is_some_and(|extension| extension == "mcap")
        })
        .collect();
    files.sort();
    files
}

/// Every message of a topic, in order.
fn messages<M: prost::Message + Default>(path: &Path, topic: Topic) -> Vec<M> {
    let mut lines = Lines::open(path).unwrap();
    let mut all = Vec::new();
    while let Some(line) = lines.next_line().unwrap() {
        if line.topic == topic {
            all.push(M::decode(line.message.as_slice()).unwrap());
        }
    }
    all
}

/// A procedure that was recorded from its start to its end: its report and its file.
async fn recorded() -> (proto::GetReportResponse, PathBuf, TempDir) {
    let (mut bench, folder) = recording().await;
    let id = bench.started().await;
    bench.reaches(&id, proto::ProcedureState::Completed).await;
    at_rest(&bench, folder.path(), 1).await;
    let report = bench.report(&id).await;
    let files = files(folder.path());
    (report, files[0].clone(), folder)
}

#[tokio::test]
async fn a_recording_holds_every_step_and_bite_of_the_journal_and_what_was_measured() {
    let (report, file, _folder) = recorded().await;
    let summary = Summary::of(&file).unwrap();
    assert!(summary.whole);
    assert_eq!(summary.procedure, report.procedure);
    assert_eq!(
        messages::<proto::BiteOutcome>(&file, Topic::Bite),
        report.bites
    );
    let steps = messages::<proto::Step>(&file, Topic::Step);
    for step in &report.steps {
        assert!(steps.contains(step), "{step:?} is missing");
    }
    for topic in [
        Topic::Cell,
        Topic::AxisList,
        Topic::Arms,
        Topic::Axes,
        Topic::Transforms,
        Topic::Scene,
    ] {
        assert!(summary.lines.contains_key(&topic), "{topic:?} is missing");
    }
    let decisions: Vec<_> = summary
        .events
        .iter()
        .filter(|(_, event)| event.kind() == proto::RecordedEventKind::Decision)
        .map(|(_, event)| event.reason.as_str())
        .collect();
    assert_eq!(decisions, ["RUNNING", "COMPLETED"]);
}

#[tokio::test]
async fn a_killed_gateway_leaves_a_file_that_can_be_read_and_goes_on_in_another() {
    let (mut bench, folder) = recording().await;
    bench.world.hold("BITE");
    let id = bench.started().await;
    bench.world.arrived("BITE", 1).await;
    bench.kill().await;
    bench.world.let_go();
    let first = files(folder.path()).remove(0);
    // Here the recorder's thread outlives its gateway and ends the file; a process that is killed leaves it without an end.
    let ended = async {
        while !Summary::of(&first).is_ok_and(|summary| summary.whole) {
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(PATIENCE, ended).await.unwrap();
    let bytes = std::fs::read(&first).unwrap();
    std::fs::write(&first, &bytes[..bytes.len() / 2]).unwrap();
    let summary = Summary::of(&first).unwrap();
    assert!(!summary.whole);
    assert_eq!(summary.head.unwrap().procedure_id, id);

    bench.restart(|_| {}).await;
    bench
        .recover(&id, proto::RecoveryAction::MarkDone)
        .await
        .unwrap();
    bench.reaches(&id, proto::ProcedureState::Completed).await;
    at_rest(&bench, folder.path(), 2).await;
    let files = files(folder.path());
    let second = Summary::of(&files[1]).unwrap();
    assert!(second.whole);
    assert_eq!(second.head.as_ref().unwrap().segment, 2);
    // It begins with the steps from before the crash.
    let steps = messages::<proto::Step>(&files[1], Topic::Step);
    for step in bench.report(&id).await.steps {
        assert!(steps.contains(&step), "{step:?} is missing");
    }
}

#[tokio::test]
async fn a_procedure_goes_on_when_it_cannot_be_recorded() {
    let (mut bench, folder) = recording().await;
    let (case_id, digest) = bench.approved().await;
    // A file where the folder was.
    std::fs::remove_dir_all(folder.path()).unwrap();
    std::fs::write(folder.path(), b"").unwrap();
    let id = bench.start(&case_id, &digest).await.unwrap();
    bench.reaches(&id, proto::ProcedureState::Completed).await;
    let mut recorder = RecordingServiceClient::new(bench.channel.clone());
    let request = proto::GetRecorderRequest {};
    let state = recorder.get_recorder(request).await.unwrap().into_inner();
    assert_eq!(state.alarm_reason, "RECORDING_FAILED");
    std::fs::remove_file(folder.path()).unwrap();
}

// === replay ===

/// A replay of one file, much faster than it was.
async fn replayed(file: &Path) -> Channel {
    let config = replay::Config {
        files: vec![file.to_owned()],
        speed: 1000.0,
        ..replay::Config::default()
    };
    let routes = replay::Server::build(config, Host::alone()).await.unwrap();
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let server = tonic::transport::Server::builder()
        .add_routes(routes)
        .serve_with_incoming(TcpIncoming::from(listener).with_nodelay(Some(true)));
    tokio::spawn(server);
    Channel::from_shared(format!("http://{address}"))
        .unwrap()
        .connect()
        .await
        .unwrap()
}

/// Watches until the recording is at its end.
async fn watched(channel: &Channel, procedure_id: &str) -> Vec<proto::Procedure> {
    let mut procedures = ProcedureServiceClient::new(channel.clone());
    let request = proto::WatchProcedureRequest {
        procedure_id: procedure_id.to_owned(),
        ..proto::WatchProcedureRequest::default()
    };
    let mut states = loop {
        // Until the first line is due there is no procedure.
        match procedures.watch_procedure(request.clone()).await {
            Ok(states) => break states.into_inner(),
            Err(refusal) => assert_eq!(
                status::reason(&refusal).as_deref(),
                Some("UNKNOWN_PROCEDURE")
            ),
        }
    };
    let mut all = Vec::new();
    let to_the_end = async {
        while let Some(state) = states.message().await.unwrap() {
            all.extend(state.procedure);
        }
    };
    tokio::time::timeout(PATIENCE, to_the_end).await.unwrap();
    all
}

#[tokio::test]
async fn a_replay_ends_with_the_report_of_the_procedure() {
    let (report, file, _folder) = recorded().await;
    let channel = replayed(&file).await;
    let recorded = report.procedure.clone().unwrap();
    let states = watched(&channel, &recorded.procedure_id).await;
    assert_eq!(states.last(), Some(&recorded));

    let mut procedures = ProcedureServiceClient::new(channel.clone());
    let listed = procedures
        .list_procedures(proto::ListProceduresRequest::default())
        .await
        .unwrap()
        .into_inner();
    assert_eq!(listed.procedures, std::slice::from_ref(&recorded));
    let request = proto::GetReportRequest {
        procedure_id: recorded.procedure_id,
    };
    let shown = procedures.get_report(request).await.unwrap().into_inner();
    assert_eq!(shown, report);

    let arms = messages::<motion::WatchStateResponse>(&file, Topic::Arms);
    let mut watch = MotionServiceClient::new(channel)
        .watch_state(motion::WatchStateRequest { period_s: 0.0 })
        .await
        .unwrap()
        .into_inner();
    assert_eq!(watch.message().await.unwrap().as_ref(), arms.last());
}

#[tokio::test]
async fn a_replay_shows_what_a_cut_file_holds() {
    let (report, file, _folder) = recorded().await;
    let bytes = std::fs::read(&file).unwrap();
    std::fs::write(&file, &bytes[..bytes.len() * 2 / 3]).unwrap();
    let held = messages::<proto::Procedure>(&file, Topic::Procedure);
    let channel = replayed(&file).await;
    let procedure_id = report.procedure.unwrap().procedure_id;
    let states = watched(&channel, &procedure_id).await;
    assert_eq!(states.last(), held.last());
}

#[tokio::test]
async fn a_replay_refuses_every_command() {
    let (_, file, _folder) = recorded().await;
    let channel = replayed(&file).await;
    let mut procedures = ProcedureServiceClient::new(channel.clone());
    let mut motion = MotionServiceClient::new(channel.clone());
    let mut instrument = InstrumentServiceClient::new(channel);
    let reasons = [
        reason(
            procedures
                .start_procedure(proto::StartProcedureRequest::default())
                .await,
        ),
        reason(
            procedures
                .stop_procedure(proto::StopProcedureRequest::default())
                .await,
        ),
        reason(
            motion
                .acquire_lease(motion::AcquireLeaseRequest::default())
                .await,
        ),
        reason(motion.r#move(motion::MoveRequest::default()).await),
        reason(
            instrument
                .bite(arthro_proto::instrument::v1::BiteRequest::default())
                .await,
        ),
    ];
    assert_eq!(reasons, ["REPLAY"; 5]);
}

#[tokio::test]
async fn what_is_no_recording_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("x.mcap");
    for (bytes, problem) in [
        (b"no recording at all".as_slice(), "no recording"),
        (b"\x89MCAP0\r\n".as_slice(), "holds no procedure"),
    ] {
        std::fs::write(&file, bytes).unwrap();
        let config = replay::Config {
            files: vec![file.clone()],
            ..replay::Config::default()
        };
        let refusal = replay::Server::build(config, Host::alone())
            .await
            .unwrap_err()
            .to_string();
        assert!(refusal.contains(problem), "{refusal}");
    }
}
