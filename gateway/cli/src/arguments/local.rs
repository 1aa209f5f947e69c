//! The commands that work on files, in this process, without any server: registration, its benchmarks, surfaces,
//! calibration.

use std::path::PathBuf;

use arthro_geometry::Point3;
use arthro_registration::scale::ScaleRange;
use clap::{ArgGroup, Args, Subcommand, ValueEnum};

use super::{Cell, StatedSpace, point, target_box};

#[derive(Debug, Args)]
pub struct Register {
    /// The model: its whole surface, as a cloud or a mesh (PLY, PCD, STL, OBJ).
    pub source: PathBuf,
    /// The view: what a camera saw of it.
    pub target: PathBuf,
    /// The scale of target over source: one that is known (within 2 %), a range LOW..HIGH, or `free` (0.3..3.5).
    #[arg(long, value_parser = scale, default_value = "1.0", allow_hyphen_values = true)]
    pub scale: ScaleRange,
    /// Where the camera stood, in the target's coordinates: x,y,z. 0,0,0 for a cloud in the camera's frame.
    #[arg(long, value_parser = point, allow_hyphen_values = true)]
    pub viewpoint: Option<Point3>,
    /// How the pose is found.
    #[arg(long, value_enum, default_value_t = MethodName::Robust)]
    pub method: MethodName,
    /// Box whose error is predicted: two opposite corners x,y,z,x,y,z in the source's coordinates; all of the model if not given.
    #[arg(long, value_parser = target_box, allow_hyphen_values = true)]
    pub target_region: Option<(Point3, Point3)>,
    /// Seconds after which the best pose so far is answered.
    #[arg(long, value_name = "SECONDS")]
    pub deadline: Option<f64>,
    /// Seed of the paper's method; the robust one draws nothing at random.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Draws the registration to this file.
    #[arg(long, value_name = "FILE")]
    pub svg: Option<PathBuf>,
    #[command(flatten)]
    pub stated: StatedSpace,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum MethodName {
    /// Every pose and scale is tried, the physics of the view judges.
    Robust,
    /// Super4PCS with the scale of the bounding boxes, then scaled ICP, as the paper has it.
    Paper,
}

#[derive(Debug, Subcommand)]
pub enum Bench {
    /// Registers every case of a folder with `cases.json` (clouds, true poses) and prints how many are solved.
    Registration(BenchRegistration),
    /// Registers what the simulated camera sees of one knee after another, scored by the referee.
    Cell(BenchCell),
    /// Calibrates and registers one simulated cell after another, and holds the predicted error of bites against the
    /// referee's.
    Budget(BenchBudget),
}

#[derive(Debug, Args)]
pub struct BenchRegistration {
    /// The folder.
    pub folder: PathBuf,
    /// Only cases whose name contains this.
    #[arg(long, value_name = "TEXT")]
    pub only: Option<String>,
    /// Prints a line for each case.
    #[arg(long)]
    pub each: bool,
}

#[derive(Debug, Args)]
pub struct BenchBudget {
    /// How many cells.
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub seeds: u64,
    /// Prints a line for each cell.
    #[arg(long)]
    pub each: bool,
}

#[derive(Debug, Args)]
pub struct BenchCell {
    /// How many knees.
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub seeds: u64,
    /// Surface of a meniscus; the built-in phantom if not given.
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Prints a line for each knee.
    #[arg(long)]
    pub each: bool,
}

#[derive(Debug, Args)]
#[command(group(ArgGroup::new("what").required(true).args(["label", "threshold", "list"])))]
pub struct Reconstruct {
    /// A label map or an image (NRRD).
    pub volume: PathBuf,
    /// The voxels with this label.
    #[arg(long, allow_negative_numbers = true)]
    pub label: Option<i64>,
    /// The voxels with at least this value.
    #[arg(long, allow_negative_numbers = true)]
    pub threshold: Option<f64>,
    /// Lists the labels with their voxels, volume and bounds.
    #[arg(long)]
    pub list: bool,
    /// Where the surface goes (PLY, LPS, mm).
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Where points spread evenly over the surface go, with normals (PLY, LPS, mm).
    #[arg(long, value_name = "FILE")]
    pub cloud: Option<PathBuf>,
    /// How many points the cloud has.
    #[arg(long, default_value_t = 20_000, requires = "cloud", value_parser = cloud_points)]
    pub points: usize,
    /// Passes of smoothing; 40 for a label and 0 for a threshold if not given.
    #[arg(long, value_name = "PASSES")]
    pub smooth: Option<u32>,
    /// Simplifies the surface to this many triangles.
    #[arg(long, conflicts_with = "max_error_mm")]
    pub triangles: Option<usize>,
    /// Simplifies the surface as far as it moves by no more than this, mm; a tenth of the shortest voxel edge if not
    /// given, 0 for not at all.
    #[arg(long)]
    pub max_error_mm: Option<f64>,
    /// Drops pieces and fills cavities smaller than this share of the largest piece: 0 none, 1 all but the largest;
    /// 0.01 if not given.
    #[arg(long)]
    pub min_piece_share: Option<f64>,
    /// The voxels of a detached header.
    #[arg(long, value_name = "FILE")]
    pub data: Option<PathBuf>,
    #[command(flatten)]
    pub stated: StatedSpace,
}

#[derive(Debug, Subcommand)]
pub enum Calibrate {
    /// The camera, from views of a board; the file is described in docs/calibration.md.
    HandEye(CalibrationFile),
    /// The tool's tip, and its shaft, from poses that turn about them; likewise.
    ToolTip(CalibrationFile),
    /// The whole routine in a simulated cell that is mounted off its drawing, graded by its referee.
    Cell(CalibrateCell),
}

#[derive(Debug, Args)]
pub struct CalibrateCell {
    #[command(flatten)]
    pub cell: Cell,
    /// Views of the board.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(15..=100))]
    pub poses: u32,
    /// Keeps configuration, logs and the measurements in this folder.
    #[arg(long, value_name = "FOLDER")]
    pub keep: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct CalibrationFile {
    /// The measurements (JSON).
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Saves the answer with the gateway under this label.
    #[arg(long, value_name = "LABEL", requires = "operator")]
    pub save: Option<String>,
    /// Who saves it.
    #[arg(long, requires = "save")]
    pub operator: Option<String>,
    /// How many days it holds; as long as the gateway's configuration says if not given.
    #[arg(long, requires = "save")]
    pub valid_days: Option<f64>,
}

/// Calibrations that the gateway keeps.
#[derive(Debug, Subcommand)]
pub enum Calibration {
    /// Lists all, the configured ones first.
    List,
    /// Shows one.
    Show {
        /// Its id.
        calibration: String,
    },
    /// Puts one in force in the place of the one of its kind; voids approvals.
    Activate {
        /// Its id; `configured-hand-eye` and `configured-tool-tip` are those of the configuration.
        calibration: String,
        /// Who puts it in force.
        #[arg(long)]
        operator: String,
    },
    /// Says that one is not to be used any more.
    Revoke {
        /// Its id.
        calibration: String,
        /// Who revokes it.
        #[arg(long)]
        operator: String,
        /// Why, for the record.
        #[arg(long)]
        because: String,
    },
}

fn scale(text: &str) -> Result<ScaleRange, String> {
    if text == "free" {
        return Ok(ScaleRange {
            low: 0.3,
            high: 3.5,
        });
    }
    let number = |part: &str| match part.trim().parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok(number),
        _ => Err(format!(
            "{part:?} is not a number greater than 0; give 1.0, 0.3..3.5 or free"
        )),
    };
    match text.split_once("..") {
        Some((low, high)) => Ok(ScaleRange {
            low: number(low)?,
            high: number(high.trim_start_matches('='))?,
        }),
        None => Ok(ScaleRange::known(number(text)?)),
    }
}

fn cloud_points(text: &str) -> Result<usize, String> {
    let limit = arthro_registration::input::MAX_POINTS;
    match text.parse() {
        Ok(count) if (1..=limit).contains(&count) => Ok(count),
        _ => Err(format!("must be 1 to {limit}")),
    }
}
