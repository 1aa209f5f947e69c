//! The joint around the meniscus as messages: its options and bones in, room and obstructions out.

use std::ops::RangeInclusive;

use arthro_bootstrap::status;
use arthro_geometry::Mesh;
use arthro_proto::common::v1 as common;
use arthro_proto::planning::v1 as proto;
use tonic::Status;

use super::answer;
use super::options::Check;
use super::packed::{FEMUR, Fields, Surface, TIBIA};
use crate::jaw::Jaw;
use crate::reach::{Clearance, Knee, Limits, Measure, Obstruction, Popliteal, Shaft};

const OPENING_MM: RangeInclusive<f64> = -20.0..=50.0;
const DIAMETER_MM: RangeInclusive<f64> = 1.0..=10.0;
const LENGTH_MM: RangeInclusive<f64> = 20.0..=500.0;

/// The joint without its bones.
pub(super) fn read(given: &proto::JointOptions, jaw_length_mm: f64, check: &mut Check) -> Knee {
    let opening_mm = given.opening_mm;
    check.within("options.joint.opening_mm", opening_mm, OPENING_MM);
    let mut shaft = Shaft::forceps(&Jaw::new(0.0, jaw_length_mm));
    let diameter_mm = check.number(
        "options.joint.shaft_diameter_mm",
        given.shaft_diameter_mm,
        2.0 * shaft.radius_mm,
        DIAMETER_MM,
    );
    shaft.radius_mm = 0.5 * diameter_mm;
    shaft.length_mm = check.number(
        "options.joint.shaft_length_mm",
        given.shaft_length_mm,
        shaft.length_mm,
        LENGTH_MM,
    );
    let asked = given.limits.unwrap_or_default();
    let popliteal = match asked.popliteal_keep_out() {
        proto::PoplitealKeepOut::Unspecified | proto::PoplitealKeepOut::On => Popliteal::KeptOut,
        proto::PoplitealKeepOut::Off => Popliteal::Ignored,
    };
    Knee {
        femur: None,
        tibia: None,
        opening_mm,
        shaft,
        limits: limits(&asked),
        popliteal,
    }
}

/// The limits as given; their ranges are checked where they are used.
fn limits(given: &proto::ReachLimits) -> Limits {
    let default = Limits::default();
    let range = |low: Option<f64>, high: Option<f64>, default: &RangeInclusive<f64>| {
        low.unwrap_or(*default.start())..=high.unwrap_or(*default.end())
    };
    Limits {
        clearance_mm: given.clearance_mm.unwrap_or(default.clearance_mm),
        elevation_rad: range(
            given.elevation_min_rad,
            given.elevation_max_rad,
            &default.elevation_rad,
        ),
        insertion_mm: range(
            given.insertion_min_mm,
            given.insertion_max_mm,
            &default.insertion_mm,
        ),
        max_opening_mm: given.max_opening_mm.unwrap_or(default.max_opening_mm),
        tissue_mm: given.tissue_limit_mm,
        ..default
    }
}

/// The bones that arrive.
pub(super) struct Bones {
    femur: Option<Surface>,
    tibia: Option<Surface>,
}

impl Bones {
    pub(super) fn announced(joint: Option<&proto::JointOptions>) -> Result<Self, Status> {
        let bone = |fields, header: Option<&common::MeshHeader>| {
            let surface = header.map(|header| Surface::announced(fields, header));
            surface.transpose()
        };
        Ok(Self {
            femur: bone(&FEMUR, joint.and_then(|joint| joint.femur.as_ref()))?,
            tibia: bone(&TIBIA, joint.and_then(|joint| joint.tibia.as_ref()))?,
        })
    }

    pub(super) fn femur(&mut self) -> Result<&mut Surface, Status> {
        announced(&mut self.femur, &FEMUR)
    }

    pub(super) fn tibia(&mut self) -> Result<&mut Surface, Status> {
        announced(&mut self.tibia, &TIBIA)
    }

    pub(super) fn complete(self) -> Result<(Option<Mesh>, Option<Mesh>), Status> {
        let femur = self.femur.map(Surface::complete).transpose()?;
        Ok((femur, self.tibia.map(Surface::complete).transpose()?))
    }
}

fn announced<'a>(
    parts: &'a mut Option<Surface>,
    fields: &Fields,
) -> Result<&'a mut Surface, Status> {
    let missing = || status::invalid(fields.header, "is missing, but chunks of it came");
    parts.as_mut().ok_or_else(missing)
}

/// How much room there is.
pub(super) fn clearance(room: &Clearance) -> proto::ReachClearance {
    proto::ReachClearance {
        // Both bones are always there, scanned or generic.
        femur_mm: room.femur_mm.unwrap_or(f64::INFINITY),
        tibia_mm: room.tibia_mm.unwrap_or(f64::INFINITY),
        meniscus_mm: room.meniscus_mm,
        elevation_rad: room.elevation_rad,
        insertion_mm: room.insertion_mm,
    }
}

/// What is in the way, in ct.
pub(super) fn obstruction(obstruction: &Obstruction) -> proto::ReachObstruction {
    let cause = &obstruction.cause;
    let (mut millimetres, mut radians) = (None, None);
    match cause.measure() {
        Some(Measure::Millimetres(value, limit)) => millimetres = Some((value, limit)),
        Some(Measure::Radians(value, limit)) => radians = Some((value, limit)),
        None => {}
    }
    proto::ReachObstruction {
        reason: cause.reason().to_owned(),
        detail: obstruction.to_string(),
        value_mm: millimetres.map(|(value, _)| value),
        limit_mm: millimetres.map(|(_, limit)| limit),
        value_rad: radians.map(|(value, _)| value),
        limit_rad: radians.map(|(_, limit)| limit),
        at: Some(answer::point(&obstruction.at)),
        triangle: cause.triangle(),
        remedy: cause.remedy(),
    }
}
