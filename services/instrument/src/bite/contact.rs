//! Feels by the current where the jaw meets something.
//!
//! The current of the free jaw is learnt in the first part of the stroke, once the motor has its speed, and followed where
//! it changes slowly. From then on a current that is above both the configured one and the free one by a rise is contact.
//! Where it began is later told from the samples around: between the last one that was still free and the line through
//! those on the way up.

use std::time::Duration;

/// What the detector must know.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct ContactSpec {
    /// A current below this is no contact, mA.
    pub current_ma: f64,
    /// Nor is one that is not this much above the free one, mA.
    pub rise_ma: f64,
    /// How far the free current is learnt for, mm.
    pub free_running_mm: f64,
    /// What the jaw's spring adds to the free current, mA/mm.
    pub spring_ma_per_mm: f64,
    /// Closing speed.
    pub speed_mm_s: f64,
    /// On the way to it.
    pub acceleration_mm_s2: f64,
}

/// Watches the current of a closing jaw.
#[derive(Clone, Copy, Debug)]
pub struct ContactWatch {
    spec: ContactSpec,
    start_mm: f64,
    started: Duration,
    /// Until then the motor is on its way to another speed.
    settles_at: Duration,
    /// Where learning began.
    learning_from_mm: Option<f64>,
    learnt: Learnt,
    free: bool,
    last_free_mm: f64,
    /// The first sample above the free current since the last one that was free: where, and by how much.
    rising_from: Option<(f64, f64)>,
    /// The current has risen by half of what is contact.
    suspected: bool,
    contact: Option<Contact>,
    peak_ma: f64,
}

/// The jaw met something.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Contact {
    /// Where; `None` when it was there before the free current could be learnt.
    pub position_mm: Option<f64>,
    /// The first position at which it was seen, which is at or beyond where it was met.
    pub seen_mm: f64,
}

/// Mean and spread, by Welford's method.
#[derive(Clone, Copy, Debug, Default)]
struct Learnt {
    count: u32,
    mean_ma: f64,
    squares: f64,
}

impl ContactWatch {
    /// After the profile's acceleration, the controller gets this time to settle.
    const SETTLING: Duration = Duration::from_millis(50);
    /// Currents nearer to the free one than this are free, mA: the drive tells whole mA, and ripples.
    const LEAST_NOISE_MA: f64 = 4.0;
    /// The free current is followed over this distance, mm: springs and friction change slowly, tissue does not.
    const FOLLOWED_OVER_MM: f64 = 2.0;
    /// A suspicion stands over this distance, mm, whatever the current does: longer than the motor needs to become slow.
    const SUSPECTED_OVER_MM: f64 = 0.4;

    /// Closing begins here and now.
    pub fn new(spec: ContactSpec, start_mm: f64, started: Duration) -> Self {
        Self {
            spec,
            start_mm,
            started,
            settles_at: Duration::ZERO,
            learning_from_mm: None,
            learnt: Learnt::default(),
            free: false,
            last_free_mm: start_mm,
            rising_from: None,
            suspected: false,
            contact: None,
            peak_ma: 0.0,
        }
    }

    /// The profile has begun at this time of the bus.
    pub fn begin(&mut self, stamp: Duration) {
        self.started = stamp;
    }

    /// From this time of the bus on, the motor goes over to another speed, for this long: what it draws meanwhile says
    /// nothing.
    pub fn change_speed(&mut self, stamp: Duration, takes: Duration) {
        self.settles_at = stamp + takes + Self::SETTLING;
    }

    /// The first contact.
    pub fn contact(&self) -> Option<Contact> {
        self.contact
    }

    /// Whether the jaw meets something, or seems about to.
    pub fn is_suspected(&self) -> bool {
        self.suspected || self.contact.is_some()
    }

    /// The current of the free jaw as far as it was learnt, mA.
    pub fn free_ma(&self) -> f64 {
        self.learnt.mean_ma
    }

    /// The highest current since the motor had its speed, mA.
    pub fn peak_ma(&self) -> f64 {
        self.peak_ma
    }

