//! Why the service refuses, and the one table that maps it to statuses.

use arthro_bootstrap::status;
use tonic::Status;

use crate::roll::profile::NoRoll;

/// A refused request. Each but [`Error::Invalid`] is a refusal by the state of the cell: nothing moved.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// Fields that are wrong whatever the state: (field, what is wrong with it).
    #[error("{}", .0.iter().map(|(field, fault)| format!("{field}: {fault}")).collect::<Vec<_>>().join("; "))]
    Invalid(Vec<(String, String)>),
    /// Lease, token or operation.
    #[error(transparent)]
    Authority(#[from] arthro_authority::Refusal),
    /// An operation of this id was refused before.
    #[error("{detail}")]
    Remembered {
        /// Its reason.
        reason: String,
        /// What it said.
        detail: String,
    },
    /// No link to the controller, or none that may command it.
    #[error("the controller of the {arm} arm at {address} is not connected: {why}")]
    NotConnected {
        /// Which arm.
        arm: &'static str,
        /// host:port.
        address: String,
        /// From [`link_reason`].
        reason: &'static str,
        /// What the last attempt ran into.
        why: String,
    },
    /// A move at speed 0 would begin whenever somebody raises the slider.
    #[error("the speed slider is at {:.1} %; a move needs more than 0", 100.0 * .fraction)]
    SpeedSlider {
        /// 0 .. 1.
        fraction: f64,
    },
    /// A move that would last for hours.
    #[error("the move would last {duration_s:.0} s; limit {limit_s:.0} s")]
    TooSlow {
        /// At nominal speed.
        duration_s: f64,
        /// Limit.
        limit_s: f64,
    },
    /// A fault is latched.
    #[error("a fault is latched and must be recovered first: {reason}: {detail}")]
    Faulted {
        /// Its reason.
        reason: String,
        /// What it said.
        detail: String,
    },
    /// RecoverFault while the cause lasts.
    #[error("the cause of the fault lasts: {reason}: {detail}")]
    FaultLasts {
        /// Reason of the breach found now.
        reason: &'static str,
        /// What it says.
        detail: String,
    },
    /// The controller cannot take a move.
    #[error("the controller is not ready: {detail}")]
    NotReady {
        /// Why.
        detail: String,
    },
    /// More requests wait for the next controller cycle than may.
    #[error("too many requests wait for the controller")]
    Busy,
    /// The arm moves or is being stopped.
    #[error("the arm moves")]
    Moving,
    /// A move that waited when Stop came.
    #[error("a stop came before the move began")]
    Stopped,
    /// No portal stated.
    #[error("no portal is set")]
    PortalNotSet,
    /// Outside moves while inside.
    #[error("the tip is {depth_mm:.3} mm beyond the portal; limit 0 mm")]
    ToolInside {
        /// Measured depth.
        depth_mm: f64,
    },
    /// A move outside whose way leads inside.
    #[error("the way leads {depth_mm:.3} mm beyond the portal; limit 0 mm")]
    WayLeadsInside {
        /// Depth on the way.
        depth_mm: f64,
    },
    /// The shaft misses the portal.
    #[error("the shaft passes the portal at {deviation_mm:.3} mm; limit {limit_mm} mm")]
    ShaftOffPortal {
        /// Measured distance.
        deviation_mm: f64,
        /// `rcm_stop_mm`.
        limit_mm: f64,
    },
    /// Deeper than allowed.
    #[error("a depth of {depth_mm:.3} mm is asked for; limit {limit_mm} mm")]
    TooDeep {
        /// Depth asked for.
        depth_mm: f64,
        /// `depth_max_mm`.
        limit_mm: f64,
    },
    /// An insertion outwards or a retraction inwards.
    #[error("the depth is {from_mm:.3} mm and {to_mm:.3} mm is asked for; {must}")]
    Direction {
        /// Measured depth.
        from_mm: f64,
        /// Depth asked for.
        to_mm: f64,
        /// What the move must do.
        must: &'static str,
    },
    /// A pivot beyond a quarter turn, or a free move of half a turn.
    #[error("the move turns by {turn_rad:.3} rad; limit {limit_rad:.3} rad")]
    TurnTooWide {
        /// Angle from here to the end.
        turn_rad: f64,
        /// Limit.
        limit_rad: f64,
    },
    /// No joints reach a pose on the way.
    #[error("the arm does not reach the pose at {percent:.0} % of the way")]
    OutOfReach {
        /// Where.
        percent: f64,
    },
    /// Joints would have to go beyond their travel.
    #[error("a joint reaches its limit at {percent:.0} % of the way")]
    JointLimit {
        /// Where.
        percent: f64,
    },
    /// No roll about the shaft takes the arm along the way.
    #[error(transparent)]
    NoRoll(#[from] NoRoll),
    /// The way passes a singularity or changes the branch.
    #[error(
        "joint {joint} would jump by {jump_rad:.3} rad at {percent:.0} % of the way; limit {limit_rad} rad"
    )]
    JointJump {
        /// 1 to 6.
        joint: usize,
        /// By how much.
        jump_rad: f64,
        /// Limit.
        limit_rad: f64,
        /// Where.
        percent: f64,
    },
    /// The planned shaft leaves the portal.
    #[error(
        "the planned shaft misses the portal by {deviation_mm:.2e} mm; limit {limit_mm:.0e} mm"
    )]
    RcmDeviation {
        /// By how much.
        deviation_mm: f64,
        /// Limit.
        limit_mm: f64,
    },
    /// A body would pass a plane that the arm keeps to.
    #[error(
        "the {body} has {room_mm:.1} mm of room to the plane {plane} at {percent:.0} % of the way; limit {limit_mm:.1} mm"
    )]
    Workspace {
        /// Its name.
        plane: String,
        /// Which body.
        body: &'static str,
        /// Its free room, mm; negative beyond the plane.
        room_mm: f64,
        /// The least, mm.
        limit_mm: f64,
        /// Where.
        percent: f64,
    },
    /// A body would come too near to the other arm where it stands.
    #[error("the {} comes to {mm:.1} mm from the {} of the other arm at {percent:.0} % of the way; limit {limit_mm:.1} mm", .bodies[0], .bodies[1])]
    ArmsTooNear {
        /// Free room less what the bodies move between samples, mm.
        mm: f64,
        /// Limit.
        limit_mm: f64,
        /// The arm's own and the other's.
        bodies: [&'static str; 2],
        /// Where.
        percent: f64,
    },
    /// The same to the way that the other arm is on.
    #[error("the {} would come to {mm:.1} mm from the {} of the other arm on the way that it is on, at {percent:.0} % of the way; limit {limit_mm:.1} mm", .bodies[0], .bodies[1])]
    ArmBusyNearby {
        /// Free room less what the bodies move between samples, mm.
        mm: f64,
        /// Limit.
        limit_mm: f64,
        /// The arm's own and the other's.
        bodies: [&'static str; 2],
        /// Where.
        percent: f64,
    },
    /// The other arm has no link.
    #[error("nobody knows where the other arm is: its controller is not connected")]
    OtherArmUnknown,
    /// Nobody stated how the arms stand to each other.
    #[error(
        "nobody has stated where the other arm stands: motion.layout must be measured or apart"
    )]
    LayoutUnknown,
    /// A fault inside was acknowledged.
    #[error(
        "after {fault} the tip, {depth_mm:.3} mm beyond the portal, may only be drawn back; limit 0 mm"
    )]
    RetractOnly {
        /// Reason of the fault.
        fault: &'static str,
        /// Measured depth.
        depth_mm: f64,
    },
    /// A portal where the arm itself is.
    #[error(
        "the portal is {radius_mm:.1} mm from the axis of the base; must be at least {limit_mm} mm"
    )]
    PortalInBase {
        /// Distance to the axis.
        radius_mm: f64,
        /// Least distance.
        limit_mm: f64,
    },
    /// A shaft that would lean too far from the portal's axis.
    #[error(
        "the shaft would lean {lean_rad:.3} rad from the portal's axis; limit {limit_rad:.3} rad"
    )]
    Cone {
        /// Angle to the axis.
        lean_rad: f64,
        /// `cone_max_rad`.
        limit_rad: f64,
    },
    /// A planned joint is too fast near a singularity.
    #[error("a joint would move at {speed_rad_s:.3} rad/s; limit {limit_rad_s} rad/s")]
    JointSpeed {
        /// Planned speed.
        speed_rad_s: f64,
        /// `joint_speed_rad_s`.
        limit_rad_s: f64,
    },
    /// No time law keeps the limits.
    #[error("the path cannot be timed: {detail}")]
    NoTiming {
        /// Why.
        detail: String,
    },
    /// Poses that teach nothing sure.
    #[error(transparent)]
    Teaching(#[from] crate::teach::Refusal),
    /// The owner of the arm has ended.
    #[error("the service is shutting down")]
    Gone,
}

