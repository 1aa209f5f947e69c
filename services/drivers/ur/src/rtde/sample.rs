//! A typed stream of states, and one state of it with what must be known before it is acted on.

use std::{
    marker::PhantomData,
    time::{Duration, Instant},
};

use super::{
    client::OutputRecipe,
    freshness::{Freshness, Stale},
    inbox::Wanted,
    recipe::{Outputs, offset_of},
    wire::{self, Type},
};
use crate::Error;

const TIMESTAMP: (&str, Type) = ("timestamp", Type::Double);

/// A state and how fresh it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample<S> {
    /// The fields of the recipe.
    pub state: S,
    /// The controller's clock, s since its start. Grows from sample to sample.
    pub timestamp_s: f64,
    /// Number of this state, those counted that nobody saw. The first sample has 1.
    pub number: u64,
    /// States between the last sample and this one that nobody saw: not sent by the controller, by its clock, or replaced
    /// by this one before they were read. 0: none was missed.
    pub skipped: u64,
    /// How much longer it was under way than the quickest of the last seconds: time it waited in the controller, the
    /// network or for this process. Needs a controller whose clock runs as fast as ours; one that runs faster (some
    /// simulators) shows 0.
    pub lateness: Duration,
    /// When it was taken from the socket.
    pub received: Instant,
}

impl<S> Sample<S> {
    /// How old the state is: lateness, and the time since it was received.
    pub fn age(&self) -> Duration {
        self.age_at(Instant::now())
    }

    /// How old the state is at this moment.
    pub fn age_at(&self, now: Instant) -> Duration {
        self.lateness + now.saturating_duration_since(self.received)
    }
}

/// A typed output recipe that a controller accepted, and the memory of what came last.
#[derive(Clone, Debug)]
pub struct Subscription<S> {
    pub(super) recipe: OutputRecipe,
    /// Fields that precede those of `S`: the timestamp, where `S` has none.
    timestamp_offset: usize,
    state_offset: usize,
    freshness: Freshness,
    began: Instant,
    /// Of the last sample.
    number: u64,
    /// Packages received since the last sample.
    packages: u64,
    state: PhantomData<S>,
}

impl<S: Outputs> Subscription<S> {
    /// Names to ask for: those of `S`, with the timestamp before them if it has none.
    pub(super) fn fields() -> Vec<(&'static str, Type)> {
        let stamp = offset_of(S::FIELDS, TIMESTAMP.0)
            .is_none()
            .then_some(TIMESTAMP);
        stamp.into_iter().chain(S::FIELDS.iter().copied()).collect()
    }

    pub(super) fn new(recipe: OutputRecipe, frequency_hz: f64) -> Self {
        let offset = offset_of(S::FIELDS, TIMESTAMP.0);
        Self {
            recipe,
            timestamp_offset: offset.unwrap_or(0),
            state_offset: if offset.is_some() {
                0
            } else {
                TIMESTAMP.1.bytes()
            },
            freshness: Freshness::new(frequency_hz),
            began: Instant::now(),
            number: 0,
            packages: 0,
            state: PhantomData,
        }
    }

    pub(super) fn wanted(&self, version: wire::Version) -> Wanted {
        self.recipe.wanted(version)
    }

    /// The sample of the newest of some packages received now; `None` when it is not newer than the last.
    pub(super) fn sample(
        &mut self,
        package: &[u8],
        packages: u64,
    ) -> Result<Option<Sample<S>>, Error> {
        self.packages += packages;
        let received = Instant::now();
        let mut stamp = package.get(self.timestamp_offset..).unwrap_or_default();
        let mut fields = package.get(self.state_offset..).unwrap_or_default();
        let (Some(stamp), Some(state)) = (wire::take(&mut stamp), S::decode(&mut fields)) else {
            return Err(Error::Wire(wire::Error::Short(b'U')));
        };
        let timestamp_s = f64::from_be_bytes(stamp);
        match self
            .freshness
            .judge(timestamp_s, received.saturating_duration_since(self.began))
        {
            Ok(fresh) => {
                // What came before the first sample is nobody's loss.
                let replaced = std::mem::take(&mut self.packages).saturating_sub(1);
                let skipped = match self.number {
                    0 => 0,
                    _ => fresh.skipped.max(replaced),
                };
                self.number = self.number.saturating_add(skipped).saturating_add(1);
                Ok(Some(Sample {
                    state,
                    timestamp_s,
                    number: self.number,
                    skipped,
                    lateness: fresh.lateness,
                    received,
                }))
            }
            Err(Stale::Old) => {
                self.packages = self.packages.saturating_sub(1);
                Ok(None)
            }
            Err(Stale::NoTime) => Err(Error::Value {
                field: "timestamp",
                value: timestamp_s,
                limit: "finite numbers",
            }),
        }
    }
}
