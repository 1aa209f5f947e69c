//! Messages to domain values, collecting what is wrong by field; and back.

use arthro_authority::{Lease, Operation, OperationState};
use arthro_geometry::frame::Frame;
use arthro_geometry::nalgebra::{Quaternion, Unit, UnitQuaternion};
use arthro_geometry::{Point3, Rigid, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::motion::v1 as proto;

use super::Which;
use crate::arm::{ArmState, Fault};
use crate::command::Authorization;
use crate::config::QUATERNION_TOLERANCE;
use crate::error::Error;
use crate::kinematics::Joints;
use crate::limits::Limits;
use crate::plan::inside::OUTSIDE_MAX_MM;
use crate::plan::{Aim, Move, Roll};
use crate::roll::Choice;

/// Farthest coordinate that is no mistake, mm.
const COORDINATE_MAX_MM: f64 = 10_000.0;
/// Slowest speeds that are no mistake.
const SPEED_MIN_MM_S: f64 = 0.1;
const SPEED_MIN_RAD_S: f64 = 0.001;

/// The violations found so far.
#[derive(Default)]
pub struct Fields(Vec<(String, String)>);

impl Fields {
    /// The value, unless anything was wrong.
    pub fn finish<T>(self, value: Option<T>) -> Result<T, Error> {
        match value {
            Some(value) if self.0.is_empty() => Ok(value),
            _ => Err(Error::Invalid(self.0)),
        }
    }

    /// Notes a violation.
    pub fn wrong<T>(&mut self, field: &str, fault: impl Into<String>) -> Option<T> {
        self.0.push((field.to_owned(), fault.into()));
        None
    }

    pub fn arm(&mut self, arm: i32) -> Option<Which> {
        match common::Arm::try_from(arm) {
            Ok(common::Arm::Forceps) => Some(Which::Forceps),
            Ok(common::Arm::Arthroscope) => Some(Which::Arthroscope),
            _ => self.wrong(
                "arm",
                format!("is {arm}; must be ARM_FORCEPS or ARM_ARTHROSCOPE"),
            ),
        }
    }

    pub fn authorization(&mut self, by: Option<common::Authorization>) -> Option<Authorization> {
        match by {
            Some(by) => Some(Authorization {
                fencing_token: by.fencing_token,
                operation_id: by.operation_id,
            }),
            None => self.wrong("authorization", "is missing"),
        }
    }

    pub fn point(&mut self, field: &str, point: Option<common::Point>) -> Option<Point3> {
        let Some(common::Point { x_mm, y_mm, z_mm }) = point else {
            return self.wrong(field, "is missing");
        };
        for (name, value) in [("x_mm", x_mm), ("y_mm", y_mm), ("z_mm", z_mm)] {
            // A NaN is in no range.
            if !(..=COORDINATE_MAX_MM).contains(&value.abs()) {
                let limit = COORDINATE_MAX_MM;
                let fault = format!("is {value} mm; must be within -{limit} .. {limit} mm");
                return self.wrong(&format!("{field}.{name}"), fault);
            }
        }
        Some(Point3::new(x_mm, y_mm, z_mm))
    }

    pub fn direction(
        &mut self,
        field: &str,
        direction: common::Direction,
    ) -> Option<Unit<Vector3>> {
        let vector = Vector3::new(direction.x, direction.y, direction.z);
        let length = vector.norm();
        if !(..=QUATERNION_TOLERANCE).contains(&(length - 1.0).abs()) {
            let fault = format!("has length {length}; must be 1 within {QUATERNION_TOLERANCE}");
            return self.wrong(field, fault);
        }
        Some(Unit::new_normalize(vector))
    }

    pub fn pose<A: Frame, B: Frame>(
        &mut self,
        field: &str,
        pose: Option<common::Pose>,
    ) -> Option<Rigid<A, B>> {
        let Some(pose) = pose else {
            return self.wrong(field, "is missing");
        };
        let translation = self.point(&format!("{field}.translation"), pose.translation);
        let rotation_field = format!("{field}.rotation");
        let Some(common::Quaternion { w, x, y, z }) = pose.rotation else {
            return self.wrong(&rotation_field, "is missing");
        };
        let quaternion = Quaternion::new(w, x, y, z);
        let norm = quaternion.norm();
        if !(..=QUATERNION_TOLERANCE).contains(&(norm - 1.0).abs()) {
            let fault = format!("has norm {norm}; must be 1 within {QUATERNION_TOLERANCE}");
            return self.wrong(&rotation_field, fault);
        }
        let rotation = UnitQuaternion::from_quaternion(quaternion);
        Some(Rigid::new(rotation, translation?.coords))
    }

    pub fn roll_choice(&mut self, field: &str, choice: i32) -> Option<Choice> {
        match proto::RollChoice::try_from(choice) {
            Ok(proto::RollChoice::Unspecified | proto::RollChoice::Keep) => Some(Choice::Keep),
            Ok(proto::RollChoice::Free) => Some(Choice::Free),
            Err(_) => self.wrong(field, format!("is {choice}; must be 0 .. 2")),
        }
    }

    fn finite(&mut self, field: &str, value: f64) -> Option<f64> {
        if value.abs() <= COORDINATE_MAX_MM {
            Some(value)
        } else {
            let limit = COORDINATE_MAX_MM;
            self.wrong(
                field,
                format!("is {value}; must be within -{limit} .. {limit}"),
            )
        }
    }

    /// A speed, where 0 means the limit.
    fn speed(
        &mut self,
        field: &str,
        value: f64,
        (slowest, limit): (f64, f64),
        unit: &str,
    ) -> Option<Option<f64>> {
        if value == 0.0 {
            Some(None)
        } else if (slowest..=limit).contains(&value) {
            Some(Some(value))
        } else {
            let fault =
                format!("is {value} {unit}; must be 0 or within {slowest} .. {limit} {unit}");
            self.wrong(field, fault)
        }
    }

    pub fn joints(&mut self, field: &str, joints: &[f64]) -> Option<Joints> {
        let Ok(joints) = Joints::try_from(joints) else {
            return self.wrong(field, format!("has {} angles; must have 6", joints.len()));
        };
        match joints.iter().position(|joint| !joint.is_finite()) {
            Some(index) => self.wrong(
                &format!("{field}[{index}]"),
                format!("is {}; must be finite", joints[index]),
            ),
            None => Some(joints),
        }
    }

    pub fn motion(
        &mut self,
        motion: Option<&proto::move_request::Motion>,
        limits: &Limits,
    ) -> Option<Move> {
        use proto::move_request::Motion;
        let tip_inside = (SPEED_MIN_MM_S, limits.inside_speed_mm_s);
        match motion {
            None => self.wrong(
                "motion",
                "is missing; must be free, pivot, insert, retract, rcm or joint",
            ),
            Some(Motion::Free(free)) => {
                let pose = self.pose("free.base_from_tool", free.base_from_tool);
                let range = (SPEED_MIN_MM_S, limits.free_speed_mm_s);
                let speed = self.speed("free.speed_mm_s", free.speed_mm_s, range, "mm/s");
                Some(Move::Free {
                    base_from_tool: pose?,
                    speed_mm_s: speed?,
                })
            }
            Some(Motion::Pivot(pivot)) => {
                let aim = self.point("pivot.aim", pivot.aim);
                let range = (SPEED_MIN_RAD_S, limits.pivot_speed_rad_s);
                let speed = self.speed("pivot.speed_rad_s", pivot.speed_rad_s, range, "rad/s");
                Some(Move::Pivot {
                    aim: aim?,
                    speed_rad_s: speed?,
                })
            }
            Some(Motion::Insert(insert)) => {
                let depth = self.finite("insert.depth_mm", insert.depth_mm);
                let speed = self.speed("insert.speed_mm_s", insert.speed_mm_s, tip_inside, "mm/s");
                Some(Move::Insert {
                    depth_mm: depth?,
                    speed_mm_s: speed?,
                })
            }
            Some(Motion::Retract(retract)) => {
                let depth = self.finite("retract.depth_mm", retract.depth_mm);
                let speed =
                    self.speed("retract.speed_mm_s", retract.speed_mm_s, tip_inside, "mm/s");
                Some(Move::Retract {
                    depth_mm: depth?,
                    speed_mm_s: speed?,
                })
            }
            Some(Motion::Rcm(rcm)) => self.rcm(rcm, limits),
            Some(Motion::Joint(joint)) => {
                let joints = self.joints("joint.joints_rad", &joint.joints_rad);
                let range = (SPEED_MIN_RAD_S, limits.joint_speed_rad_s);
                let speed = self.speed("joint.speed_rad_s", joint.speed_rad_s, range, "rad/s");
                Some(Move::Joints {
                    joints_rad: joints?,
                    speed_rad_s: speed?,
                })
            }
        }
    }
}

impl Fields {
    fn rcm(&mut self, rcm: &proto::RcmMove, limits: &Limits) -> Option<Move> {
        use proto::rcm_move::Target;
        let aim = match rcm.target {
            None => Some(None),
            Some(Target::Aim(aim)) => {
                let aim = self.point("rcm.aim", Some(aim));
                aim.map(|aim| Some(Aim::Point(aim)))
            }
            Some(Target::Direction(direction)) => {
                let direction = self.direction("rcm.direction", direction);
                direction.map(|direction| Some(Aim::Direction(direction)))
            }
        };
        let depth_mm = if (-OUTSIDE_MAX_MM..=COORDINATE_MAX_MM).contains(&rcm.depth_mm) {
            Some(rcm.depth_mm)
        } else {
            let (depth_mm, limit) = (rcm.depth_mm, limits.depth_max_mm);
            let fault = format!("is {depth_mm} mm; must be within -{OUTSIDE_MAX_MM} .. {limit} mm");
            self.wrong("rcm.depth_mm", fault)
        };
        let roll_rad = match rcm.roll_rad {
            Some(roll_rad) => self.finite("rcm.roll_rad", roll_rad).map(Some),
            None => Some(None),
        };
        let choice = self.roll_choice("rcm.roll_choice", rcm.roll_choice);
        let roll = match choice.zip(roll_rad) {
            None => None,
            Some((Choice::Keep, None)) => Some(Roll::Kept),
            Some((Choice::Keep, Some(roll_rad))) => Some(Roll::To(roll_rad)),
            Some((Choice::Free, None)) => Some(Roll::Free),
            Some((Choice::Free, Some(roll_rad))) => self.wrong(
                "rcm.roll_rad",
                format!("is {roll_rad} rad; must be unset with ROLL_CHOICE_FREE"),
            ),
        };
        let range = (SPEED_MIN_MM_S, limits.inside_speed_mm_s);
        let speed_mm_s = self.speed("rcm.speed_mm_s", rcm.speed_mm_s, range, "mm/s");
        let range = (SPEED_MIN_RAD_S, limits.pivot_speed_rad_s);
        let speed_rad_s = self.speed("rcm.speed_rad_s", rcm.speed_rad_s, range, "rad/s");
        Some(Move::Rcm {
            aim: aim?,
            depth_mm: depth_mm?,
            roll: roll?,
            speed_mm_s: speed_mm_s?,
            speed_rad_s: speed_rad_s?,
        })
    }
}

pub fn direction(direction: &Vector3) -> common::Direction {
    common::Direction {
        x: direction.x,
        y: direction.y,
        z: direction.z,
    }
}

pub fn point(point: &Point3) -> common::Point {
    common::Point {
        x_mm: point.x,
        y_mm: point.y,
        z_mm: point.z,
    }
}

pub fn pose<A: Frame, B: Frame>(a_from_b: &Rigid<A, B>) -> common::Pose {
    let rotation = a_from_b.rotation();
    common::Pose {
        rotation: Some(common::Quaternion {
            w: rotation.w,
            x: rotation.i,
            y: rotation.j,
            z: rotation.k,
        }),
        translation: Some(point(&a_from_b.origin())),
    }
}

pub fn limits(limits: &Limits) -> proto::MotionLimits {
    proto::MotionLimits {
        rcm_stop_mm: limits.rcm_stop_mm,
        free_speed_mm_s: limits.free_speed_mm_s,
        inside_speed_mm_s: limits.inside_speed_mm_s,
        pivot_speed_rad_s: limits.pivot_speed_rad_s,
        joint_speed_rad_s: limits.joint_speed_rad_s,
        depth_max_mm: limits.depth_max_mm,
        cone_max_rad: limits.cone_max_rad,
    }
}

pub fn lease(lease: &Lease) -> common::Lease {
    common::Lease {
        fencing_token: lease.fencing_token,
        holder: lease.holder.clone(),
        ttl_s: lease.ttl.as_secs_f64(),
    }
}

pub fn operation(operation: &Operation, repeated: bool) -> common::Operation {
    let state = match operation.state {
        OperationState::Running => common::OperationState::Running,
        OperationState::Done => common::OperationState::Done,
        OperationState::Failed => common::OperationState::Failed,
        OperationState::Stopped => common::OperationState::Stopped,
        OperationState::InDoubt => common::OperationState::InDoubt,
    };
    common::Operation {
        operation_id: operation.id.clone(),
        state: state.into(),
        reason: operation.reason.clone(),
        detail: operation.detail.clone(),
        repeated,
    }
}

pub fn arm_state(which: Which, state: &ArmState) -> proto::ArmState {
    let placement = state.placement.as_ref();
    let words = |fault: &Option<Fault>| match fault {
        Some(fault) => (fault.reason.to_owned(), fault.detail.clone()),
        None => Default::default(),
    };
    let (fault_reason, fault_detail) = words(&state.fault);
    let (warning_reason, warning_detail) = words(&state.warning);
    proto::ArmState {
        arm: which.on_the_wire().into(),
        controller_time_s: state.time_s,
        joints_rad: state.joints_rad.to_vec(),
        base_from_tool: Some(pose(&state.base_from_tool)),
        robot_mode: state.robot_mode.to_string(),
        safety_mode: state.safety_mode.to_string(),
        moving: state.moving,
        inside: state.inside,
        depth_mm: placement.map_or(0.0, |placement| placement.depth_mm),
        rcm_deviation_mm: placement.map_or(0.0, |placement| placement.deviation_mm()),
        fault_reason,
        fault_detail,
        warning_reason,
        warning_detail,
        speed_scaling: state.speed_scaling,
        operation_id: state.operation_id.clone().unwrap_or_default(),
        connected: state.connected,
        states_missed: state.states_missed,
    }
}
