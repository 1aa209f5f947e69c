//! The audit: what stands in it, what is found when it was tampered with, and what happens when it cannot be written.

use std::path::PathBuf;

use arthro_gateway::audit::heads;
use arthro_gateway::audit::key::{PublicKey, public_path};
use arthro_gateway::audit::read::check_export;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::{AuditKind, ProcedureState, RecoveryAction};
use sqlx::{Row as _, SqliteConnection};
use tonic::Code;

use super::bench::{Bench, reason};

const CASES: &str = "/arthro.gateway.v1.CaseService";
const PROCEDURES: &str = "/arthro.gateway.v1.ProcedureService";

fn beside(bench: &Bench, ending: &str) -> PathBuf {
    format!("{}{ending}", bench.config.journal).into()
}

async fn execute(file: &mut SqliteConnection, statement: &str) -> Result<u64, sqlx::Error> {
    let statement = sqlx::AssertSqlSafe(statement.to_owned());
    sqlx::query(statement)
        .execute(file)
        .await
        .map(|done| done.rows_affected())
}

async fn export(bench: &mut Bench) -> Vec<u8> {
    let request = proto::ExportEntriesRequest {};
    let mut answers = bench
        .audit
        .export_entries(request)
        .await
        .unwrap()
        .into_inner();
    let mut export = Vec::new();
    while let Some(answer) = answers.message().await.unwrap() {
        export.extend_from_slice(&answer.lines);
    }
    export
}

