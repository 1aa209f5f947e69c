//! How steeply the current rose over the last bit of the way. Blade on blade is stiff, tissue is not; and a jaw that slips
//! on tissue, while its encoder counts on, is seen by that.

use std::collections::VecDeque;

/// The current over the last [`WINDOW_MM`](Self::WINDOW_MM) of a closing jaw.
#[derive(Clone, Debug, Default)]
pub(super) struct Steepness {
    looks: VecDeque<Look>,
}

/// A place and the currents seen at it.
#[derive(Clone, Copy, Debug)]
struct Look {
    position_mm: f64,
    lowest_ma: f64,
    highest_ma: f64,
    /// From the lowest before to the highest after.
    rise_ma: f64,
}

impl Steepness {
    /// Long enough for four looks at 5 mm/s and 100 a second.
    const WINDOW_MM: f64 = 0.2;
    /// Nearer to each other than this, looks are at one place, so that there are few.
    const PLACE_MM: f64 = 0.02;

    pub(super) fn observe(&mut self, position_mm: f64, current_ma: f64) {
        match self.looks.back_mut() {
            Some(last) if position_mm < last.position_mm + Self::PLACE_MM => {
                last.lowest_ma = last.lowest_ma.min(current_ma);
                last.highest_ma = last.highest_ma.max(current_ma);
                last.rise_ma = last.rise_ma.max(current_ma - last.lowest_ma);
            }
            _ => self.looks.push_back(Look {
                position_mm,
                lowest_ma: current_ma,
                highest_ma: current_ma,
                rise_ma: 0.0,
            }),
        }
        // Where looks are far apart, the last one before counts.
        while self.looks.len() > 1 && self.looks[1].position_mm < position_mm - Self::WINDOW_MM {
            self.looks.pop_front();
        }
    }

    /// The highest rise from a place to a later one or at one, mA. A fall is none.
    pub(super) fn rise_ma(&self) -> f64 {
        let (mut lowest_ma, mut rise_ma) = (f64::INFINITY, 0.0_f64);
        for look in &self.looks {
            rise_ma = rise_ma.max(look.rise_ma).max(look.highest_ma - lowest_ma);
            lowest_ma = lowest_ma.min(look.lowest_ma);
        }
        rise_ma
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rise_ma(step_mm: f64, current_ma: impl Fn(f64) -> f64) -> f64 {
        let mut steepness = Steepness::default();
        let mut position_mm = 0.0;
        while position_mm < 2.0 {
            position_mm += step_mm;
            steepness.observe(position_mm, current_ma(position_mm));
        }
        steepness.rise_ma()
    }

    #[test]
    fn only_the_last_bit_of_the_way_counts_and_only_a_rise() {
        assert!((rise_ma(0.05, |mm| 40.0 + 170.0 * mm) - 34.0).abs() < 10.0);
        assert!((rise_ma(0.05, |mm| 40.0 + 2000.0 * (mm - 1.9).max(0.0)) - 200.0).abs() < 1.0);
        assert_eq!(rise_ma(0.05, |mm| 400.0 - 100.0 * mm), 0.0);
        assert!(
            (rise_ma(0.5, |mm| 100.0 * mm) - 50.0).abs() < 1e-9,
            "far apart"
        );
    }

    #[test]
    fn a_current_that_rises_while_the_jaw_stands_is_a_rise() {
        let mut steepness = Steepness::default();
        for current_ma in [40.0, 300.0, 500.0, 500.0] {
            steepness.observe(9.8, current_ma);
        }
        assert_eq!(steepness.rise_ma(), 460.0);
        let mut cut = Steepness::default();
        for current_ma in [300.0, 320.0, 40.0] {
            cut.observe(9.8, current_ma);
        }
        assert_eq!(cut.rise_ma(), 20.0, "a fall is none");
    }
}
