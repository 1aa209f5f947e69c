use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

use prost::Message as _;
use prost_types::FileDescriptorSet;

use super::*;

/// Every method of the contract, and those that each server has besides.
fn methods() -> BTreeSet<String> {
    let sets = [
        arthro_proto::DESCRIPTORS,
        tonic_health::pb::FILE_DESCRIPTOR_SET,
        tonic_reflection::pb::v1::FILE_DESCRIPTOR_SET,
        tonic_reflection::pb::v1alpha::FILE_DESCRIPTOR_SET,
    ];
    let mut methods = BTreeSet::new();
    for set in sets {
        for file in FileDescriptorSet::decode(set).unwrap().file {
            for service in &file.service {
                for method in &service.method {
                    let (service, method) = (service.name(), method.name());
                    methods.insert(format!("{}.{service}/{method}", file.package()));
                }
            }
        }
    }
    methods
}

#[test]
fn every_method_has_exactly_one_line_and_every_line_a_method() {
    let lines: BTreeSet<String> = RULES.iter().map(|rule| rule.method.to_owned()).collect();
    assert_eq!(lines.len(), RULES.len(), "a method stands there twice");
    let methods = methods();
    let without_line: Vec<_> = methods.difference(&lines).collect();
    let without_method: Vec<_> = lines.difference(&methods).collect();
    assert!(without_line.is_empty(), "add a line: {without_line:?}");
    assert!(without_method.is_empty(), "no method: {without_method:?}");
}

#[test]
fn every_stop_is_open_to_every_role_and_nothing_else_is_a_stop() {
    for rule in RULES {
        let (_, method) = rule.method.split_once('/').unwrap();
        let is_stop = method.starts_with("Stop");
        assert_eq!(rule.effect == Effect::Stop, is_stop, "{}", rule.method);
        if is_stop {
            assert!(
                Role::ALL.into_iter().all(|role| rule.allows(role)),
                "{}",
                rule.method
            );
        }
    }
}

#[test]
fn a_viewer_commands_nothing_and_only_a_surgeon_approves() {
    for rule in RULES {
        if rule.effect.changes() {
            assert!(!rule.allows(Role::Viewer), "{}", rule.method);
        }
        if rule.method.contains("Approve") {
            let allowed = Role::ALL.into_iter().filter(|role| rule.allows(*role));
            assert_eq!(
                allowed.collect::<Vec<_>>(),
                [Role::Surgeon],
                "{}",
                rule.method
            );
        }
    }
}

#[test]
fn a_service_commands_only_motion_and_instrument() {
    for rule in RULES {
        if rule.effect.changes() && rule.allows(Role::Service) {
            let device = ["arthro.motion.", "arthro.instrument."];
            assert!(
                device
                    .iter()
                    .any(|package| rule.method.starts_with(package)),
                "{}",
                rule.method
            );
        }
    }
}

/// `ARTHRO_WRITE_DOCS=1 cargo test -p arthro-bootstrap roles` writes it anew.
#[test]
fn the_documented_table_is_this_one() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/roles.md");
    let table = document();
    if std::env::var_os("ARTHRO_WRITE_DOCS").is_some() {
        std::fs::write(&path, &table).unwrap();
    }
    let written = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        written == table,
        "docs/roles.md is not the table of roles.rs; write it anew with ARTHRO_WRITE_DOCS=1"
    );
}

fn document() -> String {
    let mut text = String::from(
        "# Who may call what\n\n\
         Written from `services/bootstrap/src/roles.rs` by its test; [security.md](security.md) says how a role is held. A person may all \
         that a lesser one may: viewer < operator < surgeon. Without TLS, over loopback, everything is open.\n",
    );
    let mut last = "";
    for rule in RULES {
        let (service, method) = rule.method.split_once('/').unwrap();
        if service != last {
            write!(
                text,
                "\n## {service}\n\n| method | effect | viewer | operator | surgeon | service |\n|---|---|---|---|---|---|\n"
            )
            .unwrap();
            last = service;
        }
        write!(text, "| {method} | {} |", rule.effect.as_str()).unwrap();
        for role in Role::ALL {
            let mark = if rule.allows(role) { "yes" } else { "-" };
            write!(text, " {mark} |").unwrap();
        }
        text.push('\n');
    }
    text
}
