//! `arthro plan --scorecard`.

use serde_json::{Value, json};

use crate::{Folder, done, surface};

#[test]
fn the_scorecard_holds_the_standard_cases_beside_the_papers_bites() {
    let card = done(&["plan", "--scorecard"]);
    for (ours, case) in [(&card["tear"], "tear"), (&card["band"], "band")] {
        let paper = &card["paper"][case];
        assert_eq!(paper["bites"], 39, "{card}");
        assert!(ours["bites"].as_u64().unwrap() < 39, "{card}");
        let outside = |row: &Value| row["outside_mm3"].as_f64().unwrap();
        assert!(outside(ours) < 0.3 * outside(paper), "{card}");
    }
    for (case, keys) in [
        (&card["tear"], ["lesion_percent", "bound"]),
        (&card["band"], ["rim_min_mm", "gap"]),
    ] {
        assert_eq!(case["order_feasible"], true, "{card}");
        for key in keys.into_iter().chain([
            "region_percent",
            "scallop_rms_mm",
            "predicted_seconds",
            "seconds",
        ]) {
            assert!(case[key].is_number(), "{key}: {card}");
        }
    }
    let search = &card["paper"]["search"];
    assert_eq!(search["found"], search["seeds"], "{card}");
    assert!(search["mean_off_mm"].as_f64().unwrap() <= 0.5, "{card}");
    assert_eq!(card["menisci"], json!([]));
}

#[test]
fn a_case_that_is_refused_is_a_row_and_the_others_are_planned_all_the_same() {
    let folder = Folder::new();
    surface(&folder, "metres.ply", 1e-3);
    surface(&folder, "plain.ply", 1.0);
    let card = done(&["plan", "--scorecard", "--data", &folder.path("")]);
    let outcomes: Vec<(&str, &str)> = card["menisci"]
        .as_array()
        .unwrap()
        .iter()
        .map(|row| {
            let word = |key: &str| row[key].as_str().unwrap();
            (word("file"), word("outcome"))
        })
        .collect();
    assert_eq!(
        outcomes,
        [
            ("metres.ply", "INVALID_ARGUMENT"),
            ("metres.ply", "INVALID_ARGUMENT"),
            ("plain.ply", "planned"),
            ("plain.ply", "planned"),
        ]
    );
    for row in &card["menisci"].as_array().unwrap()[2..] {
        assert_eq!(row["paper"]["bites"], 39, "{row}");
        assert!(row["region_percent"].as_f64().unwrap() >= 94.5, "{row}");
    }
}
