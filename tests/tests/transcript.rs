//! docs/grpcurl.md is a whole procedure by hand. Its commands are executed as they stand there, and its answers are the answers.
#![allow(clippy::panic, reason = "a test says why it failed by panicking")]

mod transcript {
    pub mod answer;
    pub mod page;
}

use std::process::Stdio;
use std::time::Duration;

use arthro_tests::Cell;
use arthro_tests::cell::arthro;
use arthro_tests::peers::program;
use tokio::io::{AsyncBufReadExt as _, AsyncWriteExt as _, BufReader};
use tokio::process::Command;

use crate::transcript::answer::differs;
use crate::transcript::page::{Exchange, exchanges};

const PAGE: &str = include_str!("../../docs/grpcurl.md");
/// No command of the page is silent for longer, wall time.
const LIMIT: Duration = Duration::from_secs(120);
/// After each command, on a line of its own.
const END: &str = "--- end of answer";

/// Folders of the programs that the page calls, the machine's own last.
fn search_path() -> String {
    let folders = [arthro(), program("grpcurl")].map(|program| {
        let folder = program.parent().expect("a program lies in a folder");
        folder.display().to_string()
    });
    let path = std::env::var("PATH").unwrap_or_default();
    format!("{}:{path}", folders.join(":"))
}

#[tokio::test]
async fn the_page_on_grpcurl_is_a_procedure_as_it_goes() {
    let cell = Cell::up_with(&["--time-scale", "20"]).await;
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::os::unix::fs::symlink(cell.folder(), folder.path().join("arthro-state"))
        .expect("the state of the cell is where the page has it");
    let address = |service| cell.url(service).trim_start_matches("http://").to_owned();
    let mut shell = Command::new("bash")
        .current_dir(folder.path())
        .env("PATH", search_path())
        .env("GATEWAY", address("gateway"))
        .env("SIMULATOR", address("simulator"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .kill_on_drop(true)
        .spawn()
        .expect("bash starts");
    let mut typed = shell.stdin.take().expect("standard input is piped");
    let stdout = shell.stdout.take().expect("standard output is piped");
    let mut lines = BufReader::new(stdout).lines();

    typed.write_all(b"exec 2>&1\n").await.expect("bash listens");
    let exchanges = exchanges(PAGE);
    assert!(exchanges.len() > 15, "the page has its commands");
    for Exchange { command, answer } in exchanges {
        let text = format!("{command}\necho\necho '{END}'\n");
        typed
            .write_all(text.as_bytes())
            .await
            .expect("bash listens");
        let mut told = String::new();
        while let Some(line) = tokio::time::timeout(LIMIT, lines.next_line())
            .await
            .unwrap_or_else(|_| panic!("{command}\ndoes not end; it told\n{told}"))
            .expect("bash answers")
        {
            if line == END {
                break;
            }
            told.push_str(&line);
            told.push('\n');
        }
        if let Some(difference) = differs(&answer, &told) {
            panic!("{command}\nshall answer\n{answer}\nand answers\n{told}\n{difference}");
        }
    }
    drop(typed);
    shell.wait().await.expect("bash ends");
    cell.teardown().await;
}
