//! How deep from the free edge the contour runs, angle by angle.

use std::f64::consts::PI;

use arthro_geometry::Point3;

use super::Ends;
use crate::band::Band;
use crate::crescent::Crescent;
use crate::error::Error;
use crate::lesion::Lesion;

/// How far outboard of the lesion the contour passes, mm.
pub const LESION_MARGIN_MM: f64 = 0.4;
/// Steepest change of depth along the crescent, mm a mm.
const MAX_SLOPE: f64 = 1.0;
/// Shortest ramp, mm.
const MIN_RAMP_MM: f64 = 3.0;
/// Hollows of the depth within this way of deeper parts to both sides are filled: a tongue of tissue
/// between two notches would not last, mm.
const FILL_MM: f64 = 6.0;
/// How much of the lesion's margin a fit may use up, mm.
const FIT_SLACK_MM: f64 = 0.05;
/// Largest share of the lesion beyond start and goal, percent.
const MAX_BEYOND_PERCENT: f64 = 2.0;
const STATION_RAD: f64 = 0.5 * PI / 180.0;

/// The angles from start to goal and what they ask for.
pub(super) struct Profile {
    stations: Vec<Station>,
    /// Depth that start and goal alone ask for, mm.
    chosen_mm: Vec<f64>,
}

/// One angle of the crescent.
pub(super) struct Station {
    angle_rad: f64,
    edge_mm: f64,
    rim_mm: f64,
    /// Way along the free edge from the start, mm.
    pub(super) way_mm: f64,
    /// Depth that clears the lesion with its margin, mm; 0 beside it.
    lesion_mm: f64,
    /// Depth to aim at so that the fitted curve clears it, mm.
    aim_mm: f64,
}

impl Station {
    pub(super) fn at_depth(&self, depth_mm: f64) -> Point3 {
        let radius_mm = self.edge_mm + depth_mm;
        let (sin, cos) = self.angle_rad.sin_cos();
        Point3::new(radius_mm * cos, radius_mm * sin, 0.0)
    }

    fn depth_mm(&self, point: &Point3) -> f64 {
        (point.xy().coords.norm() - self.edge_mm).max(0.0)
    }
}

impl Profile {
    pub(super) fn between(ends: &Ends, crescent: &Crescent) -> Result<Self, Error> {
        let stations = stations(ends, crescent)?;
        let last = &stations[stations.len() - 1];
        let start_mm = stations[0].depth_mm(&ends.start);
        let goal_mm = last.depth_mm(&ends.goal);
        // The shallower of the two, and a ramp to the deeper.
        let level_mm = start_mm.min(goal_mm);
        let ramp = Ramp::down((start_mm - goal_mm).abs(), last.way_mm);
        let from_deeper_mm = |station: &Station| {
            if start_mm > goal_mm {
                station.way_mm
            } else {
                last.way_mm - station.way_mm
            }
        };
        let chosen_mm = stations
            .iter()
            .map(|station| level_mm + ramp.height_mm(from_deeper_mm(station)))
            .collect();
        Ok(Self {
            stations,
            chosen_mm,
        })
    }

    pub(super) fn stations(&self) -> &[Station] {
        &self.stations
    }

    fn whole_mm(&self) -> f64 {
        self.stations[self.stations.len() - 1].way_mm
    }

    /// Notes how deep the lesion, with its margin all round, reaches at every angle.
    pub(super) fn clear(&mut self, lesion: &Lesion, crescent: &Crescent) -> Result<(), Error> {
        // A point stands for a cell of the grid: half of it lies further out.
        let margin_mm = LESION_MARGIN_MM + 0.5 * lesion.point_mm3.cbrt();
        let last = self.stations.len() - 1;
        let first_rad = self.stations[0].angle_rad;
        let span_rad = self.stations[last].angle_rad - first_rad;
        let mut beyond = 0usize;
        for point in &lesion.points {
            let angle_rad = crescent.angle_rad(point);
            let radius_mm = point.xy().coords.norm().max(1e-6);
            let share = (angle_rad - first_rad) / span_rad;
            beyond += usize::from(!(0.0..=1.0).contains(&share));
            let reach = (margin_mm / radius_mm).min(1.0).asin() / span_rad.abs();
            let low = ((share - reach) * last as f64).ceil().max(0.0) as usize;
            let end = ((share + reach) * last as f64 + 1.0).clamp(0.0, last as f64 + 1.0) as usize;
            for station in self.stations.iter_mut().take(end).skip(low) {
                let (sin, cos) = (station.angle_rad - angle_rad).sin_cos();
                let half_chord_mm = (margin_mm.powi(2) - (radius_mm * sin).powi(2))
                    .max(0.0)
                    .sqrt();
                let depth_mm = radius_mm * cos + half_chord_mm - station.edge_mm;
                station.lesion_mm = station.lesion_mm.max(depth_mm);
                station.aim_mm = station.lesion_mm;
            }
        }
        let beyond_percent = 100.0 * beyond as f64 / lesion.points.len().max(1) as f64;
        if beyond_percent > MAX_BEYOND_PERCENT {
            return Err(Error::LesionBeyondPath {
                beyond_percent,
                limit_percent: MAX_BEYOND_PERCENT,
            });
        }
        Ok(())
    }

