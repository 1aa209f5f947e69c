//! `arthro robot` as an engineer at the bench uses it, against a simulated cell.
#![allow(clippy::panic, reason = "a test says why it failed by panicking")]

use arthro_tests::cell::Cell;
use arthro_tests::command::{answered, number};
use serde_json::Value;

/// A cell and the engineer's terminal.
struct Bench {
    cell: Cell,
    motion: String,
}

impl Bench {
    async fn set_up() -> Self {
        let cell = Cell::up().await;
        let motion = cell.at.services["motion"].clone();
        Self { cell, motion }
    }

    /// Exit code and last line of `arthro robot ARGUMENTS --json`.
    async fn robot(&self, arguments: &[&str]) -> (i32, Value) {
        answered(&[&["robot", "--motion", &self.motion], arguments].concat()).await
    }

    async fn joint_rad(&self, joint: usize) -> f64 {
        let (code, state) = self.robot(&["state"]).await;
        assert_eq!(code, 0, "{state}");
        number(&state, &format!("/arms/0/joints_rad/{}", joint - 1))
    }
}

#[tokio::test]
async fn a_jog_moves_one_joint_by_so_much_and_command_is_given_back() {
    let bench = Bench::set_up().await;
    let before_rad = bench.joint_rad(6).await;
    for _ in 0..2 {
        let (code, answer) = bench
            .robot(&["jog", "forceps", "--joint", "6", "--by-rad=-0.1"])
            .await;
        assert_eq!(code, 0, "{answer}");
    }
    let after_rad = bench.joint_rad(6).await;
    assert!(
        (before_rad - 0.2 - after_rad).abs() < 2e-3,
        "{before_rad} {after_rad}"
    );
    bench.cell.teardown().await;
}

#[tokio::test]
async fn what_is_refused_names_its_reason_and_holds_no_lease() {
    let bench = Bench::set_up().await;
    let (code, refusal) = bench.robot(&["retract", "forceps"]).await;
    assert_eq!(
        (code, &refusal["error"]["reason"]),
        (3, &"PORTAL_NOT_SET".into())
    );
    let (code, answer) = bench.robot(&["recover", "forceps"]).await;
    assert_eq!(code, 0, "{answer}");
    let arm = bench.cell.at.arms[0].clone();
    let (code, answer) = bench.robot(&["dashboard", &arm, "robotmode"]).await;
    assert_eq!((code, &answer["answer"]), (0, &"Robotmode: RUNNING".into()));
    let (code, refusal) = bench.robot(&["dashboard", &arm, "make", "coffee"]).await;
    assert_eq!(
        (code, &refusal["error"]["reason"]),
        (3, &"CONTROLLER_REFUSED".into())
    );
    let (code, refusal) = bench
        .robot(&["dashboard", "localhost:1", "robotmode"])
        .await;
    assert_eq!(
        (code, &refusal["error"]["reason"]),
        (4, &"CONTROLLER_UNREACHABLE".into())
    );
    bench.cell.teardown().await;
}

#[tokio::test]
async fn a_portal_is_taught_where_the_shaft_lines_meet() {
    let bench = Bench::set_up().await;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("taught.json");
    let file = file.to_str().expect("a temporary path is text");
    let (code, answer) = bench.robot(&["teach", "forceps", file]).await;
    assert_eq!((code, &answer["poses"]), (0, &1.into()), "{answer}");
    // The shaft turns about the axis of joint 5 and crosses it, 82.3 mm behind the flange.
    for poses in 2..=3 {
        let (code, answer) = bench
            .robot(&["jog", "forceps", "--joint", "5", "--by-rad=-0.2"])
            .await;
        assert_eq!(code, 0, "{answer}");
        let (code, answer) = bench.robot(&["teach", "forceps", file]).await;
        assert_eq!((code, &answer["poses"]), (0, &poses.into()), "{answer}");
    }
    let (code, found) = bench.robot(&["portal", "forceps", file, "--set"]).await;
    assert_eq!(code, 0, "{found}");
    assert!(number(&found, "/residual_rms_mm") < 0.05, "{found}");
    assert!(
        (number(&found, "/lines/0/depth_mm") - 392.3).abs() < 0.5,
        "{found}"
    );
    let (_, state) = bench.robot(&["state"]).await;
    for axis in 0..3 {
        let stated = number(&state, &format!("/arms/0/portal_mm/{axis}"));
        let solved = number(&found, &format!("/portal_mm/{axis}"));
        assert!((stated - solved).abs() < 1e-6, "{state}");
    }
    // Three poses are fewer than a shaft needs.
    let (code, refusal) = bench.robot(&["shaft", "forceps", file]).await;
    assert_eq!(code, 3, "{refusal}");
    bench.cell.teardown().await;
}

#[tokio::test]
async fn a_controllers_calibration_is_read_from_its_primary_interface() {
    let bench = Bench::set_up().await;
    let arm = bench.cell.at.arms[0].clone();
    let (code, answer) = bench.robot(&["kinematics", &arm]).await;
    assert_eq!(code, 0, "{answer}");
    assert_eq!(
        (&answer["model"], &answer["is_drawing"]),
        (&"ur5".into(), &true.into())
    );
    assert!((number(&answer, "/calibration/d_mm/0") - 89.159).abs() < 1e-9);
    bench.cell.teardown().await;
}
