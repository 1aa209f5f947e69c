//! The cases of a folder: `cases.json` names for each a source cloud, a target cloud and the truth,
//! target = scale R source + t.

use std::collections::HashMap;
use std::path::Path;

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::nalgebra::{Matrix3, Rotation3};
use arthro_geometry::{Cloud, Point3, Rotation, Similarity, Vector3, surface_file};
use serde::Deserialize;

use crate::commands::{read, unreadable};
use crate::exit::Failure;

/// One problem with its truth.
#[derive(Debug)]
pub struct Case {
    pub name: String,
    pub level: String,
    pub source: Cloud,
    pub target: Cloud,
    pub viewpoint: Option<Point3>,
    pub truth: Similarity<Camera, Ct>,
    /// Middle of the source, where translations are compared.
    pub centroid: Point3,
}

#[derive(Deserialize)]
struct Listed {
    cases: Vec<ListedCase>,
}

/// A case as it stands in the file; other keys are left out.
#[derive(Deserialize)]
struct ListedCase {
    id: String,
    level: String,
    source: String,
    target: String,
    scale: f64,
    #[serde(rename = "R")]
    rotation: [[f64; 3]; 3],
    t: [f64; 3],
    target_viewpoint: Option<[f64; 3]>,
}

/// Reads all cases of `folder`.
pub fn read_all(folder: &Path) -> Result<Vec<Case>, Failure> {
    let path = folder.join("cases.json");
    let bytes = read(&path)?;
    let listed: Listed =
        serde_json::from_slice(&bytes).map_err(|error| unreadable(&path, &error))?;
    let mut sources: HashMap<String, Cloud> = HashMap::new();
    listed
        .cases
        .into_iter()
        .map(|case| {
            if !sources.contains_key(&case.source) {
                sources.insert(case.source.clone(), cloud(&folder.join(&case.source))?);
            }
            let source = sources[&case.source].clone();
            let rows = case.rotation.map(|row| Vector3::from(row).transpose());
            let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_rows(&rows));
            let sum: Vector3 = source.points.iter().map(|p| p.coords).sum();
            Ok(Case {
                centroid: Point3::from(sum / source.points.len() as f64),
                target: cloud(&folder.join(&case.target))?,
                viewpoint: case.target_viewpoint.map(Point3::from),
                truth: Similarity::new(
                    case.scale,
                    Rotation::from_rotation_matrix(&rotation),
                    case.t.into(),
                ),
                name: case.id,
                level: case.level,
                source,
            })
        })
        .collect()
}

fn cloud(path: &Path) -> Result<Cloud, Failure> {
    surface_file::read_as_it_stands(path, &read(path)?)
        .map(|surface| surface.cloud)
        .map_err(|error| unreadable(path, &error))
}
