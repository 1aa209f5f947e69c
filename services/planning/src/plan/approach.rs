//! The way of the forceps to the bites of a plan, as far as the joint is known.

use super::Request;
use crate::bites::Patience;
use crate::error::Error;
use crate::evaluation::Task;
use crate::jaw::Bite;
use crate::reach::{Capsule, Clearance, Obstruction, Reach};
use crate::tissue::Tissue;
use crate::view::Segment;

use arthro_geometry::Vector3;

/// Reach in the axes of the crescent.
pub(super) struct Approach<'a> {
    task: &'a Task<'a>,
    reach: Option<Reach>,
}

impl<'a> Approach<'a> {
    pub(super) fn of(
        request: &Request,
        task: &'a Task<'a>,
        patience: &(dyn Fn() -> Patience + Sync),
    ) -> Result<Self, Error> {
        let is_awaited = || patience() != Patience::Stop;
        let reach = request.knee.as_ref().map(|knee| {
            let meniscus = task.crescent.localize(&request.model);
            knee.reach(task.crescent, &meniscus, &task.portals[0], &is_awaited)
        });
        Ok(Self {
            task,
            reach: reach.transpose()?,
        })
    }

    /// Whether nothing known is in the way of a bite.
    pub(super) fn is_clear(&self, portal: usize, bite: &Bite) -> bool {
        let portal = &self.task.portals[portal];
        self.reach
            .as_ref()
            .is_none_or(|reach| reach.is_clear(portal, bite))
    }

    /// How much room each bite has at its time, in their order.
    ///
    /// # Errors
    /// The first bite that has none.
    pub(super) fn clearances(
        &self,
        bites: &[(usize, Bite)],
    ) -> Result<Vec<Option<Clearance>>, Error> {
        let Some(reach) = &self.reach else {
            return Ok(vec![None; bites.len()]);
        };
        let mut tissue = Tissue::whole(self.task.voxels);
        let rooms = bites.iter().enumerate().map(|(index, (portal, bite))| {
            let is_tissue = |point: &arthro_geometry::Point3| {
                let voxel = self.task.voxels.at(point);
                voxel.is_some_and(|voxel| tissue.is_left(voxel as u32))
            };
            let room = reach.check(&self.task.portals[*portal], bite, &is_tissue);
            tissue.bite(&bite.cut(&self.task.jaw));
            room.map(Some).map_err(|obstruction| Error::BiteObstructed {
                bite: index,
                obstruction: self.in_ct(&obstruction),
            })
        });
        rooms.collect()
    }

    /// A refusal for tissue that stays, told by what keeps the forceps from it, if that is the reason.
    pub(super) fn explained(&self, refusal: Error) -> Error {
        let (
            Some(reach),
            Error::UnreachableTissue {
                at, residual_mm3, ..
            },
        ) = (&self.reach, &refusal)
        else {
            return refusal;
        };
        let center = self.task.crescent.ct_from_meniscal.inverse() * *at;
        let obstructions = self.task.portals.iter().map(|portal| {
            let bite = Bite::through(portal, center, &Vector3::z(), center)?;
            reach.check(portal, &bite, &|_| false).err()
        });
        // As long as one portal is free the reason is another.
        match obstructions.collect::<Option<Vec<_>>>().as_deref() {
            Some([obstruction, ..]) => Error::TissueObstructed {
                residual_mm3: *residual_mm3,
                obstruction: self.in_ct(obstruction),
            },
            _ => refusal,
        }
    }

    /// Distance from the axis of the arthroscope to the nearest bone, mm.
    pub(super) fn bone_mm(&self, shaft: &Segment) -> f64 {
        let Some(reach) = &self.reach else {
            return f64::INFINITY;
        };
        let way = shaft.to - shaft.from;
        let length_mm = way.norm();
        let Some(along) = way.try_normalize(1e-9) else {
            return f64::INFINITY;
        };
        reach.bone_mm(&Capsule {
            start: shaft.from,
            along,
            length_mm,
            radius_mm: 0.0,
        })
    }

    fn in_ct(&self, obstruction: &Obstruction) -> Obstruction {
        obstruction.carried(&self.task.crescent.ct_from_meniscal)
    }
}
