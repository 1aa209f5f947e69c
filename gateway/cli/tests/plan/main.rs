//! `arthro plan` and `arthro evaluate` as people and scripts run them: from files, without any server.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a helper that fails fails its test"
)]

mod evaluate;
mod marks;
mod refusals;
mod scorecard;
mod written;

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

/// The bites file that a plan is written to.
fn written(path: &str) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}
