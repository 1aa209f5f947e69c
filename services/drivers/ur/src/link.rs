//! What a user of an arm sees: where it is ([`Endpoint`]), how to run it ([`Options`]), what it reports ([`State`]),
//! what it can be told ([`Command`]), and the trait between them ([`RobotLink`]).

use std::{ops::RangeInclusive, time::Duration};

use crate::{Error, Expected, RobotMode, RuntimeState, SafetyMode, Window};

/// One arm, one state in and one command out per controller cycle.
///
/// The contract of a controlling client:
/// - after every state received, send exactly one command (also when the state is the one waited for): the package is the
///   keep-alive. When a moving arm misses [`Options::silent_cycles`] of them its program stops it and reports
///   [`Fault::ClientSilent`]; a simulated arm in lock step waits for it before its clock goes on;
/// - sending the same `MoveL`/`MoveJ` again keeps it going and never restarts it; to repeat a finished move send another
///   command (such as [`Command::Hold`]) between;
/// - after a [`Fault`] nothing moves until a [`Command::Hold`] is sent by a client that has seen the fault;
/// - nothing that was commanded before a stop, a fault, an end of the program or a new connection is ever continued.
pub trait RobotLink: Send + 'static {
    /// One controller cycle, s: the time between two samples of a stream, and between two states.
    fn period_s(&self) -> f64;

    /// Waits for the state of the next controller cycle; under backlog the newest, older ones are dropped.
    /// Cancel safe.
    fn next_state(&mut self) -> impl Future<Output = Result<State, Error>> + Send;

    /// Sends exactly one input package. Cancel safe: a package begun is completed before the next.
    fn send(&mut self, command: &Command) -> impl Future<Output = Result<(), Error>> + Send;
}

/// What the arm shall do, in its base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Stand still and be ready. Ends any motion as [`Command::Stop`] does; acknowledges a fault that was reported.
    Hold,
    /// Follow a stream of joint positions, one sample each cycle (URScript `servoj`); [`Stream`](crate::Stream) makes its
    /// windows. Consecutive `Stream` commands whose numbers do not go back are one command: they share a sequence number.
    /// The first sample must be near the present position. Finished once the last sample was consumed; it is held then.
    Stream(Window),
    /// Move the tool along a straight line with constant rotation axis (URScript `movel`).
    MoveL {
        /// x, y, z in m and rotation vector, of the tool set by [`Options::tcp_offset`].
        base_from_tool: [f64; 6],
        /// Tool speed.
        speed_m_s: f64,
        /// Tool acceleration.
        accel_m_s2: f64,
    },
    /// Move all joints in common time (URScript `movej`).
    MoveJ {
        /// Base, shoulder, elbow, wrist 1, 2, 3.
        joints_rad: [f64; 6],
        /// Speed of the leading joint.
        speed_rad_s: f64,
        /// Acceleration of the leading joint.
        accel_rad_s2: f64,
    },
    /// Stop now: `stopl` out of a `MoveL`, `stopj` otherwise. Finished once the arm was told to stand.
    Stop,
}

/// The arm in one controller cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Controller clock, s since its start. A simulated controller may run faster than the wall.
    pub timestamp_s: f64,
    /// Measured joint positions, rad.
    pub actual_q: [f64; 6],
    /// Commanded joint positions, rad.
    pub target_q: [f64; 6],
    /// Measured joint speeds, rad/s.
    pub actual_qd: [f64; 6],
    /// Base from tool, measured: m and rotation vector.
    pub actual_tcp_pose: [f64; 6],
    /// Power and brakes.
    pub robot_mode: RobotMode,
    /// Why it may not move, if so.
    pub safety_mode: SafetyMode,
    /// Whether a program runs.
    pub runtime_state: RuntimeState,
    /// 0..1: the share of nominal speed at which trajectories advance (slider and limits together).
    pub speed_scaling: f64,
    /// 0..1: the speed slider.
    pub target_speed_fraction: f64,
    /// What our program on the controller reports.
    pub program: ProgramState,
}

/// What the uploaded program reports through its output registers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProgramState {
    /// The program of this very connection runs. False after a protective stop, while it is paused, or when another
    /// program replaced it.
    pub ready: bool,
    /// Sequence of the last command sent by this client before this state was taken from the socket; 0: none yet.
    pub sequence_sent: i32,
    /// Sequence of the command being executed; 0: none.
    pub sequence_running: i32,
    /// Sequence of the last command that finished.
    pub sequence_done: i32,
    /// Consecutive cycles without a new package from this client, as the program counts them.
    pub missed_cycles: i32,
    /// Number of the sample of the running stream that the program commanded last; 0: none yet.
    pub sample_consumed: i32,
    /// Latched until acknowledged by [`Command::Hold`].
    pub fault: Option<Fault>,
}

impl ProgramState {
    /// The last command sent has finished: a move reached its target, a stop stands, the last sample of a stream was
    /// commanded.
    pub fn finished(&self) -> bool {
        self.ready && self.sequence_sent != 0 && self.sequence_done == self.sequence_sent
    }
}

/// Why the program stopped the arm by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// No new package for [`Options::silent_cycles`] cycles while moving.
    ClientSilent,
    /// A sample farther from the arm than [`Servo::max_lead_rad`].
    ServoLead,
    /// The command is none that the program knows.
    UnknownCommand,
    /// Every sample of the window was consumed and no newer window came.
    Starved,
    /// A sample farther from the one before than [`Servo::max_speed_rad_s`] allows.
    SampleStep,
    /// The next sample is no longer in the window.
    SampleGap,
    /// The program was paused while it moved the arm.
    Paused,
    /// A register held something this program does not know.
    Unknown(i32),
}

