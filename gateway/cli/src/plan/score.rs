//! What a list of bites does to a meniscus, in words for people and for programs.

use arthro_geometry::{Mesh, Point3};
use arthro_planning::evaluation::Evaluation;
use arthro_planning::jaw::{Bite, Jaw};
use arthro_planning::plan::{self, EvaluationRequest, Given};
use arthro_planning::tissue::THROAT_LIMIT;
use serde_json::{Value, json};

use super::site::Site;
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
        let lesion = list.lesion.clone().unwrap_or_default();
        let evaluation = plan::evaluate(&EvaluationRequest {
            model: model.clone(),
            lesion: lesion.points,
            lesion_spacing_mm: lesion.spacing_mm,
            contour: list.contour.clone(),
            bites: bites.iter().map(Given::from).collect(),
            portals: list.portals.clone(),
            jaw,
            throat_limit: THROAT_LIMIT,
            voxel_mm,
        })?;
        Ok(Self {
            site,
            bites,
            jaw,
            evaluation,
            aim,
        })
    }

    /// Bites, counted from 1, whose throat tissue would block.
    pub fn blocked(&self) -> Vec<usize> {
        let blocked = self.evaluation.infeasible.iter();
        blocked.map(|blocked| blocked.bite + 1).collect()
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
            "removed_mm3": evaluation.removed_mm3,
            "region_mm3": of_region(evaluation.region_mm3),
            "region_covered_percent": self.region_percent(),
            "outside_removed_mm3": self.outside_mm3(),
            "lesion_mm3": of_lesion(evaluation.lesion_mm3),
            "lesion_covered_percent": self.lesion_percent(),
            "healthy_removed_mm3": of_lesion(evaluation.healthy_removed_mm3),
            "rim_min_mm": evaluation.rim_min_mm,
            "rim_min_angle_deg": evaluation.rim_min_angle_rad.to_degrees(),
            "rim_min_at_mm": evaluation.rim_min_at.coords.as_slice(),
            "rim_mean_mm": evaluation.rim_mean_mm,
            "scallop_rms_mm": evaluation.scallop.map(|scallop| scallop.rms_mm),
            "scallop_max_mm": evaluation.scallop.map(|scallop| scallop.max_mm),
            "predicted_seconds": evaluation.predicted_seconds,
            "order_feasible": self.blocked().is_empty(),
            "blocked_bites": self.blocked(),
            "jaw_mm": [self.jaw.width_mm, self.jaw.length_mm],
            "throat_mm": self.jaw.throat_mm,
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
            None => format!("removed {:.1} mm3", evaluation.removed_mm3),
        });
        words.push(format!("rim min {:.1} mm", evaluation.rim_min_mm));
        words.push(match self.blocked().len() {
            0 => "order feasible".to_owned(),
            count => format!("{count} blocked in this order"),
        });
        words.join("   ")
    }
}

/// A point on the superior side of the meniscus: where a portal lies or a jaw opens to.
pub fn above(model: &Mesh, list: &BitesFile) -> Point3 {
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

fn upright(index: usize) -> Failure {
    let field = format!("bites[{index}].long_axis");
    let problem = "stands upright on the meniscus; such a bite needs its opening";
    let mut failure = Failure::refused("FILE_INVALID", format!("{field} {problem}"));
    failure.violations.push((field, problem.to_owned()));
    failure
}
