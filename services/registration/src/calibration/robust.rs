//! The estimator that all calibrations share: unknowns from poses of which some may be wrong.
//!
//! A start that bad poses cannot spoil (least median of squares over small subsets, Rousseeuw 1984), then weighted
//! least squares over the poses that agree with it. The weights come from stated noise, or the noise is estimated
//! from the residuals. A pose is rejected when its residual is one that noise gives once in a thousand poses.

mod scale;

use arthro_geometry::nalgebra::{SMatrix, SVector};
use rand::SeedableRng;
use rand::seq::index::sample;
use rand_chacha::ChaCha8Rng;

use self::scale::{Noise, chi_square, median, squares};
use super::least_squares::{Normal, minimise};

/// Subsets tried for a start: one of five poses without a wrong one among them is drawn almost surely when 40 % are wrong.
const SUBSETS: usize = 120;
/// Fixed, so that the same poses give the same answer.
const SEED: u64 = 1;
const ROUNDS: usize = 20;

/// Poses of which each says `D` numbers about `N` unknowns. The numbers come in groups of one unit each, as rotation
/// and translation.
pub(super) trait Problem<const N: usize, const D: usize> {
    /// The unknowns.
    type State: Clone;
    /// Numbers of one unit.
    const GROUP: usize;
    /// Poses that a start is computed from.
    const SUBSET: usize;

    /// How many poses there are.
    fn len(&self) -> usize;
    /// The unknowns from these poses alone, by formula.
    fn starts(&self, poses: &[usize]) -> Vec<Self::State>;
    /// Millimetres that an error of one unit of each group stands for, to compare starts.
    fn lever_mm(&self, group: usize) -> f64;
    /// What pose `index` says against these unknowns.
    fn residual(&self, index: usize, state: &Self::State) -> SVector<f64, D>;
    /// Derivative of the residual.
    fn jacobian(&self, index: usize, state: &Self::State) -> SMatrix<f64, D, N>;
    /// Covariance of the residual by the stated noise; `None` when it is to be estimated.
    fn covariance(&self, index: usize, state: &Self::State) -> Option<SMatrix<f64, D, D>>;
    /// The unknowns after a step.
    fn moved(&self, state: &Self::State, step: &SVector<f64, N>) -> Self::State;
}

/// What the estimator found.
#[derive(Clone, Debug)]
pub(super) struct Fit<S, const N: usize, const D: usize> {
    /// The unknowns.
    pub state: S,
    /// Their covariance, from the poses kept; wider by `noise_ratio` where the stated noise was too small.
    pub covariance: SMatrix<f64, N, N>,
    /// Whether each pose was kept.
    pub kept: Vec<bool>,
    /// Size of each residual in standard deviations.
    pub distances: Vec<f64>,
    /// Root mean square of the kept residuals over the stated noise; 1 when the noise is estimated.
    pub noise_ratio: f64,
    weights: Vec<SMatrix<f64, D, D>>,
}

/// Finds the unknowns; `None` when the poses leave one of them free.
pub(super) fn fit<const N: usize, const D: usize, P: Problem<N, D>>(
    problem: &P,
) -> Option<Fit<P::State, N, D>> {
    let mut state = start(problem)?;
    let mut kept = vec![true; problem.len()];
    let mut covariance = SMatrix::zeros();
    for _ in 0..ROUNDS {
        let noise = Noise::of_the_bulk(problem, &state);
        let weights = noise.weights(problem, &state)?;
        let limit = chi_square(D).rare * noise.ratio.powi(2);
        let agrees = |index: usize| {
            let weight = if kept[index] {
                Some(weights[index])
            } else {
                // The unknowns were found without this pose, so what it contradicts is uncertain too.
                let jacobian = problem.jacobian(index, &state);
                let predicted = jacobian * covariance * jacobian.transpose();
                weights[index]
                    .try_inverse()
                    .and_then(|own| (own + predicted).try_inverse())
            };
            let residual = problem.residual(index, &state);
            weight.is_some_and(|weight| residual.dot(&(weight * residual)) <= limit)
        };
        let now_kept: Vec<bool> = (0..problem.len()).map(agrees).collect();
        let (found, normal) = minimise_over(problem, state, &now_kept, &weights)?;
        state = found;
        covariance = normal.covariance()?;
        if now_kept == kept {
            break;
        }
        kept = now_kept;
    }
    weighted(problem, state, kept)
}

