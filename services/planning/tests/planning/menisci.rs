//! Segmented human menisci with a radial tear put in the middle of the body.

use std::path::PathBuf;

use arthro_geometry::ply::{self, Space, Stated, Unit};
use arthro_geometry::{Mesh, Point3, Vector3};
use arthro_planning::Error;
use arthro_planning::crescent::Crescent;
use arthro_planning::plan::{self, Request};
use arthro_planning::target::Aim;

use crate::world::{lesion, plan, tear_case};

const DEPTH_FRACTION: f64 = 0.42;
const WIDTH_MM: f64 = 1.5;
/// Where the paper's start and goal lie on the phantom: angle from the middle of the body towards the
/// anterior horn, and share of the width.
const BAND_ENDS_DEG: [f64; 2] = [60.0, -60.0];
const BAND_FRACTIONS: [f64; 2] = [0.11, 0.5];

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
        Some(Request {
            lesion: damaged,
            portals: vec![portal],
            target_box: None,
            model,
            ..tear_case()
        })
    }

    /// Everything inboard of a contour whose share of the width grows from the anterior to the
    /// posterior end, as on the phantom.
    fn band(&self) -> Option<Request> {
        let torn = self.torn()?;
        let (crescent, voxels) =
            plan::model(&torn.model, &torn.portals[0], torn.voxel_mm, 1.0).unwrap();
        let middle_rad = middle_rad(&crescent);
        let towards_anterior = crescent
            .ct_from_meniscal
            .inverse()
            .direction(&self.anterior);
        let side = towards_anterior.y.signum();
        let end = |angle_deg: f64, width_fraction: f64| {
            let angle_rad = middle_rad + side * angle_deg.to_radians();
            let edge_mm = crescent.edge_mm(angle_rad).unwrap();
            let width_mm = crescent.rim_mm(angle_rad).unwrap() - edge_mm;
            let radius_mm = edge_mm + width_fraction * width_mm;
            let (x, y) = (radius_mm * angle_rad.cos(), radius_mm * angle_rad.sin());
            let height_mm = voxels.middle_mm(x, y, 2.0).unwrap();
            crescent.ct_from_meniscal * Point3::new(x, y, height_mm)
        };
        Some(Request {
            lesion: Vec::new(),
            aim: Aim::Ends {
                start: end(BAND_ENDS_DEG[0], BAND_FRACTIONS[0]),
                goal: end(BAND_ENDS_DEG[1], BAND_FRACTIONS[1]),
            },
            ..torn
        })
    }
}

fn middle_rad(crescent: &Crescent) -> f64 {
    let rays: Vec<f64> = crescent.rays().collect();
    0.5 * (rays[0] + rays[rays.len() - 1])
}

/// A plan that keeps its limits, or a refusal that says why there is none.
fn is_planned_or_refused(file: &str, scenario: &str, request: &Request) {
    let refusal = match plan(request) {
        Ok(plan) => {
            let evaluation = &plan.evaluation;
            println!("{file} {scenario} {:?} {evaluation:?}", plan.choice);
            assert!(
                evaluation.region_covered_percent >= 95.0,
                "{file} {scenario}"
            );
            assert_eq!(
                evaluation.lesion_covered_percent.max(95.0),
                evaluation.lesion_covered_percent
            );
            assert!(evaluation.outside_removed_mm3 <= 15.0, "{file} {scenario}");
            assert!(
                evaluation.rim_min_mm >= request.contour_rules.rim_min_mm - 0.2,
                "{file} {scenario}"
            );
            assert!(evaluation.is_order_feasible(), "{file} {scenario}");
            return;
        }
        Err(refusal) => refusal,
    };
    println!("{file} {scenario} {refusal}");
    let named = matches!(
        refusal,
        Error::RimBelowLimit { .. }
            | Error::UnreachableTissue { .. }
            | Error::RegionNotCleared { .. }
    );
    assert!(named, "{file} {scenario}: {refusal}");
}

#[test]
fn every_meniscus_has_a_plan_for_its_tear_that_keeps_the_limits_or_a_named_refusal() {
    for meniscus in &MENISCI {
        if let Some(request) = meniscus.torn() {
            is_planned_or_refused(meniscus.file, "tear", &request);
        }
    }
}

#[test]
fn every_meniscus_has_a_plan_for_a_band_that_keeps_the_limits_or_a_named_refusal() {
    for meniscus in &MENISCI {
        if let Some(request) = meniscus.band() {
            is_planned_or_refused(meniscus.file, "band", &request);
        }
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

/// The menisci at hand, each torn, with the file's name.
pub fn torn() -> Vec<(&'static str, Request)> {
    let torn = |meniscus: &Meniscus| meniscus.torn().map(|request| (meniscus.file, request));
    MENISCI.iter().filter_map(torn).collect()
}
