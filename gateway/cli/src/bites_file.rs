//! Lists of bites as JSON files: what `arthro plan --out` writes and `arthro evaluate` reads, from whatever planner.
//!
//! ```json
//! {"format": "arthro-bites/1", "space": "LPS", "unit": "mm",
//!  "jaw": {"width_mm": 3.0, "length_mm": 4.5, "throat_mm": 1.0},
//!  "portals": [[62, 12, 94.5]],
//!  "contour": [[53, 48, 61], [53, 49, 60]],
//!  "lesion": {"spacing_mm": 0.5, "points": [[53, 57, 50]]},
//!  "bites": [{"center_mm": [53, 57, 50], "long_axis": [-0.2, 0.7, -0.7], "opening": [1, 0.2, 0], "portal": 0}],
//!  "views": [{"tip_mm": [58, 50, 55], "approach": [-0.2, 0.8, -0.6], "optical_axis": [-0.6, 0.5, -0.6], "roll_rad": 0,
//!             "depth_mm": 40, "distance_mm": 10, "occluded_percent": 0}]}
//! ```
//!
//! The order of the bites is the order of the list, and each view watches the bite of its place in it. Only `bites`, `space` and `unit` must be there, the latter two in the
//! file or on the command line. RAS is turned into LPS on the way in.

use std::path::Path;

use arthro_geometry::stated::{Space, Stated, Unit};
use arthro_geometry::{Point3, Vector3};
use arthro_planning::jaw::{Bite, Jaw};

use crate::arguments::StatedSpace;
use crate::commands::{read, stated};
use crate::exit::Failure;

mod entries;
mod problem;
#[cfg(test)]
mod tests;

use entries::{Entry, File, JawEntry, LesionEntry, ViewEntry};
use problem::Problem;

const FORMAT: &str = "arthro-bites/1";
/// Largest file, bytes.
const MAX_BYTES: u64 = 64 << 20;
/// Most entries of each list.
const MAX_BITES: usize = 1_000;
pub const MAX_PORTALS: usize = 16;
pub const MAX_CONTOUR: usize = 10_000;
pub const MAX_LESION: usize = 1_000_000;
/// Coordinates of a CT, mm.
const MAX_COORDINATE_MM: f64 = 10_000.0;
/// A direction shorter than this is none.
const MIN_LENGTH: f64 = 1e-6;
/// How far the cosine between a bite's directions may be from 0.
const RIGHT_ANGLE_TOLERANCE: f64 = 1e-2;
/// Sine of the least angle between the long axis and the superior direction: nearer to it, the latter does not tell how
/// the jaw opens.
const MIN_ACROSS: f64 = 0.17;
/// Sizes that a jaw may have, mm.
pub const JAW_WIDTH_MM: std::ops::RangeInclusive<f64> = 0.5..=10.0;
pub const JAW_LENGTH_MM: std::ops::RangeInclusive<f64> = 0.5..=20.0;
const THROAT_MM: std::ops::RangeInclusive<f64> = 0.1..=10.0;
/// Distances that the points of a lesion may have, mm.
pub const LESION_SPACING_MM: std::ops::RangeInclusive<f64> = 0.1..=2.0;

/// A list of bites and what its planner aimed at, in ct, mm.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BitesFile {
    /// The jaw that bites.
    pub jaw: Option<Jaw>,
    /// Where the forceps enter.
    pub portals: Vec<Point3>,
    /// The new free edge that was aimed at.
    pub contour: Vec<Point3>,
    /// The damaged tissue.
    pub lesion: Option<LesionPoints>,
    /// In the order of execution.
    pub bites: Vec<ListedBite>,
    /// How the arthroscope watches each bite; empty if that is not planned.
    pub views: Vec<ListedView>,
}

/// Damaged tissue as points on a grid.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LesionPoints {
    /// Distance between the points, mm.
    pub spacing_mm: f64,
    /// The points in ct, mm.
    pub points: Vec<Point3>,
}

/// One bite of a list.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ListedBite {
    /// Middle of the jaw, mm.
    pub center: Point3,
    /// Unit direction of the jaw's long axis, along the shaft and out of the tip.
    pub long_axis: Vector3,
    /// Unit direction in which the jaw opens, at right angles to the long axis, if known.
    pub opening: Option<Vector3>,
    /// Index of the portal it comes through, if known.
    pub portal: Option<usize>,
}

