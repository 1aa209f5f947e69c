//! `arthro audit`: lists, checks and exports the record of who did what. A check of files needs no server, and trusts
//! nothing but the public key it is given.

use std::fs::File;
use std::io::{BufReader, Write as _};
use std::path::{Path, PathBuf};

use arthro_gateway::audit::heads;
use arthro_gateway::audit::key::PublicKey;
use arthro_gateway::audit::read::{JournalCheck, Verdict, check_export};
use arthro_gateway::audit::verify::{Defect, Fault, Head};
use arthro_gateway::journal::sqlite;
use arthro_proto::gateway::v1::{
    AuditEntry, AuditKind, ExportEntriesRequest, GetHeadRequest, ListEntriesRequest,
    VerifyChainRequest,
};
use serde_json::{Value, json};

use crate::arguments::{Audit, AuditExport, AuditKindName, AuditList, AuditVerify};
use crate::exit::Failure;
use crate::gateway::Gateway;
use crate::output::Output;

/// Runs the command; connects only where a gateway is asked.
pub async fn run<C>(
    audit: Audit,
    connect: impl FnOnce() -> C,
    output: &Output,
) -> Result<(), Failure>
where
    C: Future<Output = Result<Gateway, Failure>>,
{
    match audit {
        Audit::List(list) => self::list(list, &mut connect().await?, output).await,
        Audit::Export(export) => self::export(&export, &mut connect().await?, output).await,
        Audit::Verify(verify) => match (&verify.journal, &verify.export) {
            (Some(path), _) => verify_journal(path, &verify, output).await,
            (None, Some(path)) => verify_export(path, &verify, output),
            (None, None) => verify_online(&mut connect().await?, output).await,
        },
    }
}

async fn list(list: AuditList, gateway: &mut Gateway, output: &Output) -> Result<(), Failure> {
    let request = ListEntriesRequest {
        page_size: list.last,
        newest_first: true,
        kind: list.kind.map_or(AuditKind::Unspecified, kind).into(),
        name: list.name.unwrap_or_default(),
        case_id: list.case.unwrap_or_default(),
        procedure_id: list.procedure.unwrap_or_default(),
        ..ListEntriesRequest::default()
    };
    let listed = gateway.audit.list_entries(request).await?.into_inner();
    let mut values = Vec::new();
    for listed in listed.entries.into_iter().rev() {
        let entry = listed.entry.unwrap_or_default();
        match listed.damage.as_str() {
            "" => output.line(line(&entry)),
            damage => output.line(format!("{:>8}  damaged: {damage}", entry.sequence)),
        }
        values.push(value(&entry, &listed.damage));
    }
    output.result(&json!({"entries": values}));
    Ok(())
}

async fn export(
    export: &AuditExport,
    gateway: &mut Gateway,
    output: &Output,
) -> Result<(), Failure> {
    let mut file = File::create(&export.file).map_err(|error| unwritable(&export.file, &error))?;
    let mut answers = gateway
        .audit
        .export_entries(ExportEntriesRequest {})
        .await?
        .into_inner();
    let mut entries = 0_u64;
    while let Some(answer) = answers.message().await? {
        entries += answer.lines.iter().filter(|&&byte| byte == b'\n').count() as u64;
        file.write_all(&answer.lines)
            .map_err(|error| unwritable(&export.file, &error))?;
    }
    file.sync_all()
        .map_err(|error| unwritable(&export.file, &error))?;
    let head = gateway
        .audit
        .get_head(GetHeadRequest {})
        .await?
        .into_inner();
    if let Some(path) = &export.key {
        std::fs::write(path, &head.public_key).map_err(|error| unwritable(path, &error))?;
    }
    output.line(format!("{entries} entries, signed by {}", head.key_id));
    output.result(&json!({"entries": entries, "key_id": head.key_id}));
    Ok(())
}

async fn verify_online(gateway: &mut Gateway, output: &Output) -> Result<(), Failure> {
    let mut answers = gateway
        .audit
        .verify_chain(VerifyChainRequest {})
        .await?
        .into_inner();
    let bar = output.progress("audit", 0);
    let mut last = None;
    while let Some(answer) = answers.message().await? {
        bar.set_position(answer.checked);
        last = answer.verdict.map(|verdict| (answer.checked, verdict));
    }
    bar.finish_and_clear();
    match last {
        None => Err(Failure::failed(
            "ANSWER_INCOMPLETE",
            "the gateway came to no verdict",
        )),
        Some((checked, verdict)) if verdict.whole => {
            whole(checked, verdict.heads, output);
            Ok(())
        }
        Some((_, verdict)) => Err(broken(&verdict.fault, verdict.sequence, &verdict.detail)),
    }
}

async fn verify_journal(path: &Path, verify: &AuditVerify, output: &Output) -> Result<(), Failure> {
    let (keys, heads) = trusted(verify)?;
    let count = heads.len() as u64;
    let unreadable = |error| Failure::failed("JOURNAL_UNREADABLE", error);
    let file = sqlite::audit(path).await.map_err(unreadable)?;
    let check = JournalCheck::new(&file, keys, heads);
    concluded(check.run().await.map_err(unreadable)?, count, output)
}

