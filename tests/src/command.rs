//! Commands that need no cell, as a script runs them.

use serde_json::Value;
use tokio::process::Command;

use crate::cell::arthro;

/// Exit code and last line of `arthro ARGUMENTS --json`.
pub async fn answered(arguments: &[&str]) -> (i32, Value) {
    let done = Command::new(arthro())
        .args(arguments)
        .arg("--json")
        .output()
        .await
        .expect("arthro runs");
    let out = String::from_utf8_lossy(&done.stdout);
    let last = out.lines().last().unwrap_or_default();
    let value = serde_json::from_str(last).unwrap_or_else(|error| {
        panic!(
            "{arguments:?} printed {last:?}: {error}; {}",
            String::from_utf8_lossy(&done.stderr)
        )
    });
    (done.status.code().expect("it was not killed"), value)
}

/// The number at `path` of an answer.
pub fn number(value: &Value, path: &str) -> f64 {
    value
        .pointer(path)
        .and_then(Value::as_f64)
        .unwrap_or_else(|| panic!("{path} is no number in {value}"))
}
