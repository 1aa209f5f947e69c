//! A move under way: what to command next, how far it is, and when it has arrived.

use arthro_geometry::Rigid;
use arthro_geometry::frame::{Base, Tool};
use tokio::sync::watch;
use ur_link::{Command, State};

use crate::command::{Authorization, Progress};
use crate::kinematics::{Joints, ToolArm, largest_difference};
use crate::limits::Limits;
use crate::plan::Plan;
use crate::supervisor::{Observation, Regime};
use crate::trajectory::Trajectory;

/// How fast the rate of a stream follows the controller's speed scaling, 1/s.
const RATE_SLEW_PER_S: f64 = 2.0;
/// A stream advances by at most this many periods a state: late states stretch it and skip nothing.
const ADVANCE_MAX_PERIODS: f64 = 1.5;
/// A joint this near to its target has arrived, rad: 0.1 mm at a lever of 300 mm.
const ARRIVED_RAD: f64 = 3e-4;
/// A tip this near to its target has arrived, mm.
const ARRIVED_MM: f64 = 0.3;
/// A joint slower than this stands, rad/s.
pub const STANDING_RAD_S: f64 = 0.005;
/// Controller time for arriving once the last target was commanded, s.
const SETTLE_S: f64 = 2.0;

/// One move of one arm.
pub struct Motion {
    /// Who asked for it.
    pub by: Authorization,
    course: Course,
    progress: watch::Sender<Progress>,
    fraction: f64,
    rcm_deviation_max_mm: f64,
    /// Controller time at which the last target was commanded.
    settling_since_s: Option<f64>,
}

/// What a controller cycle of a motion comes to.
pub enum Step {
    /// Send this.
    Go(Command),
    /// It is there.
    Arrived,
    /// It cannot go on: reason and detail.
    Failed(&'static str, String),
}

enum Course {
    Stream {
        trajectory: Box<Trajectory>,
        regime: Regime,
        time_s: f64,
        rate: Option<f64>,
        joints: Joints,
    },
    Controller {
        command: Command,
        target: Target,
        extent: f64,
        sent: bool,
    },
}

/// Where the controller's own move ends.
enum Target {
    Tool(Rigid<Base, Tool>),
    Joints(Joints),
}

impl Motion {
    /// Begins a plan from the commanded joints `start`.
    pub fn new(
        by: Authorization,
        plan: Plan,
        start: Joints,
        arm: &ToolArm,
        limits: &Limits,
    ) -> (Self, watch::Receiver<Progress>) {
        let course = match plan {
            Plan::Stream { trajectory, regime } => Course::Stream {
                trajectory,
                regime,
                time_s: 0.0,
                rate: None,
                joints: start,
            },
            Plan::Line {
                base_from_tool,
                speed_mm_s,
            } => {
                let from = arm.base_from_tool(&start);
                Course::Controller {
                    command: Command::MoveL {
                        base_from_tool: pose_m_rotvec(&base_from_tool),
                        speed_m_s: speed_mm_s * 1e-3,
                        accel_m_s2: limits.free_acceleration_mm_s2 * 1e-3,
                    },
                    extent: (base_from_tool.origin() - from.origin()).norm(),
                    target: Target::Tool(base_from_tool),
                    sent: false,
                }
            }
            Plan::Joints {
                joints_rad,
                speed_rad_s,
            } => Course::Controller {
                command: Command::MoveJ {
                    joints_rad,
                    speed_rad_s,
                    accel_rad_s2: limits.joint_acceleration_rad_s2,
                },
                extent: largest_difference(&joints_rad, &start).1,
                target: Target::Joints(joints_rad),
                sent: false,
            },
        };
        let (progress, follow) = watch::channel(Progress {
            operation: by.running(),
            fraction: 0.0,
            rcm_deviation_max_mm: 0.0,
        });
        let motion = Self {
            by,
            course,
            progress,
            fraction: 0.0,
            rcm_deviation_max_mm: 0.0,
            settling_since_s: None,
        };
        (motion, follow)
    }

    /// Which rules hold for it.
    pub fn regime(&self) -> Regime {
        match &self.course {
            Course::Stream { regime, .. } => *regime,
            Course::Controller { .. } => Regime::Outside,
        }
    }

