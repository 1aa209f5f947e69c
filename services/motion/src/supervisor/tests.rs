use std::f64::consts::FRAC_PI_2;

use arthro_geometry::{Rotation, Vector3};

use super::*;
use crate::bodies::{ArmShape, ToolShape};
use crate::workspace::{Part, Plane};

const JOINTS: Joints = [0.479, -1.185, -2.041, 3.004, -1.102, -1.469];

fn apart(arm: &ToolArm) -> Berth {
    Berth::apart(ArmShape::new(arm, ToolShape::default()))
}

struct Watch {
    supervisor: Supervisor,
    measured: Measured,
    portal: Point3,
    axis: Option<Unit<Vector3>>,
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
            supervisor: Supervisor::new(arm, Limits::default(), apart(&arm)),
            measured: Measured {
                time_s: 1.0,
                joints_rad: JOINTS,
                joint_speeds_rad_s: [0.0; 6],
                robot_mode: RobotMode::Running,
                safety_mode: SafetyMode::Normal,
            },
            portal: pose.origin() - shaft(&pose) * depth_mm + aside,
            axis: None,
        }
    }

    fn judge(&mut self, regime: Regime) -> Option<Breach> {
        let seen = self.observe();
        self.supervisor.check(regime, &self.measured, &seen).err()
    }

    fn observe(&mut self) -> Observation {
        self.supervisor
            .observe(&self.measured, Some(&self.portal), self.axis.as_ref())
    }

    /// The next state of a controller that ticks.
    fn tick(&mut self, regime: Regime) -> &'static str {
        self.measured.time_s += 0.008;
        self.reason(regime)
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
    let seen = watch.observe();
    watch.supervisor.acknowledge(&seen);
    assert_eq!(watch.reason(Regime::Outward), "");
    watch.portal = Watch::with(30.0, 3.51).portal;
    assert_eq!(watch.reason(Regime::Outward), "RCM_DEVIATION");
    watch.portal = Watch::with(-1.0, 3.0).portal;
    watch.judge(Regime::Outward);
    watch.portal = Watch::with(30.0, 3.0).portal;
    assert_eq!(watch.reason(Regime::Outward), "RCM_DEVIATION");
}

#[test]
fn a_shaft_that_leans_out_of_the_cone_is_a_breach_unless_it_draws_back() {
    let mut watch = Watch::with(40.0, 0.0);
    let pose = watch.observe().base_from_tool;
    let leaning = |angle_rad: f64| {
        let across = Unit::new_normalize(pose.direction(&Vector3::y()));
        let turned = Rotation::from_axis_angle(&across, angle_rad) * shaft(&pose);
        Some(Unit::new_normalize(turned))
    };
    watch.axis = leaning(1.05);
    assert_eq!(watch.tick(Regime::Inward), "");
    watch.axis = leaning(1.06);
    assert_eq!(watch.tick(Regime::Inward), "CONE");
    assert_eq!(watch.tick(Regime::Outward), "");
}

#[test]
fn a_fast_tip_is_a_breach_only_inside() {
    let mut inside = Watch::with(40.0, 0.0);
    // 0.1 rad/s about the base at some 700 mm is 70 mm/s, which no joint limit forbids.
    inside.measured.joint_speeds_rad_s[0] = 0.1;
    assert_eq!(inside.tick(Regime::Inward), "TIP_SPEED_INSIDE");
    inside.measured.joint_speeds_rad_s[0] = 0.02;
    assert_eq!(inside.tick(Regime::Inward), "");
    let mut outside = Watch::with(-5.0, 0.0);
    outside.measured.joint_speeds_rad_s[0] = 0.1;
    assert_eq!(outside.tick(Regime::Inward), "");
}

#[test]
fn the_speed_of_the_tip_is_that_of_the_difference_of_its_places() {
    let mut watch = Watch::with(-5.0, 0.0);
    watch.measured.joint_speeds_rad_s = [0.1, -0.2, 0.3, 0.1, -0.4, 0.2];
    let before = watch.observe();
    for (joint, speed) in watch.measured.joint_speeds_rad_s.into_iter().enumerate() {
        watch.measured.joints_rad[joint] += speed * 0.001;
    }
    let way_mm = (watch.observe().base_from_tool.origin() - before.base_from_tool.origin()).norm();
    assert!((way_mm / 0.001 - before.tip_speed_mm_s).abs() < 0.1);
}

#[test]
fn a_safety_mode_that_changes_is_a_breach_of_a_move() {
    let mut watch = Watch::with(-5.0, 0.0);
    assert_eq!(watch.tick(Regime::Outside), "");
    watch.measured.safety_mode = SafetyMode::Reduced;
    assert_eq!(watch.tick(Regime::Outside), "MODE_CHANGED");
    assert_eq!(watch.tick(Regime::Outside), "");
    watch.measured.safety_mode = SafetyMode::Normal;
    assert_eq!(watch.tick(Regime::Standing), "");
}

#[test]
fn a_shaft_half_way_to_the_stop_limit_is_a_warning_until_it_is_clearly_back() {
    let mut watch = Watch::with(30.0, 0.0);
    let mut warning = |aside_mm: f64| {
        watch.portal = Watch::with(30.0, aside_mm).portal;
        watch.observe().warning_mm.is_some()
    };
    assert!(!warning(0.49));
    assert!(warning(0.51));
    assert!(warning(0.45), "one episode");
    assert!(!warning(0.39));
    assert!(!warning(0.45));
    assert!(Watch::with(-30.0, 0.6).observe().warning_mm.is_none());
}

