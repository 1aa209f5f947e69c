//! The deepening that takes a contour around a lesion: a flat core between two ramps that leave the
//! contour beside it without a step in slope or curvature.

use super::station::Station;

/// Places and widths of the core that are tried.
const TRIES: usize = 12;
/// The part of a lesion that is deeper than this share of its depth may have a bump of its own.
const DEEP: f64 = 0.5;
/// It has one if both bumps together remove no more than this share of what one alone would.
const WORTH: f64 = 0.85;
/// A lack that is none, as a share of the width.
const CLEAR: f64 = 1e-9;

/// The chosen depths deepened between two ends so that they clear what the stations need: by one bump,
/// or where a lesion is deep only here and there by a second one on the first. `reach_mm` says how far
/// the contour reaches around the needs of stations.
pub(super) fn deepen(
    stations: &[Station],
    chosen: &[f64],
    ends_mm: (f64, f64),
    reach_mm: impl Fn(&[Station]) -> Option<(f64, f64)>,
) -> Vec<f64> {
    let one = Bump::added(Bump::least(stations, chosen, ends_mm), stations, chosen);
    let lack = |(station, depth): (&Station, &f64)| station.need - depth;
    let lacks: Vec<f64> = stations.iter().zip(chosen).map(lack).collect();
    let deepest = lacks.iter().copied().fold(0.0, f64::max);
    let is_deep = |lack: f64| lack >= DEEP * deepest;
    let shallow = lacks.iter().copied().filter(|&lack| !is_deep(lack));
    let level = shallow.fold(0.0, f64::max);
    let (mut deep, mut leveled) = (stations.to_vec(), stations.to_vec());
    for (index, &lack) in lacks.iter().enumerate() {
        if !is_deep(lack) {
            deep[index].need = 0.0;
        }
        leveled[index].need = leveled[index].need.min(chosen[index] + level);
    }
    let Some((low_mm, high_mm)) = reach_mm(&deep).filter(|_| level > 0.0) else {
        return one;
    };
    let deep_ends_mm = (low_mm.max(ends_mm.0), high_mm.min(ends_mm.1));
    let first = Bump::added(Bump::least(&leveled, chosen, ends_mm), stations, chosen);
    let two = Bump::added(
        Bump::least(stations, &first, deep_ends_mm),
        stations,
        &first,
    );
    let clears = |depths: &[f64]| {
        let mut lacks = stations.iter().zip(depths).map(lack);
        lacks.all(|lack| lack <= CLEAR)
    };
    let is_worth_it = area(stations, &two) - area(stations, chosen)
        < WORTH * (area(stations, &one) - area(stations, chosen));
    if clears(&two) && is_worth_it {
        two
    } else {
        one
    }
}

/// What lies inboard of the depths, mm2, up to the same factor for all depths of these stations.
fn area(stations: &[Station], depths: &[f64]) -> f64 {
    let slices = stations.iter().zip(depths).map(|(station, depth)| {
        let depth_mm = depth * station.width_mm;
        depth_mm * (station.edge_mm + 0.5 * depth_mm)
    });
    slices.sum()
}

/// A deepening along the crescent.
#[derive(Clone, Copy, Debug)]
struct Bump {
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
    fn least(stations: &[Station], chosen: &[f64], ends_mm: (f64, f64)) -> Option<Self> {
        let lacking: Vec<(f64, f64)> = stations
            .iter()
            .zip(chosen)
            .filter(|(station, depth)| station.need - **depth > CLEAR)
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
                let height = lacking.iter().fold(0.0, |height: f64, &(way_mm, lack)| {
                    height.max(lack / bump.depth(way_mm).max(CLEAR))
                });
                // At the rim nothing is left to deepen: a need at the very end is not met.
                bump.height = height.min(1.0);
                bump
            })
            .map(|bump| {
                let depths: Vec<f64> = stations.iter().map(|at| bump.depth(at.way_mm)).collect();
                (bump, area(stations, &depths))
            })
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(bump, _)| bump)
    }

    fn added(bump: Option<Self>, stations: &[Station], chosen: &[f64]) -> Vec<f64> {
        let Some(bump) = bump else {
            return chosen.to_vec();
        };
        let depths = stations.iter().zip(chosen);
        depths
            .map(|(station, depth)| depth + bump.depth(station.way_mm))
            .collect()
    }

    /// The deepening so far along the free edge, as a share of the width.
    fn depth(&self, way_mm: f64) -> f64 {
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
}

/// From 1 at 0 to 0 at 1 as `(1 - t^2)^4`: flat at the top, and at the foot zero with its first three
/// derivatives, so that neither the slope nor the curvature of the rim jumps.
fn fall(share: f64) -> f64 {
    (1.0 - share.min(1.0).powi(2)).powi(4)
}
