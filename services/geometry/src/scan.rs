//! Scans: voxel values on a lattice in the patient's axes, as a scanner or a segmentation gives them.
//!
//! A [`Scan`] is what a surface is reconstructed from; the voxels of a surface that exists already are
//! a [`Solid`](crate::volume::Solid). A lattice may be anisotropic, oblique and left-handed: only
//! [`Lattice::point`] knows where a voxel is.

use crate::{Point3, Vector3};

mod label_points;
mod labels;
mod lattice;
mod voxels;

pub use label_points::{MAX_LABEL_POINTS, NoPoints, label_points};
pub use labels::{Label, MAX_LABELS, NoLabels, labels};
pub use lattice::{Lattice, MAX_COORDINATE_MM, MIN_SOLIDITY, STEPS_MM};
pub use voxels::{ByteOrder, Value, Visit, VoxelType, Voxels};

/// Most bytes the values of a scan may take.
pub const MAX_BYTES: usize = 512 << 20;

/// Voxel values on a lattice in `ct`.
#[derive(Clone, Debug, PartialEq)]
pub struct Scan {
    lattice: Lattice,
    voxels: Voxels,
}

/// What is wrong with a lattice or with its values: everything found.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", faults.iter().map(Fault::to_string).collect::<Vec<_>>().join("; "))]
pub struct Error {
    /// At least one.
    pub faults: Vec<Fault>,
}

/// One thing that is wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// `sizes`, `steps`, `origin` or `voxels`, with an index where one is meant.
    pub field: String,
    /// Value and limit.
    pub description: String,
}

// === impl Scan ===

impl Scan {
    /// `voxels` on `lattice`.
    ///
    /// # Errors
    /// If there is not one value a voxel, or a value is not finite.
    pub fn new(lattice: Lattice, voxels: Voxels) -> Result<Self, Error> {
        let (count, expected) = (voxels.len(), lattice.len());
        if count != expected {
            return Err(Error::one(
                "voxels",
                format!("has {count} values, must have {expected}"),
            ));
        }
        if let Some((index, value)) = voxels.visit(FirstNotFinite) {
            return Err(Error::one(
                format!("voxels[{index}]"),
                format!("is {value}, must be finite"),
            ));
        }
        Ok(Self { lattice, voxels })
    }

    /// Where the voxels are.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// What they hold.
    pub fn voxels(&self) -> &Voxels {
        &self.voxels
    }
}

struct FirstNotFinite;

impl Visit for FirstNotFinite {
    type Output = Option<(usize, f64)>;
    fn visit<T: Value>(self, values: &[T]) -> Option<(usize, f64)> {
        let finite = |value: &T| (*value).into().is_finite();
        let index = values.iter().position(|value| !finite(value))?;
        Some((index, values[index].into()))
    }
}

// === impl Error ===

impl Error {
    fn one(field: impl Into<String>, description: impl Into<String>) -> Self {
        Self {
            faults: vec![Fault::new(field, description)],
        }
    }
}

impl Fault {
    fn new(field: impl Into<String>, description: impl Into<String>) -> Self {
        Self {
            field: field.into(),
            description: description.into(),
        }
    }
}

impl std::fmt::Display for Fault {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{} {}", self.field, self.description)
    }
}

#[cfg(test)]
mod tests;
