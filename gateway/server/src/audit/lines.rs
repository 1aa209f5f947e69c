//! Entries and heads as JSON lines: the export, and the file of heads. One thing has one line: a line that is not, byte for
//! byte, what its content would be written as, was edited.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::entry::{Entry, Kind, Link, Who};
use super::key::KeyId;
use super::verify::Head;
use crate::approval::Digest;

/// An entry as a line.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct EntryLine {
    sequence: u64,
    previous: String,
    at_ms: i64,
    kind: String,
    name: String,
    role: String,
    peer: String,
    stated: String,
    method: String,
    case_id: String,
    procedure_id: String,
    request_digest: String,
    plan_digest: String,
    answers: u64,
    code: String,
    reason: String,
    detail: String,
    hash: String,
    key_id: String,
    signature: String,
}

/// A head as a line.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct HeadLine {
    sequence: u64,
    hash: String,
    key_id: String,
    signature: String,
}

/// Why a line cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the line {0}")]
pub struct LineError(String);

/// The line of an entry, without its end.
pub fn entry(link: &Link) -> Result<String, LineError> {
    let entry = &link.entry;
    let line = EntryLine {
        sequence: link.sequence,
        previous: link.previous.to_string(),
        at_ms: entry.at_ms,
        kind: entry.kind.as_str().to_owned(),
        name: entry.who.name.clone(),
        role: entry.who.role.clone(),
        peer: entry.who.peer.clone(),
        stated: entry.stated.clone(),
        method: entry.method.clone(),
        case_id: entry.case_id.clone(),
        procedure_id: entry.procedure_id.clone(),
        request_digest: text(entry.request),
        plan_digest: text(entry.plan),
        answers: entry.answers,
        code: entry.code.clone(),
        reason: entry.reason.clone(),
        detail: entry.detail.clone(),
        hash: link.hash.to_string(),
        key_id: link.key.to_string(),
        signature: hexadecimal(&link.signature),
    };
    written(&line)
}

/// Reads the line of an entry.
pub fn read_entry(line: &str) -> Result<Link, LineError> {
    let read: EntryLine = parsed(line)?;
    let entry = Entry {
        at_ms: read.at_ms,
        kind: Kind::parse(&read.kind).ok_or_else(|| wrong("kind", &read.kind))?,
        who: Who {
            name: read.name,
            role: read.role,
            peer: read.peer,
        },
        stated: read.stated,
        method: read.method,
        case_id: read.case_id,
        procedure_id: read.procedure_id,
        request: optional("request_digest", &read.request_digest)?,
        plan: optional("plan_digest", &read.plan_digest)?,
        answers: read.answers,
        code: read.code,
        reason: read.reason,
        detail: read.detail,
    };
    let link = Link {
        sequence: read.sequence,
        previous: digest("previous", &read.previous)?,
        entry,
        hash: digest("hash", &read.hash)?,
        key: KeyId::from_text(read.key_id),
        signature: signature(&read.signature)?,
    };
    same(line, &self::entry(&link)?)?;
    Ok(link)
}

/// The line of a head, without its end.
pub fn head(head: &Head) -> Result<String, LineError> {
    written(&HeadLine {
        sequence: head.sequence,
        hash: head.hash.to_string(),
        key_id: head.key.to_string(),
        signature: hexadecimal(&head.signature),
    })
}

/// Reads the line of a head.
pub fn read_head(line: &str) -> Result<Head, LineError> {
    let read: HeadLine = parsed(line)?;
    let head = Head {
        sequence: read.sequence,
        hash: digest("hash", &read.hash)?,
        key: KeyId::from_text(read.key_id),
        signature: signature(&read.signature)?,
    };
    same(line, &self::head(&head)?)?;
    Ok(head)
}

fn written(line: &impl Serialize) -> Result<String, LineError> {
    serde_json::to_string(line).map_err(|error| LineError(format!("cannot be written: {error}")))
}

fn parsed<T: DeserializeOwned>(line: &str) -> Result<T, LineError> {
    serde_json::from_str(line).map_err(|error| LineError(format!("cannot be read: {error}")))
}

fn same(line: &str, written: &str) -> Result<(), LineError> {
    if line == written {
        return Ok(());
    }
    Err(LineError(
        "is not written as the gateway writes it".to_owned(),
    ))
}

fn wrong(field: &str, value: &str) -> LineError {
    LineError(format!("has {value:?} as its {field}"))
}

fn digest(field: &str, text: &str) -> Result<Digest, LineError> {
    Digest::parse(text).ok_or_else(|| wrong(field, text))
}

fn optional(field: &str, text: &str) -> Result<Option<Digest>, LineError> {
    if text.is_empty() {
        return Ok(None);
    }
    digest(field, text).map(Some)
}

fn text(digest: Option<Digest>) -> String {
    digest.map_or_else(String::new, |digest| digest.to_string())
}

/// Bytes as hexadecimal digits.
pub fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A signature is as long as two digests.
fn signature(text: &str) -> Result<[u8; 64], LineError> {
    let halves = text.split_at_checked(64);
    let Some((first, second)) =
        halves.and_then(|(first, second)| Digest::parse(first).zip(Digest::parse(second)))
    else {
        return Err(wrong("signature", text));
    };
    let mut signature = [0; 64];
    signature[..32].copy_from_slice(first.as_bytes());
    signature[32..].copy_from_slice(second.as_bytes());
    Ok(signature)
}
