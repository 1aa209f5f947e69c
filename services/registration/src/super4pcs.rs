//! The coarse stage: Super4PCS, congruent four-point sets under the AABB scale of Eq. 1-4.
//!
//! Four nearly coplanar points of the view keep, under a similarity, the two ratios in which their diagonals cut
//! each other. Pairs of model points with the diagonals' lengths are hashed by the place of that cut; where two
//! cuts meet, four model points may be the same four. Bases come from the view, since the view is part of the model.
//! As printed, the stage keeps one pose; on partial views the best score is often wrong, so several distinct ones are kept.

use std::collections::HashMap;

use arthro_geometry::{Point3, Vector3};
use rand::Rng as _;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::model::Model;
use crate::problem::Pose;
use crate::scale::ScaleRange;
use crate::scaled_icp::closed_form;
pub use thinned::Thinned;

mod thinned;

/// How the congruent sets are searched.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Four-point bases drawn from the view.
    pub bases: usize,
    /// How far a model point may be from where the base puts it, mm.
    pub tolerance_mm: f64,
    /// Scale of camera_from_ct.
    pub scale: f64,
    /// Best poses kept of each base.
    pub kept_per_base: usize,
}

/// A pose that a congruent set gives.
#[derive(Clone, Copy, Debug)]
pub struct Candidate {
    /// The pose.
    pub pose: Pose,
    /// Share of the checked view points near the model, 0..1.
    pub inlier_share: f64,
}

/// Candidate poses, best first, of `bases` independent draws. Deterministic by `seed` on any number of threads.
///
/// `model` is searched for congruent sets, `full_model` says how well a pose fits `view`.
pub fn search(
    model: &Thinned,
    full_model: &Model,
    view: &Thinned,
    settings: &Settings,
    seed: u64,
) -> Vec<Candidate> {
    let mut candidates: Vec<Candidate> = (0..settings.bases)
        .into_par_iter()
        .flat_map_iter(|draw| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(draw as u64);
            Base::draw(view, settings, &mut rng)
                .map(|base| base.candidates(model, full_model, view, settings))
                .unwrap_or_default()
        })
        .collect();
    candidates.sort_by(|a, b| b.inlier_share.total_cmp(&a.inlier_share));
    candidates
}

/// Four view points a, b, c, d, in mm of the model; diagonals ab and cd.
struct Base {
    view_points: [Point3; 4],
    points: [Point3; 4],
    normals: [Vector3; 4],
    /// Where the diagonals come nearest, as fractions of ab and cd.
    ratios: [f64; 2],
    /// How far the diagonals pass each other, mm.
    gap_mm: f64,
}

/// Triangles tried for the widest one.
const TRIANGLES_TRIED: usize = 60;
/// A diagonal is cut no nearer to its ends than this fraction.
const LEAST_RATIO: f64 = 0.15;

impl Base {
    /// A wide triangle and the fourth point that lies best in its plane.
    fn draw(view: &Thinned, settings: &Settings, rng: &mut ChaCha8Rng) -> Option<Self> {
        let count = view.points.len();
        let (mut widest, mut triangle) = (0.0, [0; 3]);
        for _ in 0..TRIANGLES_TRIED {
            let [a, b, c] = [0; 3].map(|_| rng.random_range(0..count));
            let (ab, ac) = (
                view.points[b] - view.points[a],
                view.points[c] - view.points[a],
            );
            let area = ab.cross(&ac).norm();
            if area > widest {
                (widest, triangle) = (area, [a, b, c]);
            }
        }
        (0..count)
            .filter(|d| !triangle.contains(d))
            .flat_map(|d| {
                let [a, b, c] = triangle;
                [[a, b, c, d], [a, c, b, d], [b, c, a, d]]
            })
            .filter_map(|quad| Self::new(view, quad, settings.scale))
            .min_by(|x, y| x.gap_mm.total_cmp(&y.gap_mm))
    }

