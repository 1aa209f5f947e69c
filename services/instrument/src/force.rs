//! What the jaw presses with, by the motor's current: a table that was measured, with friction in it, and straight lines
//! between its points. Outside of it nothing is known.

/// Force over current, both strictly rising.
#[derive(Clone, PartialEq, Debug)]
pub struct ForceTable {
    /// mA and N.
    points: Vec<[f64; 2]>,
}

/// A table that is none.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
pub enum TableError {
    /// A line needs two points.
    #[error("has {0} points; at least 2 are needed")]
    TooFewPoints(usize),
    /// A number that is none, or negative.
    #[error("point {place} is {current_ma} mA, {force_n} N; both must be finite and at least 0")]
    NotANumber {
        /// Counted from 0.
        place: usize,
        /// As given.
        current_ma: f64,
        /// As given.
        force_n: f64,
    },
    /// The same force at two currents, or the other way round.
    #[error(
        "point {place}, {current_ma} mA and {force_n} N, is not above the one before it in both"
    )]
    NotRising {
        /// Counted from 0.
        place: usize,
        /// As given.
        current_ma: f64,
        /// As given.
        force_n: f64,
    },
}

/// A force that the table does not reach.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
#[error("{force_n} N is outside of the calibrated {lowest_n} to {highest_n} N")]
pub struct OutsideTable {
    /// As asked.
    pub force_n: f64,
    /// Of the table.
    pub lowest_n: f64,
    /// Of the table.
    pub highest_n: f64,
}

impl ForceTable {
    /// Of points (mA, N) in rising order.
    pub fn new(points: Vec<[f64; 2]>) -> Result<Self, TableError> {
        if points.len() < 2 {
            return Err(TableError::TooFewPoints(points.len()));
        }
        for (place, &[current_ma, force_n]) in points.iter().enumerate() {
            let is_number = |value: f64| value.is_finite() && value >= 0.0;
            if !is_number(current_ma) || !is_number(force_n) {
                return Err(TableError::NotANumber {
                    place,
                    current_ma,
                    force_n,
                });
            }
        }
        for (place, pair) in (1..).zip(points.windows(2)) {
            let [before, [current_ma, force_n]] = [pair[0], pair[1]];
            if current_ma <= before[0] || force_n <= before[1] {
                return Err(TableError::NotRising {
                    place,
                    current_ma,
                    force_n,
                });
            }
        }
        Ok(Self { points })
    }

    /// The force at a current. `None` outside of the table; but where the table begins with no force, less current has
    /// none either: friction takes it.
    pub fn force_n(&self, current_ma: f64) -> Option<f64> {
        let [first_ma, first_n] = self.points[0];
        if current_ma < first_ma {
            return (first_n == 0.0).then_some(0.0);
        }
        self.between(current_ma, |[current_ma, force_n]| (current_ma, force_n))
    }

    /// The current for a force.
    pub fn current_ma(&self, force_n: f64) -> Result<f64, OutsideTable> {
        self.between(force_n, |[current_ma, force_n]| (force_n, current_ma))
            .ok_or(OutsideTable {
                force_n,
                lowest_n: self.points[0][1],
                highest_n: self.points[self.points.len() - 1][1],
            })
    }

    /// On the line between the two points around `at`.
    fn between(&self, at: f64, from_to: impl Fn([f64; 2]) -> (f64, f64)) -> Option<f64> {
        self.points.windows(2).find_map(|pair| {
            let [(low, low_value), (high, high_value)] = [from_to(pair[0]), from_to(pair[1])];
            (low..=high)
                .contains(&at)
                .then(|| low_value + (at - low) / (high - low) * (high_value - low_value))
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn table() -> ForceTable {
        ForceTable::new(vec![[40.0, 0.0], [240.0, 60.0], [500.0, 160.0]]).unwrap()
    }

    #[test]
    fn forces_lie_on_the_lines_between_the_points() {
        assert_eq!(table().force_n(140.0), Some(30.0));
        assert_eq!(table().current_ma(30.0), Ok(140.0));
        assert_eq!(table().force_n(500.0), Some(160.0));
        assert_eq!(table().force_n(20.0), Some(0.0), "friction takes it");
    }

    #[test]
    fn outside_of_the_table_nothing_is_known() {
        assert_eq!(table().force_n(501.0), None);
        assert_eq!(table().force_n(f64::NAN), None);
        let without_friction = ForceTable::new(vec![[100.0, 5.0], [200.0, 50.0]]).unwrap();
        assert_eq!(without_friction.force_n(99.0), None);
        for force_n in [-1.0, 160.1, f64::NAN] {
            let refused = table().current_ma(force_n).unwrap_err();
            assert_eq!((refused.lowest_n, refused.highest_n), (0.0, 160.0));
        }
    }

    #[test]
    fn a_table_that_does_not_rise_is_refused() {
        let message =
            |points: &[[f64; 2]]| ForceTable::new(points.to_vec()).unwrap_err().to_string();
        assert_eq!(
            message(&[[1.0, 1.0]]),
            "has 1 points; at least 2 are needed"
        );
        assert_eq!(
            message(&[[40.0, 0.0], [240.0, 60.0], [240.0, 70.0]]),
            "point 2, 240 mA and 70 N, is not above the one before it in both"
        );
        assert_eq!(
            message(&[[40.0, 0.0], [f64::NAN, 60.0]]),
            "point 1 is NaN mA, 60 N; both must be finite and at least 0"
        );
    }

    proptest! {
        #[test]
        fn force_and_current_lead_back_to_each_other(force_n in 0.0..160.0_f64) {
            let current_ma = table().current_ma(force_n).unwrap();
            let back_n = table().force_n(current_ma).unwrap();
            prop_assert!((back_n - force_n).abs() < 1e-9);
        }
    }
}
