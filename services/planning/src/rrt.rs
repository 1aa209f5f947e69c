//! The paper's rapidly exploring random tree from start to goal, with the curvature cost of Eq. 8-10
//! put right.
//!
//! As printed, Eq. 9 compares the sine of a turning angle with a curvature in 1/mm: it depends on the
//! step, takes a reversal for a straight line, an arc bent the wrong way for the right one, and lets a
//! path run anywhere. Here the turn per length is a vector, `(t2 - t1) / l` with the unit directions
//! before and after a node, and is compared with the curvature vector of the reference; a term for
//! the distance to the reference ties the path to it. Eq. 8's mean is taken over the newest segments,
//! so that a long smooth path does not pay for a kink.

use std::ops::ControlFlow;

use arthro_geometry::{Point3, Vector3};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::contour::Spline;
use crate::error::Error;
use crate::voxels::Voxels;

/// Newest segments over which the cost is averaged (Eq. 8).
const WINDOW: usize = 5;
/// Cost of a millimetre off the reference, 1/mm for each mm.
const DISTANCE_WEIGHT: f64 = 0.5;
/// Share of the samples that are the goal.
const GOAL_BIAS: f64 = 0.05;
/// Share of the samples drawn around the reference; the rest are drawn from the whole tissue.
const REFERENCE_BIAS: f64 = 0.75;
/// A node this near to another one, in steps, adds nothing.
const CROWDED: f64 = 0.2;
/// The last segment, in steps: the goal ends it, not the step.
const GOAL_REACH: std::ops::RangeInclusive<f64> = 0.5..=1.5;
/// Distance between the samples of the reference, mm.
const REFERENCE_SPACING_MM: f64 = 0.25;
/// Iterations between two reports.
const REPORT_EVERY: u32 = 256;

/// How the search goes.
#[derive(Clone, Copy, Debug)]
pub struct Search {
    /// Length of one extension, mm.
    pub step_mm: f64,
    /// How far a point may be from tissue and from the reference, mm.
    pub tolerance_mm: f64,
    /// Highest cost, 1/mm.
    pub cost_limit_per_mm: f64,
    /// Iterations before it gives up.
    pub max_iterations: u32,
    /// Same seed, same path.
    pub seed: u64,
}

/// The path found.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// From start to goal, one step apart, mm.
    pub points: Vec<Point3>,
    /// Iterations made.
    pub iterations: u32,
}

/// Searches a path along `reference` through points that `allowed` lets pass.
///
/// `watch` hears the iterations made and may end the search.
pub fn search(
    reference: &Spline,
    voxels: &Voxels,
    options: &Search,
    allowed: impl Fn(&Point3) -> bool,
    mut watch: impl FnMut(u32) -> ControlFlow<()>,
) -> Result<Path, Error> {
    let guide = Guide::of(reference);
    let goal = guide.samples[guide.samples.len() - 1].point;
    let mut tree = Tree::from_start(&guide);
    let mut random = ChaCha8Rng::seed_from_u64(options.seed);
    for iteration in 1..=options.max_iterations {
        if iteration % REPORT_EVERY == 0 && watch(iteration).is_break() {
            return Err(Error::Cancelled);
        }
        let sample = guide.sample(&mut random, voxels, options.tolerance_mm);
        let nearest = tree.nearest(&sample);
        let toward = sample - tree.nodes[nearest].point;
        let Some(direction) = toward.try_normalize(1e-9) else {
            continue;
        };
        let point = tree.nodes[nearest].point + direction * options.step_mm;
        let on_tissue = || voxels.distance_mm(&point, options.tolerance_mm).is_some();
        if !allowed(&point) || tree.is_crowded(&point, CROWDED * options.step_mm) || !on_tissue() {
            continue;
        }
        let Some(node) = tree.extension(nearest, point, &guide, options) else {
            continue;
        };
        tree.nodes.push(node);
        let newest = tree.nodes.len() - 1;
        let to_goal = (goal - point).norm() / options.step_mm;
        if GOAL_REACH.contains(&to_goal) && tree.extension(newest, goal, &guide, options).is_some()
        {
            let mut points = tree.branch(newest);
            points.push(goal);
            return Ok(Path {
                points,
                iterations: iteration,
            });
        }
    }
    let left = tree.nodes.iter().map(|node| (goal - node.point).norm());
    Err(Error::NoPath {
        iterations: options.max_iterations,
        left_mm: left.fold(f64::INFINITY, f64::min),
    })
}

