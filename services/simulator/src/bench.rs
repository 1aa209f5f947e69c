//! The drives' mechanisms without a knee: on a bench, the jaw of the forceps closes on a block of tissue.

use serde::{Deserialize, Serialize};

use crate::cell::axes::{self, Axis, JawLoad, Mechanisms};
use crate::epos4::{Drives, Mechanics};
use crate::jaw::{BLADES_N_PER_MM, SPRING_N_PER_MM};

/// The jaw, and the block that lies between its blades anew whenever it is open.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct JawConfig {
    /// Between the open blades, mm, above 0 to 50.
    pub opening_mm: f64,
    /// Feed at which the empty blades touch, mm, above 0 to 14.
    pub closed_feed_mm: f64,
    /// The block, mm, 0 to the opening; 0: nothing lies there.
    pub tissue_thickness_mm: f64,
    /// Force for each millimetre by which it is pressed together, N/mm, above 0 to 1000.
    pub tissue_stiffness_n_mm: f64,
    /// At this force the blades have cut it, N, above 0 to 1000.
    pub tissue_cut_n: f64,
}

/// A number of the jaw that is out of its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{field} is {value}, must be {limit}")]
pub struct OutOfRange {
    /// Which one.
    pub field: &'static str,
    /// What was given.
    pub value: f64,
    /// What may be given.
    pub limit: &'static str,
}

/// Mechanisms and block.
#[derive(Clone, Debug)]
pub struct Bench {
    jaw: JawConfig,
    axes: Vec<Axis>,
    mechanisms: Mechanisms,
    block: Block,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Block {
    Whole,
    Cut,
}

/// Opened to this feed, the jaw is empty again and a new block lies in it, mm.
const OPEN_MM: f64 = 0.5;

impl Default for JawConfig {
    fn default() -> Self {
        Self {
            opening_mm: 10.0,
            closed_feed_mm: 10.0,
            tissue_thickness_mm: 3.0,
            tissue_stiffness_n_mm: 60.0,
            tissue_cut_n: 90.0,
        }
    }
}

impl JawConfig {
    /// Refuses numbers out of range.
    ///
    /// # Errors
    /// Names the first one.
    pub fn checked(&self) -> Result<&Self, OutOfRange> {
        let thickness_fits = (0.0..=self.opening_mm).contains(&self.tissue_thickness_mm);
        for (field, value, fits, limit) in [
            (
                "opening_mm",
                self.opening_mm,
                within(self.opening_mm, 50.0),
                "above 0 to 50 mm",
            ),
            (
                "closed_feed_mm",
                self.closed_feed_mm,
                within(self.closed_feed_mm, 14.0),
                "above 0 to 14 mm",
            ),
            (
                "tissue_thickness_mm",
                self.tissue_thickness_mm,
                thickness_fits,
                "0 mm to the opening",
            ),
            (
                "tissue_stiffness_n_mm",
                self.tissue_stiffness_n_mm,
                within(self.tissue_stiffness_n_mm, 1000.0),
                "above 0 to 1000 N/mm",
            ),
            (
                "tissue_cut_n",
                self.tissue_cut_n,
                within(self.tissue_cut_n, 1000.0),
                "above 0 to 1000 N",
            ),
        ] {
            if !fits {
                return Err(OutOfRange {
                    field,
                    value,
                    limit,
                });
            }
        }
        Ok(self)
    }
}

fn within(value: f64, most: f64) -> bool {
    value > 0.0 && value <= most
}

impl Bench {
    /// The mechanisms of the drives with these node ids.
    #[must_use]
    pub fn new(node_ids: &[u8], jaw: JawConfig) -> Self {
        let axes: Vec<Axis> = node_ids.iter().map(|id| Axis::of_node(*id)).collect();
        Self {
            jaw,
            mechanisms: Mechanisms::new(&axes),
            axes,
            block: Block::Whole,
        }
    }

    /// The drives as commissioned, just powered up.
    #[must_use]
    pub fn drives(node_ids: &[u8]) -> Drives {
        let drives = node_ids.iter().map(|id| Axis::of_node(*id).drive(*id));
        Drives::new(drives.collect())
    }

    /// What the mechanisms do to the drives while these stand here, quadcounts of the true shafts.
    pub fn mechanics(&mut self, shafts_qc: &[f64]) -> Vec<Mechanics> {
        let feed = self.axes.iter().position(|axis| *axis == Axis::ForcepsFeed);
        let feed_mm = feed
            .and_then(|place| shafts_qc.get(place))
            .map_or(0.0, |shaft_qc| axes::feed_mm(*shaft_qc));
        let load = self.close(feed_mm);
        self.mechanisms.act(shafts_qc, load)
    }

    /// Another jaw, with a whole block between its blades.
    pub fn put_into_jaw(&mut self, jaw: JawConfig) {
        self.jaw = jaw;
        self.block = Block::Whole;
    }

    /// Between the blades while the feed stands here, mm; below 0 they press on each other.
    #[must_use]
    pub fn gap_mm(&self, feed_mm: f64) -> f64 {
        self.jaw.opening_mm * (1.0 - feed_mm / self.jaw.closed_feed_mm)
    }

    fn close(&mut self, feed_mm: f64) -> JawLoad {
        let aperture_mm = self.gap_mm(feed_mm);
        let jaw = &self.jaw;
        let pressed_mm = (jaw.tissue_thickness_mm - aperture_mm).max(0.0);
        let mut tissue_n = match self.block {
            Block::Whole => pressed_mm * jaw.tissue_stiffness_n_mm,
            Block::Cut => 0.0,
        };
        if tissue_n >= jaw.tissue_cut_n {
            self.block = Block::Cut;
            tissue_n = 0.0;
        } else if feed_mm <= OPEN_MM {
            self.block = Block::Whole;
        }
        JawLoad {
            spring_n: feed_mm.max(0.0) * SPRING_N_PER_MM,
            bite_n: tissue_n + (feed_mm - jaw.closed_feed_mm).max(0.0) * BLADES_N_PER_MM,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The force between the blades at each of these feeds in turn.
    fn bite(feeds_mm: &[f64]) -> Vec<f64> {
        let mut bench = Bench::new(&[2], JawConfig::default());
        let qc = Axis::ForcepsFeed.qc_per_unit();
        feeds_mm
            .iter()
            .map(|feed_mm| bench.mechanics(&[feed_mm * qc])[0].tool_force_n)
            .collect()
    }

    #[test]
    fn the_block_presses_back_until_it_is_cut_and_a_new_one_lies_in_the_open_jaw() {
        let forces = bite(&[0.0, 6.9, 7.5, 8.4, 8.6, 8.0, 10.1, 0.4, 7.5]);
        let expected = [0.0, 0.0, 30.0, 84.0, 0.0, 0.0, 70.0, 0.0, 30.0];
        for (force, expected) in forces.iter().zip(expected) {
            assert!((force - expected).abs() < 1e-9, "{forces:?}");
        }
    }

    #[test]
    fn a_jaw_that_cannot_be_is_refused_by_name() {
        for (jaw, field) in [
            (
                JawConfig {
                    tissue_thickness_mm: 10.1,
                    ..JawConfig::default()
                },
                "tissue_thickness_mm",
            ),
            (
                JawConfig {
                    tissue_cut_n: f64::NAN,
                    ..JawConfig::default()
                },
                "tissue_cut_n",
            ),
            (
                JawConfig {
                    closed_feed_mm: 0.0,
                    ..JawConfig::default()
                },
                "closed_feed_mm",
            ),
        ] {
            assert_eq!(jaw.checked().unwrap_err().field, field);
        }
    }
}