    /// Takes a current without sign.
    pub fn observe(&mut self, position_mm: f64, current_ma: f64, stamp: Duration) {
        if stamp < self.settles_at {
            return;
        }
        let Some(learning_from_mm) = self.learning_from_mm else {
            if self.has_speed(position_mm, stamp) {
                self.learning_from_mm = Some(position_mm);
                self.peak_ma = current_ma;
                self.learn(position_mm, position_mm, current_ma);
            }
            return;
        };
        self.peak_ma = self.peak_ma.max(current_ma);
        if self.contact.is_some() {
            return;
        }
        if !self.free {
            self.learn(learning_from_mm, position_mm, current_ma);
            return;
        }
        let excess_ma = self.excess_ma(learning_from_mm, position_mm, current_ma);
        if excess_ma <= self.noise_ma() {
            // The motor that becomes slower for a suspicion draws less for a moment.
            let rising_mm = self.rising_from.map(|(from_mm, _)| position_mm - from_mm);
            if self.suspected && rising_mm.is_some_and(|mm| mm < Self::SUSPECTED_OVER_MM) {
                return;
            }
            let share = (position_mm - self.last_free_mm) / Self::FOLLOWED_OVER_MM;
            self.learnt.mean_ma += excess_ma * share.clamp(0.0, 1.0);
            self.last_free_mm = position_mm;
            self.rising_from = None;
            return;
        }
        self.suspected |= excess_ma >= 0.5 * self.spec.rise_ma;
        let (from_mm, from_ma) = *self.rising_from.get_or_insert((position_mm, excess_ma));
        if excess_ma >= self.spec.rise_ma && current_ma >= self.spec.current_ma {
            self.contact = Some(Contact {
                position_mm: Some(self.onset_mm((from_mm, from_ma), (position_mm, excess_ma))),
                seen_mm: from_mm,
            });
        }
    }

    /// A motor that gets its speed draws more than one that has it.
    fn has_speed(&self, position_mm: f64, stamp: Duration) -> bool {
        let ContactSpec {
            speed_mm_s,
            acceleration_mm_s2,
            ..
        } = self.spec;
        let takes = Duration::from_secs_f64(speed_mm_s / acceleration_mm_s2) + Self::SETTLING;
        let covers_mm = 0.5 * speed_mm_s * speed_mm_s / acceleration_mm_s2;
        stamp.saturating_sub(self.started) >= takes && position_mm - self.start_mm >= covers_mm
    }

    fn learn(&mut self, from_mm: f64, position_mm: f64, current_ma: f64) {
        if current_ma >= self.spec.current_ma {
            self.contact = Some(Contact {
                position_mm: None,
                seen_mm: position_mm,
            });
            return;
        }
        self.learnt
            .add(current_ma - self.spec.spring_ma_per_mm * (position_mm - from_mm));
        self.last_free_mm = position_mm;
        self.free = position_mm - from_mm >= self.spec.free_running_mm;
    }

    fn excess_ma(&self, from_mm: f64, position_mm: f64, current_ma: f64) -> f64 {
        current_ma - self.learnt.mean_ma - self.spec.spring_ma_per_mm * (position_mm - from_mm)
    }

    fn noise_ma(&self) -> f64 {
        (4.0 * self.learnt.deviation_ma()).clamp(Self::LEAST_NOISE_MA, 0.5 * self.spec.rise_ma)
    }

    /// Where the line through two samples on the way up meets the free current: before the first one that was not free,
    /// and after the last one that was, but for what passes as noise.
    fn onset_mm(&self, (from_mm, from_ma): (f64, f64), (to_mm, to_ma): (f64, f64)) -> f64 {
        let last_free_mm = self.last_free_mm.min(from_mm);
        if to_ma <= from_ma || to_mm <= from_mm {
            return 0.5 * (last_free_mm + from_mm);
        }
        let mm_per_ma = (to_mm - from_mm) / (to_ma - from_ma);
        let earliest_mm = last_free_mm - self.noise_ma() * mm_per_ma;
        (from_mm - from_ma * mm_per_ma).clamp(earliest_mm, from_mm)
    }
}

impl Learnt {
    fn add(&mut self, current_ma: f64) {
        self.count += 1;
        let from_mean_ma = current_ma - self.mean_ma;
        self.mean_ma += from_mean_ma / f64::from(self.count);
        self.squares += from_mean_ma * (current_ma - self.mean_ma);
    }

