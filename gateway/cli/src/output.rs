//! What a command prints: lines for a person, or JSON for a program.
//!
//! Results go to standard output, everything else to standard error, so that a pipe reads results
//! only. With `--json` the last line of standard output is one JSON object, success or not.

use std::io::Write as _;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;
use serde_json::json;

use crate::exit::Failure;

/// Where a command's words go.
#[derive(Debug)]
pub struct Output {
    json: bool,
}

impl Output {
    /// For people, or for programs if `json`.
    pub fn new(json: bool) -> Self {
        Self { json }
    }

    /// Whether a program reads the result.
    pub fn is_json(&self) -> bool {
        self.json
    }

    /// What is going on, for a person; goes to standard error.
    pub fn note(&self, text: impl AsRef<str>) {
        // A closed terminal is no reason to stop a procedure.
        writeln!(std::io::stderr(), "{}", text.as_ref()).ok();
    }

    /// A line of the result for a person; silent with `--json`.
    pub fn line(&self, text: impl AsRef<str>) {
        if !self.json {
            writeln!(std::io::stdout(), "{}", text.as_ref()).ok();
        }
    }

    /// The result for a program; silent without `--json`.
    pub fn result(&self, value: &impl Serialize) {
        if self.json {
            let text = serde_json::to_string(value)
                .unwrap_or_else(|error| json!({"error": error.to_string()}).to_string());
            let mut out = std::io::stdout();
            writeln!(out, "{text}").and_then(|()| out.flush()).ok();
        }
    }

    /// Why the command failed.
    pub fn failure(&self, failure: &Failure) {
        self.note(format!("arthro: {}: {}", failure.reason, failure.message));
        // Mostly the message says all of it.
        let said = |(_, description): &&(String, String)| failure.message.contains(description);
        for (field, description) in failure.violations.iter().filter(|told| !said(told)) {
            self.note(format!("  {field}: {description}"));
        }
        let violations: Vec<_> = failure
            .violations
            .iter()
            .map(|(field, description)| json!({"field": field, "description": description}))
            .collect();
        self.result(&json!({"error": {
            "reason": failure.reason,
            "message": failure.message,
            "violations": violations,
        }}));
    }

    /// A progress bar on standard error; hidden where that is no terminal.
    pub fn progress(&self, title: &str, length: u64) -> ProgressBar {
        let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::stderr());
        let style = ProgressStyle::with_template("{prefix:>14} [{bar:32}] {pos}/{len} {msg}")
            .unwrap_or_else(|_| ProgressStyle::default_bar())
            .progress_chars("=> ");
        bar.set_style(style);
        bar.set_prefix(title.to_owned());
        bar
    }
}
