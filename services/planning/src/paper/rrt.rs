//! The rapidly exploring random tree from start to goal.
//!
//! Each iteration draws a point, extends the nearest node by one step towards it, and keeps the
//! extension if it stays on the tissue, in the box, and below the limit of the [`Cost`]. A node whose
//! extensions are all refused would remain the nearest one for ever: the corrected search therefore
//! turns towards the point only as far as its cost allows, draws most points around the reference,
//! and keeps no two nodes in the same place.

use std::ops::{ControlFlow, RangeInclusive};

use arthro_geometry::{Point3, Vector3};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::cost::{Corner, Cost, Term};
use super::guide::{Foot, Guide};
use super::slabs::Slabs;
use crate::contour::Spline;
use crate::error::Error;
use crate::voxels::Voxels;

/// Share of the samples that are the goal.
const GOAL_SHARE: f64 = 0.05;
/// The last segment, in steps: the goal ends it, not the step.
const GOAL_REACH: RangeInclusive<f64> = 0.5..=1.5;
/// Iterations between two reports.
const REPORT_EVERY: u32 = 256;

/// How the search goes.
#[derive(Clone, Copy, Debug)]
pub struct Search {
    /// Which cost the limit is for.
    pub cost: Cost,
    /// Length of one extension, mm.
    pub step_mm: f64,
    /// How far a point may be from tissue, and with [`Cost::Corrected`] from the reference, mm.
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
    /// From start to goal, one step apart but for the last, mm.
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
    let reserve = Reserve::of(options);
    let mut tree = Tree::from_start(&guide, voxels, options);
    let mut random = ChaCha8Rng::seed_from_u64(options.seed);
    for iteration in 1..=options.max_iterations {
        if iteration % REPORT_EVERY == 0 && watch(iteration).is_break() {
            return Err(Error::Cancelled);
        }
        let sample = reserve.sample(&mut random, &guide, voxels);
        let nearest = tree.places.nearest(&sample);
        let Some(direction) = tree.direction(nearest, &sample, &reserve) else {
            continue;
        };
        let point = tree.nodes[nearest].point + direction * options.step_mm;
        let foot = guide.foot(&point);
        if foot.off_mm > reserve.off_mm || tree.places.has_within(&point, reserve.crowded_mm) {
            continue;
        }
        let Some(node) = tree.extension(nearest, point, foot) else {
            continue;
        };
        if !allowed(&point) || !voxels.is_within(&point, options.tolerance_mm) {
            continue;
        }
        tree.push(node);
        if let Some(points) = tree.path_to_goal(&guide) {
            return Ok(Path {
                points,
                iterations: iteration,
            });
        }
    }
    let goal = guide.goal();
    let left = tree.nodes.iter().map(|node| (goal - node.point).norm());
    Err(Error::NoPath {
        iterations: options.max_iterations,
        left_mm: left.fold(f64::INFINITY, f64::min),
    })
}

/// What the corrected search takes care of beyond the cost.
struct Reserve {
    /// How far a node may be from the reference, mm.
    off_mm: f64,
    /// How near two nodes may not be, mm.
    crowded_mm: f64,
    /// Share of the samples drawn around the reference; the others come from the whole tissue.
    reference_share: f64,
    /// How far around the reference they are drawn, mm.
    around_mm: f64,
    /// How much more or less than the reference a step may turn, 1/mm.
    turn_per_mm: f64,
}

impl Reserve {
    fn of(options: &Search) -> Self {
        match options.cost {
            Cost::Corrected => Self {
                off_mm: options.tolerance_mm,
                crowded_mm: 0.2 * options.step_mm,
                reference_share: 0.75,
                around_mm: 0.5 * options.tolerance_mm,
                // The other half of the cost is left for the distance.
                turn_per_mm: 0.5 * options.cost_limit_per_mm,
            },
            Cost::AsPrinted => Self {
                off_mm: f64::INFINITY,
                crowded_mm: 0.0,
                reference_share: 0.0,
                around_mm: 0.0,
                turn_per_mm: f64::INFINITY,
            },
        }
    }

    fn sample(&self, random: &mut ChaCha8Rng, guide: &Guide, voxels: &Voxels) -> Point3 {
        let choice: f64 = random.random();
        if choice < GOAL_SHARE {
            return guide.goal();
        }
        if choice < GOAL_SHARE + self.reference_share || voxels.centers().is_empty() {
            let on_reference = guide.points()[random.random_range(0..guide.points().len())];
            let mut offset_mm = || (2.0 * random.random::<f64>() - 1.0) * self.around_mm;
            return on_reference + Vector3::new(offset_mm(), offset_mm(), offset_mm());
        }
        voxels.centers()[random.random_range(0..voxels.centers().len())]
    }
}