#[test]
fn an_arm_beyond_a_plane_is_a_breach_until_that_is_acknowledged_and_then_goes_no_farther() {
    let mut watch = Watch::with(-50.0, 0.0);
    let tip_mm = watch.observe().base_from_tool.origin().z;
    watch.supervisor.limits.planes = vec![Plane {
        name: "table".to_owned(),
        normal: [0.0, 0.0, 1.0],
        offset_mm: tip_mm + 2.0,
        keeps: vec![Part::Tip],
    }];
    assert_eq!(watch.tick(Regime::Standing), "");
    let breach = watch.judge(Regime::Outside).unwrap();
    assert_eq!(breach.reason, "WORKSPACE");
    assert_eq!(
        breach.detail,
        "room of the tip to the plane table is -2.000 mm; limit 0.000 mm"
    );
    let seen = watch.observe();
    watch.supervisor.acknowledge(&seen);
    assert_eq!(watch.tick(Regime::Outside), "");
    watch.supervisor.limits.planes[0].offset_mm = tip_mm + 3.5;
    assert_eq!(watch.tick(Regime::Outside), "WORKSPACE");
    // Once back, it is held to the plane again.
    watch.supervisor.limits.planes[0].offset_mm = tip_mm - 1.0;
    assert_eq!(watch.tick(Regime::Outside), "");
    watch.supervisor.limits.planes[0].offset_mm = tip_mm + 1.0;
    assert_eq!(watch.tick(Regime::Outside), "WORKSPACE");
}

mod two_arms {
    use super::*;
    use crate::clearance::Clearance;

    /// Two arms that stand face to face, so that their shafts point at each other.
    fn facing(gap_mm: f64) -> [Watch; 2] {
        let mut watches = [Watch::with(-50.0, 0.0), Watch::with(-50.0, 0.0)];
        let arm = watches[0].supervisor.arm;
        let shape = ArmShape::new(&arm, ToolShape::default());
        let pose = arm.base_from_tool(&JOINTS);
        // The other base is half a turn about the vertical through a point ahead of the tip.
        let half = Rotation::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
        let level = Vector3::new(shaft(&pose).x, shaft(&pose).y, 0.0).normalize();
        let middle = pose.origin() + level * (0.5 * gap_mm);
        let middle = Vector3::new(middle.x, middle.y, 0.0);
        let base = Rigid::new(half, middle - half * middle);
        let berths = Berth::beside(Clearance::new((arm, shape), (arm, shape), base));
        for (watch, berth) in watches.iter_mut().zip(berths) {
            watch.supervisor = Supervisor::new(arm, Limits::default(), berth);
        }
        watches
    }

    #[test]
    fn an_arm_that_moves_stops_before_the_other_and_one_that_stands_does_not_mind() {
        let [mut moving, mut other] = facing(0.5);
        other.tick(Regime::Standing);
        assert_eq!(moving.tick(Regime::Outside), "ARMS_TOO_NEAR");
        assert_eq!(moving.tick(Regime::Standing), "");
        let [mut moving, mut other] = facing(30.0);
        other.tick(Regime::Standing);
        assert_eq!(moving.tick(Regime::Outside), "");
    }

    #[test]
    fn arms_too_near_may_part_once_that_is_acknowledged() {
        let [mut moving, mut other] = facing(0.5);
        other.tick(Regime::Standing);
        let seen = moving.observe();
        moving.supervisor.acknowledge(&seen);
        assert_eq!(moving.tick(Regime::Outside), "");
        let shafts_mm = moving.supervisor.keep().shafts_mm;
        assert!(shafts_mm < 0.0, "{shafts_mm}");
        moving.measured.joints_rad[0] += 0.2;
        moving.tick(Regime::Outside);
        assert_eq!(moving.supervisor.keep(), Keep::of(&Limits::default()));
    }

    #[test]
    fn an_arm_whose_neighbour_is_not_heard_of_does_not_move_but_may_be_drawn_back() {
        let [mut moving, _] = facing(200.0);
        assert_eq!(moving.tick(Regime::Outside), "OTHER_ARM_UNKNOWN");
        assert_eq!(moving.tick(Regime::Outward), "");
        assert_eq!(moving.tick(Regime::Standing), "");
    }

    #[test]
    fn a_neighbour_that_falls_silent_is_where_its_speed_may_have_brought_it_and_then_unknown() {
        let [mut moving, mut other] = facing(12.0);
        other.tick(Regime::Outside);
        assert_eq!(moving.tick(Regime::Outside), "");
        other.measured.joints_rad[0] += 0.005;
        other.tick(Regime::Outside);
        assert_eq!(moving.tick(Regime::Outside), "");
        // Some 4 mm in a cycle: after a few without news the shafts may have met.
        let reasons: Vec<_> = (0..30).map(|_| moving.tick(Regime::Outside)).collect();
        let near = reasons.iter().position(|reason| *reason == "ARMS_TOO_NEAR");
        let unknown = reasons
            .iter()
            .position(|reason| *reason == "OTHER_ARM_UNKNOWN");
        assert!(near.unwrap() < unknown.unwrap(), "{reasons:?}");
        assert_eq!(reasons[29], "OTHER_ARM_UNKNOWN");
        other.tick(Regime::Standing);
        other.tick(Regime::Standing);
        assert_eq!(moving.tick(Regime::Outside), "");
    }
}
