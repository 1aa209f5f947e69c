//! The command line.

use std::ffi::OsString;
use std::path::PathBuf;

use arthro_geometry::Point3;
use clap::{Args, Parser, Subcommand, ValueEnum};

mod audit;
mod can;
mod local;
mod pki;
mod planning;
mod recording;
mod requests;
mod robot;

pub use audit::{Audit, AuditExport, AuditKindName, AuditList, AuditVerify};
pub use can::{
    Can, CanCommand, Dump, Eds, Faults, NmtCommand, NmtOrder, NmtTarget, ObjectKind, Sdo, SdoRead,
    SdoWrite,
};
pub use local::{
    Bench, BenchBudget, BenchCell, BenchRegistration, Calibrate, CalibrateCell, Calibration,
    CalibrationFile, MethodName, Reconstruct, Register,
};
pub use pki::{Pki, PkiIssue, PkiRotate};
pub use planning::{Evaluate, PaperCostName, Pictures, Plan, PlannerName, Region, ScenarioName};
pub use recording::{Record, Replay};
pub use requests::{ModelRequests, Requests, SceneRequests};
pub use robot::{
    ArmName, AxisName, Controller, Dashboard, Jog, Portal, Robot, RobotCommand, RobotState, Taught,
};

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
    #[command(flatten)]
    pub tls: Tls,
    #[command(subcommand)]
    pub command: Command,
}

