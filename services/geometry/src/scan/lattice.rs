//! Where the voxels of a scan are: centres at whole multiples of three steps from an origin.

use std::ops::RangeInclusive;

use super::{Error, Fault, Point3, Vector3};
use crate::nalgebra::Matrix3;

/// Steps between neighbouring voxels that are accepted, mm: what lies outside is in another unit.
pub const STEPS_MM: RangeInclusive<f64> = 0.01..=50.0;
/// Farthest the first voxel may be from the origin of its axes, mm.
pub const MAX_COORDINATE_MM: f64 = 100_000.0;
/// Least volume of a voxel as a share of the box with the same edges: 1 for right angles, 0 in a plane.
pub const MIN_SOLIDITY: f64 = 0.1;

/// Voxel centres in `ct`, mm.
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice {
    size: [usize; 3],
    origin: Point3,
    steps: Matrix3<f64>,
    index_from_mm: Matrix3<f64>,
}

impl Lattice {
    /// `size` voxels along each axis; `origin` is the centre of voxel (0, 0, 0) and the columns of `steps`
    /// lead from one voxel to the next along each axis, mm.
    ///
    /// # Errors
    /// Everything that is wrong with the three, by the names `sizes`, `origin` and `steps`.
    pub fn new(size: [usize; 3], origin: Point3, steps: Matrix3<f64>) -> Result<Self, Error> {
        let mut faults = Vec::new();
        for (axis, count) in size.into_iter().enumerate() {
            if count == 0 {
                faults.push(Fault::new(
                    format!("sizes[{axis}]"),
                    "is 0, must be at least 1",
                ));
            }
        }
        let count = size.iter().try_fold(1usize, |all, &n| all.checked_mul(n));
        if count.is_none_or(|count| count > super::MAX_BYTES) {
            let [columns, rows, slices] = size;
            faults.push(Fault::new(
                "sizes",
                format!(
                    "are {columns} x {rows} x {slices}, must be at most {} voxels",
                    super::MAX_BYTES
                ),
            ));
        }
        if !origin.iter().all(|c| c.abs() <= MAX_COORDINATE_MM) {
            faults.push(Fault::new(
                "origin",
                format!(
                    "is ({}, {}, {}) mm, must be finite and within {MAX_COORDINATE_MM} mm",
                    origin.x, origin.y, origin.z
                ),
            ));
        }
        for axis in 0..3 {
            let length_mm = steps.column(axis).norm();
            if !STEPS_MM.contains(&length_mm) {
                faults.push(Fault::new(
                    format!("steps[{axis}]"),
                    format!(
                        "is {length_mm} mm long, must be {} to {} mm; is it in another unit?",
                        STEPS_MM.start(),
                        STEPS_MM.end()
                    ),
                ));
            }
        }
        if !faults.is_empty() {
            return Err(Error { faults });
        }
        let edges: f64 = (0..3).map(|axis| steps.column(axis).norm()).product();
        let solidity = steps.determinant().abs() / edges;
        match steps.try_inverse() {
            Some(index_from_mm) if solidity >= MIN_SOLIDITY => Ok(Self {
                size,
                origin,
                steps,
                index_from_mm,
            }),
            _ => Err(Error::one(
                "steps",
                format!(
                    "lie almost in a plane: a voxel fills {solidity:.4} of a box with its edges, must fill at least {MIN_SOLIDITY}"
                ),
            )),
        }
    }

    /// How many voxels along each axis.
    pub fn size(&self) -> [usize; 3] {
        self.size
    }

    /// How many voxels.
    pub fn len(&self) -> usize {
        self.size.iter().product()
    }

    /// Never: a lattice has at least one voxel.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Centre of voxel (0, 0, 0), mm.
    pub fn origin(&self) -> Point3 {
        self.origin
    }

    /// Steps from one voxel to the next along each axis, as columns, mm.
    pub fn steps(&self) -> &Matrix3<f64> {
        &self.steps
    }

    /// The point at fractional voxel indices, mm.
    pub fn point(&self, index: Vector3) -> Point3 {
        self.origin + self.steps * index
    }

    /// Fractional voxel indices of a point.
    pub fn index(&self, point: &Point3) -> Vector3 {
        self.index_from_mm * (point - self.origin)
    }

    /// Volume of a voxel, mm3.
    pub fn voxel_mm3(&self) -> f64 {
        self.steps.determinant().abs()
    }

    /// Edges of a voxel, mm.
    pub fn spacing_mm(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.steps.column(axis).norm())
    }

    /// Whether its three axes are left-handed in space, which turns every orientation round.
    pub fn is_left_handed(&self) -> bool {
        self.steps.determinant() < 0.0
    }
}