impl Error {
    /// One wrong field.
    pub fn invalid(field: impl Into<String>, fault: impl Into<String>) -> Self {
        Self::Invalid(vec![(field.into(), fault.into())])
    }

    /// The stable word for programs.
    pub fn reason(&self) -> &str {
        match self {
            Self::Invalid(_) => "INVALID_ARGUMENT",
            Self::Authority(refusal) => refusal.reason(),
            Self::Remembered { reason, .. } => reason,
            Self::NotConnected { reason, .. } => reason,
            Self::SpeedSlider { .. } => "SPEED_SLIDER_ZERO",
            Self::TooSlow { .. } => "TOO_SLOW",
            Self::Faulted { .. } => "FAULT_LATCHED",
            Self::FaultLasts { reason, .. } => reason,
            Self::NotReady { .. } => "CONTROLLER_NOT_READY",
            Self::Busy => "TOO_MANY_REQUESTS",
            Self::Moving => "ARM_MOVING",
            Self::Stopped => "STOPPED",
            Self::PortalNotSet => "PORTAL_NOT_SET",
            Self::ToolInside { .. } => "TOOL_INSIDE",
            Self::WayLeadsInside { .. } => "WAY_LEADS_INSIDE",
            Self::ShaftOffPortal { .. } => "SHAFT_OFF_PORTAL",
            Self::TooDeep { .. } => "TOO_DEEP",
            Self::Direction { .. } => "WRONG_DIRECTION",
            Self::TurnTooWide { .. } => "TURN_TOO_WIDE",
            Self::OutOfReach { .. } => "OUT_OF_REACH",
            Self::JointLimit { .. } | Self::JointJump { .. } => "JOINT_LIMIT",
            Self::NoRoll(no) => no.reason(),
            Self::RcmDeviation { .. } => "RCM_DEVIATION",
            Self::Workspace { .. } => "WORKSPACE",
            Self::ArmsTooNear { .. } => "ARMS_TOO_NEAR",
            Self::ArmBusyNearby { .. } => "ARM_BUSY_NEARBY",
            Self::OtherArmUnknown => "OTHER_ARM_UNKNOWN",
            Self::LayoutUnknown => "LAYOUT_UNKNOWN",
            Self::RetractOnly { .. } => "RETRACT_ONLY",
            Self::Teaching(refusal) => refusal.reason(),
            Self::PortalInBase { .. } => "PORTAL_IN_BASE",
            Self::Cone { .. } => "CONE",
            Self::JointSpeed { .. } => "JOINT_SPEED",
            Self::NoTiming { .. } => "NO_TIMING",
            Self::Gone => "SHUTTING_DOWN",
        }
    }