impl Fault {
    /// From the number in the register; none for 0.
    pub(crate) fn from_code(code: i32) -> Option<Self> {
        Some(match code {
            0 => return None,
            1 => Self::ClientSilent,
            2 => Self::ServoLead,
            3 => Self::UnknownCommand,
            4 => Self::Starved,
            5 => Self::SampleStep,
            6 => Self::SampleGap,
            7 => Self::Paused,
            other => Self::Unknown(other),
        })
    }
}

/// Where the services of one controller are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Endpoint {
    /// Name or address.
    pub host: String,
    /// Dashboard server, 29999.
    pub dashboard_port: u16,
    /// RTDE, 30004.
    pub rtde_port: u16,
    /// Any interface that accepts URScript: 30003, 30002 or 30001.
    pub script_port: u16,
}

impl Endpoint {
    /// The standard ports of a controller.
    pub fn new(host: impl Into<String>) -> Self {
        Self {
            host: host.into(),
            dashboard_port: 29999,
            rtde_port: 30004,
            script_port: 30003,
        }
    }
}

/// How to run an arm.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Where it is.
    pub endpoint: Endpoint,
    /// Flange from tool: m and rotation vector. `MoveL` and the reported pose are of this point.
    pub tcp_offset: [f64; 6],
    /// Mass at the flange, kg.
    pub payload_kg: f64,
    /// The robot that must be there; any if none is named.
    pub expected: Option<Expected>,
    /// What `connect` may do to the arm.
    pub startup: Startup,
    /// How a stream is followed.
    pub servo: Servo,
    /// Deceleration of `stopj`.
    pub stop_accel_rad_s2: f64,
    /// Deceleration of `stopl`.
    pub stop_accel_m_s2: f64,
    /// Controller cycles without a package after which a moving arm is stopped.
    pub silent_cycles: u32,
    /// Wall time without any state after which `next_state` fails.
    pub silence_timeout: Duration,
    /// Wall time for one reply of the controller.
    pub reply_timeout: Duration,
    /// Wall time for power on, brake release and program start, each.
    pub startup_timeout: Duration,
}

impl Options {
    /// Any arm without tool: short lookahead, 10 silent cycles.
    pub fn new(endpoint: Endpoint) -> Self {
        Self {
            endpoint,
            tcp_offset: [0.0; 6],
            payload_kg: 0.5,
            expected: None,
            startup: Startup::PowerOn,
            servo: Servo {
                lookahead_s: 0.03,
                gain: 600.0,
                max_lead_rad: 0.3,
                max_speed_rad_s: 3.2,
            },
            stop_accel_rad_s2: 4.0,
            stop_accel_m_s2: 1.5,
            silent_cycles: 10,
            silence_timeout: Duration::from_secs(2),
            reply_timeout: Duration::from_secs(3),
            startup_timeout: Duration::from_secs(30),
        }
    }
}

/// What `connect` may do to the arm before it uploads the program. A protective stop is never unlocked by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Startup {
    /// Power on and release the brakes where needed.
    PowerOn,
    /// Touch nothing; refuse an arm that is not running.
    RequireRunning,
}

/// The parameters of `servoj`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Servo {
    /// 0.03..0.2 s; smooths and delays.
    pub lookahead_s: f64,
    /// 100..2000.
    pub gain: f64,
    /// Largest distance of any joint from its sample; beyond it the program refuses with [`Fault::ServoLead`].
    pub max_lead_rad: f64,
    /// Largest speed of any joint from sample to sample; beyond it the program refuses with [`Fault::SampleStep`].
    pub max_speed_rad_s: f64,
}

impl Command {
    /// Refuses what must not go to a robot.
    ///
    /// # Errors
    /// [`Error::Value`] for numbers that are not finite or far outside any arm.
    pub fn check(&self) -> Result<(), Error> {
        match self {
            Self::Hold | Self::Stop => Ok(()),
            Self::Stream(window) => window.joints_rad.iter().try_for_each(check_joints),
            Self::MoveL {
                base_from_tool,
                speed_m_s,
                accel_m_s2,
            } => {
                for value in base_from_tool {
                    in_range("base_from_tool", *value, -10.0..=10.0, "-10 to 10")?;
                }
                in_range("speed_m_s", *speed_m_s, 1e-6..=3.0, "0.000001 to 3")?;
                in_range("accel_m_s2", *accel_m_s2, 1e-6..=30.0, "0.000001 to 30")
            }
            Self::MoveJ {
                joints_rad,
                speed_rad_s,
                accel_rad_s2,
            } => {
                check_joints(joints_rad)?;
                in_range("speed_rad_s", *speed_rad_s, 1e-6..=3.2, "0.000001 to 3.2")?;
                in_range("accel_rad_s2", *accel_rad_s2, 1e-6..=40.0, "0.000001 to 40")
            }
        }
    }

    /// Both belong to one execution: the same move kept alive, or the next window of a stream.
    pub(crate) fn continues(&self, before: &Self) -> bool {
        match (self, before) {
            (Self::Stream(next), Self::Stream(before)) => next.first >= before.first,
            _ => self == before,
        }
    }
}

fn check_joints(joints_rad: &[f64; 6]) -> Result<(), Error> {
    // One turn each way and the small reserve the controller grants itself.
    joints_rad
        .iter()
        .try_for_each(|value| in_range("joints_rad", *value, -6.34..=6.34, "-6.34 to 6.34"))
}

pub(crate) fn in_range(
    field: &'static str,
    value: f64,
    allowed: RangeInclusive<f64>,
    limit: &'static str,
) -> Result<(), Error> {
    if allowed.contains(&value) {
        Ok(())
    } else {
        Err(Error::Value {
            field,
            value,
            limit,
        })
    }
}
