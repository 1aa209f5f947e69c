//! Normal equations of a pose's seven parameters, and the step that solves them with the scale kept in its range.

use nalgebra::{SMatrix, SVector};

use crate::scale::ScaleRange;

/// Turn about the model's centre (rad), shift (mm), logarithm of ct_from_view's scale about the view's centre.
pub(crate) type Step = SVector<f64, 7>;
/// Weighted sum of the squares of rows.
pub(crate) type Information = SMatrix<f64, 7, 7>;

/// A step stretches by no more than this, as a logarithm: beyond it the linear model says nothing.
const LARGEST_STRETCH: f64 = 0.1;

/// information * step = -gradient.
#[derive(Clone, Debug)]
pub(crate) struct Equations {
    pub(crate) information: Information,
    pub(crate) gradient: Step,
}

impl Equations {
    /// Nothing known yet.
    pub(crate) fn zeros() -> Self {
        Self {
            information: Information::zeros(),
            gradient: Step::zeros(),
        }
    }

    /// One residual and how it changes with a step.
    pub(crate) fn add(&mut self, weight: f64, row: &Step, residual: f64) {
        self.information.ger(weight, row, row, 1.0);
        self.gradient.axpy(weight * residual, row, 1.0);
    }

    /// The step from a pose of this `scale` (ct_from_view), and the scale that it leads to; camera_from_ct's scale stays
    /// within `allowed`. `None` if the equations do not determine it.
    pub(crate) fn solved(&self, scale: f64, allowed: ScaleRange) -> Option<(Step, f64)> {
        let free = self.information.cholesky()?.solve(&-self.gradient);
        let wanted = scale * free[6].clamp(-LARGEST_STRETCH, LARGEST_STRETCH).exp();
        let reached = 1.0 / allowed.clamp(1.0 / wanted);
        let step = if (reached / wanted - 1.0).abs() < 1e-12 {
            free
        } else {
            self.held_at((reached / scale).ln())?
        };
        let is_sound = step.iter().all(|value| value.is_finite()) && reached > 0.0;
        is_sound.then_some((step, reached))
    }

    /// The step with its logarithm of scale held at `stretch`: the other six are solved for.
    fn held_at(&self, stretch: f64) -> Option<Step> {
        let six = self.information.fixed_view::<6, 6>(0, 0).into_owned();
        let moved = self.information.fixed_view::<6, 1>(0, 6) * stretch;
        let solved = six
            .cholesky()?
            .solve(&-(self.gradient.fixed_rows::<6>(0) + moved));
        Some(Step::from_fn(
            |i, _| if i < 6 { solved[i] } else { stretch },
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Residuals row . (step - truth) of rows that look random.
    fn equations(truth: &Step) -> Equations {
        let mut equations = Equations::zeros();
        for i in 0..40 {
            let row =
                Step::from_fn(|j, _| (0.7 * f64::from(i) * (j + 1) as f64 + (j * j) as f64).sin());
            equations.add(1.0, &row, -row.dot(truth));
        }
        equations
    }

    #[test]
    fn the_step_leads_to_the_truth_and_a_clamped_scale_to_its_limit() {
        let truth = Step::from([0.01, -0.02, 0.03, 0.4, -0.5, 0.6, 0.05]);
        let wide = ScaleRange {
            low: 0.1,
            high: 10.0,
        };
        let (step, scale) = equations(&truth).solved(2.0, wide).unwrap();
        assert!((step - truth).norm() < 1e-9);
        assert!((scale - 2.0 * 0.05f64.exp()).abs() < 1e-9);
        let (step, scale) = equations(&truth)
            .solved(2.0, ScaleRange::only(0.5))
            .unwrap();
        assert_eq!((step[6], scale), (0.0, 2.0));
        assert!(Equations::zeros().solved(1.0, wide).is_none());
    }
}