/// The reference as the search needs it.
struct Guide {
    samples: Vec<Sample>,
    start_tangent: Vector3,
}

struct Sample {
    point: Point3,
    /// Curvature vector, 1/mm.
    bend: Vector3,
}

impl Guide {
    fn of(reference: &Spline) -> Self {
        let parameters = reference.parameters_every(REFERENCE_SPACING_MM);
        let samples = parameters.iter().map(|&at| {
            let (first, second) = reference.derivatives(at);
            let squared = first.norm_squared().max(1e-12);
            let across = second - first * (second.dot(&first) / squared);
            Sample {
                point: reference.point(at),
                bend: across / squared,
            }
        });
        Self {
            samples: samples.collect(),
            start_tangent: reference.tangent(0.0),
        }
    }

    /// Distance to the reference and its curvature vector there.
    fn nearest(&self, point: &Point3) -> (f64, Vector3) {
        let mut best = (f64::INFINITY, Vector3::zeros());
        for sample in &self.samples {
            let squared = (point - sample.point).norm_squared();
            if squared < best.0 {
                best = (squared, sample.bend);
            }
        }
        (best.0.sqrt(), best.1)
    }

    fn sample(&self, random: &mut ChaCha8Rng, voxels: &Voxels, tolerance_mm: f64) -> Point3 {
        let choice: f64 = random.random();
        if choice < GOAL_BIAS {
            return self.samples[self.samples.len() - 1].point;
        }
        if choice < GOAL_BIAS + REFERENCE_BIAS || voxels.centers().is_empty() {
            let index = random.random_range(0..self.samples.len());
            let mut offset = || random.random_range(-0.5..0.5) * tolerance_mm;
            let offset = Vector3::new(offset(), offset(), offset());
            return self.samples[index].point + offset;
        }
        voxels.centers()[random.random_range(0..voxels.centers().len())]
    }
}

struct Node {
    point: Point3,
    parent: usize,
    /// Unit direction of the segment that ends here.
    direction: Vector3,
    /// What this node adds to Eq. 8, 1/mm.
    term_per_mm: f64,
}

struct Tree {
    nodes: Vec<Node>,
}

impl Tree {
    fn from_start(guide: &Guide) -> Self {
        Self {
            nodes: vec![Node {
                point: guide.samples[0].point,
                parent: 0,
                // The first segment must leave along the reference.
                direction: guide.start_tangent,
                term_per_mm: 0.0,
            }],
        }
    }

    fn nearest(&self, point: &Point3) -> usize {
        let mut best = (f64::INFINITY, 0);
        for (index, node) in self.nodes.iter().enumerate() {
            let squared = (point - node.point).norm_squared();
            if squared < best.0 {
                best = (squared, index);
            }
        }
        best.1
    }

    fn is_crowded(&self, point: &Point3, radius_mm: f64) -> bool {
        let squared = radius_mm * radius_mm;
        let mut nodes = self.nodes.iter();
        nodes.any(|node| (point - node.point).norm_squared() < squared)
    }

    /// The node at `point` after `parent`, if its cost (Eq. 8) allows it.
    fn extension(
        &self,
        parent: usize,
        point: Point3,
        guide: &Guide,
        options: &Search,
    ) -> Option<Node> {
        let before = &self.nodes[parent];
        let segment = point - before.point;
        let length_mm = segment.norm().max(1e-9);
        let direction = segment / length_mm;
        let (distance_mm, _) = guide.nearest(&point);
        if distance_mm > options.tolerance_mm {
            return None;
        }
        let (_, bend) = guide.nearest(&before.point);
        let turn = (direction - before.direction) / length_mm.max(options.step_mm);
        let term_per_mm = (turn - bend).norm() + DISTANCE_WEIGHT * distance_mm;
        let (mut sum, mut count, mut at) = (term_per_mm, 1, parent);
        while count < WINDOW && at != 0 {
            sum += self.nodes[at].term_per_mm;
            at = self.nodes[at].parent;
            count += 1;
        }
        (sum / count as f64 <= options.cost_limit_per_mm).then_some(Node {
            point,
            parent,
            direction,
            term_per_mm,
        })
    }