/// Who is shown to servers with TLS; all three or none.
#[derive(Clone, Debug, Args)]
pub struct Tls {
    /// The site's authority (PEM): of whom servers must have their certificate.
    #[arg(long, global = true, value_name = "FILE", env = "ARTHRO_TLS_CA", requires_all = ["tls_cert", "tls_key"])]
    pub tls_ca: Option<PathBuf>,
    /// The own certificate (PEM), from `arthro pki issue`.
    #[arg(long, global = true, value_name = "FILE", env = "ARTHRO_TLS_CERT", requires_all = ["tls_ca", "tls_key"])]
    pub tls_cert: Option<PathBuf>,
    /// Its key (PEM).
    #[arg(long, global = true, value_name = "FILE", env = "ARTHRO_TLS_KEY", requires_all = ["tls_ca", "tls_cert"])]
    pub tls_key: Option<PathBuf>,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Performs a whole simulated meniscoplasty and prints what truly happened.
    Demo(Demo),
    /// Starts the simulated cell and all services and keeps them running.
    Up(Up),
    /// Runs one service in the foreground.
    Serve(Serve),
    /// Makes and renews the certificates of a site.
    #[command(subcommand)]
    Pki(Pki),
    /// Creates and shows cases, and takes them from their scene to an approved plan.
    #[command(subcommand)]
    Case(Case),
    /// Prints an upload as JSON, one message a line, for `grpcurl -d @`.
    #[command(subcommand)]
    Requests(Requests),
    /// Finds a model in a view, from two files, without any server.
    Register(Register),
    /// Plans a resection from files, without any server.
    Plan(Box<Plan>),
    /// Scores a list of bites from files, wherever it was planned.
    Evaluate(Evaluate),
    /// Runs a benchmark on a folder of cases with known truth.
    #[command(subcommand)]
    Bench(Bench),
    /// Makes a watertight surface of a label or threshold of a volume.
    Reconstruct(Reconstruct),
    /// Starts the approved plan of a case and watches it to the end.
    Run(Run),
    /// Watches a procedure until it ends.
    Watch(Watch),
    /// Stops both arms and all drives at once.
    Stop(Stop),
    /// Halts a procedure and holds, or draws back along the shafts, as configured.
    Pause(ProcedureId),
    /// Goes on after a pause.
    Resume(Resume),
    /// Ends a procedure: halts, retracts along the shaft and withdraws.
    Abort(ProcedureId),
    /// Tells what is known of a halted procedure, and what may be decided.
    Recovery(ProcedureId),
    /// Decides what happens to an interrupted procedure.
    Recover(Recover),
    /// Looks at recordings of procedures.
    #[command(subcommand)]
    Record(Record),
    /// Shows recordings again as a gateway that can only be watched.
    Replay(Replay),
    /// Lists, checks and exports the record of who did what.
    #[command(subcommand)]
    Audit(Audit),
    /// Finds where camera, tool and shaft are mounted.
    #[command(subcommand)]
    Calibrate(Calibrate),
    /// Lists calibrations that the gateway keeps, puts them in force and revokes them.
    #[command(subcommand)]
    Calibration(Calibration),
    /// Shows, jogs, recovers and teaches the arms, and asks their controllers: for the engineer at the bench.
    Robot(Robot),
    /// Talks CANopen with the drives: for the engineer at the bench.
    Can(Can),
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
    /// What is removed.
    #[arg(long, value_enum, default_value_t = ScenarioName::Tear)]
    pub scenario: ScenarioName,
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
    /// Runs everything with TLS, by the certificates of this folder (`arthro pki`); what is missing there is made.
    #[arg(long, value_name = "FOLDER")]
    pub tls: Option<PathBuf>,
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
    /// Accepts the registration; one of verdict REVIEW needs a surgeon.
    Accept {
        case: String,
        /// Who accepts; with a certificate its name if not given.
        #[arg(long)]
        operator: Option<String>,
        /// The surgeon who accepts.
        #[arg(long)]
        surgeon: Option<String>,
    },
    /// Keeps where the forceps' tip stands now as a touch of a known landmark.
    Verify {
        case: String,
        /// The landmark's name.
        #[arg(long)]
        landmark: String,
        /// Where it is: x,y,z in ct, mm.
        #[arg(long, value_parser = point, allow_hyphen_values = true)]
        at: Point3,
        /// Who touches; with a certificate its name if not given.
        #[arg(long, default_value = "")]
        operator: String,
    },
    /// Takes the touch of a landmark back.
    Untouch {
        case: String,
        /// The landmark's name.
        #[arg(long)]
        landmark: String,
        /// Who takes it back; with a certificate its name if not given.
        #[arg(long, default_value = "")]
        operator: String,
    },
    /// Plans a case's bites and prints the plan's digest.
    Plan(Box<PlanCase>),
    /// Approves exactly the plan with this digest.
    Approve {
        case: String,
        /// The plan's digest.
        #[arg(long)]
        digest: String,
        /// Who approves; with a certificate its name if not given.
        #[arg(long, default_value = "")]
        surgeon: String,
    },
    /// Puts a second person's name to the plan that a surgeon approved.
    Countersign {
        case: String,
        /// The plan's digest.
        #[arg(long)]
        digest: String,
        /// Who signs; with a certificate its name if not given.
        #[arg(long, default_value = "")]
        person: String,
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

/// Without a contour, ends or targets the new contour is found around the case's lesion.
#[derive(Debug, Args)]
pub struct PlanCase {
    pub case: String,
    /// Where the new contour leaves the free edge: x,y,z in ct, mm.
    #[arg(long, value_parser = point, requires = "goal", allow_hyphen_values = true)]
    pub start: Option<Point3>,
    /// Where it meets the free edge again.
    #[arg(long, value_parser = point, requires = "start", allow_hyphen_values = true)]
    pub goal: Option<Point3>,
    /// Targets stay inside this box: two opposite corners, x,y,z,x,y,z in ct, mm; anywhere if not given.
    #[arg(long = "box", value_parser = target_box, allow_hyphen_values = true)]
    pub target_box: Option<(Point3, Point3)>,
    /// Takes start, goal and box from this file (`targets.toml` of a simulated cell).
    #[arg(long, value_name = "FILE", conflicts_with_all = ["start", "goal", "target_box"])]
    pub targets: Option<PathBuf>,
    /// The new contour as drawn: its points in their order (PLY or a Slicer curve).
    #[arg(long, value_name = "FILE", conflicts_with_all = ["start", "goal", "targets"])]
    pub contour: Option<PathBuf>,
    /// Who chooses the bites.
    #[arg(long, value_enum, default_value_t)]
    pub planner: PlannerName,
    /// Clears as much as can be cleared where not all can.
    #[arg(long)]
    pub partial: bool,
    /// Plans no views: the arthroscope looks at the middle of the bites.
    #[arg(long)]
    pub no_views: bool,
    /// The rim that must be left, mm; 0 means 3.
    #[arg(long, default_value_t = 0.0)]
    pub rim_min_mm: f64,
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    #[command(flatten)]
    pub stated: StatedSpace,
}

#[derive(Debug, Args)]
pub struct Run {
    pub case: String,
    /// Who starts; with a certificate its name if not given.
    #[arg(long, default_value = "")]
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
pub struct Resume {
    /// The newest one if not given.
    pub procedure: Option<String>,
    /// You have looked at the cell and let the arms move.
    #[arg(long)]
    pub acknowledge: bool,
}

#[derive(Debug, Args)]
pub struct Recover {
    /// The newest one if not given.
    pub procedure: Option<String>,
    /// You have looked at the cell and let the arms move.
    #[arg(long)]
    pub acknowledge: bool,
    /// Acknowledge the latched faults of arms and drives first.
    #[arg(long)]
    pub recover_faults: bool,
    /// What to do after retracting along the shaft.
    #[arg(long, value_enum)]
    pub action: RecoveryName,
    /// Who decides; with a certificate its name if not given.
    #[arg(long, default_value = "")]
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

fn point(text: &str) -> Result<Point3, String> {
    numbers::<3>(text).map(Point3::from)
}

fn target_box(text: &str) -> Result<(Point3, Point3), String> {
    let [ax, ay, az, bx, by, bz] = numbers::<6>(text)?;
    let (a, b) = (Point3::new(ax, ay, az), Point3::new(bx, by, bz));
    Ok((a.inf(&b), a.sup(&b)))
}