    /// Refuses ends that leave too little rim. What the lesion demands is not measured here: a tear
    /// does not ask how wide the meniscus is.
    pub(super) fn check_rim(&self, ends: &Ends, crescent: &Crescent) -> Result<(), Error> {
        let narrowest = self
            .stations
            .iter()
            .zip(&self.chosen_mm)
            .filter(|(_, depth_mm)| **depth_mm > ends.tolerance_mm)
            .map(|(station, &depth_mm)| {
                let rim_mm = station.rim_mm - station.edge_mm - depth_mm;
                (rim_mm, station.at_depth(depth_mm))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0));
        match narrowest {
            Some((rim_mm, at)) if rim_mm < ends.rim_min_mm => Err(Error::RimBelowLimit {
                rim_mm,
                limit_mm: ends.rim_min_mm,
                at: crescent.ct_from_meniscal * at,
            }),
            _ => Ok(()),
        }
    }

    /// The depth at each station: what start and goal ask for and, around the lesion, what clears it
    /// with ramps to both sides.
    pub(super) fn depths(&self) -> Vec<f64> {
        let level_mm = self.chosen_mm.iter().copied().fold(f64::INFINITY, f64::min);
        let mut depths = self.chosen_mm.clone();
        for peak in &self.stations {
            let height_mm = peak.aim_mm - level_mm;
            if height_mm <= 0.0 {
                continue;
            }
            let before = Ramp::down(height_mm, peak.way_mm);
            let after = Ramp::down(height_mm, self.whole_mm() - peak.way_mm);
            for (depth_mm, station) in depths.iter_mut().zip(&self.stations) {
                let distance_mm = station.way_mm - peak.way_mm;
                let ramp = if distance_mm < 0.0 { &before } else { &after };
                *depth_mm = depth_mm.max(level_mm + ramp.height_mm(distance_mm.abs()));
            }
        }
        self.filled(&depths)
    }

    /// Raises what has deeper parts near by on both sides to the shallower of these.
    fn filled(&self, depths: &[f64]) -> Vec<f64> {
        let deepest = |from_mm: f64, to_mm: f64| {
            let within = self.stations.iter().zip(depths);
            within
                .filter(|(station, _)| (from_mm..=to_mm).contains(&station.way_mm))
                .fold(0.0, |deepest: f64, (_, &depth_mm)| deepest.max(depth_mm))
        };
        let ways = self.stations.iter().map(|station| station.way_mm);
        ways.map(|way_mm| deepest(way_mm - FILL_MM, way_mm).min(deepest(way_mm, way_mm + FILL_MM)))
            .collect()
    }

    /// Deepens the aim where a fit cuts into the lesion's margin; false where none does.
    pub(super) fn lift(&mut self, band: &Band) -> bool {
        let mut lifted = false;
        let last = self.stations.len() - 1;
        for station in &mut self.stations[1..last] {
            let Some(radius_mm) = band.radius_mm(station.angle_rad) else {
                continue;
            };
            let short_mm = station.edge_mm + station.lesion_mm - radius_mm;
            if station.lesion_mm > 0.0 && short_mm > FIT_SLACK_MM {
                station.aim_mm += short_mm;
                lifted = true;
            }
        }
        lifted
    }
}

/// A cosine from a height down to nothing.
pub(super) struct Ramp {
    height_mm: f64,
    length_mm: f64,
}

impl Ramp {
    pub(super) fn new(height_mm: f64, length_mm: f64) -> Self {
        Self {
            height_mm,
            length_mm: length_mm.max(1e-6),
        }
    }

    /// As long as the steepest slope demands, but not longer than there is room.
    fn down(height_mm: f64, room_mm: f64) -> Self {
        let length_mm = (0.5 * PI * height_mm / MAX_SLOPE).max(MIN_RAMP_MM);
        Self::new(height_mm, length_mm.min(room_mm))
    }

    pub(super) fn height_mm(&self, distance_mm: f64) -> f64 {
        let share = (distance_mm / self.length_mm).min(1.0);
        0.5 * self.height_mm * (1.0 + (PI * share).cos())
    }
}

/// The angles from start to goal.
fn stations(ends: &Ends, crescent: &Crescent) -> Result<Vec<Station>, Error> {
    let first_rad = crescent.angle_rad(&ends.start);
    let span_rad = crescent.angle_rad(&ends.goal) - first_rad;
    let count = ((span_rad.abs() / STATION_RAD).ceil() as usize).max(8);
    let mut stations: Vec<Station> = Vec::with_capacity(count + 1);
    for step in 0..=count {
        let angle_rad = first_rad + span_rad * step as f64 / count as f64;
        let (edge_mm, rim_mm) = crescent
            .edge_mm(angle_rad)
            .zip(crescent.rim_mm(angle_rad))
            .ok_or_else(|| {
                let field = if step == 0 {
                    "options.start"
                } else {
                    "options.goal"
                };
                Error::invalid(field, "lies beyond the horns of the crescent")
            })?;
        let way_mm = stations.last().map_or(0.0, |before| {
            before.way_mm + (angle_rad - before.angle_rad).abs() * edge_mm
        });
        stations.push(Station {
            angle_rad,
            edge_mm,
            rim_mm,
            way_mm,
            lesion_mm: 0.0,
            aim_mm: 0.0,
        });
    }
    Ok(stations)
}
