//! What is refused by name.

use serde_json::json;

use crate::{Folder, arthro, cloud, surface};

#[test]
fn what_cannot_be_planned_or_scored_is_refused_by_name() {
    let folder = Folder::new();
    let good = folder.foreign("good.json", "LPS", &json!({}));
    let zero = json!({"bites": [{"center_mm": [1, 2, 3], "long_axis": [0, 0, 0]}]});
    let zero = folder.foreign("zero.json", "LPS", &zero);
    let nan =
        r#"{"space":"LPS","unit":"mm","bites":[{"center_mm":[54,NaN,50],"long_axis":[0,1,0]}]}"#;
    let nan = folder.write("nan.json", nan);
    let upright = json!({"bites": [{"center_mm": [54, 60, 50], "long_axis": [1, 0, 0]}]});
    let upright = folder.foreign("upright.json", "LPS", &upright);
    let metres = surface(&folder, "metres.ply", 1e-3).display().to_string();
    let plain = surface(&folder, "plain.ply", 1.0).display().to_string();
    let absent = folder.path("absent.json");
    let ends = ["--start=53,48,61", "--goal=54,53,36"];
    let absent_lesion = cloud(&folder, "far.ply", &json!([[0, 0, 0], [0.5, 0, 0]]));
    let cases: [(&[&str], &str, &str); 16] = [
        (
            &["evaluate", "phantom", &zero, "--jaw", "3,4.5"],
            "FILE_INVALID",
            "bites[0].long_axis has length 0",
        ),
        (
            &["evaluate", "phantom", &nan, "--jaw", "3,4.5"],
            "FILE_INVALID",
            "center_mm holds what is no number",
        ),
        (
            &["evaluate", "phantom", &upright, "--jaw", "3,4.5"],
            "FILE_INVALID",
            "needs its opening",
        ),
        (
            &["evaluate", "phantom", &absent],
            "FILE_UNREADABLE",
            "absent.json",
        ),
        (&["evaluate", "phantom", &good], "JAW_UNKNOWN", "--jaw"),
        (
            &["evaluate", &metres, &good, "--jaw", "3,4.5"],
            "INVALID_ARGUMENT",
            "millimetres?",
        ),
        (
            &["plan", &plain, ends[0], ends[1]],
            "PORTAL_NOT_GIVEN",
            "--portal",
        ),
        (&["plan", "phantom"], "INVALID_ARGUMENT", "lesion: is empty"),
        (
            &[
                "plan",
                "phantom",
                "--scenario",
                "band",
                "--deadline-s",
                "0.001",
            ],
            "DEADLINE",
            "no plan yet",
        ),
        (
            &["plan", "phantom", "--scenario", "tear", "--jaw", "0,4.5"],
            "INVALID_ARGUMENT",
            "a width of 0 mm; must be 0.5 .. 10",
        ),
        (
            &[
                "plan",
                "phantom",
                "--scenario",
                "tear",
                "--portal=62,NaN,94.5",
            ],
            "INVALID_ARGUMENT",
            "--portal is 62,NaN,94.5",
        ),
        (
            &["plan", "phantom", "--scenario", "tear", "--portal=54,61,50"],
            "INVALID_ARGUMENT",
            "options.portal: is 0.",
        ),
        (
            &["plan", &metres, ends[0], ends[1], "--portal=62,12,94.5"],
            "INVALID_ARGUMENT",
            "millimetres?",
        ),
        (
            &["plan", "phantom", "--lesion", &absent_lesion],
            "LESION_OUTSIDE_MODEL",
            "100.0 % of the lesion",
        ),
        (
            &["plan", "phantom", ends[0], ends[1], "--box=0,0,0,0,0,0"],
            "INVALID_ARGUMENT",
            "options.target_box: holds no tissue",
        ),
        (
            &["plan", "phantom", "--start=0,0,0", ends[1]],
            "INVALID_ARGUMENT",
            "options.start",
        ),
    ];
    for (arguments, reason, words) in cases {
        let (code, answer) = arthro(arguments);
        assert_eq!(code, 3, "{arguments:?}: {answer}");
        assert_eq!(answer["error"]["reason"], reason, "{arguments:?}: {answer}");
        assert!(
            answer.to_string().contains(words),
            "{arguments:?}: {answer}"
        );
    }
}

#[test]
fn what_cannot_be_cleared_is_refused_and_planned_in_part_only_when_asked() {
    let from_aside = [
        "plan",
        "phantom",
        "--scenario",
        "tear",
        "--portal=62,48,94.5",
    ];
    let (code, refused) = arthro(&from_aside);
    assert_eq!(code, 3, "{refused}");
    assert_eq!(
        refused["error"]["reason"], "UNREACHABLE_TISSUE",
        "{refused}"
    );
    let mut arguments = from_aside.to_vec();
    arguments.push("--partial");
    let (code, partial) = arthro(&arguments);
    assert_eq!(code, 0, "{partial}");
    assert_eq!(partial["choice"]["complete"], false, "{partial}");
    assert!(
        partial["lesion_covered_percent"].as_f64().unwrap() < 99.0,
        "{partial}"
    );
}
