//! `arthro calibrate` as a person uses it: the whole routine in a cell, and its measurements again from their files.
#![allow(clippy::panic, reason = "a test says why it failed by panicking")]

use std::path::Path;

use arthro_tests::command::{answered, number};
use serde_json::{Value, json};

/// Exit code and last line of `arthro calibrate --json`.
async fn calibrate(arguments: &[&str]) -> (i32, Value) {
    answered(&[&["calibrate"], arguments].concat()).await
}

fn path(path: &Path) -> &str {
    path.to_str().expect("a temporary path is text")
}

#[tokio::test]
async fn an_uncalibrated_cell_is_calibrated_and_its_measurements_say_the_same_again() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (code, found) = calibrate(&["cell", "--seed", "9", "--keep", path(folder.path())]).await;
    assert_eq!(code, 0, "{found}");
    // Held to the figures again, so that the command does not grade itself.
    assert!(
        number(&found, "/referee/work_point_error_mm") < 1.0,
        "{found}"
    );
    assert!(number(&found, "/referee/tip_error_mm") < 0.3, "{found}");
    assert!(
        number(&found, "/referee_of_the_drawing/work_point_error_mm") > 2.0,
        "{found}"
    );
    assert_eq!(found["collisions"], 0);

    let (code, again) = calibrate(&["hand-eye", path(&folder.path().join("hand_eye.json"))]).await;
    assert_eq!(code, 0, "{again}");
    for axis in 0..3 {
        let at = format!("/base_from_camera/translation_mm/{axis}");
        let before = number(&found, &format!("/hand_eye{at}"));
        assert!((number(&again, &at) - before).abs() < 1e-6, "{again}");
    }
    let (code, again) = calibrate(&["tool-tip", path(&folder.path().join("tool_tip.json"))]).await;
    assert_eq!(code, 0, "{again}");
    let length_mm = number(&again, "/tip_in_flange_mm/2");
    assert!((length_mm - number(&found, "/tool_tip/tip_in_flange_mm/2")).abs() < 1e-6);
}

#[tokio::test]
async fn a_file_that_is_not_enough_or_not_right_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("poses.json");
    let pose =
        |w: f64| json!({"rotation_wxyz": [w, 0.0, 0.0, 0.0], "translation_mm": [0.0, 0.0, 400.0]});
    let view = |w: f64| json!({"base_from_flange": pose(w), "camera_from_board": pose(1.0)});
    for (content, code, reason) in [
        (
            json!({"mounting": "beside_arm", "poses": [view(1.0)]}),
            3,
            "TOO_FEW_POSES",
        ),
        (
            json!({"mounting": "beside_arm", "poses": [view(2.0)]}),
            3,
            "INVALID_ARGUMENT",
        ),
        (
            json!({"mounting": "on_the_wall", "poses": []}),
            3,
            "FILE_INVALID",
        ),
        (
            json!({"mounting": "beside_arm", "poses": [], "typo": 1}),
            3,
            "FILE_INVALID",
        ),
    ] {
        std::fs::write(&file, content.to_string()).expect("the file can be written");
        let (exit, answer) = calibrate(&["hand-eye", path(&file)]).await;
        assert_eq!(
            (exit, answer["error"]["reason"].as_str()),
            (code, Some(reason)),
            "{answer}"
        );
    }
    let (exit, answer) = calibrate(&["tool-tip", path(&folder.path().join("none.json"))]).await;
    assert_eq!(
        (exit, answer["error"]["reason"].as_str()),
        (3, Some("FILE_UNREADABLE"))
    );
}
