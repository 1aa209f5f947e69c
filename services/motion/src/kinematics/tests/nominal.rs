use super::*;

#[test]
fn a_singular_wrist_takes_joint_6_from_the_sample_before() {
    let mut joints = [0.3, -1.2, 1.4, 0.2, 0.0, 0.9];
    for q5 in [0.0, PI] {
        joints[4] = q5;
        let model = Model::ur5();
        let wanted = model.forward(&joints);
        let found = model
            .inverse(&wanted, &joints)
            .nearest(&joints, model.limits())
            .unwrap();
        assert!(largest_difference(&found, &joints).1 < 1e-7, "{found:?}");
        assert!(residual(&model, &found, &wanted).0 < 1e-9);
    }
}

/// A stream that passes through the wrist's singularity keeps to its branch.
#[test]
fn a_way_through_a_singular_wrist_is_followed_without_a_jump() {
    let model = Model::ur5e();
    let mut before = [0.3, -1.2, 1.4, 0.2, 0.05, 0.9];
    for step in 1..=100 {
        let wanted = [0.3, -1.2, 1.4, 0.2, 0.05 - 0.001 * f64::from(step), 0.9];
        let found = model
            .inverse(&model.forward(&wanted), &before)
            .nearest(&before, model.limits())
            .unwrap();
        assert!(largest_difference(&found, &wanted).1 < 1e-9, "{found:?}");
        before = found;
    }
}
