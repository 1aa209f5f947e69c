//! The tissue as the arthroscope sees it from above: its height column by column, and the tibia's
//! plateau below it.
//!
//! The meniscus rests on the tibia, so whatever lies below its superior surface is in the way of a
//! shaft and of a line of sight. A shaft of some radius is clear of the tissue where its axis is
//! above the relief raised by a ball of that radius.

use arthro_geometry::Point3;

use crate::voxels::Voxels;

/// Heights over the plane of the crescent.
#[derive(Clone, Debug)]
pub(super) struct Relief {
    /// Middle of the first column, mm.
    origin_mm: [f64; 2],
    /// Edge of a column, mm.
    column_mm: f64,
    size: [usize; 2],
    /// Top of the tissue of each column, row by row, mm; that of the plateau beside the tissue.
    top_mm: Vec<f64>,
    /// The plateau, mm.
    plateau_mm: f64,
    /// The highest top, mm.
    summit_mm: f64,
}

impl Relief {
    /// The superior surface of `tissue`; its lowest point rests on the plateau.
    pub(super) fn of(tissue: &Voxels) -> Self {
        let column_mm = tissue.voxel_mm();
        let half_mm = 0.5 * column_mm;
        let (mut low, mut high) = (
            Point3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
            Point3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
        );
        for center in tissue.centers() {
            low = low.inf(center);
            high = high.sup(center);
        }
        let columns = |axis: usize| {
            if tissue.centers().is_empty() {
                0
            } else {
                ((high[axis] - low[axis]) / column_mm).round() as usize + 1
            }
        };
        let size = [columns(0), columns(1)];
        let plateau_mm = low.z - half_mm;
        let mut relief = Self {
            origin_mm: [low.x, low.y],
            column_mm,
            size,
            top_mm: vec![plateau_mm; size[0] * size[1]],
            plateau_mm,
            summit_mm: plateau_mm.max(high.z + half_mm),
        };
        for center in tissue.centers() {
            if let Some(column) = relief.column(center.x, center.y) {
                let top_mm = &mut relief.top_mm[column];
                *top_mm = top_mm.max(center.z + half_mm);
            }
        }
        relief
    }

    /// Where the middle of a ball may be at the lowest: the relief raised by the ball.
    pub(super) fn raised(&self, radius_mm: f64) -> Self {
        let reach = (radius_mm / self.column_mm).floor() as usize + 1;
        let size = self.size.map(|columns| columns + 2 * reach);
        let plateau_mm = self.plateau_mm + radius_mm;
        let mut top_mm = vec![plateau_mm; size[0] * size[1]];
        let ball = ball_mm(radius_mm, self.column_mm, reach);
        for j in 0..self.size[1] {
            for i in 0..self.size[0] {
                let height_mm = self.top_mm[j * self.size[0] + i];
                if height_mm <= self.plateau_mm {
                    continue;
                }
                for &(right, back, above_mm) in &ball {
                    let raised_mm = &mut top_mm[(j + back) * size[0] + i + right];
                    *raised_mm = raised_mm.max(height_mm + above_mm);
                }
            }
        }
        let margin_mm = reach as f64 * self.column_mm;
        Self {
            origin_mm: self.origin_mm.map(|value| value - margin_mm),
            column_mm: self.column_mm,
            size,
            top_mm,
            plateau_mm,
            summit_mm: self.summit_mm + radius_mm,
        }
    }

    /// Height at a place of the plane, mm.
    pub(super) fn height_mm(&self, x: f64, y: f64) -> f64 {
        self.column(x, y)
            .map_or(self.plateau_mm, |column| self.top_mm[column])
    }

    /// Edge of a column, mm.
    pub(super) fn column_mm(&self) -> f64 {
        self.column_mm
    }

    /// Whether a point lies below the relief.
    pub(super) fn buries(&self, point: &Point3) -> bool {
        point.z < self.height_mm(point.x, point.y)
    }

    /// Length of the straight way between two points that lies below the relief, mm.
    pub(super) fn buried_mm(&self, from: &Point3, to: &Point3) -> f64 {
        if from.z.min(to.z) >= self.summit_mm {
            return 0.0;
        }
        let way = to - from;
        let steps = (way.norm() / self.column_mm).ceil().max(1.0);
        let buried = (0..steps as usize)
            .filter(|&step| self.buries(&(from + way * ((step as f64 + 0.5) / steps))));
        buried.count() as f64 * way.norm() / steps
    }

    /// Whether the relief hides a point on it from an eye. The stairs of the columns next to the point
    /// do not count.
    pub(super) fn hides(&self, point: &Point3, eye: &Point3) -> bool {
        let way = eye - point;
        let steps = (way.norm() / self.column_mm).ceil().max(1.0);
        let rise_mm = way.z / steps;
        let below_summit = if rise_mm > 0.0 {
            ((self.summit_mm - point.z) / rise_mm)
                .ceil()
                .clamp(0.0, steps)
        } else {
            steps
        };
        (2..below_summit as usize).any(|step| self.buries(&(point + way * (step as f64 / steps))))
    }

