//! Compares a claimed registration with the truth.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::{Point3, Rigid, Similarity, Vector3};

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

impl Scenario {
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
