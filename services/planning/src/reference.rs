//! The reference contour: the new free edge from start to goal, outboard of the lesion.
//!
//! Along the crescent the contour stays as near to the free edge as its ends and the lesion let it
//! and changes depth by smooth ramps, since a rim must not change its width suddenly. It is a cubic
//! B-spline by least squares through the middle of the tissue.

mod profile;

use arthro_geometry::Point3;

use crate::band::Band;
use crate::contour::Spline;
use crate::crescent::Crescent;
use crate::error::Error;
use crate::lesion::Lesion;
use crate::voxels::Voxels;

use profile::{Profile, Ramp, Station};

pub use profile::LESION_MARGIN_MM;

/// Contour between two control points, mm.
const CONTROL_SPACING_MM: f64 = 3.0;
/// Heights are averaged over so much contour to each side, mm.
const HEIGHT_WINDOW_MM: f64 = 3.0;
/// Within this way the contour comes to the height of a given end, mm.
const HEIGHT_RAMP_MM: f64 = 8.0;
/// How far beside the tissue its height is still looked for, mm.
const HEIGHT_REACH_MM: f64 = 2.0;
/// Least distance from start to goal, mm.
const MIN_CHORD_MM: f64 = 3.0;
/// Distance between the points at which the region inboard is tabulated, mm.
const BAND_SPACING_MM: f64 = 0.2;
/// Rounds of lifting the fitted spline out of the lesion's margin.
const MAX_ROUNDS: usize = 8;

/// What the contour has to do.
#[derive(Clone, Copy, Debug)]
pub struct Ends {
    /// First point in the axes of the crescent, mm.
    pub start: Point3,
    /// Last point, mm.
    pub goal: Point3,
    /// Depth up to which a point counts as lying on the free edge, mm.
    pub tolerance_mm: f64,
    /// Rim that must be left wherever the lesion does not demand more, mm.
    pub rim_min_mm: f64,
}

/// The new free edge and what lies inboard of it.
#[derive(Clone, Debug)]
pub struct Reference {
    /// The contour in the axes of the crescent.
    pub spline: Spline,
    /// The region inboard of it.
    pub band: Band,
}

impl Reference {
    /// Draws the contour.
    pub fn draw(
        ends: &Ends,
        lesion: Option<&Lesion>,
        crescent: &Crescent,
        voxels: &Voxels,
    ) -> Result<Self, Error> {
        let chord_mm = (ends.goal - ends.start).norm();
        if chord_mm < MIN_CHORD_MM {
            return Err(Error::invalid(
                "options.goal",
                format!("is {chord_mm:.2} mm from the start; must be at least {MIN_CHORD_MM} mm"),
            ));
        }
        let mut profile = Profile::between(ends, crescent)?;
        if let Some(lesion) = lesion {
            profile.clear(lesion, crescent)?;
        }
        profile.check_rim(ends, crescent)?;
        let mut reference = Self::fit(ends, &profile, crescent, voxels)?;
        for _ in 0..MAX_ROUNDS {
            if !profile.lift(&reference.band) {
                break;
            }
            reference = Self::fit(ends, &profile, crescent, voxels)?;
        }
        Ok(reference)
    }

    fn fit(
        ends: &Ends,
        profile: &Profile,
        crescent: &Crescent,
        voxels: &Voxels,
    ) -> Result<Self, Error> {
        let depths = profile.depths();
        let stations = profile.stations();
        let flat: Vec<Point3> = stations
            .iter()
            .zip(depths)
            .map(|(station, depth_mm)| station.at_depth(depth_mm))
            .collect();
        let mut points = flat.clone();
        for (point, height_mm) in points
            .iter_mut()
            .zip(heights(ends, stations, &flat, voxels))
        {
            point.z = height_mm;
        }
        let last = points.len() - 1;
        (points[0], points[last]) = (ends.start, ends.goal);
        let chords = points.windows(2).map(|pair| (pair[1] - pair[0]).norm());
        let control_points = (chords.sum::<f64>() / CONTROL_SPACING_MM).ceil() as usize + 3;
        let spline = Spline::fit(&points, control_points.clamp(4, last))?;
        let band = Band::inboard_of(&spline.points_every(BAND_SPACING_MM), crescent);
        Ok(Self { spline, band })
    }
}

