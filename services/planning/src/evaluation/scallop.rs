//! How far the new inner edge is from the contour that was aimed at: the scallops that straight jaws
//! leave, and what they missed or took too much of.

use super::edge::Edge;
use crate::band::Band;

/// Distance between the new edge and the planned contour along the rays between the contour's ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scallop {
    /// Root mean square, mm.
    pub rms_mm: f64,
    /// Largest, mm.
    pub max_mm: f64,
}

impl Scallop {
    /// Of an edge against the contour of a band; `None` if no ray meets the contour. Where the contour
    /// runs inboard of the free edge, nothing was to be removed and the free edge is the measure.
    pub fn of(edge: &Edge, band: &Band) -> Option<Self> {
        let (mut sum, mut max_mm, mut count) = (0.0, 0f64, 0usize);
        for ray in &edge.rays {
            let Some(contour_mm) = band.radius_mm(ray.angle_rad) else {
                continue;
            };
            let off_mm = (ray.new_mm - contour_mm.max(ray.old_mm)).abs();
            sum += off_mm * off_mm;
            max_mm = max_mm.max(off_mm);
            count += 1;
        }
        (count > 0).then(|| Self {
            rms_mm: (sum / count as f64).sqrt(),
            max_mm,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crescent::Crescent;
    use crate::evaluation::edge::Ray;
    use arthro_geometry::{Point3, phantom};

    fn ring(radius_mm: f64, ends_deg: i32) -> Band {
        let crescent = Crescent::of(&phantom::mesh(), &phantom::PORTAL_ANTEROLATERAL).unwrap();
        let points: Vec<Point3> = (-ends_deg..=ends_deg)
            .map(|deg| {
                let (sin, cos) = f64::from(deg).to_radians().sin_cos();
                Point3::new(radius_mm * cos, radius_mm * sin, 0.0)
            })
            .collect();
        Band::inboard_of(&points, &crescent)
    }

    fn edge(new_mm: impl Fn(i32) -> f64) -> Edge {
        let rays = (-60..=60).map(|deg| Ray {
            angle_rad: f64::from(deg).to_radians(),
            old_mm: 12.0,
            new_mm: new_mm(deg),
            rim_mm: 22.0 - new_mm(deg),
            is_bitten: true,
            at: Point3::origin(),
        });
        Edge {
            rays: rays.collect(),
        }
    }

    #[test]
    fn too_much_and_too_little_count_alike_between_the_ends() {
        let edge = edge(|deg| match deg {
            -30..0 => 14.5,
            0..=30 => 16.0,
            _ => 20.0,
        });
        let scallop = Scallop::of(&edge, &ring(15.0, 30)).unwrap();
        assert!((scallop.max_mm - 1.0).abs() < 1e-9);
        let rms_mm = ((30.0 * 0.25 + 31.0) / 61.0f64).sqrt();
        assert!((scallop.rms_mm - rms_mm).abs() < 1e-3, "{scallop:?}");
    }

    #[test]
    fn a_contour_in_the_hollow_asks_for_nothing() {
        let scallop = Scallop::of(&edge(|_| 12.0), &ring(9.0, 30)).unwrap();
        assert_eq!((scallop.rms_mm, scallop.max_mm), (0.0, 0.0));
    }

    #[test]
    fn no_ray_or_no_contour_has_no_scallop() {
        assert_eq!(Scallop::of(&edge(|_| 12.0), &ring(9.0, 0)), None);
        assert_eq!(Scallop::of(&Edge { rays: vec![] }, &ring(15.0, 30)), None);
    }
}
