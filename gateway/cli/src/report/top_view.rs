//! The plan of a demo as `arthro plan` draws it, and where the jaw was measured when it closed.

use arthro_geometry::frame::{Camera, Ct, ForcepsBase};
use arthro_geometry::nalgebra::Quaternion;
use arthro_geometry::{Point3, Rotation, Similarity, Vector3};
use arthro_planning::jaw::{Bite, Jaw};
use arthro_proto::common::v1 as common;
use arthro_proto::gateway::v1::GetReportResponse;
use arthro_proto::planning::v1 as planning;
use arthro_simulator::scenario::{LESION_SPACING_MM, Scenario};

use crate::bites_file::LesionPoints;
use crate::demo::Summary;
use crate::drawing;
use crate::plan::picture::Picture;
use crate::plan::site::Site;

const VOXEL_MM: f64 = 0.5;

/// The picture with its caption.
pub fn figure(scenario: &Scenario, summary: &Summary, journal: &GetReportResponse) -> String {
    match svg(scenario, summary, journal) {
        Ok(svg) => format!(
            "<figure>{svg}<figcaption>The plan, and crosses where the jaw was measured when it closed.</figcaption></figure>"
        ),
        Err(problem) => format!("<p>The plan cannot be drawn: {problem}.</p>"),
    }
}

fn svg(
    scenario: &Scenario,
    summary: &Summary,
    journal: &GetReportResponse,
) -> Result<String, String> {
    let camera_from_ct = summary.registration.camera_from_ct.as_ref();
    let camera_from_ct = camera_from_ct.ok_or("there is no registration")?;
    let system = scenario.system_view();
    let base_from_ct: Similarity<ForcepsBase, Ct> =
        Similarity::from(system.forceps_base_from_camera) * similarity(camera_from_ct);
    let ct_from_base = base_from_ct.inverse();
    let portal = ct_from_base * system.portal_in_forceps_base;
    let tips = journal.bites.iter().filter_map(|bite| bite.tip.as_ref());
    let measured: Vec<Point3> = tips.map(|tip| ct_from_base * bare(tip)).collect();
    let bites: Vec<Bite> = summary.plan.bites.iter().filter_map(pose).collect();
    let contour: Vec<Point3> = summary.plan.contour.iter().map(bare).collect();
    let lesion = LesionPoints {
        spacing_mm: LESION_SPACING_MM,
        points: scenario.preoperative.lesion.clone(),
    };
    let site = Site::of(&scenario.preoperative.model, &portal, VOXEL_MM)
        .map_err(|error| error.to_string())?;
    let picture = Picture {
        title: "plan",
        headline: &headline(&summary.plan),
        site: &site,
        jaw: Jaw::new(system.jaw_width_mm, system.jaw_length_mm),
        bites: &bites,
        through: &[],
        contour: &contour,
        lesion: Some(&lesion),
        portals: &[portal],
        measured: &measured,
        rim_min_mm: None,
    };
    Ok(drawing::svg(&picture.draw()))
}

fn headline(plan: &planning::ResectionPlan) -> String {
    let bites = plan.bites.len();
    plan.evaluation.as_ref().map_or_else(
        || format!("{bites} bites"),
        |evaluation| {
            format!(
                "{bites} bites   region {:.1} %   lesion {:.1} %   outside {:.1} mm3   rim min {:.1} mm",
                evaluation.region_covered_percent,
                evaluation.lesion_covered_percent,
                evaluation.outside_removed_mm3,
                evaluation.rim_min_mm
            )
        },
    )
}

/// `None` for a bite without a place or a direction.
fn pose(bite: &planning::Bite) -> Option<Bite> {
    let center = bare(bite.center.as_ref()?);
    let (approach, opening) = (bite.approach.as_ref()?, bite.opening.as_ref()?);
    let direction = |message: &common::Direction| {
        Vector3::new(message.x, message.y, message.z).try_normalize(1e-6)
    };
    Some(Bite {
        center,
        approach: direction(approach)?,
        opening: direction(opening)?,
        contour_point: center,
    })
}

fn similarity(message: &common::Similarity) -> Similarity<Camera, Ct> {
    let rotation = message.rotation.unwrap_or_default();
    Similarity::new(
        message.scale,
        Rotation::from_quaternion(Quaternion::new(
            rotation.w, rotation.x, rotation.y, rotation.z,
        )),
        bare(&message.translation.unwrap_or_default()).coords,
    )
}

fn bare(point: &common::Point) -> Point3 {
    Point3::new(point.x_mm, point.y_mm, point.z_mm)
}
