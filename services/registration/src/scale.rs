//! Which scales a registration may answer.

/// The scales that a camera_from_ct similarity may have, both ends included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleRange {
    /// Smallest scale.
    pub low: f64,
    /// Largest scale.
    pub high: f64,
}

impl ScaleRange {
    /// How far a known scale may be off, as a fraction: what a calibrated sensor and a scanner disagree at most.
    pub const KNOWN_TOLERANCE: f64 = 0.02;

    /// The scale expected of two sensors, within `tolerance` as a fraction.
    pub fn around(expected: f64, tolerance: f64) -> Self {
        Self {
            low: expected * (1.0 - tolerance),
            high: expected * (1.0 + tolerance),
        }
    }

    /// A scale known from the sensors: 1 for two metric ones.
    pub fn known(scale: f64) -> Self {
        Self::around(scale, Self::KNOWN_TOLERANCE)
    }

    /// One scale and no other.
    pub fn only(scale: f64) -> Self {
        Self {
            low: scale,
            high: scale,
        }
    }

    /// The scale of the range nearest to `scale`.
    pub fn clamp(&self, scale: f64) -> f64 {
        scale.clamp(self.low, self.high)
    }

    /// What both ranges hold, or the end of this one that is nearest to the other.
    pub fn intersection(&self, other: &Self) -> Self {
        Self {
            low: self.clamp(other.low),
            high: self.clamp(other.high),
        }
    }

    /// Width of the range as a logarithm.
    pub fn log_width(&self) -> f64 {
        (self.high / self.low).ln()
    }

    /// The range in steps of no more than `max_step` (a logarithm): the middle of each, the ones nearest to `first` first.
    pub fn steps(&self, max_step: f64, first: f64) -> Vec<f64> {
        let count = (self.log_width() / max_step).ceil().max(1.0);
        let step = self.log_width() / count;
        let mut scales: Vec<f64> = (0..count as i32)
            .map(|index| self.low * (step * (f64::from(index) + 0.5)).exp())
            .collect();
        let off = |scale: &f64| (scale / first).ln().abs();
        scales.sort_by(|a, b| off(a).total_cmp(&off(b)));
        scales
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_scale_is_one_step_and_a_wide_range_many_that_fill_it() {
        let known = ScaleRange::known(1.0).steps(0.14, 1.0);
        assert!(matches!(known[..], [one] if (one - 1.0).abs() < 1e-3));
        let free = ScaleRange {
            low: 0.3,
            high: 3.5,
        };
        let steps = free.steps(0.14, 1.3);
        assert_eq!(steps.len(), 18);
        assert!((steps[0] / 1.3).ln().abs() <= 0.07);
        let mut sorted = steps.clone();
        sorted.sort_by(f64::total_cmp);
        assert!((sorted[0] / 0.3).ln() <= 0.07 && (3.5 / sorted[17]).ln() <= 0.07);
        assert!(
            sorted
                .windows(2)
                .all(|pair| (pair[1] / pair[0]).ln() <= 0.14 + 1e-12)
        );
    }

    #[test]
    fn ranges_that_do_not_meet_keep_to_the_allowed_one() {
        let allowed = ScaleRange {
            low: 0.9,
            high: 1.1,
        };
        let estimate = ScaleRange {
            low: 1.5,
            high: 2.0,
        };
        assert_eq!(allowed.intersection(&estimate), ScaleRange::only(1.1));
    }
}
