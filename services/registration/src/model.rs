//! The preoperative surface made ready for matching: evenly spread samples, each with the quadric that fits its
//! neighbourhood, and lattices that tell the nearest sample of any point at once.
//!
//! A cloud out of a segmented volume carries the stairs of its voxels. The fitted quadrics level them:
//! a height over a quadric tells the surface, where the nearest point tells the stair.

use arthro_geometry::{Cloud, Point3, Vector3};
use nalgebra::Matrix3;

use crate::cells::Cells;
use crate::lattice::Lattice;
use crate::sampling;

mod orient;
mod quadric;

/// Most samples of the surface.
const SAMPLES: usize = 4000;
/// Root mean square radius of the surface that one unit of length stands for: a human meniscus has units of about a millimetre.
const RADIUS_UNITS: f64 = 16.0;
/// Radius of the neighbourhood that a quadric is fitted to, units; never less than some spacings of the samples.
const QUADRIC_RADIUS_UNITS: f64 = 2.0;
const QUADRIC_RADIUS_SPACINGS: f64 = 2.0;
/// Share of that radius over which the first, plain normals are fitted.
const NORMAL_RADIUS: f64 = 0.75;
/// Edge of a cell of the wide lattice and its margin around the samples, units.
const WIDE_EDGE_UNITS: f64 = 1.0;
const WIDE_MARGIN_UNITS: f64 = 9.0;
/// The same of the close lattice.
const CLOSE_EDGE_UNITS: f64 = 0.5;
const CLOSE_MARGIN_UNITS: f64 = 1.5;

/// A sampled surface, mm, about its own centre.
#[derive(Clone, Debug)]
pub struct Model {
    /// Middle of the samples, in the frame of the cloud they came from.
    pub center: Point3,
    /// Positions about `center`.
    pub points: Vec<Point3>,
    /// Unit normals.
    pub normals: Vec<Vector3>,
    /// Of each normal whether it surely points outwards; elsewhere the body is too thin, or open, to tell.
    pub is_outward: Vec<bool>,
    /// How the surface bends away from the plane of each sample: height = n.d - d.K d / 2.
    pub bends: Vec<Matrix3<f64>>,
    /// Median distance between neighbouring samples.
    pub spacing_mm: f64,
    /// The length that a distance is compared with, so that nothing depends on the size of the model: about 1 mm for a human meniscus.
    pub unit_mm: f64,
    wide: Lattice,
    close: Lattice,
}

/// What is known of the surface near a point.
#[derive(Clone, Copy, Debug)]
pub struct Foot {
    /// The sample.
    pub index: usize,
    /// Height over the fitted surface, mm; positive on the side of the normal.
    pub height_mm: f64,
    /// Normal of the fitted surface below the point.
    pub normal: Vector3,
    /// Squared distance to the surface, mm2: the height, and what the point lies beyond the sample's surroundings.
    pub distance2: f64,
}

