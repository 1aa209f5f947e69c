//! Why a plan is refused, and the one table that maps it to a status.

use arthro_bootstrap::status;
use arthro_geometry::{Point3, volume};
use tonic::Status;

use crate::contour;
use crate::reach::{Measure, Obstruction};
use crate::server::view;
use crate::view::Blind;

/// Why there is no plan.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A value that cannot be right whatever the model.
    #[error("{field} {problem}")]
    Invalid {
        /// The field of the request.
        field: &'static str,
        /// Value and limit.
        problem: String,
    },
    /// A bite of a list that is none.
    #[error("bites[{index}].approach {problem}")]
    Bite {
        /// Its position, from 0.
        index: usize,
        /// Value and limit.
        problem: String,
    },
    /// The surface is no solid.
    #[error(transparent)]
    Surface(#[from] volume::Error),
    /// The points have no spline.
    #[error(transparent)]
    Contour(#[from] contour::Error),
    /// The surface has no free edge and rim around an opening.
    #[error("the surface is no crescent: {problem}")]
    NotACrescent {
        /// What is missing, with numbers.
        problem: String,
    },
    /// The search ended without reaching the goal.
    #[error("no path to the goal after {iterations} iterations, {left_mm:.1} mm are left")]
    NoPath {
        /// Iterations made.
        iterations: u32,
        /// Distance from the nearest node to the goal, mm.
        left_mm: f64,
    },
    /// The contour comes closer to the rim than allowed.
    #[error(
        "the contour leaves a rim of {rim_mm:.2} mm < {limit_mm} mm at {:.0} deg, ({:.1}, {:.1}, {:.1}) mm; possible with {}",
        angle_rad.to_degrees(), at.x, at.y, at.z, rim_remedy(*rim_mm, *limit_mm)
    )]
    RimBelowLimit {
        /// Rim left, mm.
        rim_mm: f64,
        /// Rim demanded, mm.
        limit_mm: f64,
        /// Where, in ct, mm.
        at: Point3,
        /// Where about the centre of the crescent, 0 in the middle of the body.
        angle_rad: f64,
    },
    /// Lesion points that are not in the model.
    #[error(
        "{outside_percent:.1} % of the lesion lie outside the model, up to {farthest_mm:.1} mm or more away; the limit is {limit_percent} %"
    )]
    LesionOutsideModel {
        /// Share of the points, percent.
        outside_percent: f64,
        /// How far, mm, as far as looked.
        farthest_mm: f64,
        /// Share allowed, percent.
        limit_percent: f64,
    },
    /// The contour does not go around the lesion.
    #[error(
        "{beyond_percent:.1} % of the lesion lie outboard of the contour or beyond its ends; the limit is {limit_percent} %"
    )]
    LesionBeyondPath {
        /// Share of the points, percent.
        beyond_percent: f64,
        /// Share allowed, percent.
        limit_percent: f64,
    },
    /// The contour runs along the free edge.
    #[error("{region_mm3:.2} mm3 lie inboard of the contour, the least is {limit_mm3} mm3")]
    NothingToRemove {
        /// Volume of the region, mm3.
        region_mm3: f64,
        /// Least volume worth a bite, mm3.
        limit_mm3: f64,
    },
    /// Every bite that would clear some of the region has its centre outside the target box or cuts
    /// the rim that must be left.
    #[error("no bite inside the target box clears any of the {region_mm3:.2} mm3 to be removed")]
    NoBite {
        /// Volume of the region, mm3.
        region_mm3: f64,
    },
    /// Tissue that stays whatever is bitten: no bite that keeps box, rim and reach meets it, or the
    /// throat of every such bite stays blocked.
    #[error(
        "{residual_mm3:.1} mm3 of the region around ({:.1}, {:.1}, {:.1}) mm stay whatever is bitten, the limit is {allowed_mm3:.1} mm3; {blocked_mm3:.1} mm3 of them because the jaw's throat stays blocked; {lesion_percent:.1} % of the lesion stay, of which nothing may; possible with a region of at most {possible_percent:.1} %, perhaps with another portal, or as a partial plan",
        at.x, at.y, at.z
    )]
    UnreachableTissue {
        /// What stays, mm3.
        residual_mm3: f64,
        /// What may stay, mm3.
        allowed_mm3: f64,
        /// Part of what stays for the sake of the throat, mm3.
        blocked_mm3: f64,
        /// Share of the lesion that stays, percent.
        lesion_percent: f64,
        /// Share of the region that goes if everything that can be bitten is, percent.
        possible_percent: f64,
        /// Its middle, in ct, mm.
        at: Point3,
    },
    /// No set of bites was found that clears the region and spares what lies outside it.
    #[error(
        "no bites were found that leave at most {allowed_mm3:.1} mm3 of the region and take at most {outside_limit_mm3:.1} mm3 outside it: the closest {bites} leave {residual_mm3:.1} mm3 around ({:.1}, {:.1}, {:.1}) mm and take {outside_mm3:.1} mm3; perhaps possible with another portal, more effort, another limit, or as a partial plan",
        at.x, at.y, at.z
    )]
    RegionNotCleared {
        /// How many bites the closest set has.
        bites: usize,
        /// What it leaves of the region, mm3.
        residual_mm3: f64,
        /// What may be left, mm3.
        allowed_mm3: f64,
        /// What it takes outside, mm3.
        outside_mm3: f64,
        /// What may be taken, mm3.
        outside_limit_mm3: f64,
        /// Middle of what is left, in ct, mm.
        at: Point3,
    },
    /// Something is in the way of a planned bite.
    #[error("bite {bite}: {obstruction}; {}", obstruction.cause.remedy())]
    BiteObstructed {
        /// Its position, from 0.
        bite: usize,
        /// What, in ct.
        obstruction: Obstruction,
    },
    /// Something is in the way of every bite that could clear what stays.
    #[error("{residual_mm3:.1} mm3 of the region cannot be reached: {obstruction}; {}", obstruction.cause.remedy())]
    TissueObstructed {
        /// What stays, mm3.
        residual_mm3: f64,
        /// What, in ct.
        obstruction: Obstruction,
    },
    /// The arthroscope does not see a bite.
    #[error("the arthroscope: {0}")]
    Blind(#[from] Blind),
    /// Time was up before there was a plan.
    #[error("the deadline came near before there was any plan")]
    Deadline,
    /// The caller went away.
    #[error("the caller went away")]
    Cancelled,
}

