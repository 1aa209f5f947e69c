use proptest::prelude::*;

use super::*;

fn program() -> impl Strategy<Value = Program<2>> {
    (
        prop::collection::vec(-1.0..1.0f64, 36),
        prop::array::uniform6(-3.0..3.0f64),
        prop::collection::vec(-1.0..1.0f64, 12),
        prop::array::uniform2(-0.3..0.3f64),
        prop::array::uniform6(0.05..1.0f64),
        prop::array::uniform6(0.05..1.0f64),
    )
        .prop_map(|(factor, linear, equations, equal_to, low, high)| {
            let factor = Matrix6::from_column_slice(&factor);
            Program {
                quadratic: factor.tr_mul(&factor) + Matrix6::identity() * 0.05,
                linear: linear.into(),
                equations: SMatrix::from_column_slice(&equations),
                equal_to: equal_to.into(),
                low: -Vector6::from(low),
                high: high.into(),
            }
        })
}

/// How far `x` is from obeying the conditions of Karush, Kuhn and Tucker, by least squares for the multipliers of the
/// equations over the unknowns that are free.
fn gradient_left(program: &Program<2>, solution: &Solution) -> (f64, bool) {
    let gradient = program.quadratic * solution.x - program.linear;
    let free: Vec<usize> = (0..6).filter(|i| solution.held[*i].is_none()).collect();
    let rows = arthro_geometry::nalgebra::DMatrix::from_fn(free.len(), 2, |i, j| {
        program.equations[(j, free[i])]
    });
    let wanted = arthro_geometry::nalgebra::DVector::from_fn(free.len(), |i, _| gradient[free[i]]);
    let multipliers = rows
        .clone()
        .svd(true, true)
        .solve(&wanted, 1e-12)
        .unwrap_or_else(|_| arthro_geometry::nalgebra::DVector::zeros(2));
    let left = (&rows * &multipliers - wanted).norm();
    let presses_outward = (0..6).all(|i| {
        let pressing = gradient[i]
            - (0..2)
                .map(|j| program.equations[(j, i)] * multipliers[j])
                .sum::<f64>();
        match solution.held[i] {
            None => true,
            Some(Bound::Low) => pressing >= -1e-6,
            Some(Bound::High) => pressing <= 1e-6,
        }
    });
    (left, presses_outward || free.len() < 3)
}

proptest! {
    #[test]
    fn a_solution_obeys_its_constraints_and_nothing_near_is_less(program in program()) {
        match program.solve() {
            Ok(solution) => {
                let off = program.equations * solution.x - program.equal_to;
                prop_assert!(off.norm() < 1e-9, "{off}");
                for i in 0..6 {
                    prop_assert!((program.low[i] - 1e-9..=program.high[i] + 1e-9).contains(&solution.x[i]));
                }
                let (left, presses_outward) = gradient_left(&program, &solution);
                prop_assert!(left < 1e-6, "{left} {solution:?}");
                prop_assert!(presses_outward, "{solution:?}");
            }
            Err(error) => {
                prop_assert_eq!(error, Unsolvable::Infeasible);
                // Each equation alone can be so far from what the bounds allow; or both together are: then a
                // combination of them is beyond what the bounds reach. It is found among many directions.
                let beyond = (0..3600).any(|k| {
                    let angle = f64::from(k) * std::f64::consts::PI / 1800.0;
                    let (s, c) = angle.sin_cos();
                    let row = program.equations.row(0) * c + program.equations.row(1) * s;
                    let value = program.equal_to[0] * c + program.equal_to[1] * s;
                    let most: f64 = (0..6)
                        .map(|i| (row[i] * program.low[i]).max(row[i] * program.high[i]))
                        .sum();
                    value > most - 1e-6
                });
                prop_assert!(beyond);
            }
        }
    }
}

#[test]
fn what_cannot_be_is_told_from_what_is_ill_posed() {
    let mut program = Program::<2> {
        quadratic: Matrix6::identity(),
        linear: Vector6::zeros(),
        equations: SMatrix::zeros(),
        equal_to: SVector::zeros(),
        low: -Vector6::repeat(1.0),
        high: Vector6::repeat(1.0),
    };
    assert_eq!(program.solve(), Err(Unsolvable::Degenerate));
    program.equations[(0, 0)] = 1.0;
    program.equations[(1, 1)] = 1.0;
    program.equal_to[0] = 0.5;
    assert_eq!(program.solve().unwrap().x[0], 0.5);
    program.equal_to[0] = 2.0;
    assert_eq!(program.solve(), Err(Unsolvable::Infeasible));
    program.equal_to[0] = f64::NAN;
    assert_eq!(program.solve(), Err(Unsolvable::Degenerate));
    program.equal_to[0] = 0.0;
    program.low[3] = 1.5;
    assert_eq!(program.solve(), Err(Unsolvable::Infeasible));
    program.quadratic[(2, 2)] = -1.0;
    assert_eq!(program.solve(), Err(Unsolvable::Degenerate));
}
