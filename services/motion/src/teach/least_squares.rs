//! Gauss-Newton over poses that each say two numbers, with the covariance of the answer and the pose that
//! contradicts the rest.

use arthro_geometry::nalgebra::{Matrix2, SMatrix, SVector, SymmetricEigen, Vector2};

use super::Refusal;

/// Steps at most; from a start within some degrees four are enough.
const STEPS: usize = 40;
/// Halvings of a step that makes it worse.
const HALVINGS: usize = 12;
/// A step this small, in units of the unknowns, is the end.
const SETTLED: f64 = 1e-11;
/// A residual that noise gives once in so many solutions contradicts the rest.
const RARE: f64 = 1e-3;

/// Poses of which each says two numbers about `N` unknowns.
pub trait Problem<const N: usize> {
    /// The unknowns.
    type State: Clone;
    /// How many poses there are.
    fn len(&self) -> usize;
    /// Across the line of pose `index`, mm.
    fn residual(&self, index: usize, state: &Self::State) -> Vector2<f64>;
    /// Derivative of the residual.
    fn jacobian(&self, index: usize, state: &Self::State) -> SMatrix<f64, 2, N>;
    /// The unknowns after a step.
    fn moved(&self, state: &Self::State, step: &SVector<f64, N>) -> Self::State;
}

/// What was found.
#[derive(Clone, Debug)]
pub struct Fit<S, const N: usize> {
    /// The unknowns.
    pub state: S,
    /// Inverse of the information of noise 1 mm.
    pub unit_covariance: SMatrix<f64, N, N>,
    /// Squared residuals, summed, mm2.
    pub cost_mm2: f64,
    /// Numbers beyond those that the unknowns take up.
    pub freedom: usize,
}

/// Which unknowns the poses tell least about.
#[derive(Clone, Copy, Debug)]
pub struct Weakest<const N: usize> {
    /// Root mean square change of the residuals by a change of 1.
    pub share: f64,
    /// The change, of length 1.
    pub direction: SVector<f64, N>,
}

/// Minimises the squared residuals of the poses for which `takes` holds. `None` when they leave an unknown open.
pub fn minimise<const N: usize, P: Problem<N>>(
    problem: &P,
    start: P::State,
    takes: impl Fn(usize) -> bool,
) -> Option<Fit<P::State, N>> {
    let poses: Vec<usize> = (0..problem.len()).filter(|index| takes(*index)).collect();
    let cost = |state: &P::State| -> f64 {
        let squares = poses
            .iter()
            .map(|i| problem.residual(*i, state).norm_squared());
        squares.sum()
    };
    let mut state = start;
    let mut now_mm2 = cost(&state);
    for _ in 0..STEPS {
        let (information, moment) = normal(problem, &state, &poses);
        let step = -information.cholesky()?.solve(&moment);
        let tried = (0..HALVINGS).find_map(|halving| {
            let part = step * 0.5_f64.powi(halving as i32);
            let next = problem.moved(&state, &part);
            let next_mm2 = cost(&next);
            (next_mm2 <= now_mm2).then_some((next, next_mm2, part.norm()))
        });
        let Some((next, next_mm2, length)) = tried else {
            break;
        };
        (state, now_mm2) = (next, next_mm2);
        if length < SETTLED {
            break;
        }
    }
    let (information, _) = normal(problem, &state, &poses);
    Some(Fit {
        unit_covariance: information.cholesky()?.inverse(),
        cost_mm2: now_mm2,
        freedom: (2 * poses.len()).saturating_sub(N),
        state,
    })
}

/// The change of the unknowns that shows least in the residuals.
pub fn weakest<const N: usize, P: Problem<N>>(problem: &P, state: &P::State) -> Weakest<N> {
    let all: Vec<usize> = (0..problem.len()).collect();
    let (information, _) = normal(problem, state, &all);
    // The least eigenvalue by its inverse's largest would lose it: few unknowns make the whole spectrum cheap.
    let dynamic = SymmetricEigen::new(arthro_geometry::nalgebra::DMatrix::from_column_slice(
        N,
        N,
        information.as_slice(),
    ));
    let least = dynamic.eigenvalues.imin();
    Weakest {
        share: (dynamic.eigenvalues[least].max(0.0) / problem.len() as f64).sqrt(),
        direction: SVector::from_iterator(dynamic.eigenvectors.column(least).iter().copied()),
    }
}

/// Refuses when a pose contradicts the answer of the others by more than their noise explains.
///
/// # Errors
/// [`Refusal::Outlier`].
pub fn agree<const N: usize, P: Problem<N>>(
    problem: &P,
    fit: &Fit<P::State, N>,
    noise_mm: Option<f64>,
) -> Result<(), Refusal> {
    let mut worst: Option<(f64, Refusal)> = None;
    for pose in 0..problem.len() {
        let Some(others) = minimise(problem, fit.state.clone(), |index| index != pose) else {
            continue;
        };
        let variance_mm2 = match noise_mm {
            Some(noise_mm) => noise_mm * noise_mm,
            None if others.freedom == 0 => continue,
            None => others.cost_mm2 / others.freedom as f64,
        };
        let jacobian = problem.jacobian(pose, &others.state);
        let predicted =
            Matrix2::identity() + jacobian * others.unit_covariance * jacobian.transpose();
        let residual = problem.residual(pose, &others.state);
        let Some(inverse) = predicted.try_inverse() else {
            continue;
        };
        let square = residual.dot(&(inverse * residual)) / variance_mm2.max(f64::MIN_POSITIVE);
        let deviations = square.sqrt();
        let limit = rare_square(noise_mm.is_none().then_some(others.freedom), problem.len()).sqrt();
        let excess = deviations / limit;
        if excess > 1.0 && worst.as_ref().is_none_or(|(most, _)| excess > *most) {
            let refusal = Refusal::Outlier {
                pose,
                distance_mm: residual.norm(),
                deviations,
                limit,
            };
            worst = Some((excess, refusal));
        }
    }
    worst.map_or(Ok(()), |(_, refusal)| Err(refusal))
}

/// The squared length in standard deviations that the worst of `poses` residuals of two numbers exceeds
/// once in a thousand: chi-square, or Fisher's F where the noise is estimated with this freedom.
fn rare_square(estimated_with: Option<usize>, poses: usize) -> f64 {
    let rare = RARE / poses.max(1) as f64;
    match estimated_with {
        None => -2.0 * rare.ln(),
        Some(freedom) => {
            let freedom = freedom as f64;
            freedom * (rare.powf(-2.0 / freedom) - 1.0)
        }
    }
}

fn normal<const N: usize, P: Problem<N>>(
    problem: &P,
    state: &P::State,
    poses: &[usize],
) -> (SMatrix<f64, N, N>, SVector<f64, N>) {
    let (mut information, mut moment) = (SMatrix::zeros(), SVector::zeros());
    for index in poses {
        let jacobian = problem.jacobian(*index, state);
        information += jacobian.transpose() * jacobian;
        moment += jacobian.transpose() * problem.residual(*index, state);
    }
    (information, moment)
}

impl<S, const N: usize> Fit<S, N> {
    /// The variance of the noise that the covariances are for, mm2: stated, and larger where the residuals
    /// say so, or estimated. `None` when nothing tells it.
    pub fn variance_mm2(&self, stated_mm: Option<f64>) -> Option<f64> {
        let estimated = (self.freedom > 0).then(|| self.cost_mm2 / self.freedom as f64);
        match stated_mm {
            Some(stated_mm) => Some(estimated.unwrap_or(0.0).max(stated_mm * stated_mm)),
            None => estimated,
        }
    }
}
