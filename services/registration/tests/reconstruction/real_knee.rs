//! A real knee: the label map of an MR scan against the meshes that others made of it.
//!
//! The folder `$ARTHRO_DATA`, by default `../shared/data` beside the workspace, holds both. Without it the test says so
//! and passes. Which label is which is not taken for known: the one whose box is nearest to that of the mesh is.

use std::path::{Path, PathBuf};

use arthro_geometry::mesh::NearestOnMesh;
use arthro_geometry::ply::{Space, Stated, Unit, read_mesh};
use arthro_geometry::scan::labels;
use arthro_geometry::{Mesh, Point3, Scan, nrrd};
use arthro_registration::reconstruct::{Inside, Options, Reconstruction, sample};

use crate::shapes::surface;

/// Points that stand for a surface.
const SAMPLES: usize = 20_000;

fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("ARTHRO_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    if folder.join("volumes/pymskt_knee_labels.nrrd").exists() {
        return Some(folder);
    }
    eprintln!(
        "SKIPPED: no volumes/pymskt_knee_labels.nrrd in {}",
        folder.display()
    );
    None
}

fn scan(folder: &Path) -> Scan {
    let file = std::fs::read(folder.join("volumes/pymskt_knee_labels.nrrd")).unwrap();
    nrrd::read(&file, None).unwrap()
}

fn given(folder: &Path, name: &str) -> Mesh {
    let stated = Stated {
        space: Space::Lps,
        unit: Unit::Millimetre,
    };
    let file = std::fs::read(folder.join(name)).unwrap();
    read_mesh(&file, Some(stated)).unwrap()
}

/// The surface of the label whose box is nearest to that of a mesh.
fn counterpart(scan: &Scan, mesh: &Mesh) -> Reconstruction {
    let (low, high) = mesh.bounds().unwrap();
    let labels = labels(scan).unwrap();
    let apart = |bounds: &(Point3, Point3)| (bounds.0 - low).norm() + (bounds.1 - high).norm();
    let nearest = labels
        .iter()
        .min_by(|a, b| apart(&a.bounds).total_cmp(&apart(&b.bounds)))
        .unwrap();
    surface(scan, &Options::new(Inside::Label(nearest.value)))
}

/// Distances from one surface to another, in voxels, ascending.
fn distances(from: &Mesh, to: &Mesh, voxel_mm: f64) -> Vec<f64> {
    let to = NearestOnMesh::new(to);
    let points = sample(from, SAMPLES).points;
    let mut distances: Vec<f64> = points
        .iter()
        .map(|p| to.distance_mm(p) / voxel_mm)
        .collect();
    distances.sort_by(f64::total_cmp);
    distances
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn menisci_and_tibia_agree_with_the_given_meshes_within_half_a_voxel() {
    let Some(folder) = data() else { return };
    let scan = scan(&folder);
    let voxel_mm = scan.lattice().voxel_mm3().cbrt();
    for name in [
        "menisci/pymskt_lateral_meniscus.ply",
        "menisci/pymskt_medial_meniscus.ply",
        "bones/pymskt_tibia.ply",
    ] {
        let given = given(&folder, name);
        let ours = counterpart(&scan, &given);
        assert!(ours.mesh.is_watertight(), "{name}");
        for (from, to) in [(&ours.mesh, &given), (&given, &ours.mesh)] {
            let distances = distances(from, to, voxel_mm);
            assert!(mean(&distances) < 0.5, "{name}: {}", mean(&distances));
        }
        let thicker_mm = (ours.mesh.volume_mm3() - given.volume_mm3()) / given.area_mm2();
        assert!(thicker_mm.abs() < 0.5 * voxel_mm, "{name}: {thicker_mm} mm");
    }
}

#[test]
fn the_given_cartilage_lies_on_ours() {
    // The label reaches farther at the thin edges than the mesh, so that only this direction says how well they agree.
    let Some(folder) = data() else { return };
    let scan = scan(&folder);
    let voxel_mm = scan.lattice().voxel_mm3().cbrt();
    for name in [
        "bones/pymskt_lat_tibial_cartilage.ply",
        "bones/pymskt_med_tibial_cartilage.ply",
    ] {
        let given = given(&folder, name);
        let distances = distances(&given, &counterpart(&scan, &given).mesh, voxel_mm);
        assert!(mean(&distances) < 0.5, "{name}: {}", mean(&distances));
    }
}

#[test]
fn every_label_of_the_knee_has_a_watertight_surface_of_its_volume() {
    let Some(folder) = data() else { return };
    let scan = scan(&folder);
    for label in labels(&scan).unwrap() {
        let surface = surface(&scan, &Options::new(Inside::Label(label.value)));
        assert!(surface.mesh.is_watertight(), "{}", label.value);
        let off = surface.mesh.volume_mm3() / label.volume_mm3 - 1.0;
        assert!(off.abs() < 1e-3, "{}: {off}", label.value);
    }
}
