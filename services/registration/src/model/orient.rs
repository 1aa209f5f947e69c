//! Which side of a sampled surface is the outer one.
//!
//! A ray that goes inwards from a closed surface meets its other side soon; one that goes outwards meets nothing, or
//! something far away; and where the body is thinner than the samples are dense, the other side's samples lie a little
//! inwards. Each sample votes, neighbours on the same face agree, and where the body is too thin to tell, none is named.

use arthro_geometry::{Point3, Vector3};
use rayon::prelude::*;

use crate::cells::Cells;
use crate::lattice::Lattice;

/// How far neighbours are apart, spacings.
const NEIGHBOUR_SPACINGS: f64 = 1.8;
/// Neighbours this far off a sample's plane, spacings, belong to its face with a weight of 1/e.
const LEVEL_SPACINGS: f64 = 0.5;
/// Rounds of agreement: a vote is heard this many neighbours away.
const ROUNDS: usize = 12;
/// How loud all neighbours together are beside a sample's own vote.
const NEIGHBOURS_LOUDNESS: f64 = 2.0;
/// A belief weaker than this names no side.
const LEAST_BELIEF: f64 = 0.35;
/// How far a ray goes, units: through the thickest part of a meniscus.
const REACH_UNITS: f64 = 16.0;
/// How near it must come to a sample to meet it, spacings.
const MEETING_SPACINGS: f64 = 0.8;
/// The first step leaves the surface's own samples behind.
const FIRST_SPACINGS: f64 = 1.6;
const STEP_SPACINGS: f64 = 0.6;
const OWN_SPACINGS: f64 = 1.3;

/// The samples of a surface and how they are found.
pub(super) struct Samples<'a> {
    pub(super) points: &'a [Point3],
    pub(super) cells: &'a Cells,
    pub(super) lattice: &'a Lattice,
    pub(super) spacing_mm: f64,
    pub(super) unit_mm: f64,
}

/// Gives `normals` the signs of `given`, and tells of each whether its side is sure.
pub(super) fn like(points: &[Point3], normals: &mut [Vector3], given: &[Vector3]) -> Vec<bool> {
    let is_sure = normals
        .iter_mut()
        .zip(given)
        .map(|(normal, given)| {
            let along = normal.dot(given);
            if along < 0.0 {
                *normal = -*normal;
            }
            along.abs() > 0.3 * given.norm().max(1e-9)
        })
        .collect();
    // A closed surface has positive volume: triangles wound the wrong way round show here.
    let volume: f64 = points
        .iter()
        .zip(normals.iter())
        .map(|(p, n)| p.coords.dot(n))
        .sum();
    if volume < 0.0 {
        normals.iter_mut().for_each(|normal| *normal = -*normal);
    }
    is_sure
}

impl Samples<'_> {
    /// Turns `normals` outwards, and tells of each whether its side is sure.
    pub(super) fn turn_outwards(&self, normals: &mut [Vector3]) -> Vec<bool> {
        let votes: Vec<f64> = self
            .points
            .par_iter()
            .zip(normals.par_iter())
            .with_min_len(64)
            .map(|(point, normal)| self.vote(point, normal))
            .collect();
        let couplings: Vec<Vec<(u32, f64)>> = (0..self.points.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|index| self.couplings(normals, index))
            .collect();
        let mut beliefs = votes.clone();
        for _ in 0..ROUNDS {
            beliefs = votes
                .par_iter()
                .zip(couplings.par_iter())
                .with_min_len(256)
                .map(|(vote, coupled)| {
                    let heard: f64 = coupled
                        .iter()
                        .map(|(other, weight)| weight * beliefs[*other as usize])
                        .sum();
                    (vote + NEIGHBOURS_LOUDNESS * heard).tanh()
                })
                .collect();
        }
        for (normal, belief) in normals.iter_mut().zip(&beliefs) {
            if *belief < 0.0 {
                *normal = -*normal;
            }
        }
        beliefs
            .iter()
            .map(|belief| belief.abs() >= LEAST_BELIEF)
            .collect()
    }

    /// The neighbours of a sample with how much they agree with it; the weights add up to one at most.
    fn couplings(&self, normals: &[Vector3], index: usize) -> Vec<(u32, f64)> {
        let (point, normal) = (&self.points[index], &normals[index]);
        let mut coupled = Vec::new();
        let mut total = 0.0;
        self.cells.within(
            point,
            NEIGHBOUR_SPACINGS * self.spacing_mm,
            |other, distance2| {
                if other == index || distance2 <= 0.0 {
                    return;
                }
                // Across a thin sheet the other face is as near and as parallel as the next sample of this one.
                let height =
                    normal.dot(&(self.points[other] - point)) / (LEVEL_SPACINGS * self.spacing_mm);
                let weight = (-height * height).exp();
                total += weight;
                coupled.push((other as u32, weight * normal.dot(&normals[other])));
            },
        );
        coupled
            .iter_mut()
            .for_each(|(_, weight)| *weight /= total.max(1e-9));
        coupled
    }

    /// Above zero if the normal seems to point outwards.
    fn vote(&self, point: &Point3, normal: &Vector3) -> f64 {
        match (
            self.meeting_mm(point, normal),
            self.meeting_mm(point, &-normal),
        ) {
            (None, Some(_)) => 1.0,
            (Some(_), None) => -1.0,
            (Some(ahead), Some(behind)) => (ahead - behind) / (ahead + behind),
            (None, None) => self.lean(point, normal),
        }
    }

    /// The other side of a thin sheet lies among the nearest samples, a little inwards.
    fn lean(&self, point: &Point3, normal: &Vector3) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        self.cells
            .within(point, NEIGHBOUR_SPACINGS * self.spacing_mm, |other, _| {
                sum += normal.dot(&(self.points[other] - point));
                count += 1.0;
            });
        (-sum / count / (0.3 * self.spacing_mm)).clamp(-1.0, 1.0)
    }

    /// How far a ray goes before it meets the surface again.
    fn meeting_mm(&self, point: &Point3, direction: &Vector3) -> Option<f64> {
        let mut way_mm = FIRST_SPACINGS * self.spacing_mm;
        while way_mm < REACH_UNITS * self.unit_mm {
            let at = point + direction * way_mm;
            let near = &self.points[self.lattice.nearest(at.cast::<f32>().coords.into())];
            let is_own = (near - point).norm() < OWN_SPACINGS * self.spacing_mm;
            if !is_own && (near - at).norm() < MEETING_SPACINGS * self.spacing_mm {
                return Some(way_mm);
            }
            way_mm += STEP_SPACINGS * self.spacing_mm;
        }
        None
    }
}
