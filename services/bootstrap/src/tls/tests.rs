//! Whom a server lets in, over real connections, at least a hundred attempts of each kind.

mod site;

use std::io::{Read as _, Write as _};
use std::time::Duration;

use rustls::version::{TLS12, TLS13};
use tonic::Code;

use self::site::{Holder, Server, Site, Visitor};
use super::*;
use crate::Caller;
use crate::identity::Role;

const ATTEMPTS: usize = 100;

/// Every attempt fails, and the server says so each time.
async fn none_accepted(what: &str, server: &Server, visitor: &Visitor) {
    let mut refusals = server.refusals();
    let mut accepted = 0;
    for _ in 0..ATTEMPTS {
        if visitor.checks_health(server).await.is_ok() {
            accepted += 1;
        }
        let refusal = refusals.recv().await.unwrap();
        assert_eq!(refusal.reason, incoming::HANDSHAKE_REFUSED, "{what}");
    }
    println!("{what}: {accepted} of {ATTEMPTS} accepted");
    assert_eq!(accepted, 0, "{what}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_certificate_of_the_site_is_let_in() {
    let site = Site::new();
    let server = site.server().await;
    for role in Role::ALL {
        let visitor = site.visitor(Holder::new("Dr. Adams", role));
        visitor.checks_health(&server).await.unwrap();
        let caller = Caller::Certified {
            name: "Dr. Adams".into(),
            role,
        };
        assert_eq!(server.last_caller(), Some(caller));
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nobody_else_is_let_in() {
    let site = Site::new();
    let server = site.server().await;
    let good = || Holder::new("Dr. Adams", Role::Surgeon);
    let stranger = Site::new();
    let trusting = |visitor: Visitor| visitor.trusting(&site);
    let kinds = [
        ("another authority", trusting(stranger.visitor(good()))),
        ("self-signed", site.visitor(good().self_signed())),
        ("expired", site.visitor(good().expired())),
        ("not yet valid", site.visitor(good().not_yet_valid())),
        ("no role", site.visitor(good().uris(&["urn:arthro:name:x"]))),
        (
            "no name",
            site.visitor(good().uris(&["urn:arthro:role:surgeon"])),
        ),
        ("no identity at all", site.visitor(good().uris(&[]))),
        (
            "two roles",
            site.visitor(good().and_uri("urn:arthro:role:viewer")),
        ),
        (
            "the same role twice",
            site.visitor(good().and_uri("urn:arthro:role:surgeon")),
        ),
        (
            "two names",
            site.visitor(good().and_uri("urn:arthro:name:Dr.%20Brown")),
        ),
        (
            "an unknown role",
            site.visitor(good().uris(&["urn:arthro:name:x", "urn:arthro:role:admin"])),
        ),
        ("for servers only", site.visitor(good().for_servers_only())),
        ("no certificate", site.anonymous(&TLS13)),
        ("TLS 1.2", site.visitor_by(good(), &TLS12)),
    ];
    for (what, visitor) in kinds {
        none_accepted(what, &server, &visitor).await;
    }
    assert_eq!(server.last_caller(), None, "a call has reached the service");
    let visitor = site.visitor(good());
    visitor.checks_health(&server).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn plain_http2_and_tls_1_1_are_not_spoken() {
    let site = Site::new();
    let server = site.server().await;
    let preface = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0".to_vec();
    for (what, hello) in [("plaintext", preface), ("TLS 1.1", hello_of_tls_1_1())] {
        let mut refusals = server.refusals();
        for _ in 0..ATTEMPTS {
            let (address, hello) = (server.address(), hello.clone());
            let answer = tokio::task::spawn_blocking(move || {
                let mut stream = std::net::TcpStream::connect(address).unwrap();
                stream.write_all(&hello).unwrap();
                let mut answer = Vec::new();
                // A reset is an end as well.
                stream.read_to_end(&mut answer).ok();
                answer
            });
            // An alert at most: its record's type is 21, a ServerHello's 22.
            let answer = answer.await.unwrap();
            assert!(answer.first().is_none_or(|first| *first == 21), "{what}");
            let refusal = refusals.recv().await.unwrap();
            assert_eq!(refusal.reason, incoming::HANDSHAKE_REFUSED);
        }
        println!("{what}: 0 of {ATTEMPTS} accepted");
    }
    assert_eq!(server.last_caller(), None);
}

/// A ClientHello of RFC 4346: version 3.2, one suite, no extension.
fn hello_of_tls_1_1() -> Vec<u8> {
    let mut body = vec![3, 2];
    body.extend([7; 32]);
    body.extend([0, 0, 2, 0xc0, 0x13, 1, 0]);
    let mut record = vec![22, 3, 1, 0, body.len() as u8 + 4, 1, 0, 0, body.len() as u8];
    record.extend(body);
    record
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_role_that_does_not_suffice_is_refused_by_every_class_of_method() {
    let site = Site::new();
    let server = site.server().await;
    let cases = "arthro.gateway.v1.CaseService";
    let motion = "arthro.motion.v1.MotionService";
    let instrument = "arthro.instrument.v1.InstrumentService";
    let refused = [
        (Role::Viewer, format!("{cases}/CreateCase")),
        (Role::Viewer, format!("{cases}/ApprovePlan")),
        (Role::Viewer, format!("{motion}/Move")),
        (
            Role::Viewer,
            "arthro.planning.v1.PlanningService/FitContour".into(),
        ),
        (
            Role::Viewer,
            "arthro.simulator.v1.FaultService/ClearFaults".into(),
        ),
        (Role::Operator, format!("{cases}/ApprovePlan")),
        (Role::Service, format!("{cases}/ListCases")),
        (Role::Service, format!("{cases}/ApprovePlan")),
        (
            Role::Service,
            "arthro.gateway.v1.ProcedureService/StartProcedure".into(),
        ),
        (Role::Service, format!("{instrument}/WriteObject")),
    ];
    let mut refusals = server.refusals();
    for (role, method) in refused {
        let channel = site.visitor(Holder::new("x", role)).channel(&server);
        let mut accepted = 0;
        for _ in 0..ATTEMPTS {
            let status = site::call(&channel, &method).await.unwrap_err();
            if status.code() != Code::PermissionDenied {
                accepted += 1;
            }
            let word = crate::status::reason(&status);
            assert_eq!(word.as_deref(), Some("ROLE_NOT_ALLOWED"), "{method}");
            let refusal = refusals.recv().await.unwrap();
            assert_eq!(refusal.method, format!("/{method}"));
        }
        println!("{role} calls {method}: {accepted} of {ATTEMPTS} accepted");
        assert_eq!(accepted, 0);
    }
    assert_eq!(server.last_caller(), None, "a call has reached the service");

    let surgeon = site
        .visitor(Holder::new("x", Role::Surgeon))
        .channel(&server);
    let status = site::call(&surgeon, &format!("{cases}/ApprovePlan"))
        .await
        .unwrap_err();
    // It has passed the guard; behind it nobody serves the method.
    assert_eq!(status.code(), Code::Unimplemented);
    assert_eq!(crate::status::reason(&status), None);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_certificate_that_ends_while_connected_ends_calls_and_streams() {
    let site = Site::new();
    let server = site.server().await;
    let visitor = site.visitor(Holder::new("x", Role::Viewer).for_seconds(2));
    let channel = visitor.channel(&server);
    site::health(&channel).await.unwrap();
    let mut watch = site::watch_health(&channel).await.unwrap();
    watch.message().await.unwrap();
    let end = watch.message().await.unwrap_err();
    assert_eq!(
        crate::status::reason(&end).as_deref(),
        Some("CERTIFICATE_EXPIRED")
    );
    for _ in 0..ATTEMPTS {
        let status = site::health(&channel).await.unwrap_err();
        assert_eq!(status.code(), Code::Unauthenticated);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn new_files_are_used_by_the_next_connection_and_damaged_ones_are_not() {
    let site = Site::new();
    let server = site.server().await;
    let visitor = site.visitor(Holder::new("x", Role::Viewer));
    let connected = visitor.channel(&server);
    site::health(&connected).await.unwrap();

    site.damage_server_key();
    assert!(matches!(server.credentials().refresh(), Refreshed::Kept(_)));
    assert!(matches!(
        server.credentials().refresh(),
        Refreshed::Unchanged
    ));
    visitor.checks_health(&server).await.unwrap();

    // The authority is another one: who was let in is not any more, and the other way round.
    let next = Site::new();
    next.write_server_files(&site);
    assert!(matches!(server.credentials().refresh(), Refreshed::Renewed));
    site::health(&connected).await.unwrap();
    visitor.checks_health(&server).await.unwrap_err();
    let newcomer = next.visitor(Holder::new("y", Role::Viewer));
    newcomer.checks_health(&server).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn traffic_goes_on_while_certificates_change() {
    let site = Site::new();
    let server = site.server().await;
    let visitor = site.visitor(Holder::new("x", Role::Viewer));
    let connected = visitor.channel(&server);
    for round in 0..20 {
        site.renew_server();
        assert!(
            matches!(server.credentials().refresh(), Refreshed::Renewed),
            "{round}"
        );
        for _ in 0..20 {
            site::health(&connected).await.unwrap();
        }
        visitor.checks_health(&server).await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn whoever_connects_and_says_nothing_holds_up_nobody() {
    let site = Site::new();
    let server = site.server().await;
    let mut silent = Vec::new();
    for _ in 0..600 {
        silent.push(
            tokio::net::TcpStream::connect(server.address())
                .await
                .unwrap(),
        );
    }
    let visitor = site.visitor(Holder::new("x", Role::Viewer));
    let answer = tokio::time::timeout(Duration::from_secs(4), visitor.checks_health(&server));
    answer
        .await
        .expect("sooner than any handshake's limit")
        .unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn credentials_take_their_own_new_files_when_they_connect_again() {
    let site = Site::new();
    let server = site.server().await;
    let mine = site.files_of(Holder::new("me", Role::Operator));
    let credentials = Credentials::read(&mine).unwrap();
    let dial = || {
        let dial = Dial::to(&server.address().to_string(), Some(&credentials)).unwrap();
        dial.certified_as("localhost").unwrap().connect_lazily()
    };
    site::health(&dial()).await.unwrap();
    assert_eq!(server.last_caller().unwrap().name(), "me");
    site.write(&mine, Holder::new("me again", Role::Operator));
    site::health(&dial()).await.unwrap();
    assert_eq!(server.last_caller().unwrap().name(), "me again");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_that_is_certified_as_another_is_not_called() {
    let site = Site::new();
    let server = site.server().await;
    let mine = site.files_of(Holder::new("me", Role::Operator));
    let credentials = Credentials::read(&mine).unwrap();
    let person = Site::new().server_as(Holder::new("x", Role::Surgeon)).await;
    let impostor = site.server_as(Holder::new("x", Role::Surgeon)).await;
    let elsewhere = (server.address(), "elsewhere.example");
    for (address, name) in [
        elsewhere,
        (person.address(), "localhost"),
        (impostor.address(), "localhost"),
    ] {
        let dial = Dial::to(&format!("https://{address}"), Some(&credentials)).unwrap();
        let error = dial.certified_as(name).unwrap().connect().await;
        error.unwrap_err();
    }
    assert_eq!(server.last_caller(), None);
}
