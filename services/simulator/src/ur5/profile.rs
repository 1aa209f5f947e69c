//! How far along its path a move is: speed that rises, stays and falls (a trapezoid, or a triangle when the path is short).

/// A path of some length (rad, m, or 1) covered from rest to rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trapezoid {
    length: f64,
    accel: f64,
    ramp_s: f64,
    cruise_s: f64,
}

impl Trapezoid {
    /// With bounded speed and acceleration, both positive.
    pub fn bounded(length: f64, speed: f64, accel: f64) -> Self {
        let peak = speed.min((length * accel).sqrt());
        if peak <= 0.0 {
            return Self {
                length,
                accel,
                ramp_s: 0.0,
                cruise_s: 0.0,
            };
        }
        Self {
            length,
            accel,
            ramp_s: peak / accel,
            cruise_s: (length / peak - peak / accel).max(0.0),
        }
    }

    /// In exactly this time, a third of it each to speed up and to slow down.
    pub fn timed(length: f64, duration_s: f64) -> Self {
        let ramp_s = duration_s / 3.0;
        Self {
            length,
            accel: length / (2.0 * ramp_s * ramp_s),
            ramp_s,
            cruise_s: ramp_s,
        }
    }

    /// From start to end.
    pub fn duration_s(&self) -> f64 {
        2.0 * self.ramp_s + self.cruise_s
    }

    /// Way covered after this time, 0 to the whole length.
    pub fn at(&self, time_s: f64) -> f64 {
        let left_s = self.duration_s() - time_s;
        if left_s <= 0.0 {
            self.length
        } else if time_s <= 0.0 {
            0.0
        } else if time_s < self.ramp_s {
            0.5 * self.accel * time_s * time_s
        } else if left_s < self.ramp_s {
            self.length - 0.5 * self.accel * left_s * left_s
        } else {
            self.accel * self.ramp_s * (time_s - 0.5 * self.ramp_s)
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn speed_and_acceleration_stay_bounded(length in 1e-4..5.0f64, speed in 0.01..3.0f64, accel in 0.1..10.0f64) {
            let profile = Trapezoid::bounded(length, speed, accel);
            let step = profile.duration_s() / 500.0;
            let way: Vec<_> = (0..=500).map(|n| profile.at(f64::from(n) * step)).collect();
            prop_assert!((way[500] - length).abs() < 1e-9);
            for triple in way.windows(3) {
                let (before, after) = ((triple[1] - triple[0]) / step, (triple[2] - triple[1]) / step);
                prop_assert!(before >= -1e-9 && before <= speed * (1.0 + 1e-6));
                prop_assert!((after - before).abs() / step <= accel * (1.0 + 1e-3) + 1e-6);
            }
        }
    }

    #[test]
    fn a_timed_move_takes_its_time() {
        let profile = Trapezoid::timed(0.6, 3.0);
        assert!((profile.duration_s() - 3.0).abs() < 1e-12);
        assert!((profile.at(1.5) - 0.3).abs() < 1e-12);
    }
}
