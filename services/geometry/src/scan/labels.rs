//! The labels of a label map: which there are, how large they are and where.

use std::collections::BTreeMap;

use super::{Lattice, Point3, Scan, Value, Vector3, Visit};

/// Most labels a label map may have; an image has more distinct values.
pub const MAX_LABELS: usize = 4096;

/// One label of a label map.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// Its value.
    pub value: i64,
    /// How many voxels have it.
    pub voxels: usize,
    /// Their volume, mm3.
    pub volume_mm3: f64,
    /// Lowest and highest corner of the axis-aligned box around the centres of its voxels, mm.
    pub bounds: (Point3, Point3),
}

/// Why a scan is no label map.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoLabels {
    /// A value that no label has.
    #[error("the scan holds {0}, a label is a whole number; reconstruct it by a threshold")]
    NotWhole(f64),
    /// More values than labels.
    #[error("the scan has more than {MAX_LABELS} distinct values; reconstruct it by a threshold")]
    TooMany,
}

/// All labels of a scan in ascending order, without the background 0.
pub fn labels(scan: &Scan) -> Result<Vec<Label>, NoLabels> {
    scan.voxels.visit(Tally(&scan.lattice))
}

struct Tally<'a>(&'a Lattice);

impl Visit for Tally<'_> {
    type Output = Result<Vec<Label>, NoLabels>;

    fn visit<T: Value>(self, values: &[T]) -> Self::Output {
        let lattice = self.0;
        let [columns, rows, _] = lattice.size();
        let mut found: BTreeMap<i64, Label> = BTreeMap::new();
        for (line, row) in values.chunks_exact(columns).enumerate() {
            let mut first = 0;
            for run in row.chunk_by(|a, b| a == b) {
                let end = first + run.len();
                let value = whole(run[0])?;
                if value != 0 {
                    let at = |column: usize| {
                        let cell = [column, line % rows, line / rows].map(|n| n as f64);
                        lattice.point(Vector3::from(cell))
                    };
                    let (a, b) = (at(first), at(end - 1));
                    let label = found.entry(value).or_insert_with(|| Label {
                        value,
                        voxels: 0,
                        volume_mm3: 0.0,
                        bounds: (a, a),
                    });
                    label.voxels += run.len();
                    let (low, high) = label.bounds;
                    label.bounds = (low.inf(&a).inf(&b), high.sup(&a).sup(&b));
                    if found.len() > MAX_LABELS {
                        return Err(NoLabels::TooMany);
                    }
                }
                first = end;
            }
        }
        let mut labels: Vec<Label> = found.into_values().collect();
        for label in &mut labels {
            label.volume_mm3 = label.voxels as f64 * lattice.voxel_mm3();
        }
        Ok(labels)
    }
}

fn whole<T: Value>(value: T) -> Result<i64, NoLabels> {
    let number: f64 = value.into();
    // Beyond 2^53 a float no longer tells neighbouring whole numbers apart.
    if number.fract() != 0.0 || number.abs() > 9e15 {
        return Err(NoLabels::NotWhole(number));
    }
    Ok(number as i64)
}
