use std::f64::consts::FRAC_PI_2;

use arthro_geometry::{Rotation, Vector3};

use super::*;
use crate::rcm::shaft;

const JOINTS: Joints = [0.479, -1.185, -2.041, 3.004, -1.102, -1.469];

struct Watch {
    supervisor: Supervisor,
    measured: Measured,
    portal: Point3,
}

impl Watch {
    /// A standing arm whose tip is `depth_mm` beyond a portal that its shaft passes at `aside_mm`.
    fn with(depth_mm: f64, aside_mm: f64) -> Self {
        let arm = ToolArm::new(
            crate::kinematics::model::Model::ur5(),
            Rigid::new(
                Rotation::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2),
                Vector3::new(0.0, 0.0, 310.0),
            ),
        );
        let pose = arm.base_from_tool(&JOINTS);
        let aside = pose.direction(&Vector3::y()) * aside_mm;
        Self {
            supervisor: Supervisor::new(arm, Limits::default()),
            measured: Measured {
                time_s: 1.0,
                joints_rad: JOINTS,
                joint_speeds_rad_s: [0.0; 6],
                robot_mode: RobotMode::Running,
                safety_mode: SafetyMode::Normal,
            },
            portal: pose.origin() - shaft(&pose) * depth_mm + aside,
        }
    }

    fn judge(&mut self, regime: Regime) -> Option<Breach> {
        let seen = self.supervisor.observe(&self.measured, Some(&self.portal));
        self.supervisor.check(regime, &self.measured, &seen).err()
    }

    fn reason(&mut self, regime: Regime) -> &'static str {
        self.judge(regime).map_or("", |breach| breach.reason)
    }
}

#[test]
fn a_sound_arm_passes_in_every_regime() {
    for regime in [Regime::Standing, Regime::Inward, Regime::Outward] {
        assert_eq!(Watch::with(40.0, 0.1).judge(regime), None);
    }
    assert_eq!(Watch::with(-5.0, 30.0).judge(Regime::Outside), None);
}

#[test]
fn a_shaft_off_the_portal_is_a_breach_while_inside() {
    let breach = Watch::with(20.0, 1.25).judge(Regime::Inward).unwrap();
    assert_eq!(breach.reason, "RCM_DEVIATION");
    assert_eq!(
        breach.detail,
        "distance of the shaft to the portal is 1.250 mm; limit 1.000 mm"
    );
    assert_eq!(
        Watch::with(20.0, 1.25).reason(Regime::Standing),
        "RCM_DEVIATION"
    );
    assert_eq!(Watch::with(-20.0, 1.25).reason(Regime::Inward), "");
}

#[test]
fn a_tip_beyond_the_deepest_depth_is_a_breach_unless_it_draws_back() {
    assert_eq!(Watch::with(80.6, 0.0).reason(Regime::Inward), "TOO_DEEP");
    assert_eq!(Watch::with(80.4, 0.0).reason(Regime::Inward), "");
    assert_eq!(Watch::with(80.6, 0.0).reason(Regime::Outward), "");
}

#[test]
fn a_tip_inside_is_a_breach_of_a_move_outside() {
    assert_eq!(
        Watch::with(0.01, 0.0).reason(Regime::Outside),
        "TOOL_INSIDE"
    );
}

#[test]
fn a_fast_joint_is_a_breach() {
    let mut watch = Watch::with(-5.0, 0.0);
    watch.measured.joint_speeds_rad_s[3] = -1.21;
    assert_eq!(watch.reason(Regime::Standing), "JOINT_SPEED");
    watch.measured.joint_speeds_rad_s[3] = f64::NAN;
    assert_eq!(watch.reason(Regime::Standing), "JOINT_SPEED");
}

#[test]
fn a_controller_that_is_not_running_is_a_breach() {
    let mut watch = Watch::with(-5.0, 0.0);
    watch.measured.safety_mode = SafetyMode::ProtectiveStop;
    assert_eq!(watch.reason(Regime::Standing), "SAFETY_MODE");
    watch.measured.safety_mode = SafetyMode::Unknown(77);
    assert_eq!(watch.reason(Regime::Standing), "SAFETY_MODE");
    watch.measured.safety_mode = SafetyMode::Reduced;
    watch.measured.robot_mode = RobotMode::Idle;
    assert_eq!(watch.reason(Regime::Standing), "ROBOT_MODE");
}

#[test]
fn a_gap_in_the_states_is_a_breach_while_moving() {
    let mut watch = Watch::with(-5.0, 0.0);
    assert_eq!(watch.reason(Regime::Outside), "");
    watch.measured.time_s += 0.101;
    assert_eq!(watch.reason(Regime::Outside), "STATE_STALE");
    watch.measured.time_s -= 0.05;
    assert_eq!(
        watch.reason(Regime::Outside),
        "STATE_STALE",
        "time ran backwards"
    );
    watch.measured.time_s += 5.0;
    assert_eq!(watch.reason(Regime::Standing), "");
}

#[test]
fn a_joint_that_is_no_number_is_a_breach() {
    let mut watch = Watch::with(10.0, 0.0);
    watch.measured.joints_rad[2] = f64::NAN;
    assert_eq!(watch.reason(Regime::Standing), "STATE_UNKNOWN");
}

#[test]
fn a_tip_beside_the_knee_is_not_inside_but_one_that_strayed_is() {
    assert_eq!(Watch::with(50.0, 150.0).reason(Regime::Outside), "");
    let mut strayed = Watch::with(50.0, 0.0);
    strayed.judge(Regime::Inward);
    strayed.portal = Watch::with(50.0, 150.0).portal;
    assert_eq!(strayed.reason(Regime::Outside), "TOOL_INSIDE");
    strayed.portal = Watch::with(-1.0, 150.0).portal;
    strayed.judge(Regime::Outward);
    strayed.portal = Watch::with(50.0, 150.0).portal;
    assert_eq!(strayed.reason(Regime::Outside), "");
}

#[test]
fn an_acknowledged_deviation_lets_the_shaft_be_drawn_back_but_not_stray_farther() {
    let mut watch = Watch::with(30.0, 3.0);
    let seen = watch
        .supervisor
        .observe(&watch.measured, Some(&watch.portal));
    watch.supervisor.acknowledge(&seen);
    assert_eq!(watch.reason(Regime::Outward), "");
    watch.portal = Watch::with(30.0, 3.51).portal;
    assert_eq!(watch.reason(Regime::Outward), "RCM_DEVIATION");
    watch.portal = Watch::with(-1.0, 3.0).portal;
    watch.judge(Regime::Outward);
    watch.portal = Watch::with(30.0, 3.0).portal;
    assert_eq!(watch.reason(Regime::Outward), "RCM_DEVIATION");
}