    /// Takes note of what was measured, and decides what to command.
    pub fn step(&mut self, state: &State, seen: &Observation, period_s: f64) -> Step {
        if let Some(placement) = seen.placement.filter(|_| seen.inside) {
            self.rcm_deviation_max_mm = self.rcm_deviation_max_mm.max(placement.deviation_mm());
        }
        let advance_s = seen.gap_s.clamp(0.0, ADVANCE_MAX_PERIODS * period_s);
        let (commanded_all, arrived, command) = match &mut self.course {
            Course::Stream {
                trajectory,
                time_s,
                rate,
                joints,
                ..
            } => {
                let scaling = state.speed_scaling.clamp(0.0, 1.0);
                let slew = RATE_SLEW_PER_S * advance_s;
                let now = rate.map_or(scaling, |rate| rate + (scaling - rate).clamp(-slew, slew));
                *rate = Some(now);
                *time_s += advance_s * now;
                match trajectory.sample(*time_s, joints) {
                    Ok(next) => *joints = next,
                    Err(error) => return Step::Failed("NO_SAMPLE", error.to_string()),
                }
                self.fraction = trajectory.fraction(*time_s);
                let done = *time_s >= trajectory.duration_s();
                let arrived = largest_difference(joints, &state.actual_q).1 <= ARRIVED_RAD;
                let command = Command::Servo {
                    joints_rad: *joints,
                };
                (done, arrived, command)
            }
            Course::Controller {
                command,
                target,
                extent,
                sent,
            } => {
                let done = *sent && state.program.finished();
                *sent = true;
                let (left, near) = match target {
                    Target::Tool(end) => {
                        let left = (end.origin() - seen.base_from_tool.origin()).norm();
                        (left, ARRIVED_MM)
                    }
                    Target::Joints(end) => {
                        let left = largest_difference(end, &state.actual_q).1;
                        (left, ARRIVED_RAD)
                    }
                };
                let fraction = 1.0 - left / extent.max(near);
                self.fraction = self.fraction.max(fraction.clamp(0.0, 1.0));
                (done, left <= near, *command)
            }
        };
        self.publish();
        if !commanded_all {
            return Step::Go(command);
        }
        let since_s = *self.settling_since_s.get_or_insert(state.timestamp_s);
        if arrived && stands(state) {
            self.fraction = 1.0;
            return Step::Arrived;
        }
        if state.timestamp_s - since_s > SETTLE_S {
            let detail = format!("the arm has not come to stand at its target within {SETTLE_S} s");
            return Step::Failed("TARGET_MISSED", detail);
        }
        Step::Go(command)
    }

    /// For people: what was measured on the way.
    pub fn summary(&self) -> String {
        match self.regime() {
            Regime::Standing | Regime::Outside => {
                format!("{:.0} % of the way", 100.0 * self.fraction)
            }
            Regime::Inward | Regime::Outward => format!(
                "{:.0} % of the way, the shaft at most {:.4} mm from the portal while inside",
                100.0 * self.fraction,
                self.rcm_deviation_max_mm
            ),
        }
    }

    /// Tells those that follow how it ended.
    pub fn end(self, operation: arthro_authority::Operation) {
        self.progress.send_replace(Progress {
            operation,
            fraction: self.fraction,
            rcm_deviation_max_mm: self.rcm_deviation_max_mm,
        });
    }

    fn publish(&self) {
        self.progress.send_modify(|progress| {
            progress.fraction = self.fraction;
            progress.rcm_deviation_max_mm = self.rcm_deviation_max_mm;
        });
    }
}

/// Whether no joint moves.
pub fn stands(state: &State) -> bool {
    state
        .actual_qd
        .iter()
        .all(|speed| speed.abs() <= STANDING_RAD_S)
}

/// The driver's form of a pose: m and rotation vector.
fn pose_m_rotvec(base_from_tool: &Rigid<Base, Tool>) -> [f64; 6] {
    let tip = base_from_tool.translation_mm() * 1e-3;
    let rotation = base_from_tool.rotation().scaled_axis();
    [tip.x, tip.y, tip.z, rotation.x, rotation.y, rotation.z]
}
