//! How sure a pose is: the covariance of its seven parameters, and the target registration error that it predicts.
//!
//! Neighbouring points err alike (stairs of voxels, patches of the sensor), so they are counted in clusters: the
//! sandwich estimator with clustered residuals (Liang and Zeger 1986).

use std::collections::BTreeMap;

use arthro_geometry::{Point3, Vector3};
use nalgebra::{SMatrix, SVector};

use crate::contact::{contacts, weights};
use crate::problem::{Pose, Problem};
use crate::robust::refine::{equations, jacobian};

/// Edge of a cluster, units: about what a voxel's stair reaches along the surface.
const CLUSTER_UNITS: f64 = 3.0;

/// Errors are larger than clusters of residuals show: a model that is off everywhere alike shows in no residual. Over
/// rendered views of four menisci the true errors were this many times those that clusters alone predict.
const UNSEEN: f64 = 1.9;

/// Covariance of turn (rad, about the model's centre), shift (mm) and logarithm of scale.
pub type Covariance = SMatrix<f64, 7, 7>;

/// The covariance of `pose`; `None` if the view does not determine it.
pub fn of(problem: &Problem, pose: &Pose) -> Option<Covariance> {
    let contacts = contacts(&problem.model, &problem.view.dense, pose);
    let weights = weights(&problem.model, &contacts, 0.0);
    let mut information = equations(&contacts, &weights, pose).information;
    let edge_mm = CLUSTER_UNITS * problem.model.unit_mm;
    let mut clusters: BTreeMap<[i32; 3], SVector<f64, 7>> = BTreeMap::new();
    for (contact, weight) in contacts
        .iter()
        .zip(&weights)
        .filter(|(_, weight)| **weight > 0.0)
    {
        let cell: [i32; 3] = contact
            .carried
            .coords
            .map(|c| (c / edge_mm).floor() as i32)
            .into();
        let row = jacobian(contact, &(contact.carried.coords - pose.translation_mm));
        *clusters.entry(cell).or_insert_with(SVector::zeros) +=
            row * (weight * contact.foot.height_mm);
    }
    let mut spread = SMatrix::<f64, 7, 7>::zeros();
    for gradient in clusters.values() {
        spread.ger(1.0, gradient, gradient, 1.0);
    }
    // Few clusters fit themselves: the usual correction for the seven parameters.
    let count = clusters.len() as f64;
    spread *= count / (count - 7.0).max(1.0);
    // The allowed range says something of the scale, too: it is as likely anywhere in it.
    let width = problem.allowed.log_width();
    if width > 0.0 {
        let known = 12.0 / (width * width);
        information[(6, 6)] += known;
        spread[(6, 6)] += known;
    } else {
        information[(6, 6)] += 1e12;
    }
    let inverse = information.cholesky()?.inverse();
    Some(inverse * spread * inverse * (UNSEEN * UNSEEN))
}

/// Root mean square error that `covariance` predicts over `targets`, points about the model's centre, mm of the model.
pub fn predicted_tre_mm(covariance: &Covariance, pose: &Pose, targets: &[Point3]) -> f64 {
    let squares: f64 = targets
        .iter()
        .map(|target| {
            let p = target.coords;
            let arm: Vector3 = p - pose.translation_mm;
            let moved = SMatrix::<f64, 3, 7>::from_columns(&[
                Vector3::x().cross(&p),
                Vector3::y().cross(&p),
                Vector3::z().cross(&p),
                Vector3::x(),
                Vector3::y(),
                Vector3::z(),
                arm,
            ]);
            (moved * covariance * moved.transpose()).trace()
        })
        .sum();
    (squares / targets.len().max(1) as f64).max(0.0).sqrt()
}
