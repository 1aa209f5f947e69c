//! Can a straight instrument get through its portal to a bite, and what does it come near to?
//!
//! Everything is in the axes of the crescent ([`crate::crescent::Crescent`]), z superior. The shaft is
//! a capsule that begins behind the jaw, which is slimmer and meant to reach into tissue, and runs
//! through the portal. It must keep clear of femur and tibia, within the limits of elevation and
//! insertion, and out of what lies behind the posterior horn. The meniscus itself yields: how much of
//! it the shaft passes through is reported and limited only when asked.

mod bone;
mod convert;
mod field;
mod joint;
mod knee;
mod limits;
mod obstruction;
mod shaft;
mod surface;

use arthro_geometry::{Point3, Vector3};

use crate::error::Error;
use crate::jaw::Bite;
use limits::in_range;

pub use bone::{Bone, Near};
pub use field::{DistanceField, ERROR_MM, MARGIN_MM, MAX_SAMPLES, SPACING_MM};
pub use joint::{Generic, Joint, Obstacle};
pub use knee::{Knee, Popliteal};
pub use limits::{KeepOut, Limits};
pub use obstruction::{BoneName, Cause, Measure, Obstruction};
pub use shaft::{Capsule, Shaft, shafts_mm};

/// How exactly the opening that is needed is found, mm.
const OPENING_STEP_MM: f64 = 0.05;
/// How much higher a portal may be that is proposed, mm.
const MAX_RAISE_MM: f64 = 30.0;
/// Between two places at which the shaft is looked at for tissue, mm.
const TISSUE_STEP_MM: f64 = 0.5;

/// A joint, a shaft and its limits, prepared for hundreds of thousands of bites a second.
#[derive(Clone, Debug)]
pub struct Reach {
    femur: Option<Bone>,
    tibia: Option<Bone>,
    opening_mm: f64,
    shaft: Shaft,
    limits: Limits,
}

/// How much room a shaft has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clearance {
    /// Between shaft and femur, mm; `None` without one.
    pub femur_mm: Option<f64>,
    /// Between shaft and tibia, mm; `None` without one.
    pub tibia_mm: Option<f64>,
    /// How much of the remaining meniscus the shaft passes through, mm along its axis.
    pub meniscus_mm: f64,
    /// Of the shaft over the meniscal plane; positive when the portal is above the bite.
    pub elevation_rad: f64,
    /// From the portal to the middle of the jaw, mm.
    pub insertion_mm: f64,
}

/// A shaft on its way from a portal to a bite.
struct Way {
    body: Capsule,
    elevation_rad: f64,
    insertion_mm: f64,
}

impl Reach {
    /// Prepares the bones. A mesh of 20,000 faces takes some tenths of a second.
    ///
    /// # Errors
    /// When a bone, size or limit is not usable; names field, value and limit.
    pub fn of(joint: &Joint, shaft: Shaft, limits: Limits) -> Result<Self, Error> {
        Self::while_awaited(joint, shaft, limits, &|| true)
    }

    /// The same as long as it `is_awaited`.
    ///
    /// # Errors
    /// As [`Reach::of`], and [`Error::Cancelled`].
    pub fn while_awaited(
        joint: &Joint,
        shaft: Shaft,
        limits: Limits,
        is_awaited: &(dyn Fn() -> bool + Sync),
    ) -> Result<Self, Error> {
        in_range("options.joint.opening_mm", joint.opening_mm, -20.0..=50.0)?;
        in_range(
            "options.joint.shaft_diameter_mm",
            shaft.radius_mm,
            0.25..=10.0,
        )?;
        in_range(
            "options.joint.shaft_length_mm",
            shaft.length_mm,
            20.0..=500.0,
        )?;
        in_range("shaft.ahead_mm", shaft.ahead_mm, 0.0..=20.0)?;
        in_range("shaft.slim_mm", shaft.slim_mm, 0.0..=40.0)?;
        let bone = |name, obstacle: &Option<Obstacle>| {
            let bone = obstacle.as_ref();
            let bone = bone.map(|obstacle| Bone::while_awaited(name, obstacle, is_awaited));
            bone.transpose()
        };
        Ok(Self {
            femur: bone("femur", &joint.femur)?,
            tibia: bone("tibia", &joint.tibia)?,
            opening_mm: joint.opening_mm,
            shaft,
            limits: limits.checked()?,
        })
    }

    /// How much room the shaft has when it makes `bite` through `portal`; `tissue` tells whether a
    /// point is in what remains of the meniscus.
    ///
    /// # Errors
    /// What is in the way. Of several things the first is told: portal, insertion, elevation,
    /// keep-outs, tibia, femur, meniscus.
    pub fn check(
        &self,
        portal: &Point3,
        bite: &Bite,
        tissue: &dyn Fn(&Point3) -> bool,
    ) -> Result<Clearance, Obstruction> {
        let way = self.way(portal, bite)?;
        self.bones_allow(portal, bite, &way)?;
        let (meniscus_mm, entry) = through_mm(&way, tissue);
        if let Some(limit_mm) = self.limits.tissue_mm
            && meniscus_mm > limit_mm
        {
            let cause = Cause::Tissue {
                tissue_mm: meniscus_mm,
                limit_mm,
            };
            return Err(Obstruction { cause, at: entry });
        }
        let lowered = self.below_femur(&way.body, self.opening_mm);
        Ok(Clearance {
            femur_mm: self.femur.as_ref().map(|f| f.nearest(&lowered).distance_mm),
            tibia_mm: self
                .tibia
                .as_ref()
                .map(|t| t.nearest(&way.body).distance_mm),
            meniscus_mm,
            elevation_rad: way.elevation_rad,
            insertion_mm: way.insertion_mm,
        })
    }

