//! `CheckReachability`: the stream of options, model and bones, the question in the axes of the
//! crescent, the answers back in ct.

use std::ops::RangeInclusive;

use arthro_bootstrap::status;
use arthro_geometry::volume::Solid;
use arthro_geometry::{Mesh, Point3, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::common::v1::mesh_chunk::Part;
use arthro_proto::planning::v1 as proto;
use proto::check_reachability_request::Payload;
use tonic::{Status, Streaming};

use super::intake::{self, Packed};
use super::{answer, options};
use crate::crescent::Crescent;
use crate::error::Error;
use crate::jaw::{Bite, Jaw};
use crate::reach::{
    Cause, Clearance, Generic, Joint, KeepOut, Limits, Measure, Obstacle, Obstruction, Reach, Shaft,
};

/// Most portals that are tried.
const MAX_PORTALS: usize = 16;
/// Edge of the voxels that tell what is meniscus, mm.
const TISSUE_VOXEL_MM: f64 = 0.5;
const DIAMETER_MM: RangeInclusive<f64> = 1.0..=10.0;
const LENGTH_MM: RangeInclusive<f64> = 20.0..=500.0;

/// What is asked, in ct.
pub(super) struct Wanted {
    model: Mesh,
    femur: Option<Mesh>,
    tibia: Option<Mesh>,
    opening_mm: f64,
    portals: Vec<Point3>,
    bites: Vec<Point3>,
    shaft: Shaft,
    limits: Limits,
    popliteal: Popliteal,
}

enum Popliteal {
    KeptOut,
    Ignored,
}

pub(super) async fn intake(
    mut stream: Streaming<proto::CheckReachabilityRequest>,
) -> Result<Wanted, Status> {
    let first = intake::next(&mut stream).await?;
    let Some(Payload::Options(options)) = first.and_then(|first| first.payload) else {
        return Err(intake::options_first());
    };
    let model = options.model.as_ref();
    let model = model.ok_or_else(|| status::invalid("options.model", "is missing"))?;
    let mut model = Parts::announced(&MODEL, model)?;
    let bone = |fields, header: &Option<common::MeshHeader>| {
        let parts = header
            .as_ref()
            .map(|header| Parts::announced(fields, header));
        parts.transpose()
    };
    let mut femur = bone(&FEMUR, &options.femur)?;
    let mut tibia = bone(&TIBIA, &options.tibia)?;
    let mut wanted = read(&options)?;
    while let Some(message) = intake::next(&mut stream).await? {
        match message.payload {
            Some(Payload::Model(chunk)) => model.push(chunk)?,
            Some(Payload::Femur(chunk)) => announced(&mut femur, &FEMUR)?.push(chunk)?,
            Some(Payload::Tibia(chunk)) => announced(&mut tibia, &TIBIA)?.push(chunk)?,
            Some(Payload::Options(_)) => return Err(intake::options_once()),
            None => return Err(status::invalid("payload", "is empty")),
        }
    }
    wanted.model = model.complete()?;
    wanted.femur = femur.map(Parts::complete).transpose()?;
    wanted.tibia = tibia.map(Parts::complete).transpose()?;
    Ok(wanted)
}

/// Answers as long as `is_awaited`.
pub(super) fn check(
    wanted: &Wanted,
    is_awaited: impl Fn() -> bool,
) -> Result<proto::CheckReachabilityResponse, Status> {
    let crescent = Crescent::of(&wanted.model, &wanted.portals[0])?;
    let model = crescent.localize(&wanted.model);
    let meniscal_from_ct = crescent.ct_from_meniscal.inverse();
    let localized = |points: &[Point3]| -> Vec<Point3> {
        points
            .iter()
            .map(|point| meniscal_from_ct * *point)
            .collect()
    };
    let (portals, bites) = (localized(&wanted.portals), localized(&wanted.bites));
    let mut limits = wanted.limits.clone();
    if let Popliteal::KeptOut = wanted.popliteal {
        limits.keep_outs = vec![KeepOut::popliteal(&crescent, &portals[0])];
    }
    let reach = Reach::of(&joint(wanted, &crescent, &model)?, wanted.shaft, limits)?;
    let tissue = Solid::of(&model, TISSUE_VOXEL_MM).map_err(Error::from)?;
    let is_tissue = |point: &Point3| tissue.contains(point);
    let mut answers = Vec::with_capacity(bites.len() * portals.len());
    let mut reachable_bites = 0;
    for (bite_index, center) in bites.iter().enumerate() {
        if !is_awaited() {
            return Err(Error::Cancelled.into());
        }
        let mut is_reachable = false;
        for (portal_index, portal) in portals.iter().enumerate() {
            let room = through(&reach, portal, center, &is_tissue);
            is_reachable |= room.is_ok();
            let room = room.map_err(|obstruction| obstruction.carried(&crescent.ct_from_meniscal));
            answers.push(proto::Reachability {
                bite: bite_index as u32,
                portal: portal_index as u32,
                answer: Some(told(room)),
            });
        }
        reachable_bites += u32::from(is_reachable);
    }
    Ok(proto::CheckReachabilityResponse {
        answers,
        reachable_bites,
    })
}

fn through(
    reach: &Reach,
    portal: &Point3,
    center: &Point3,
    is_tissue: &dyn Fn(&Point3) -> bool,
) -> Result<Clearance, Obstruction> {
    let bite = Bite::through(portal, *center, &Vector3::z(), *center);
    let bite = bite.ok_or(Obstruction {
        cause: Cause::NoShaft,
        at: *center,
    })?;
    reach.check(portal, &bite, is_tissue)
}

/// The joint in the axes of the crescent; where no bone was scanned, the generic one.
fn joint(wanted: &Wanted, crescent: &Crescent, model: &Mesh) -> Result<Joint, Error> {
    let generic = Generic::default();
    let scanned = |mesh: &Mesh| Obstacle::Mesh(crescent.localize(mesh));
    Ok(Joint {
        femur: Some(match &wanted.femur {
            Some(mesh) => scanned(mesh),
            None => generic.femur(model)?,
        }),
        tibia: Some(match &wanted.tibia {
            Some(mesh) => scanned(mesh),
            None => generic.tibia(model)?,
        }),
        opening_mm: wanted.opening_mm,
    })
}

fn read(options: &proto::CheckReachabilityOptions) -> Result<Wanted, Status> {
    let mut check = options::Check::default();
    for (field, count, limit) in [
        ("options.portals", options.portals.len(), MAX_PORTALS),
        ("options.bites", options.bites.len(), options::MAX_BITES),
    ] {
        if !(1..=limit).contains(&count) {
            let problem = format!("are {count}; must be 1 .. {limit}");
            return Err(status::invalid(field, problem));
        }
    }
    check.within("options.opening_mm", options.opening_mm, -20.0..=50.0);
    let length_mm = options.jaw_length_mm;
    check.within("options.jaw_length_mm", length_mm, options::JAW_LENGTH_MM);
    let mut shaft = Shaft::forceps(&Jaw::new(0.0, length_mm));
    let (diameter, length) = ("options.shaft_diameter_mm", "options.shaft_length_mm");
    let default_mm = 2.0 * shaft.radius_mm;
    shaft.radius_mm =
        0.5 * check.number(diameter, options.shaft_diameter_mm, default_mm, DIAMETER_MM);
    shaft.length_mm = check.number(length, options.shaft_length_mm, shaft.length_mm, LENGTH_MM);
    let given = options.limits.unwrap_or_default();
    let popliteal = match given.popliteal_keep_out() {
        proto::PoplitealKeepOut::Unspecified | proto::PoplitealKeepOut::On => Popliteal::KeptOut,
        proto::PoplitealKeepOut::Off => Popliteal::Ignored,
    };
    let wanted = Wanted {
        model: Mesh::default(),
        femur: None,
        tibia: None,
        opening_mm: options.opening_mm,
        portals: check.points("options.portals", &options.portals),
        bites: check.points("options.bites", &options.bites),
        shaft,
        limits: limits(&given),
        popliteal,
    };
    check.done(wanted)
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

fn told(room: Result<Clearance, Obstruction>) -> proto::reachability::Answer {
    use proto::reachability::Answer;
    match room {
        Ok(room) => Answer::Clearance(proto::ReachClearance {
            // Both bones are always there, scanned or generic.
            femur_mm: room.femur_mm.unwrap_or(f64::INFINITY),
            tibia_mm: room.tibia_mm.unwrap_or(f64::INFINITY),
            meniscus_mm: room.meniscus_mm,
            elevation_rad: room.elevation_rad,
            insertion_mm: room.insertion_mm,
        }),
        Err(obstruction) => {
            let cause = &obstruction.cause;
            let (mut millimetres, mut radians) = (None, None);
            match cause.measure() {
                Some(Measure::Millimetres(value, limit)) => millimetres = Some((value, limit)),
                Some(Measure::Radians(value, limit)) => radians = Some((value, limit)),
                None => {}
            }
            Answer::Obstruction(proto::ReachObstruction {
                reason: cause.reason().to_owned(),
                detail: obstruction.to_string(),
                value_mm: millimetres.map(|(value, _)| value),
                limit_mm: millimetres.map(|(_, limit)| limit),
                value_rad: radians.map(|(value, _)| value),
                limit_rad: radians.map(|(_, limit)| limit),
                at: Some(answer::point(&obstruction.at)),
                triangle: cause.triangle(),
                remedy: cause.remedy(),
            })
        }
    }
}

/// How the parts of a mesh are named in refusals.
struct Fields {
    header: &'static str,
    frame: &'static str,
    vertex_count: &'static str,
    triangle_count: &'static str,
    vertices: &'static str,
    triangles: &'static str,
    part: &'static str,
}

macro_rules! fields {
    ($name:literal) => {
        Fields {
            header: concat!("options.", $name),
            frame: concat!("options.", $name, ".frame"),
            vertex_count: concat!("options.", $name, ".vertex_count"),
            triangle_count: concat!("options.", $name, ".triangle_count"),
            vertices: concat!($name, ".vertices"),
            triangles: concat!($name, ".triangles"),
            part: concat!($name, ".part"),
        }
    };
}

const MODEL: Fields = fields!("model");
const FEMUR: Fields = fields!("femur");
const TIBIA: Fields = fields!("tibia");

/// The packed parts of a mesh.
struct Parts {
    part: &'static str,
    vertices: Packed,
    triangles: Packed,
}

impl Parts {
    fn announced(fields: &Fields, header: &common::MeshHeader) -> Result<Self, Status> {
        intake::in_ct(fields.frame, header.frame)?;
        let vertices = (fields.vertex_count, header.vertex_count);
        let triangles = (fields.triangle_count, header.triangle_count);
        Ok(Self {
            part: fields.part,
            vertices: Packed::announced(fields.vertices, vertices, 4..=intake::MAX_VERTICES)?,
            triangles: Packed::announced(fields.triangles, triangles, 4..=intake::MAX_TRIANGLES)?,
        })
    }

    fn push(&mut self, chunk: common::MeshChunk) -> Result<(), Status> {
        match chunk.part {
            Some(Part::Vertices(bytes)) => self.vertices.push(&bytes),
            Some(Part::Triangles(bytes)) => self.triangles.push(&bytes),
            None => Err(status::invalid(self.part, "is empty")),
        }
    }

    fn complete(self) -> Result<Mesh, Status> {
        Ok(Mesh {
            vertices: self.vertices.points()?,
            triangles: self.triangles.triples(u32::from_le_bytes)?,
        })
    }
}

fn announced<'a>(parts: &'a mut Option<Parts>, fields: &Fields) -> Result<&'a mut Parts, Status> {
    let missing = || status::invalid(fields.header, "is missing, but chunks of it came");
    parts.as_mut().ok_or_else(missing)
}