struct Node {
    point: Point3,
    parent: usize,
    /// Unit direction of the segment that ends here; at the start the tangent of the reference.
    direction: Vector3,
    /// Length of that segment, mm; 0 at the start.
    length_mm: f64,
    /// Curvature vector of the reference nearest to the point, 1/mm.
    bend_per_mm: Vector3,
    /// What the segment adds to Eq. 8.
    term: Option<Term>,
}

struct Tree<'a> {
    options: &'a Search,
    nodes: Vec<Node>,
    /// The points of the nodes.
    places: Slabs,
}

impl<'a> Tree<'a> {
    fn from_start(guide: &Guide, voxels: &Voxels, options: &'a Search) -> Self {
        let start = guide.start();
        let mut tree = Self {
            options,
            nodes: Vec::new(),
            places: Slabs::across(voxels.centers()),
        };
        tree.push(Node {
            point: start,
            parent: 0,
            direction: guide.start_tangent(),
            length_mm: 0.0,
            bend_per_mm: guide.foot(&start).bend_per_mm,
            term: None,
        });
        tree
    }

    fn push(&mut self, node: Node) {
        self.places.push(node.point);
        self.nodes.push(node);
    }

    /// The unit direction from a node to `sample`, or as near to it as the turn allowed lets it come;
    /// `None` if the sample lies at the node or behind it.
    fn direction(&self, from: usize, sample: &Point3, reserve: &Reserve) -> Option<Vector3> {
        let node = &self.nodes[from];
        let toward = (sample - node.point).try_normalize(1e-9)?;
        if reserve.turn_per_mm.is_infinite() {
            return Some(toward);
        }
        let way_mm = 0.5 * (node.length_mm + self.options.step_mm);
        let along = (node.direction + node.bend_per_mm * way_mm).try_normalize(1e-9)?;
        let (cosine, most_rad) = (toward.dot(&along), reserve.turn_per_mm * way_mm);
        if cosine <= 0.0 {
            return None;
        }
        if cosine.min(1.0).acos() <= most_rad {
            return Some(toward);
        }
        let across = (toward - along * cosine).try_normalize(1e-9)?;
        let (sin, cos) = most_rad.sin_cos();
        Some(along * cos + across * sin)
    }

    /// The node at `point` after `parent`, if the cost (Eq. 8) allows it.
    fn extension(&self, parent: usize, point: Point3, foot: Foot) -> Option<Node> {
        let before = &self.nodes[parent];
        let segment = point - before.point;
        let length_mm = segment.norm().max(1e-9);
        let direction = segment / length_mm;
        let cost = self.options.cost;
        let term = cost.term(&Corner {
            before: before.direction,
            before_mm: before.length_mm,
            after: direction,
            after_mm: length_mm,
            bend_per_mm: before.bend_per_mm,
            off_mm: foot.off_mm,
        });
        let older = self.to_start(parent).filter_map(|node| node.term);
        let mean_per_mm = cost.mean_per_mm(term.into_iter().chain(older));
        (mean_per_mm <= self.options.cost_limit_per_mm).then_some(Node {
            point,
            parent,
            direction,
            length_mm,
            bend_per_mm: foot.bend_per_mm,
            term,
        })
    }

    /// The path that the newest node ends, if one more segment leads from it to the goal.
    fn path_to_goal(&self, guide: &Guide) -> Option<Vec<Point3>> {
        let newest = self.nodes.len() - 1;
        let goal = guide.goal();
        let left_steps = (goal - self.nodes[newest].point).norm() / self.options.step_mm;
        if !GOAL_REACH.contains(&left_steps) {
            return None;
        }
        self.extension(newest, goal, guide.foot(&goal))?;
        let mut points = vec![goal];
        points.extend(self.to_start(newest).map(|node| node.point));
        points.reverse();
        Some(points)
    }

    /// The nodes from `leaf` back to the start, both included.
    fn to_start(&self, leaf: usize) -> impl Iterator<Item = &Node> {
        let before = |&at: &usize| (at != 0).then(|| self.nodes[at].parent);
        std::iter::successors(Some(leaf), before).map(|at| &self.nodes[at])
    }
}
