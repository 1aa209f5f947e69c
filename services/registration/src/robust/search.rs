//! The global search: a patch of the view laid on every part of the model, turned about its normal, at every scale;
//! what fits best is drawn to the surface and settled on it.
//!
//! No feature is matched, since a meniscus has none. A hypothesis costs a hundred look-ups, so all of them are tried.

use arthro_geometry::{Point3, Rotation, Similarity, Vector3};
use nalgebra::Unit;
use rayon::prelude::*;

use super::kernel::{Kernel, Laid};
use crate::budget::Budget;
use crate::cells::Cells;
use crate::error::Error;
use crate::moments::Moments;
use crate::neighbours::Neighbours;
use crate::problem::{Candidate, Pose, Problem};
use crate::sampling;

/// How much is tried at each scale.
#[derive(Clone, Copy, Debug)]
pub(super) struct Effort {
    /// Patches of the view.
    pub(super) patches: usize,
    /// Places on the model that each is laid on.
    pub(super) places: usize,
    /// Turns about the normal.
    pub(super) turns: usize,
    /// Hypotheses that are drawn to the surface.
    pub(super) drawn: usize,
    /// Those of them that are settled on it.
    pub(super) settled: usize,
}

/// Radius of a patch of the view that gives a normal, units.
const PATCH_RADIUS_UNITS: f64 = 3.0;
/// Never less than this many spacings of the points.
const PATCH_RADIUS_SPACINGS: f64 = 2.2;
/// Patches are this far apart, as a share of the view's extent.
const PATCHES_APART: f64 = 0.15;
/// Fewer points than this give no normal.
const LEAST_PATCH_POINTS: f64 = 6.0;

/// A place in the view with its normal.
type Patch = (Point3, Vector3);

/// Poses of one scale that fit the view's sparse points, settled on the model, with their scores.
pub(super) fn at_scale(
    problem: &Problem,
    kernel: &Kernel<'_>,
    scale: f64,
    effort: &Effort,
    budget: &Budget,
) -> Result<Vec<Candidate>, Error> {
    let mut laid = laid_everywhere(problem, kernel, scale, effort, budget);
    budget.check()?;
    keep_best(&mut laid, effort.drawn);
    let mut drawn: Vec<(f32, Laid)> = laid
        .into_par_iter()
        .with_min_len(8)
        .map(|(_, pose)| {
            let pose = kernel.drawn(pose);
            (kernel.mean_distance(&pose), pose)
        })
        .collect();
    budget.check()?;
    keep_best(&mut drawn, effort.settled);
    let settled = drawn
        .into_par_iter()
        .with_min_len(4)
        .map(|(_, pose)| {
            let settled = kernel.settled(pose, problem.allowed);
            Candidate {
                coarse: pose.similarity(),
                pose: settled.similarity(),
                score: kernel.misfit_view_mm(&settled),
            }
        })
        .collect();
    budget.check()?;
    Ok(settled)
}

/// Every patch on every place in every turn, with its distance.
fn laid_everywhere(
    problem: &Problem,
    kernel: &Kernel<'_>,
    scale: f64,
    effort: &Effort,
    budget: &Budget,
) -> Vec<(f32, Laid)> {
    let (model, view) = (&problem.model, &problem.view);
    let patches = patches(problem, scale, effort.patches);
    spread_indices(&model.points, effort.places)
        .into_par_iter()
        .with_min_len(4)
        .flat_map_iter(|place| {
            let sides: &[f64] = match model.is_outward[place] && view.viewpoint.is_some() {
                true => &[1.0],
                // Nobody knows which side the camera saw.
                false => &[1.0, -1.0],
            };
            let mut laid = Vec::with_capacity(patches.len() * sides.len() * effort.turns);
            if budget.is_cancelled() {
                return laid;
            }
            for (patch, side) in patches
                .iter()
                .flat_map(|patch| sides.iter().map(move |side| (patch, side)))
            {
                let onto = (model.points[place], model.normals[place] * *side);
                for turn in 0..effort.turns {
                    let angle_rad = std::f64::consts::TAU * turn as f64 / effort.turns as f64;
                    let pose = Laid::from(&laid_on(patch, &onto, angle_rad, 1.0 / scale));
                    laid.push((kernel.mean_distance(&pose), pose));
                }
            }
            laid
        })
        .collect()
}