    /// Whether [`Reach::check`] finds nothing in the way but, perhaps, meniscus. Fast.
    pub fn is_clear(&self, portal: &Point3, bite: &Bite) -> bool {
        let Ok(way) = self.way(portal, bite) else {
            return false;
        };
        self.portal_in_bone(portal).is_none() && self.is_free(&way.body, self.opening_mm)
    }

    /// The shaft when it makes a bite.
    pub fn body(&self, bite: &Bite) -> Capsule {
        self.shaft.at(bite)
    }

    /// Distance of a shaft to the nearest bone in the opened joint, mm; infinite without bones.
    pub fn bone_mm(&self, body: &Capsule) -> f64 {
        let lowered = self.below_femur(body, self.opening_mm);
        let femur_mm = self.femur.as_ref().map(|femur| femur.distance_mm(&lowered));
        let tibia_mm = self.tibia.as_ref().map(|tibia| tibia.distance_mm(body));
        let none = f64::INFINITY;
        femur_mm.unwrap_or(none).min(tibia_mm.unwrap_or(none))
    }

    /// The femur as it was scanned.
    pub fn femur(&self) -> Option<&Bone> {
        self.femur.as_ref()
    }

    /// The tibia.
    pub fn tibia(&self) -> Option<&Bone> {
        self.tibia.as_ref()
    }

    /// The shaft's way, if it keeps to what does not ask the bones.
    fn way(&self, portal: &Point3, bite: &Bite) -> Result<Way, Obstruction> {
        let limits = &self.limits;
        let refuse = |cause, at: Point3| Err(Obstruction { cause, at });
        let back = portal - bite.center;
        let insertion_mm = back.norm();
        let is_unit = (bite.approach.norm() - 1.0).abs() <= 1e-6;
        let is_line = is_unit && insertion_mm.is_finite() && insertion_mm > 1e-6;
        if !is_line {
            return refuse(Cause::NoShaft, bite.center);
        }
        let aside = back - bite.approach * back.dot(&bite.approach);
        let points_away = back.dot(&bite.approach) > 0.0;
        let distance_mm = if points_away {
            insertion_mm
        } else {
            aside.norm()
        };
        if distance_mm > limits.portal_mm {
            let limit_mm = limits.portal_mm;
            return refuse(
                Cause::MissesPortal {
                    distance_mm,
                    limit_mm,
                },
                *portal,
            );
        }
        if !limits.insertion_mm.contains(&insertion_mm) {
            let limit_mm = broken(&limits.insertion_mm, insertion_mm);
            return refuse(
                Cause::Insertion {
                    insertion_mm,
                    limit_mm,
                },
                *portal,
            );
        }
        let elevation_rad = (-bite.approach.z).clamp(-1.0, 1.0).asin();
        if !limits.elevation_rad.contains(&elevation_rad) {
            let limit_rad = broken(&limits.elevation_rad, elevation_rad);
            let lower_mm = back.z - back.xy().norm() * limit_rad.tan();
            let cause = Cause::Elevation {
                elevation_rad,
                limit_rad,
                lower_mm,
            };
            return refuse(cause, *portal);
        }
        let body = self.shaft.at(bite);
        if !limits.keep_outs.is_empty() {
            self.keeps_out(bite, &body)?;
        }
        Ok(Way {
            body,
            elevation_rad,
            insertion_mm,
        })
    }

    /// Whether the whole tool with its jaw stays out of the keep-outs.
    fn keeps_out(&self, bite: &Bite, body: &Capsule) -> Result<(), Obstruction> {
        let start = bite.center + bite.approach * self.shaft.ahead_mm;
        let tool = Capsule {
            start,
            length_mm: (body.at(body.length_mm) - start).norm(),
            ..*body
        };
        let limit_mm = self.limits.clearance_mm;
        for (index, keep_out) in self.limits.keep_outs.iter().enumerate() {
            let (distance_mm, at) = keep_out.distance_mm(&tool);
            if distance_mm < limit_mm {
                let cause = Cause::KeepOut {
                    index,
                    distance_mm,
                    limit_mm,
                };
                return Err(Obstruction { cause, at });
            }
        }
        Ok(())
    }

