//! How servers start: configuration from all its sources, refusals that name what is wrong.

use std::process::Output;

use arthro_tests::cell::arthro;
use tokio::process::Command;

async fn serve(arguments: &[&str]) -> Output {
    Command::new(arthro())
        .arg("serve")
        .args(arguments)
        .env("ARTHRO_PLANNING__SERVER__MAX_CALLS", "7")
        .output()
        .await
        .expect("arthro runs")
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[tokio::test]
async fn every_service_dumps_a_configuration_that_it_reads_back() {
    for service in [
        "registration",
        "planning",
        "motion",
        "instrument",
        "simulator",
        "gateway",
    ] {
        let dumped = serve(&[service, "--dump-config"]).await;
        assert!(dumped.status.success(), "{service}: {}", stderr(&dumped));
        let file = tempfile::NamedTempFile::new().expect("a temporary file");
        std::fs::write(file.path(), &dumped.stdout).expect("the file can be written");
        let path = file.path().to_str().expect("a printable path");
        let again = serve(&[service, "--config", path, "--dump-config"]).await;
        assert_eq!(
            stdout(&dumped),
            stdout(&again),
            "{service}: {}",
            stderr(&again)
        );
    }
}

#[tokio::test]
async fn the_configuration_of_a_real_cell_is_one_that_every_service_takes() {
    let cell = concat!(env!("CARGO_MANIFEST_DIR"), "/../deploy/cell.toml");
    for service in [
        "registration",
        "planning",
        "motion",
        "instrument",
        "simulator",
        "gateway",
    ] {
        let dumped = serve(&[service, "--config", cell, "--dump-config"]).await;
        assert!(dumped.status.success(), "{service}: {}", stderr(&dumped));
    }
}

#[tokio::test]
async fn flags_win_over_the_environment_and_the_environment_over_the_file() {
    let file = tempfile::NamedTempFile::new().expect("a temporary file");
    let text = "[planning.server]\nmax_calls = 3\ndrain_s = 1.5\n";
    std::fs::write(file.path(), text).expect("the file can be written");
    let path = file.path().to_str().expect("a printable path");

    let dumped = stdout(&serve(&["planning", "--config", path, "--dump-config"]).await);
    assert!(dumped.contains("max_calls = 7"), "{dumped}");
    assert!(dumped.contains("drain_s = 1.5"), "{dumped}");

    let flags = [
        "planning",
        "--config",
        path,
        "--set",
        "server.max_calls=9",
        "--dump-config",
    ];
    let dumped = stdout(&serve(&flags).await);
    assert!(dumped.contains("max_calls = 9"), "{dumped}");
}

#[tokio::test]
async fn an_unknown_key_is_refused_by_name() {
    let refused = serve(&["planning", "--set", "server.max_cals=9", "--dump-config"]).await;
    assert_eq!(refused.status.code(), Some(64));
    assert!(
        stderr(&refused).contains("max_cals"),
        "{}",
        stderr(&refused)
    );
}

#[tokio::test]
async fn a_public_address_without_tls_is_refused() {
    let refused = serve(&["planning", "--listen", "0.0.0.0:0"]).await;
    assert_eq!(refused.status.code(), Some(64));
    assert!(
        stderr(&refused).contains("loopback"),
        "{}",
        stderr(&refused)
    );
}

#[tokio::test]
async fn a_missing_configuration_file_is_refused_by_name() {
    let refused = serve(&["planning", "--config", "/does/not/exist.toml"]).await;
    assert_eq!(refused.status.code(), Some(64));
    assert!(
        stderr(&refused).contains("/does/not/exist.toml"),
        "{}",
        stderr(&refused)
    );
}