/// How the arthroscope watches one bite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ListedView {
    /// Where the shaft ends, mm.
    pub tip: Point3,
    /// Unit direction along the shaft, out of the tip.
    pub approach: Vector3,
    /// Unit direction of the middle of the image.
    pub optical_axis: Vector3,
    /// Turn of the optics about the shaft.
    pub roll_rad: f64,
    /// From the portal to the tip, mm.
    pub depth_mm: f64,
    /// From the tip to the middle of the jaw, mm.
    pub distance_mm: f64,
    /// Share of the jaw's footprint that is hidden, percent.
    pub occluded_percent: f64,
}

impl ListedBite {
    /// The bite; where it is not known how the jaw opens, it opens towards `superior`. `None` if the long axis lies
    /// along it.
    pub fn pose(&self, superior: &Vector3) -> Option<Bite> {
        let opening = match self.opening {
            Some(opening) => opening,
            None => {
                let across = superior - self.long_axis * superior.dot(&self.long_axis);
                across.try_normalize(MIN_ACROSS)?
            }
        };
        Some(Bite {
            center: self.center,
            approach: self.long_axis,
            opening,
            contour_point: self.center,
        })
    }
}

impl BitesFile {
    /// Reads a list; `given` is said of files that do not state their space and unit.
    pub fn read(path: &Path, given: StatedSpace) -> Result<Self, Failure> {
        let size = std::fs::metadata(path).map_or(0, |about| about.len());
        if size > MAX_BYTES {
            return Err(Problem::new(
                "file",
                format!("has {size} bytes; must be at most {MAX_BYTES}"),
            )
            .of(path));
        }
        Self::parse(&read(path)?, stated(given)).map_err(|problem| problem.of(path))
    }

    /// Writes the list, in LPS and mm.
    pub fn write(&self, path: &Path) -> Result<(), Failure> {
        let unwritable = |error: &dyn std::fmt::Display| {
            Failure::refused("FILE_UNWRITABLE", format!("{}: {error}", path.display()))
        };
        let entries = self.bites.iter();
        let entries = entries.map(|bite| serde_json::to_value(Entry::from(bite)));
        let file = File {
            format: Some(FORMAT.to_owned()),
            space: Some("LPS".to_owned()),
            unit: Some("mm".to_owned()),
            jaw: self.jaw.map(JawEntry::from),
            portals: self.portals.iter().map(|point| (*point).into()).collect(),
            contour: self.contour.iter().map(|point| (*point).into()).collect(),
            lesion: self.lesion.as_ref().map(LesionEntry::from),
            bites: entries
                .collect::<Result<_, _>>()
                .map_err(|error| unwritable(&error))?,
            views: self.views.iter().map(ViewEntry::from).collect(),
        };
        let text = serde_json::to_vec(&file).map_err(|error| unwritable(&error))?;
        std::fs::write(path, text).map_err(|error| unwritable(&error))
    }

    fn parse(bytes: &[u8], given: Option<Stated>) -> Result<Self, Problem> {
        let file: File =
            serde_json::from_slice(bytes).map_err(|error| Problem::of_syntax(&error, bytes))?;
        if let Some(format) = file.format.filter(|format| format != FORMAT) {
            return Err(Problem::new(
                "format",
                format!("is {format:?}; must be {FORMAT:?}"),
            ));
        }
        let factors = factors(file.space.as_deref(), file.unit.as_deref(), given)?;
        for (field, count, limit) in [
            ("bites", file.bites.len(), MAX_BITES),
            ("portals", file.portals.len(), MAX_PORTALS),
            ("contour", file.contour.len(), MAX_CONTOUR),
            (
                "lesion.points",
                file.lesion.as_ref().map_or(0, |lesion| lesion.points.len()),
                MAX_LESION,
            ),
        ] {
            if count > limit {
                return Err(Problem::new(
                    field,
                    format!("are {count}; must be at most {limit}"),
                ));
            }
        }
        let (bites, views) = (file.bites.len(), file.views.len());
        if views > 0 && views != bites {
            let problem = format!("are {views}; must be one for each of the {bites} bites");
            return Err(Problem::new("views", problem));
        }
        let lesion = file.lesion.map(|lesion| {
            check("lesion.spacing_mm", lesion.spacing_mm, &LESION_SPACING_MM)?;
            Ok(LesionPoints {
                spacing_mm: lesion.spacing_mm,
                points: points("lesion.points", &lesion.points, &factors)?,
            })
        });
        let portals = points("portals", &file.portals, &factors)?;
        let (bites, views) = (file.bites.into_iter(), file.views.iter());
        Ok(Self {
            jaw: file.jaw.map(JawEntry::checked).transpose()?,
            contour: points("contour", &file.contour, &factors)?,
            lesion: lesion.transpose()?,
            bites: bites
                .enumerate()
                .map(|(index, entry)| bite(index, entry, &factors, portals.len()))
                .collect::<Result<_, _>>()?,
            views: views
                .enumerate()
                .map(|(index, view)| view.checked(index, &factors))
                .collect::<Result<_, _>>()?,
            portals,
        })
    }
}

