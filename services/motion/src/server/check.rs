//! The dry run of targets: nothing moves.

use arthro_geometry::Point3;
use arthro_proto::motion::v1 as proto;

use super::fields::Fields;
use super::{Arm, Which};
use crate::check::{Checked, DryRun, Method, Order};
use crate::error::Error;
use crate::rcm::Portal;
use crate::rcm::paper::Formula;
use crate::roll::Choice;

/// Most targets of one dry run.
const TARGETS_MAX: usize = 1000;

/// What is asked for.
pub struct Checking {
    targets: Vec<Point3>,
    portal: Option<Portal>,
    method: Method,
    order: Order,
    roll: Choice,
}

/// Reads a request.
pub fn read(request: proto::CheckMotionRequest) -> Result<(Which, Checking), Error> {
    use proto::{CheckOrder, ReachMethod};
    let mut found = Fields::default();
    let which = found.arm(request.arm);
    let count = request.targets.len();
    if !(1..=TARGETS_MAX).contains(&count) {
        let fault = format!("has {count} points; must have 1 .. {TARGETS_MAX}");
        found.wrong::<()>("targets", fault);
    }
    let point = request
        .portal
        .and_then(|portal| found.point("portal", Some(portal)));
    let axis = request.axis.and_then(|axis| found.direction("axis", axis));
    let mut targets = Vec::new();
    for (index, target) in request.targets.iter().take(TARGETS_MAX).enumerate() {
        targets.extend(found.point(&format!("targets[{index}]"), Some(*target)));
    }
    let method = match ReachMethod::try_from(request.method) {
        Ok(ReachMethod::Unspecified | ReachMethod::Rcm) => Some(Method::Rcm),
        Ok(ReachMethod::Paper) => Some(Method::Paper(Formula::Corrected)),
        Ok(ReachMethod::PaperAsPrinted) => Some(Method::Paper(Formula::AsPrinted)),
        Err(_) => found.wrong("method", format!("is {}; must be 0 .. 3", request.method)),
    };
    let order = match CheckOrder::try_from(request.order) {
        Ok(CheckOrder::Unspecified | CheckOrder::Any) => Some(Order::Any),
        Ok(CheckOrder::AsListed) => Some(Order::AsListed),
        Err(_) => found.wrong("order", format!("is {}; must be 0 .. 2", request.order)),
    };
    let roll = found.roll_choice("roll_choice", request.roll_choice);
    if roll == Some(Choice::Free) && matches!(method, Some(Method::Paper(_))) {
        let fault = "is ROLL_CHOICE_FREE; goes with REACH_METHOD_RCM only";
        found.wrong::<()>("roll_choice", fault);
    }
    let (((which, method), order), roll) = found.finish(which.zip(method).zip(order).zip(roll))?;
    let portal = match point {
        Some(point) => Some(Portal::new(point, axis)?),
        None => None,
    };
    let checking = Checking {
        targets,
        portal,
        method,
        order,
        roll,
    };
    Ok((which, checking))
}

impl Checking {
    /// Checks, off the threads that carry the stop.
    pub async fn run(self, arm: &Arm) -> Result<proto::CheckMotionResponse, Error> {
        let in_force = arm.handle.published().borrow().portal;
        let options = arm.handle.options();
        let dry_run = DryRun {
            arm: options.arm,
            limits: options.limits.clone(),
            neutral_joints_rad: arm.neutral_joints_rad,
            portal: self.portal.or(in_force).ok_or(Error::PortalNotSet)?,
            period_s: options.period_s,
            method: self.method,
            roll: self.roll,
            berth: options.berth.clone(),
        };
        let (targets, order) = (self.targets, self.order);
        let checked = tokio::task::spawn_blocking(move || dry_run.check_all(&targets, order))
            .await
            .map_err(|_| Error::Gone)?;
        let worst = Checked::worst(&checked).unwrap_or(0);
        Ok(proto::CheckMotionResponse {
            checks: checked.iter().map(message).collect(),
            worst_target: u32::try_from(worst).unwrap_or(u32::MAX),
        })
    }
}

fn message(checked: &Checked) -> proto::MotionCheck {
    let depth_mm = checked.depth_mm;
    match &checked.outcome {
        Ok(way) => {
            let (room, word) = way.least_room();
            proto::MotionCheck {
                reachable: true,
                joint_margin_rad: way.margins.joint_limit_rad,
                rcm_deviation_mm: way.margins.rcm_between_samples_mm,
                depth_mm,
                margins: Some(proto::MotionMargins {
                    joint_limit_rad: way.margins.joint_limit_rad,
                    wrist_rad: way.margins.singularities.wrist_rad,
                    elbow_rad: way.margins.singularities.elbow_rad,
                    shoulder_mm: way.margins.singularities.shoulder_mm,
                    manipulability_mm3: way.margins.manipulability_mm3,
                    cone_rad: way.cone_rad,
                    depth_mm: way.depth_mm,
                    rcm_at_samples_mm: way.margins.rcm_at_samples_mm,
                    rcm_between_samples_mm: way.margins.rcm_between_samples_mm,
                    joint_speed_rad_s: way.margins.joint_speed_rad_s,
                    duration_s: way.duration_s,
                    worst: word.to_owned(),
                    room,
                }),
                ..proto::MotionCheck::default()
            }
        }
        Err(error) => proto::MotionCheck {
            reachable: false,
            reason: error.reason().to_owned(),
            detail: error.to_string(),
            depth_mm,
            rcm_deviation_mm: match error {
                Error::RcmDeviation { deviation_mm, .. } => *deviation_mm,
                _ => 0.0,
            },
            ..proto::MotionCheck::default()
        },
    }
}
