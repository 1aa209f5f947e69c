//! `arthro register` as a script uses it: two files in, one JSON object out.
#![allow(clippy::panic, reason = "a test says why it failed by panicking")]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use arthro_tests::command::{answered, number};
use serde_json::Value;

type Point = [f64; 3];

/// A bent wedge, thicker at one horn, that no turn and no mirror maps to itself; `upper` is the face that is seen from above.
fn wedge(upper: bool) -> Vec<Point> {
    let mut points = Vec::new();
    for step in 0..160 {
        let along = f64::from(step) / 159.0;
        let angle = 4.2 * along;
        for side in 0..24 {
            let across = f64::from(side) / 23.0;
            let radius = 17.0 - (6.0 + 5.0 * along) * (1.0 - across);
            let height = if upper {
                (3.5 + 3.0 * along * along) * across.powf(1.5)
            } else {
                0.0
            };
            points.push([
                radius * angle.cos(),
                0.8 * radius * angle.sin(),
                height + 0.15 * radius * (2.0 * angle).sin(),
            ]);
        }
    }
    points
}

fn write(folder: &Path, name: &str, points: &[Point]) -> PathBuf {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
        points.len()
    );
    for [x, y, z] in points {
        writeln!(text, "{x} {y} {z}").expect("a string takes all");
    }
    let path = folder.join(name);
    std::fs::write(&path, text).expect("the folder takes a file");
    path
}

/// Scaled by 2 and turned a quarter about z.
fn moved([x, y, z]: Point) -> Point {
    [-2.0 * y + 5.0, 2.0 * x - 40.0, 2.0 * z + 300.0]
}

#[tokio::test]
async fn a_model_is_found_in_a_view_of_unknown_scale_and_drawn() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (mut model, seen) = (wedge(true), wedge(true));
    model.extend(wedge(false));
    let source = write(folder.path(), "model.ply", &model);
    let target = write(
        folder.path(),
        "view.ply",
        &seen.into_iter().map(moved).collect::<Vec<_>>(),
    );
    let picture = folder.path().join("found.svg");
    let (code, found) = answered(&[
        "register",
        &source.display().to_string(),
        &target.display().to_string(),
        "--scale",
        "0.3..3.5",
        "--viewpoint=5,-40,700",
        "--svg",
        &picture.display().to_string(),
    ])
    .await;
    assert_eq!(code, 0, "{found}");
    assert_eq!(found["verdict"], "ACCEPT", "{found}");
    assert!((number(&found, "/scale") - 2.0).abs() < 0.01, "{found}");
    // y = s R x + t in the coordinates of the files.
    let quarter = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    for (row, expected) in quarter.iter().enumerate() {
        for (column, expected) in expected.iter().enumerate() {
            let entry = number(&found, &format!("/rotation/{row}/{column}"));
            assert!((entry - expected).abs() < 0.01, "{found}");
        }
    }
    for (axis, expected) in [5.0, -40.0, 300.0].into_iter().enumerate() {
        assert!(
            (number(&found, &format!("/translation_mm/{axis}")) - expected).abs() < 0.5,
            "{found}"
        );
    }
    for key in [
        "mse_mm2",
        "coarse_mse_mm2",
        "inlier_share",
        "overlap",
        "tre_predicted_mm",
        "ambiguity",
        "seconds",
    ] {
        number(&found, &format!("/{key}"));
    }
    let svg = std::fs::read_to_string(picture).expect("the picture was drawn");
    assert!(svg.starts_with("<svg") && svg.contains("ACCEPT"));
}

#[tokio::test]
async fn what_cannot_be_registered_is_refused_by_field_value_and_limit() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let good = write(folder.path(), "good.ply", &wedge(true))
        .display()
        .to_string();
    let metres: Vec<Point> = wedge(true)
        .into_iter()
        .map(|p| p.map(|c| c / 1000.0))
        .collect();
    let metres = write(folder.path(), "metres.ply", &metres)
        .display()
        .to_string();
    let few = write(folder.path(), "few.ply", &wedge(true)[..9])
        .display()
        .to_string();
    let absent = folder.path().join("absent.ply").display().to_string();
    let cases: [(&[&str], &str); 6] = [
        (&[&good, &metres], "metres?"),
        (&[&few, &good], "has 9 points, must have at least 100"),
        (&[&absent, &good], "absent.ply"),
        (&[&good, &good, "--scale", "3..2"], "empty range 3 to 2"),
        (&[&good, &good, "--deadline", "0.001"], "must be 0.05"),
        (
            &[
                &good, &good, "--space", "ras", "--unit", "mm", "--scale", "500",
            ],
            "must be within 0.01 to 100",
        ),
    ];
    for (arguments, expected) in cases {
        let arguments = [&["register"], arguments].concat();
        let (code, answer): (i32, Value) = answered(&arguments).await;
        assert_eq!(code, 3, "{arguments:?}: {answer}");
        assert!(
            answer.to_string().contains(expected),
            "{arguments:?}: {answer}"
        );
    }
}
