//! What is known of a knee, in ct, and what it makes of reach in the axes of a crescent.

use arthro_geometry::{Mesh, Point3};

use super::{Generic, Joint, KeepOut, Limits, Obstacle, Reach, Shaft};
use crate::crescent::Crescent;
use crate::error::Error;

/// The bones as far as they were scanned, how far the joint is opened, and the instrument in it.
#[derive(Clone, Debug)]
pub struct Knee {
    /// The femur in ct; `None`: a ball stands for the condyle.
    pub femur: Option<Mesh>,
    /// The tibia in ct; `None`: a plane stands for the plateau.
    pub tibia: Option<Mesh>,
    /// How far the femur is lifted from where it was scanned, mm; of the ball the gap between it and
    /// the top of the meniscus.
    pub opening_mm: f64,
    /// The forceps' shaft.
    pub shaft: Shaft,
    /// What it must keep to, apart from the vessels.
    pub limits: Limits,
    /// What is done about the vessels behind the posterior horn.
    pub popliteal: Popliteal,
}

/// What is done about the vessels behind the posterior horn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Popliteal {
    /// No part of the tool comes near them.
    #[default]
    KeptOut,
    /// Nothing.
    Ignored,
}

impl Knee {
    /// Reach in the axes of `crescent`, prepared as long as it `is_awaited`. `meniscus` and `portal`, which lies on the anterior side, are
    /// in these axes.
    ///
    /// # Errors
    /// When a bone, size or limit is not usable; names field, value and limit; [`Error::Cancelled`].
    pub fn reach(
        &self,
        crescent: &Crescent,
        meniscus: &Mesh,
        portal: &Point3,
        is_awaited: &(dyn Fn() -> bool + Sync),
    ) -> Result<Reach, Error> {
        let generic = Generic::default();
        let scanned = |mesh: &Mesh| Obstacle::Mesh(crescent.localize(mesh));
        let joint = Joint {
            femur: Some(match &self.femur {
                Some(mesh) => scanned(mesh),
                None => generic.femur(meniscus)?,
            }),
            tibia: Some(match &self.tibia {
                Some(mesh) => scanned(mesh),
                None => generic.tibia(meniscus)?,
            }),
            opening_mm: self.opening_mm,
        };
        let mut limits = self.limits.clone();
        if self.popliteal == Popliteal::KeptOut {
            limits.keep_outs = vec![KeepOut::popliteal(crescent, portal)];
        }
        Reach::while_awaited(&joint, self.shaft, limits, is_awaited)
    }
}
