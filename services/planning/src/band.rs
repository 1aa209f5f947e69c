//! The region inboard of a contour: what lies between the free edge and the contour, from the ray of
//! its first to the ray of its last point.

use arthro_geometry::Point3;

use crate::crescent::Crescent;

/// Angle between the stations of the table.
const STATION_RAD: f64 = 0.25 * std::f64::consts::PI / 180.0;

/// Distance of a contour from the centre of the crescent, by angle.
#[derive(Clone, Debug)]
pub struct Band {
    first_rad: f64,
    radii_mm: Vec<f64>,
}

impl Band {
    /// The band inboard of a polyline in the axes of the crescent. Where it passes an angle more than
    /// once, the outermost passage counts.
    pub fn inboard_of(polyline: &[Point3], crescent: &Crescent) -> Self {
        let polar: Vec<(f64, f64)> = polyline
            .iter()
            .map(|point| (crescent.angle_rad(point), point.xy().coords.norm()))
            .collect();
        let angles = polar.iter().map(|&(angle, _)| angle);
        let first_rad = angles.clone().fold(f64::INFINITY, f64::min);
        let last_rad = angles.fold(f64::NEG_INFINITY, f64::max);
        let stations = if first_rad < last_rad {
            ((last_rad - first_rad) / STATION_RAD).floor() as usize + 1
        } else {
            0
        };
        let mut radii_mm = vec![0.0f64; stations];
        for pair in polar.windows(2) {
            let ((a, radius_a), (b, radius_b)) = if pair[0].0 <= pair[1].0 {
                (pair[0], pair[1])
            } else {
                (pair[1], pair[0])
            };
            let from = ((a - first_rad) / STATION_RAD).ceil() as usize;
            let to = ((b - first_rad) / STATION_RAD).floor() as usize;
            let passed = radii_mm.iter_mut().enumerate().take(to + 1).skip(from);
            for (station, deepest_mm) in passed {
                let angle = first_rad + station as f64 * STATION_RAD;
                let share = (angle - a) / (b - a).max(1e-12);
                let radius_mm = radius_a + share.clamp(0.0, 1.0) * (radius_b - radius_a);
                *deepest_mm = deepest_mm.max(radius_mm);
            }
        }
        Self {
            first_rad,
            radii_mm,
        }
    }

    /// Distance of the contour from the centre at an angle, mm; `None` beyond its ends.
    pub fn radius_mm(&self, angle_rad: f64) -> Option<f64> {
        let position = (angle_rad - self.first_rad) / STATION_RAD;
        if position < 0.0 {
            return None;
        }
        let before = self.radii_mm.get(position.floor() as usize)?;
        let after = self
            .radii_mm
            .get(position.ceil() as usize)
            .unwrap_or(before);
        Some(before + position.fract() * (after - before))
    }

    /// Whether a point lies inboard of the contour.
    pub fn contains(&self, point: &Point3, crescent: &Crescent) -> bool {
        self.radius_mm(crescent.angle_rad(point))
            .is_some_and(|radius_mm| point.xy().coords.norm() < radius_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use arthro_geometry::phantom;

    fn ring(radius_mm: f64, from_deg: i32, to_deg: i32) -> Vec<Point3> {
        (from_deg..=to_deg)
            .map(|angle_deg| {
                let (sin, cos) = f64::from(angle_deg).to_radians().sin_cos();
                Point3::new(radius_mm * cos, radius_mm * sin, 0.0)
            })
            .collect()
    }

    #[test]
    fn what_is_nearer_the_centre_between_the_ends_is_inboard() {
        let crescent = Crescent::of(&phantom::mesh(), &phantom::PORTAL_ANTEROLATERAL).unwrap();
        let mut contour = ring(12.0, -30, 40);
        for band in [
            Band::inboard_of(&contour, &crescent),
            Band::inboard_of(
                &{
                    contour.reverse();
                    contour
                },
                &crescent,
            ),
        ] {
            assert!(band.contains(&Point3::new(11.9, 0.0, 3.0), &crescent));
            assert!(!band.contains(&Point3::new(12.1, 0.0, 3.0), &crescent));
            assert!(!band.contains(&Point3::new(0.0, -9.0, 0.0), &crescent));
        }
    }

    #[test]
    fn a_contour_of_one_point_or_none_has_nothing_inboard() {
        let crescent = Crescent::of(&phantom::mesh(), &phantom::PORTAL_ANTEROLATERAL).unwrap();
        for contour in [vec![], ring(12.0, 5, 5), vec![Point3::origin(); 3]] {
            let band = Band::inboard_of(&contour, &crescent);
            assert!(!band.contains(&Point3::new(9.0, 0.5, 0.0), &crescent));
        }
    }
}
