use std::f64::consts::FRAC_PI_2;

use arthro_geometry::{Rotation, Vector3};

use super::*;
use crate::bodies::{ArmShape, ToolShape};

fn dry_run() -> DryRun {
    let arm = ToolArm::new(
        crate::kinematics::model::Model::ur5(),
        Rigid::new(
            Rotation::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2),
            Vector3::new(0.0, 0.0, 310.0),
        ),
    );
    DryRun {
        arm,
        limits: Limits::default(),
        neutral_joints_rad: [0.479, -1.185, -2.041, 3.004, -1.102, -1.469],
        portal: Point3::new(700.0, 0.0, 265.0).into(),
        period_s: 0.008,
        method: Method::Rcm,
        berth: Berth::apart(ArmShape::new(&arm, ToolShape::default())),
    }
}

#[test]
fn targets_in_the_knee_are_reached_with_margins() {
    for (x, y, z) in [
        (740.0, 0.0, 250.0),
        (745.0, 20.0, 255.0),
        (755.0, -15.0, 248.0),
    ] {
        let checked = dry_run().check(&Point3::new(x, y, z));
        let margins = checked.outcome.unwrap();
        assert!(margins.margins.joint_limit_rad > 0.3, "{margins:?}");
        assert!(margins.margins.rcm_between_samples_mm < 0.01, "{margins:?}");
        assert!(checked.depth_mm > 40.0);
    }
}

#[test]
fn targets_that_cannot_be_reached_say_why() {
    let reason = |target| {
        let checked = dry_run().check(&target);
        checked.outcome.unwrap_err().reason().to_owned()
    };
    assert_eq!(reason(Point3::new(800.0, 0.0, 250.0)), "TOO_DEEP");
    assert_eq!(reason(Point3::new(660.0, 0.0, 265.0)), "TURN_TOO_WIDE");
    let mut far = dry_run();
    far.portal = Point3::new(1300.0, 0.0, 265.0).into();
    let checked = far.check(&Point3::new(1340.0, 0.0, 250.0));
    assert_eq!(checked.outcome.unwrap_err().reason(), "OUT_OF_REACH");
}
