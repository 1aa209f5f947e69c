//! Exact nearest neighbours: a k-d tree laid flat in the order of its points, without pointers.

use arthro_geometry::Point3;

/// Ranges of at most this many points are searched one by one.
const LEAF: usize = 10;

/// A k-d tree over a fixed set of points. Indices are those of the slice it was built from.
#[derive(Clone, Debug)]
pub struct Neighbours {
    /// Points in tree order: the middle of a range is its splitting point.
    points: Vec<Point3>,
    /// Original index of each point in tree order.
    indices: Vec<u32>,
    /// Splitting axis of the range whose middle stands here.
    axes: Vec<u8>,
}

/// A point found near a query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    /// Index into the points the tree was built from.
    pub index: usize,
    /// Squared distance to the query, mm2.
    pub distance2: f64,
}

impl Neighbours {
    /// Builds the tree; O(n log n). At most `u32::MAX` points, all finite.
    pub fn new(points: &[Point3]) -> Self {
        let mut indices: Vec<u32> = (0..points.len() as u32).collect();
        let mut axes = vec![0; points.len()];
        build(points, &mut indices, &mut axes);
        Self {
            points: indices.iter().map(|&i| points[i as usize]).collect(),
            indices,
            axes,
        }
    }

    /// The nearest point; `None` only for an empty tree.
    pub fn nearest(&self, query: &Point3) -> Option<Neighbour> {
        self.nearest_within(query, f64::INFINITY)
    }

    /// The nearest point closer than the square root of `limit2`, mm2.
    pub fn nearest_within(&self, query: &Point3, limit2: f64) -> Option<Neighbour> {
        let mut best = (usize::MAX, limit2);
        self.search_nearest(query, 0, self.points.len(), &mut best);
        (best.0 != usize::MAX).then(|| Neighbour {
            index: self.indices[best.0] as usize,
            distance2: best.1,
        })
    }

    /// The `count` nearest points (fewer if the tree has fewer), nearest first.
    pub fn nearest_many(&self, query: &Point3, count: usize) -> Vec<Neighbour> {
        let mut found = Vec::with_capacity(count + 1);
        if count > 0 {
            self.search_many(query, 0, self.points.len(), count, &mut found);
        }
        found
    }

    fn search_nearest(&self, query: &Point3, low: usize, high: usize, best: &mut (usize, f64)) {
        if high - low <= LEAF {
            for position in low..high {
                let distance2 = (self.points[position] - query).norm_squared();
                if distance2 < best.1 {
                    *best = (position, distance2);
                }
            }
            return;
        }
        let middle = low + (high - low) / 2;
        let offset =
            query[self.axes[middle] as usize] - self.points[middle][self.axes[middle] as usize];
        let (near, far) = sides(low, middle, high, offset);
        self.search_nearest(query, near.0, near.1, best);
        let distance2 = (self.points[middle] - query).norm_squared();
        if distance2 < best.1 {
            *best = (middle, distance2);
        }
        if offset * offset < best.1 {
            self.search_nearest(query, far.0, far.1, best);
        }
    }

    fn search_many(
        &self,
        query: &Point3,
        low: usize,
        high: usize,
        count: usize,
        found: &mut Vec<Neighbour>,
    ) {
        if high - low <= LEAF {
            for position in low..high {
                self.offer(query, position, count, found);
            }
            return;
        }
        let middle = low + (high - low) / 2;
        let offset =
            query[self.axes[middle] as usize] - self.points[middle][self.axes[middle] as usize];
        let (near, far) = sides(low, middle, high, offset);
        self.search_many(query, near.0, near.1, count, found);
        self.offer(query, middle, count, found);
        if found.len() < count || offset * offset < found[count - 1].distance2 {
            self.search_many(query, far.0, far.1, count, found);
        }
    }

    fn offer(&self, query: &Point3, position: usize, count: usize, found: &mut Vec<Neighbour>) {
        let distance2 = (self.points[position] - query).norm_squared();
        if found.len() == count && distance2 >= found[count - 1].distance2 {
            return;
        }
        let place = found.partition_point(|other| other.distance2 <= distance2);
        found.insert(
            place,
            Neighbour {
                index: self.indices[position] as usize,
                distance2,
            },
        );
        found.truncate(count);
    }
}

/// The half of the range on the query's side of the splitting plane, and the other.
fn sides(low: usize, middle: usize, high: usize, offset: f64) -> ((usize, usize), (usize, usize)) {
    if offset < 0.0 {
        ((low, middle), (middle + 1, high))
    } else {
        ((middle + 1, high), (low, middle))
    }
}

fn build(points: &[Point3], indices: &mut [u32], axes: &mut [u8]) {
    if indices.len() <= LEAF {
        return;
    }
    let axis = widest_axis(points, indices);
    let middle = indices.len() / 2;
    indices.select_nth_unstable_by(middle, |&a, &b| {
        points[a as usize][axis]
            .total_cmp(&points[b as usize][axis])
            .then(a.cmp(&b))
    });
    axes[middle] = axis as u8;
    let (left, right) = indices.split_at_mut(middle);
    let (left_axes, right_axes) = axes.split_at_mut(middle);
    build(points, left, left_axes);
    build(points, &mut right[1..], &mut right_axes[1..]);
}

fn widest_axis(points: &[Point3], indices: &[u32]) -> usize {
    let first = points[indices[0] as usize];
    let (low, high) = indices.iter().fold((first, first), |(low, high), &i| {
        let point = &points[i as usize];
        (low.inf(point), high.sup(point))
    });
    (high - low).imax()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn points(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Point3>> {
        // A coarse lattice, so that equal coordinates and equal points occur.
        let coordinate = (-20i32..20).prop_map(|c| f64::from(c) * 0.5);
        prop::collection::vec(
            (coordinate.clone(), coordinate.clone(), coordinate)
                .prop_map(|(x, y, z)| Point3::new(x, y, z)),
            count,
        )
    }

    proptest! {
        #[test]
        fn the_tree_finds_what_brute_force_finds(
            cloud in points(1..200), query in points(1..2), count in 1usize..20
        ) {
            let query = query[0] + arthro_geometry::Vector3::new(0.1, 0.2, 0.05);
            let mut distances: Vec<f64> = cloud.iter().map(|p| (p - query).norm_squared()).collect();
            let tree = Neighbours::new(&cloud);
            let nearest = tree.nearest(&query).unwrap();
            prop_assert_eq!(distances[nearest.index], nearest.distance2);
            let many: Vec<f64> = tree.nearest_many(&query, count).iter().map(|n| n.distance2).collect();
            distances.sort_by(f64::total_cmp);
            prop_assert_eq!(nearest.distance2, distances[0]);
            distances.truncate(count);
            prop_assert_eq!(many, distances);
        }
    }

    #[test]
    fn nothing_is_nearest_in_an_empty_tree_or_within_too_short_a_reach() {
        assert_eq!(Neighbours::new(&[]).nearest(&Point3::origin()), None);
        let tree = Neighbours::new(&[Point3::new(2.0, 0.0, 0.0)]);
        assert_eq!(tree.nearest_within(&Point3::origin(), 3.9), None);
    }
}
