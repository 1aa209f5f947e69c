//! A small strictly convex quadratic program: six unknowns between bounds, some equations.
//!
//! minimise `x' H x / 2 - g' x` subject to `E x = f`, `low <= x <= high`.
//!
//! Solved by the dual active-set method of Goldfarb and Idnani (1983): it starts at the least of all `x` that obey the
//! equations, takes in the most violated bound and drops those that no longer press, until none is violated. It
//! needs no feasible start, and finds out by itself that there is no solution.

use arthro_geometry::nalgebra::{Cholesky, Matrix6, SMatrix, SVector, Vector6};

/// Most constraints that hold at once: the unknowns, and one that is being taken in.
const MOST: usize = 7;
/// Equations and twelve bounds come and go; more exchanges than this are rounding that goes round.
const EXCHANGES: usize = 200;
/// A bound violated by less than this share of its size, or by this much, is kept.
const VIOLATION: f64 = 1e-10;
/// A direction whose gain is this small a share of what it would be alone follows from the constraints held.
const DEPENDENT: f64 = 1e-12;

/// The program.
#[derive(Clone, Debug, PartialEq)]
pub struct Program<const EQUATIONS: usize> {
    /// Symmetric and positive definite.
    pub quadratic: Matrix6<f64>,
    /// The linear part, which is subtracted.
    pub linear: Vector6<f64>,
    /// Left side of the equations.
    pub equations: SMatrix<f64, EQUATIONS, 6>,
    /// Right side of the equations.
    pub equal_to: SVector<f64, EQUATIONS>,
    /// Least values.
    pub low: Vector6<f64>,
    /// Largest values.
    pub high: Vector6<f64>,
}

/// Its solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// Where the least is.
    pub x: Vector6<f64>,
    /// What presses on each unknown.
    pub held: [Option<Bound>; 6],
}

/// One end of an unknown's range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// The least value.
    Low,
    /// The largest value.
    High,
}

/// Why there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unsolvable {
    /// No `x` between the bounds obeys the equations.
    Infeasible,
    /// The equations depend on each other, the quadratic part is not positive definite, or a number is none.
    Degenerate,
}

/// A constraint `normal . x >= least`, of an equation `=`.
#[derive(Clone, Copy, Debug)]
struct Constraint {
    normal: Vector6<f64>,
    least: f64,
    bound: Option<(usize, Bound)>,
}

/// The constraints that hold, with their multipliers.
struct Active {
    constraints: Vec<Constraint>,
    multipliers: Vec<f64>,
    inverse: Matrix6<f64>,
}

impl<const EQUATIONS: usize> Program<EQUATIONS> {
    /// Solves it.
    pub fn solve(&self) -> Result<Solution, Unsolvable> {
        let inverse = Cholesky::new(self.quadratic)
            .ok_or(Unsolvable::Degenerate)?
            .inverse();
        let mut x = inverse * self.linear;
        let numbers = x.iter().chain(&self.equations).chain(&self.equal_to);
        let bounds = self.low.iter().chain(&self.high);
        if !numbers.chain(bounds).all(|number| number.is_finite()) {
            return Err(Unsolvable::Degenerate);
        }
        let mut active = Active {
            constraints: Vec::with_capacity(MOST),
            multipliers: Vec::with_capacity(MOST),
            inverse,
        };
        for (row, value) in self.equations.row_iter().zip(&self.equal_to) {
            let equation = Constraint {
                normal: row.transpose(),
                least: *value,
                bound: None,
            };
            let (way, pull) = active.directions(&equation.normal)?;
            let gain = way.dot(&equation.normal);
            if !(DEPENDENT * equation.normal.dot(&(inverse * equation.normal))..).contains(&gain) {
                return Err(Unsolvable::Degenerate);
            }
            let step = (equation.least - equation.normal.dot(&x)) / gain;
            x += way * step;
            active.yield_by(&pull, step);
            active.take_in(equation, step);
        }
        for _ in 0..EXCHANGES {
            let Some(violated) = self.most_violated(&x) else {
                return Ok(Solution {
                    x,
                    held: active.held(),
                });
            };
            active.enforce(violated, &mut x)?;
        }
        Err(Unsolvable::Degenerate)
    }

