//! How fast a path is run through: s over time from rest to rest, with limited speed, acceleration
//! and jerk.

/// Limits of s, which runs from 0 to 1: per s, s2 and s3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateLimits {
    /// Largest ds/dt, 1/s.
    pub speed: f64,
    /// Largest second derivative, 1/s2.
    pub acceleration: f64,
    /// Largest third derivative, 1/s3.
    pub jerk: f64,
}

/// The fastest s(t) from 0 to 1 within the limits whose two ramps are alike. The second half mirrors
/// the first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeLaw {
    /// Reached speed.
    speed: f64,
    jerk: f64,
    /// Duration of each part of constant jerk, s.
    jerk_s: f64,
    /// Duration of speeding up, s.
    ramp_s: f64,
    duration_s: f64,
}

impl TimeLaw {
    /// All limits must be greater than zero.
    pub fn new(limits: &RateLimits) -> Self {
        let RateLimits {
            speed,
            acceleration,
            jerk,
        } = *limits;
        let reached = speed.min(peak_speed(acceleration, jerk));
        let jerk_s = (reached / jerk).sqrt().min(acceleration / jerk);
        let ramp_s = jerk_s + reached / (jerk * jerk_s);
        // The ramps cover speed * ramp_s together.
        let cruise_s = (1.0 / reached - ramp_s).max(0.0);
        Self {
            speed: reached,
            jerk,
            jerk_s,
            ramp_s,
            duration_s: 2.0 * ramp_s + cruise_s,
        }
    }

    /// From 0 to 1, s.
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// s at `time_s` after the start; 0 before and 1 after the motion.
    pub fn at(&self, time_s: f64) -> f64 {
        if time_s >= 0.5 * self.duration_s {
            1.0 - self.first_half(self.duration_s - time_s)
        } else {
            self.first_half(time_s)
        }
    }

    fn first_half(&self, time_s: f64) -> f64 {
        let acceleration = self.jerk * self.jerk_s;
        if time_s <= 0.0 {
            0.0
        } else if time_s < self.jerk_s {
            self.jerk * time_s.powi(3) / 6.0
        } else if time_s < self.ramp_s - self.jerk_s {
            acceleration * (time_s * (time_s - self.jerk_s) / 2.0 + self.jerk_s.powi(2) / 6.0)
        } else {
            let to_cruise_s = (self.ramp_s - time_s).max(0.0);
            self.speed * (time_s - 0.5 * self.ramp_s) + self.jerk * to_cruise_s.powi(3) / 6.0
        }
    }
}

/// The speed at which two ramps alone cover the whole way.
fn peak_speed(acceleration: f64, jerk: f64) -> f64 {
    // With the full acceleration reached, a ramp to v lasts v/a + a/j, and v times that is 1.
    let rounding_s = acceleration / jerk;
    let reached =
        0.5 * acceleration * ((rounding_s.powi(2) + 4.0 / acceleration).sqrt() - rounding_s);
    if reached >= acceleration * rounding_s {
        reached
    } else {
        // Without it a ramp to v lasts 2 sqrt(v/j).
        (0.25 * jerk).cbrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_law_goes_from_rest_to_rest_within_its_limits(
            speed in 0.01..10.0f64, acceleration in 0.01..50.0f64, jerk in 0.05..500.0f64,
        ) {
            let limits = RateLimits { speed, acceleration, jerk };
            let law = TimeLaw::new(&limits);
            prop_assert_eq!(law.at(0.0), 0.0);
            prop_assert_eq!(law.at(law.duration_s()), 1.0);
            let h = law.duration_s() / 2000.0;
            let s: Vec<f64> = (0..=2000).map(|i| law.at(i as f64 * h)).collect();
            for w in s.windows(4) {
                let v = (w[1] - w[0]) / h;
                let a = (w[2] - 2.0 * w[1] + w[0]) / (h * h);
                let j = (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]) / (h * h * h);
                prop_assert!(v >= -1e-9);
                prop_assert!(v <= speed * (1.0 + 1e-6));
                prop_assert!(a.abs() <= acceleration * (1.0 + 1e-6) + 1e-7 / (h * h) * 1e-6);
                // Third differences of doubles: rounding grows with 1/h3.
                prop_assert!(j.abs() <= jerk * (1.0 + 1e-6) + 1e-14 / (h * h * h), "{} > {}", j, jerk);
            }
        }

        #[test]
        fn the_law_is_symmetric(
            speed in 0.01..10.0f64, acceleration in 0.01..50.0f64, jerk in 0.05..500.0f64, t in 0.0..1.0f64,
        ) {
            let law = TimeLaw::new(&RateLimits { speed, acceleration, jerk });
            let (a, b) = (law.at(t * law.duration_s()), law.at((1.0 - t) * law.duration_s()));
            prop_assert!((a + b - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn a_slow_limit_gives_a_cruise_at_that_speed() {
        let law = TimeLaw::new(&RateLimits {
            speed: 0.5,
            acceleration: 5.0,
            jerk: 50.0,
        });
        assert!((law.duration_s() - (2.0 + 0.2)).abs() < 1e-12);
    }
}
