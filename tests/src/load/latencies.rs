//! How long answers took.

use std::fmt;

/// Sorted, in milliseconds.
#[derive(Clone, Debug)]
pub struct Latencies(Vec<f64>);

impl Latencies {
    /// In any order.
    pub fn of(mut all_ms: Vec<f64>) -> Self {
        all_ms.sort_by(f64::total_cmp);
        Self(all_ms)
    }

    /// How many.
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// The smallest that at least `share` of all keep to; not a number without any.
    pub fn quantile_ms(&self, share: f64) -> f64 {
        let rank = (share * self.0.len() as f64).ceil() as usize;
        self.0.get(rank.max(1) - 1).copied().unwrap_or(f64::NAN)
    }

    /// The largest.
    pub fn max_ms(&self) -> f64 {
        self.0.last().copied().unwrap_or(f64::NAN)
    }
}

impl fmt::Display for Latencies {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:.2} / {:.2} / {:.2} ({})",
            self.quantile_ms(0.5),
            self.quantile_ms(0.99),
            self.max_ms(),
            self.count()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_of_those_measured() {
        let latencies = Latencies::of((1..=200).rev().map(f64::from).collect());
        assert_eq!(latencies.quantile_ms(0.5), 100.0);
        assert_eq!(latencies.quantile_ms(0.99), 198.0);
        assert_eq!(latencies.max_ms(), 200.0);
        assert!(Latencies::of(Vec::new()).quantile_ms(0.5).is_nan());
    }
}
