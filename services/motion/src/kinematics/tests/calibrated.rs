use super::*;

/// How many of the generating joints are not found again from a far reference, and the worst residual, mm.
fn account(cases: usize) -> (usize, f64) {
    let mut sweep = Sweep(21);
    let (mut lost, mut worst_mm) = (0, 0.0_f64);
    for case in 0..cases {
        let make = [Make::Ur5, Make::Ur5e][case % 2];
        let model = Model::from(make)
            .calibrated(&sweep.calibration(make))
            .unwrap();
        let joints = sweep.joints();
        let wanted = model.forward(&joints);
        let solutions = model.inverse(&wanted, &sweep.joints());
        for solution in solutions.as_slice() {
            worst_mm = worst_mm.max(residual(&model, solution, &wanted).0);
        }
        let kept = solutions
            .as_slice()
            .iter()
            .any(|solution| (0..6).all(|i| wrap(solution[i] - joints[i]).abs() < 1e-6));
        lost += usize::from(!kept);
    }
    (lost, worst_mm)
}

/// `ARTHRO_POSES` sets how many are tried. Near two singularities at once a branch may be missed.
#[test]
fn the_branches_of_a_calibrated_arm_are_found_from_those_of_the_drawing() {
    let cases = std::env::var("ARTHRO_POSES").map_or(10_000, |poses| poses.parse().unwrap());
    let (lost, worst_mm) = account(cases);
    eprintln!("{cases} poses: {lost} lost, worst residual {worst_mm:.1e} mm");
    assert!(worst_mm <= RESIDUAL_MAX, "{worst_mm}");
    assert!(lost * 5000 <= cases, "{lost} of {cases} lost");
}

/// Nearly parallel axes make a table whose lengths along them are metres that cancel, and whose offsets are
/// large; the chain is the same.
#[test]
fn a_table_of_nearly_parallel_axes_is_computed_as_well() {
    // Joints 2 and 3 lean by 1e-3 rad against one another: their common normal lies far away.
    let mut table = Dh::nominal(&Make::Ur5.links());
    let lean = 1e-3_f64;
    let far_mm = 300.0 / lean;
    let near_mm = (425.0_f64.powi(2) - 300.0_f64.powi(2)).sqrt();
    let offset = 300.0_f64.atan2(near_mm);
    table.a_mm[1] = -near_mm;
    table.theta_rad[1] = offset;
    table.d_mm[1] = far_mm;
    table.alpha_rad[1] = lean;
    table.theta_rad[2] = -offset;
    table.d_mm[2] = -far_mm;
    let model = Model::ur5().calibrated(&table).unwrap();
    let mut sweep = Sweep(3);
    for _ in 0..1000 {
        let joints = sweep.joints();
        let wanted = model.forward(&joints);
        let found = model.inverse(&wanted, &joints.map(|angle| angle + 0.02));
        assert!(!found.as_slice().is_empty());
        for solution in found.as_slice() {
            assert!(residual(&model, solution, &wanted).0 <= RESIDUAL_MAX);
        }
    }
}

#[test]
fn a_stream_through_a_singular_wrist_is_followed_by_a_calibrated_arm() {
    let model = models()[1];
    let mut before = [0.3, -1.2, 1.4, 0.2, 0.05, 0.9];
    for step in 1..=100 {
        let wanted = [0.3, -1.2, 1.4, 0.2, 0.05 - 0.001 * f64::from(step), 0.9];
        let found = model
            .inverse(&model.forward(&wanted), &before)
            .nearest(&before, model.limits())
            .unwrap();
        assert!(largest_difference(&found, &before).1 < 0.05, "{found:?}");
        assert!(residual(&model, &found, &model.forward(&wanted)).0 <= RESIDUAL_MAX);
        before = found;
    }
}
