//! `arthro reconstruct` as people and scripts run it: what it prints, writes and exits with.
#![allow(clippy::unwrap_used, reason = "a helper that fails fails its test")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use arthro_geometry::ply::{read_cloud, read_mesh};
use serde_json::Value;
use tempfile::TempDir;

/// A label map with a block of label 4, 6 x 5 x 4 voxels of 0.5 x 0.5 x 1 mm, and a voxel of label 9.
fn volume(folder: &TempDir) -> PathBuf {
    let mut words = Vec::new();
    for (k, j, i) in (0..800).map(|at| (at / 100, at / 10 % 10, at % 10)) {
        let is_block = (2..8).contains(&i) && (3..8).contains(&j) && (2..6).contains(&k);
        words.push(match (is_block, (i, j, k)) {
            (true, _) => "4",
            (false, (9, 9, 0)) => "9",
            _ => "0",
        });
    }
    let header = "NRRD0004\ntype: short\ndimension: 3\nspace: right-anterior-superior\nsizes: 10 10 8\n\
        space directions: (0.5,0,0) (0,0.5,0) (0,0,1)\nspace origin: (10,20,30)\nencoding: text\n\n";
    let path = folder.path().join("block.nrrd");
    std::fs::write(&path, format!("{header}{}", words.join(" "))).unwrap();
    path
}

fn arthro(volume: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_arthro"))
        .arg("reconstruct")
        .arg(volume)
        .args(arguments)
        .output()
        .unwrap()
}

fn answer(output: &Output) -> Value {
    let text = String::from_utf8_lossy(&output.stdout);
    serde_json::from_str(text.lines().last().unwrap()).unwrap()
}

#[test]
fn a_label_becomes_a_mesh_and_a_cloud_that_read_back() {
    let folder = TempDir::new().unwrap();
    let [mesh, cloud] = ["mesh.ply", "cloud.ply"].map(|name| folder.path().join(name));
    let output = arthro(
        &volume(&folder),
        &[
            "--label",
            "4",
            "--json",
            "--out",
            mesh.to_str().unwrap(),
            "--cloud",
            cloud.to_str().unwrap(),
            "--points",
            "700",
        ],
    );
    assert!(output.status.success(), "{output:?}");
    let said = answer(&output);
    assert_eq!(said["label"], 4);
    assert_eq!(said["watertight"], true);
    assert_eq!(said["touches_border"], false);
    let volume_mm3 = said["volume_mm3"].as_f64().unwrap();
    assert!(
        (volume_mm3 - 6.0 * 5.0 * 4.0 * 0.25).abs() < 0.1,
        "{volume_mm3}"
    );

    let mesh = read_mesh(&std::fs::read(mesh).unwrap(), None).unwrap();
    assert!(mesh.is_watertight());
    assert_eq!(mesh.triangles.len() as u64, said["triangles"]);
    assert_eq!(mesh.vertices.len() as u64, said["vertices"]);
    // RAS became LPS: the block reaches from x = 11 to 13.5, y = 21.5 to 23.5 and z = 32 to 35 there.
    let (low, high) = mesh.bounds().unwrap();
    let middle = low + (high - low) / 2.0;
    assert!(
        (middle.x + 12.25).abs() < 0.1 && (middle.y + 22.5).abs() < 0.1,
        "{middle}"
    );
    assert!((middle.z - 33.5).abs() < 0.1, "{middle}");
    assert!((said["bounds"]["min"][0].as_f64().unwrap() - low.x).abs() < 1e-5);
    let cloud = read_cloud(&std::fs::read(cloud).unwrap(), None).unwrap();
    assert_eq!((cloud.points.len(), cloud.normals.len()), (700, 700));
}

#[test]
fn a_list_shows_every_label_with_its_voxels() {
    let folder = TempDir::new().unwrap();
    let said = answer(&arthro(&volume(&folder), &["--list", "--json"]));
    let labels: Vec<(i64, i64)> = said["labels"]
        .as_array()
        .unwrap()
        .iter()
        .map(|label| {
            (
                label["label"].as_i64().unwrap(),
                label["voxels"].as_i64().unwrap(),
            )
        })
        .collect();
    assert_eq!(labels, [(4, 120), (9, 1)]);
    assert!((said["labels"][0]["volume_mm3"].as_f64().unwrap() - 30.0).abs() < 1e-9);
    assert_eq!(said["labels"][1]["bounds"]["max"][1], -24.5);
}

#[test]
fn refusals_exit_with_3_and_name_the_field() {
    let folder = TempDir::new().unwrap();
    let volume = volume(&folder);
    let nowhere = folder.path().join("none/mesh.ply");
    for (arguments, expected) in [
        (&["--label", "5"][..], "label: is 5, there are 4, 9"),
        (
            &["--threshold", "9.5"],
            "threshold: is 9.5, the values are 0 to 9",
        ),
        (
            &["--label", "4", "--triangles", "7"],
            "triangles: is 7, must be at least 100",
        ),
        (
            &["--label", "4", "--space", "lps", "--unit", "mm"],
            "by the caller",
        ),
        (
            &["--label", "4", "--out", nowhere.to_str().unwrap()],
            "FILE_UNWRITABLE",
        ),
    ] {
        let output = arthro(&volume, arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{arguments:?}: {said}");
        assert!(said.contains(expected), "{arguments:?}: {said}");
    }
    assert_eq!(arthro(&volume, &[]).status.code(), Some(2));
    assert_eq!(
        arthro(&volume, &["--label", "4", "--list"]).status.code(),
        Some(2)
    );
}
