//! The standard cases: TEAR, a radial tear in the middle of the body, and BAND, all that lies inboard of a contour from
//! the paper's start to its goal. On the phantom they are the paper's; on any other meniscus the same is put at the
//! same angles and depths, as far as the rim of the phantom's case allows.

use arthro_geometry::phantom::{self, Coordinates, Phantom, RadialTear};
use arthro_geometry::{Mesh, Point3, Vector3};
use arthro_planning::Error;
use arthro_simulator::scenario::Layout;
use arthro_simulator::scenario::crescent::Crescent as Knee;
use arthro_simulator::voxels::Voxels as KneeVoxels;

use super::files::{Model, Source};
use super::site::Site;
use crate::arguments::ScenarioName;
use crate::bites_file::LesionPoints;
use crate::exit::Failure;

/// Where the contour leaves the free edge to both sides of the tear, degrees about the crescent.
const TEAR_ENDS_DEG: f64 = 28.0;
/// How far in from the free edge these ends lie on a meniscus from a file, mm; on the phantom as a share of the width.
const TEAR_END_DEPTH_MM: f64 = 0.3;
const TEAR_END_DEPTH: f64 = 0.03;
/// The paper's start and goal on the phantom: degrees from the middle of the body, and share of the width.
const BAND_ENDS: [(f64, f64); 2] = [(79.7, 0.11), (-63.4, 0.71)];
/// The rim that the paper's goal leaves on the phantom, mm: on a narrower meniscus the contour stays as far from the rim.
const BAND_RIM_MM: f64 = 3.2;
const LESION_SPACING_MM: f64 = 0.5;
/// Around a model, mm.
const BOX_MARGIN_MM: f64 = 5.0;
/// How far beside the tissue its height is still looked for, mm.
const HEIGHT_REACH_MM: f64 = 2.0;
/// Voxels in which the generic knee around a meniscus is laid out, mm.
const KNEE_VOXEL_MM: f64 = 0.5;

/// What a surgeon would have marked.
#[derive(Clone, Debug)]
pub struct Marked {
    /// Where the contour leaves the free edge.
    pub start: Point3,
    /// Where it meets it again.
    pub goal: Point3,
    /// Lowest and highest corner of the box that targets stay inside.
    pub target_box: (Point3, Point3),
    /// The damaged tissue, if any is marked.
    pub lesion: Option<LesionPoints>,
}

/// The marks of a standard case on a model.
pub fn marked(
    name: ScenarioName,
    model: &Model,
    portal: &Point3,
    voxel_mm: f64,
) -> Result<Marked, Failure> {
    match (model.source, name) {
        (Source::Phantom, ScenarioName::Tear) => Ok(torn_phantom(&model.mesh)),
        (Source::Phantom, ScenarioName::Band) => Ok(Marked {
            start: phantom::START,
            goal: phantom::GOAL,
            target_box: phantom::TARGET_BOX,
            lesion: None,
        }),
        (Source::Surface, name) => on_surface(name, &model.mesh, portal, voxel_mm),
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

/// The model and a margin around it.
pub fn box_around(mesh: &Mesh) -> Option<(Point3, Point3)> {
    let (low, high) = mesh.bounds()?;
    let margin = Vector3::repeat(BOX_MARGIN_MM);
    Some((low - margin, high + margin))
}

fn torn_phantom(mesh: &Mesh) -> Marked {
    let shape = Phantom::default();
    let on_edge = |phi_deg: f64| {
        shape.point(Coordinates {
            phi_rad: phi_deg.to_radians(),
            width_fraction: TEAR_END_DEPTH,
            height_fraction: 0.5,
        })
    };
    Marked {
        start: on_edge(TEAR_ENDS_DEG),
        goal: on_edge(-TEAR_ENDS_DEG),
        target_box: phantom::TARGET_BOX,
        lesion: Some(lesion(mesh, |point| {
            shape.is_torn(point, &RadialTear::BODY)
        })),
    }
}

fn on_surface(
    name: ScenarioName,
    mesh: &Mesh,
    portal: &Point3,
    voxel_mm: f64,
) -> Result<Marked, Failure> {
    let site = Site::of(mesh, portal, voxel_mm)?;
    let crescent = &site.crescent;
    let meniscal_from_ct = crescent.ct_from_meniscal.inverse();
    let rays: Vec<f64> = crescent.rays().collect();
    let (Some(first), Some(last)) = (rays.first(), rays.last()) else {
        let problem = "no ray meets its tissue".to_owned();
        return Err(Error::NotACrescent { problem }.into());
    };
    let middle_rad = 0.5 * (first + last);
    // The forceps come from the anterior side.
    let anterior = (meniscal_from_ct * *portal).y.signum();
    let at = |angle_deg: f64, depth_mm: &dyn Fn(f64) -> f64| {
        let angle_rad = (middle_rad + anterior * angle_deg.to_radians()).clamp(*first, *last);
        let edges = crescent.edge_mm(angle_rad).zip(crescent.rim_mm(angle_rad));
        let (edge_mm, rim_mm) = edges?;
        let radius_mm = edge_mm + depth_mm(rim_mm - edge_mm);
        let (x, y) = (radius_mm * angle_rad.cos(), radius_mm * angle_rad.sin());
        let height_mm = site.voxels.middle_mm(x, y, HEIGHT_REACH_MM)?;
        Some(crescent.ct_from_meniscal * Point3::new(x, y, height_mm))
    };
    let ends = match name {
        ScenarioName::Tear => {
            [TEAR_ENDS_DEG, -TEAR_ENDS_DEG].map(|angle_deg| at(angle_deg, &|_| TEAR_END_DEPTH_MM))
        }
        ScenarioName::Band => BAND_ENDS.map(|(angle_deg, share)| {
            at(angle_deg, &|width_mm| {
                (share * width_mm).min(width_mm - BAND_RIM_MM).max(0.0)
            })
        }),
    };
    let ([Some(start), Some(goal)], Some(target_box)) = (ends, box_around(mesh)) else {
        let problem = "it has no tissue where the contour would begin or end".to_owned();
        return Err(Error::NotACrescent { problem }.into());
    };
    let tear = &RadialTear::BODY;
    let is_torn = |point: &Point3| {
        let point = meniscal_from_ct * *point;
        let (radius_mm, turn_rad) = (
            point.xy().coords.norm(),
            crescent.angle_rad(&point) - middle_rad,
        );
        let edges = crescent
            .edge_mm(middle_rad)
            .zip(crescent.rim_mm(middle_rad));
        let deepest_mm = edges.map_or(0.0, |(edge_mm, rim_mm)| {
            edge_mm + tear.depth_fraction * (rim_mm - edge_mm)
        });
        turn_rad.cos() > 0.0
            && (radius_mm * turn_rad.sin()).abs() <= 0.5 * tear.width_mm
            && radius_mm <= deepest_mm
            && site.voxels.distance_mm(&point, 0.5) == Some(0.0)
    };
    Ok(Marked {
        start,
        goal,
        target_box,
        lesion: (name == ScenarioName::Tear).then(|| lesion(mesh, is_torn)),
    })
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