    fn new(view: &Thinned, quad: [usize; 4], scale: f64) -> Option<Self> {
        let view_points = quad.map(|i| view.points[i]);
        let points = view_points.map(|p| p / scale);
        let [a, b, c, d] = points;
        let (ratios, gap_mm) = crossing(a, b, c, d)?;
        ratios
            .iter()
            .all(|r| (LEAST_RATIO..=1.0 - LEAST_RATIO).contains(r))
            .then(|| Self {
                view_points,
                points,
                normals: quad.map(|i| view.normals[i]),
                ratios,
                gap_mm,
            })
    }

    fn candidates(
        &self,
        model: &Thinned,
        full_model: &Model,
        view: &Thinned,
        settings: &Settings,
    ) -> Vec<Candidate> {
        let mut fits: Vec<(f64, Pose)> = self
            .congruent_sets(model, settings.tolerance_mm)
            .into_iter()
            .filter_map(|set| {
                let pairs: Vec<(Point3, Point3)> = set
                    .iter()
                    .zip(self.view_points)
                    .map(|(&index, point)| (model.points[index as usize], point))
                    .collect();
                let camera_from_ct = closed_form(&pairs, ScaleRange::only(settings.scale))?;
                let error2: f64 = pairs
                    .iter()
                    .map(|(ct, camera)| (camera_from_ct * *ct - camera).norm_squared())
                    .sum();
                Some((error2, camera_from_ct.inverse()))
            })
            .collect();
        fits.sort_by(|a, b| a.0.total_cmp(&b.0));
        fits.truncate(FITS_CHECKED);
        let mut candidates: Vec<Candidate> = Vec::new();
        for (_, pose) in fits {
            let least = match candidates.last() {
                Some(worst) if candidates.len() >= settings.kept_per_base => worst.inlier_share,
                _ => 0.0,
            };
            let Some(inlier_share) = inlier_share(
                full_model,
                &view.points,
                &pose,
                settings.tolerance_mm,
                least,
            ) else {
                continue;
            };
            let place = candidates.partition_point(|other| other.inlier_share >= inlier_share);
            candidates.insert(place, Candidate { pose, inlier_share });
            candidates.truncate(settings.kept_per_base);
        }
        candidates
    }

    /// Quadruples of model points congruent to the base within the tolerance.
    fn congruent_sets(&self, model: &Thinned, tolerance_mm: f64) -> Vec<[u32; 4]> {
        let [a, b, c, d] = self.points;
        let first = self.pairs_like(model, 0, 1, tolerance_mm);
        let second = self.pairs_like(model, 2, 3, tolerance_mm);
        let cell_mm = self.gap_mm + tolerance_mm;
        let cell = |p: &Point3| [p.x, p.y, p.z].map(|v| (v / cell_mm).floor() as i32);
        let cut = |pair: &[u32; 2], ratio: f64| {
            let (p, q) = (
                model.points[pair[0] as usize],
                model.points[pair[1] as usize],
            );
            p + (q - p) * ratio
        };
        let mut cuts: HashMap<[i32; 3], Vec<(u32, Point3)>> = HashMap::new();
        for (index, pair) in first.iter().enumerate() {
            let at = cut(pair, self.ratios[0]);
            cuts.entry(cell(&at)).or_default().push((index as u32, at));
        }
        let sides = [
            (a - c).norm(),
            (a - d).norm(),
            (b - c).norm(),
            (b - d).norm(),
        ];
        let mut sets = Vec::new();
        for pair in &second {
            let at = cut(pair, self.ratios[1]);
            let home = cell(&at);
            for neighbour in around(home) {
                for (index, other) in cuts.get(&neighbour).into_iter().flatten() {
                    if (at - other).norm_squared() > cell_mm * cell_mm {
                        continue;
                    }
                    let [p, q] = first[*index as usize];
                    let set = [p, q, pair[0], pair[1]];
                    let [p, q, r, s] = set.map(|i| model.points[i as usize]);
                    let found = [
                        (p - r).norm(),
                        (p - s).norm(),
                        (q - r).norm(),
                        (q - s).norm(),
                    ];
                    let alike = found
                        .iter()
                        .zip(sides)
                        .all(|(found, side)| (found - side).abs() < 1.5 * tolerance_mm);
                    if alike {
                        sets.push(set);
                    }
                }
            }
        }
        sets
    }

