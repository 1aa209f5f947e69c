//! Replicas of the registration as processes that are killed: what one computed, the other computes.
#![allow(clippy::panic, reason = "a test says why it failed by panicking")]

use std::process::Stdio;

use arthro_proto::gateway::v1::{BegunAnew, RegisterCaseRequest, RegisterCaseResponse};
use arthro_proto::registration::v1::register_response;
use arthro_tests::Cell;
use arthro_tests::cell::{arthro, signal};
use tokio::io::{AsyncBufReadExt as _, BufReader};
use tokio::process::{Child, ChildStdin, Command};
use tonic::Streaming;

/// A service beside those of the cell. It ends with the test.
struct Served {
    address: String,
    process: Child,
    _stdin: ChildStdin,
}

impl Served {
    async fn start(cell: &Cell, name: &str, settings: &[String]) -> Self {
        let mut process = Command::new(arthro())
            .args(["serve", name, "--listen", "127.0.0.1:0"])
            .args(["--until-stdin-closes", "--config"])
            .arg(&cell.at.config)
            .args(settings.iter().flat_map(|setting| ["--set", setting]))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .kill_on_drop(true)
            .spawn()
            .expect("arthro starts");
        let stdin = process.stdin.take().expect("standard input is piped");
        let stdout = process.stdout.take().expect("standard output is piped");
        let mut line = String::new();
        BufReader::new(stdout)
            .read_line(&mut line)
            .await
            .expect("standard output is read");
        let announced: serde_json::Value = serde_json::from_str(&line)
            .unwrap_or_else(|error| panic!("{name} announced {line:?}: {error}"));
        let address = announced["address"].as_str().expect("an address");
        Self {
            address: address.to_owned(),
            process,
            _stdin: stdin,
        }
    }

    async fn kill(&self) {
        signal(self.process.id().expect("it runs"), "KILL").await;
    }
}

/// One registration under way.
struct Registering(Streaming<RegisterCaseResponse>);

impl Registering {
    /// Begins; resolves with its first event, when a replica computes.
    async fn begin(cell: &Cell, case_id: &str) -> Self {
        let mut cases = cell.cases().await;
        let request = RegisterCaseRequest {
            case_id: case_id.to_owned(),
            ..RegisterCaseRequest::default()
        };
        let answer = cases.register_case(request).await;
        let mut events = answer.expect("it begins").into_inner();
        let first = events.message().await.expect("the stream goes on");
        assert!(first.is_some_and(|first| first.event.is_some()));
        Self(events)
    }

    /// Goes on to the result; how often the computation was begun anew.
    async fn end(mut self) -> Vec<BegunAnew> {
        let mut begun_anew = Vec::new();
        let mut result = None;
        while let Some(message) = self.0.message().await.expect("the stream goes on") {
            begun_anew.extend(message.begun_anew);
            let event = message.event.and_then(|event| event.event);
            if let Some(register_response::Event::Result(last)) = event {
                result = Some(last);
            }
        }
        assert!(result.is_some(), "a result is the last event");
        begun_anew
    }
}

#[tokio::test]
async fn what_a_killed_replica_computed_the_other_computes() {
    let mut cell = Cell::up().await;
    let dying = Served::start(&cell, "registration", &[]).await;
    let lasting = Served::start(&cell, "registration", &[]).await;
    let journal = cell.folder().join("beside.sqlite");
    let settings = [
        format!(
            "registration=[\"{}\", \"{}\"]",
            dying.address, lasting.address
        ),
        format!("journal={:?}", journal.display().to_string()),
    ];
    let gateway = Served::start(&cell, "gateway", &settings).await;
    let url = format!("http://{}", gateway.address);
    cell.at.services.insert("gateway".to_owned(), url);
    let (one, two) = (cell.case().await, cell.case().await);

    // Of two computations each replica gets one.
    let (one, two) = tokio::join!(
        Registering::begin(&cell, &one),
        Registering::begin(&cell, &two)
    );
    dying.kill().await;
    let (one, two) = tokio::join!(one.end(), two.end());
    let begun_anew: Vec<_> = one.into_iter().chain(two).collect();
    let lost: Vec<_> = begun_anew
        .iter()
        .map(|anew| (anew.times, anew.lost_replica.as_str()))
        .collect();
    assert_eq!(lost, [(1, dying.address.as_str())], "{begun_anew:?}");
    cell.teardown().await;
}
