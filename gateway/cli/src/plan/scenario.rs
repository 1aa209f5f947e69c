//! The standard cases: TEAR, a radial tear in the middle of the body with the contour around it, and BAND, all that lies
//! inboard of a contour from the paper's start to its goal. On the phantom they are the paper's; on any other meniscus
//! the same is put at the same angles and depths, as far as the rim of the phantom's case allows.

use arthro_geometry::phantom::{self, Phantom, RadialTear};
use arthro_geometry::{Mesh, Point3, Vector3};
use arthro_planning::Error;
use arthro_planning::target::{Aim, Rules};
use arthro_simulator::scenario::Layout;
use arthro_simulator::scenario::crescent::Crescent as Knee;
use arthro_simulator::voxels::Voxels as KneeVoxels;

use super::files::{Model, Source};
use super::site::Site;
use crate::arguments::ScenarioName;
use crate::bites_file::LesionPoints;
use crate::exit::Failure;

/// The paper's start and goal on the phantom: degrees from the middle of the body, and share of the width.
const BAND_ENDS: [(f64, f64); 2] = [(79.7, 0.11), (-63.4, 0.71)];
/// The rim that the paper's goal leaves on the phantom, mm: the least that BAND leaves on any meniscus.
const BAND_RIM_MM: f64 = 3.2;
const LESION_SPACING_MM: f64 = 0.5;
/// How far beside the tissue its height is still looked for, mm.
const HEIGHT_REACH_MM: f64 = 2.0;
/// Voxels in which the generic knee around a meniscus is laid out, mm.
const KNEE_VOXEL_MM: f64 = 0.5;

/// What a surgeon would have marked.
#[derive(Clone, Debug)]
pub struct Marks {
    /// What the contour comes from, ct.
    pub aim: Aim,
    /// Lowest and highest corner of the box that targets stay inside, if any is meant.
    pub target_box: Option<(Point3, Point3)>,
    /// The damaged tissue, if any is marked.
    pub lesion: Option<LesionPoints>,
    /// The rim that must be left, mm.
    pub rim_min_mm: f64,
}

impl Marks {
    /// The marks of a standard case on a model.
    pub fn standard(
        name: ScenarioName,
        model: &Model,
        portal: &Point3,
        voxel_mm: f64,
    ) -> Result<Self, Failure> {
        let target_box = (model.source == Source::Phantom).then_some(phantom::TARGET_BOX);
        let (mesh, is_phantom) = (&model.mesh, model.source == Source::Phantom);
        match name {
            ScenarioName::Tear => Ok(Self {
                aim: Aim::Lesion,
                target_box,
                lesion: Some(if is_phantom {
                    torn_phantom(mesh)
                } else {
                    torn(&Site::of(mesh, portal, voxel_mm)?, mesh)?
                }),
                rim_min_mm: Rules::default().rim_min_mm,
            }),
            ScenarioName::Band => Ok(Self {
                aim: if is_phantom {
                    Aim::Ends {
                        start: phantom::START,
                        goal: phantom::GOAL,
                    }
                } else {
                    band_ends(&Site::of(mesh, portal, voxel_mm)?, portal)?
                },
                target_box,
                lesion: None,
                rim_min_mm: BAND_RIM_MM,
            }),
        }
    }
}

/// The anterolateral portal: that of the phantom; for a surface, which says nothing about its knee, that of a generic
/// one around it.
pub fn anterolateral(model: &Model) -> Result<Point3, Failure> {
    if model.source == Source::Phantom {
        return Ok(phantom::PORTAL_ANTEROLATERAL);
    }
    // Refuses what is no meniscus before any memory is taken for its knee.
    let above = model.mesh.vertices.first().copied().unwrap_or_default() + Vector3::z();
    Site::of(&model.mesh, &above, KNEE_VOXEL_MM)?;
    let voxels = KneeVoxels::from_mesh(&model.mesh, KNEE_VOXEL_MM);
    let knee = Knee::of_mesh(&model.mesh, &voxels)
        .map_err(|error| Failure::refused_because("INVALID_ARGUMENT", &error))?;
    let [forceps, _] = Layout::default().portals_in_knee(&knee);
    Ok(knee.ct_from_knee * forceps)
}

