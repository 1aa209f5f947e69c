//! The cell that both arms stand in: the owner of each arm tells where its arm is and which way it will
//! go, and sees the other.
//!
//! Both owners share one record of each arm. The common frame is the base of the forceps arm.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use arthro_geometry::Rigid;
use arthro_geometry::frame::{Base, Tool};

use crate::bodies::{ArmShape, Bodies};
use crate::clearance::{Clearance, Keep, Side};
use crate::error::Error;
use crate::kinematics::Joints;
use crate::sweep::Sweep;

/// How often a way is looked at again because the other arm began or ended a move meanwhile.
const ATTEMPTS: usize = 4;

/// Where one arm stands in the cell: its bodies, and how it sees the other arm.
#[derive(Clone, Debug)]
pub struct Berth {
    shape: ArmShape,
    neighbour: Neighbour,
}

/// The other arm of the cell.
#[derive(Clone, Debug)]
enum Neighbour {
    /// There is none within reach.
    Apart,
    /// Nobody has stated where it stands.
    Unstated,
    /// It stands where it was measured.
    Beside {
        side: Side,
        clearance: Box<Clearance>,
        record: Arc<Mutex<[Record; 2]>>,
    },
}

/// What is known of one arm.
#[derive(Clone, Debug, Default)]
struct Record {
    present: Option<Present>,
    /// The way of the move under way.
    way: Option<Arc<Sweep>>,
    /// How many moves began or ended.
    changes: u64,
}

/// Where an arm was in its owner's newest controller cycle.
#[derive(Clone, Copy, Debug)]
pub struct Present {
    /// Counts the cycles.
    pub number: u64,
    /// In the common frame.
    pub bodies: Bodies,
    /// No place of any body was faster, mm/s.
    pub speed_mm_s: f64,
}

/// What an owner sees of the other arm.
#[derive(Clone, Debug)]
pub enum Other {
    /// There is none within reach.
    Apart,
    /// Nobody has stated where it stands.
    Unstated,
    /// It has no link: nobody knows its joints.
    Unknown,
    /// There it is.
    Here(Box<Present>),
}

impl Berth {
    /// Of an arm that no other arm can reach.
    pub fn apart(shape: ArmShape) -> Self {
        Self {
            shape,
            neighbour: Neighbour::Apart,
        }
    }

    /// Of an arm in a cell of which nobody has stated where the other arm stands: it does not move.
    pub fn unstated(shape: ArmShape) -> Self {
        Self {
            shape,
            neighbour: Neighbour::Unstated,
        }
    }

    /// Of two arms beside each other, forceps first.
    pub fn beside(clearance: Clearance) -> [Self; 2] {
        let record = Arc::new(Mutex::new(<[Record; 2]>::default()));
        [Side::Forceps, Side::Arthroscope].map(|side| Self {
            shape: clearance.shape(side),
            neighbour: Neighbour::Beside {
                side,
                clearance: Box::new(clearance),
                record: record.clone(),
            },
        })
    }

    /// The bodies in the arm's base, at joints that put the tool at `base_from_tool`.
    pub fn bodies(&self, joints: &Joints, base_from_tool: &Rigid<Base, Tool>) -> Bodies {
        self.shape.bodies(joints, base_from_tool)
    }

    /// The same in the common frame.
    pub fn in_common(&self, bodies: &Bodies) -> Bodies {
        match &self.neighbour {
            Neighbour::Beside {
                side, clearance, ..
            } => clearance.in_common(*side, bodies),
            Neighbour::Apart | Neighbour::Unstated => *bodies,
        }
    }

    /// Tells where the arm is.
    pub fn tell(&self, present: Present) {
        if let Some((mut records, side)) = self.records() {
            records[side as usize].present = Some(present);
        }
    }

    /// Nobody knows any more where the arm is.
    pub fn lose(&self) {
        if let Some((mut records, side)) = self.records() {
            records[side as usize].present = None;
        }
    }

    /// What is to be seen of the other arm.
    pub fn other(&self) -> Other {
        match &self.neighbour {
            Neighbour::Apart => Other::Apart,
            Neighbour::Unstated => Other::Unstated,
            Neighbour::Beside { side, record, .. } => {
                let present = lock(record)[side.other() as usize].present;
                present.map_or(Other::Unknown, |present| Other::Here(Box::new(present)))
            }
        }
    }

    /// Refused where a sweep comes too near to the other arm as it stands now.
    pub fn keeps_clear(&self, sweep: &Sweep, keep: &Keep) -> Result<(), Error> {
        match self.other() {
            Other::Apart => Ok(()),
            Other::Unstated => Err(Error::LayoutUnknown),
            Other::Unknown => Err(Error::OtherArmUnknown),
            Other::Here(present) => sweep.keeps_clear_of(&present.bodies, keep),
        }
    }

    /// Takes the way of a move, unless the other arm is too near to it or is itself on a way too near.
    /// From then on the other arm's moves keep clear of it, until [`Berth::clear`].
    pub fn take(&self, way: Sweep, keep: &Keep) -> Result<(), Error> {
        let Neighbour::Beside { side, record, .. } = &self.neighbour else {
            return match self.neighbour {
                Neighbour::Unstated => Err(Error::LayoutUnknown),
                _ => Ok(()),
            };
        };
        let way = Arc::new(way);
        for _ in 0..ATTEMPTS {
            let other = lock(record)[side.other() as usize].clone();
            let present = other.present.ok_or(Error::OtherArmUnknown)?;
            match &other.way {
                Some(theirs) => way.keeps_clear_of_sweep(theirs, keep)?,
                None => way.keeps_clear_of(&present.bodies, keep)?,
            }
            // The search takes ms and must not hold up the other arm's cycle.
            let mut records = lock(record);
            if records[side.other() as usize].changes == other.changes {
                let own = &mut records[*side as usize];
                own.way = Some(way);
                own.changes += 1;
                return Ok(());
            }
        }
        Err(Error::Busy)
    }

    /// Takes the way whatever is near: drawing back along the shaft must always be open.
    pub fn take_way_out(&self, way: Sweep) {
        if let Some((mut records, side)) = self.records() {
            let own = &mut records[side as usize];
            own.way = Some(Arc::new(way));
            own.changes += 1;
        }
    }

    /// The move has ended.
    pub fn clear(&self) {
        if let Some((mut records, side)) = self.records() {
            let own = &mut records[side as usize];
            if own.way.take().is_some() {
                own.changes += 1;
            }
        }
    }

    fn records(&self) -> Option<(MutexGuard<'_, [Record; 2]>, Side)> {
        match &self.neighbour {
            Neighbour::Beside { side, record, .. } => Some((lock(record), *side)),
            Neighbour::Apart | Neighbour::Unstated => None,
        }
    }
}

/// A panic of the other owner must not take this one down: a record is valid between any two statements.
fn lock(record: &Mutex<[Record; 2]>) -> MutexGuard<'_, [Record; 2]> {
    record.lock().unwrap_or_else(PoisonError::into_inner)
}
