//! The angles along which a contour is drawn, and what the lesion asks for at each of them.

use std::f64::consts::PI;

use arthro_geometry::Point3;

use crate::crescent::Crescent;
use crate::lesion::Lesion;

/// Angle between two stations.
const STATION_RAD: f64 = 0.5 * PI / 180.0;
/// Fewest steps from the first to the last station.
const MIN_STEPS: usize = 8;
/// Free edge and rim are averaged over so much way to each side, mm.
const WINDOW_MM: f64 = 3.0;

/// One angle of the crescent. A depth is a share of the width: 0 at the free edge, 1 at the rim.
#[derive(Clone, Copy, Debug)]
pub(super) struct Station {
    pub(super) angle_rad: f64,
    pub(super) edge_mm: f64,
    pub(super) width_mm: f64,
    /// Way along the free edge from the first station, mm.
    pub(super) way_mm: f64,
    /// Depth that clears the lesion with its margin; 0 beside it.
    pub(super) need: f64,
}

impl Station {
    /// The stations from one angle to another, both included; the first angle without tissue is the
    /// error.
    pub(super) fn between(
        first_rad: f64,
        last_rad: f64,
        crescent: &Crescent,
    ) -> Result<Vec<Self>, f64> {
        let span_rad = last_rad - first_rad;
        let steps = ((span_rad.abs() / STATION_RAD).ceil() as usize).max(MIN_STEPS);
        let mut stations: Vec<Self> = Vec::with_capacity(steps + 1);
        for step in 0..=steps {
            let angle_rad = first_rad + span_rad * step as f64 / steps as f64;
            let (edge_mm, rim_mm) = smooth_mm(angle_rad, crescent).ok_or(angle_rad)?;
            let mut station = Self {
                angle_rad,
                edge_mm,
                width_mm: rim_mm - edge_mm,
                way_mm: 0.0,
                need: 0.0,
            };
            if let Some(before) = stations.last() {
                station.way_mm = before.way_mm + (station.at(0.0) - before.at(0.0)).norm();
            }
            stations.push(station);
        }
        Ok(stations)
    }

    /// The place in the plane at a depth.
    pub(super) fn at(&self, depth: f64) -> Point3 {
        let radius_mm = self.edge_mm + depth * self.width_mm;
        let (sin, cos) = self.angle_rad.sin_cos();
        Point3::new(radius_mm * cos, radius_mm * sin, 0.0)
    }

    /// The depth of a distance from the centre.
    pub(super) fn depth(&self, radius_mm: f64) -> f64 {
        (radius_mm - self.edge_mm) / self.width_mm.max(1e-6)
    }
}

/// Free edge and rim at an angle without the steps that a segmented edge has and a new one should not
/// repeat: averaged over the tissue to both sides, with weights that fall to the end of the window.
fn smooth_mm(angle_rad: f64, crescent: &Crescent) -> Option<(f64, f64)> {
    let pair_mm = |angle_rad: f64| crescent.edge_mm(angle_rad).zip(crescent.rim_mm(angle_rad));
    let (mut edge_mm, mut rim_mm) = pair_mm(angle_rad)?;
    let window_rad = WINDOW_MM / edge_mm.max(WINDOW_MM);
    let steps = (window_rad / STATION_RAD).ceil() as usize;
    let mut weights = 1.0;
    for step in 1..steps {
        let offset_rad = step as f64 * STATION_RAD;
        let sides = pair_mm(angle_rad - offset_rad).zip(pair_mm(angle_rad + offset_rad));
        let Some((before, after)) = sides else {
            break;
        };
        let weight = 1.0 - step as f64 / steps as f64;
        edge_mm += weight * (before.0 + after.0);
        rim_mm += weight * (before.1 + after.1);
        weights += 2.0 * weight;
    }
    Some((edge_mm / weights, rim_mm / weights))
}

/// Notes how deep the lesion reaches at every station, with a margin all round; returns how many of
/// its points lie beyond the ends.
pub(super) fn demand(
    stations: &mut [Station],
    lesion: &Lesion,
    margin_mm: f64,
    crescent: &Crescent,
) -> usize {
    // A point stands for a cell of the grid: half of it lies further out, so much is no margin yet.
    let margin_mm = margin_mm.max(0.5 * lesion.point_mm3.cbrt());
    let last = stations.len() - 1;
    let first_rad = stations[0].angle_rad;
    let span_rad = stations[last].angle_rad - first_rad;
    let mut beyond = 0;
    for point in &lesion.points {
        let angle_rad = crescent.angle_rad(point);
        let radius_mm = point.xy().coords.norm().max(1e-6);
        let share = (angle_rad - first_rad) / span_rad;
        beyond += usize::from(!(0.0..=1.0).contains(&share));
        let reach = (margin_mm / radius_mm).min(1.0).asin() / span_rad.abs();
        let low = ((share - reach) * last as f64).ceil().max(0.0) as usize;
        let end = ((share + reach) * last as f64 + 1.0).clamp(0.0, last as f64 + 1.0) as usize;
        for station in stations.iter_mut().take(end).skip(low) {
            // The ray leaves the ball around the point at the far end of its chord.
            let (sin, cos) = (station.angle_rad - angle_rad).sin_cos();
            let half_chord_mm = (margin_mm.powi(2) - (radius_mm * sin).powi(2))
                .max(0.0)
                .sqrt();
            let depth = station.depth(radius_mm * cos + half_chord_mm);
            station.need = station.need.max(depth);
        }
    }
    beyond
}