/// The last word: noise from the poses kept, the unknowns by it, and their covariance.
fn weighted<const N: usize, const D: usize, P: Problem<N, D>>(
    problem: &P,
    mut state: P::State,
    kept: Vec<bool>,
) -> Option<Fit<P::State, N, D>> {
    const PASSES: usize = 4;
    let mut weights = Vec::new();
    let mut normal = Normal::empty();
    for _ in 0..PASSES {
        weights = Noise::of_kept(problem, &state, &kept).weights(problem, &state)?;
        (state, normal) = minimise_over(problem, state, &kept, &weights)?;
    }
    let squares = squares(problem, &state, &weights);
    let is_stated = problem.covariance(0, &state).is_some();
    let freedom = (D * count(&kept)).saturating_sub(N).max(1) as f64;
    let noise_ratio = if is_stated {
        (normal.cost / freedom).sqrt()
    } else {
        1.0
    };
    Some(Fit {
        covariance: normal.covariance()? * noise_ratio.max(1.0).powi(2),
        state,
        kept,
        distances: squares.into_iter().map(f64::sqrt).collect(),
        noise_ratio,
        weights,
    })
}

impl<S: Clone, const N: usize, const D: usize> Fit<S, N, D> {
    /// How many poses were kept.
    pub fn kept_count(&self) -> usize {
        count(&self.kept)
    }

    /// The poses kept.
    pub fn kept_indices(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.kept.len()).filter(|index| self.kept[*index])
    }

    /// The poses rejected.
    pub fn rejected(&self) -> Vec<usize> {
        (0..self.kept.len())
            .filter(|index| !self.kept[*index])
            .collect()
    }

    /// The unknowns from the kept poses without one of them; `None` when that leaves one free.
    pub fn without<P: Problem<N, D, State = S>>(&self, problem: &P, left_out: usize) -> Option<S> {
        let mut kept = self.kept.clone();
        kept[left_out] = false;
        minimise_over(problem, self.state.clone(), &kept, &self.weights).map(|(state, _)| state)
    }
}

/// The unknowns that fit the better half of the poses best.
fn start<const N: usize, const D: usize, P: Problem<N, D>>(problem: &P) -> Option<P::State> {
    let count = problem.len();
    let all: Vec<usize> = (0..count).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let subset = P::SUBSET.min(count);
    let mut candidates = problem.starts(&all);
    for _ in 0..SUBSETS {
        candidates.extend(problem.starts(&sample(&mut rng, count, subset).into_vec()));
    }
    let scored = candidates.into_iter().map(|state| {
        let squares = (0..count).map(|index| square_mm2(problem, index, &state));
        (median(squares.collect()), state)
    });
    scored
        .filter(|(score, _)| score.is_finite())
        .min_by(|one, other| one.0.total_cmp(&other.0))
        .map(|(_, state)| state)
}

fn square_mm2<const N: usize, const D: usize, P: Problem<N, D>>(
    problem: &P,
    index: usize,
    state: &P::State,
) -> f64 {
    let residual = problem.residual(index, state);
    (0..D)
        .map(|row| (residual[row] * problem.lever_mm(row / P::GROUP)).powi(2))
        .sum()
}

fn minimise_over<const N: usize, const D: usize, P: Problem<N, D>>(
    problem: &P,
    state: P::State,
    kept: &[bool],
    weights: &[SMatrix<f64, D, D>],
) -> Option<(P::State, Normal<N>)> {
    minimise(
        state,
        |state| {
            let mut normal = Normal::empty();
            for index in (0..problem.len()).filter(|index| kept[*index]) {
                let residual = problem.residual(index, state);
                normal.add(&residual, &problem.jacobian(index, state), &weights[index]);
            }
            normal
        },
        |state, step| problem.moved(state, step),
    )
}

fn count(kept: &[bool]) -> usize {
    kept.iter().filter(|kept| **kept).count()
}
