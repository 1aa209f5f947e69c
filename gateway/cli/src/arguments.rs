//! The command line.

use std::ffi::OsString;
use std::path::PathBuf;

use arthro_geometry::Point3;
use arthro_registration::scale::ScaleRange;
use clap::{ArgGroup, Args, Parser, Subcommand, ValueEnum};

/// An arthroscopic robot system for meniscoplasty.
///
/// Exit codes: 0 done, 1 failed, 2 wrong command line, 3 refused, 4 service unreachable, 5 procedure
/// aborted or interrupted, 6 demo or calibration missed a limit.
#[derive(Debug, Parser)]
#[command(name = "arthro", version)]
pub struct Arguments {
    /// Prints the result as one JSON object on the last line of standard output.
    #[arg(long, global = true)]
    pub json: bool,
    /// The gateway's address.
    #[arg(
        long,
        global = true,
        env = "ARTHRO_GATEWAY",
        default_value = "http://127.0.0.1:50050"
    )]
    pub gateway: String,
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Performs a whole simulated meniscoplasty and prints what truly happened.
    Demo(Demo),
    /// Starts the simulated cell and all services and keeps them running.
    Up(Up),
    /// Runs one service in the foreground.
    Serve(Serve),
    /// Creates and shows cases, and gives them a scene.
    #[command(subcommand)]
    Case(Case),
    /// Finds a model in a view, from two files, without any server.
    Register(Register),
    /// Runs a benchmark on a folder of cases with known truth.
    #[command(subcommand)]
    Bench(Bench),
    /// Makes a watertight surface of a label or threshold of a volume.
    Reconstruct(Reconstruct),
    /// Plans a case's bites, or approves the plan.
    Plan(Plan),
    /// Starts the approved plan of a case and watches it to the end.
    Run(Run),
    /// Watches a procedure until it ends.
    Watch(Watch),
    /// Stops both arms and all drives at once.
    Stop(Stop),
    /// Holds a procedure before its next step.
    Pause(ProcedureId),
    /// Goes on after a pause.
    Resume(ProcedureId),
    /// Ends a procedure: retracts along the shaft and withdraws.
    Abort(ProcedureId),
    /// Decides what happens to an interrupted procedure.
    Recover(Recover),
    /// Finds where camera, tool and shaft are mounted.
    #[command(subcommand)]
    Calibrate(Calibrate),
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
}

#[derive(Debug, Args)]
pub struct Cell {
    /// Surface of a meniscus (PLY); the built-in phantom if not given.
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Seed of everything random in the cell: the knee's pose, the camera's noise.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// How many times faster than real time the cell may run.
    #[arg(long, default_value_t = 50.0)]
    pub time_scale: f64,
}

