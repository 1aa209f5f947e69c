//! Rigid and similarity transforms whose types name both frames.

use std::marker::PhantomData;
use std::ops::Mul;

use nalgebra::{Isometry3, Translation3};

use crate::frame::Frame;
use crate::{Point3, Rotation, Vector3};

/// The rigid transform `a_from_b`: maps coordinates in `B` to coordinates in `A`, in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rigid<A: Frame, B: Frame> {
    isometry: Isometry3<f64>,
    frames: PhantomData<(A, B)>,
}

impl<A: Frame, B: Frame> Rigid<A, B> {
    /// From a rotation and a translation in mm: `y = R x + t`.
    pub fn new(rotation: Rotation, translation_mm: Vector3) -> Self {
        Self::from_isometry(Isometry3::from_parts(
            Translation3::from(translation_mm),
            rotation,
        ))
    }

    /// States the frames of a bare isometry (translation in mm).
    ///
    /// The rotation is made unit: what comes from a matrix or a long chain is off by some 1e-9, which
    /// an inverse kinematics that verifies its answer takes for a pose out of reach.
    pub fn from_isometry(isometry: Isometry3<f64>) -> Self {
        let rotation = Rotation::new_normalize(isometry.rotation.into_inner());
        Self {
            isometry: Isometry3::from_parts(isometry.translation, rotation),
            frames: PhantomData,
        }
    }

    /// The transform that changes nothing.
    pub fn identity() -> Self {
        Self::from_isometry(Isometry3::identity())
    }

    /// The bare isometry, translation in mm.
    pub fn isometry(&self) -> &Isometry3<f64> {
        &self.isometry
    }

    /// The rotation part.
    pub fn rotation(&self) -> Rotation {
        self.isometry.rotation
    }

    /// The translation part in mm: the origin of `B` in coordinates of `A`.
    pub fn translation_mm(&self) -> Vector3 {
        self.isometry.translation.vector
    }

    /// The origin of `B` as a point in `A`, mm.
    pub fn origin(&self) -> Point3 {
        Point3::from(self.isometry.translation.vector)
    }

    /// `b_from_a`.
    pub fn inverse(&self) -> Rigid<B, A> {
        Rigid::from_isometry(self.isometry.inverse())
    }

    /// Rotates a direction of `B` into `A`.
    pub fn direction(&self, direction_in_b: &Vector3) -> Vector3 {
        self.isometry.rotation * direction_in_b
    }
}

impl<A: Frame, B: Frame, C: Frame> Mul<Rigid<B, C>> for Rigid<A, B> {
    type Output = Rigid<A, C>;
    fn mul(self, right: Rigid<B, C>) -> Rigid<A, C> {
        Rigid::from_isometry(self.isometry * right.isometry)
    }
}

impl<A: Frame, B: Frame> Mul<Point3> for Rigid<A, B> {
    type Output = Point3;
    fn mul(self, point_in_b: Point3) -> Point3 {
        self.isometry * point_in_b
    }
}

/// The similarity `a_from_b`: `y = s R x + t`, in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity<A: Frame, B: Frame> {
    /// Scale `s`, greater than zero.
    pub scale: f64,
    /// Rotation `R`.
    pub rotation: Rotation,
    /// Translation `t`, mm.
    pub translation_mm: Vector3,
    frames: PhantomData<(A, B)>,
}

impl<A: Frame, B: Frame> Similarity<A, B> {
    /// `y = s R x + t`.
    pub fn new(scale: f64, rotation: Rotation, translation_mm: Vector3) -> Self {
        Self {
            scale,
            rotation,
            translation_mm,
            frames: PhantomData,
        }
    }

    /// The similarity that changes nothing.
    pub fn identity() -> Self {
        Self::new(1.0, Rotation::identity(), Vector3::zeros())
    }

    /// `b_from_a`.
    pub fn inverse(&self) -> Similarity<B, A> {
        let rotation = self.rotation.inverse();
        let scale = 1.0 / self.scale;
        Similarity::new(scale, rotation, -(rotation * self.translation_mm) * scale)
    }

    /// Rotates a direction of `B` into `A`; its length is kept.
    pub fn direction(&self, direction_in_b: &Vector3) -> Vector3 {
        self.rotation * direction_in_b
    }
}

impl<A: Frame, B: Frame> From<Rigid<A, B>> for Similarity<A, B> {
    fn from(rigid: Rigid<A, B>) -> Self {
        Self::new(1.0, rigid.rotation(), rigid.translation_mm())
    }
}

impl<A: Frame, B: Frame, C: Frame> Mul<Similarity<B, C>> for Similarity<A, B> {
    type Output = Similarity<A, C>;
    fn mul(self, right: Similarity<B, C>) -> Similarity<A, C> {
        Similarity::new(
            self.scale * right.scale,
            self.rotation * right.rotation,
            self.rotation * right.translation_mm * self.scale + self.translation_mm,
        )
    }
}

impl<A: Frame, B: Frame> Mul<Point3> for Similarity<A, B> {
    type Output = Point3;
    fn mul(self, point_in_b: Point3) -> Point3 {
        Point3::from(self.rotation * point_in_b.coords * self.scale + self.translation_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{Base, Camera, Ct};
    use proptest::prelude::*;

    fn rotation() -> impl Strategy<Value = Rotation> {
        (-3.0..3.0f64, -3.0..3.0f64, -3.0..3.0f64)
            .prop_map(|(x, y, z)| Rotation::from_scaled_axis(Vector3::new(x, y, z)))
    }

    fn vector() -> impl Strategy<Value = Vector3> {
        (-500.0..500.0f64, -500.0..500.0f64, -500.0..500.0f64)
            .prop_map(|(x, y, z)| Vector3::new(x, y, z))
    }

    proptest! {
        #[test]
        fn a_similarity_and_its_inverse_cancel(
            s in 0.2..4.0f64, r in rotation(), t in vector(), p in vector()
        ) {
            let camera_from_ct = Similarity::<Camera, Ct>::new(s, r, t);
            let point = Point3::from(p);
            prop_assert!((camera_from_ct.inverse() * (camera_from_ct * point) - point).norm() < 1e-9);
        }

        #[test]
        fn a_chain_maps_like_its_links_one_by_one(
            s in 0.2..4.0f64, r1 in rotation(), t1 in vector(), r2 in rotation(), t2 in vector(), p in vector()
        ) {
            let base_from_camera = Rigid::<Base, Camera>::new(r1, t1);
            let camera_from_ct = Similarity::<Camera, Ct>::new(s, r2, t2);
            let base_from_ct = Similarity::from(base_from_camera) * camera_from_ct;
            let point = Point3::from(p);
            prop_assert!((base_from_ct * point - base_from_camera * (camera_from_ct * point)).norm() < 1e-9);
        }
    }
}
