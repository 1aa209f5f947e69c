//! Weighted nonlinear least squares of few unknowns: Levenberg and Marquardt on the normal equations.

use arthro_geometry::nalgebra::{Cholesky, Const, SMatrix, SVector};

const ITERATIONS: usize = 60;
/// A step shorter than this, in standard deviations of the unknowns, is none.
const STILL: f64 = 1e-7;
const DAMPING: f64 = 1e-6;
/// A step that is refused under this damping leads nowhere.
const DAMPING_MAX: f64 = 1e9;

/// The normal equations of `N` unknowns at one state.
#[derive(Clone, Debug)]
pub(super) struct Normal<const N: usize> {
    /// Sum of J'WJ: the inverse of the unknowns' covariance.
    pub information: SMatrix<f64, N, N>,
    /// Sum of J'Wr.
    pub gradient: SVector<f64, N>,
    /// Sum of r'Wr.
    pub cost: f64,
}

impl<const N: usize> Normal<N> {
    /// No observation yet.
    pub fn empty() -> Self {
        Self {
            information: SMatrix::zeros(),
            gradient: SVector::zeros(),
            cost: 0.0,
        }
    }

    /// Adds an observation: residual, its derivative by the unknowns, the inverse of its covariance.
    pub fn add<const D: usize>(
        &mut self,
        residual: &SVector<f64, D>,
        jacobian: &SMatrix<f64, D, N>,
        weight: &SMatrix<f64, D, D>,
    ) {
        let weighted = jacobian.transpose() * weight;
        self.information += weighted * jacobian;
        self.gradient += weighted * residual;
        self.cost += residual.dot(&(weight * residual));
    }

    /// Covariance of the unknowns; `None` when the observations leave one of them free.
    pub fn covariance(&self) -> Option<SMatrix<f64, N, N>> {
        self.scaled(0.0)
            .map(|(factor, scale)| scaled_by(&factor.inverse(), &scale))
    }

    fn step(&self, damping: f64) -> Option<SVector<f64, N>> {
        let (factor, scale) = self.scaled(damping)?;
        let step = factor.solve(&-self.gradient.component_mul(&scale));
        Some(step.component_mul(&scale))
    }

    /// Factor of the damped information with ones on its diagonal, because radians and millimetres differ by decades,
    /// and what the unknowns were divided by.
    #[allow(clippy::type_complexity)]
    fn scaled(&self, damping: f64) -> Option<(Cholesky<f64, Const<N>>, SVector<f64, N>)> {
        let diagonal = self.information.diagonal();
        if diagonal.iter().any(|entry| entry.is_nan() || *entry <= 0.0) {
            return None;
        }
        let scale = diagonal.map(|entry| entry.sqrt().recip());
        let mut scaled = scaled_by(&self.information, &scale);
        for index in 0..N {
            scaled[(index, index)] += damping;
        }
        Some((Cholesky::new(scaled)?, scale))
    }
}

fn scaled_by<const N: usize>(
    matrix: &SMatrix<f64, N, N>,
    scale: &SVector<f64, N>,
) -> SMatrix<f64, N, N> {
    SMatrix::from_fn(|row, column| matrix[(row, column)] * scale[row] * scale[column])
}

/// The state of least cost near `start`, with the normal equations there; `None` when an unknown is free.
pub(super) fn minimise<S, const N: usize>(
    start: S,
    normal_at: impl Fn(&S) -> Normal<N>,
    moved: impl Fn(&S, &SVector<f64, N>) -> S,
) -> Option<(S, Normal<N>)> {
    let mut state = start;
    let mut normal = normal_at(&state);
    let mut damping = DAMPING;
    for _ in 0..ITERATIONS {
        let step = normal.step(damping)?;
        let ahead = moved(&state, &step);
        let normal_ahead = normal_at(&ahead);
        let still = step.dot(&(normal.information * step)).sqrt() < STILL;
        if normal_ahead.cost <= normal.cost {
            (state, normal) = (ahead, normal_ahead);
            damping *= 0.1;
        } else {
            damping = damping.max(DAMPING) * 10.0;
        }
        if still || damping > DAMPING_MAX {
            break;
        }
    }
    normal.cost.is_finite().then_some((state, normal))
}
