//! The noise that an estimator weighs residuals by: stated, or estimated from them.

use arthro_geometry::nalgebra::{SMatrix, SVector};

use super::{Problem, count};

/// Estimated noise is not taken for smaller than this share of the residuals' own unit (rad, mm): rounding.
const NOISE_FLOOR: f64 = 1e-12;

/// The noise that residuals are weighed by.
pub(super) struct Noise {
    /// Variance of each group; empty when the noise is stated.
    variances: Vec<f64>,
    /// How much larger the bulk of the residuals is than the noise says; at least 1.
    pub(super) ratio: f64,
}

impl Noise {
    /// From the median, which wrong poses do not move; with the factor that Rousseeuw and Leroy give for few poses.
    pub(super) fn of_the_bulk<const N: usize, const D: usize, P: Problem<N, D>>(
        problem: &P,
        state: &P::State,
    ) -> Self {
        let count = problem.len();
        let few = 1.0 + 5.0 / count.saturating_sub(N.div_ceil(D)).max(1) as f64;
        if let Some(weights) = stated_weights(problem, state) {
            let square = median(squares(problem, state, &weights)) / chi_square(D).median;
            // What few poses show by chance does not make the stated noise wrong.
            let ratio = if square > few * few {
                square.sqrt()
            } else {
                1.0
            };
            return Self {
                variances: Vec::new(),
                ratio,
            };
        }
        let variance = |group: usize| {
            let squares =
                (0..count).map(|index| group_square::<N, D, P>(problem, index, state, group));
            few * few * median(squares.collect()) / chi_square(P::GROUP).median
        };
        Self {
            variances: (0..D / P::GROUP).map(variance).collect(),
            ratio: 1.0,
        }
    }

    /// From the mean over the poses kept, less what the unknowns took up.
    pub(super) fn of_kept<const N: usize, const D: usize, P: Problem<N, D>>(
        problem: &P,
        state: &P::State,
        kept: &[bool],
    ) -> Self {
        let groups = D / P::GROUP;
        let freedom = (P::GROUP * count(kept)).saturating_sub(N / groups).max(1) as f64;
        let variance = |group: usize| {
            (0..problem.len())
                .filter(|index| kept[*index])
                .map(|index| group_square::<N, D, P>(problem, index, state, group))
                .sum::<f64>()
                / freedom
        };
        Self {
            variances: (0..groups).map(variance).collect(),
            ratio: 1.0,
        }
    }

    /// The inverse covariance of every residual; the stated one where there is one.
    pub(super) fn weights<const N: usize, const D: usize, P: Problem<N, D>>(
        &self,
        problem: &P,
        state: &P::State,
    ) -> Option<Vec<SMatrix<f64, D, D>>> {
        stated_weights(problem, state).or_else(|| {
            let diagonal = SVector::<f64, D>::from_fn(|row, _| {
                let variance = self.variances.get(row / P::GROUP).copied().unwrap_or(1.0);
                variance.max(NOISE_FLOOR * NOISE_FLOOR).recip()
            });
            Some(vec![SMatrix::from_diagonal(&diagonal); problem.len()])
        })
    }
}

fn stated_weights<const N: usize, const D: usize, P: Problem<N, D>>(
    problem: &P,
    state: &P::State,
) -> Option<Vec<SMatrix<f64, D, D>>> {
    (0..problem.len())
        .map(|index| {
            let covariance = problem.covariance(index, state)?;
            covariance.cholesky().map(|factor| factor.inverse())
        })
        .collect()
}

/// Every residual's square in units of its variance.
pub(super) fn squares<const N: usize, const D: usize, P: Problem<N, D>>(
    problem: &P,
    state: &P::State,
    weights: &[SMatrix<f64, D, D>],
) -> Vec<f64> {
    weights
        .iter()
        .enumerate()
        .map(|(index, weight)| {
            let residual = problem.residual(index, state);
            residual.dot(&(weight * residual))
        })
        .collect()
}

fn group_square<const N: usize, const D: usize, P: Problem<N, D>>(
    problem: &P,
    index: usize,
    state: &P::State,
    group: usize,
) -> f64 {
    let residual = problem.residual(index, state);
    let rows = group * P::GROUP..(group + 1) * P::GROUP;
    rows.map(|row| residual[row].powi(2)).sum()
}

/// The upper of two middle values: of few poses the lower one says too little noise.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Quantiles of the sum of `freedom` squared normal deviates.
pub(super) struct ChiSquare {
    pub(super) median: f64,
    /// Exceeded once in a thousand.
    pub(super) rare: f64,
}

/// From the tables, for the numbers of degrees that occur.
pub(super) fn chi_square(freedom: usize) -> ChiSquare {
    let (median, rare) = match freedom {
        2 => (1.386, 13.816),
        3 => (2.366, 16.266),
        4 => (3.357, 18.467),
        _ => (5.348, 22.458),
    };
    ChiSquare { median, rare }
}
