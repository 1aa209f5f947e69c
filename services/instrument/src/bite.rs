//! The bite: the forceps feed runs forward until the jaw is closed or something stops it. Where it stands says whether it
//! is closed, the current says on what, and whatever does not fit together says that nobody knows.

pub mod contact;
mod error;
mod steepness;

use std::time::Duration;

use epos4_link::cia402::{State, Statusword};

use self::contact::{Contact, ContactSpec, ContactWatch};
pub use self::error::BiteError;
use self::steepness::Steepness;
use crate::force::ForceTable;
use crate::positioning::Sample;

/// The bite of this forceps.
#[derive(Clone, PartialEq, Debug)]
pub struct BiteSpec {
    /// Where the jaw is open, mm: a bite begins at or behind it.
    pub open_mm: f64,
    /// Where the empty blades touch, mm.
    pub closed_mm: f64,
    /// How far before that the jaw counts as closed on what is between, mm.
    pub closed_tolerance_mm: f64,
    /// The highest current of a bite, mA.
    pub current_limit_ma: f64,
    /// How contact is felt; with the closing speed.
    pub contact: ContactSpec,
    /// How it presses.
    pub press: Press,
    /// How blade on blade is felt; `None` where it is not looked for.
    pub blades: Option<Blades>,
    /// What the jaw presses with; `None` when nobody has measured it.
    pub force: Option<ForceTable>,
}

/// Slowly, so that the current is what presses: the momentum of a motor at closing speed presses with half as much again.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Press {
    /// From contact on, and where the blades are about to touch, mm/s.
    pub speed_mm_s: f64,
    /// How far before the blades touch, mm.
    pub from_mm: f64,
    /// On the way to that speed, mm/s^2.
    pub deceleration_mm_s2: f64,
}

/// Blade on blade: the feed presses on beyond the touch, and the current must rise.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Blades {
    /// A rise of at least this over the last 0.2 mm, mA.
    pub current_ma: f64,
    /// Pressed on for, mm.
    pub overtravel_mm: f64,
}

/// What is known of the jaw.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Jaw {
    /// At or behind the open position.
    Open,
    /// A command moves it.
    Moving,
    /// Closed, and nothing was felt on the way.
    ClosedEmpty,
    /// Closed, and something was felt on the way or is between the blades.
    ClosedOnTissue,
    /// After any doubt, until opened or homed.
    #[default]
    Unknown,
}

/// What a bite came to.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum BiteResult {
    /// The blades met and nothing was felt before.
    ClosedEmpty,
    /// Something was felt, and the jaw closed: through it, or on what is thin enough to count as closed.
    ClosedOnTissue,
    /// Stopped at the current limit with the jaw still open.
    NotClosed,
    /// Stopped otherwise: what the drive tells does not fit together, or something else holds it.
    Stalled,
}

/// How a bite ended.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct BiteEnd {
    /// What it came to.
    pub result: BiteResult,
    /// Where the feed stands.
    pub position_mm: f64,
    /// Where the jaw met something; `None` when it met nothing, or did so before the free current could be learnt.
    pub contact_mm: Option<f64>,
    /// The highest current seen, that of the acceleration too.
    pub peak_current_ma: f64,
    /// The force at the highest current after the acceleration; `None` without table or outside of it.
    pub force_n: Option<f64>,
}

/// Watches a closing jaw.
#[derive(Clone, Debug)]
pub struct Watch {
    spec: BiteSpec,
    limit_ma: f64,
    tolerance_mm: f64,
    start: (f64, Duration),
    time_limit: Duration,
    peak_current_ma: f64,
    contact: ContactWatch,
    steepness: Steepness,
    /// The farthest position and when it was reached.
    farthest: (f64, Duration),
}

// === impl BiteSpec ===

impl BiteSpec {
    /// Where the feed is sent.
    pub fn target_mm(&self) -> f64 {
        self.closed_mm + self.blades.map_or(0.0, |blades| blades.overtravel_mm)
    }

    /// From here on a current that rises may be that of the blades: contact is told to a tenth of a millimetre.
    fn blades_from_mm(&self) -> f64 {
        const CONTACT_ACCURACY_MM: f64 = 0.1;
        self.closed_mm - CONTACT_ACCURACY_MM
    }

    /// From here on the jaw counts as closed.
    pub fn closed_from_mm(&self) -> f64 {
        self.closed_mm - self.closed_tolerance_mm
    }
}

// === impl Jaw ===