#[tokio::test(flavor = "multi_thread")]
async fn every_command_and_decision_stands_before_its_outcome() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    let procedure_id = bench.start(&case_id, &digest).await.unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    let ended = bench
        .entry(|entry| entry.kind() == AuditKind::Procedure && entry.code == "COMPLETED")
        .await;
    assert_eq!(
        (ended.case_id, ended.plan_digest),
        (case_id.clone(), digest.clone())
    );

    let entries = bench.entries().await;
    assert_eq!(entries[0].kind(), AuditKind::Start);
    for (method, kind) in [
        (format!("{CASES}/CreateCase"), AuditKind::Command),
        (format!("{CASES}/UploadModel"), AuditKind::Command),
        (format!("{CASES}/UploadScene"), AuditKind::Command),
        (format!("{CASES}/RegisterCase"), AuditKind::Command),
        (format!("{CASES}/AcceptRegistration"), AuditKind::Decision),
        (format!("{CASES}/PlanCase"), AuditKind::Command),
        (format!("{CASES}/ApprovePlan"), AuditKind::Decision),
        (format!("{PROCEDURES}/StartProcedure"), AuditKind::Decision),
    ] {
        let begun = entries
            .iter()
            .find(|entry| entry.method == method)
            .unwrap_or_else(|| panic!("{method} is not recorded"));
        assert_eq!(begun.kind(), kind, "{method}");
        assert_eq!(
            (begun.name.as_str(), begun.role.as_str()),
            ("local", "local")
        );
        assert!(begun.peer.starts_with("127.0.0.1:"), "{}", begun.peer);
        let outcome = entries
            .iter()
            .find(|entry| entry.answers == begun.sequence)
            .unwrap_or_else(|| panic!("{method} has no outcome"));
        assert_eq!(outcome.kind(), AuditKind::Outcome);
        assert_eq!(
            (outcome.code.as_str(), outcome.method.as_str()),
            ("OK", method.as_str())
        );
        assert_eq!(outcome.request_digest.len(), 64, "{method}");
        if method != format!("{CASES}/CreateCase") {
            assert_eq!(begun.case_id, case_id, "{method}");
        }
    }
    let approval = entries
        .iter()
        .find(|entry| entry.kind() == AuditKind::Approval)
        .unwrap();
    assert_eq!(
        (approval.stated.as_str(), approval.code.as_str()),
        ("surgeon", "APPROVED")
    );
    assert_eq!(approval.plan_digest, digest);
    // What only reads leaves no trace.
    for reading in ["/GetCase", "/WatchProcedure", "/ListEntries"] {
        assert!(entries.iter().all(|entry| !entry.method.ends_with(reading)));
    }
    assert!(bench.verdict().await.whole);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_refusal_stands_with_its_reason() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.planned().await;
    assert_eq!(reason(bench.start(&case_id, &digest).await), "NOT_APPROVED");
    let refusal = bench
        .entry(|entry| entry.kind() == AuditKind::Refusal)
        .await;
    assert_eq!(refusal.method, format!("{PROCEDURES}/StartProcedure"));
    assert_eq!(
        (refusal.code.as_str(), refusal.reason.as_str()),
        ("FAILED_PRECONDITION", "NOT_APPROVED")
    );
    assert_eq!(
        (refusal.stated.as_str(), refusal.plan_digest),
        ("operator", digest)
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stop_and_what_it_interrupts_are_recorded_and_so_is_the_decision_after_it() {
    let mut bench = Bench::new().await;
    bench.world.hold("INSERT FORCEPS");
    let procedure_id = bench.started().await;
    bench.world.arrived("INSERT FORCEPS", 1).await;
    let request = proto::StopProcedureRequest {
        reason: "the knee slipped".to_owned(),
        wait_for_devices: true,
    };
    bench.procedures.stop_procedure(request).await.unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    bench.world.let_go();
    let stop = bench.entry(|entry| entry.kind() == AuditKind::Stop).await;
    assert_eq!(stop.detail, "the knee slipped");
    bench.entry(|entry| entry.answers == stop.sequence).await;
    let alarm = bench.entry(|entry| entry.kind() == AuditKind::Alarm).await;
    assert_eq!(
        (alarm.procedure_id, alarm.reason),
        (procedure_id.clone(), "STOPPED".to_owned())
    );
    bench
        .recover(&procedure_id, RecoveryAction::Withdraw)
        .await
        .unwrap();
    let decision = format!("{PROCEDURES}/RecoverProcedure");
    let decision = bench.entry(|entry| entry.method == decision).await;
    assert_eq!(
        (decision.kind(), decision.stated.as_str()),
        (AuditKind::Decision, "operator")
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_crash_left_open_is_an_alarm_of_the_next_gateway_in_the_same_chain() {
    let mut bench = Bench::new().await;
    bench.world.hold("BITE");
    let procedure_id = bench.started().await;
    bench.world.arrived("BITE", 1).await;
    bench.kill().await;
    bench.world.let_go();
    bench.restart(|_| {}).await;
    let alarm = bench.entry(|entry| entry.kind() == AuditKind::Alarm).await;
    assert_eq!(
        (alarm.procedure_id, alarm.reason),
        (procedure_id, "GATEWAY_RESTARTED".to_owned())
    );
    let starts = bench.entries().await;
    let starts = starts
        .iter()
        .filter(|entry| entry.kind() == AuditKind::Start);
    assert_eq!(starts.count(), 2);
    assert!(bench.verdict().await.whole);
}

#[tokio::test(flavor = "multi_thread")]
async fn without_the_audit_nothing_is_commanded_and_a_stop_still_stops() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    let mut file = bench.intrude().await;
    let fail = "CREATE TRIGGER full BEFORE INSERT ON audit BEGIN SELECT RAISE(ABORT, 'the disk is full'); END";
    execute(&mut file, fail).await.unwrap();

    let refused = bench.start(&case_id, &digest).await.unwrap_err();
    assert_eq!(refused.code(), Code::Unavailable);
    assert!(
        refused.message().contains("the disk is full"),
        "{refused:?}"
    );
    assert_eq!(reason(bench.start(&case_id, &digest).await), "AUDIT_FAILED");
    assert!(bench.world.commands().is_empty());
    let request = proto::StopProcedureRequest {
        reason: "the audit failed".to_owned(),
        wait_for_devices: true,
    };
    bench.procedures.stop_procedure(request).await.unwrap();
    assert_eq!(*bench.world.stops.borrow(), 2);

    // Once it can be written, the stop and the refusals stand there, and commands are taken again.
    execute(&mut file, "DROP TRIGGER full").await.unwrap();
    let stop = bench.entry(|entry| entry.kind() == AuditKind::Stop).await;
    assert_eq!(stop.detail, "the audit failed");
    let refused = bench
        .entry(|entry| entry.kind() == AuditKind::Refusal && entry.reason == "AUDIT_FAILED")
        .await;
    assert_eq!(refused.answers, 0);
    bench.start(&case_id, &digest).await.unwrap();
    assert!(bench.verdict().await.whole);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_database_refuses_to_change_or_delete_what_is_recorded() {
    let mut bench = Bench::new().await;
    bench.case().await;
    let mut file = bench.intrude().await;
    for statement in ["UPDATE audit SET detail = 'x'", "DELETE FROM audit"] {
        let refused = execute(&mut file, statement).await.unwrap_err();
        assert!(refused.to_string().contains("append only"), "{refused}");
    }
    assert!(bench.verdict().await.whole);
}

/// Statements of somebody who has the file but not the key, and what is found.
#[tokio::test(flavor = "multi_thread")]
async fn what_is_done_to_the_file_is_found_and_named() {
    let mut bench = Bench::new().await;
    let (case_id, _) = bench.approved().await;
    let opened = bench
        .entry(|entry| entry.kind() == AuditKind::Approval)
        .await;
    bench
        .entry(|entry| entry.answers != 0 && entry.method.ends_with("/ApprovePlan"))
        .await;
    assert_eq!(opened.case_id, case_id);
    let mut file = bench.intrude().await;
    for trigger in ["audit_is_not_changed", "audit_is_not_deleted"] {
        let drop = format!("DROP TRIGGER {trigger}");
        execute(&mut file, &drop).await.unwrap();
    }
    let columns: Vec<String> = sqlx::query("PRAGMA table_info(audit)")
        .fetch_all(&mut file)
        .await
        .unwrap()
        .iter()
        .map(|row| row.get("name"))
        .collect();
    assert_eq!(columns.len(), 20);
    let mut attacks: Vec<(String, &[&str])> = columns
        .iter()
        .map(|column| {
            let value = match column.as_str() {
                "sequence" => "1000",
                "at_ms" | "answers" => &*format!("{column} + 1"),
                "previous" | "hash" | "request_digest" | "plan_digest" => "randomblob(32)",
                "signature" => "randomblob(64)",
                _ => &*format!("{column} || 'x'"),
            };
            let update = format!("UPDATE audit SET {column} = {value} WHERE sequence = 5");
            let faults: &[&str] = match column.as_str() {
                "sequence" => &["REMOVED"],
                "signature" => &["SIGNATURE_WRONG"],
                _ => &["EDITED"],
            };
            (update, faults)
        })
        .collect();
    attacks.extend::<[(String, &[&str]); 6]>([
        ("DELETE FROM audit WHERE sequence = 7".into(), &["REMOVED"]),
        ("DELETE FROM audit WHERE sequence <= 3".into(), &["REMOVED"]),
        ("DELETE FROM audit WHERE sequence >= 9".into(), &["TRUNCATED"]),
        ("DELETE FROM audit".into(), &["TRUNCATED"]),
        (
            "UPDATE audit SET sequence = CASE sequence WHEN 4 THEN -6 ELSE -4 END WHERE sequence IN (4, 6); \
             UPDATE audit SET sequence = -sequence WHERE sequence < 0"
                .into(),
            &["EDITED"],
        ),
        (
            "INSERT INTO audit SELECT (SELECT max(sequence) + 1 FROM audit), previous, at_ms, kind, name, role, peer, \
             stated, method, case_id, procedure_id, request_digest, plan_digest, answers, code, reason, detail, hash, \
             key_id, signature FROM audit WHERE sequence = 5"
                .into(),
            &["EDITED"],
        ),
    ]);
    execute(&mut file, "CREATE TABLE kept AS SELECT * FROM audit")
        .await
        .unwrap();
    assert!(bench.verdict().await.whole);
    for (attack, faults) in attacks {
        for statement in attack.split("; ") {
            assert_ne!(
                execute(&mut file, statement).await.unwrap(),
                0,
                "{statement}"
            );
        }
        let verdict = bench.verdict().await;
        assert!(!verdict.whole, "{attack}");
        assert!(
            faults.contains(&verdict.fault.as_str()),
            "{attack}: {verdict:?}"
        );
        execute(&mut file, "DELETE FROM audit").await.unwrap();
        execute(&mut file, "INSERT INTO audit SELECT * FROM kept")
            .await
            .unwrap();
    }
    assert!(bench.verdict().await.whole);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_export_is_checked_elsewhere_with_the_public_key_and_the_heads() {
    let mut bench = Bench::new().await;
    bench.approved().await;
    let export = export(&mut bench).await;
    let key = PublicKey::read(&public_path(&beside(&bench, ".audit-key"))).unwrap();
    let text = std::fs::read_to_string(beside(&bench, ".audit-heads")).unwrap();
    let head = bench
        .audit
        .get_head(proto::GetHeadRequest {})
        .await
        .unwrap();
    let head = head.into_inner();
    assert_eq!(head.public_key, key.to_pem());
    assert!(text.lines().any(|line| line == head.line));

    let heads = heads::parse(&text).unwrap();
    let check = |export: &[u8]| check_export(export, vec![key.clone()], heads.clone()).unwrap();
    // Heads that were kept after the export are of entries that it does not have.
    let last = export.iter().filter(|&&byte| byte == b'\n').count() as u64;
    assert!(last >= 10);
    let known: Vec<_> = heads
        .iter()
        .filter(|head| head.sequence <= last)
        .cloned()
        .collect();
    let whole = check_export(&export[..], vec![key.clone()], known).unwrap();
    assert_eq!(whole.unwrap().sequence, last);
    let cut = export.iter().position(|&byte| byte == b'\n').unwrap() + 1;
    assert!(check(&export[..cut]).is_err());
    assert!(check(&export[cut..]).is_err());
}

#[tokio::test(flavor = "multi_thread")]
async fn entries_are_listed_by_page_kind_person_and_case() {
    let mut bench = Bench::new().await;
    let (case_id, _) = bench.approved().await;
    bench.case().await;
    let all = bench.entries().await;
    let mut paged = Vec::new();
    let mut request = proto::ListEntriesRequest {
        page_size: 3,
        ..proto::ListEntriesRequest::default()
    };
    while paged.len() < all.len() {
        let page = bench.audit.list_entries(request.clone()).await.unwrap();
        let page = page.into_inner();
        paged.extend(page.entries.into_iter().map(|listed| listed.entry.unwrap()));
        request.from_sequence = page.next_sequence;
    }
    assert_eq!(paged[..all.len()], all[..]);

    let request = proto::ListEntriesRequest {
        newest_first: true,
        kind: AuditKind::Decision.into(),
        name: "surgeon".to_owned(),
        case_id: case_id.clone(),
        ..proto::ListEntriesRequest::default()
    };
    let listed = bench
        .audit
        .list_entries(request)
        .await
        .unwrap()
        .into_inner();
    assert_eq!(listed.entries.len(), 1);
    let entry = listed.entries[0].entry.as_ref().unwrap();
    assert_eq!(entry.method, format!("{CASES}/ApprovePlan"));

    let request = proto::ListEntriesRequest {
        page_size: 1001,
        ..proto::ListEntriesRequest::default()
    };
    let refused = bench.audit.list_entries(request).await.unwrap_err();
    assert_eq!(
        refused.message(),
        "page_size: is 1001; must be within 1 .. 1000, or 0 for 100"
    );
}
