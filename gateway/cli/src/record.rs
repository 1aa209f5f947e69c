//! `arthro record info FILE` and `arthro replay FILE...`: recordings of procedures, looked at and shown again.

use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;

use arthro_gateway::recording::read::ReadError;
use arthro_gateway::recording::summary::Summary;
use arthro_proto::gateway::v1::{RecordedEvent, RecordedEventKind};
use serde_json::json;
use toml::Value;

use crate::arguments::{Record, Replay};
use crate::commands::show;
use crate::exit::Failure;
use crate::gateway::state_word;
use crate::output::Output;

/// Looks at recordings.
pub fn run(record: Record, output: &Output) -> Result<(), Failure> {
    let Record::Info { file } = record;
    let summary = Summary::of(&file).map_err(|error| unreadable(&error))?;
    print(&file, &summary, output);
    Ok(())
}

/// Shows recordings as a server until it drains.
pub fn replay(arguments: &Replay) -> ExitCode {
    let files = arguments
        .files
        .iter()
        .map(|path| Value::String(path.display().to_string()));
    let set = |key: &str, value: Value| OsString::from(format!("--set={key}={value}"));
    let mut flags = vec![
        OsString::from("arthro replay"),
        OsString::from(format!("--listen={}", arguments.listen)),
        set("files", Value::Array(files.collect())),
        set("speed", Value::Float(arguments.speed)),
        set("from_s", Value::Float(arguments.from)),
        set("repeat", Value::Boolean(arguments.repeat)),
    ];
    if arguments.until_stdin_closes {
        flags.push(OsString::from("--until-stdin-closes"));
    }
    arthro_bootstrap::run::<arthro_gateway::replay::Server>(flags).into()
}

fn print(file: &Path, summary: &Summary, output: &Output) {
    let head = summary.head.clone().unwrap_or_default();
    let procedure = summary.procedure.clone().unwrap_or_default();
    output.line(format!(
        "procedure {}, file {}, {:.1} s, {}",
        head.procedure_id,
        head.segment,
        summary.seconds(),
        if summary.whole {
            "whole"
        } else {
            "cut off: it has no end"
        }
    ));
    output.line(format!(
        "at last {}, {} of {} bites",
        state_word(procedure.state()),
        procedure.bites_done,
        procedure.bites_planned
    ));
    for (topic, lines) in &summary.lines {
        output.line(format!(
            "{lines:>9}  {:<12} {}",
            topic.name(),
            topic.schema()
        ));
    }
    if summary.missing_lines > 0 {
        output.line(format!("{:>9}  missing", summary.missing_lines));
    }
    let began_ns = summary.span_ns.map_or(0, |(first, _)| first);
    for (at_ns, event) in &summary.events {
        output.line(format!(
            "{:>9.3} s  {}  {}",
            (at_ns.saturating_sub(began_ns)) as f64 * 1e-9,
            event.reason,
            event.detail
        ));
    }
    let lines: serde_json::Map<_, _> = summary
        .lines
        .iter()
        .map(|(topic, lines)| (topic.name().to_owned(), json!(lines)))
        .collect();
    output.result(&json!({
        "file": file.display().to_string(),
        "procedure_id": head.procedure_id,
        "case_id": head.case_id,
        "plan_digest": head.plan_digest,
        "segment": head.segment,
        "version": head.version,
        "whole": summary.whole,
        "seconds": summary.seconds(),
        "first_ns": summary.span_ns.map(|(first, _)| first),
        "last_ns": summary.span_ns.map(|(_, last)| last),
        "lines": lines,
        "missing_lines": summary.missing_lines,
        "events": summary.events.iter().map(|(at_ns, event)| json!({
            "at_ns": at_ns,
            "kind": kind_word(event),
            "reason": event.reason,
            "detail": event.detail,
        })).collect::<Vec<_>>(),
        "procedure": summary.procedure.as_ref().map(show::procedure),
    }));
}

fn kind_word(event: &RecordedEvent) -> &'static str {
    match event.kind() {
        RecordedEventKind::Decision => "DECISION",
        RecordedEventKind::Alarm => "ALARM",
        RecordedEventKind::Recording => "RECORDING",
        RecordedEventKind::Unspecified => "UNSPECIFIED",
    }
}

fn unreadable(error: &ReadError) -> Failure {
    let reason = match error {
        ReadError::Unreadable { .. } => "FILE_UNREADABLE",
        ReadError::Damaged { .. } | ReadError::NoProcedure { .. } => "FILE_INVALID",
    };
    Failure::refused_because(reason, error)
}
