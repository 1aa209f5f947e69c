//! Watches the truth at every controller tick and keeps the account: shafts against their portals,
//! contacts that must not be, tissue and its whereabouts.

pub mod body;
pub mod contact;
pub mod score;

use arthro_geometry::{Point3, Vector3};

use self::body::ArmBody;
use self::contact::{Capsule, Penetration};
use crate::jaw;
use crate::knee::{Knee, Volume};

/// The account of one case so far.
#[derive(Clone, Debug, Default)]
pub struct Referee {
    shafts: [ShaftAccount; 2],
    collisions: Vec<Collision>,
    touching: [Option<usize>; PAIRS],
    tissue: TissueAccount,
}

/// One shaft against its portal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ShaftAccount {
    /// Largest distance of the shaft to the portal at a tick while inside, mm.
    pub rcm_max_mm: f64,
    sum_of_squares_mm2: f64,
    /// Ticks while inside.
    pub ticks_inside: u64,
    /// Deepest tip beyond the portal, mm.
    pub depth_max_mm: f64,
    /// Times that the tip went in.
    pub insertions: u32,
    inside: bool,
}

impl ShaftAccount {
    /// Root mean square of the distance over the ticks inside, mm.
    pub fn rcm_rms_mm(&self) -> f64 {
        if self.ticks_inside == 0 {
            return 0.0;
        }
        (self.sum_of_squares_mm2 / self.ticks_inside as f64).sqrt()
    }
}

/// A contact from its first tick to its last.
#[derive(Clone, Debug, PartialEq)]
pub struct Collision {
    /// When it began, cell time.
    pub time_s: f64,
    /// The bodies.
    pub between: (&'static str, &'static str),
    /// Deepest of the episode, mm.
    pub penetration_mm: f64,
}

/// Where the tissue went.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TissueAccount {
    /// Taken by the jaw.
    pub removed: Volume,
    /// Closures that took tissue.
    pub bites: u32,
    /// Closures that took none.
    pub empty_bites: u32,
    /// Let go over the tray, mm3.
    pub delivered_mm3: f64,
    /// Let go under the skin, mm3.
    pub dropped_inside_mm3: f64,
    /// Let go anywhere else, mm3.
    pub dropped_outside_mm3: f64,
}

/// Where the jaw let go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Over the tray.
    Tray,
    /// Under the skin.
    Inside,
    /// Anywhere else.
    Elsewhere,
}

const ARMS: [&str; 2] = ["forceps arm", "arthroscope arm"];
const SHAFTS: [&str; 2] = ["forceps shaft", "arthroscope shaft"];
const CONDYLE: &str = "femoral condyle";
const TIBIA: &str = "tibial plateau";
/// Two shafts against two bones, shaft against shaft, each shaft against the other arm, arm against arm.
const PAIRS: usize = 8;
/// More episodes than this are a failed case whatever they are; the account stays bounded.
const MAX_COLLISIONS: usize = 1000;

impl Referee {
    /// One controller tick: both arms are here now.
    pub fn tick(&mut self, time_s: f64, arms: &[ArmBody; 2], knee: &Knee) {
        for (arm, account) in self.shafts.iter_mut().enumerate() {
            account.tick(&arms[arm].tip, &arms[arm].along, &knee.portals()[arm], knee);
        }
        let knee_from_base = knee.forceps_base_from_knee().inverse();
        let bones = knee.bones();
        for arm in 0..2 {
            let shaft = arms[arm].shaft.moved(|point| knee_from_base * *point);
            let condyle =
                contact::capsule_sphere(&shaft, &bones.condyle_center, bones.condyle_radius_mm);
            self.note(2 * arm, time_s, (SHAFTS[arm], CONDYLE), condyle);
            let tibia = contact::capsule_slab(&shaft, bones.tibia_mm, bones.plateau_radius_mm);
            self.note(2 * arm + 1, time_s, (SHAFTS[arm], TIBIA), tibia);
        }
        let [forceps, arthroscope] = arms;
        let shafts = contact::capsules(&forceps.shaft, &arthroscope.shaft);
        self.note(4, time_s, (SHAFTS[0], SHAFTS[1]), shafts);
        let forceps_in_arm = deepest([&forceps.shaft], &arthroscope.links);
        self.note(5, time_s, (SHAFTS[0], ARMS[1]), forceps_in_arm);
        let arthroscope_in_arm = deepest([&arthroscope.shaft], &forceps.links);
        self.note(6, time_s, (ARMS[0], SHAFTS[1]), arthroscope_in_arm);
        let arms = deepest(&forceps.links, &arthroscope.links);
        self.note(7, time_s, (ARMS[0], ARMS[1]), arms);
    }

