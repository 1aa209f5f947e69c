//! From joints that nearly reach a pose to joints that do: Newton's method on a calibrated chain, which has
//! no closed inverse. The steps are damped where the arm is near a singularity.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use arthro_geometry::nalgebra::{Cholesky, Matrix6, SMatrix, SymmetricEigen, Vector6};

use super::dh::Chain;
use super::flange_pose::FlangePose;
use super::links::Links;
use super::links::inverse::Leeway;
use super::singularity::Singularities;
use super::solutions::Solutions;
use super::{Joints, RESIDUAL_MAX, wrap};

/// The joints of the arm as drawn are taken for a start also where it is this much too short, mm.
const REACH_MM: f64 = 20.0;
/// Nearer to the shoulder's singularity than this a branch of the calibrated arm may lie elsewhere than that of the
/// drawing: it is also sought from starts on either side, mm.
const NEAR_MM: f64 = 60.0;
/// The same at the elbow and the wrist, rad.
const NEAR_RAD: f64 = 0.35;
/// Starts beside a solution, for its twin on the other side of a singularity, rad.
const ACROSS_RAD: [f64; 6] = [-0.6, -0.2, -0.05, 0.05, 0.2, 0.6];
/// Longest step, rad.
const STEP_MAX_RAD: f64 = 0.3;
/// Where two branches meet each step halves the error only.
const STEPS: usize = 40;
/// What a turn of the flange counts for beside a shift of it, mm/rad.
const TURN_MM: f64 = 300.0;
/// A residual that rounding leaves: no step makes it smaller, mm.
const ROUNDING_MM: f64 = 1e-11;
/// Solutions closer than this are one, rad.
const SAME_RAD: f64 = 1e-6;

/// The joint angles that a stream may go on with: the branches of the arm as drawn, and what `reference`, the
/// sample before, leads to. Near a singularity another branch may be missing.
pub fn inverse_near(
    chain: &Chain,
    links: &Links,
    flange: &FlangePose,
    reference: &Joints,
) -> Solutions {
    let mut search = Search::new(chain, flange);
    search.start_all(&links.inverse_with(flange, reference[5], &leeway(0.0, 0.0, 0.0)));
    search.start(reference);
    search.found
}

/// All joint angles found that reach a pose: as [`inverse_near`], and near a singularity from more starts.
pub fn inverse(chain: &Chain, links: &Links, flange: &FlangePose, reference: &Joints) -> Solutions {
    let mut search = Search::new(chain, flange);
    let drawn = links.inverse_with(flange, reference[5], &leeway(0.0, 0.0, 0.0));
    search.start_all(&drawn);
    search.start(reference);
    let is_near = |joints: &Joints| {
        let from = Singularities::of(links, joints);
        from.shoulder_mm < NEAR_MM || from.elbow_rad < NEAR_RAD || from.wrist_rad < NEAR_RAD
    };
    let seeds = drawn.as_slice();
    if seeds.is_empty() || seeds.iter().any(is_near) {
        for q6_rad in [0.0, FRAC_PI_4, FRAC_PI_2, -FRAC_PI_4] {
            let apart = leeway(NEAR_MM, NEAR_RAD, q6_rad);
            search.start_all(&links.inverse_with(flange, reference[5], &apart));
        }
    }
    // A solution near a singularity has its twin on the other side, along what hardly moves the flange.
    let mut next = 0;
    while let Some(joints) = search.found.as_slice().get(next).copied() {
        if is_near(&joints) {
            search.start_across(&joints);
        }
        next += 1;
    }
    search.found
}

fn leeway(shoulder_mm: f64, elbow_rad: f64, q6_rad: f64) -> Leeway {
    Leeway {
        reach_mm: REACH_MM,
        shoulder_mm,
        elbow_rad,
        q6_rad,
    }
}

/// What was found for one pose so far.
struct Search<'a> {
    chain: &'a Chain,
    flange: &'a FlangePose,
    found: Solutions,
}