    fn most_violated(&self, x: &Vector6<f64>) -> Option<Constraint> {
        let bounds = (0..6).flat_map(|i| {
            let unit = Vector6::ith(i, 1.0);
            [
                (unit, self.low[i], (i, Bound::Low)),
                (-unit, -self.high[i], (i, Bound::High)),
            ]
        });
        bounds
            .map(|(normal, least, bound)| {
                let constraint = Constraint {
                    normal,
                    least,
                    bound: Some(bound),
                };
                (normal.dot(x) - least, constraint)
            })
            .filter(|(room, constraint)| *room < -VIOLATION * constraint.least.abs().max(1.0))
            .min_by(|(a, _), (b, _)| a.total_cmp(b))
            .map(|(_, constraint)| constraint)
    }
}

impl Active {
    /// Moves `x` until a constraint holds, and drops those that stop pressing on the way.
    fn enforce(&mut self, wanted: Constraint, x: &mut Vector6<f64>) -> Result<(), Unsolvable> {
        let alone = wanted.normal.dot(&(self.inverse * wanted.normal));
        let mut pressing = 0.0;
        // Each round but the last drops one.
        for _ in 0..=MOST {
            let (way, pull) = self.directions(&wanted.normal)?;
            let gain = way.dot(&wanted.normal);
            let missing = wanted.least - wanted.normal.dot(x);
            let whole = if gain > DEPENDENT * alone {
                missing / gain
            } else {
                f64::INFINITY
            };
            let first = self.first_to_drop(&pull);
            let step = first.map_or(whole, |(_, step)| step.min(whole));
            if !step.is_finite() {
                return Err(Unsolvable::Infeasible);
            }
            if whole.is_finite() {
                *x += way * step;
            }
            self.yield_by(&pull, step);
            pressing += step;
            match first {
                Some((index, at)) if at < whole => {
                    self.constraints.remove(index);
                    self.multipliers.remove(index);
                }
                _ => {
                    self.take_in(wanted, pressing);
                    return Ok(());
                }
            }
        }
        Err(Unsolvable::Degenerate)
    }

    /// How `x` moves, and how much less the constraints held press, for each unit that a new one presses.
    fn directions(
        &self,
        normal: &Vector6<f64>,
    ) -> Result<(Vector6<f64>, SVector<f64, MOST>), Unsolvable> {
        // Padded with ones on the diagonal to one size.
        let mut mutual = SMatrix::<f64, MOST, MOST>::identity();
        let mut with_new = SVector::<f64, MOST>::zeros();
        let free = self.inverse * normal;
        for (i, a) in self.constraints.iter().enumerate() {
            let weighed = self.inverse * a.normal;
            for (j, b) in self.constraints.iter().enumerate() {
                mutual[(i, j)] = weighed.dot(&b.normal);
            }
            with_new[i] = a.normal.dot(&free);
        }
        let pull = Cholesky::new(mutual)
            .ok_or(Unsolvable::Degenerate)?
            .solve(&with_new);
        let held = self
            .constraints
            .iter()
            .zip(&pull)
            .fold(Vector6::zeros(), |sum, (held, pull)| {
                sum + held.normal * *pull
            });
        Ok((self.inverse * (normal - held), pull))
    }

    /// The bound that first stops pressing, and at which step.
    fn first_to_drop(&self, pull: &SVector<f64, MOST>) -> Option<(usize, f64)> {
        (0..self.constraints.len())
            .filter(|i| self.constraints[*i].bound.is_some() && pull[*i] > 0.0)
            .map(|i| (i, (self.multipliers[i] / pull[i]).max(0.0)))
            .min_by(|(_, a), (_, b)| a.total_cmp(b))
    }

    fn yield_by(&mut self, pull: &SVector<f64, MOST>, step: f64) {
        for (multiplier, pull) in self.multipliers.iter_mut().zip(pull) {
            *multiplier -= step * pull;
        }
    }

    fn take_in(&mut self, constraint: Constraint, multiplier: f64) {
        self.constraints.push(constraint);
        self.multipliers.push(multiplier);
    }

    fn held(&self) -> [Option<Bound>; 6] {
        let mut held = [None; 6];
        for (i, bound) in self.constraints.iter().filter_map(|held| held.bound) {
            held[i] = Some(bound);
        }
        held
    }
}

#[cfg(test)]
mod tests;
