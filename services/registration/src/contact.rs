//! Where the view's points meet the model in a pose, and how much each of them says.

use arthro_geometry::Point3;
use rayon::prelude::*;

use crate::model::{Foot, Model};
use crate::problem::Pose;
use crate::sampling::median;
use crate::view::Seen;

/// Residuals beyond this many standard deviations weigh nothing (Tukey's constant).
const TUKEY: f64 = 4.685;
/// A model point off by this, units, is usual: stairs of voxels that the fitted quadrics left.
pub const MODEL_DEVIATION_UNITS: f64 = 0.15;
/// A surface seen flatter than this cosine tells little of its height.
const GRAZING: f64 = 0.15;

/// A normal this far along the line of sight is that of a side which the camera did not see; less may be an edge's.
pub const AVERTED: f64 = 0.5;

/// A view point on the model.
#[derive(Clone, Copy, Debug)]
pub struct Contact {
    /// The point, carried to the model.
    pub carried: Point3,
    /// Where it stands over the surface.
    pub foot: Foot,
    /// Cosine between line of sight and normal: the share of the noise along the ray that shows in the height.
    pub noise_share: f64,
    /// Whether the camera could have seen that side of the surface.
    pub faces_camera: bool,
}

/// The contacts of all points in a pose.
pub fn contacts(model: &Model, seen: &Seen, pose: &Pose) -> Vec<Contact> {
    let one = |(index, point): (usize, &Point3)| {
        let carried = *pose * *point;
        let foot = model.foot(&carried);
        let along = seen.sight.get(index).map(|sight| pose.rotation * sight);
        let cosine = along.map_or(-1.0, |along| along.dot(&foot.normal));
        Contact {
            carried,
            foot,
            noise_share: cosine.abs().max(GRAZING),
            faces_camera: !model.is_outward[foot.index] || cosine < AVERTED,
        }
    };
    seen.points
        .par_iter()
        .enumerate()
        .with_min_len(256)
        .map(one)
        .collect()
}

/// Robust deviation of the points along their rays, mm of the model.
pub fn deviation_mm(contacts: &[Contact]) -> f64 {
    let facing = contacts.iter().filter(|contact| contact.faces_camera);
    let mut sizes: Vec<f64> = facing
        .map(|contact| contact.foot.distance2.sqrt() / contact.noise_share)
        .collect();
    1.4826 * median(&mut sizes)
}

/// Tukey's weight of each contact over the variance that noise and model give it, 1/mm2 of the model.
/// Deviations are taken as no less than `least_mm`.
pub fn weights(model: &Model, contacts: &[Contact], least_mm: f64) -> Vec<f64> {
    let deviation = deviation_mm(contacts).max(least_mm);
    let usual = MODEL_DEVIATION_UNITS * model.unit_mm;
    let weight = |contact: &Contact| {
        if !contact.faces_camera {
            return 0.0;
        }
        let own = (deviation * contact.noise_share).hypot(usual).max(least_mm);
        let inside = 1.0 - contact.foot.distance2 / (TUKEY * own).powi(2);
        if inside > 0.0 {
            (inside / own).powi(2)
        } else {
            0.0
        }
    };
    contacts.iter().map(weight).collect()
}
