//! `arthro audit`: a gateway's record is listed, exported and checked, by it and without it; what was tampered with is
//! found, and the exit code says so.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "clippy.toml allows them in tests, which leaves out what tests share"
)]

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;
use tempfile::TempDir;

struct Gateway {
    process: Child,
    address: String,
    folder: TempDir,
}

impl Gateway {
    fn start() -> Self {
        let folder = TempDir::new().unwrap();
        let mut process = Command::new(env!("CARGO_BIN_EXE_arthro"))
            .args(["serve", "gateway", "--listen", "127.0.0.1:0"])
            .args(["--set", "journal=journal.sqlite", "--until-stdin-closes"])
            .current_dir(folder.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(process.stdout.take().unwrap())
            .read_line(&mut line)
            .unwrap();
        let announced: Value = serde_json::from_str(&line).unwrap();
        Self {
            address: format!("http://{}", announced["address"].as_str().unwrap()),
            process,
            folder,
        }
    }

    fn arthro(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_arthro"))
            .args(["--json", "--gateway", &self.address])
            .args(arguments)
            .current_dir(self.folder.path())
            .output()
            .unwrap()
    }

    fn kinds_of(&self, name: &str) -> Vec<String> {
        let listed = answer(&self.arthro(&["audit", "list", "--name", name]));
        let entries = listed["entries"].as_array().unwrap();
        let kind = |entry: &Value| entry["kind"].as_str().unwrap().to_owned();
        entries.iter().map(kind).collect()
    }

    fn verify(&self, chain: &[&str]) -> (Option<i32>, Value) {
        let files = [
            "--heads",
            "journal.sqlite.audit-heads",
            "--key",
            "audit.pub",
        ];
        let checked = self.arthro(&[&["audit", "verify"], chain, &files].concat());
        (checked.status.code(), answer(&checked))
    }

    fn file(&self, name: &str) -> Box<Path> {
        self.folder.path().join(name).into()
    }
}

impl Drop for Gateway {
    fn drop(&mut self) {
        self.process.kill().ok();
        self.process.wait().ok();
    }
}

fn answer(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn a_record_is_checked_with_and_without_its_gateway() {
    let mut gateway = Gateway::start();
    let refused = gateway.arthro(&["run", "nobody", "--operator", "Olsen", "--digest", "0"]);
    assert_eq!(refused.status.code(), Some(3));
    // How a call ended is written after its answer.
    let ended = (0..1000).any(|_| gateway.kinds_of("Olsen") == ["DECISION", "REFUSAL"]);
    assert!(ended, "{:?}", gateway.kinds_of("Olsen"));
    let checked = gateway.arthro(&["audit", "verify"]);
    assert_eq!(answer(&checked)["whole"], true);

    gateway.arthro(&["audit", "export", "audit.jsonl", "--key", "audit.pub"]);
    let chains = [["--journal", "journal.sqlite"], ["--export", "audit.jsonl"]];
    for chain in &chains {
        let (code, answer) = gateway.verify(chain);
        assert_eq!(
            (code, &answer["whole"]),
            (Some(0), &Value::Bool(true)),
            "{answer}"
        );
    }

    // The gateway is killed, and its record stands.
    gateway.process.kill().unwrap();
    gateway.process.wait().unwrap();
    assert_eq!(gateway.verify(&chains[0]).0, Some(0));

    let export = std::fs::read_to_string(gateway.file("audit.jsonl")).unwrap();
    let edited = export.replace("Olsen", "Larsen");
    assert_ne!(edited, export);
    let fewer = export
        .lines()
        .take(2)
        .map(|line| format!("{line}\n"))
        .collect();
    for (tampered, reason) in [(edited, "AUDIT_EDITED"), (fewer, "AUDIT_TRUNCATED")] {
        std::fs::write(gateway.file("audit.jsonl"), tampered).unwrap();
        let (code, answer) = gateway.verify(&chains[1]);
        assert_eq!(
            (code, answer["error"]["reason"].as_str()),
            (Some(1), Some(reason))
        );
    }
    std::fs::remove_file(gateway.file("journal.sqlite.audit-heads")).unwrap();
    let (code, answer) = gateway.verify(&chains[0]);
    assert_eq!(code, Some(1));
    assert_eq!(answer["error"]["reason"], "AUDIT_HEAD_DAMAGED");
}