    fn metadata(&self) -> Vec<(&'static str, String)> {
        match self {
            Self::Authority(refusal) => refusal.metadata(),
            Self::NotConnected { arm, address, .. } => {
                vec![("arm", (*arm).to_owned()), ("address", address.clone())]
            }
            Self::Faulted { reason, detail } => {
                vec![
                    ("fault_reason", reason.clone()),
                    ("fault_detail", detail.clone()),
                ]
            }
            Self::ToolInside { depth_mm } | Self::WayLeadsInside { depth_mm } => {
                vec![("depth_mm", depth_mm.to_string()), ("limit_mm", "0".into())]
            }
            Self::ShaftOffPortal {
                deviation_mm,
                limit_mm,
            }
            | Self::RcmDeviation {
                deviation_mm,
                limit_mm,
            } => {
                vec![
                    ("deviation_mm", deviation_mm.to_string()),
                    ("limit_mm", limit_mm.to_string()),
                ]
            }
            Self::TooDeep { depth_mm, limit_mm } => {
                vec![
                    ("depth_mm", depth_mm.to_string()),
                    ("limit_mm", limit_mm.to_string()),
                ]
            }
            Self::Direction { from_mm, to_mm, .. } => {
                vec![
                    ("depth_mm", from_mm.to_string()),
                    ("asked_mm", to_mm.to_string()),
                ]
            }
            Self::TurnTooWide {
                turn_rad,
                limit_rad,
            } => vec![
                ("turn_rad", turn_rad.to_string()),
                ("limit_rad", limit_rad.to_string()),
            ],
            Self::OutOfReach { percent } | Self::JointLimit { percent } => {
                vec![("percent_of_way", percent.to_string())]
            }
            Self::NoRoll(NoRoll::Ends { percent, .. }) => {
                vec![("percent_of_way", percent.to_string())]
            }
            Self::JointJump {
                joint,
                jump_rad,
                limit_rad,
                ..
            } => vec![
                ("joint", joint.to_string()),
                ("jump_rad", jump_rad.to_string()),
                ("limit_rad", limit_rad.to_string()),
            ],
            Self::Workspace {
                plane,
                body,
                room_mm,
                limit_mm,
                percent,
            } => vec![
                ("plane", plane.clone()),
                ("body", (*body).to_owned()),
                ("room_mm", room_mm.to_string()),
                ("limit_mm", limit_mm.to_string()),
                ("percent_of_way", percent.to_string()),
            ],
            Self::ArmsTooNear {
                mm,
                limit_mm,
                bodies: [own, others],
                percent,
            }
            | Self::ArmBusyNearby {
                mm,
                limit_mm,
                bodies: [own, others],
                percent,
            } => vec![
                ("distance_mm", mm.to_string()),
                ("limit_mm", limit_mm.to_string()),
                ("body", (*own).to_owned()),
                ("other_body", (*others).to_owned()),
                ("percent_of_way", percent.to_string()),
            ],
            Self::RetractOnly { fault, depth_mm } => vec![
                ("fault_reason", (*fault).to_owned()),
                ("depth_mm", depth_mm.to_string()),
            ],
            Self::Teaching(refusal) => refusal.metadata(),
            Self::PortalInBase {
                radius_mm,
                limit_mm,
            } => vec![
                ("radius_mm", radius_mm.to_string()),
                ("limit_mm", limit_mm.to_string()),
            ],
            Self::Cone {
                lean_rad,
                limit_rad,
            } => vec![
                ("lean_rad", lean_rad.to_string()),
                ("limit_rad", limit_rad.to_string()),
            ],
            Self::JointSpeed {
                speed_rad_s,
                limit_rad_s,
            } => vec![
                ("speed_rad_s", speed_rad_s.to_string()),
                ("limit_rad_s", limit_rad_s.to_string()),
            ],
            _ => Vec::new(),
        }
    }
}

