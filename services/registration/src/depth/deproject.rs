//! A depth image as points: each with a normal towards the camera, and how far both may be off.

use arthro_geometry::nalgebra::Vector2;
use arthro_geometry::{Point3, Vector3};
use rayon::prelude::*;

use super::fusion::frames::Averaged;
use super::intrinsics::Roi;
use super::lens::Lens;
use super::noise::DepthNoise;
use crate::error::{Error, Violation};

mod flying;
mod normal;

/// A point of a surface as a depth camera saw it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenPoint {
    /// Where it is, mm.
    pub position: Point3,
    /// Unit normal of the surface, towards the camera; the line of sight where too little is seen around.
    pub normal: Vector3,
    /// Standard deviation of the position along the line of sight, mm.
    pub sigma_mm: f64,
    /// Root mean square angle by which the noise may turn the normal; [`UNKNOWN_NORMAL_RAD`] where the line of sight
    /// stands for it.
    pub normal_sigma_rad: f64,
    /// Which viewpoint saw it.
    pub view: u32,
    /// Which pixel of that viewpoint's image: row * width + column.
    pub pixel: u32,
}

/// What of an image becomes points.
#[derive(Clone, Copy, Debug)]
pub struct Selection<'a> {
    /// The pixels looked at.
    pub roi: Roi,
    /// One byte a pixel of the whole image, non-zero where it is looked at.
    pub mask: Option<&'a [u8]>,
    /// Nearest and farthest depth kept, mm.
    pub range_mm: [f64; 2],
    /// Drops pixels that hang in the air beside an edge: those with a step down on one side and a step up on the other
    /// that are both steeper than this against the image plane. `None` keeps them.
    pub steepest_rad: Option<f64>,
    /// Pixels to each side that a normal is fitted to.
    pub normal_reach_px: u32,
}

/// The points of an image, and what became of its other pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Deprojected {
    /// Row by row.
    pub points: Vec<SeenPoint>,
    /// The others.
    pub dropped: Dropped,
}

/// Pixels looked at that gave no point, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dropped {
    /// Not measured.
    pub without_depth: usize,
    /// Farther than 16 bits can say.
    pub saturated: usize,
    /// Out of the range of depths.
    pub out_of_range: usize,
    /// In the air beside an edge.
    pub flying: usize,
}

impl std::ops::AddAssign for Dropped {
    fn add_assign(&mut self, more: Self) {
        self.without_depth += more.without_depth;
        self.saturated += more.saturated;
        self.out_of_range += more.out_of_range;
        self.flying += more.flying;
    }
}

/// The uncertainty of a normal that is not known.
pub const UNKNOWN_NORMAL_RAD: f64 = std::f64::consts::FRAC_PI_2;
/// Noise that is still no difference, in standard deviations.
const SIGNIFICANT: f64 = 5.0;

/// Deprojects the `selection` of an image with the uncertainty of `noise`. `view` numbers the viewpoint.
///
/// # Errors
/// [`Error::Invalid`] if all that is measured is saturated, or a pixel has no ray.
pub fn deproject(
    lens: &Lens,
    image: &Averaged,
    noise: &DepthNoise,
    selection: &Selection<'_>,
    view: u32,
) -> Result<Deprojected, Error> {
    let mut dropped = Dropped::default();
    let mut patch = Patch::new(lens, image, noise, selection)?;
    patch.select(image, selection, &mut dropped)?;
    if let Some(steepest_rad) = selection.steepest_rad {
        dropped.flying = patch.drop_flying(steepest_rad.tan());
    }
    let points = (0..patch.height)
        .into_par_iter()
        .flat_map_iter(|row| {
            let patch = &patch;
            (0..patch.width).filter_map(move |column| patch.seen(column, row, selection, view))
        })
        .collect();
    Ok(Deprojected { points, dropped })
}

/// The region of interest: rays and depths, row by row.
struct Patch<'a> {
    lens: &'a Lens,
    roi: Roi,
    width: i64,
    height: i64,
    rays: Vec<Vector2<f64>>,
    /// 0 where there is none.
    depths_mm: Vec<f64>,
    sigmas_mm: Vec<f64>,
}

