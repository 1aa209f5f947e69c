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