impl Jaw {
    /// What was known of a jaw at rest, held against a new look at its axis: any contradiction is a doubt.
    pub fn held_against(self, spec: &BiteSpec, tolerance_mm: f64, sample: Option<&Sample>) -> Self {
        let fits = |within: &dyn Fn(f64) -> bool| {
            sample.is_some_and(|sample| {
                sample.statusword.has(Statusword::REFERENCED) && within(sample.position)
            })
        };
        // Without power nothing holds it closed.
        let has_power =
            sample.is_some_and(|sample| sample.statusword.state() == Some(State::OperationEnabled));
        match self {
            Self::Open if fits(&|mm| mm <= spec.open_mm + tolerance_mm) => self,
            Self::ClosedEmpty | Self::ClosedOnTissue
                if fits(&|mm| mm >= spec.closed_from_mm() - tolerance_mm) && has_power =>
            {
                self
            }
            Self::Moving => self,
            _ => Self::Unknown,
        }
    }
}

// === impl BiteResult ===

impl BiteResult {
    /// What is known of the jaw after it.
    pub fn jaw(self) -> Jaw {
        match self {
            Self::ClosedEmpty => Jaw::ClosedEmpty,
            Self::ClosedOnTissue => Jaw::ClosedOnTissue,
            Self::NotClosed | Self::Stalled => Jaw::Unknown,
        }
    }
}

// === impl Watch ===

impl Watch {
    /// Less than this is no progress.
    const PROGRESS_MM: f64 = 0.02;
    /// Standing for this long at the current limit is a jaw that is stopped.
    const STOPPED_AFTER: Duration = Duration::from_millis(150);
    /// Standing for this long below the limit is a jaw that something else holds.
    const STALLED_AFTER: Duration = Duration::from_secs(1);
    /// At the limit means: from this share on. The limit itself is the drive's; what it measures ripples.
    const AT_LIMIT: f64 = 0.9;

    /// Closing begins with this sample; refused unless the jaw is open.
    pub fn new(
        spec: BiteSpec,
        limit_ma: f64,
        tolerance_mm: f64,
        first: &Sample,
    ) -> Result<Self, BiteError> {
        let start = (first.position, first.stamp);
        if start.0 > spec.open_mm + tolerance_mm {
            return Err(BiteError::NotOpen {
                position_mm: start.0,
                open_mm: spec.open_mm,
            });
        }
        let ContactSpec {
            speed_mm_s,
            acceleration_mm_s2,
            ..
        } = spec.contact;
        // All of the way may be pressed.
        let profile_s = (spec.target_mm() - start.0) / speed_mm_s.min(spec.press.speed_mm_s)
            + speed_mm_s / acceleration_mm_s2;
        Ok(Self {
            limit_ma,
            tolerance_mm,
            start,
            time_limit: Duration::from_secs_f64(2.0 * profile_s + 5.0),
            peak_current_ma: 0.0,
            contact: ContactWatch::new(spec.contact, start.0, start.1),
            steepness: Steepness::default(),
            farthest: start,
            spec,
        })
    }

    /// The drive has begun to close at this time of the bus.
    pub fn begin(&mut self, stamp: Duration) {
        self.start.1 = stamp;
        self.farthest.1 = stamp;
        self.contact.begin(stamp);
    }

    /// The drive has begun to press at this time of the bus.
    pub fn press(&mut self, stamp: Duration) {
        let press = self.spec.press;
        let slower_mm_s = self.spec.contact.speed_mm_s - press.speed_mm_s;
        let takes = Duration::from_secs_f64(slower_mm_s / press.deceleration_mm_s2);
        self.contact.change_speed(stamp, takes);
    }

    /// Whether the jaw is to close slowly from now on.
    pub fn presses(&self) -> bool {
        self.contact.is_suspected()
            || self.farthest.0 >= self.spec.closed_mm - self.spec.press.from_mm
    }

    /// Takes what the motor went through before a sample, in the order of time.
    pub fn pass(&mut self, position_mm: f64, current_ma: f64, stamp: Duration) {
        let current_ma = current_ma.abs();
        self.peak_current_ma = self.peak_current_ma.max(current_ma);
        self.contact.observe(position_mm, current_ma, stamp);
        self.steepness.observe(position_mm, current_ma);
    }