impl<'a> Patch<'a> {
    fn new(
        lens: &'a Lens,
        image: &Averaged,
        noise: &DepthNoise,
        selection: &Selection<'_>,
    ) -> Result<Self, Error> {
        let roi = selection.roi;
        let mut patch = Self {
            lens,
            roi,
            width: i64::from(roi.width_px),
            height: i64::from(roi.height_px),
            rays: Vec::new(),
            depths_mm: Vec::new(),
            sigmas_mm: Vec::new(),
        };
        let places = patch.width * patch.height;
        patch.rays = (0..places)
            .into_par_iter()
            .map(|place| {
                let [column, row] = patch.column_row(place);
                lens.ray([column as f64, row as f64])
                    .map(|ray| ray.xy())
                    .ok_or_else(|| {
                        Error::Invalid(vec![Violation::new(
                            "header.intrinsics.distortion",
                            format!("does not converge at pixel ({column}, {row})"),
                        )])
                    })
            })
            .collect::<Result<_, _>>()?;
        patch.depths_mm = vec![0.0; places as usize];
        patch.sigmas_mm = (0..places)
            .map(|place| patch.pixel(place))
            .map(|pixel| match image.frames[pixel] {
                0 => 0.0,
                frames => noise.sigma_mm(image.depth_mm[pixel], frames),
            })
            .collect();
        Ok(patch)
    }

    /// Takes over the depths that are selected.
    fn select(
        &mut self,
        image: &Averaged,
        selection: &Selection<'_>,
        dropped: &mut Dropped,
    ) -> Result<(), Error> {
        let [nearest_mm, farthest_mm] = selection.range_mm;
        let mut measured = 0;
        for place in 0..self.width * self.height {
            let pixel = self.pixel(place);
            if selection.mask.is_some_and(|mask| mask[pixel] == 0) {
                continue;
            }
            let depth_mm = image.depth_mm[pixel];
            if depth_mm == 0.0 {
                dropped.without_depth += 1;
            } else if depth_mm.is_infinite() {
                dropped.saturated += 1;
            } else {
                measured += 1;
                if (nearest_mm..=farthest_mm).contains(&depth_mm) {
                    self.depths_mm[place as usize] = depth_mm;
                } else {
                    dropped.out_of_range += 1;
                }
            }
        }
        if dropped.saturated > 0 && measured == 0 {
            return Err(Error::Invalid(vec![Violation::new(
                "depth",
                format!(
                    "is {} in all {} measured pixels, which is beyond 16 bits; a larger depth_unit_mm is needed",
                    u16::MAX,
                    dropped.saturated
                ),
            )]));
        }
        Ok(())
    }

    fn seen(
        &self,
        column: i64,
        row: i64,
        selection: &Selection<'_>,
        view: u32,
    ) -> Option<SeenPoint> {
        let depth_mm = self.depth_mm(column, row)?;
        let place = row * self.width + column;
        let ray = self.rays[place as usize].push(1.0);
        let reach = i64::from(selection.normal_reach_px);
        let (normal, normal_sigma_rad) = self
            .normal(column, row, depth_mm, reach)
            .unwrap_or_else(|| (-ray.normalize(), UNKNOWN_NORMAL_RAD));
        Some(SeenPoint {
            position: Point3::from(ray * depth_mm),
            normal,
            sigma_mm: self.sigmas_mm[place as usize] * ray.norm(),
            normal_sigma_rad,
            view,
            pixel: self.pixel(place) as u32,
        })
    }

    /// Depth at a place of the patch; `None` beyond it and where there is none.
    fn depth_mm(&self, column: i64, row: i64) -> Option<f64> {
        if !(0..self.width).contains(&column) || !(0..self.height).contains(&row) {
            return None;
        }
        let depth_mm = self.depths_mm[(row * self.width + column) as usize];
        (depth_mm > 0.0).then_some(depth_mm)
    }

    /// Column and row of the image.
    fn column_row(&self, place: i64) -> [i64; 2] {
        [
            i64::from(self.roi.column_px) + place % self.width,
            i64::from(self.roi.row_px) + place / self.width,
        ]
    }

    /// Index into the image.
    fn pixel(&self, place: i64) -> usize {
        let [column, row] = self.column_row(place);
        (row * i64::from(self.lens.intrinsics().width_px) + column) as usize
    }
}