/// The stable word for why there is no link.
pub fn link_reason(error: &ur_link::Error) -> &'static str {
    match error {
        ur_link::Error::InUse { .. } => "CONTROLLER_IN_USE",
        ur_link::Error::TooOld { .. } => "CONTROLLER_FIRMWARE",
        ur_link::Error::WrongRobot { .. } => "WRONG_ROBOT",
        ur_link::Error::LocalControl => "LOCAL_CONTROL",
        ur_link::Error::NotReady { .. } => "CONTROLLER_NOT_READY",
        _ => "NOT_CONNECTED",
    }
}

impl From<Error> for Status {
    fn from(error: Error) -> Self {
        let message = error.to_string();
        match &error {
            Error::Invalid(violations) => return status::invalid_all(violations.clone()),
            Error::Authority(refusal) => {
                if let Some(field) = refusal.field() {
                    return status::invalid(field, message);
                }
            }
            _ => {}
        }
        let metadata = error.metadata();
        match error {
            Error::Gone => status::unavailable(error.reason(), message, &metadata),
            Error::Busy | Error::Authority(arthro_authority::Refusal::TooManyOperations { .. }) => {
                status::exhausted(error.reason(), message, &metadata)
            }
            _ => status::refused(error.reason(), message, &metadata),
        }
    }
}