#[derive(Debug, Args)]
pub struct Demo {
    #[command(flatten)]
    pub cell: Cell,
    /// Where the HTML report goes.
    #[arg(long, value_name = "FILE", default_value = "arthro-report.html")]
    pub report: PathBuf,
    /// Keeps configuration, logs and journal in this folder.
    #[arg(long, value_name = "FOLDER")]
    pub keep: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct Up {
    #[command(flatten)]
    pub cell: Cell,
    /// Where configuration, logs and journal go.
    #[arg(long, value_name = "FOLDER", default_value = "arthro-state")]
    pub state: PathBuf,
    /// Free ports instead of 50050 to 50059 and free loopback addresses for the arms instead of 127.0.0.11 and .12.
    #[arg(long)]
    pub free_ports: bool,
}

#[derive(Debug, Args)]
pub struct Serve {
    /// Which service.
    #[arg(value_enum)]
    pub service: ServiceName,
    /// Flags of the service; `arthro serve NAME --help` lists them.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    pub flags: Vec<OsString>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ServiceName {
    Registration,
    Planning,
    Motion,
    Instrument,
    Simulator,
    Gateway,
}

#[derive(Debug, Subcommand)]
pub enum Case {
    /// Creates a case from a model.
    Create(CaseCreate),
    /// Lists all cases, newest first.
    List,
    /// Shows one case.
    Show { case: String },
    /// Gives a case what the camera saw.
    Scene(CaseScene),
    /// Registers a case's model to its scene.
    Register(RegisterCase),
    /// Accepts the registration.
    Accept {
        case: String,
        /// Who accepts.
        #[arg(long)]
        operator: String,
    },
}

#[derive(Debug, Args)]
pub struct CaseCreate {
    /// For people to read; no patient's name.
    pub label: String,
    /// Closed surface of the meniscus (PLY).
    #[arg(long, value_name = "FILE")]
    pub model: PathBuf,
    /// Points inside the damaged tissue on a regular grid (PLY).
    #[arg(long, value_name = "FILE")]
    pub lesion: Option<PathBuf>,
    /// Distance between the lesion's points, mm.
    #[arg(long, default_value_t = 0.5)]
    pub lesion_spacing_mm: f64,
    #[command(flatten)]
    pub stated: StatedSpace,
}

/// What a file does not say of itself.
#[derive(Clone, Copy, Debug, Args)]
pub struct StatedSpace {
    /// Patient axes of files that do not state them.
    #[arg(long, value_enum, requires = "unit")]
    pub space: Option<SpaceName>,
    /// Length unit of files that do not state it.
    #[arg(long, value_enum, requires = "space")]
    pub unit: Option<UnitName>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum SpaceName {
    Lps,
    Ras,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum UnitName {
    Mm,
    M,
}

#[derive(Debug, Args)]
pub struct CaseScene {
    pub case: String,
    /// A cloud in the camera's frame (PLY, mm).
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with = "simulator",
        required_unless_present = "simulator"
    )]
    pub cloud: Option<PathBuf>,
    /// Takes a frame from the simulated camera at this address.
    #[arg(long, value_name = "ADDRESS")]
    pub simulator: Option<String>,
    /// Seed of the simulated camera's noise.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

#[derive(Debug, Args)]
pub struct RegisterCase {
    pub case: String,
    /// Scale expected from the sensors; 0 means 1.
    #[arg(long, default_value_t = 0.0)]
    pub scale_prior: f64,
    /// How far the scale may be off, as a fraction; 0 means 0.02.
    #[arg(long, default_value_t = 0.0)]
    pub scale_tolerance: f64,
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

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
pub struct Plan {
    pub case: String,
    /// Where the new contour leaves the free edge: x,y,z in ct, mm.
    #[arg(long, value_parser = point, required_unless_present_any = ["targets", "approve"], allow_hyphen_values = true)]
    pub start: Option<Point3>,
    /// Where it meets the free edge again.
    #[arg(long, value_parser = point, required_unless_present_any = ["targets", "approve"], allow_hyphen_values = true)]
    pub goal: Option<Point3>,
    /// Targets stay inside this box: two opposite corners, x,y,z,x,y,z in ct, mm.
    #[arg(long = "box", value_parser = target_box, required_unless_present_any = ["targets", "approve"], allow_hyphen_values = true)]
    pub target_box: Option<(Point3, Point3)>,
    /// Takes start, goal and box from this file (`targets.toml` of a simulated cell).
    #[arg(long, value_name = "FILE", conflicts_with_all = ["start", "goal", "target_box"])]
    pub targets: Option<PathBuf>,
    /// The rim that must be left, mm; 0 means 3.
    #[arg(long, default_value_t = 0.0)]
    pub rim_min_mm: f64,
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Approves the plan with this digest instead of planning.
    #[arg(long, value_name = "DIGEST", requires = "surgeon")]
    pub approve: Option<String>,
    /// Who approves.
    #[arg(long)]
    pub surgeon: Option<String>,
}

#[derive(Debug, Args)]
pub struct Run {
    pub case: String,
    /// Who starts.
    #[arg(long)]
    pub operator: String,
    /// The digest that was approved; the case's present one if not given.
    #[arg(long)]
    pub digest: Option<String>,
    /// Returns at once instead of watching.
    #[arg(long)]
    pub detach: bool,
}

#[derive(Debug, Args)]
pub struct Watch {
    /// The newest one if not given.
    pub procedure: Option<String>,
}

#[derive(Debug, Args)]
pub struct Stop {
    /// Why, for the record.
    #[arg(long, default_value = "stopped from the command line")]
    pub reason: String,
}

#[derive(Debug, Args)]
pub struct ProcedureId {
    /// The newest one if not given.
    pub procedure: Option<String>,
}

#[derive(Debug, Args)]
pub struct Recover {
    /// The newest one if not given.
    pub procedure: Option<String>,
    /// What to do after retracting along the shaft.
    #[arg(long, value_enum)]
    pub action: RecoveryName,
    /// Who decides.
    #[arg(long)]
    pub operator: String,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum RecoveryName {
    /// Withdraw and end the procedure.
    Withdraw,
    /// Do the interrupted bite from its start.
    RepeatBite,
    /// Hold the interrupted bite as done and go on.
    MarkDone,
}

fn cloud_points(text: &str) -> Result<usize, String> {
    let limit = arthro_registration::input::MAX_POINTS;
    match text.parse() {
        Ok(count) if (1..=limit).contains(&count) => Ok(count),
        _ => Err(format!("must be 1 to {limit}")),
    }
}

fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|part| {
            part.trim()
                .parse::<f64>()
                .ok()
                .filter(|number| number.is_finite())
                .ok_or_else(|| format!("{part:?} is not a finite number"))
        })
        .collect::<Result<_, _>>()?;
    let count = numbers.len();
    numbers
        .try_into()
        .map_err(|_| format!("{count} numbers; expected {N}"))
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

fn point(text: &str) -> Result<Point3, String> {
    numbers::<3>(text).map(Point3::from)
}

fn target_box(text: &str) -> Result<(Point3, Point3), String> {
    let [ax, ay, az, bx, by, bz] = numbers::<6>(text)?;
    let (a, b) = (Point3::new(ax, ay, az), Point3::new(bx, by, bz));
    Ok((a.inf(&b), a.sup(&b)))
}
