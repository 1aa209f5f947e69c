//! The commands that plan and score resections from files, without any server.

use std::ops::RangeInclusive;
use std::path::PathBuf;

use arthro_geometry::Point3;
use clap::{Args, ValueEnum};

use super::{StatedSpace, numbers, target_box};
use crate::bites_file::LESION_SPACING_MM;

const VOXEL_MM: RangeInclusive<f64> = 0.2..=2.0;
const RIM_MIN_MM: RangeInclusive<f64> = 0.5..=20.0;
const DEADLINE_S: RangeInclusive<f64> = 0.001..=86_400.0;
const RADIUS_MM: RangeInclusive<f64> = 0.1..=10.0;
const REGION_PERCENT: RangeInclusive<f64> = 50.0..=100.0;
const OUTSIDE_MM3: RangeInclusive<f64> = 0.0..=1000.0;
const PLACEMENT_ERROR_MM: RangeInclusive<f64> = 0.0..=3.0;

#[derive(Debug, Args)]
pub struct Plan {
    /// Closed surface of the meniscus (PLY, STL, OBJ), or `phantom`, the built-in one.
    #[arg(required_unless_present = "scorecard")]
    pub model: Option<PathBuf>,
    #[command(flatten)]
    pub region: Region,
    /// Where the new contour leaves the free edge: x,y,z in ct, mm. Without ends, drawn contour and standard case it
    /// leads around the lesion.
    #[arg(long, value_parser = place, requires = "goal", conflicts_with_all = ["scenario", "contour"], allow_hyphen_values = true)]
    pub start: Option<Point3>,
    /// Where it meets the free edge again.
    #[arg(long, value_parser = place, requires = "start", allow_hyphen_values = true)]
    pub goal: Option<Point3>,
    /// Targets stay inside this box: two opposite corners, x,y,z,x,y,z in ct, mm; anywhere if not given.
    #[arg(long = "box", value_parser = target_box, conflicts_with = "scenario", allow_hyphen_values = true)]
    pub target_box: Option<(Point3, Point3)>,
    /// The rim that must be left, mm: 3, and 3.2 for `--scenario band`, if not given.
    #[arg(long, value_parser = rim_min)]
    pub rim_min_mm: Option<f64>,
    #[command(flatten)]
    pub bites: Bites,
    /// Also plans from where an arthroscope that enters here watches each bite: x,y,z in ct, mm.
    #[arg(long, value_name = "X,Y,Z", value_parser = place, allow_hyphen_values = true)]
    pub arthroscope: Option<Point3>,
    /// Same seed, same plan.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Seconds that choosing the bites may take: after it the best plan so far is taken.
    #[arg(long, value_name = "SECONDS", value_parser = deadline)]
    pub deadline_s: Option<f64>,
    /// Where the bites go (JSON, LPS, mm).
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub pictures: Pictures,
    /// Plans the standard cases instead and prints them beside the paper's 39 bites on the same contour. `seconds` is
    /// the wall time of one run of the planner alone, without reading, scoring and drawing; on the phantom after one run
    /// that does not count, which starts the threads.
    #[arg(long, conflicts_with_all = ["model", "start", "target_box", "lesion", "contour", "scenario", "out", "svg", "png", "portal", "arthroscope", "planner"])]
    pub scorecard: bool,
    /// Also plans the standard cases on every PLY file of this folder, or of `menisci` in it, through the
    /// anterolateral portal of a generic knee. A file that states neither axes nor unit is taken to be in LPS and mm.
    #[arg(long, value_name = "FOLDER", requires = "scorecard")]
    pub data: Option<PathBuf>,
    #[command(flatten)]
    pub stated: StatedSpace,
}

