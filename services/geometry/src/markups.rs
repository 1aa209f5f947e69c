//! Markups of 3D Slicer (`.mrk.json`): points and curves that somebody set on a model, to and from LPS
//! and mm.
//!
//! Read are the types `Curve`, `ClosedCurve`, `Fiducial` and `Line`. A markup without
//! `coordinateSystem` is in LPS and one without `coordinateUnits` in mm, as the schema says; RAS is
//! turned, any other axes or unit are refused. A control point that is not placed (`positionStatus`
//! `undefined` or `preview`) is skipped and counted; one without a status is placed, and every point
//! written is marked `defined`, since some versions of Slicer hide points without it. Orientations and
//! display properties are ignored.
//!
//! Source: Slicer's `markups-schema-v1.0.0.json` to `markups-schema-v1.0.3.json`.

use crate::Point3;

mod read;
mod write;

#[cfg(test)]
mod tests;

pub use read::{read, read_one};
pub use write::write;

/// Most bytes of a file.
pub const MAX_BYTES: usize = 16 << 20;
/// Most markups of a file.
pub const MAX_MARKUPS: usize = 1000;
/// Most control points of a markup.
pub const MAX_POINTS: usize = 10_000;
/// Largest coordinate, mm.
pub const MAX_COORDINATE_MM: f64 = 10_000.0;

/// What the points of a markup are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// An open curve through the points, in order.
    Curve,
    /// A curve that returns from the last point to the first.
    ClosedCurve,
    /// Single points.
    Fiducial,
    /// Two points and what lies between.
    Line,
}

/// One markup.
#[derive(Clone, Debug, PartialEq)]
pub struct Markup {
    /// As displayed; may be empty.
    pub name: String,
    /// What the points are.
    pub kind: Kind,
    /// Placed control points in ct (LPS), mm.
    pub points: Vec<Point3>,
    /// Control points that are not placed.
    pub skipped: usize,
}

/// Why a file was refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// More bytes than are read.
    #[error("the file has {bytes} bytes, the limit is {MAX_BYTES}")]
    TooLarge {
        /// Bytes of the file.
        bytes: usize,
    },
    /// It is no JSON.
    #[error("the file is no JSON: {0}")]
    Json(String),
    /// Something in it is not as the schema has it or not what is read.
    #[error("{path} {problem}")]
    Field {
        /// Where, as `markups[0].controlPoints[3].position`.
        path: String,
        /// Value and limit.
        problem: String,
    },
    /// No markup has the name that is asked for.
    #[error("no markup is named {name}; there are {known}")]
    Unknown {
        /// The name, quoted.
        name: String,
        /// Names of the file's markups, quoted.
        known: String,
    },
    /// It is not clear which markup is meant.
    #[error("{count} markups could be meant, named {known}; give the name of exactly one")]
    Ambiguous {
        /// How many.
        count: usize,
        /// Their names, quoted.
        known: String,
    },
}

impl Kind {
    const ALL: [Self; 4] = [Self::Curve, Self::ClosedCurve, Self::Fiducial, Self::Line];

    /// The schema's word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Curve => "Curve",
            Self::ClosedCurve => "ClosedCurve",
            Self::Fiducial => "Fiducial",
            Self::Line => "Line",
        }
    }
}
