//! The options of requests, checked, with their defaults.

mod check;
mod plan;

use std::ops::RangeInclusive;

use arthro_bootstrap::status;
use arthro_geometry::{Mesh, Point3};
use arthro_proto::planning::v1 as proto;
use tonic::Status;

use crate::contour::MIN_CONTROL_POINTS;
use crate::plan::{EvaluationRequest, Limits};

pub(super) use check::{Check, JAW_LENGTH_MM};
pub(super) use plan::read as plan;

/// Most points of a contour.
const MAX_CONTOUR_POINTS: usize = 10_000;
/// Most bites that are scored.
pub(super) const MAX_BITES: usize = 1_000;
/// Most portals of the forceps.
const MAX_PORTALS: usize = 8;
const SPACING_MM: RangeInclusive<f64> = 0.05..=10.0;
const PERCENT: RangeInclusive<f64> = 0.0..=100.0;
/// Control points that are chosen at most.
const MAX_CHOSEN_CONTROL_POINTS: usize = 64;

/// A contour to be fitted.
#[derive(Debug)]
pub(super) struct Contour {
    pub(super) points: Vec<Point3>,
    pub(super) control_points: usize,
    pub(super) spacing_mm: f64,
}

impl Contour {
    pub(super) fn read(request: proto::FitContourRequest) -> Result<Self, Status> {
        let mut check = Check::default();
        let count = request.points.len();
        if !(MIN_CONTROL_POINTS..=MAX_CONTOUR_POINTS).contains(&count) {
            return Err(status::invalid(
                "points",
                format!("are {count}; must be {MIN_CONTROL_POINTS} .. {MAX_CONTOUR_POINTS}"),
            ));
        }
        let points = check.points("points", &request.points);
        let spacing_mm = check.number("spacing_mm", request.spacing_mm, 1.0, SPACING_MM);
        // Half as many as points smooths what a hand clicked.
        let chosen = (count / 2 + 2).clamp(MIN_CONTROL_POINTS, MAX_CHOSEN_CONTROL_POINTS);
        let control_points = match request.control_point_count as usize {
            0 => chosen.min(count),
            given => given,
        };
        check.done(Self {
            points,
            control_points,
            spacing_mm,
        })
    }
}

/// The request without its model and lesion.
pub(super) fn evaluation(
    options: &proto::EvaluateResectionOptions,
) -> Result<EvaluationRequest, Status> {
    let mut check = Check::default();
    let counts = [
        ("options.contour", options.contour.len(), MAX_CONTOUR_POINTS),
        ("options.bites", options.bites.len(), MAX_BITES),
        ("options.portals", options.portals.len(), MAX_PORTALS),
    ];
    if !counts
        .map(|(field, count, limit)| check.at_most(field, count, limit))
        .iter()
        .all(|few| *few)
    {
        return check.done_never();
    }
    let throat = options.throat_limit_percent;
    let throat = check.given("options.throat_limit_percent", throat, PERCENT);
    let request = EvaluationRequest {
        model: Mesh::default(),
        lesion: Vec::new(),
        lesion_spacing_mm: check.lesion_spacing(options.lesion_spacing_mm),
        contour: check.points("options.contour", &options.contour),
        bites: check.bites(&options.bites),
        portals: check.points("options.portals", &options.portals),
        jaw: check.jaw(options.jaw.as_ref()),
        throat_limit: throat.map_or(Limits::default().throat_limit, |percent| percent / 100.0),
        voxel_mm: check.voxel(options.voxel_mm),
    };
    check.done(request)
}