/// Height of the contour at each station: the middle of the tissue without the steps of its voxels,
/// and near the ends drawn to the height that is given there.
fn heights(ends: &Ends, stations: &[Station], flat: &[Point3], voxels: &Voxels) -> Vec<f64> {
    let mut middle_mm = ends.start.z;
    let stepped: Vec<f64> = flat
        .iter()
        .map(|at| {
            let found = voxels.middle_mm(at.x, at.y, HEIGHT_REACH_MM);
            middle_mm = found.unwrap_or(middle_mm);
            middle_mm
        })
        .collect();
    let smooth: Vec<f64> = stations
        .iter()
        .map(|station| {
            let near = |other: &Station| (other.way_mm - station.way_mm).abs() <= HEIGHT_WINDOW_MM;
            let window = stations.iter().zip(&stepped);
            let (sum, count) = window
                .filter(|(other, _)| near(other))
                .fold((0.0, 0.0), |(sum, count), (_, z)| (sum + z, count + 1.0));
            sum / count
        })
        .collect();
    let last = stations.len() - 1;
    let whole_mm = stations[last].way_mm;
    let length_mm = HEIGHT_RAMP_MM.min(whole_mm);
    let to_start = Ramp::new(ends.start.z - smooth[0], length_mm);
    let to_goal = Ramp::new(ends.goal.z - smooth[last], length_mm);
    let drawn = stations.iter().zip(&smooth).map(|(station, z)| {
        z + to_start.height_mm(station.way_mm) + to_goal.height_mm(whole_mm - station.way_mm)
    });
    drawn.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan;
    use arthro_geometry::phantom::{self, RadialTear};

    struct World {
        crescent: Crescent,
        voxels: Voxels,
        lesion: Lesion,
    }

    impl World {
        fn torn_phantom() -> Self {
            let mesh = phantom::mesh();
            let (crescent, voxels) =
                plan::model(&mesh, &phantom::PORTAL_ANTEROLATERAL, 0.5, 1.0).unwrap();
            let shape = phantom::Phantom::default();
            let is_torn = |center: &Point3| {
                shape.is_torn(&(crescent.ct_from_meniscal * *center), &RadialTear::BODY)
            };
            let marks = voxels.centers().iter().map(is_torn).collect();
            let lesion = Lesion::of_voxels(marks, &voxels);
            Self {
                crescent,
                voxels,
                lesion,
            }
        }

        fn ends(&self, start: Point3, goal: Point3) -> Ends {
            let meniscal_from_ct = self.crescent.ct_from_meniscal.inverse();
            Ends {
                start: meniscal_from_ct * start,
                goal: meniscal_from_ct * goal,
                tolerance_mm: 1.0,
                rim_min_mm: 3.0,
            }
        }

        fn papers_reference(&self) -> Reference {
            let ends = self.ends(phantom::START, phantom::GOAL);
            Reference::draw(&ends, Some(&self.lesion), &self.crescent, &self.voxels).unwrap()
        }
    }

    #[test]
    fn the_contour_leads_from_start_to_goal_outboard_of_the_lesion() {
        let world = World::torn_phantom();
        let ends = world.ends(phantom::START, phantom::GOAL);
        let reference = world.papers_reference();
        assert!((reference.spline.point(0.0) - ends.start).norm() < 1e-9);
        assert!((reference.spline.point(1.0) - ends.goal).norm() < 1e-9);
        let points = reference.spline.points_every(0.1);
        for damaged in &world.lesion.points {
            assert!(reference.band.contains(damaged, &world.crescent));
            let flat = |point: &Point3| (point.xy() - damaged.xy()).norm();
            let nearest_mm = points.iter().map(flat).fold(f64::INFINITY, f64::min);
            assert!(nearest_mm > LESION_MARGIN_MM, "{nearest_mm} mm");
        }
    }

    #[test]
    fn the_contour_is_smooth() {
        let reference = World::torn_phantom().papers_reference();
        for at in reference.spline.parameters_every(0.5) {
            let curvature_per_mm = reference.spline.curvature_per_mm(at);
            assert!(curvature_per_mm < 0.5, "{curvature_per_mm} /mm at {at}");
        }
    }

    #[test]
    fn a_lesion_beyond_start_and_goal_is_refused() {
        let world = World::torn_phantom();
        let ends = world.ends(phantom::START, Point3::new(54.0, 57.0, 57.0));
        let refusal = Reference::draw(&ends, Some(&world.lesion), &world.crescent, &world.voxels);
        assert!(matches!(refusal, Err(Error::LesionBeyondPath { .. })));
    }

    #[test]
    fn an_end_too_near_the_rim_is_refused_with_the_rim_it_leaves() {
        let world = World::torn_phantom();
        let ends = Ends {
            rim_min_mm: 4.0,
            ..world.ends(phantom::START, phantom::GOAL)
        };
        match Reference::draw(&ends, None, &world.crescent, &world.voxels) {
            Err(Error::RimBelowLimit { rim_mm, at, .. }) => {
                assert!((3.0..4.0).contains(&rim_mm), "{rim_mm} mm");
                assert!((at - phantom::GOAL).norm() < 2.0, "{at}");
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn start_and_goal_at_the_same_place_are_refused() {
        let world = World::torn_phantom();
        let ends = world.ends(phantom::START, phantom::START);
        let refusal = Reference::draw(&ends, None, &world.crescent, &world.voxels);
        assert!(matches!(refusal, Err(Error::Invalid { .. })));
    }
}
