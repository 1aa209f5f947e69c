//! What an engineer at the bench needs of the arms.

use std::ops::RangeInclusive;
use std::path::PathBuf;

use clap::{ArgGroup, Args, Subcommand, ValueEnum};

/// Farthest that one jog goes: a slip of the finger must not cross the cell.
const JOG_RAD: RangeInclusive<f64> = -0.2..=0.2;
const JOG_MM: RangeInclusive<f64> = -50.0..=50.0;
const DEPTH_MM: RangeInclusive<f64> = -500.0..=500.0;

#[derive(Debug, Args)]
pub struct Robot {
    /// The motion service's address.
    #[arg(
        long,
        env = "ARTHRO_MOTION",
        default_value = "http://127.0.0.1:50053",
        global = true
    )]
    pub motion: String,
    #[command(subcommand)]
    pub command: RobotCommand,
}

#[derive(Debug, Subcommand)]
pub enum RobotCommand {
    /// Shows what was measured of both arms.
    State(RobotState),
    /// Asks a controller's dashboard: power, brakes, protective stop, modes.
    Dashboard(Dashboard),
    /// Moves an arm a little way outside: one joint, or the tool along an axis.
    Jog(Jog),
    /// Draws a tool back along its shaft.
    Retract(Retract),
    /// Acknowledges an arm's fault once its cause is gone; nothing moves.
    Recover(WhichArm),
    /// Adds where an arm stands now to a file of taught poses.
    Teach(Taught),
    /// Finds the portal that the taught shaft lines meet in.
    Portal(Portal),
    /// Finds the shaft's line in the flange from taught poses whose shaft passes one fixed point.
    Shaft(Taught),
    /// Reads a controller's factory calibration and prints it as configuration.
    Kinematics(Controller),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ArmName {
    Forceps,
    Arthroscope,
}

#[derive(Debug, Args)]
pub struct RobotState {
    /// Goes on until interrupted, a line an arm each second of the controllers' time.
    #[arg(long)]
    pub watch: bool,
}

#[derive(Debug, Args)]
pub struct WhichArm {
    /// Which arm.
    #[arg(value_enum)]
    pub arm: ArmName,
}

#[derive(Debug, Args)]
pub struct Taught {
    /// Which arm.
    #[arg(value_enum)]
    pub arm: ArmName,
    /// The taught poses (JSON): `poses`, each base_from_flange with `rotation_wxyz` and `translation_mm`.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
}

#[derive(Debug, Args)]
pub struct Portal {
    #[command(flatten)]
    pub taught: Taught,
    /// States the portal and its axis to the motion service.
    #[arg(long)]
    pub set: bool,
}

#[derive(Debug, Args)]
pub struct Controller {
    /// The controller: HOST or HOST:PORT of its primary interface.
    pub controller: String,
}

#[derive(Debug, Args)]
pub struct Dashboard {
    /// The controller: HOST or HOST:PORT.
    pub controller: String,
    /// One line as the controller's manual has it, such as `robotmode`, `power on`, `brake release`, `unlock protective stop`.
    #[arg(required = true, num_args = 1..)]
    pub line: Vec<String>,
}

#[derive(Debug, Args)]
#[command(group(ArgGroup::new("what").required(true).args(["joint", "along"])))]
pub struct Jog {
    /// Which arm.
    #[arg(value_enum)]
    pub arm: ArmName,
    /// The joint, 1 base to 6 wrist 3.
    #[arg(long, requires = "by_rad", value_parser = clap::value_parser!(u8).range(1..=6))]
    pub joint: Option<u8>,
    /// How far it turns, rad; at most 0.2 either way.
    #[arg(long, requires = "joint", value_parser = jog_rad, allow_hyphen_values = true)]
    pub by_rad: Option<f64>,
    /// The axis.
    #[arg(long, value_enum, requires = "by_mm")]
    pub along: Option<AxisName>,
    /// How far the tool moves, mm; at most 50 either way.
    #[arg(long, requires = "along", value_parser = jog_mm, allow_hyphen_values = true)]
    pub by_mm: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum AxisName {
    /// Of the arm's base.
    BaseX,
    BaseY,
    BaseZ,
    /// Of the tool: x is along the shaft, out of the tip.
    ToolX,
    ToolY,
    ToolZ,
}

#[derive(Debug, Args)]
pub struct Retract {
    /// Which arm.
    #[arg(value_enum)]
    pub arm: ArmName,
    /// Depth of the tip beyond the portal at the end, mm; negative is outside.
    #[arg(long, default_value_t = -20.0, value_parser = depth_mm, allow_hyphen_values = true)]
    pub to_depth_mm: f64,
}

fn within(text: &str, range: &RangeInclusive<f64>, unit: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(number) if range.contains(&number) => Ok(number),
        _ => Err(format!(
            "must be {} to {} {unit}",
            range.start(),
            range.end()
        )),
    }
}

fn jog_rad(text: &str) -> Result<f64, String> {
    within(text, &JOG_RAD, "rad")
}

fn jog_mm(text: &str) -> Result<f64, String> {
    within(text, &JOG_MM, "mm")
}

fn depth_mm(text: &str) -> Result<f64, String> {
    within(text, &DEPTH_MM, "mm")
}
