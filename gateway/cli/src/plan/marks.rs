//! The files in which somebody marked damaged tissue or drew the new free edge.

use std::path::Path;

use arthro_geometry::markups::{self, Kind};
use arthro_geometry::{Point3, Scan, nrrd, surface_file};
use arthro_planning::lesion::Lesion;

use super::site::{MARGIN_MM, Site};
use crate::arguments::{Region, StatedSpace};
use crate::bites_file::{LesionPoints, MAX_CONTOUR, MAX_LESION};
use crate::commands::{read, stated, unreadable};
use crate::exit::Failure;

const MARKUPS: &str = ".json";
const VOLUMES: [&str; 2] = [".nrrd", ".nhdr"];

/// Damaged tissue as a file tells it; points in ct, mm.
#[derive(Clone, Debug)]
pub enum Marked {
    /// Points on a grid.
    Grid(LesionPoints),
    /// Everything around some points.
    Near {
        /// The points.
        points: Vec<Point3>,
        /// How far around them, mm.
        radius_mm: f64,
    },
    /// What a closed curve goes around.
    Inside(Vec<Point3>),
    /// A label of a segmentation.
    Label {
        /// The segmentation.
        scan: Box<Scan>,
        /// The label.
        label: i64,
    },
}

impl Marked {
    /// Reads the lesion that the command line names, if any.
    pub fn read(region: &Region, given: StatedSpace) -> Result<Option<Self>, Failure> {
        let Some(path) = &region.lesion else {
            return Ok(None);
        };
        let name = lower(path);
        let is_volume = VOLUMES.iter().any(|ending| name.ends_with(ending));
        if is_volume {
            return Self::of_volume(path, region, given).map(Some);
        }
        if name.ends_with(MARKUPS) {
            return Self::of_markup(path, region).map(Some);
        }
        Ok(Some(Self::Grid(LesionPoints {
            spacing_mm: region.lesion_spacing_mm,
            points: points(path, given, MAX_LESION)?,
        })))
    }

    fn of_volume(path: &Path, region: &Region, given: StatedSpace) -> Result<Self, Failure> {
        let label = region.label.ok_or_else(|| {
            let problem = format!("{}: which label is damaged? Give --label", path.display());
            Failure::refused("LABEL_NOT_GIVEN", problem)
        })?;
        let scan = nrrd::read(&read(path)?, stated(given));
        let scan = Box::new(scan.map_err(|error| unreadable(path, &error))?);
        Ok(Self::Label { scan, label })
    }

    fn of_markup(path: &Path, region: &Region) -> Result<Self, Failure> {
        let markup = markup(path)?;
        let points = markup.points;
        match (markup.kind, region.lesion_radius_mm) {
            (Kind::ClosedCurve, _) => Ok(Self::Inside(points)),
            (Kind::Fiducial, Some(radius_mm)) => Ok(Self::Near { points, radius_mm }),
            (Kind::Fiducial, None) => {
                let problem = "points alone have no size; give --lesion-radius-mm";
                Err(invalid(path, problem))
            }
            (kind @ (Kind::Curve | Kind::Line), _) => {
                let problem = format!(
                    "is a {}; a lesion is a ClosedCurve or Fiducial points",
                    kind.word()
                );
                Err(invalid(path, &problem))
            }
        }
    }

    /// The damaged tissue as points on a grid.
    pub fn on(self, site: &Site) -> Result<LesionPoints, Failure> {
        let (crescent, voxels) = (&site.crescent, &site.voxels);
        let lesion = match self {
            Self::Grid(points) => return Ok(points),
            Self::Near { points, radius_mm } => {
                Lesion::near_points(&points, radius_mm, crescent, voxels, MARGIN_MM)
            }
            Self::Inside(points) => Lesion::inside_curve(&points, crescent, voxels),
            Self::Label { scan, label } => {
                Lesion::of_label(&scan, label, crescent, voxels, MARGIN_MM)
            }
        }?;
        Ok(LesionPoints {
            spacing_mm: lesion.spacing_mm(),
            points: lesion.points_in_ct(crescent),
        })
    }
}

/// Reads the points of a contour in their order.
pub fn read_contour(path: &Path, given: StatedSpace) -> Result<Vec<Point3>, Failure> {
    if !lower(path).ends_with(MARKUPS) {
        return points(path, given, MAX_CONTOUR);
    }
    let markup = markup(path)?;
    match markup.kind {
        Kind::Curve | Kind::Line => Ok(markup.points),
        Kind::ClosedCurve | Kind::Fiducial => {
            let problem = format!("is a {}; a contour is a Curve", markup.kind.word());
            Err(invalid(path, &problem))
        }
    }
}

fn markup(path: &Path) -> Result<markups::Markup, Failure> {
    markups::read_one(&read(path)?, None).map_err(|error| unreadable(path, &error))
}

fn points(path: &Path, given: StatedSpace, limit: usize) -> Result<Vec<Point3>, Failure> {
    let cloud = surface_file::read_cloud(path, &read(path)?, stated(given))
        .map_err(|error| unreadable(path, &error))?;
    let count = cloud.points.len();
    if count > limit {
        return Err(invalid(
            path,
            &format!("has {count} points; must be at most {limit}"),
        ));
    }
    Ok(cloud.points)
}

fn lower(path: &Path) -> String {
    path.to_string_lossy().to_lowercase()
}

fn invalid(path: &Path, problem: &str) -> Failure {
    Failure::refused("FILE_INVALID", format!("{}: {problem}", path.display()))
}
