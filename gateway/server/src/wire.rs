//! Between the contract's messages and the domain's types.
//!
//! Reading checks: a number is finite, a direction and a quaternion are unit, and what is not is a
//! [`Violation`] that names the field.

mod accuracy;

use arthro_geometry::frame::{Camera, Ct, Frame};
use arthro_geometry::{Point3, Rigid, Rotation, Similarity, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::planning::v1 as planning;
use arthro_proto::registration::v1 as registration;
use bytes::Bytes;
use nalgebra::Quaternion;
use prost::Message as _;

pub use accuracy::{
    errors_message, hand_eye, tool_tip, touch, touch_message, uncertainty, verification_message,
};

use crate::cases::case::{Bite, Plan, Registration, Verdict, View};
use crate::config::Jaw;
use crate::error::Violation;

/// The cell's one portal for the forceps, as plans number portals.
const FORCEPS_PORTAL: u32 = 0;
/// A direction's length and a quaternion's norm may differ from 1 by this much.
const UNIT_TOLERANCE: f64 = 1e-3;

// === reading ===

/// A point that must be there and finite.
pub fn point(message: Option<common::Point>, field: &str) -> Result<Point3, Violation> {
    let common::Point { x_mm, y_mm, z_mm } = message.ok_or_else(|| missing(field))?;
    if [x_mm, y_mm, z_mm].iter().all(|value| value.is_finite()) {
        return Ok(Point3::new(x_mm, y_mm, z_mm));
    }
    Err(Violation::new(
        field,
        format!("is ({x_mm}, {y_mm}, {z_mm}); must be finite"),
    ))
}

/// A direction that must be there and unit; normalised.
pub fn direction(message: Option<common::Direction>, field: &str) -> Result<Vector3, Violation> {
    let common::Direction { x, y, z } = message.ok_or_else(|| missing(field))?;
    let vector = Vector3::new(x, y, z);
    let length = vector.norm();
    if is_one(length) {
        return Ok(vector / length);
    }
    Err(Violation::new(
        field,
        format!("has the length {length}; must be 1 within {UNIT_TOLERANCE}"),
    ))
}

/// A quaternion that must be there and unit; normalised.
pub fn rotation(message: Option<common::Quaternion>, field: &str) -> Result<Rotation, Violation> {
    let common::Quaternion { w, x, y, z } = message.ok_or_else(|| missing(field))?;
    let quaternion = Quaternion::new(w, x, y, z);
    let norm = quaternion.norm();
    if is_one(norm) {
        return Ok(Rotation::from_quaternion(quaternion));
    }
    Err(Violation::new(
        field,
        format!("has the norm {norm}; must be 1 within {UNIT_TOLERANCE}"),
    ))
}

/// A rigid transform that must be there.
pub fn pose<A: Frame, B: Frame>(
    message: Option<common::Pose>,
    field: &str,
) -> Result<Rigid<A, B>, Violation> {
    let pose = message.ok_or_else(|| missing(field))?;
    Ok(Rigid::new(
        rotation(pose.rotation, &format!("{field}.rotation"))?,
        point(pose.translation, &format!("{field}.translation"))?.coords,
    ))
}

/// The part of a registration's result that the gateway reads. The residuals are left out of `encoded`.
pub fn registration(
    mut result: registration::RegistrationResult,
) -> Result<Registration, Violation> {
    let similarity = result
        .camera_from_ct
        .ok_or_else(|| missing("camera_from_ct"))?;
    if !(similarity.scale > 0.0 && similarity.scale.is_finite()) {
        return Err(Violation::new(
            "camera_from_ct.scale",
            format!("is {}; must be greater than 0", similarity.scale),
        ));
    }
    let verdict = match result.verdict() {
        registration::Verdict::Accept => Verdict::Accept,
        registration::Verdict::Review => Verdict::Review,
        registration::Verdict::Reject => Verdict::Reject,
        registration::Verdict::Unspecified => return Err(missing("verdict")),
    };
    result.residuals_mm = Bytes::new();
    Ok(Registration {
        camera_from_ct: Similarity::<Camera, Ct>::new(
            similarity.scale,
            rotation(similarity.rotation, "camera_from_ct.rotation")?,
            point(similarity.translation, "camera_from_ct.translation")?.coords,
        ),
        verdict,
        reasons: result.reasons.clone(),
        encoded: result.encode_to_vec().into(),
    })
}

/// A plan with at least one bite.
pub fn plan(message: &planning::ResectionPlan, jaw: Jaw) -> Result<Plan, Violation> {
    if message.bites.is_empty() {
        return Err(Violation::new("bites", "is empty; must hold at least 1"));
    }
    Ok(Plan {
        bites: bites(&message.bites)?,
        contour: message
            .contour
            .iter()
            .enumerate()
            .map(|(index, sample)| point(Some(*sample), &format!("contour[{index}]")))
            .collect::<Result<_, _>>()?,
        views: views(message)?,
        jaw,
        encoded: message.encode_to_vec().into(),
    })
}

/// One view for each bite, or none.
fn views(message: &planning::ResectionPlan) -> Result<Vec<View>, Violation> {
    let (views, bites) = (message.views.len(), message.bites.len());
    if views != 0 && views != bites {
        let problem = format!("holds {views}; must hold none or one for each of {bites} bites");
        return Err(Violation::new("views", problem));
    }
    let checked = message.views.iter().enumerate();
    checked
        .map(|(index, view)| {
            let field = |name: &str| format!("views[{index}].{name}");
            if !view.roll_rad.is_finite() {
                let problem = format!("is {}; must be finite", view.roll_rad);
                return Err(Violation::new(field("roll_rad"), problem));
            }
            Ok(View {
                tip: point(view.tip, &field("tip"))?,
                approach: direction(view.approach, &field("approach"))?,
                roll_rad: view.roll_rad,
            })
        })
        .collect()
}

/// Bites in order, all through the one portal of the forceps.
pub fn bites(messages: &[planning::Bite]) -> Result<Vec<Bite>, Violation> {
    messages
        .iter()
        .enumerate()
        .map(|(index, bite)| {
            let field = |name: &str| format!("bites[{index}].{name}");
            let approach = direction(bite.approach, &field("approach"))?;
            let opening = direction(bite.opening, &field("opening"))?;
            if bite.portal != FORCEPS_PORTAL {
                return Err(Violation::new(
                    field("portal"),
                    format!(
                        "is {}; the cell has one forceps portal, {FORCEPS_PORTAL}",
                        bite.portal
                    ),
                ));
            }
            let along = approach.dot(&opening);
            if along.abs() > 0.01 {
                return Err(Violation::new(
                    field("opening"),
                    format!("has the component {along} along approach; must be 0 within 0.01"),
                ));
            }
            Ok(Bite {
                center: point(bite.center, &field("center"))?,
                approach,
                opening,
                contour_point: point(bite.contour_point, &field("contour_point"))?,
            })
        })
        .collect()
}

/// The jaw of a request within the limits of the configuration.
pub fn jaw(message: planning::Jaw, field: &str) -> Result<Jaw, Violation> {
    let throat_mm = message.throat_mm.unwrap_or(Jaw::default().throat_mm);
    for (name, value, lowest, highest) in [
        ("width_mm", message.width_mm, 0.5, 10.0),
        ("length_mm", message.length_mm, 0.5, 20.0),
        ("throat_mm", throat_mm, 0.1, 10.0),
    ] {
        if !(lowest..=highest).contains(&value) {
            return Err(Violation::new(
                format!("{field}.{name}"),
                format!("is {value} mm; must be within {lowest} .. {highest} mm"),
            ));
        }
    }
    Ok(Jaw {
        width_mm: message.width_mm,
        length_mm: message.length_mm,
        throat_mm,
    })
}

// === writing ===

/// A point.
pub fn point_message(point: &Point3) -> common::Point {
    common::Point {
        x_mm: point.x,
        y_mm: point.y,
        z_mm: point.z,
    }
}

/// A rotation and the place of the tip.
pub fn pose_message(rotation: &Rotation, tip: &Point3) -> common::Pose {
    common::Pose {
        rotation: Some(common::Quaternion {
            w: rotation.w,
            x: rotation.i,
            y: rotation.j,
            z: rotation.k,
        }),
        translation: Some(point_message(tip)),
    }
}

/// A direction.
pub fn direction_message(vector: &Vector3) -> common::Direction {
    common::Direction {
        x: vector.x,
        y: vector.y,
        z: vector.z,
    }
}

/// A bite.
pub fn bite_message(bite: &Bite) -> planning::Bite {
    planning::Bite {
        center: Some(point_message(&bite.center)),
        approach: Some(direction_message(&bite.approach)),
        opening: Some(direction_message(&bite.opening)),
        contour_point: Some(point_message(&bite.contour_point)),
        portal: FORCEPS_PORTAL,
    }
}

/// A jaw.
pub fn jaw_message(jaw: &Jaw) -> planning::Jaw {
    planning::Jaw {
        width_mm: jaw.width_mm,
        length_mm: jaw.length_mm,
        throat_mm: Some(jaw.throat_mm),
    }
}

fn is_one(norm: f64) -> bool {
    (norm - 1.0).abs() <= UNIT_TOLERANCE
}

fn missing(field: &str) -> Violation {
    Violation::new(field, "is missing")
}

/// Announces a cloud.
pub fn cloud_header(
    frame: common::Frame,
    point_count: u32,
    has_normals: bool,
) -> common::CloudHeader {
    common::CloudHeader {
        frame: frame.into(),
        point_count,
        has_normals,
    }
}
