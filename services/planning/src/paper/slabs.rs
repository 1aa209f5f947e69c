//! Points in slabs across the tissue's longest extent, so that the nearest one is found without
//! visiting all of them. A tree that stalls has a hundred thousand.

use arthro_geometry::Point3;

/// Thickness of a slab, mm.
const SLAB_MM: f64 = 0.5;
/// Most slabs.
const MAX_SLABS: f64 = 1_000.0;

/// Points, each with the number under which it was added.
pub(super) struct Slabs {
    axis: usize,
    low_mm: f64,
    slabs: Vec<Vec<(Point3, usize)>>,
    points: usize,
}

impl Slabs {
    /// No points yet; slabs across the longest extent of `space`.
    pub(super) fn across(space: &[Point3]) -> Self {
        let mut low = Point3::origin();
        let mut high = Point3::origin();
        if let Some(first) = space.first() {
            (low, high) = space.iter().fold((*first, *first), |(low, high), point| {
                (low.inf(point), high.sup(point))
            });
        }
        let extent = high - low;
        let axis = extent.imax();
        let count = (extent[axis] / SLAB_MM).ceil().clamp(1.0, MAX_SLABS) as usize;
        Self {
            axis,
            low_mm: low[axis],
            slabs: vec![Vec::new(); count],
            points: 0,
        }
    }

    /// Adds a point; its number is how many were added before.
    pub(super) fn push(&mut self, point: Point3) {
        let slab = self.slab(&point);
        self.slabs[slab].push((point, self.points));
        self.points += 1;
    }

    /// The number of the point nearest to `place`; 0 while there is none.
    pub(super) fn nearest(&self, place: &Point3) -> usize {
        let own = self.slab(place);
        let mut best = (f64::INFINITY, 0);
        for away in 0..self.slabs.len() {
            let gap_mm = gap_mm(away);
            if gap_mm * gap_mm > best.0 {
                break;
            }
            for (point, number) in self.slabs_at(own, away).flatten() {
                let squared = (place - point).norm_squared();
                if squared < best.0 {
                    best = (squared, *number);
                }
            }
        }
        best.1
    }

    /// Whether a point lies nearer than `radius_mm` to `place`.
    pub(super) fn has_within(&self, place: &Point3, radius_mm: f64) -> bool {
        let own = self.slab(place);
        let squared = radius_mm * radius_mm;
        (0..self.slabs.len())
            .take_while(|&away| gap_mm(away) < radius_mm)
            .any(|away| {
                let mut points = self.slabs_at(own, away).flatten();
                points.any(|(point, _)| (place - point).norm_squared() < squared)
            })
    }

    /// The slab of a place; what lies beyond the first or the last slab belongs to it. That moves two
    /// places only nearer to each other, so that [`gap_mm`] holds for them as well.
    fn slab(&self, place: &Point3) -> usize {
        let position = (place[self.axis] - self.low_mm) / SLAB_MM;
        position.clamp(0.0, (self.slabs.len() - 1) as f64) as usize
    }

    /// The one or two slabs so many slabs `away`.
    fn slabs_at(&self, own: usize, away: usize) -> impl Iterator<Item = &Vec<(Point3, usize)>> {
        let below = own.checked_sub(away);
        let above = (away > 0).then_some(own + away);
        let both = [below, above].into_iter().flatten();
        both.filter_map(|slab| self.slabs.get(slab))
    }
}

/// The least distance between places so many slabs apart, mm.
fn gap_mm(away: usize) -> f64 {
    away.saturating_sub(1) as f64 * SLAB_MM
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn place() -> impl Strategy<Value = Point3> {
        (-30.0..30.0f64, -9.0..9.0f64, -3.0..3.0f64).prop_map(|(x, y, z)| Point3::new(x, y, z))
    }

    proptest! {
        #[test]
        fn the_nearest_point_is_the_one_that_a_scan_of_all_finds(
            points in proptest::collection::vec(place(), 1..60),
            space in proptest::collection::vec(place(), 0..4),
            asked in place(),
            radius_mm in 0.0..9.0f64,
        ) {
            let mut slabs = Slabs::across(&space);
            points.iter().for_each(|&point| slabs.push(point));
            let distances = points.iter().map(|point| (asked - point).norm());
            let least_mm = distances.fold(f64::INFINITY, f64::min);
            let found_mm = (asked - points[slabs.nearest(&asked)]).norm();
            prop_assert_eq!(found_mm, least_mm);
            prop_assert_eq!(slabs.has_within(&asked, radius_mm), least_mm < radius_mm);
        }
    }
}
