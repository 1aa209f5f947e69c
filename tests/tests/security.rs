//! A whole cell with TLS: who is let in by the real services, what each role may, and certificates that change under way.

use std::path::{Path, PathBuf};

use arthro_bootstrap::config::TlsConfig;
use arthro_bootstrap::tls::{Credentials, Dial};
use arthro_bootstrap::{Caller, status};
use arthro_proto::gateway::v1::case_service_client::CaseServiceClient;
use arthro_proto::gateway::v1::procedure_service_client::ProcedureServiceClient;
use arthro_proto::gateway::v1::{
    ApprovePlanRequest, CreateCaseRequest, ListCasesRequest, StopProcedureRequest,
};
use arthro_proto::motion::v1::GetCellRequest;
use arthro_proto::motion::v1::motion_service_client::MotionServiceClient;
use arthro_tests::Cell;
use arthro_tests::command::answered;
use arthro_tests::peers::{run, text};
use serde_json::Value;
use tempfile::TempDir;
use tonic::Code;
use tonic::transport::Channel;

/// Attempts of each kind.
const ATTEMPTS: usize = 100;

/// A cell with TLS and the site that it belongs to.
struct Secured {
    cell: Cell,
    site: TempDir,
}

impl Secured {
    async fn up() -> Self {
        let site = tempfile::tempdir().expect("a temporary folder");
        let cell = Cell::up_with(&["--tls", &text_of(site.path())]).await;
        Self { cell, site }
    }

    fn file(&self, name: &str) -> PathBuf {
        self.site.path().join(name)
    }

    fn credentials(&self, holder: &str) -> Credentials {
        credentials(self.site.path(), holder)
    }

    async fn channel(&self, holder: &str, service: &str) -> Channel {
        self.connect(&self.credentials(holder), service)
            .await
            .expect("the service is reached")
    }

    async fn connect(
        &self,
        credentials: &Credentials,
        service: &str,
    ) -> Result<Channel, tonic::transport::Error> {
        let dial = Dial::to(self.cell.url(service), Some(credentials));
        dial.expect("announced addresses are valid").connect().await
    }

    /// Calls the gateway as `arthro` does.
    async fn arthro(&self, holder: &str, arguments: &[&str]) -> (i32, Value) {
        let files = [
            "ca.pem".to_owned(),
            format!("{holder}.pem"),
            format!("{holder}.key"),
        ];
        let [ca, cert, key] = files.map(|file| text_of(&self.file(&file)));
        let identity = ["--tls-ca", &ca, "--tls-cert", &cert, "--tls-key", &key];
        let gateway = ["--gateway", self.cell.url("gateway")];
        answered(&[&gateway[..], &identity, arguments].concat()).await
    }

    async fn pki(&self, command: &str, arguments: &[&str]) -> (i32, Value) {
        let site = text_of(self.site.path());
        answered(&[&["pki", command, &site], arguments].concat()).await
    }

    async fn grpcurl(&self, holder: Option<&str>, arguments: &[&str]) -> (bool, String) {
        let address = self.cell.url("gateway").trim_start_matches("https://");
        let mut all = vec!["-cacert".to_owned(), text_of(&self.file("ca.pem"))];
        if let Some(holder) = holder {
            for (flag, end) in [("-cert", "pem"), ("-key", "key")] {
                all.push(flag.to_owned());
                all.push(text_of(&self.file(&format!("{holder}.{end}"))));
            }
        }
        all.push(address.to_owned());
        all.extend(arguments.iter().map(|argument| (*argument).to_owned()));
        let all: Vec<&str> = all.iter().map(String::as_str).collect();
        let output = run("grpcurl", &all).await;
        (output.status.success(), text(&output))
    }
}

fn text_of(path: &Path) -> String {
    path.to_str().expect("a plain path").to_owned()
}

fn credentials(site: &Path, holder: &str) -> Credentials {
    Credentials::read(&TlsConfig {
        certificate: site.join(format!("{holder}.pem")),
        key: site.join(format!("{holder}.key")),
        client_ca: site.join("ca.pem"),
    })
    .expect("the site has issued it")
}

async fn lists_cases(channel: Channel) -> Result<(), tonic::Status> {
    let mut cases = CaseServiceClient::new(channel);
    cases
        .list_cases(ListCasesRequest::default())
        .await
        .map(drop)
}

