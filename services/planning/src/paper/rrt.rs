//! The rapidly exploring random tree from start to goal.
//!
//! Each iteration draws a point, extends the nearest node by one step towards it, and keeps the
//! extension if it stays on the tissue, in the box, and below the limit of the [`Cost`]. With the
//! paper's manner a node whose extensions are all refused remains the nearest one for ever. The
//! corrected search therefore draws most points around the reference, extends the node that comes
//! nearest to the point if it goes on straight, turns no further than its cost allows, and keeps no
//! two nodes that come to the same place.

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
    /// Highest cost, 1/mm; the printed one has no unit that holds.
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
/// Reference, voxels and path are in the axes of the crescent, mm. `watch` hears the iterations made
/// every few hundred and may end the search ([`Error::Cancelled`]). [`Error::NoPath`] tells how far
/// it came.
pub fn search(
    reference: &Spline,
    voxels: &Voxels,
    options: &Search,
    allowed: impl Fn(&Point3) -> bool,
    mut watch: impl FnMut(u32) -> ControlFlow<()>,
) -> Result<Path, Error> {
    let guide = Guide::of(reference);
    let mut tree = Tree::from_start(&guide, voxels, options);
    let mut random = ChaCha8Rng::seed_from_u64(options.seed);
    for iteration in 1..=options.max_iterations {
        if iteration % REPORT_EVERY == 0 && watch(iteration).is_break() {
            return Err(Error::Cancelled);
        }
        let sample = tree.manner.sample(&mut random, &guide, voxels);
        let Some(node) = tree.grown_towards(&sample, &guide) else {
            continue;
        };
        if !allowed(&node.point) || !voxels.is_within(&node.point, options.tolerance_mm) {
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

/// What the two searches do differently beyond their costs.
struct Manner {
    /// How far a node may be from the reference, mm.
    off_mm: f64,
    /// Share of the samples drawn around the reference; the others come from the whole tissue.
    reference_share: f64,
    /// How far around the reference they are drawn along each axis, mm.
    around_mm: f64,
    /// A sample extends the node that comes nearest to it when it goes on straight for so long, mm: a
    /// node beside the reference that heads away from it is then not the nearest to what lies ahead.
    ahead_mm: f64,
    /// How near to each other two nodes may not come there, mm.
    crowded_mm: f64,
    /// How a node turns towards a sample.
    steering: Steering,
}

enum Steering {
    /// At once, however sharp the turn.
    Straight,
    /// At most so much more or less than the reference turns, 1/mm.
    Bounded { turn_per_mm: f64 },
}

impl Manner {
    fn of(options: &Search) -> Self {
        match options.cost {
            Cost::Corrected => Self {
                off_mm: options.tolerance_mm,
                reference_share: 0.75,
                around_mm: 0.25 * options.tolerance_mm,
                ahead_mm: 1.0,
                crowded_mm: 0.2 * options.step_mm,
                // The other half of the cost is left for the distance.
                steering: Steering::Bounded {
                    turn_per_mm: 0.5 * options.cost_limit_per_mm,
                },
            },
            Cost::AsPrinted => Self {
                off_mm: f64::INFINITY,
                reference_share: 0.0,
                around_mm: 0.0,
                ahead_mm: 0.0,
                crowded_mm: 0.0,
                steering: Steering::Straight,
            },
        }
    }

    fn sample(&self, random: &mut ChaCha8Rng, guide: &Guide, voxels: &Voxels) -> Point3 {
        let choice: f64 = random.random();
        if choice < GOAL_SHARE {
            return guide.goal();
        }
        if choice < GOAL_SHARE + self.reference_share || voxels.centers().is_empty() {
            // The last nodes look beyond the goal.
            let whole_mm = guide.length_mm() + self.ahead_mm;
            let on_reference = guide.at(random.random::<f64>() * whole_mm);
            let mut offset_mm = || (2.0 * random.random::<f64>() - 1.0) * self.around_mm;
            return on_reference + Vector3::new(offset_mm(), offset_mm(), offset_mm());
        }
        voxels.centers()[random.random_range(0..voxels.centers().len())]
    }

    /// The unit direction from a node to `sample`, or as near to it as the steering lets it come;
    /// `None` if the sample lies at the node, or behind one that cannot turn at once.
    fn direction(&self, from: &Node, sample: &Point3, step_mm: f64) -> Option<Vector3> {
        let toward = (sample - from.point).try_normalize(1e-9)?;
        let turn_per_mm = match self.steering {
            Steering::Straight => return Some(toward),
            Steering::Bounded { turn_per_mm } => turn_per_mm,
        };
        let way_mm = 0.5 * (from.length_mm + step_mm);
        let along = (from.direction + from.bend_per_mm * way_mm).try_normalize(1e-9)?;
        let (cosine, most_rad) = (toward.dot(&along), turn_per_mm * way_mm);
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
    manner: Manner,
    nodes: Vec<Node>,
    /// Where each node comes to [`Manner::ahead_mm`] ahead.
    places: Slabs,
}

impl<'a> Tree<'a> {
    fn from_start(guide: &Guide, voxels: &Voxels, options: &'a Search) -> Self {
        let start = guide.start();
        let mut tree = Self {
            options,
            manner: Manner::of(options),
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
        self.places.push(self.place(&node));
        self.nodes.push(node);
    }

    fn place(&self, node: &Node) -> Point3 {
        node.point + node.direction * self.manner.ahead_mm
    }

    /// The node one step from the nearest one towards `sample`, if it may be one.
    fn grown_towards(&self, sample: &Point3, guide: &Guide) -> Option<Node> {
        let nearest = self.places.nearest(sample);
        let (from, step_mm) = (&self.nodes[nearest], self.options.step_mm);
        let point = from.point + self.manner.direction(from, sample, step_mm)? * step_mm;
        let foot = guide.foot(&point);
        if foot.off_mm > self.manner.off_mm {
            return None;
        }
        let node = self.extension(nearest, point, foot)?;
        let crowded = self
            .places
            .has_within(&self.place(&node), self.manner.crowded_mm);
        (!crowded).then_some(node)
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
