//! Menisci with a contour, and the paper's bites on them.

use arthro_geometry::phantom::{self, Coordinates, Phantom, RadialTear};
use arthro_geometry::{Mesh, Point3, Vector3};
use arthro_planning::band::Band;
use arthro_planning::crescent::Crescent;
use arthro_planning::evaluation::time::Timing;
use arthro_planning::evaluation::{Evaluation, Task};
use arthro_planning::jaw::{Bite, Jaw};
use arthro_planning::lesion::Lesion;
use arthro_planning::tissue::THROAT_LIMIT;
use arthro_planning::voxels::Voxels;

use crate::world::{self, LESION_SPACING_MM};

/// The paper's bites on a contour.
const PAPERS_BITES: usize = 39;

/// A meniscus with a contour, and all that its evaluation needs.
pub struct Case {
    pub crescent: Crescent,
    voxels: Voxels,
    lesion: Lesion,
    band: Band,
    portal: Point3,
    /// In the axes of the crescent.
    pub contour: Vec<Point3>,
}

impl Case {
    /// A model and a contour in ct; without damaged points the region is the lesion.
    pub fn new(
        model: &Mesh,
        contour: &[Point3],
        lesion: &[Point3],
        portal: &Point3,
        voxel_mm: f64,
    ) -> Self {
        let crescent = Crescent::of(model, portal).unwrap();
        let voxels = Voxels::of(model, &crescent, voxel_mm, 1.0).unwrap();
        let meniscal_from_ct = crescent.ct_from_meniscal.inverse();
        let contour: Vec<Point3> = contour
            .iter()
            .map(|point| meniscal_from_ct * *point)
            .collect();
        let band = Band::inboard_of(&contour, &crescent);
        let lesion = match lesion {
            [] => Lesion::inboard_of(&band, &crescent, &voxels),
            points => Lesion::of(points, LESION_SPACING_MM, &crescent, &voxels, 1.0).unwrap(),
        };
        Self {
            portal: meniscal_from_ct * *portal,
            crescent,
            voxels,
            lesion,
            band,
            contour,
        }
    }

    /// A contour around the tear in the phantom's body: 28 deg to each side, the power of a cosine.
    pub fn tear(voxel_mm: f64) -> Self {
        let mesh = phantom::mesh();
        let is_torn = |point: &Point3| Phantom::default().is_torn(point, &RadialTear::BODY);
        let lesion = world::lesion(&mesh, is_torn);
        let portal = phantom::PORTAL_ANTEROLATERAL;
        Self::new(&mesh, &tear_contour(), &lesion, &portal, voxel_mm)
    }

    /// The width fraction of the paper's start blended into that of its goal.
    pub fn band(voxel_mm: f64) -> Self {
        let portal = phantom::PORTAL_ANTEROLATERAL;
        Self::new(&phantom::mesh(), &band_contour(), &[], &portal, voxel_mm)
    }

    pub fn evaluate(&self, bites: &[Bite]) -> Evaluation {
        let task = Task {
            crescent: &self.crescent,
            voxels: &self.voxels,
            lesion: &self.lesion,
            band: Some(&self.band),
            jaw: Jaw::new(3.0, 4.5),
            portals: &[self.portal],
            timing: Timing::default(),
            throat_limit: THROAT_LIMIT,
        };
        task.evaluate(bites)
    }

    /// A bite in the meniscal plane: its long axis points from the portal seen from above.
    fn flat_bite(&self, center: Point3) -> Bite {
        let mut axis = center - self.portal;
        axis.z = 0.0;
        Bite::of_axis(center, &axis, &Vector3::z()).unwrap()
    }

    /// Bites centred at equal distances along a polyline.
    fn bites_along(&self, polyline: &[Point3], count: usize) -> Vec<Bite> {
        let points = spaced(polyline, count);
        points
            .into_iter()
            .map(|point| self.flat_bite(point))
            .collect()
    }

    pub fn papers_bites(&self) -> Vec<Bite> {
        self.bites_along(&self.contour, PAPERS_BITES)
    }
}

fn on_phantom(phi_rad: f64, width_fraction: f64) -> Point3 {
    Phantom::default().point(Coordinates {
        phi_rad,
        width_fraction,
        height_fraction: 0.5,
    })
}

/// Angle from the tear and depth as a share of the width, from one end of the blend to the other.
pub fn tear_blend() -> impl Iterator<Item = (f64, f64)> {
    const REACH_DEG: i32 = 28;
    /// As deep as the tear.
    const DEPTH_FRACTION: f64 = 0.42;
    /// Makes the flanks as steep as the reference's region is large.
    const STEEPNESS: f64 = 1.5;
    (-REACH_DEG..=REACH_DEG).map(|deg| {
        let share = f64::from(deg) / f64::from(REACH_DEG);
        let blend: f64 = 0.5 * (1.0 + (std::f64::consts::PI * share).cos());
        (
            f64::from(deg).to_radians(),
            DEPTH_FRACTION * blend.powf(STEEPNESS),
        )
    })
}

fn tear_contour() -> Vec<Point3> {
    tear_blend()
        .map(|(phi_rad, width_fraction)| on_phantom(phi_rad, width_fraction))
        .collect()
}

pub fn band_contour() -> Vec<Point3> {
    let shape = Phantom::default();
    let (start, goal) = (
        shape.coordinates(&phantom::START),
        shape.coordinates(&phantom::GOAL),
    );
    (0..=200)
        .map(|step| {
            let share = f64::from(step) / 200.0;
            let blend = |from: f64, to: f64| from + share * (to - from);
            on_phantom(
                blend(start.phi_rad, goal.phi_rad),
                blend(start.width_fraction, goal.width_fraction),
            )
        })
        .collect()
}

/// `count` points at equal distances along a polyline, both ends included.
fn spaced(polyline: &[Point3], count: usize) -> Vec<Point3> {
    let pieces = || polyline.windows(2).map(|pair| (pair[1] - pair[0]).norm());
    let length_mm: f64 = pieces().sum();
    (0..count)
        .map(|index| {
            let mut left_mm = length_mm * index as f64 / (count - 1) as f64;
            for (pair, piece_mm) in polyline.windows(2).zip(pieces()) {
                if left_mm <= piece_mm {
                    return pair[0] + (pair[1] - pair[0]) * (left_mm / piece_mm);
                }
                left_mm -= piece_mm;
            }
            polyline[polyline.len() - 1]
        })
        .collect()
}
