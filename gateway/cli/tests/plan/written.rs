//! What a plan writes, and that it is the plan.

use serde_json::Value;

use crate::{Folder, close, done, surface, written};

#[test]
fn a_plan_that_is_written_is_scored_as_it_was_planned_and_drawn() {
    let folder = Folder::new();
    let [bites, svg, png] = ["bites.json", "plan.svg", "plan.png"].map(|name| folder.path(name));
    let planned = done(&[
        "plan",
        "phantom",
        "--scenario",
        "tear",
        "--out",
        &bites,
        "--svg",
        &svg,
        "--png",
        &png,
    ]);
    assert!(
        planned["lesion_covered_percent"].as_f64().unwrap() >= 99.9,
        "{planned}"
    );
    let scored = done(&["evaluate", "phantom", &bites]);
    for key in [
        "bites",
        "removed_mm3",
        "region_covered_percent",
        "lesion_covered_percent",
        "outside_removed_mm3",
        "healthy_removed_mm3",
        "rim_min_mm",
        "rim_mean_mm",
        "predicted_seconds",
        "scallop_rms_mm",
    ] {
        close(&planned, &scored, key);
    }
    assert_eq!(planned["blocked_bites"], scored["blocked_bites"]);
    let svg = std::fs::read_to_string(svg).unwrap();
    let discs = svg.matches("<circle").count() as u64;
    assert!(svg.starts_with("<svg") && discs > planned["bites"].as_u64().unwrap());
    let png = std::fs::read(png).unwrap();
    assert!(
        png.starts_with(b"\x89PNG") && png.len() > 20_000,
        "{} bytes",
        png.len()
    );
}

#[test]
fn the_same_seed_gives_the_same_list() {
    let folder = Folder::new();
    let lists = ["first.json", "second.json"].map(|name| {
        let path = folder.path(name);
        done(&[
            "plan",
            "phantom",
            "--scenario",
            "tear",
            "--seed",
            "7",
            "--out",
            &path,
        ]);
        std::fs::read(path).unwrap()
    });
    assert!(lists[0] == lists[1]);
}

#[test]
fn a_surface_is_planned_as_the_built_in_one_through_the_same_portal() {
    let folder = Folder::new();
    let file = surface(&folder, "meniscus.ply", 1.0).display().to_string();
    let ends = [
        "--start=53,48,61",
        "--goal=54,53,36",
        "--box=50,40,30,60,70,70",
    ];
    let read = done(&[
        "plan",
        &file,
        ends[0],
        ends[1],
        ends[2],
        "--portal=62,12,94.5",
    ]);
    let built_in = done(&["plan", "phantom", "--scenario", "band"]);
    let percent = |value: &Value| value["region_covered_percent"].as_f64().unwrap();
    assert!(
        (percent(&read) - percent(&built_in)).abs() < 3.0,
        "{read} {built_in}"
    );
    assert!(percent(&read) > 90.0, "{read}");
}

#[test]
fn the_papers_planner_bites_at_every_point_of_its_path() {
    for cost in ["corrected", "as-printed"] {
        let planned = done(&[
            "plan",
            "phantom",
            "--scenario",
            "band",
            "--planner",
            "paper",
            "--paper-cost",
            cost,
        ]);
        assert!(planned["bites"].as_u64().unwrap() > 30, "{cost}: {planned}");
        assert_eq!(planned["choice"], Value::Null, "{cost}: {planned}");
    }
}

#[test]
fn a_view_of_each_bite_is_written_and_read_back() {
    let folder = Folder::new();
    let path = folder.path("bites.json");
    let planned = done(&[
        "plan",
        "phantom",
        "--scenario",
        "tear",
        "--arthroscope=62,48,94.5",
        "--out",
        &path,
    ]);
    let list = written(&path);
    let count = |value: &Value, key: &str| value[key].as_array().unwrap().len();
    assert_eq!(count(&list, "views"), count(&list, "bites"));
    assert_eq!(count(&planned, "views"), count(&list, "bites"));
    let scored = done(&["evaluate", "phantom", &path]);
    close(&planned, &scored, "region_covered_percent");
}