/// Factors on x, y and z that carry the file's coordinates to LPS.
fn factors(
    space: Option<&str>,
    unit: Option<&str>,
    given: Option<Stated>,
) -> Result<Vector3, Problem> {
    let space = match (space, given) {
        (Some("LPS"), _) => Space::Lps,
        (Some("RAS"), _) => Space::Ras,
        (Some(other), _) => {
            return Err(Problem::new(
                "space",
                format!("is {other:?}; must be \"LPS\" or \"RAS\""),
            ));
        }
        (None, Some(given)) => given.space,
        (None, None) => {
            return Err(Problem::new(
                "space",
                "is not stated; must be \"LPS\" or \"RAS\", or give --space",
            ));
        }
    };
    match (unit, given.map(|given| given.unit)) {
        (Some("mm"), _) | (None, Some(Unit::Millimetre)) => {}
        (Some(other), _) => {
            return Err(Problem::new(
                "unit",
                format!("is {other:?}; must be \"mm\""),
            ));
        }
        (None, Some(Unit::Metre)) => {
            return Err(Problem::new(
                "unit",
                "is given as m; lists of bites are in mm",
            ));
        }
        (None, None) => {
            return Err(Problem::new(
                "unit",
                "is not stated; must be \"mm\", or give --unit",
            ));
        }
    }
    let unit = Unit::Millimetre;
    Ok(Stated { space, unit }.to_lps_mm())
}

fn bite(
    index: usize,
    entry: serde_json::Value,
    factors: &Vector3,
    portals: usize,
) -> Result<ListedBite, Problem> {
    let field = |name: &str| format!("bites[{index}].{name}");
    let entry: Entry = serde_json::from_value(entry)
        .map_err(|error| Problem::new(format!("bites[{index}]"), error.to_string()))?;
    let long_axis = direction(&field("long_axis"), entry.long_axis, factors)?;
    let opening = match entry.opening {
        None => None,
        Some(opening) => Some(at_right_angles(
            &field("opening"),
            &direction(&field("opening"), opening, factors)?,
            &long_axis,
        )?),
    };
    if let Some(portal) = entry.portal.filter(|portal| *portal >= portals) {
        let problem = format!("is {portal}; the file has {portals} portals");
        return Err(Problem::new(field("portal"), problem));
    }
    Ok(ListedBite {
        center: point(&field("center_mm"), entry.center_mm, factors)?,
        long_axis,
        opening,
        portal: entry.portal,
    })
}

fn points(field: &str, points: &[[f64; 3]], factors: &Vector3) -> Result<Vec<Point3>, Problem> {
    let entries = points.iter().enumerate();
    entries
        .map(|(index, entry)| point(&format!("{field}[{index}]"), *entry, factors))
        .collect()
}

fn point(field: &str, coordinates: [f64; 3], factors: &Vector3) -> Result<Point3, Problem> {
    for value in coordinates {
        check(field, value, &(-MAX_COORDINATE_MM..=MAX_COORDINATE_MM))?;
    }
    Ok(Point3::from(
        Vector3::from(coordinates).component_mul(factors),
    ))
}

fn direction(field: &str, parts: [f64; 3], factors: &Vector3) -> Result<Vector3, Problem> {
    let given = Vector3::from(parts);
    let length = given.norm();
    match given.component_mul(factors).try_normalize(MIN_LENGTH) {
        Some(unit) if length.is_finite() => Ok(unit),
        _ => Err(Problem::new(
            field,
            format!("has length {length}; must be a direction"),
        )),
    }
}

fn at_right_angles(
    field: &str,
    opening: &Vector3,
    long_axis: &Vector3,
) -> Result<Vector3, Problem> {
    let cosine = opening.dot(long_axis);
    let across = (opening - long_axis * cosine).try_normalize(MIN_LENGTH);
    match across {
        Some(across) if cosine.abs() <= RIGHT_ANGLE_TOLERANCE => Ok(across),
        _ => Err(Problem::new(
            field,
            format!(
                "is {:.2} deg from the long axis; must be 90 deg",
                cosine.acos().to_degrees()
            ),
        )),
    }
}

fn check(field: &str, value: f64, range: &std::ops::RangeInclusive<f64>) -> Result<(), Problem> {
    // NaN is in no range.
    if range.contains(&value) {
        return Ok(());
    }
    let problem = format!("is {value}; must be {} .. {}", range.start(), range.end());
    Err(Problem::new(field, problem))
}