fn verify_export(path: &Path, verify: &AuditVerify, output: &Output) -> Result<(), Failure> {
    let (keys, heads) = trusted(verify)?;
    let count = heads.len() as u64;
    let file = File::open(path).map_err(|error| unreadable(path, &error))?;
    let verdict = check_export(BufReader::new(file), keys, heads)
        .map_err(|error| unreadable(path, &error))?;
    concluded(verdict, count, output)
}

/// The keys and heads that were given. A file of heads that is not there is what somebody leaves who cut the chain.
fn trusted(verify: &AuditVerify) -> Result<(Vec<PublicKey>, Vec<Head>), Failure> {
    let read_key = |path: &PathBuf| {
        PublicKey::read(path).map_err(|error| Failure::refused_because("KEY_UNREADABLE", &error))
    };
    let keys = verify.keys.iter().map(read_key).collect::<Result<_, _>>()?;
    let mut all = Vec::new();
    for path in &verify.heads {
        let text = std::fs::read_to_string(path).map_err(|error| {
            let detail = format!("{} cannot be read: {error}", path.display());
            defective(&Defect::new(Fault::HeadDamaged, 0, detail))
        })?;
        all.extend(heads::parse(&text).map_err(|defect| defective(&defect))?);
    }
    Ok((keys, all))
}

fn concluded(verdict: Verdict, heads: u64, output: &Output) -> Result<(), Failure> {
    let tail = verdict.map_err(|defect| defective(&defect))?;
    whole(tail.sequence, heads, output);
    Ok(())
}

fn whole(entries: u64, heads: u64, output: &Output) {
    output.line(format!(
        "whole: {entries} entries, each in its place and signed; {heads} heads agree"
    ));
    output.result(&json!({"whole": true, "entries": entries, "heads": heads}));
}

fn defective(defect: &Defect) -> Failure {
    broken(defect.fault.as_str(), defect.sequence, &defect.detail)
}

fn broken(fault: &str, sequence: u64, detail: &str) -> Failure {
    Failure::failed(
        &format!("AUDIT_{fault}"),
        format!("the audit is not whole at entry {sequence}: {detail}"),
    )
}

fn unreadable(path: &Path, error: &std::io::Error) -> Failure {
    Failure::refused("FILE_UNREADABLE", format!("{}: {error}", path.display()))
}

fn unwritable(path: &Path, error: &std::io::Error) -> Failure {
    Failure::refused("FILE_UNWRITABLE", format!("{}: {error}", path.display()))
}

// === showing ===

fn line(entry: &AuditEntry) -> String {
    let who = match entry.stated.as_str() {
        "" => entry.name.clone(),
        stated if stated == entry.name => entry.name.clone(),
        stated => format!("{stated} ({})", entry.name),
    };
    let method = entry.method.rsplit('/').next().unwrap_or_default();
    let mut text = format!(
        "{:>8}  {}  {:<9}  {who:<20}  {method}",
        entry.sequence,
        entry.at_ms,
        kind_word(entry)
    );
    for (sign, part) in [
        ("", entry.code.clone()),
        ("", entry.reason.clone()),
        ("to ", number(entry.answers)),
        ("", entry.detail.clone()),
    ] {
        if !part.is_empty() {
            text.push_str("  ");
            text.push_str(sign);
            text.push_str(&part);
        }
    }
    text
}

fn number(number: u64) -> String {
    match number {
        0 => String::new(),
        number => number.to_string(),
    }
}

fn value(entry: &AuditEntry, damage: &str) -> Value {
    json!({
        "sequence": entry.sequence,
        "at_ms": entry.at_ms,
        "kind": kind_word(entry),
        "name": entry.name,
        "role": entry.role,
        "peer": entry.peer,
        "stated": entry.stated,
        "method": entry.method,
        "case_id": entry.case_id,
        "procedure_id": entry.procedure_id,
        "request_digest": entry.request_digest,
        "plan_digest": entry.plan_digest,
        "answers": entry.answers,
        "code": entry.code,
        "reason": entry.reason,
        "detail": entry.detail,
        "hash": entry.hash,
        "damage": damage,
    })
}

fn kind_word(entry: &AuditEntry) -> &'static str {
    entry.kind().as_str_name().trim_start_matches("AUDIT_KIND_")
}

fn kind(name: AuditKindName) -> AuditKind {
    match name {
        AuditKindName::Start => AuditKind::Start,
        AuditKindName::End => AuditKind::End,
        AuditKindName::Command => AuditKind::Command,
        AuditKindName::Decision => AuditKind::Decision,
        AuditKindName::Stop => AuditKind::Stop,
        AuditKindName::Outcome => AuditKind::Outcome,
        AuditKindName::Refusal => AuditKind::Refusal,
        AuditKindName::Approval => AuditKind::Approval,
        AuditKindName::Procedure => AuditKind::Procedure,
        AuditKindName::Alarm => AuditKind::Alarm,
    }
}