    fn branch(&self, leaf: usize) -> Vec<Point3> {
        let mut points = vec![self.nodes[leaf].point];
        let mut at = leaf;
        while at != 0 {
            at = self.nodes[at].parent;
            points.push(self.nodes[at].point);
        }
        points.reverse();
        points
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RADIUS_MM: f64 = 13.0;

    fn on_arc(radius_mm: f64, way_mm: f64) -> Point3 {
        let (sin, cos) = (way_mm / RADIUS_MM).sin_cos();
        Point3::new(radius_mm * cos, radius_mm * sin, 0.0)
    }

    fn guide() -> Guide {
        let points: Vec<Point3> = (0..=60)
            .map(|step| on_arc(RADIUS_MM, f64::from(step) * 0.5))
            .collect();
        Guide::of(&Spline::fit(&points, 16).unwrap())
    }

    fn options(step_mm: f64) -> Search {
        Search {
            step_mm,
            tolerance_mm: 5.0,
            cost_limit_per_mm: f64::INFINITY,
            max_iterations: 1,
            seed: 0,
        }
    }

    /// What the last of these points adds to the cost.
    fn last_term(points: &[Point3], step_mm: f64) -> f64 {
        let guide = guide();
        let mut tree = Tree::from_start(&guide);
        for &point in &points[1..] {
            let newest = tree.nodes.len() - 1;
            let node = tree.extension(newest, point, &guide, &options(step_mm));
            tree.nodes.push(node.unwrap());
        }
        tree.nodes[tree.nodes.len() - 1].term_per_mm
    }

    #[test]
    fn following_the_reference_costs_nothing_whatever_the_step() {
        for step_mm in [0.25, 0.5, 1.0, 2.0] {
            let points: Vec<Point3> = (0..6)
                .map(|step| on_arc(RADIUS_MM, f64::from(step) * step_mm))
                .collect();
            let term = last_term(&points, step_mm);
            assert!(term < 0.1, "{term} /mm at a step of {step_mm} mm");
        }
    }

    #[test]
    fn a_sharper_turn_costs_more_and_a_reversal_is_no_straight_line() {
        let begin = [
            on_arc(RADIUS_MM, 0.0),
            on_arc(RADIUS_MM, 1.0),
            on_arc(RADIUS_MM, 2.0),
        ];
        let turned = |angle_deg: f64| {
            let ahead = begin[2] - begin[1];
            let (sin, cos) = angle_deg.to_radians().sin_cos();
            let next = Vector3::new(
                ahead.x * cos - ahead.y * sin,
                ahead.x * sin + ahead.y * cos,
                0.0,
            );
            last_term(&[begin[0], begin[1], begin[2], begin[2] + next], 1.0)
        };
        let terms: Vec<f64> = [5.0, 45.0, 90.0, 135.0].map(turned).to_vec();
        assert!(terms.windows(2).all(|pair| pair[0] < pair[1]), "{terms:?}");
        assert!(turned(180.0) > terms[2]);
    }

    #[test]
    fn an_arc_bent_the_wrong_way_and_an_arc_beside_the_reference_cost() {
        let points: Vec<Point3> = (0..6)
            .map(|step| on_arc(RADIUS_MM, f64::from(step)))
            .collect();
        let right = last_term(&points, 1.0);
        // Mirrored at the tangent of the start.
        let wrong: Vec<Point3> = points
            .iter()
            .map(|point| Point3::new(2.0 * RADIUS_MM - point.x, point.y, 0.0))
            .collect();
        assert!(last_term(&wrong, 1.0) > right + 0.1);
        let mut beside: Vec<Point3> = (0..6)
            .map(|step| on_arc(RADIUS_MM + 1.0, f64::from(step)))
            .collect();
        beside[0] = points[0];
        assert!(last_term(&beside, 1.0) > right + 0.4);
    }
}