    /// Takes a sample; an answer when the bite is over.
    pub fn observe(&mut self, sample: &Sample) -> Option<Result<BiteEnd, BiteError>> {
        let Sample {
            statusword,
            position: position_mm,
            stamp,
            ..
        } = *sample;
        let current_ma = sample.current_ma.abs();
        if statusword.state() != Some(State::OperationEnabled) {
            return Some(Err(BiteError::LeftOperation {
                position_mm,
                statusword,
            }));
        }
        if !statusword.has(Statusword::REFERENCED) {
            return Some(Err(BiteError::ReferenceLost {
                position_mm,
                statusword,
            }));
        }
        self.pass(position_mm, current_ma, stamp);
        let arrived = position_mm >= self.spec.target_mm() - self.tolerance_mm;
        if arrived && statusword.has(Statusword::TARGET_REACHED) {
            return Some(self.closed(self.closed_on(), position_mm));
        }
        if position_mm >= self.farthest.0 + Self::PROGRESS_MM {
            self.farthest = (position_mm, stamp);
        }
        let standing = stamp.saturating_sub(self.farthest.1);
        let at_limit = current_ma >= Self::AT_LIMIT * self.limit_ma;
        if at_limit && standing >= Self::STOPPED_AFTER {
            return Some(self.stopped_at(position_mm));
        }
        if standing >= Self::STALLED_AFTER {
            return Some(Err(BiteError::Stalled {
                end: self.end(BiteResult::Stalled, position_mm),
                target_mm: self.spec.target_mm(),
                current_ma,
                limit_ma: self.limit_ma,
            }));
        }
        let late = stamp.saturating_sub(self.start.1) > self.time_limit;
        late.then(|| {
            Err(BiteError::TooSlow {
                end: self.end(BiteResult::Stalled, position_mm),
                limit: self.time_limit,
            })
        })
    }

    /// The limit stopped it: closed, if it is far enough.
    fn stopped_at(&self, position_mm: f64) -> Result<BiteEnd, BiteError> {
        let limit_ma = self.limit_ma;
        if self.farthest.0 <= self.start.0 {
            return Err(BiteError::NeverMoved {
                end: self.end(BiteResult::Stalled, position_mm),
                limit_ma,
            });
        }
        if position_mm < self.spec.closed_from_mm() {
            return Err(BiteError::NotClosed {
                end: self.end(BiteResult::NotClosed, position_mm),
                limit_ma,
                closed_from_mm: self.spec.closed_from_mm(),
            });
        }
        // Short of the blades it was something else.
        let closed_on = match position_mm < self.spec.blades_from_mm() {
            true => BiteResult::ClosedOnTissue,
            false => self.closed_on(),
        };
        self.closed(closed_on, position_mm)
    }

    /// The encoder says closed: the end must be as stiff as blade on blade, where that is looked for.
    fn closed(&self, result: BiteResult, position_mm: f64) -> Result<BiteEnd, BiteError> {
        let Some(blades) = self.spec.blades else {
            return Ok(self.end(result, position_mm));
        };
        // A limit that is near to the free current leaves less room to rise.
        const SHARE_OF_ROOM: f64 = 0.7;
        let room_ma = SHARE_OF_ROOM * (self.limit_ma - self.contact.free_ma());
        let (rise_ma, needed_ma) = (self.steepness.rise_ma(), blades.current_ma.min(room_ma));
        if rise_ma >= needed_ma {
            return Ok(self.end(result, position_mm));
        }
        Err(BiteError::BladesNotFelt {
            end: self.end(BiteResult::Stalled, position_mm),
            rise_ma,
            needed_ma,
        })
    }

    fn closed_on(&self) -> BiteResult {
        match self.tissue() {
            Some(_) => BiteResult::ClosedOnTissue,
            None => BiteResult::ClosedEmpty,
        }
    }

    /// What was first seen where the blades touch are the blades.
    fn tissue(&self) -> Option<Contact> {
        let blades_from_mm = self.spec.blades_from_mm();
        self.contact
            .contact()
            .filter(|contact| contact.seen_mm < blades_from_mm)
    }

    fn end(&self, result: BiteResult, position_mm: f64) -> BiteEnd {
        BiteEnd {
            result,
            position_mm,
            contact_mm: self.tissue().and_then(|contact| contact.position_mm),
            peak_current_ma: self.peak_current_ma,
            force_n: self
                .spec
                .force
                .as_ref()
                .and_then(|table| table.force_n(self.contact.peak_ma())),
        }
    }
}

#[cfg(test)]
mod model_tests;
#[cfg(test)]
mod tests;