/// How the bites are chosen, and what they have to keep.
#[derive(Debug, Args)]
pub struct Bites {
    /// Who chooses the bites.
    #[arg(long, value_enum, default_value_t)]
    pub planner: PlannerName,
    /// Which cost the paper's planner keeps below its limit.
    #[arg(long, value_enum, default_value_t)]
    pub paper_cost: PaperCostName,
    /// Multiplies the search for fewer bites.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100))]
    pub effort: u32,
    /// Takes a plan that leaves some of the region where it cannot be cleared, instead of none.
    #[arg(long)]
    pub partial: bool,
    /// Share of the region that has to go, percent.
    #[arg(long, default_value = "95", value_parser = region_percent)]
    pub region_percent: f64,
    /// How much may go outside it, mm3; 2 mm3 and 4 % of the region, at most 15 mm3, if not given.
    #[arg(long, value_parser = outside)]
    pub outside_limit_mm3: Option<f64>,
    /// How far off an executed bite may lie and still the lesion must be covered, mm.
    #[arg(long, default_value = "0.3", value_parser = placement_error)]
    pub placement_error_mm: f64,
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
    #[arg(long, value_parser = place, allow_hyphen_values = true)]
    pub portal: Vec<Point3>,
    /// The damaged tissue: points inside it on a regular grid (PLY, PCD), a label map (NRRD, with `--label`), or a markup
    /// of 3D Slicer (`.mrk.json`): a closed curve around it, or points in it with `--lesion-radius-mm`.
    #[arg(long, value_name = "FILE", conflicts_with = "scenario")]
    pub lesion: Option<PathBuf>,
    /// Distance between the lesion's points on their grid, mm.
    #[arg(long, default_value = "0.5", value_parser = lesion_spacing)]
    pub lesion_spacing_mm: f64,
    /// How far around the points of a markup the tissue is damaged, mm.
    #[arg(long, requires = "lesion", value_parser = radius)]
    pub lesion_radius_mm: Option<f64>,
    /// The label of the damaged tissue.
    #[arg(long, requires = "lesion", allow_hyphen_values = true)]
    pub label: Option<i64>,
    /// The new free edge as points in their order (PLY, PCD), or as an open curve of 3D Slicer (`.mrk.json`).
    #[arg(long, value_name = "FILE", conflicts_with = "scenario")]
    pub contour: Option<PathBuf>,
    /// A standard case instead.
    #[arg(long, value_enum)]
    pub scenario: Option<ScenarioName>,
    /// Width and length of the jaw, mm: w,l; 3,4.5 if nobody says.
    #[arg(long, value_name = "W,L", value_parser = numbers::<2>)]
    pub jaw: Option<[f64; 2]>,
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
    /// A radial tear in the middle of the body; the contour leads around it.
    Tear,
    /// All that lies inboard of a contour from the paper's start to its goal.
    Band,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum PlannerName {
    /// As few as clear the region, in an order in which each can be made.
    #[default]
    Bites,
    /// The paper's: one on every point of a path through the tissue.
    Paper,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum PaperCostName {
    /// Turn against the curvature as a vector, and the distance to the contour.
    #[default]
    Corrected,
    /// Eq. 8-10 of the paper.
    AsPrinted,
}

/// Three numbers; whether they are a place is told with the rest of the request.
fn place(text: &str) -> Result<Point3, String> {
    let parts = text.split(',').map(|part| {
        let number = part.trim().parse::<f64>();
        number.map_err(|_| format!("{part:?} is no number"))
    });
    let parts: Vec<f64> = parts.collect::<Result<_, _>>()?;
    let count = parts.len();
    let parts: [f64; 3] = parts
        .try_into()
        .map_err(|_| format!("{count} numbers; expected 3"))?;
    Ok(Point3::from(parts))
}

fn lesion_spacing(text: &str) -> Result<f64, String> {
    number(text, &LESION_SPACING_MM)
}

fn radius(text: &str) -> Result<f64, String> {
    number(text, &RADIUS_MM)
}

fn region_percent(text: &str) -> Result<f64, String> {
    number(text, &REGION_PERCENT)
}

fn outside(text: &str) -> Result<f64, String> {
    number(text, &OUTSIDE_MM3)
}

fn placement_error(text: &str) -> Result<f64, String> {
    number(text, &PLACEMENT_ERROR_MM)
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
