//! What a list of bites does to a meniscus, in words for people and for programs.

use arthro_geometry::{Mesh, Point3};
use arthro_planning::evaluation::{Evaluation, Task};
use arthro_planning::jaw::{Bite, Jaw};
use arthro_planning::lesion::Lesion;
use arthro_planning::plan::{self, EvaluationRequest};
use serde_json::{Value, json};

use super::site::{HINGE_SHARE_MAX, Site};
use crate::bites_file::BitesFile;
use crate::exit::Failure;

/// Where superior lies if nothing says it: any side is as good, a jaw cuts the full thickness.
const ABOVE_MM: f64 = 1000.0;

/// A scored list of bites.
#[derive(Debug)]
pub struct Score {
    /// The meniscus.
    pub site: Site,
    /// The bites in ct, in their order.
    pub bites: Vec<Bite>,
    /// The jaw they were scored with.
    pub jaw: Jaw,
    /// What they do.
    pub evaluation: Evaluation,
    /// Share of each bite's hinge that holds tissue when the bite is made.
    pub hinge_shares: Vec<f64>,
    aim: Aim,
}

/// What was aimed at.
#[derive(Clone, Copy, Debug)]
struct Aim {
    contour: bool,
    lesion: bool,
}

impl Score {
    /// Scores a list of bites on a model; what the list does not say it aimed at is not scored.
    pub fn of(model: &Mesh, list: &BitesFile, voxel_mm: f64) -> Result<Self, Failure> {
        let jaw = list.jaw.ok_or_else(|| {
            Failure::refused(
                "JAW_UNKNOWN",
                "neither the list nor --jaw says the size of the jaw",
            )
        })?;
        let site = Site::of(model, &above(model, list), voxel_mm)?;
        let superior = site.superior();
        let poses = list.bites.iter().enumerate();
        let bites: Vec<Bite> = poses
            .map(|(index, bite)| bite.pose(&superior).ok_or_else(|| upright(index)))
            .collect::<Result<_, _>>()?;
        let aim = Aim {
            contour: !list.contour.is_empty(),
            lesion: list
                .lesion
                .as_ref()
                .is_some_and(|lesion| !lesion.points.is_empty()),
        };
        let meniscal_from_ct = site.crescent.ct_from_meniscal.inverse();
        let local: Vec<Bite> = bites
            .iter()
            .map(|bite| bite.carried(&meniscal_from_ct))
            .collect();
        let evaluation = if aim.contour || aim.lesion {
            let lesion = list.lesion.clone().unwrap_or_default();
            plan::evaluate(&EvaluationRequest {
                model: model.clone(),
                lesion: lesion.points,
                lesion_spacing_mm: lesion.spacing_mm,
                contour: list.contour.clone(),
                bites: bites.clone(),
                jaw,
                voxel_mm,
            })?
        } else {
            aimless(&site, jaw, &local)
        };
        Ok(Self {
            hinge_shares: site.hinge_shares(&local, &jaw),
            site,
            bites,
            jaw,
            evaluation,
            aim,
        })
    }

    /// Tissue removed, mm3.
    pub fn removed_mm3(&self) -> f64 {
        let evaluation = &self.evaluation;
        evaluation.outside_removed_mm3
            + 0.01 * evaluation.region_covered_percent * evaluation.region_mm3
    }

    /// Bites, counted from 1, whose hinge would have to lie in tissue.
    pub fn blocked(&self) -> Vec<usize> {
        let shares = self.hinge_shares.iter().enumerate();
        shares
            .filter(|(_, share)| **share > HINGE_SHARE_MAX)
            .map(|(index, _)| index + 1)
            .collect()
    }

    /// The angle about the crescent at which the rim is narrowest, degrees from the middle of the body.
    pub fn rim_min_angle_deg(&self) -> f64 {
        let meniscal_from_ct = self.site.crescent.ct_from_meniscal.inverse();
        let at = meniscal_from_ct * self.evaluation.rim_min_at;
        self.site.crescent.angle_rad(&at).to_degrees()
    }