    /// The jaw did something; `place` is where it is.
    pub fn jaw(&mut self, event: jaw::Event, place: Place) {
        match event {
            jaw::Event::Bit(volume) if volume.total_mm3() > 0.0 => {
                self.tissue.bites += 1;
                self.tissue.removed += volume;
            }
            jaw::Event::Bit(_) => self.tissue.empty_bites += 1,
            jaw::Event::Released(volume) => {
                let where_to = match place {
                    Place::Tray => &mut self.tissue.delivered_mm3,
                    Place::Inside => &mut self.tissue.dropped_inside_mm3,
                    Place::Elsewhere => &mut self.tissue.dropped_outside_mm3,
                };
                *where_to += volume.total_mm3();
            }
        }
    }

    /// Both shafts: forceps, arthroscope.
    pub fn shafts(&self) -> &[ShaftAccount; 2] {
        &self.shafts
    }

    /// Every episode of contact, in the order in which they began.
    pub fn collisions(&self) -> &[Collision] {
        &self.collisions
    }

    /// Where the tissue went.
    pub fn tissue(&self) -> &TissueAccount {
        &self.tissue
    }

    fn note(
        &mut self,
        pair: usize,
        time_s: f64,
        between: (&'static str, &'static str),
        penetration: Penetration,
    ) {
        let Some(penetration_mm) = penetration.depth_mm() else {
            self.touching[pair] = None;
            return;
        };
        match self.touching[pair] {
            Some(episode) => {
                let deepest_mm = &mut self.collisions[episode].penetration_mm;
                *deepest_mm = deepest_mm.max(penetration_mm);
            }
            None if self.collisions.len() < MAX_COLLISIONS => {
                self.touching[pair] = Some(self.collisions.len());
                self.collisions.push(Collision {
                    time_s,
                    between,
                    penetration_mm,
                });
                tracing::warn!(
                    time_s,
                    first = between.0,
                    second = between.1,
                    "bodies touch that must not"
                );
            }
            None => {}
        }
    }
}

impl ShaftAccount {
    fn tick(&mut self, tip: &Point3, along: &Vector3, portal: &Point3, knee: &Knee) {
        let from_portal = tip - portal;
        let depth_mm = from_portal.dot(along);
        let inside = depth_mm > 0.0 && knee.under_skin(tip);
        self.insertions += u32::from(inside && !self.inside);
        self.inside = inside;
        if !inside {
            return;
        }
        let distance_mm = from_portal.cross(along).norm();
        self.ticks_inside += 1;
        self.rcm_max_mm = self.rcm_max_mm.max(distance_mm);
        self.sum_of_squares_mm2 += distance_mm * distance_mm;
        self.depth_max_mm = self.depth_max_mm.max(depth_mm);
    }
}

/// The deepest of all contacts between two sets of capsules.
fn deepest<'a>(first: impl IntoIterator<Item = &'a Capsule>, second: &[Capsule]) -> Penetration {
    first
        .into_iter()
        .flat_map(|one| {
            second
                .iter()
                .map(move |other| contact::capsules(one, other))
        })
        .fold(Penetration::NONE, Penetration::max)
}

#[cfg(test)]
mod tests;
