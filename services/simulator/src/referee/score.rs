//! Compares a claimed registration with the truth.

use arthro_geometry::frame::{Camera, Ct, ForcepsBase};
use arthro_geometry::{Point3, Rigid, Rotation, Similarity, Vector3};

use crate::scenario::Scenario;

/// How far a claimed camera_from_ct is off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// Over all vertices of the model, mm.
    pub tre_rms_mm: f64,
    /// Worst vertex, mm.
    pub tre_max_mm: f64,
    /// Over the lesion, mm.
    pub lesion_tre_rms_mm: f64,
    /// Angle between the claimed and the true rotation.
    pub rotation_error_rad: f64,
    /// Where the middle of the model is taken to be, mm off.
    pub translation_error_mm: f64,
    /// claimed / true - 1.
    pub scale_error: f64,
}

/// What a system believes of the way of its forceps' tip.
#[derive(Clone, Copy, Debug)]
pub struct Believed {
    /// Where ct lies.
    pub base_from_ct: Similarity<ForcepsBase, Ct>,
    /// The tip in the flange.
    pub tip_in_flange: Point3,
    /// How the flange is turned while the tip is there.
    pub base_from_flange: Rotation,
}

impl Scenario {
    /// From a place of the model to where the true tip is when the arm brings the believed tip to the believed place, mm,
    /// axes of the forceps arm's base.
    pub fn miss(&self, place: &Point3, believed: &Believed) -> Vector3 {
        let mounted = &self.truth.mounted;
        let tip_off = mounted.flange_from_tools[0].origin() - believed.tip_in_flange;
        let tip = believed.base_from_ct * *place + believed.base_from_flange * tip_off;
        tip - self.truth.forceps_base_from_ct * *place
    }

    /// Where the model really is in the camera's frame.
    pub(crate) fn camera_from_ct(&self) -> Rigid<Camera, Ct> {
        self.truth.mounted.forceps_base_from_camera.inverse() * self.truth.forceps_base_from_ct
    }

    /// Scores a claim.
    pub fn score(&self, claimed: &Similarity<Camera, Ct>) -> Score {
        let truth = self.camera_from_ct();
        let error_mm = |point: &Point3| (*claimed * *point - truth * *point).norm();
        let vertices = &self.preoperative.model.vertices;
        let middle = vertices.iter().map(|v| v.coords).sum::<Vector3>() / vertices.len() as f64;
        Score {
            tre_rms_mm: rms(vertices.iter().map(error_mm)),
            tre_max_mm: vertices.iter().map(error_mm).fold(0.0, f64::max),
            lesion_tre_rms_mm: rms(self.preoperative.lesion.iter().map(error_mm)),
            rotation_error_rad: claimed.rotation.angle_to(&truth.rotation()),
            translation_error_mm: error_mm(&middle.into()),
            scale_error: claimed.scale - 1.0,
        }
    }
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0_u32, 0.0), |(count, sum), value| {
        (count + 1, sum + value * value)
    });
    if count == 0 {
        return 0.0;
    }
    (sum / f64::from(count)).sqrt()
}
