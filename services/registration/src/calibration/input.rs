//! What a calibration needs of its input, checked before any work: every violation is named, with value and limit.

use arthro_geometry::frame::Frame;
use arthro_geometry::nalgebra::{Isometry3, Matrix6, Quaternion};
use arthro_geometry::{Rigid, Rotation};

use super::gate::MAX_POSES;
use super::noise::{PoseCovariance, PoseNoise};
use crate::error::{Error, Violation};

/// Farthest that anything may be mounted or measured, mm.
const MAX_COORDINATE_MM: f64 = 100_000.0;
/// Stated noise, rad and mm: below, it is rounding; above, no measurement.
const ROTATION_NOISE_RAD: std::ops::RangeInclusive<f64> = 1e-9..=0.5;
const TRANSLATION_NOISE_MM: std::ops::RangeInclusive<f64> = 1e-6..=100.0;
/// Limits that may be asked for.
const LIMITS: std::ops::RangeInclusive<f64> = 1e-6..=1000.0;

/// A quaternion may be off unit length by this much.
const UNIT_TOLERANCE: f64 = 1e-3;

/// A pose from the numbers of a file or message: unit quaternion w, x, y, z and translation in mm.
///
/// # Errors
/// When the quaternion is not of unit length; `field` names the pose.
pub fn pose<A: Frame, B: Frame>(
    field: &str,
    rotation_wxyz: [f64; 4],
    translation_mm: [f64; 3],
) -> Result<Rigid<A, B>, Violation> {
    let [w, x, y, z] = rotation_wxyz;
    let quaternion = Quaternion::new(w, x, y, z);
    let norm = quaternion.norm();
    // A NaN is in no range.
    if !(..=UNIT_TOLERANCE).contains(&(norm - 1.0).abs()) {
        return Err(Violation::new(
            format!("{field}.rotation"),
            format!("has norm {norm}, must be 1 within {UNIT_TOLERANCE}"),
        ));
    }
    Ok(Rigid::new(
        Rotation::from_quaternion(quaternion),
        translation_mm.into(),
    ))
}

/// The violations found so far.
#[derive(Debug, Default)]
pub(super) struct Checked(Vec<Violation>);

impl Checked {
    /// Not more poses than are worked with.
    pub fn count(&mut self, field: &str, count: usize) {
        if count > MAX_POSES {
            self.wrong(
                field,
                format!("has {count} poses, must have at most {MAX_POSES}"),
            );
        }
    }

    /// A pose within reach.
    pub fn pose(&mut self, field: impl FnOnce() -> String, pose: &Isometry3<f64>) {
        let translation = pose.translation.vector;
        let turn = pose.rotation.coords;
        let finite = turn.iter().all(|part| part.is_finite());
        if !finite
            || !translation
                .iter()
                .all(|part| part.abs() <= MAX_COORDINATE_MM)
        {
            let [x, y, z] = translation.into();
            self.wrong(
                field(),
                format!("is at ({x}, {y}, {z}), must be finite and within {MAX_COORDINATE_MM} mm"),
            );
        }
    }

    /// A point within reach.
    pub fn point(&mut self, field: &str, point: &arthro_geometry::Point3) {
        if !point.iter().all(|part| part.abs() <= MAX_COORDINATE_MM) {
            self.wrong(
                field,
                format!("is {point}, must be finite and within {MAX_COORDINATE_MM} mm"),
            );
        }
    }

    /// Noise as a measurement has it.
    pub fn noise(&mut self, field: &str, noise: Option<PoseNoise>) {
        let Some(noise) = noise else { return };
        self.within(
            &format!("{field}.rotation_rad"),
            noise.rotation_rad,
            &ROTATION_NOISE_RAD,
        );
        self.within(
            &format!("{field}.translation_mm"),
            noise.translation_mm,
            &TRANSLATION_NOISE_MM,
        );
    }

    /// A covariance that is one.
    pub fn covariance(
        &mut self,
        field: impl FnOnce() -> String,
        covariance: Option<&PoseCovariance>,
    ) {
        let Some(covariance) = covariance else { return };
        let asymmetry = (covariance - covariance.transpose()).amax();
        if asymmetry > 1e-9 * covariance.amax() || !is_positive(covariance) {
            self.wrong(
                field(),
                "must be symmetric and positive definite".to_owned(),
            );
        }
    }

    /// A limit that can be kept and missed.
    pub fn limit(&mut self, field: &str, value: f64) {
        self.within(field, value, &LIMITS);
    }

    /// A number within its range.
    pub fn within(&mut self, field: &str, value: f64, range: &std::ops::RangeInclusive<f64>) {
        if !range.contains(&value) {
            self.wrong(
                field,
                format!("is {value}, must be {} to {}", range.start(), range.end()),
            );
        }
    }

    /// Notes a violation.
    pub fn wrong(&mut self, field: impl Into<String>, description: String) {
        self.0.push(Violation::new(field, description));
    }

    /// Whether nothing was wrong.
    pub fn passed(self) -> Result<(), Error> {
        if self.0.is_empty() {
            Ok(())
        } else {
            Err(Error::Invalid(self.0))
        }
    }
}

/// Brought to ones on the diagonal first: rad2 and mm2 differ by decades.
fn is_positive(covariance: &PoseCovariance) -> bool {
    let scale = covariance
        .diagonal()
        .map(|variance| variance.sqrt().recip());
    let scaled =
        Matrix6::from_fn(|row, column| covariance[(row, column)] * scale[row] * scale[column]);
    scaled.iter().all(|entry| entry.is_finite()) && scaled.cholesky().is_some()
}
