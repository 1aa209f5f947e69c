//! `arthro plan` and `arthro evaluate` as people and scripts run them: from files, without any server.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a helper that fails fails its test"
)]

use std::path::{Path, PathBuf};
use std::process::Command;

use arthro_geometry::{Cloud, Point3, phantom, ply};
use serde_json::{Value, json};
use tempfile::TempDir;

/// Exit code and last line of `arthro ARGUMENTS --json`.
fn arthro(arguments: &[&str]) -> (i32, Value) {
    let output = Command::new(env!("CARGO_BIN_EXE_arthro"))
        .args(arguments)
        .arg("--json")
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    let last = text.lines().last().unwrap_or_default();
    let value = serde_json::from_str(last).unwrap_or_else(|error| {
        panic!(
            "{arguments:?}: {last:?}: {error}; {}",
            String::from_utf8_lossy(&output.stderr)
        )
    });
    (output.status.code().unwrap(), value)
}

fn done(arguments: &[&str]) -> Value {
    let (code, value) = arthro(arguments);
    assert_eq!(code, 0, "{arguments:?}: {value}");
    value
}

struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        Self(TempDir::new().unwrap())
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).display().to_string()
    }

    /// Writes a list of bites into the middle of the body of the phantom.
    fn foreign(&self, name: &str, space: &str, fields: &Value) -> String {
        let turn = if space == "RAS" { -1.0 } else { 1.0 };
        let bite = |y: f64| json!({"center_mm": [54.0 * turn, y * turn, 50.0], "long_axis": [-0.1 * turn, 0.8 * turn, -0.6]});
        let mut list = json!({"space": space, "unit": "mm", "bites": [bite(58.5), bite(61.0)]});
        for (key, value) in fields.as_object().unwrap() {
            list[key] = value.clone();
        }
        self.write(name, &list.to_string())
    }

    fn write(&self, name: &str, text: &str) -> String {
        let path = self.path(name);
        std::fs::write(&path, text).unwrap();
        path
    }
}

fn close(a: &Value, b: &Value, key: &str) {
    let (a, b) = (a[key].as_f64(), b[key].as_f64());
    let (a, b) = (a.unwrap_or(f64::NAN), b.unwrap_or(f64::NAN));
    assert!((a - b).abs() < 1e-6, "{key}: {a} and {b}");
}

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
        planned["lesion_covered_percent"].as_f64().unwrap() >= 98.0,
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

/// Points as a PLY file in LPS and mm.
fn cloud(folder: &Folder, name: &str, points: &Value) -> String {
    let rows: Vec<[f64; 3]> = serde_json::from_value(points.clone()).unwrap();
    let cloud = Cloud {
        points: rows.into_iter().map(Point3::from).collect(),
        ..Cloud::default()
    };
    let path = folder.path(name);
    std::fs::write(&path, ply::write_cloud(&cloud)).unwrap();
    path
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

/// The phantom as a file, its coordinates times `factor`.
fn surface(folder: &Folder, name: &str, factor: f64) -> PathBuf {
    let mut mesh = phantom::mesh();
    for vertex in &mut mesh.vertices {
        *vertex = Point3::from(vertex.coords * factor);
    }
    let path = Path::new(&folder.path(name)).to_owned();
    std::fs::write(&path, ply::write_mesh(&mesh)).unwrap();
    path
}

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
    let cases: [(&[&str], &str, &str); 10] = [
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
        (&["plan", "phantom"], "REGION_NOT_GIVEN", "--scenario"),
        (
            &[
                "plan",
                "phantom",
                "--scenario",
                "band",
                "--deadline-s",
                "0.001",
            ],
            "DEADLINE_TOO_SHORT",
            "0.001",
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
fn the_scorecard_holds_the_standard_cases_beside_the_papers_bites() {
    let card = done(&["plan", "--scorecard"]);
    for (ours, case) in [(&card["tear"], "tear"), (&card["band"], "band")] {
        let paper = &card["paper"][case];
        assert_eq!(paper["bites"], 39, "{card}");
        assert!(ours["bites"].as_u64().unwrap() < 39, "{card}");
        let outside = |row: &Value| row["outside_mm3"].as_f64().unwrap();
        assert!(outside(ours) < 0.3 * outside(paper), "{card}");
    }
    assert_eq!(card["menisci"], json!([]));
}