    /// Share of the region that is removed, if a region was given.
    pub fn region_percent(&self) -> Option<f64> {
        (self.aim.contour || self.aim.lesion).then_some(self.evaluation.region_covered_percent)
    }

    /// Share of the lesion that is removed, if a lesion was given.
    pub fn lesion_percent(&self) -> Option<f64> {
        self.aim
            .lesion
            .then_some(self.evaluation.lesion_covered_percent)
    }

    /// Tissue removed outside the region, mm3, if a region was given.
    pub fn outside_mm3(&self) -> Option<f64> {
        (self.aim.contour || self.aim.lesion).then_some(self.evaluation.outside_removed_mm3)
    }

    /// The score as one JSON object; what was not given is null.
    pub fn json(&self) -> Value {
        let evaluation = &self.evaluation;
        let of_region = |value: f64| self.region_percent().map(|_| value);
        let of_lesion = |value: f64| self.lesion_percent().map(|_| value);
        json!({
            "bites": evaluation.bites,
            "removed_mm3": self.removed_mm3(),
            "region_mm3": of_region(evaluation.region_mm3),
            "region_covered_percent": self.region_percent(),
            "outside_removed_mm3": self.outside_mm3(),
            "lesion_mm3": of_lesion(evaluation.lesion_mm3),
            "lesion_covered_percent": self.lesion_percent(),
            "healthy_removed_mm3": of_lesion(evaluation.healthy_removed_mm3),
            "rim_min_mm": evaluation.rim_min_mm,
            "rim_min_angle_deg": self.rim_min_angle_deg(),
            "rim_min_at_mm": evaluation.rim_min_at.coords.as_slice(),
            "rim_mean_mm": evaluation.rim_mean_mm,
            "order_feasible": self.blocked().is_empty(),
            "blocked_bites": self.blocked(),
            "jaw_mm": [self.jaw.width_mm, self.jaw.length_mm],
        })
    }

    /// The score in one line.
    pub fn line(&self) -> String {
        let evaluation = &self.evaluation;
        let mut words = vec![match evaluation.bites {
            1 => "1 bite".to_owned(),
            count => format!("{count} bites"),
        }];
        words.extend(
            self.region_percent()
                .map(|percent| format!("region {percent:.1} %")),
        );
        words.extend(
            self.lesion_percent()
                .map(|percent| format!("lesion {percent:.1} %")),
        );
        words.push(match self.outside_mm3() {
            Some(outside_mm3) => format!("outside {outside_mm3:.1} mm3"),
            None => format!("removed {:.1} mm3", self.removed_mm3()),
        });
        words.push(format!("rim min {:.1} mm", evaluation.rim_min_mm));
        words.push(match self.blocked().len() {
            0 => "order feasible".to_owned(),
            count => format!("{count} blocked in this order"),
        });
        words.join("   ")
    }
}

fn above(model: &Mesh, list: &BitesFile) -> Point3 {
    if let Some(portal) = list.portals.first() {
        return *portal;
    }
    let opening = list
        .bites
        .iter()
        .find_map(|bite| bite.opening.map(|opening| bite.center + opening * ABOVE_MM));
    let middle = || model.vertices.first().copied().unwrap_or_default();
    opening.unwrap_or_else(|| middle() + arthro_geometry::Vector3::z() * ABOVE_MM)
}

/// What bites remove that nobody says the aim of.
fn aimless(site: &Site, jaw: Jaw, bites: &[Bite]) -> Evaluation {
    let nothing = Lesion::of_voxels(vec![false; site.voxels.centers().len()], &site.voxels);
    let task = Task {
        crescent: &site.crescent,
        voxels: &site.voxels,
        lesion: &nothing,
        band: None,
        jaw,
    };
    let mut evaluation = task.evaluate(bites);
    evaluation.rim_min_at = site.crescent.ct_from_meniscal * evaluation.rim_min_at;
    evaluation
}

fn upright(index: usize) -> Failure {
    let field = format!("bites[{index}].long_axis");
    let problem = "stands upright on the meniscus; such a bite needs its opening";
    let mut failure = Failure::refused("FILE_INVALID", format!("{field} {problem}"));
    failure.violations.push((field, problem.to_owned()));
    failure
}