impl Error {
    /// A value that cannot be right whatever the model.
    pub fn invalid(field: &'static str, problem: impl Into<String>) -> Self {
        Self::Invalid {
            field,
            problem: problem.into(),
        }
    }

    /// The same about a bite of a list.
    pub fn of_bite(self, index: usize) -> Self {
        match self {
            Self::Invalid { problem, .. } => Self::Bite { index, problem },
            other => other,
        }
    }
}

/// What would let a contour keep the rim.
fn rim_remedy(rim_mm: f64, limit_mm: f64) -> String {
    let nearer = format!(
        "the contour {:.2} mm nearer to the free edge there",
        limit_mm - rim_mm
    );
    if rim_mm > 0.0 {
        format!("a rim limit of at most {rim_mm:.2} mm or {nearer}")
    } else {
        nearer
    }
}

impl From<Error> for Status {
    fn from(error: Error) -> Self {
        let message = error.to_string();
        let mm = |value: f64| format!("{value:.2}");
        match error {
            Error::Invalid { field, problem } => status::invalid(field, problem),
            Error::Bite { index, problem } => {
                status::invalid(format!("options.bites[{index}].approach"), problem)
            }
            Error::Surface(volume::Error::Voxel { .. } | volume::Error::TooManyVoxels { .. }) => {
                status::invalid("options.voxel_mm", message)
            }
            Error::Surface(_) => status::invalid("model", message),
            Error::NotACrescent { .. } => status::invalid("model", message),
            Error::Contour(contour::Error::ControlPoints { .. }) => {
                status::invalid("control_point_count", message)
            }
            Error::Contour(_) => status::invalid("points", message),
            Error::NoPath {
                iterations,
                left_mm,
            } => status::refused(
                "NO_PATH",
                message,
                &[
                    ("iterations", iterations.to_string()),
                    ("left_mm", mm(left_mm)),
                ],
            ),
            Error::RimBelowLimit {
                rim_mm,
                limit_mm,
                at,
                angle_rad,
            } => status::refused(
                "RIM_BELOW_LIMIT",
                message,
                &[
                    ("rim_mm", mm(rim_mm)),
                    ("limit_mm", mm(limit_mm)),
                    ("inboard_mm", mm(limit_mm - rim_mm)),
                    ("angle_deg", format!("{:.1}", angle_rad.to_degrees())),
                    ("x_mm", mm(at.x)),
                    ("y_mm", mm(at.y)),
                    ("z_mm", mm(at.z)),
                ],
            ),
            Error::LesionOutsideModel {
                outside_percent,
                farthest_mm,
                limit_percent,
            } => status::refused(
                "LESION_OUTSIDE_MODEL",
                message,
                &[
                    ("outside_percent", mm(outside_percent)),
                    ("farthest_mm", mm(farthest_mm)),
                    ("limit_percent", mm(limit_percent)),
                ],
            ),
            Error::LesionBeyondPath {
                beyond_percent,
                limit_percent,
            } => status::refused(
                "LESION_BEYOND_PATH",
                message,
                &[
                    ("beyond_percent", mm(beyond_percent)),
                    ("limit_percent", mm(limit_percent)),
                ],
            ),
            Error::NothingToRemove {
                region_mm3,
                limit_mm3,
            } => status::refused(
                "NOTHING_TO_REMOVE",
                message,
                &[("region_mm3", mm(region_mm3)), ("limit_mm3", mm(limit_mm3))],
            ),
            Error::NoBite { region_mm3 } => {
                status::refused("NO_BITE", message, &[("region_mm3", mm(region_mm3))])
            }
            Error::UnreachableTissue {
                residual_mm3,
                allowed_mm3,
                blocked_mm3,
                lesion_percent,
                possible_percent,
                at,
            } => status::refused(
                "UNREACHABLE_TISSUE",
                message,
                &[
                    ("residual_mm3", mm(residual_mm3)),
                    ("allowed_mm3", mm(allowed_mm3)),
                    ("blocked_mm3", mm(blocked_mm3)),
                    ("lesion_percent", mm(lesion_percent)),
                    ("possible_percent", mm(possible_percent)),
                    ("x_mm", mm(at.x)),
                    ("y_mm", mm(at.y)),
                    ("z_mm", mm(at.z)),
                ],
            ),
            Error::RegionNotCleared {
                bites,
                residual_mm3,
                allowed_mm3,
                outside_mm3,
                outside_limit_mm3,
                at,
            } => status::refused(
                "REGION_NOT_CLEARED",
                message,
                &[
                    ("bites", bites.to_string()),
                    ("residual_mm3", mm(residual_mm3)),
                    ("allowed_mm3", mm(allowed_mm3)),
                    ("outside_mm3", mm(outside_mm3)),
                    ("outside_limit_mm3", mm(outside_limit_mm3)),
                    ("x_mm", mm(at.x)),
                    ("y_mm", mm(at.y)),
                    ("z_mm", mm(at.z)),
                ],
            ),
            Error::BiteObstructed { bite, obstruction } => {
                obstructed(message, ("bite", bite.to_string()), &obstruction)
            }
            Error::TissueObstructed {
                residual_mm3,
                obstruction,
            } => obstructed(message, ("residual_mm3", mm(residual_mm3)), &obstruction),
            Error::Blind(blind) => view::refusal("options.arthroscope", &blind),
            Error::Deadline => Status::deadline_exceeded(message),
            Error::Cancelled => Status::cancelled(message),
        }
    }
}

/// A refusal by the reason word of what is in the way.
fn obstructed(message: String, about: (&'static str, String), obstruction: &Obstruction) -> Status {
    let number = |value: f64| format!("{value:.3}");
    let at = &obstruction.at;
    let mut metadata = vec![
        about,
        ("x_mm", number(at.x)),
        ("y_mm", number(at.y)),
        ("z_mm", number(at.z)),
    ];
    match obstruction.cause.measure() {
        Some(Measure::Millimetres(value, limit)) => {
            metadata.extend([("value_mm", number(value)), ("limit_mm", number(limit))]);
        }
        Some(Measure::Radians(value, limit)) => {
            metadata.extend([("value_rad", number(value)), ("limit_rad", number(limit))]);
        }
        None => {}
    }
    status::refused(obstruction.cause.reason(), message, &metadata)
}
