//! What a list of bites from anywhere is scored as.

use serde_json::{Value, json};

use crate::{Folder, arthro, cloud, done};

#[test]
fn a_foreign_list_without_an_aim_is_scored_for_what_it_removes() {
    let folder = Folder::new();
    let list = folder.foreign("foreign.json", "LPS", &json!({}));
    let score = done(&["evaluate", "phantom", &list, "--jaw", "3,4.5"]);
    assert_eq!(score["bites"], 2);
    assert!(score["removed_mm3"].as_f64().unwrap() > 20.0, "{score}");
    assert!(
        (2.0..9.5).contains(&score["rim_min_mm"].as_f64().unwrap()),
        "{score}"
    );
    for key in [
        "region_covered_percent",
        "outside_removed_mm3",
        "lesion_covered_percent",
    ] {
        assert_eq!(score[key], Value::Null, "{key}");
    }
}

#[test]
fn a_standard_case_gives_a_foreign_list_its_aim() {
    let folder = Folder::new();
    let list = folder.foreign("foreign.json", "LPS", &json!({}));
    let score = done(&[
        "evaluate",
        "phantom",
        &list,
        "--jaw",
        "3,4.5",
        "--scenario",
        "tear",
    ]);
    let number = |key: &str| score[key].as_f64().unwrap();
    assert!(number("lesion_covered_percent") > 95.0, "{score}");
    assert!(
        (20.0..70.0).contains(&number("region_covered_percent")),
        "{score}"
    );
    let taken = number("removed_mm3") - number("outside_removed_mm3");
    let share = 0.01 * number("region_covered_percent") * number("region_mm3");
    assert!((taken - share).abs() < 1e-6, "{score}");
}

#[test]
fn contour_and_lesion_from_files_give_the_score_that_those_of_the_list_give() {
    let folder = Folder::new();
    let path = folder.path("bites.json");
    done(&["plan", "phantom", "--scenario", "tear", "--out", &path]);
    let full = done(&["evaluate", "phantom", &path]);
    let list: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let contour = cloud(&folder, "contour.ply", &list["contour"]);
    let lesion = cloud(&folder, "lesion.ply", &list["lesion"]["points"]);
    let bare =
        json!({"space": "LPS", "unit": "mm", "bites": list["bites"], "portals": list["portals"]});
    let bare = folder.write("bare.json", &bare.to_string());
    let score = done(&[
        "evaluate",
        "phantom",
        &bare,
        "--jaw",
        "3,4.5",
        "--contour",
        &contour,
        "--lesion",
        &lesion,
    ]);
    for key in [
        "region_covered_percent",
        "lesion_covered_percent",
        "outside_removed_mm3",
    ] {
        let [a, b] = [&full, &score].map(|value| value[key].as_f64().unwrap());
        // The files hold float32, which may move a voxel on the contour.
        assert!((a - b).abs() < 0.5, "{key}: {a} and {b}");
    }
}

#[test]
fn a_list_in_ras_has_the_score_of_the_same_list_in_lps() {
    let folder = Folder::new();
    let [lps, ras] = ["LPS", "RAS"].map(|space| {
        let list = folder.foreign(&format!("{space}.json"), space, &json!({}));
        done(&["evaluate", "phantom", &list, "--jaw", "3,4.5"])
    });
    assert!(lps["removed_mm3"].as_f64().unwrap() > 20.0, "{lps}");
    assert_eq!(lps, ras);
}

#[test]
fn a_file_without_space_and_unit_is_scored_when_the_command_line_states_them() {
    let folder = Folder::new();
    let text = r#"{"bites":[{"center_mm":[54,60,50],"long_axis":[0,0.8,-0.6]}]}"#;
    let list = folder.write("bare.json", text);
    let (code, answer) = arthro(&["evaluate", "phantom", &list, "--jaw", "3,4.5"]);
    assert_eq!(code, 3);
    assert!(
        answer.to_string().contains("space is not stated"),
        "{answer}"
    );
    done(&[
        "evaluate", "phantom", &list, "--jaw", "3,4.5", "--space", "lps", "--unit", "mm",
    ]);
}
