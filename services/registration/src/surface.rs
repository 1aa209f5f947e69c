//! A cloud made ready for matching: evenly thinned, with fitted normals and a search tree.

use arthro_geometry::{Point3, Vector3};

use crate::field::Field;
use crate::neighbours::Neighbours;
use crate::sampling;

/// Neighbours that a normal is fitted to.
const NORMAL_NEIGHBOURS: usize = 14;

/// A sampled surface in one frame, mm.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Evenly spread points.
    pub points: Vec<Point3>,
    /// Unit normals of `points`; signs are arbitrary.
    pub normals: Vec<Vector3>,
    /// Median distance between neighbouring points, mm.
    pub spacing_mm: f64,
    tree: Neighbours,
    field: Option<Field>,
}

/// How the nearest sample is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Matching {
    /// Looked up in a grid: fast, a sample or two off.
    Rough,
    /// Searched in the tree.
    Exact,
}

/// Where a point meets the surface.
#[derive(Clone, Copy, Debug)]
pub struct Foot {
    /// Index of the surface's nearest sample.
    pub index: usize,
    /// Squared distance to that sample, mm2.
    pub distance2: f64,
    /// Squared distance to the surface between the samples, mm2; never more than `distance2`.
    pub surface_distance2: f64,
}

impl Surface {
    /// Thins `points` to at most `count` and fits normals.
    pub fn new(points: &[Point3], count: usize) -> Self {
        let points = sampling::spread(points, count);
        let tree = Neighbours::new(&points);
        let normals = sampling::fitted_normals(&points, &tree, NORMAL_NEIGHBOURS);
        let spacing_mm = sampling::spacing_mm(&points, &tree);
        Self {
            points,
            normals,
            spacing_mm,
            tree,
            field: None,
        }
    }

    /// With the grid that makes rough matching fast.
    pub fn with_lookup(mut self) -> Self {
        self.field = Some(Field::new(&self.points, &self.tree));
        self
    }

    /// At most `count` of the samples, with the normals that all of them gave.
    pub fn thinned(&self, count: usize) -> Self {
        let (points, normals): (Vec<Point3>, Vec<Vector3>) = sampling::spread(&self.points, count)
            .iter()
            .filter_map(|point| self.tree.nearest(point))
            .map(|nearest| (self.points[nearest.index], self.normals[nearest.index]))
            .unzip();
        let tree = Neighbours::new(&points);
        let spacing_mm = sampling::spacing_mm(&points, &tree);
        Self {
            points,
            normals,
            spacing_mm,
            tree,
            field: None,
        }
    }

    /// Where `query` meets the surface.
    ///
    /// The samples stand for a continuous surface: a query above it lies up to a spacing beside its nearest
    /// sample, and that sideways part says nothing about the pose.
    pub fn foot(&self, query: &Point3, matching: Matching) -> Foot {
        let index = match matching {
            Matching::Rough => self.roughly_nearest(query),
            Matching::Exact => self.nearest(query),
        };
        let offset = query - self.points[index];
        let distance2 = offset.norm_squared();
        let height2 = self.normals[index].dot(&offset).powi(2);
        let sideways = (distance2 - height2).max(0.0).sqrt();
        let beyond = (sideways - self.spacing_mm).max(0.0);
        Foot {
            index,
            distance2,
            surface_distance2: height2 + beyond * beyond,
        }
    }

    /// Distance from `query` to a sample near it, mm: never less than to the nearest one, and hardly more.
    pub fn rough_distance_mm(&self, query: &Point3) -> f64 {
        (query - self.points[self.roughly_nearest(query)]).norm()
    }

    fn roughly_nearest(&self, query: &Point3) -> usize {
        match &self.field {
            Some(field) => field.nearest(query),
            None => self.nearest(query),
        }
    }

    fn nearest(&self, query: &Point3) -> usize {
        self.tree.nearest(query).map_or(0, |found| found.index)
    }

    /// Whether a sample lies within the square root of `limit2` (mm2) of `query`.
    pub fn has_within(&self, query: &Point3, limit2: f64) -> bool {
        self.tree.nearest_within(query, limit2).is_some()
    }

    /// Length of the diagonal of the axis-aligned bounding box, mm (Eq. 1 and 2).
    pub fn diagonal_mm(&self) -> f64 {
        arthro_geometry::cloud::bounds(&self.points).map_or(0.0, |(low, high)| (high - low).norm())
    }
}