#[tokio::test]
async fn each_role_may_what_the_table_says_and_a_stop_is_open_to_all() {
    let secured = Secured::up().await;
    for holder in ["viewer", "operator", "surgeon"] {
        lists_cases(secured.channel(holder, "gateway").await)
            .await
            .expect("everybody looks on");
    }
    let refused = [
        ("viewer", "CreateCase"),
        ("viewer", "ApprovePlan"),
        ("operator", "ApprovePlan"),
        ("gateway", "ApprovePlan"),
    ];
    for (holder, method) in refused {
        let channel = secured.channel(holder, "gateway").await;
        let mut cases = CaseServiceClient::new(channel);
        for _ in 0..ATTEMPTS {
            let answer = match method {
                "CreateCase" => {
                    let request = CreateCaseRequest::default();
                    cases.create_case(request).await.map(drop)
                }
                _ => {
                    let request = ApprovePlanRequest::default();
                    cases.approve_plan(request).await.map(drop)
                }
            };
            let refusal = answer.expect_err("the role does not suffice");
            assert_eq!(refusal.code(), Code::PermissionDenied);
            assert_eq!(
                status::reason(&refusal).as_deref(),
                Some("ROLE_NOT_ALLOWED")
            );
        }
    }
    for holder in ["viewer", "operator", "surgeon", "gateway"] {
        let channel = secured.channel(holder, "gateway").await;
        let request = StopProcedureRequest::default();
        let mut procedures = ProcedureServiceClient::new(channel);
        let answer = procedures.stop_procedure(request).await;
        answer.expect("everybody may stop");
    }
    secured.cell.teardown().await;
}

#[tokio::test]
async fn a_flood_of_stops_is_answered_and_the_first_after_a_command_is_carried_out() {
    let secured = Secured::up().await;
    let channel = secured.channel("viewer", "gateway").await;
    let mut procedures = ProcedureServiceClient::new(channel);
    let (mut done, mut answered) = (0, 0);
    for _ in 0..200 {
        match procedures
            .stop_procedure(StopProcedureRequest::default())
            .await
        {
            Ok(_) => done += 1,
            Err(refusal) => {
                assert_eq!(status::reason(&refusal).as_deref(), Some("STOP_JUST_DONE"));
                answered += 1;
            }
        }
    }
    println!("of 200 stops {done} were carried out, {answered} had nothing left to halt");
    assert!(done >= 20, "{done}");
    let channel = secured.channel("operator", "gateway").await;
    let mut cases = CaseServiceClient::new(channel);
    for _ in 0..ATTEMPTS {
        let request = CreateCaseRequest {
            label: "any command".into(),
        };
        cases.create_case(request).await.expect("an operator may");
        let stop = procedures
            .stop_procedure(StopProcedureRequest::default())
            .await;
        stop.expect("something may have begun to move");
    }
    secured.cell.teardown().await;
}

#[tokio::test]
async fn the_gateway_calls_its_services_by_its_own_certificate() {
    let secured = Secured::up().await;
    let (model, lesion) = (&secured.cell.at.model, &secured.cell.at.lesion);
    let (model, lesion) = (text_of(model), text_of(lesion));
    let create = [
        "case", "create", "knee", "--model", &model, "--lesion", &lesion,
    ];
    let (code, case) = secured.arthro("operator", &create).await;
    assert_eq!(code, 0, "{case}");
    let case = case["case_id"].as_str().expect("it has an id").to_owned();
    let simulator = secured.cell.url("simulator");
    let (code, answer) = secured
        .arthro(
            "operator",
            &["case", "scene", &case, "--simulator", simulator],
        )
        .await;
    assert_eq!(code, 0, "{answer}");
    let (code, answer) = secured
        .arthro("operator", &["case", "register", &case])
        .await;
    assert_eq!(code, 0, "{answer}");
    let approve = [
        "case",
        "approve",
        &case,
        "--digest",
        "00",
        "--surgeon",
        "operator",
    ];
    let (code, answer) = secured.arthro("operator", &approve).await;
    assert_eq!(code, 3, "{answer}");
    assert_eq!(answer["error"]["reason"], "ROLE_NOT_ALLOWED", "{answer}");
    secured.cell.teardown().await;
}

