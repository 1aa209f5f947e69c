//! What is measured of a pose: residuals, free space, overlap, the margin to its best rival.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::{Cloud, Point3, Similarity};
use rayon::prelude::*;

use super::{Candidate, FINAL_VIEW_POINTS, INLIER_DISTANCE_MM, Problem, Registration};
use crate::mse::{MATCHED_SHARE, mean_squared_error};
use crate::surface::{Matching, Surface};
use crate::verdict::{self, Evidence};

impl Problem {
    /// Distances of `view` to the model's surface, mm of the camera frame.
    pub(super) fn residuals_mm(
        &self,
        view: &[Point3],
        ct_from_camera: &Similarity<Ct, Camera>,
    ) -> Vec<f64> {
        view.par_iter()
            .with_min_len(256)
            .map(|point| {
                let foot = self
                    .model
                    .foot(&(*ct_from_camera * *point), Matching::Exact);
                foot.surface_distance2.sqrt() / ct_from_camera.scale
            })
            .collect()
    }

    /// Of the nearest nine tenths of the view.
    fn trimmed_rms_mm(&self, ct_from_camera: &Similarity<Ct, Camera>) -> f64 {
        let mut residuals = self.residuals_mm(&self.final_view, ct_from_camera);
        residuals.sort_by(f64::total_cmp);
        residuals.truncate((residuals.len() as f64 * MATCHED_SHARE).ceil() as usize);
        root_mean_square(residuals.into_iter())
    }

    pub(super) fn violation_share(&self, ct_from_camera: &Similarity<Ct, Camera>) -> f64 {
        self.visibility.as_ref().map_or(0.0, |visibility| {
            visibility.violation_share(&self.free_space_model, &ct_from_camera.inverse())
        })
    }

    /// Share of the model's samples that have a view point nearby, 0..1.
    fn overlap(&self, camera_from_ct: &Similarity<Camera, Ct>) -> f64 {
        let view = Surface::new(&self.final_view, FINAL_VIEW_POINTS);
        let reach = INLIER_DISTANCE_MM.max(view.spacing_mm);
        let covered = self
            .model
            .points
            .iter()
            .filter(|point| view.has_within(&(*camera_from_ct * **point), reach * reach))
            .count();
        covered as f64 / self.model.points.len() as f64
    }

    /// Score margin of the best candidate to the best one that is clearly another pose.
    fn rival_margin(&self, ranked: &[Candidate]) -> f64 {
        let best = &ranked[0];
        ranked[1..]
            .iter()
            .filter(|other| !self.alike(&best.refined, &other.refined, 10.0, 3.0))
            .map(|rival| (1.0 - best.score / rival.score.max(1e-9)).clamp(0.0, 1.0))
            .fold(1.0, f64::min)
    }

    /// The best of `ranked`, with all that speaks for and against it.
    pub(super) fn answer(&self, target: &Cloud, ranked: &[Candidate]) -> Registration {
        let best = &ranked[0];
        let camera_from_ct = best.refined.inverse();
        let residuals_mm = self.residuals_mm(&target.points, &best.refined);
        let evidence = Evidence {
            scale: camera_from_ct.scale,
            scale_range: self.scale,
            trimmed_rms_mm: self.trimmed_rms_mm(&best.refined),
            inlier_share: inlier_share(&residuals_mm),
            overlap: self.overlap(&camera_from_ct),
            violation_share: self.violation_share(&best.refined),
            rival_margin: self.rival_margin(ranked),
        };
        let (verdict, reasons) = verdict::judge(&evidence);
        Registration {
            camera_from_ct,
            coarse_mse_mm2: mean_squared_error(&self.model, &self.final_view, &best.coarse),
            mse_mm2: mean_squared_error(&self.model, &self.final_view, &best.refined),
            residuals_mm: residuals_mm.into_iter().map(|r| r as f32).collect(),
            evidence,
            verdict,
            reasons,
        }
    }
}

pub(super) fn root_mean_square(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    (values.map(|value| value * value).sum::<f64>() / count).sqrt()
}

/// Share of residuals within [`INLIER_DISTANCE_MM`], 0..1.
pub(super) fn inlier_share(residuals_mm: &[f64]) -> f64 {
    let inliers = residuals_mm.iter().filter(|r| **r < INLIER_DISTANCE_MM);
    inliers.count() as f64 / residuals_mm.len().max(1) as f64
}
