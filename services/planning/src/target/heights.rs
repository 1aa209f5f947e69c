//! The height at which a contour runs: the middle of the tissue without the steps of its voxels.

use std::f64::consts::PI;

use arthro_geometry::Point3;

use crate::voxels::Voxels;

/// Heights are averaged over so much contour to each side, mm.
const WINDOW_MM: f64 = 3.0;
/// Within this way the contour comes to the height of a given end, mm.
const RAMP_MM: f64 = 8.0;
/// How far beside the tissue its height is still looked for, mm.
const REACH_MM: f64 = 2.0;

/// Lifts points of the plane to the middle of the tissue; near the ends they are drawn to the heights
/// that are given there, mm.
pub(super) fn lift(points: &mut [Point3], given_mm: Option<[f64; 2]>, voxels: &Voxels) {
    let ways_mm = ways(points);
    let mut found = points
        .iter()
        .map(|at| voxels.middle_mm(at.x, at.y, REACH_MM));
    let first_mm = found.clone().flatten().next().unwrap_or(0.0);
    let mut middle_mm = given_mm.map_or(first_mm, |[start_mm, _]| start_mm);
    let stepped: Vec<f64> = points
        .iter()
        .map(|_| {
            middle_mm = found.next().flatten().unwrap_or(middle_mm);
            middle_mm
        })
        .collect();
    let smooth: Vec<f64> = ways_mm
        .iter()
        .map(|way_mm| {
            let near = |other: &f64| (other - way_mm).abs() <= WINDOW_MM;
            let window = ways_mm.iter().zip(&stepped);
            let (sum, count) = window
                .filter(|(other, _)| near(other))
                .fold((0.0, 0.0), |(sum, count), (_, z)| (sum + z, count + 1.0));
            sum / count
        })
        .collect();
    let last = points.len() - 1;
    let [start_mm, goal_mm] = given_mm.unwrap_or([smooth[0], smooth[last]]);
    let ramp_mm = RAMP_MM.min(ways_mm[last]);
    for (step, point) in points.iter_mut().enumerate() {
        let to_start = (start_mm - smooth[0]) * fade(ways_mm[step] / ramp_mm);
        let to_goal = (goal_mm - smooth[last]) * fade((ways_mm[last] - ways_mm[step]) / ramp_mm);
        point.z = smooth[step] + to_start + to_goal;
    }
}

/// Way from the first point to each, mm.
fn ways(points: &[Point3]) -> Vec<f64> {
    let mut sum_mm = 0.0;
    let steps = points.windows(2).map(|pair| {
        sum_mm += (pair[1] - pair[0]).xy().norm();
        sum_mm
    });
    std::iter::once(0.0)
        .chain(steps.collect::<Vec<_>>())
        .collect()
}

/// A cosine from 1 at 0 to 0 at 1.
fn fade(share: f64) -> f64 {
    0.5 * (1.0 + (PI * share.min(1.0)).cos())
}