#[tokio::test]
async fn grpcurl_is_let_in_by_certificate_and_not_without() {
    let secured = Secured::up().await;
    let (listed, list) = secured.grpcurl(Some("viewer"), &["list"]).await;
    assert!(
        listed && list.contains("arthro.gateway.v1.CaseService"),
        "{list}"
    );
    let list_cases = ["arthro.gateway.v1.CaseService/ListCases"];
    let (called, answer) = secured.grpcurl(Some("viewer"), &list_cases).await;
    assert!(called, "{answer}");
    let create = ["arthro.gateway.v1.CaseService/CreateCase"];
    let (called, answer) = secured.grpcurl(Some("viewer"), &create).await;
    assert!(!called && answer.contains("ROLE_NOT_ALLOWED"), "{answer}");
    let (called, answer) = secured.grpcurl(None, &["list"]).await;
    assert!(!called, "{answer}");
    secured.cell.teardown().await;
}

#[tokio::test]
async fn an_authority_is_replaced_while_calls_go_on() {
    let secured = Secured::up().await;
    let old = secured.credentials("viewer");
    let kept = tempfile::tempdir().expect("a temporary folder");
    for file in ["ca.pem", "viewer.pem", "viewer.key"] {
        std::fs::copy(secured.file(file), kept.path().join(file)).expect("it can be copied");
    }
    let going_on = {
        let channel = secured
            .connect(&old, "motion")
            .await
            .expect("motion is reached");
        tokio::spawn(async move {
            let mut motion = MotionServiceClient::new(channel);
            loop {
                let answer = motion.get_cell(GetCellRequest {}).await;
                answer.expect("an open connection goes on");
                tokio::task::yield_now().await;
            }
        })
    };
    let (code, answer) = secured.pki("rotate", &["--authority"]).await;
    assert_eq!((code, answer["trusted"].as_u64()), (0, Some(2)), "{answer}");
    for file in [
        "registration",
        "planning",
        "motion",
        "instrument",
        "simulator",
        "gateway",
        "viewer",
    ] {
        let (code, answer) = secured.pki("rotate", &[file]).await;
        assert_eq!(code, 0, "{answer}");
    }
    let (code, answer) = secured.pki("rotate", &["--retire"]).await;
    assert_eq!((code, answer["trusted"].as_u64()), (0, Some(1)), "{answer}");

    // Who trusts the old authority alone is no longer answered once the servers have looked at their files.
    let outsider = credentials(kept.path(), "viewer");
    for service in ["motion", "gateway"] {
        while secured.connect(&outsider, service).await.is_ok() {
            tokio::task::yield_now().await;
        }
    }
    lists_cases(secured.channel("viewer", "gateway").await)
        .await
        .expect("the new certificate is good");
    assert!(!going_on.is_finished(), "an open connection was closed");
    going_on.abort();
    secured.cell.teardown().await;
}

#[tokio::test]
async fn an_authority_overwrites_nothing_and_keeps_its_key_to_itself() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let site = text_of(folder.path());
    let init = ["pki", "init", &site];
    assert_eq!(answered(&init).await.0, 0);
    let (code, answer) = answered(&init).await;
    assert_eq!(
        (code, &answer["error"]["reason"]),
        (3, &"FILE_EXISTS".into()),
        "{answer}"
    );
    let adams = [
        "pki",
        "issue",
        &site,
        "--name",
        "Dr. Adams",
        "--role",
        "surgeon",
    ];
    assert_eq!(answered(&adams).await.0, 0);
    assert_eq!(answered(&adams).await.0, 3);
    for file in ["ca.key", "dr-adams.key"] {
        let mode = std::fs::metadata(folder.path().join(file))
            .expect("it is there")
            .permissions()
            .mode();
        assert_eq!(mode & 0o777, 0o600, "{file}");
    }
    let holder = credentials(folder.path(), "dr-adams").holder();
    let surgeon = Caller::Certified {
        name: holder.name,
        role: holder.role,
    };
    assert_eq!(surgeon.acting(String::new()).as_deref(), Ok("Dr. Adams"));
    let service = [
        "pki", "issue", &site, "--name", "motion", "--role", "service",
    ];
    let (code, answer) = answered(&service).await;
    assert_eq!(
        (code, &answer["error"]["reason"]),
        (3, &"HOST_MISSING".into()),
        "{answer}"
    );
    let too_long = [
        "pki", "issue", &site, "--name", "x", "--role", "viewer", "--days", "826",
    ];
    let refused = tokio::process::Command::new(arthro_tests::cell::arthro())
        .args(too_long)
        .output()
        .await
        .expect("arthro runs");
    assert_eq!(refused.status.code(), Some(2));
}
