//! Known problems to solve: the public cases, views rendered from meshes, and a made-up crescent.
//!
//! Real menisci come from the folder `$ARTHRO_DATA`, by default `../shared/data` beside the workspace. Without it the
//! tests that need it say so and pass.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Instant;

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::nalgebra::{Matrix3, Rotation3};
use arthro_geometry::ply::{Space, Stated, Unit, read_cloud};
use arthro_geometry::{Cloud, Point3, Rotation, Similarity, Vector3};
use arthro_registration::budget::Budget;
use arthro_registration::pipeline::{Options, Registration, register};
use serde_json::Value;

/// One case made metric: the target and all that belongs to it divided by the true scale.
#[derive(Clone)]
pub struct Case {
    pub name: String,
    pub mesh: String,
    pub source: Cloud,
    pub target: Cloud,
    pub options: Options,
    pub truth: Similarity<Camera, Ct>,
    pub centroid: Point3,
}

/// How far an answer is from the truth.
pub struct Outcome {
    pub rotation_deg: f64,
    pub centroid_mm: f64,
    pub scale_percent: f64,
    pub tre_mm: f64,
    pub seconds: f64,
    pub answer: Registration,
}

impl Outcome {
    pub fn is_success(&self) -> bool {
        self.rotation_deg < 5.0 && self.centroid_mm < 2.0 && self.scale_percent < 3.0
    }
}

pub fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("ARTHRO_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    if folder.join("registration/cases.json").exists() {
        return Some(folder);
    }
    eprintln!(
        "SKIPPED: no registration/cases.json in {}",
        folder.display()
    );
    None
}

pub fn cases(level: &str) -> Vec<Case> {
    let Some(folder) = data() else {
        return Vec::new();
    };
    let folder = folder.join("registration");
    let read = |name: &Value| {
        let bytes = std::fs::read(folder.join(name.as_str().unwrap())).unwrap();
        let stated = Stated {
            space: Space::Lps,
            unit: Unit::Millimetre,
        };
        read_cloud(&bytes, Some(stated)).unwrap()
    };
    let text = std::fs::read_to_string(folder.join("cases.json")).unwrap();
    let listed: Value = serde_json::from_str(&text).unwrap();
    listed["cases"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|case| case["level"] == level)
        .map(|case| {
            let scale = case["scale"].as_f64().unwrap();
            let rows = case["R"].as_array().unwrap().iter().map(vector);
            let matrix = Matrix3::from_columns(&rows.collect::<Vec<_>>()).transpose();
            let rotation =
                Rotation::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
            let mut target = read(&case["target"]);
            for point in &mut target.points {
                *point /= scale;
            }
            Case {
                name: case["id"].as_str().unwrap().to_owned(),
                mesh: case["mesh"].as_str().unwrap().to_owned(),
                source: read(&case["source"]),
                target,
                options: Options {
                    viewpoint: Some(Point3::from(vector(&case["target_viewpoint"]) / scale)),
                    ..Options::default()
                },
                truth: Similarity::new(1.0, rotation, vector(&case["t"]) / scale),
                centroid: Point3::from(vector(&case["source_centroid"])),
            }
        })
        .collect()
}

fn vector(json: &Value) -> Vector3 {
    Vector3::from_iterator(json.as_array().unwrap().iter().map(|c| c.as_f64().unwrap()))
}

impl Case {
    pub fn solve(&self) -> Outcome {
        let began = Instant::now();
        let answer = register(
            &self.source,
            &self.target,
            &self.options,
            &mut |_| {},
            &Budget::default(),
        )
        .unwrap();
        let seconds = began.elapsed().as_secs_f64();
        let found = answer.camera_from_ct;
        let squares: f64 = self
            .source
            .points
            .iter()
            .map(|p| (found * *p - self.truth * *p).norm_squared())
            .sum();
        Outcome {
            rotation_deg: found.rotation.angle_to(&self.truth.rotation).to_degrees(),
            centroid_mm: (found * self.centroid - self.truth * self.centroid).norm(),
            scale_percent: (found.scale - 1.0).abs() * 100.0,
            tre_mm: (squares / self.source.points.len() as f64).sqrt(),
            seconds,
            answer,
        }
    }
}

/// A crescent-shaped band with a wedge profile: 32 mm wide, thicker and wider at one horn, so that no turn maps it to itself.
pub fn crescent() -> Cloud {
    let mut points = Vec::new();
    for step in 0..180 {
        let along = f64::from(step) / 179.0;
        let angle = along * 4.2;
        let (width, height) = (6.0 + 5.0 * along, 3.5 + 3.0 * along * along);
        for side in 0..40 {
            let across = f64::from(side % 20) / 19.0;
            let lift = if side < 20 {
                height * across.powf(1.5)
            } else {
                0.0
            };
            let radius = 16.0 - width * (1.0 - across);
            points.push(Point3::new(
                radius * angle.cos(),
                0.8 * radius * angle.sin(),
                lift + 0.15 * radius * (2.0 * angle).sin(),
            ));
        }
    }
    Cloud::new(points)
}

/// What a camera at `viewpoint` sees of a densely sampled surface: the nearest point of each pixel, noise along the ray.
pub fn seen(
    surface: &[Point3],
    viewpoint: Point3,
    pitch_mm: f64,
    mut noise_mm: impl FnMut() -> f64,
) -> Cloud {
    let (low, high) = arthro_geometry::cloud::bounds(surface).unwrap();
    let toward = low + (high - low) / 2.0 - viewpoint;
    let looking = Rotation::rotation_between(&toward, &Vector3::z()).unwrap();
    let pixel = pitch_mm / toward.norm();
    let mut nearest: BTreeMap<(i64, i64), (f64, Point3)> = BTreeMap::new();
    for point in surface {
        let ray = looking * (point - viewpoint);
        let pixel = [ray.x, ray.y].map(|c| (c / ray.z / pixel).round() as i64);
        let seen = nearest.entry(pixel.into()).or_insert((ray.z, *point));
        if ray.z < seen.0 {
            *seen = (ray.z, *point);
        }
    }
    let points = nearest
        .into_values()
        .map(|(_, point)| point + (point - viewpoint).normalize() * noise_mm());
    Cloud::new(points.collect())
}
