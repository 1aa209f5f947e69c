//! The quadric that best fits a sample's neighbourhood: moving least squares (Levin 1998; Alexa et al. 2003).

use arthro_geometry::{Point3, Vector3};
use nalgebra::{Matrix3, SMatrix, SVector};
use rayon::prelude::*;

use crate::cells::Cells;

/// Neighbours whose normals differ by more than the angle of this cosine lie on another face.
const SAME_FACE: f64 = 0.35;
/// Fewer neighbours than this do not hold a quadric.
const LEAST_NEIGHBOURS: usize = 9;
/// A quadric bends no more than over this share of the neighbourhood's radius.
const LEAST_BEND_RADIUS: f64 = 0.4;

/// A neighbour at the border of the neighbourhood weighs exp of minus this.
const SHARPNESS: f64 = 4.0;

/// A point of the fitted surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quadric {
    pub(super) point: Point3,
    pub(super) normal: Vector3,
    pub(super) bend: Matrix3<f64>,
    /// Distance of the sample from the fitted surface, mm.
    pub(super) offset_mm: f64,
}

/// One quadric a sample, fitted over `radius_mm`.
pub(super) fn fit_all(
    points: &[Point3],
    normals: &[Vector3],
    cells: &Cells,
    radius_mm: f64,
    is_outward: &[bool],
) -> Vec<Quadric> {
    (0..points.len())
        .into_par_iter()
        .with_min_len(64)
        .map(|index| {
            let plain = Quadric {
                point: points[index],
                normal: normals[index],
                bend: Matrix3::zeros(),
                offset_mm: 0.0,
            };
            fit(points, normals, cells, radius_mm, is_outward, index).unwrap_or(plain)
        })
        .collect()
}

/// `None` where the neighbours do not determine it.
fn fit(
    points: &[Point3],
    normals: &[Vector3],
    cells: &Cells,
    radius_mm: f64,
    is_outward: &[bool],
    index: usize,
) -> Option<Quadric> {
    let (origin, normal) = (points[index], normals[index]);
    let [u, v] = tangents(&normal);
    let mut matrix = SMatrix::<f64, 6, 6>::zeros();
    let mut right = SVector::<f64, 6>::zeros();
    let mut count = 0;
    cells.within(&origin, radius_mm, |other, distance2| {
        let alike = normal.dot(&normals[other]);
        if (if is_outward[index] && is_outward[other] {
            alike
        } else {
            alike.abs()
        }) < SAME_FACE
        {
            return;
        }
        let offset = (points[other] - origin) / radius_mm;
        let (a, b, height) = (u.dot(&offset), v.dot(&offset), normal.dot(&offset));
        let row = SVector::<f64, 6>::from([1.0, a, b, a * a, a * b, b * b]);
        let weight = (-SHARPNESS * distance2 / (radius_mm * radius_mm)).exp();
        matrix.ger(weight, &row, &row, 1.0);
        right.axpy(weight * height, &row, 1.0);
        count += 1;
    });
    if count < LEAST_NEIGHBOURS {
        return None;
    }
    // Bends are held back a little: where all neighbours lie in a row, nothing else would hold them.
    for (place, hold) in [(1, 1e-6), (2, 1e-6), (3, 1e-3), (4, 1e-3), (5, 1e-3)] {
        matrix[(place, place)] += hold * matrix[(0, 0)];
    }
    let c = matrix.cholesky()?.solve(&right);
    let limit = 0.5 / LEAST_BEND_RADIUS;
    if c[0].abs() > 0.5 || c.iter().skip(3).any(|bend| bend.abs() > limit) {
        return None;
    }
    let bend = (u * u.transpose() * (2.0 * c[3])
        + (u * v.transpose() + v * u.transpose()) * c[4]
        + v * v.transpose() * (2.0 * c[5]))
        / radius_mm;
    Some(Quadric {
        point: origin + normal * (c[0] * radius_mm),
        normal: (normal - u * c[1] - v * c[2]).normalize(),
        bend,
        offset_mm: c[0] * radius_mm,
    })
}

/// Two unit vectors across `normal` and each other.
pub(super) fn tangents(normal: &Vector3) -> [Vector3; 2] {
    let mut aside = Vector3::zeros();
    aside[normal.iamin()] = 1.0;
    let u = normal.cross(&aside).normalize();
    [u, normal.cross(&u)]
}
