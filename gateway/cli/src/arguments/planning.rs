//! The commands that plan and score resections from files, without any server.

use std::ops::RangeInclusive;
use std::path::PathBuf;

use arthro_geometry::Point3;
use arthro_planning::jaw::Jaw;
use clap::{Args, ValueEnum};

use super::{StatedSpace, numbers, point, target_box};
use crate::bites_file::{JAW_LENGTH_MM, JAW_WIDTH_MM, LESION_SPACING_MM};

const VOXEL_MM: RangeInclusive<f64> = 0.2..=2.0;
const RIM_MIN_MM: RangeInclusive<f64> = 0.5..=20.0;
const DEADLINE_S: RangeInclusive<f64> = 0.001..=86_400.0;

#[derive(Debug, Args)]
pub struct Plan {
    /// Closed surface of the meniscus (PLY, STL, OBJ), or `phantom`, the built-in one.
    #[arg(required_unless_present = "scorecard")]
    pub model: Option<PathBuf>,
    #[command(flatten)]
    pub region: Region,
    /// Where the new contour leaves the free edge: x,y,z in ct, mm.
    #[arg(long, value_parser = point, requires = "goal", conflicts_with = "scenario", allow_hyphen_values = true)]
    pub start: Option<Point3>,
    /// Where it meets the free edge again.
    #[arg(long, value_parser = point, requires = "start", allow_hyphen_values = true)]
    pub goal: Option<Point3>,
    /// Targets stay inside this box: two opposite corners, x,y,z,x,y,z in ct, mm; the model and 5 mm around it if not
    /// given.
    #[arg(long = "box", value_parser = target_box, requires = "start", allow_hyphen_values = true)]
    pub target_box: Option<(Point3, Point3)>,
    /// The rim that must be left, mm.
    #[arg(long, default_value = "3", value_parser = rim_min)]
    pub rim_min_mm: f64,
    /// Same seed, same plan.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Seconds that planning may take.
    #[arg(long, value_name = "SECONDS", value_parser = deadline)]
    pub deadline_s: Option<f64>,
    /// Where the bites go (JSON, LPS, mm).
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub pictures: Pictures,
    /// Plans the standard cases instead and prints them beside the paper's 39 bites.
    #[arg(long, conflicts_with_all = ["model", "start", "lesion", "contour", "scenario", "out", "svg", "png", "portal", "deadline_s"])]
    pub scorecard: bool,
    /// Also plans the standard cases on every PLY file of this folder, or of `menisci` in it.
    #[arg(long, value_name = "FOLDER", requires = "scorecard")]
    pub data: Option<PathBuf>,
    #[command(flatten)]
    pub stated: StatedSpace,
}

#[derive(Debug, Args)]
pub struct Evaluate {
    /// Closed surface of the meniscus (PLY, STL, OBJ), or `phantom`, the built-in one.
    pub model: PathBuf,
    /// The bites in their order (JSON); what the flags say counts more than what the file says.
    pub bites: PathBuf,
    #[command(flatten)]
    pub region: Region,
    #[command(flatten)]
    pub pictures: Pictures,
    #[command(flatten)]
    pub stated: StatedSpace,
}

/// What is to be removed, and with what.
#[derive(Debug, Args)]
pub struct Region {
    /// Where the forceps enter: x,y,z in ct, mm; may be given several times. The phantom has an anterolateral one.
    #[arg(long, value_parser = point, allow_hyphen_values = true)]
    pub portal: Vec<Point3>,
    /// Points inside the damaged tissue on a regular grid (PLY).
    #[arg(long, value_name = "FILE", conflicts_with = "scenario")]
    pub lesion: Option<PathBuf>,
    /// Distance between the lesion's points, mm.
    #[arg(long, default_value = "0.5", value_parser = lesion_spacing)]
    pub lesion_spacing_mm: f64,
    /// The new free edge as points in their order (PLY).
    #[arg(long, value_name = "FILE", conflicts_with = "scenario")]
    pub contour: Option<PathBuf>,
    /// A standard case instead.
    #[arg(long, value_enum)]
    pub scenario: Option<ScenarioName>,
    /// Width and length of the jaw, mm: w,l; 3,4.5 if nobody says.
    #[arg(long, value_parser = jaw)]
    pub jaw: Option<Jaw>,
    /// Edge of the voxels, mm.
    #[arg(long, default_value = "0.5", value_parser = voxel)]
    pub voxel_mm: f64,
}

/// Where pictures go.
#[derive(Debug, Args)]
pub struct Pictures {
    /// Draws meniscus, bites and remaining rim to this file (SVG).
    #[arg(long, value_name = "FILE")]
    pub svg: Option<PathBuf>,
    /// The same as PNG.
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ScenarioName {
    /// A radial tear in the middle of the body, the contour 28 degrees to both sides of it.
    Tear,
    /// All that lies inboard of a contour from the paper's start to its goal.
    Band,
}

fn jaw(text: &str) -> Result<Jaw, String> {
    let [width_mm, length_mm] = numbers::<2>(text)?;
    within(width_mm, &JAW_WIDTH_MM).map_err(|problem| format!("the width {problem}"))?;
    within(length_mm, &JAW_LENGTH_MM).map_err(|problem| format!("the length {problem}"))?;
    Ok(Jaw {
        width_mm,
        length_mm,
    })
}

fn lesion_spacing(text: &str) -> Result<f64, String> {
    number(text, &LESION_SPACING_MM)
}

fn voxel(text: &str) -> Result<f64, String> {
    number(text, &VOXEL_MM)
}

fn rim_min(text: &str) -> Result<f64, String> {
    number(text, &RIM_MIN_MM)
}

fn deadline(text: &str) -> Result<f64, String> {
    number(text, &DEADLINE_S)
}

fn number(text: &str, range: &RangeInclusive<f64>) -> Result<f64, String> {
    let [value] = numbers::<1>(text)?;
    within(value, range).map(|()| value)
}

fn within(value: f64, range: &RangeInclusive<f64>) -> Result<(), String> {
    if range.contains(&value) {
        return Ok(());
    }
    Err(format!(
        "is {value}; must be {} .. {}",
        range.start(),
        range.end()
    ))
}