impl Model {
    /// Samples `cloud`, in mm. Not for fewer than a handful of points.
    pub fn new(cloud: &Cloud) -> Self {
        let mut points = sampling::spread(&cloud.points, SAMPLES);
        let center = middle(&points);
        for point in &mut points {
            *point -= center.coords;
        }
        let radius_mm = root_mean_square(points.iter().map(|p| p.coords.norm()));
        let unit_mm = radius_mm / RADIUS_UNITS;
        let spacing_mm = sampling::spacing_mm(&points);
        let radius_mm = (QUADRIC_RADIUS_UNITS * unit_mm).max(QUADRIC_RADIUS_SPACINGS * spacing_mm);
        let cells = Cells::new(&points, radius_mm);
        let mut normals = sampling::fitted_normals(&points, &cells, NORMAL_RADIUS * radius_mm);
        let is_outward = match given_normals(cloud, &points, center, spacing_mm) {
            Some(given) => orient::like(&points, &mut normals, &given),
            None => {
                let lattice = Lattice::new(
                    &points,
                    WIDE_EDGE_UNITS * unit_mm,
                    WIDE_EDGE_UNITS * unit_mm,
                );
                let samples = orient::Samples {
                    points: &points,
                    cells: &cells,
                    lattice: &lattice,
                    spacing_mm,
                    unit_mm,
                };
                samples.turn_outwards(&mut normals)
            }
        };
        let fitted = quadric::fit_all(&points, &normals, &cells, radius_mm, &is_outward);
        // What a fit takes away from bends is put back by fitting what it left: twicing (Tukey 1977).
        let sharpened: Vec<Point3> = points
            .iter()
            .zip(&normals)
            .zip(&fitted)
            .map(|((point, normal), quadric)| point - normal * quadric.offset_mm)
            .collect();
        let fitted = quadric::fit_all(&sharpened, &normals, &cells, radius_mm, &is_outward);
        let mut model = Self {
            center,
            wide: Lattice::new(&[], 1.0, 0.0),
            close: Lattice::new(&[], 1.0, 0.0),
            points: Vec::with_capacity(points.len()),
            normals: Vec::with_capacity(points.len()),
            bends: Vec::with_capacity(points.len()),
            is_outward,
            spacing_mm,
            unit_mm,
        };
        for quadric in fitted {
            model.points.push(quadric.point);
            model.normals.push(quadric.normal);
            model.bends.push(quadric.bend);
        }
        let lattice =
            |edge: f64, margin: f64| Lattice::new(&model.points, edge * unit_mm, margin * unit_mm);
        (model.wide, model.close) = rayon::join(
            || lattice(WIDE_EDGE_UNITS, WIDE_MARGIN_UNITS),
            || lattice(CLOSE_EDGE_UNITS, CLOSE_MARGIN_UNITS),
        );
        model
    }

    /// Index of a sample near `query`, looked up in the lattice that reaches far.
    #[inline]
    pub fn roughly_nearest(&self, query: [f32; 3]) -> usize {
        self.wide.nearest(query)
    }

    /// Distance from `query` to a sample near it: never less than to the nearest one, and hardly more.
    pub fn rough_distance_mm(&self, query: &Point3) -> f64 {
        let near = self.roughly_nearest(query.cast::<f32>().coords.into());
        (query - self.points[near]).norm()
    }

    /// Where `query` stands over the surface.
    #[inline]
    pub fn foot(&self, query: &Point3) -> Foot {
        let near = query.cast::<f32>().coords.into();
        let index = if self.close.holds(near) {
            self.close.nearest(near)
        } else {
            self.wide.nearest(near)
        };
        let offset = query - self.points[index];
        let bent = self.bends[index] * offset;
        let height_mm = self.normals[index].dot(&offset) - 0.5 * offset.dot(&bent);
        let sample_distance2 = offset.norm_squared();
        let sideways = (sample_distance2 - height_mm * height_mm).max(0.0).sqrt();
        let beyond = (sideways - self.spacing_mm).max(0.0);
        Foot {
            index,
            height_mm,
            normal: (self.normals[index] - bent).normalize(),
            distance2: height_mm * height_mm + beyond * beyond,
        }
    }
}

/// The cloud's own normals at the samples, if it has them.
fn given_normals(
    cloud: &Cloud,
    samples: &[Point3],
    center: Point3,
    spacing_mm: f64,
) -> Option<Vec<Vector3>> {
    if cloud.normals.len() != cloud.points.len() || cloud.points.is_empty() {
        return None;
    }
    let about: Vec<Point3> = cloud.points.iter().map(|p| p - center.coords).collect();
    let cells = Cells::new(&about, spacing_mm);
    let near = |sample: &Point3| {
        let mut sum = Vector3::zeros();
        cells.within(sample, spacing_mm, |index, _| sum += cloud.normals[index]);
        sum
    };
    Some(samples.iter().map(near).collect())
}

fn middle(points: &[Point3]) -> Point3 {
    Point3::from(points.iter().map(|p| p.coords).sum::<Vector3>() / points.len().max(1) as f64)
}

pub(crate) fn root_mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| {
        (sum + value * value, count + 1.0)
    });
    if count > 0.0 {
        (sum / count).sqrt()
    } else {
        0.0
    }
}
