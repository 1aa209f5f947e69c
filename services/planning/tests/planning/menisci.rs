//! Segmented human menisci with a radial tear put in the middle of the body.

use std::path::PathBuf;

use arthro_geometry::ply::{self, Space, Stated, Unit};
use arthro_geometry::{Mesh, Point3, Vector3};
use arthro_planning::crescent::Crescent;
use arthro_planning::plan::{self, Request};

use crate::world::{lesion, papers_case, plan, worst_displaced_percent};

const DEPTH_FRACTION: f64 = 0.42;
const WIDTH_MM: f64 = 1.5;
/// The contour needs 6 mm of the free edge to each side of a tear.
const ENDS_DEG: f64 = 45.0;
/// What the tear leaves of the narrowest meniscus, with the margin around it.
const RIM_MIN_MM: f64 = 2.0;

/// A mesh of the data and how it lies.
pub struct Meniscus {
    pub file: &'static str,
    superior: Vector3,
    anterior: Vector3,
}

pub const MENISCI: [Meniscus; 4] = [
    Meniscus::pymskt("pymskt_lateral_meniscus.ply"),
    Meniscus::pymskt("pymskt_medial_meniscus.ply"),
    Meniscus::smith("smith2019_R_lateral_meniscus.ply"),
    Meniscus::smith("smith2019_R_medial_meniscus.ply"),
];

impl Meniscus {
    const fn pymskt(file: &'static str) -> Self {
        Self {
            file,
            superior: Vector3::new(0.0, 0.0, 1.0),
            anterior: Vector3::new(0.0, -1.0, 0.0),
        }
    }

    const fn smith(file: &'static str) -> Self {
        Self {
            file,
            superior: Vector3::new(0.0, 1.0, 0.0),
            anterior: Vector3::new(1.0, 0.0, 0.0),
        }
    }

    /// The mesh; `None`, said loudly, where the data are absent.
    fn mesh(&self) -> Option<Mesh> {
        let root = std::env::var_os("ARTHRO_DATA").map_or_else(
            || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
            PathBuf::from,
        );
        let path = root.join("menisci").join(self.file);
        let Ok(bytes) = std::fs::read(&path) else {
            eprintln!("SKIPPED: {} is absent; set ARTHRO_DATA", path.display());
            return None;
        };
        let stated = Stated {
            space: Space::Lps,
            unit: Unit::Millimetre,
        };
        Some(ply::read_mesh(&bytes, Some(stated)).unwrap())
    }

    /// A tear in the middle of the body, start and goal on the free edge beside it, a portal 26 mm in
    /// front of the anterior rim.
    pub fn torn(&self) -> Option<Request> {
        let model = self.mesh()?;
        let (low, high) = model.bounds().unwrap();
        let center = nalgebra::center(&low, &high);
        let half_mm = 0.5 * (high - low).dot(&self.anterior).abs();
        let portal = center + self.anterior * (half_mm + 26.0) + self.superior * 8.0;
        let (crescent, voxels) = plan::model(&model, &portal, 0.5, 1.0).unwrap();
        let meniscal_from_ct = crescent.ct_from_meniscal.inverse();
        let middle_rad = middle_rad(&crescent);
        let edge_mm = crescent.edge_mm(middle_rad).unwrap();
        let deepest_mm =
            edge_mm + DEPTH_FRACTION * (crescent.rim_mm(middle_rad).unwrap() - edge_mm);
        let damaged = lesion(&model, |point| {
            let point = meniscal_from_ct * *point;
            let (radius_mm, angle_rad) = (
                point.xy().coords.norm(),
                crescent.angle_rad(&point) - middle_rad,
            );
            angle_rad.cos() > 0.0
                && (radius_mm * angle_rad.sin()).abs() <= 0.5 * WIDTH_MM
                && radius_mm <= deepest_mm
                && voxels.distance_mm(&point, 0.5) == Some(0.0)
        });
        let on_edge = |angle_deg: f64| {
            let angle_rad = middle_rad + angle_deg.to_radians();
            let radius_mm = crescent.edge_mm(angle_rad).unwrap() + 0.3;
            let (x, y) = (radius_mm * angle_rad.cos(), radius_mm * angle_rad.sin());
            let height_mm = voxels.middle_mm(x, y, 2.0).unwrap();
            crescent.ct_from_meniscal * Point3::new(x, y, height_mm)
        };
        let around = Vector3::repeat(5.0);
        Some(Request {
            lesion: damaged,
            start: on_edge(ENDS_DEG),
            goal: on_edge(-ENDS_DEG),
            target_box: (low - around, high + around),
            portal,
            model,
            rim_min_mm: RIM_MIN_MM,
            ..papers_case()
        })
    }
}

fn middle_rad(crescent: &Crescent) -> f64 {
    let rays: Vec<f64> = crescent.rays().collect();
    0.5 * (rays[0] + rays[rays.len() - 1])
}

#[test]
fn every_meniscus_has_a_plan_that_clears_its_tear() {
    for meniscus in &MENISCI {
        let Some(request) = meniscus.torn() else {
            continue;
        };
        let began = std::time::Instant::now();
        let plan = plan(&request).unwrap();
        let seconds = began.elapsed().as_secs_f64();
        let displaced = worst_displaced_percent(&request, &plan.bites, &meniscus.superior, 0.7);
        println!(
            "{} {seconds:.2} s, displaced {displaced:.1} %, {:?}",
            meniscus.file, plan.evaluation
        );
        let evaluation = plan.evaluation;
        assert!(evaluation.bites <= 15, "{}: {evaluation:?}", meniscus.file);
        assert!(
            evaluation.lesion_covered_percent >= 98.0,
            "{}: {evaluation:?}",
            meniscus.file
        );
        assert!(displaced >= 95.0, "{}: {displaced} %", meniscus.file);
    }
}

#[test]
fn every_meniscus_has_its_free_edge_before_its_rim_on_every_ray() {
    for meniscus in &MENISCI {
        let Some(mesh) = meniscus.mesh() else {
            continue;
        };
        let (low, high) = mesh.bounds().unwrap();
        let above = nalgebra::center(&low, &high) + meniscus.superior * 50.0;
        let crescent = Crescent::of(&mesh, &above).unwrap();
        let superior = crescent.ct_from_meniscal.direction(&Vector3::z());
        assert!(superior.dot(&meniscus.superior) > 0.95, "{}", meniscus.file);
        let rays: Vec<f64> = crescent.rays().collect();
        let span_deg = (rays[rays.len() - 1] - rays[0]).to_degrees();
        assert!(
            (180.0..345.0).contains(&span_deg),
            "{}: {span_deg} deg",
            meniscus.file
        );
        for angle_rad in rays {
            let edge_mm = crescent.edge_mm(angle_rad).unwrap();
            let rim_mm = crescent.rim_mm(angle_rad).unwrap();
            assert!(
                2.0 < edge_mm && edge_mm < rim_mm && rim_mm < 30.0,
                "{}",
                meniscus.file
            );
        }
    }
}

#[test]
fn the_voxels_of_every_meniscus_have_its_volume_even_where_the_mesh_is_open() {
    for meniscus in &MENISCI {
        let Some(mesh) = meniscus.mesh() else {
            continue;
        };
        let solid = arthro_geometry::volume::Solid::of(&mesh, 0.25).unwrap();
        let share = solid.volume_mm3() / mesh.volume_mm3();
        assert!((share - 1.0).abs() < 0.02, "{}: {share}", meniscus.file);
    }
}