    fn bones_allow(&self, portal: &Point3, bite: &Bite, way: &Way) -> Result<(), Obstruction> {
        if let Some((bone, depth_mm)) = self.portal_in_bone(portal) {
            let cause = Cause::PortalInBone { bone, depth_mm };
            return Err(Obstruction { cause, at: *portal });
        }
        let limit_mm = self.limits.clearance_mm;
        if let Some(near) = self.tibia.as_ref().and_then(|t| t.hit(&way.body, limit_mm)) {
            let cause = Cause::HitsTibia {
                distance_mm: near.distance_mm,
                limit_mm,
                triangle: near.triangle,
                raise_mm: self.raise_mm(portal, bite),
            };
            return Err(Obstruction { cause, at: near.at });
        }
        let lowered = self.below_femur(&way.body, self.opening_mm);
        let Some(near) = self.femur.as_ref().and_then(|f| f.hit(&lowered, limit_mm)) else {
            return Ok(());
        };
        let needed_mm = least(self.opening_mm, self.limits.max_opening_mm, |opening_mm| {
            self.is_free(&way.body, opening_mm)
        });
        let cause = match needed_mm {
            Some(needed_mm) => Cause::JointGap {
                opening_mm: self.opening_mm,
                needed_mm,
                distance_mm: near.distance_mm,
                triangle: near.triangle,
            },
            None => Cause::HitsCondyle {
                distance_mm: near.distance_mm,
                limit_mm,
                max_opening_mm: self.limits.max_opening_mm,
                triangle: near.triangle,
            },
        };
        let at = near.at + Vector3::z() * self.opening_mm;
        Err(Obstruction { cause, at })
    }

    fn portal_in_bone(&self, portal: &Point3) -> Option<(BoneName, f64)> {
        let lowered = portal - Vector3::z() * self.opening_mm;
        let places = [
            (BoneName::Femur, &self.femur, lowered),
            (BoneName::Tibia, &self.tibia, *portal),
        ];
        places.into_iter().find_map(|(name, bone, place)| {
            let distance_mm = bone.as_ref()?.point_mm(&place);
            (distance_mm < 0.0).then_some((name, -distance_mm))
        })
    }

    /// Whether a shaft keeps clear of both bones when the joint is opened so far.
    fn is_free(&self, body: &Capsule, opening_mm: f64) -> bool {
        let touches = |bone: &Option<Bone>, body: &Capsule| {
            let bone = bone.as_ref();
            bone.is_some_and(|bone| bone.touches(body, self.limits.clearance_mm))
        };
        !touches(&self.tibia, body) && !touches(&self.femur, &self.below_femur(body, opening_mm))
    }

    /// Lowering the shaft instead of lifting the femur leaves the femur's field where it is.
    fn below_femur(&self, body: &Capsule, opening_mm: f64) -> Capsule {
        body.displaced(&(Vector3::z() * -opening_mm))
    }

    /// How much higher the portal must be for the same bite to clear the tibia.
    fn raise_mm(&self, portal: &Point3, bite: &Bite) -> Option<f64> {
        let tibia = self.tibia.as_ref()?;
        let back = portal - bite.center;
        let steepest_mm = back.xy().norm() * self.limits.elevation_rad.end().tan() - back.z;
        least(0.0, MAX_RAISE_MM.min(steepest_mm), |raise_mm| {
            let raised = back + Vector3::z() * raise_mm;
            let body = self.shaft.body(&bite.center, &-raised.normalize());
            !tibia.touches(&body, self.limits.clearance_mm)
        })
    }
}

/// The end of a range that a value outside it breaks.
fn broken(range: &std::ops::RangeInclusive<f64>, value: f64) -> f64 {
    if value < *range.start() {
        *range.start()
    } else {
        *range.end()
    }
}

/// The least value from `low` to `high` that is enough, within [`OPENING_STEP_MM`] and on the side
/// that is enough; `None` if `high` is not. By bisection: more is never less.
fn least(low: f64, high: f64, is_enough: impl Fn(f64) -> bool) -> Option<f64> {
    let (mut low, mut high) = (low, high);
    if low > high || !is_enough(high) {
        return None;
    }
    while high - low > OPENING_STEP_MM {
        let middle = 0.5 * (low + high);
        if is_enough(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    Some(high)
}

/// How much of a shaft between its end and the portal is in tissue, its axis or one of four lines on
/// its surface, mm, and where that begins seen from the jaw.
fn through_mm(way: &Way, tissue: &dyn Fn(&Point3) -> bool) -> (f64, Point3) {
    let body = &way.body;
    let side = body.along.cross(&Vector3::z()).try_normalize(1e-6);
    let side = side.unwrap_or_else(Vector3::x) * body.radius_mm;
    let up = side.cross(&body.along);
    let steps = (way.insertion_mm.min(body.length_mm) / TISSUE_STEP_MM) as usize;
    let (mut length_mm, mut entry) = (0.0, None);
    for step in 0..steps {
        let middle = body.at((step as f64 + 0.5) * TISSUE_STEP_MM);
        let places = [Vector3::zeros(), side, -side, up, -up];
        if places.iter().any(|offset| tissue(&(middle + offset))) {
            length_mm += TISSUE_STEP_MM;
            entry.get_or_insert(middle);
        }
    }
    (length_mm, entry.unwrap_or(body.start))
}
