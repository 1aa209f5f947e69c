//! `CheckReachability`: the stream of options, model and bones, the question in the axes of the
//! crescent, the answers back in ct.

use arthro_bootstrap::status;
use arthro_geometry::volume::Solid;
use arthro_geometry::{Mesh, Point3, Vector3};
use arthro_proto::planning::v1 as proto;
use proto::check_reachability_request::Payload;
use proto::reachability::Answer;
use tonic::{Status, Streaming};

use super::joint::{self, Bones};
use super::packed::{MODEL, Surface};
use super::{intake, options};
use crate::crescent::Crescent;
use crate::error::Error;
use crate::jaw::Bite;
use crate::reach::{Cause, Clearance, Knee, Obstruction, Reach};

/// Most portals that are tried.
const MAX_PORTALS: usize = 16;
/// Edge of the voxels that tell what is meniscus, mm.
const TISSUE_VOXEL_MM: f64 = 0.5;

/// What is asked, in ct.
pub(super) struct Wanted {
    model: Mesh,
    portals: Vec<Point3>,
    bites: Vec<Point3>,
    knee: Knee,
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
    let mut model = Surface::announced(&MODEL, model)?;
    let mut bones = Bones::announced(options.joint.as_ref())?;
    let mut wanted = read(&options)?;
    while let Some(message) = intake::next(&mut stream).await? {
        match message.payload {
            Some(Payload::Model(chunk)) => model.push(chunk)?,
            Some(Payload::Femur(chunk)) => bones.femur()?.push(chunk)?,
            Some(Payload::Tibia(chunk)) => bones.tibia()?.push(chunk)?,
            Some(Payload::Options(_)) => return Err(intake::options_once()),
            None => return Err(status::invalid("payload", "is empty")),
        }
    }
    wanted.model = model.complete()?;
    (wanted.knee.femur, wanted.knee.tibia) = bones.complete()?;
    Ok(wanted)
}

/// Answers as long as `is_awaited`.
pub(super) fn check(
    wanted: &Wanted,
    is_awaited: &(dyn Fn() -> bool + Sync),
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
    let reach = wanted
        .knee
        .reach(&crescent, &model, &portals[0], is_awaited)?;
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
                answer: Some(match &room {
                    Ok(room) => Answer::Clearance(joint::clearance(room)),
                    Err(obstruction) => Answer::Obstruction(joint::obstruction(obstruction)),
                }),
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
    let length_mm = options.jaw_length_mm;
    check.within("options.jaw_length_mm", length_mm, options::JAW_LENGTH_MM);
    let joint = options.joint.unwrap_or_default();
    let wanted = Wanted {
        model: Mesh::default(),
        portals: check.points("options.portals", &options.portals),
        bites: check.points("options.bites", &options.bites),
        knee: joint::read(&joint, length_mm, &mut check),
    };
    check.done(wanted)
}