fn keep_best(scored: &mut Vec<(f32, Laid)>, count: usize) {
    if scored.len() > count {
        scored.select_nth_unstable_by(count, |a, b| a.0.total_cmp(&b.0));
        scored.truncate(count);
    }
    scored.sort_by(|a, b| a.0.total_cmp(&b.0));
}

/// The pose that lays `patch` on the place `onto`, normal on normal, turned by `angle_rad` about it.
fn laid_on(patch: &Patch, onto: &Patch, angle_rad: f64, scale: f64) -> Pose {
    let tilt = Rotation::rotation_between(&patch.1, &onto.1).unwrap_or_else(|| {
        let mut aside = Vector3::zeros();
        aside[patch.1.iamin()] = 1.0;
        Rotation::from_axis_angle(
            &Unit::new_normalize(patch.1.cross(&aside)),
            std::f64::consts::PI,
        )
    });
    let rotation = Rotation::from_axis_angle(&Unit::new_normalize(onto.1), angle_rad) * tilt;
    Similarity::new(
        scale,
        rotation,
        onto.0.coords - rotation * patch.0.coords * scale,
    )
}

/// Smooth places of the view, far from its border and from each other, with normals towards the camera.
fn patches(problem: &Problem, scale: f64, count: usize) -> Vec<Patch> {
    let view = &problem.view;
    let radius_mm = (PATCH_RADIUS_UNITS * problem.model.unit_mm * scale)
        .max(PATCH_RADIUS_SPACINGS * view.medium.spacing_mm);
    let cells = Cells::new(&view.medium.points, radius_mm);
    let mut candidates: Vec<(f64, Patch)> = view
        .medium
        .points
        .iter()
        .filter_map(|at| {
            let (flaw, patch) = patch_at(problem, &cells, at, radius_mm)?;
            let off_middle = patch.0.coords.norm() / view.extent_mm.max(f64::MIN_POSITIVE);
            Some((flaw + 0.5 * off_middle, patch))
        })
        .collect();
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut chosen: Vec<Patch> = Vec::new();
    for (_, patch) in candidates {
        if chosen.len() == count {
            break;
        }
        let apart_mm = PATCHES_APART * view.extent_mm;
        if chosen
            .iter()
            .all(|other| (other.0 - patch.0).norm() > apart_mm)
        {
            chosen.push(patch);
        }
    }
    chosen
}

/// The plane through the view around `at`, and how little it deserves to be one: at the border a patch is lopsided,
/// over an edge it is thick.
fn patch_at(problem: &Problem, cells: &Cells, at: &Point3, radius_mm: f64) -> Option<(f64, Patch)> {
    let moments = Moments::around(at, &problem.view.medium.points, cells, radius_mm)?;
    if moments.count < LEAST_PATCH_POINTS {
        return None;
    }
    let (plane, mean) = (moments.plane(), moments.mean);
    let mut normal = plane.normal;
    if let Some(eye) = problem.view.viewpoint
        && normal.dot(&(eye - at)) < 0.0
    {
        normal = -normal;
    }
    let flaw = mean.norm().hypot(2.0 * plane.deviation_mm) / radius_mm;
    Some((flaw, (at + mean, normal)))
}

/// Indices of about `count` points spread evenly.
fn spread_indices(points: &[Point3], count: usize) -> Vec<usize> {
    let tree = Neighbours::new(points);
    let mut indices: Vec<usize> = sampling::spread(points, count)
        .iter()
        .filter_map(|point| Some(tree.nearest(point)?.index))
        .collect();
    indices.sort_unstable();
    indices.dedup();
    indices
}