fn torn_phantom(mesh: &Mesh) -> LesionPoints {
    let shape = Phantom::default();
    lesion(mesh, |point| shape.is_torn(point, &RadialTear::BODY))
}

/// First and last ray that meet the tissue.
fn span_rad(site: &Site) -> Result<(f64, f64), Failure> {
    let mut rays = site.crescent.rays();
    let first = rays.next();
    first.zip(rays.last()).ok_or_else(|| {
        let problem = "no ray meets its tissue".to_owned();
        Error::NotACrescent { problem }.into()
    })
}

fn band_ends(site: &Site, portal: &Point3) -> Result<Aim, Failure> {
    let crescent = &site.crescent;
    let (first_rad, last_rad) = span_rad(site)?;
    let middle_rad = 0.5 * (first_rad + last_rad);
    // A fitted contour and the rim at its goal are known to half a voxel.
    let left_mm = BAND_RIM_MM + 0.5 * site.voxels.voxel_mm();
    // The forceps come from the anterior side.
    let anterior = (crescent.ct_from_meniscal.inverse() * *portal).y.signum();
    let ends = BAND_ENDS.map(|(angle_deg, share)| {
        let angle_rad = (middle_rad + anterior * angle_deg.to_radians()).clamp(first_rad, last_rad);
        let edge_mm = crescent.edge_mm(angle_rad)?;
        let width_mm = crescent.rim_mm(angle_rad)? - edge_mm;
        let depth_mm = (share * width_mm).min(width_mm - left_mm).max(0.0);
        let radius_mm = edge_mm + depth_mm;
        let (x, y) = (radius_mm * angle_rad.cos(), radius_mm * angle_rad.sin());
        let height_mm = site.voxels.middle_mm(x, y, HEIGHT_REACH_MM)?;
        Some(crescent.ct_from_meniscal * Point3::new(x, y, height_mm))
    });
    let [Some(start), Some(goal)] = ends else {
        let problem = "it has no tissue where the contour would begin or end".to_owned();
        return Err(Error::NotACrescent { problem }.into());
    };
    Ok(Aim::Ends { start, goal })
}

fn torn(site: &Site, mesh: &Mesh) -> Result<LesionPoints, Failure> {
    let crescent = &site.crescent;
    let meniscal_from_ct = crescent.ct_from_meniscal.inverse();
    let (first_rad, last_rad) = span_rad(site)?;
    let middle_rad = 0.5 * (first_rad + last_rad);
    let tear = &RadialTear::BODY;
    let edges = crescent
        .edge_mm(middle_rad)
        .zip(crescent.rim_mm(middle_rad));
    let deepest_mm = edges.map_or(0.0, |(edge_mm, rim_mm)| {
        edge_mm + tear.depth_fraction * (rim_mm - edge_mm)
    });
    Ok(lesion(mesh, |point| {
        let point = meniscal_from_ct * *point;
        let radius_mm = point.xy().coords.norm();
        let turn_rad = crescent.angle_rad(&point) - middle_rad;
        turn_rad.cos() > 0.0
            && (radius_mm * turn_rad.sin()).abs() <= 0.5 * tear.width_mm
            && radius_mm <= deepest_mm
            && site.voxels.distance_mm(&point, 0.5) == Some(0.0)
    }))
}

/// The points of a grid over a model that are damaged.
fn lesion(mesh: &Mesh, is_damaged: impl Fn(&Point3) -> bool) -> LesionPoints {
    let steps = |value: f64| value / LESION_SPACING_MM;
    let mut points = Vec::new();
    if let Some((low, high)) = mesh.bounds() {
        let first = low.map(|value| steps(value).floor() as i64);
        let last = high.map(|value| steps(value).ceil() as i64);
        for i in first.x..=last.x {
            for j in first.y..=last.y {
                let column = (first.z..=last.z)
                    .map(|k| Point3::new(i as f64, j as f64, k as f64) * LESION_SPACING_MM);
                points.extend(column.filter(&is_damaged));
            }
        }
    }
    LesionPoints {
        spacing_mm: LESION_SPACING_MM,
        points,
    }
}