    fn deviation_ma(&self) -> f64 {
        match self.count {
            0 | 1 => 0.0,
            count => (self.squares / f64::from(count - 1)).sqrt(),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SPEC: ContactSpec = ContactSpec {
        current_ma: 120.0,
        rise_ma: 40.0,
        free_running_mm: 1.0,
        spring_ma_per_mm: 0.0,
        speed_mm_s: 5.0,
        acceleration_mm_s2: 50.0,
    };

    /// A jaw with the profile of [`SPEC`] from 0 mm, looked at every 10 ms from this time after its start. Its current is
    /// that of friction, acceleration and what resists at a position, in whole mA.
    fn close(
        spec: ContactSpec,
        friction_ma: f64,
        first_look_s: f64,
        ripple: impl Fn(u32) -> f64,
        resists_ma: impl Fn(f64) -> f64,
    ) -> ContactWatch {
        let mut watch = ContactWatch::new(spec, 0.0, Duration::from_secs(5));
        for look in 0..190 {
            let time_s = first_look_s + 0.01 * f64::from(look);
            let (position_mm, accelerates_ma) = match time_s {
                time_s if time_s < 0.1 => (25.0 * time_s * time_s, 250.0),
                time_s => (0.25 + 5.0 * (time_s - 0.1), 0.0),
            };
            let current_ma =
                friction_ma + accelerates_ma + ripple(look) + resists_ma(position_mm).max(0.0);
            watch.observe(
                position_mm,
                current_ma.round(),
                Duration::from_secs_f64(5.0 + time_s),
            );
        }
        watch
    }

    fn still(_: u32) -> f64 {
        0.0
    }

    #[test]
    fn a_free_jaw_meets_nothing() {
        let watch = close(SPEC, 40.0, 0.0, still, |_| 0.0);
        assert_eq!(
            watch.contact(),
            None,
            "the current of acceleration is no contact"
        );
        assert_eq!(watch.peak_ma(), 40.0);
    }

    #[test]
    fn friction_above_the_configured_current_alone_is_no_contact_later_on() {
        // Learnt at 100 mA, and it grows.
        let watch = close(SPEC, 100.0, 0.0, still, |mm| 3.5 * mm);
        assert_eq!(watch.contact(), None);
    }

    #[test]
    fn a_spring_that_is_known_is_no_contact() {
        let spring = |mm: f64| 12.0 * mm;
        let known = ContactSpec {
            spring_ma_per_mm: 12.0,
            ..SPEC
        };
        assert_eq!(close(known, 40.0, 0.0, still, spring).contact(), None);
        assert!(
            close(SPEC, 40.0, 0.0, still, spring).contact().is_some(),
            "an unknown one is"
        );
    }

    #[test]
    fn what_is_between_the_blades_from_the_first_is_felt_without_a_place() {
        let watch = close(SPEC, 40.0, 0.0, still, |mm| 300.0 * mm);
        let contact = watch.contact().unwrap();
        assert_eq!(contact.position_mm, None);
        assert!(contact.seen_mm < 1.0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(10_000))]

        #[test]
        fn contact_is_found_within_a_tenth_of_a_millimetre(
            at_mm in 1.65..7.5_f64,
            stiffness_ma_per_mm in 80.0..4000.0_f64,
            first_look_s in 0.0..0.01_f64,
            friction_ma in 10.0..75.0_f64,
            ripple_ma in 0.0..3.0_f64,
            spring_ma_per_mm in 0.0..1.5_f64,
        ) {
            let ripple = |look: u32| ripple_ma * f64::from(look * 7 % 11) / 5.5 - ripple_ma;
            let watch = close(SPEC, friction_ma, first_look_s, ripple, |mm| {
                spring_ma_per_mm * mm + stiffness_ma_per_mm * (mm - at_mm).max(0.0)
            });
            let found_mm = watch.contact().unwrap().position_mm.unwrap();
            prop_assert!((found_mm - at_mm).abs() <= 0.1, "{} instead of {}", found_mm, at_mm);
        }
    }
}
