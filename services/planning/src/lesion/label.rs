//! A lesion that is a label of a segmentation.

use arthro_geometry::scan::{Scan, Value, Visit, label_points};
use arthro_geometry::{Point3, Vector3};

use super::{Lesion, on_tissue};
use crate::crescent::Crescent;
use crate::error::Error;
use crate::voxels::Voxels;

impl Lesion {
    /// The tissue whose nearest voxel of the segmentation has a label.
    ///
    /// # Errors
    /// If no voxel or too many have the label, or too much of it lies beside the model.
    pub fn of_label(
        segmentation: &Scan,
        label: i64,
        crescent: &Crescent,
        voxels: &Voxels,
        tolerance_mm: f64,
    ) -> Result<Self, Error> {
        let centers = label_points(segmentation, label).map_err(|problem| {
            Error::invalid("lesion.label", format!("is not usable: {problem}"))
        })?;
        on_tissue(&centers, crescent, voxels, tolerance_mm)?;
        let places = voxels.centers().iter();
        let places: Vec<Point3> = places
            .map(|center| crescent.ct_from_meniscal * *center)
            .collect();
        let marks = segmentation.voxels().visit(Marking {
            segmentation,
            label,
            places: &places,
        });
        Ok(Self::of_voxels(marks, voxels))
    }
}

/// Tells for places in ct whether they have the label.
struct Marking<'a> {
    segmentation: &'a Scan,
    label: i64,
    places: &'a [Point3],
}

impl Visit for Marking<'_> {
    type Output = Vec<bool>;

    fn visit<T: Value>(self, values: &[T]) -> Vec<bool> {
        let lattice = self.segmentation.lattice();
        let [columns, rows, slices] = lattice.size();
        let highest = Vector3::new(columns as f64, rows as f64, slices as f64);
        let label = T::exactly(self.label as f64);
        let has_label = |place: &Point3| {
            let cell = lattice.index(place).map(f64::round);
            let inside = cell
                .iter()
                .zip(highest.iter())
                .all(|(at, end)| (0.0..*end).contains(at));
            if !inside {
                return false;
            }
            let [i, j, k] = [cell.x, cell.y, cell.z].map(|at| at as usize);
            values.get((k * rows + j) * columns + i).copied() == label
        };
        self.places.iter().map(has_label).collect()
    }
}