    fn column(&self, x: f64, y: f64) -> Option<usize> {
        let i = ((x - self.origin_mm[0]) / self.column_mm).round();
        let j = ((y - self.origin_mm[1]) / self.column_mm).round();
        let on_grid =
            (0.0..self.size[0] as f64).contains(&i) && (0.0..self.size[1] as f64).contains(&j);
        on_grid.then(|| j as usize * self.size[0] + i as usize)
    }
}

/// Columns that a ball on a column can reach, counted from the first, and how far its middle stands
/// above a top there, mm. Both ball and top may be anywhere on their column: the nearest places count.
fn ball_mm(radius_mm: f64, column_mm: f64, reach: usize) -> Vec<(usize, usize, f64)> {
    let offset_mm = |index: usize| index.abs_diff(reach).saturating_sub(1) as f64 * column_mm;
    let columns = (0..=2 * reach).flat_map(|back| (0..=2 * reach).map(move |right| (right, back)));
    columns
        .filter_map(|(right, back)| {
            let flat_mm = offset_mm(right).hypot(offset_mm(back));
            let above_mm = (radius_mm * radius_mm - flat_mm * flat_mm).sqrt();
            (flat_mm <= radius_mm).then_some((right, back, above_mm))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crescent::Crescent;
    use arthro_geometry::phantom::{self, Coordinates, Phantom};

    fn phantom_relief() -> (Crescent, Voxels, Relief) {
        let mesh = phantom::mesh();
        let crescent = Crescent::of(&mesh, &phantom::PORTAL_ANTEROLATERAL).unwrap();
        let voxels = Voxels::of(&mesh, &crescent, 0.5, 1.0).unwrap();
        let relief = Relief::of(&voxels);
        (crescent, voxels, relief)
    }

    #[test]
    fn the_relief_is_the_phantoms_superior_surface() {
        let (crescent, _, relief) = phantom_relief();
        for width_fraction in [0.2, 0.5, 0.8] {
            let on_top = Phantom::default().point(Coordinates {
                phi_rad: 0.2,
                width_fraction,
                height_fraction: 1.0,
            });
            let local = crescent.ct_from_meniscal.inverse() * on_top;
            let height_mm = relief.height_mm(local.x, local.y);
            assert!((height_mm - local.z).abs() < 0.7, "{height_mm} {local}");
        }
    }

    #[test]
    fn a_ball_rests_on_the_raised_relief_without_touching_the_tissue() {
        let (_, voxels, relief) = phantom_relief();
        let raised = relief.raised(2.0);
        for x in -4..5 {
            for y in -8..9 {
                let (x, y) = (15.0 + 2.0 * f64::from(x), 2.0 * f64::from(y));
                let rests_at = Point3::new(x, y, raised.height_mm(x, y));
                let distance_mm = voxels.distance_mm(&rests_at, 3.0);
                assert!(
                    distance_mm.is_none_or(|mm| mm > 2.0 - 1e-9),
                    "{distance_mm:?} at {rests_at}"
                );
            }
        }
    }

    #[test]
    fn beside_the_tissue_lies_the_plateau() {
        let (_, voxels, relief) = phantom_relief();
        let lowest_mm = voxels.centers().iter().map(|center| center.z);
        let lowest_mm = lowest_mm.fold(f64::INFINITY, f64::min);
        assert_eq!(relief.height_mm(0.0, 0.0), lowest_mm - 0.25);
        assert_eq!(relief.height_mm(1e9, f64::NAN), lowest_mm - 0.25);
        assert_eq!(relief.raised(2.0).height_mm(0.0, 0.0), lowest_mm + 1.75);
    }

    #[test]
    fn the_rim_hides_the_free_edge_from_a_low_eye_outside_and_from_no_high_one() {
        let (crescent, _, relief) = phantom_relief();
        let on_top = |x: f64| Point3::new(x, 0.0, relief.height_mm(x, 0.0) + 0.25);
        let edge = on_top(crescent.edge_mm(0.0).unwrap() + 1.0);
        let rim = on_top(crescent.rim_mm(0.0).unwrap() - 1.0);
        let outside = |height_mm: f64| Point3::new(35.0, 0.0, rim.z + height_mm);
        assert!(relief.hides(&edge, &outside(0.0)));
        assert!(!relief.hides(&edge, &outside(15.0)));
        assert!(!relief.hides(&rim, &outside(15.0)));
        let inside = Point3::new(0.0, 0.0, edge.z + 1.0);
        assert!(!relief.hides(&edge, &inside));
    }

    #[test]
    fn the_buried_part_of_a_way_through_the_body_is_as_long_as_the_body_is_wide() {
        let (_, _, relief) = phantom_relief();
        let at = |x: f64| Point3::new(x, 0.0, -1.0);
        let buried_mm = relief.buried_mm(&at(0.0), &at(60.0));
        assert!((buried_mm - 10.0).abs() < 1.5, "{buried_mm} mm");
        let above = Point3::new(60.0, 0.0, 20.0);
        assert_eq!(relief.buried_mm(&Point3::new(0.0, 0.0, 20.0), &above), 0.0);
    }
}