impl<'a> Search<'a> {
    fn new(chain: &'a Chain, flange: &'a FlangePose) -> Self {
        Self {
            chain,
            flange,
            found: Solutions::default(),
        }
    }

    fn start_all(&mut self, seeds: &Solutions) {
        for seed in seeds.as_slice() {
            self.start(seed);
        }
    }

    fn start(&mut self, seed: &Joints) {
        let Some(joints) = polish(self.chain, self.flange, seed) else {
            return;
        };
        let joints = joints.map(wrap);
        let known =
            self.found.as_slice().iter().any(|known| {
                (0..6).all(|i| (..SAME_RAD).contains(&wrap(known[i] - joints[i]).abs()))
            });
        if !known {
            self.found.push(joints);
        }
    }

    fn start_across(&mut self, joints: &Joints) {
        let rows = weighed(&self.chain.forward_and_jacobian(joints).1);
        let gain = SymmetricEigen::new(rows.tr_mul(&rows));
        let mut order: [usize; 6] = std::array::from_fn(|i| i);
        order.sort_by(|a, b| gain.eigenvalues[*a].total_cmp(&gain.eigenvalues[*b]));
        // Two singularities may be near.
        for way in &order[..2] {
            let turns = gain.eigenvectors.column(*way);
            for step in ACROSS_RAD {
                let seed = std::array::from_fn(|i| joints[i] + step * turns[i]);
                self.start(&seed);
            }
        }
    }
}

/// The joints near `seed` that reach a pose to [`RESIDUAL_MAX`], if there are any.
fn polish(chain: &Chain, flange: &FlangePose, seed: &Joints) -> Option<Joints> {
    let mut joints = *seed;
    let mut best = (f64::INFINITY, joints);
    for _ in 0..STEPS {
        let (reached, jacobian) = chain.forward_and_jacobian(&joints);
        let (shift_mm, turn_rad) = reached.error_to(flange);
        let error = weighed(&Vector6::new(
            shift_mm.x, shift_mm.y, shift_mm.z, turn_rad.x, turn_rad.y, turn_rad.z,
        ));
        let size_mm = error.norm();
        if size_mm < best.0 && reached.faces(flange) {
            best = (size_mm, joints);
        } else if best.0 < RESIDUAL_MAX {
            break;
        }
        if size_mm < ROUNDING_MM {
            break;
        }
        let step = step(&jacobian, &error)?;
        joints = std::array::from_fn(|i| joints[i] + step[i]);
    }
    let (shift_mm, turn_rad) = chain.forward(&best.1).error_to(flange);
    let reaches = (..=RESIDUAL_MAX).contains(&shift_mm.norm().max(turn_rad.norm()));
    (reaches && best.0.is_finite()).then_some(best.1)
}

/// Newton's step, or where that is too long the damped one that is not.
fn step(jacobian: &Matrix6<f64>, error: &Vector6<f64>) -> Option<Vector6<f64>> {
    let rows = weighed(jacobian);
    if let Some(step) = rows.lu().solve(error)
        && (..=STEP_MAX_RAD).contains(&step.norm())
    {
        return Some(step);
    }
    let normal = rows.tr_mul(&rows);
    let gradient = rows.tr_mul(error);
    let mut damping = 1e-8 * normal.trace();
    // Ten to the twelfth of the trace is far beyond what makes any finite step short.
    for _ in 0..20 {
        let damped = normal + Matrix6::from_diagonal_element(damping);
        if let Some(factor) = Cholesky::new(damped) {
            let step = factor.solve(&gradient);
            if (..=STEP_MAX_RAD).contains(&step.norm()) {
                return Some(step);
            }
        }
        damping *= 10.0;
    }
    None
}

/// With turns of the flange as lengths.
fn weighed<const COLUMNS: usize>(rows: &SMatrix<f64, 6, COLUMNS>) -> SMatrix<f64, 6, COLUMNS> {
    let mut rows = *rows;
    rows.fixed_rows_mut::<3>(3).scale_mut(TURN_MM);
    rows
}
