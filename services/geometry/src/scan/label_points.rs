//! Where the voxels of one label are.

use super::{Lattice, Point3, Scan, Value, Vector3, Visit};

/// Most voxels of a label that are listed: a lesion has thousands, a bone millions.
pub const MAX_LABEL_POINTS: usize = 500_000;

/// Why the voxels of a label are not listed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoPoints {
    /// No voxel has the label.
    #[error("no voxel has the label {0}")]
    Absent(i64),
    /// More than are listed.
    #[error("more than {MAX_LABEL_POINTS} voxels have the label {0}")]
    TooMany(i64),
}

/// Centres of all voxels with a label in ct, mm, in the order of the scan; how far they are apart is
/// [`Lattice::spacing_mm`].
///
/// # Errors
/// If no voxel has the label, or too many have it.
pub fn label_points(scan: &Scan, label: i64) -> Result<Vec<Point3>, NoPoints> {
    scan.voxels.visit(Listing {
        lattice: &scan.lattice,
        label,
    })
}

struct Listing<'a> {
    lattice: &'a Lattice,
    label: i64,
}

impl Visit for Listing<'_> {
    type Output = Result<Vec<Point3>, NoPoints>;

    fn visit<T: Value>(self, values: &[T]) -> Self::Output {
        let [columns, rows, _] = self.lattice.size();
        let label = T::exactly(self.label as f64).ok_or(NoPoints::Absent(self.label))?;
        let found = values
            .iter()
            .enumerate()
            .filter(|(_, value)| **value == label);
        let points: Vec<Point3> = found
            .take(MAX_LABEL_POINTS + 1)
            .map(|(index, _)| {
                let line = index / columns;
                let cell = [index % columns, line % rows, line / rows].map(|n| n as f64);
                self.lattice.point(Vector3::from(cell))
            })
            .collect();
        match points.len() {
            0 => Err(NoPoints::Absent(self.label)),
            count if count > MAX_LABEL_POINTS => Err(NoPoints::TooMany(self.label)),
            _ => Ok(points),
        }
    }
}
