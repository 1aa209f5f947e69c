//! Daniilidis, "Hand-Eye Calibration Using Dual Quaternions", 1999: rotation and translation together.

use arthro_geometry::nalgebra::{
    Isometry3, Quaternion, SMatrix, SVector, SymmetricEigen, Translation3, Vector4,
};
use arthro_geometry::{Rotation, Vector3};

use super::MotionPair;

/// Motions that turn less say nothing about rotation, rad.
const LEAST_TURN_RAD: f64 = 1e-9;

/// `X` of `a X = X b`; `None` when the motions do not determine it. An error of translation by `unit_mm` counts as much
/// as one of rotation by a radian: see [`length_unit_mm`].
pub fn solve(pairs: &[MotionPair], unit_mm: f64) -> Option<Isometry3<f64>> {
    let mut information = SMatrix::<f64, 8, 8>::zeros();
    for pair in pairs {
        if pair.a.rotation.angle() < LEAST_TURN_RAD {
            continue;
        }
        let rows = equations(&Screw::of(&pair.a, unit_mm), &Screw::of(&pair.b, unit_mm));
        information += rows.transpose() * rows;
    }
    let eigen = SymmetricEigen::new(information);
    let mut order: [usize; 8] = std::array::from_fn(|index| index);
    order.sort_by(|one, other| eigen.eigenvalues[*one].total_cmp(&eigen.eigenvalues[*other]));
    let null = [order[0], order[1]].map(|index| eigen.eigenvectors.column(index).into_owned());
    let dual = unit_dual_quaternion(&null)?;
    Some(pose(&dual, unit_mm))
}

/// The vector parts of a motion's unit dual quaternion.
struct Screw {
    real: Vector3,
    dual: Vector3,
}

impl Screw {
    fn of(motion: &Isometry3<f64>, unit_mm: f64) -> Self {
        let mut real = motion.rotation.into_inner();
        if real.w < 0.0 {
            real = -real;
        }
        let translation = Quaternion::from_imag(motion.translation.vector / unit_mm);
        let dual = translation * real * 0.5;
        Self {
            real: real.imag(),
            dual: dual.imag(),
        }
    }
}

/// The six equations of one motion (Eq. 31 of the paper).
fn equations(a: &Screw, b: &Screw) -> SMatrix<f64, 6, 8> {
    let mut rows = SMatrix::<f64, 6, 8>::zeros();
    for (row, column, a, b) in [
        (0, 0, &a.real, &b.real),
        (3, 0, &a.dual, &b.dual),
        (3, 4, &a.real, &b.real),
    ] {
        rows.fixed_view_mut::<3, 1>(row, column).copy_from(&(a - b));
        rows.fixed_view_mut::<3, 3>(row, column + 1)
            .copy_from(&(a + b).cross_matrix());
    }
    rows
}

/// The combination of the two null vectors that is a unit dual quaternion (Eq. 34 and 35).
fn unit_dual_quaternion(null: &[SVector<f64, 8>; 2]) -> Option<SVector<f64, 8>> {
    let real = |vector: &SVector<f64, 8>| Vector4::from(vector.fixed_rows::<4>(0));
    let dual = |vector: &SVector<f64, 8>| Vector4::from(vector.fixed_rows::<4>(4));
    let [first, second] = null;
    let a = real(first).dot(&dual(first));
    let b = real(first).dot(&dual(second)) + real(second).dot(&dual(first));
    let c = real(second).dot(&dual(second));
    // The shares are the zeros of a x2 + b x y + c y2, in the form that does not subtract near equals.
    let root = (b * b - 4.0 * a * c).max(0.0).sqrt();
    let stable = -0.5 * (b + root.copysign(b));
    [(stable, a), (c, stable)]
        .into_iter()
        .filter_map(|(x, y)| {
            let length = x.hypot(y);
            (length > 0.0).then(|| (first * x + second * y) / length)
        })
        .map(|combined| (real(&combined).norm(), combined))
        // One zero is the pure translation, which has no real part.
        .max_by(|one, other| one.0.total_cmp(&other.0))
        .filter(|(norm, _)| *norm > 1e-6)
        .map(|(norm, combined)| combined / norm)
}

fn pose(dual: &SVector<f64, 8>, unit_mm: f64) -> Isometry3<f64> {
    let real = Quaternion::new(dual[0], dual[1], dual[2], dual[3]);
    let moment = Quaternion::new(dual[4], dual[5], dual[6], dual[7]);
    let translation = (moment * real.conjugate()).imag() * 2.0 * unit_mm;
    Isometry3::from_parts(
        Translation3::from(translation),
        Rotation::from_quaternion(real),
    )
}

/// Root mean square of the translations: brings both halves of the equations to one size.
pub fn length_unit_mm(pairs: &[MotionPair]) -> f64 {
    let sum: f64 = pairs
        .iter()
        .map(|pair| {
            pair.a.translation.vector.norm_squared() + pair.b.translation.vector.norm_squared()
        })
        .sum();
    (sum / (2 * pairs.len()).max(1) as f64).sqrt().max(1.0)
}
