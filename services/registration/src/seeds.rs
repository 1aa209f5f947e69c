//! Poses to begin from where no congruent set is found: rotations spread over all of SO(3), centroids on each other.

use std::f64::consts::{SQRT_2, TAU};

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::nalgebra::Quaternion;
use arthro_geometry::{Point3, Rotation, Similarity, Vector3};

use crate::scaled_icp::ScaleRange;

/// Second irrational number of the super-Fibonacci spiral (Alexa, CVPR 2022): the real root of x^4 = x + 4.
const PSI: f64 = 1.533_751_168_755_204_3;

/// `count` rotations spread evenly over SO(3), a super-Fibonacci spiral.
pub fn rotations(count: usize) -> impl Iterator<Item = Rotation> {
    (0..count).map(move |index| {
        let step = index as f64 + 0.5;
        let share = step / count as f64;
        let (alpha, beta) = (TAU * step / SQRT_2, TAU * step / PSI);
        Rotation::from_quaternion(Quaternion::new(
            share.sqrt() * alpha.sin(),
            share.sqrt() * alpha.cos(),
            (1.0 - share).sqrt() * beta.sin(),
            (1.0 - share).sqrt() * beta.cos(),
        ))
    })
}

/// Scales to begin from: the whole range in steps that the fine stage bridges.
pub fn scales(range: ScaleRange) -> Vec<f64> {
    let steps = ((range.high / range.low).ln() / MAX_STEP).ceil().max(1.0);
    let ratio = (range.high / range.low).powf(1.0 / steps);
    (0..steps as i32)
        .map(|step| range.low * ratio.powf(f64::from(step) + 0.5))
        .collect()
}

/// Widest step between scales to begin from, as a logarithm.
const MAX_STEP: f64 = 0.08;

/// Each rotation with each scale, the centroid of `view` on that of `model`.
pub fn poses(
    model: &[Point3],
    view: &[Point3],
    range: ScaleRange,
    rotation_count: usize,
) -> Vec<Similarity<Ct, Camera>> {
    let (model, view) = (centroid(model), centroid(view));
    let mut poses = Vec::new();
    for scale in scales(range) {
        poses.extend(rotations(rotation_count).map(|rotation| {
            Similarity::new(1.0 / scale, rotation, model - rotation * view / scale)
        }));
    }
    poses
}

fn centroid(points: &[Point3]) -> Vector3 {
    points.iter().map(|p| p.coords).sum::<Vector3>() / points.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_rotation_has_a_seed_nearby() {
        let seeds: Vec<Rotation> = rotations(120).collect();
        for probe in rotations(1111) {
            let nearest = seeds
                .iter()
                .map(|seed| seed.angle_to(&probe))
                .fold(f64::INFINITY, f64::min);
            assert!(nearest.to_degrees() < 50.0, "{}", nearest.to_degrees());
        }
    }

    #[test]
    fn a_narrow_range_has_one_scale_and_a_wide_one_many() {
        let middle = scales(ScaleRange {
            low: 0.98,
            high: 1.02,
        });
        assert!(matches!(middle[..], [one] if (one - 1.0).abs() < 1e-3));
        assert!(
            scales(ScaleRange {
                low: 0.5,
                high: 1.5
            })
            .len()
                >= 13
        );
    }
}