    /// Ordered pairs of model points as far apart as base points `from` and `to`, whose normals lean alike.
    fn pairs_like(
        &self,
        model: &Thinned,
        from: usize,
        to: usize,
        tolerance_mm: f64,
    ) -> Vec<[u32; 2]> {
        let along = self.points[to] - self.points[from];
        let length = along.norm();
        let lean = leaning(&along, &self.normals[from], &self.normals[to]);
        let mut pairs = Vec::new();
        for (i, p) in model.points.iter().enumerate() {
            for (j, q) in model.points.iter().enumerate().skip(i + 1) {
                let along = q - p;
                if (along.norm() - length).abs() > tolerance_mm {
                    continue;
                }
                let [at_p, at_q, between] = leaning(&along, &model.normals[i], &model.normals[j]);
                if (between - lean[2]).abs() > LEAN_TOLERANCE_RAD {
                    continue;
                }
                let like = |x: f64, y: f64| {
                    (x - lean[0]).abs() < LEAN_TOLERANCE_RAD
                        && (y - lean[1]).abs() < LEAN_TOLERANCE_RAD
                };
                if like(at_p, at_q) {
                    pairs.push([i as u32, j as u32]);
                }
                if like(at_q, at_p) {
                    pairs.push([j as u32, i as u32]);
                }
            }
        }
        pairs
    }
}

/// Best fits of a base that are checked against the whole view.
const FITS_CHECKED: usize = 500;
/// How much the normals' leanings may differ, rad; fitted normals at an edge are this unsure.
const LEAN_TOLERANCE_RAD: f64 = 0.5;

/// Angles between a segment and the normals at its ends, and between the normals; signs of normals do not count.
fn leaning(along: &Vector3, at_start: &Vector3, at_end: &Vector3) -> [f64; 3] {
    let angle = |cosine: f64| cosine.abs().min(1.0).acos();
    let length = along.norm();
    [
        angle(along.dot(at_start) / length),
        angle(along.dot(at_end) / length),
        angle(at_start.dot(at_end)),
    ]
}

/// Where lines ab and cd come nearest, as fractions of ab and cd, and how near; `None` if parallel.
fn crossing(a: Point3, b: Point3, c: Point3, d: Point3) -> Option<([f64; 2], f64)> {
    let (u, v, w) = (b - a, d - c, a - c);
    let (uu, uv, vv, uw, vw) = (u.dot(&u), u.dot(&v), v.dot(&v), u.dot(&w), v.dot(&w));
    let determinant = uu * vv - uv * uv;
    // Diagonals nearer to parallel than 15 degrees leave their cut unsure.
    if determinant < 0.067 * uu * vv {
        return None;
    }
    let first = (uv * vw - vv * uw) / determinant;
    let second = (uu * vw - uv * uw) / determinant;
    let gap = (a + u * first) - (c + v * second);
    Some(([first, second], gap.norm()))
}

fn around([x, y, z]: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    (-1..=1)
        .flat_map(move |i| (-1..=1).flat_map(move |j| (-1..=1).map(move |k| [x + i, y + j, z + k])))
}

/// Share of `view` within `tolerance_mm` of the model; `None` as soon as it cannot reach `least`.
fn inlier_share(
    model: &Model,
    view: &[Point3],
    pose: &Pose,
    tolerance_mm: f64,
    least: f64,
) -> Option<f64> {
    let count = view.len() as f64;
    let misses_allowed = count * (1.0 - least);
    let mut misses = 0.0;
    for point in view {
        if model.rough_distance_mm(&(*pose * *point)) > tolerance_mm {
            misses += 1.0;
            if misses > misses_allowed {
                return None;
            }
        }
    }
    Some(1.0 - misses / count)
}
