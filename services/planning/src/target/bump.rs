//! The deepening that takes a contour around a lesion: a flat core between two ramps that leave the
//! contour beside it without a step in slope or curvature.

use super::station::Station;

/// Places and widths of the core that are tried.
const TRIES: usize = 12;

/// A deepening along the crescent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bump {
    /// Where it is deepest, as the way along the free edge, mm.
    middle_mm: f64,
    /// Half the way over which it stays so, mm.
    core_mm: f64,
    /// Where its ramps end, mm.
    ends_mm: (f64, f64),
    /// How deep, as a share of the width.
    height: f64,
}

impl Bump {
    /// The bump between two ends that clears what the stations need beyond their chosen depth and
    /// removes least; `None` where the chosen depth suffices.
    pub(super) fn least(stations: &[Station], chosen: &[f64], ends_mm: (f64, f64)) -> Option<Self> {
        let lacking: Vec<(f64, f64)> = stations
            .iter()
            .zip(chosen)
            .filter(|(station, depth)| station.need > **depth)
            .map(|(station, depth)| (station.way_mm, station.need - depth))
            .collect();
        let ways = lacking.iter().map(|&(way_mm, _)| way_mm);
        let low_mm = ways.clone().reduce(f64::min)?;
        let high_mm = ways.reduce(f64::max)?;
        let share = |step: usize| step as f64 / TRIES as f64;
        let tries = (0..=TRIES).flat_map(|place| (0..=TRIES).map(move |width| (place, width)));
        tries
            .map(|(place, width)| {
                let middle_mm = low_mm + share(place) * (high_mm - low_mm);
                let widest_mm = (high_mm - middle_mm).max(middle_mm - low_mm);
                let mut bump = Self {
                    middle_mm,
                    core_mm: share(width) * widest_mm,
                    ends_mm,
                    height: 1.0,
                };
                bump.height = lacking.iter().fold(0.0, |height, &(way_mm, lack)| {
                    height.max(lack / bump.depth(way_mm).max(1e-9))
                });
                bump
            })
            .min_by(|a, b| a.area(stations).total_cmp(&b.area(stations)))
    }

    /// The deepening so far along the free edge, as a share of the width.
    pub(super) fn depth(&self, way_mm: f64) -> f64 {
        let offset_mm = way_mm - self.middle_mm;
        let room_mm = if offset_mm < 0.0 {
            self.middle_mm - self.ends_mm.0
        } else {
            self.ends_mm.1 - self.middle_mm
        };
        let ramp_mm = (room_mm - self.core_mm).max(1e-9);
        let share = (offset_mm.abs() - self.core_mm).max(0.0) / ramp_mm;
        self.height * fall(share)
    }

    /// What it removes, mm2, up to the same factor for all bumps of these stations.
    fn area(&self, stations: &[Station]) -> f64 {
        let slices = stations.iter().map(|station| {
            let depth_mm = self.depth(station.way_mm) * station.width_mm;
            depth_mm * (station.edge_mm + 0.5 * depth_mm)
        });
        slices.sum()
    }
}

/// From 1 at 0 to 0 at 1 as `(1 - t^2)^4`: flat at the top, and at the foot zero with its first three
/// derivatives, so that neither the slope nor the curvature of the rim jumps.
fn fall(share: f64) -> f64 {
    (1.0 - share.min(1.0).powi(2)).powi(4)
}
