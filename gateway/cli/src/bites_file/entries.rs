//! The file as it stands on disk.

use arthro_geometry::Vector3;
use arthro_planning::jaw::{DEFAULT_THROAT_MM, Jaw};
use serde::{Deserialize, Serialize};

use super::problem::Problem;
use super::{
    JAW_LENGTH_MM, JAW_WIDTH_MM, LesionPoints, ListedBite, ListedView, THROAT_MM, check, direction,
    point,
};

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct File {
    pub format: Option<String>,
    pub space: Option<String>,
    pub unit: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub jaw: Option<JawEntry>,
    #[serde(default)]
    pub portals: Vec<[f64; 3]>,
    #[serde(default)]
    pub contour: Vec<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lesion: Option<LesionEntry>,
    /// Read one by one, so that an error tells which.
    pub bites: Vec<serde_json::Value>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub views: Vec<ViewEntry>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JawEntry {
    width_mm: f64,
    length_mm: f64,
    throat_mm: Option<f64>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LesionEntry {
    pub spacing_mm: f64,
    pub points: Vec<[f64; 3]>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    pub center_mm: [f64; 3],
    pub long_axis: [f64; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    pub opening: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub portal: Option<usize>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewEntry {
    tip_mm: [f64; 3],
    approach: [f64; 3],
    optical_axis: [f64; 3],
    roll_rad: f64,
    depth_mm: f64,
    distance_mm: f64,
    occluded_percent: f64,
}

impl JawEntry {
    pub fn checked(self) -> Result<Jaw, Problem> {
        let throat_mm = self.throat_mm.unwrap_or(DEFAULT_THROAT_MM);
        check("jaw.width_mm", self.width_mm, &JAW_WIDTH_MM)?;
        check("jaw.length_mm", self.length_mm, &JAW_LENGTH_MM)?;
        check("jaw.throat_mm", throat_mm, &THROAT_MM)?;
        Ok(Jaw {
            width_mm: self.width_mm,
            length_mm: self.length_mm,
            throat_mm,
        })
    }
}

impl ViewEntry {
    /// The view with this index; `factors` carry the file's coordinates to LPS.
    pub fn checked(&self, index: usize, factors: &Vector3) -> Result<ListedView, Problem> {
        let field = |name: &str| format!("views[{index}].{name}");
        Ok(ListedView {
            tip: point(&field("tip_mm"), self.tip_mm, factors)?,
            approach: direction(&field("approach"), self.approach, factors)?,
            optical_axis: direction(&field("optical_axis"), self.optical_axis, factors)?,
            roll_rad: self.roll_rad,
            depth_mm: self.depth_mm,
            distance_mm: self.distance_mm,
            occluded_percent: self.occluded_percent,
        })
    }
}

impl From<Jaw> for JawEntry {
    fn from(jaw: Jaw) -> Self {
        Self {
            width_mm: jaw.width_mm,
            length_mm: jaw.length_mm,
            throat_mm: Some(jaw.throat_mm),
        }
    }
}

impl From<&LesionPoints> for LesionEntry {
    fn from(lesion: &LesionPoints) -> Self {
        Self {
            spacing_mm: lesion.spacing_mm,
            points: lesion.points.iter().map(|point| (*point).into()).collect(),
        }
    }
}

impl From<&ListedBite> for Entry {
    fn from(bite: &ListedBite) -> Self {
        Self {
            center_mm: bite.center.into(),
            long_axis: bite.long_axis.into(),
            opening: bite.opening.map(<[f64; 3]>::from),
            portal: bite.portal,
        }
    }
}

impl From<&ListedView> for ViewEntry {
    fn from(view: &ListedView) -> Self {
        Self {
            tip_mm: view.tip.into(),
            approach: view.approach.into(),
            optical_axis: view.optical_axis.into(),
            roll_rad: view.roll_rad,
            depth_mm: view.depth_mm,
            distance_mm: view.distance_mm,
            occluded_percent: view.occluded_percent,
        }
    }
}
