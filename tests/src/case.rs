//! A case on its way, driven by the `arthro` command as an operator drives it.

use serde_json::Value;
use tokio::process::Command;

use crate::cell::{Cell, arthro};

/// What one `arthro --json` command gave.
#[derive(Debug)]
pub struct Answer {
    /// The exit code.
    pub code: i32,
    /// The last line of standard output.
    pub json: Value,
}

impl Answer {
    /// The reason word of a failure.
    pub fn reason(&self) -> &str {
        self.json["error"]["reason"].as_str().unwrap_or_default()
    }
}

impl Cell {
    /// Runs `arthro --json` with these arguments against this cell's gateway.
    pub async fn command(&self, arguments: &[&str]) -> Answer {
        let done = Command::new(arthro())
            .args(["--json", "--gateway", self.url("gateway")])
            .args(arguments)
            .output()
            .await
            .expect("arthro runs");
        let text = String::from_utf8_lossy(&done.stdout);
        let last = text.lines().last().unwrap_or_default();
        let json = serde_json::from_str(last).unwrap_or_else(|error| {
            let errors = String::from_utf8_lossy(&done.stderr);
            panic!("arthro {arguments:?} printed {text:?} and {errors:?}: {error}")
        });
        Answer {
            code: done.status.code().unwrap_or(-1),
            json,
        }
    }

    /// The same, which must succeed.
    pub async fn done(&self, arguments: &[&str]) -> Value {
        let answer = self.command(arguments).await;
        assert_eq!(answer.code, 0, "arthro {arguments:?}: {}", answer.json);
        answer.json
    }

    /// A case with the cell's model and a fresh frame of the simulated camera.
    pub async fn case(&self) -> String {
        let (model, lesion) = (path(&self.at.model), path(&self.at.lesion));
        let created = self
            .done(&[
                "case", "create", "test", "--model", &model, "--lesion", &lesion,
            ])
            .await;
        let case = created["case_id"]
            .as_str()
            .expect("a case has an id")
            .to_owned();
        let simulator = self.url("simulator").to_owned();
        self.done(&["case", "scene", &case, "--simulator", &simulator])
            .await;
        case
    }

    /// A case with an accepted registration.
    pub async fn registered_case(&self) -> String {
        let case = self.case().await;
        self.done(&["case", "register", &case]).await;
        self.done(&["case", "accept", &case, "--operator", "test"])
            .await;
        case
    }

    /// A case with a plan of several bites around its lesion, and the plan's digest.
    pub async fn planned_case(&self) -> (String, String) {
        let case = self.registered_case().await;
        let plan = self.done(&["case", "plan", &case]).await;
        let bites = plan["targets"].as_u64();
        assert!(bites.is_some_and(|bites| bites >= 3), "{plan}");
        let digest = plan["plan_digest"].as_str().expect("a plan has a digest");
        (case, digest.to_owned())
    }

    /// A case with an approved plan, and the plan's digest.
    pub async fn approved_case(&self) -> (String, String) {
        let (case, digest) = self.planned_case().await;
        self.done(&[
            "case",
            "approve",
            &case,
            "--digest",
            &digest,
            "--surgeon",
            "test",
        ])
        .await;
        (case, digest)
    }
}

fn path(path: &std::path::Path) -> String {
    path.display().to_string()
}
