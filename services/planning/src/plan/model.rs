//! The model that a plan is made on, and whether what is asked for lies on it.

use arthro_geometry::{Mesh, Point3};

use super::Request;
use crate::crescent::Crescent;
use crate::error::Error;
use crate::target::Aim;
use crate::voxels::Voxels;

/// Extent that a meniscus has, mm: a mesh in metres or inches is neither.
pub(super) const EXTENT_MM: std::ops::RangeInclusive<f64> = 10.0..=150.0;
/// How far the volume by the triangles' direction may be from the solid's, as a share.
const VOLUME_MISMATCH: f64 = 0.3;
/// Distance of the portal from the nearest voxel of tissue, mm.
const PORTAL_CLEARANCE_MM: f64 = 5.0;

/// The crescent and the voxels of a model, checked to have the size of a meniscus.
pub fn model(
    mesh: &Mesh,
    above: &Point3,
    voxel_mm: f64,
    margin_mm: f64,
) -> Result<(Crescent, Voxels), Error> {
    arthro_geometry::volume::check(mesh)?;
    let (low, high) = mesh.bounds().ok_or(arthro_geometry::volume::Error::Empty)?;
    let extent_mm = (high - low).max();
    if !EXTENT_MM.contains(&extent_mm) {
        return Err(Error::invalid(
            "model",
            format!(
                "is {extent_mm:.4} mm long; must be {} .. {} mm: are the vertices in millimetres?",
                EXTENT_MM.start(),
                EXTENT_MM.end()
            ),
        ));
    }
    let crescent = Crescent::of(mesh, above)?;
    let voxels = Voxels::of(mesh, &crescent, voxel_mm, margin_mm)?;
    let solid_mm3 = voxels.centers().len() as f64 * voxels.voxel_mm3();
    let signed_mm3 = mesh.volume_mm3().abs();
    if (signed_mm3 / solid_mm3 - 1.0).abs() > VOLUME_MISMATCH {
        return Err(Error::invalid(
            "model",
            format!(
                "has triangles that face both ways or pass through each other: they enclose {signed_mm3:.0} mm3 by their \
                 direction and {solid_mm3:.0} mm3 by their place"
            ),
        ));
    }
    Ok((crescent, voxels))
}

/// Ends, box and portals must fit the tissue.
pub(super) fn check_places(
    request: &Request,
    crescent: &Crescent,
    voxels: &Voxels,
) -> Result<(), Error> {
    if let Some(target_box) = request.target_box {
        check_box(target_box, request, crescent, voxels)?;
    }
    let meniscal_from_ct = crescent.ct_from_meniscal.inverse();
    if let Aim::Ends { start, goal } = request.aim {
        let limit_mm = request.contour_rules.tolerance_mm;
        for (field, point) in [("options.start", start), ("options.goal", goal)] {
            let on_tissue = voxels.distance_mm(&(meniscal_from_ct * point), limit_mm);
            if on_tissue.is_none() {
                return Err(Error::invalid(
                    field,
                    format!("is further than options.tolerance_mm, {limit_mm} mm, from tissue"),
                ));
            }
        }
    }
    for portal in &request.portals {
        let portal = meniscal_from_ct * *portal;
        if let Some(distance_mm) = voxels.distance_mm(&portal, PORTAL_CLEARANCE_MM) {
            return Err(Error::invalid(
                "options.portal",
                format!(
                    "is {distance_mm:.1} mm from tissue; must be more than {PORTAL_CLEARANCE_MM} mm"
                ),
            ));
        }
    }
    Ok(())
}

fn check_box(
    (low, high): (Point3, Point3),
    request: &Request,
    crescent: &Crescent,
    voxels: &Voxels,
) -> Result<(), Error> {
    let in_box = |point: &Point3| point.inf(&low) == low && point.sup(&high) == high;
    let mut tissue = voxels.centers().iter();
    if !tissue.any(|center| in_box(&(crescent.ct_from_meniscal * *center))) {
        return Err(Error::invalid(
            "options.target_box",
            "holds no tissue of the model",
        ));
    }
    if let Aim::Ends { start, goal } = request.aim {
        for (field, point) in [("options.start", start), ("options.goal", goal)] {
            if !in_box(&point) {
                return Err(Error::invalid(field, "lies outside options.target_box"));
            }
        }
    }
    Ok(())
}
