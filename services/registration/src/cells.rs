//! Points sorted into cubic cells, so that all that lie near a query are found by looking into a few of them.

use arthro_geometry::cloud::bounds;
use arthro_geometry::{Point3, Vector3};

/// Most cells; a cloud that would need more (strays far away) gets larger ones.
const MAX_CELLS: f64 = 2e6;

/// A fixed set of points in cells. Indices are those of the slice it was built from.
#[derive(Clone, Debug)]
pub struct Cells {
    low: Point3,
    cells_per_mm: f64,
    size: [usize; 3],
    /// Where each cell's points begin; one more at the end.
    starts: Vec<u32>,
    points: Vec<Point3>,
    indices: Vec<u32>,
}

impl Cells {
    /// Sorts `points` into cells of about `edge_mm`; O(n). At most `u32::MAX` points, all finite.
    pub fn new(points: &[Point3], edge_mm: f64) -> Self {
        let origin = (Point3::origin(), Point3::origin());
        let (low, high) = bounds(points).unwrap_or(origin);
        let extent = high - low;
        let mut edge_mm = edge_mm.max(1e-9 * extent.max()).max(f64::MIN_POSITIVE);
        let count = |edge: f64| {
            extent
                .iter()
                .map(|e| (e / edge).floor() + 1.0)
                .product::<f64>()
        };
        while count(edge_mm) > MAX_CELLS {
            edge_mm *= 1.5;
        }
        let size: [usize; 3] = extent.map(|e| (e / edge_mm) as usize + 1).into();
        let mut cells = Self {
            low,
            cells_per_mm: 1.0 / edge_mm,
            size,
            starts: vec![0; size.iter().product::<usize>() + 1],
            points: vec![Point3::origin(); points.len()],
            indices: vec![0; points.len()],
        };
        let homes: Vec<usize> = points.iter().map(|point| cells.home(point)).collect();
        for home in &homes {
            cells.starts[home + 1] += 1;
        }
        for cell in 1..cells.starts.len() {
            cells.starts[cell] += cells.starts[cell - 1];
        }
        let mut next = cells.starts.clone();
        for (index, (point, home)) in points.iter().zip(homes).enumerate() {
            let place = next[home] as usize;
            next[home] += 1;
            cells.points[place] = *point;
            cells.indices[place] = index as u32;
        }
        cells
    }

    /// Calls `found` with the index and squared distance (mm2) of each point within `radius_mm` of `query`.
    pub fn within(&self, query: &Point3, radius_mm: f64, mut found: impl FnMut(usize, f64)) {
        let limit2 = radius_mm * radius_mm;
        let reach = Vector3::repeat(radius_mm);
        let first = self.along(&(query - reach));
        let last = self.along(&(query + reach));
        for slice in first[2]..=last[2] {
            for row in first[1]..=last[1] {
                let line = (slice * self.size[1] + row) * self.size[0];
                // Cells of a row stand one after another.
                let from = self.starts[line + first[0]] as usize;
                let to = self.starts[line + last[0] + 1] as usize;
                for place in from..to {
                    let distance2 = (self.points[place] - query).norm_squared();
                    if distance2 <= limit2 {
                        found(self.indices[place] as usize, distance2);
                    }
                }
            }
        }
    }

    /// How many points lie within `radius_mm` of `query`.
    pub fn count_within(&self, query: &Point3, radius_mm: f64) -> usize {
        let mut count = 0;
        self.within(query, radius_mm, |_, _| count += 1);
        count
    }

    /// The cell of a point, or the outermost one on its side.
    fn along(&self, point: &Point3) -> [usize; 3] {
        // A cast saturates: what lies below the first cell is in it.
        let cell = |axis: usize| {
            let steps = ((point[axis] - self.low[axis]) * self.cells_per_mm) as usize;
            steps.min(self.size[axis] - 1)
        };
        [cell(0), cell(1), cell(2)]
    }

    fn home(&self, point: &Point3) -> usize {
        let [column, row, slice] = self.along(point);
        (slice * self.size[1] + row) * self.size[0] + column
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn points() -> impl Strategy<Value = Vec<Point3>> {
        let coordinate = (-40i32..40).prop_map(|c| f64::from(c) * 0.5);
        prop::collection::vec(
            prop::array::uniform3(coordinate).prop_map(Point3::from),
            1..150,
        )
    }

    proptest! {
        #[test]
        fn the_cells_find_what_brute_force_finds(
            cloud in points(), edge in 0.01..30.0f64, radius in 0.0..25.0f64, x in -30.0..30.0f64
        ) {
            let query = Point3::new(x, 0.3 * x, -0.5 * x);
            let cells = Cells::new(&cloud, edge);
            let mut found = Vec::new();
            cells.within(&query, radius, |index, _| found.push(index));
            found.sort_unstable();
            let expected: Vec<usize> = (0..cloud.len())
                .filter(|&index| (cloud[index] - query).norm_squared() <= radius * radius)
                .collect();
            prop_assert_eq!(found, expected);
        }
    }

    #[test]
    fn a_stray_far_away_does_not_ask_for_more_memory() {
        let cells = Cells::new(&[Point3::origin(), Point3::new(1e5, -1e5, 1e5)], 0.1);
        assert!(cells.starts.len() <= MAX_CELLS as usize + 1);
        assert_eq!(cells.count_within(&Point3::origin(), 1.0), 1);
    }
}
