//! A pose of the flange as a rotation matrix and an origin, the form that the kinematics compute in.
//!
//! [`Rigid`] keeps a unit quaternion: making one of a matrix costs more than the forward kinematics, so
//! that what only compares poses or solves for joints stays with the matrix.

use arthro_geometry::frame::{Base, Flange};
use arthro_geometry::nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use arthro_geometry::{Rigid, Vector3};

/// `base_from_flange`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlangePose {
    /// Orthonormal: the flange's axes in base as columns.
    pub rotation: Matrix3<f64>,
    /// The flange's origin in base, mm.
    pub origin_mm: Vector3,
}

impl FlangePose {
    /// How far it is from another: of the origins, mm, and of the orientations as a small turn in base axes
    /// that takes `self` onto `other`, rad. The turn's length is the sine of the angle between them.
    pub fn error_to(&self, other: &Self) -> (Vector3, Vector3) {
        let columns = (0..3).map(|i| {
            let column = self.rotation.column(i);
            column.cross(&other.rotation.column(i))
        });
        (
            other.origin_mm - self.origin_mm,
            columns.fold(Vector3::zeros(), |sum, cross| sum + cross) * 0.5,
        )
    }

    /// Whether their orientations differ by less than a quarter turn, where [`FlangePose::error_to`] tells
    /// how much.
    pub fn faces(&self, other: &Self) -> bool {
        self.rotation.dot(&other.rotation) > 1.0
    }
}

impl From<Rigid<Base, Flange>> for FlangePose {
    fn from(base_from_flange: Rigid<Base, Flange>) -> Self {
        Self {
            rotation: *base_from_flange.rotation().to_rotation_matrix().matrix(),
            origin_mm: base_from_flange.translation_mm(),
        }
    }
}

impl From<FlangePose> for Rigid<Base, Flange> {
    fn from(pose: FlangePose) -> Self {
        let rotation = Rotation3::from_matrix_unchecked(pose.rotation);
        Rigid::new(
            UnitQuaternion::from_rotation_matrix(&rotation),
            pose.origin_mm,
        )
    }
}
