//! Every rule of the watch, broken once on the way of a move: the arm is told to stop within two
//! controller cycles, with the right reason.

use ur_link::{RobotMode, SafetyMode};

use super::*;
use crate::arm::fake::Robot;
use crate::workspace::{Part, Plane};

/// How a rule is broken, and what must come of it.
struct Case {
    reason: &'static str,
    limits: fn(&mut Limits),
    /// Where the move begins: the depth, mm.
    from_mm: f64,
    wanted: fn(&Cell) -> Move,
    break_it: fn(&mut Robot),
    /// A value and a limit that the detail names.
    told: [&'static str; 2],
}

fn keep_limits(_: &mut Limits) {}

fn deeper(_: &Cell) -> Move {
    insert(60.0)
}

fn aside(cell: &Cell) -> Move {
    pivot(cell, 0.4)
}

fn away(cell: &Cell) -> Move {
    free(cell, -60.0, 120.0)
}

const CASES: &[Case] = &[
    Case {
        reason: "RCM_DEVIATION",
        limits: keep_limits,
        from_mm: 30.0,
        wanted: deeper,
        break_it: |robot| robot.encoder_error[0] = 0.008,
        told: ["distance of the shaft to the portal is", "limit 1.000 mm"],
    },
    Case {
        reason: "TOO_DEEP",
        limits: |limits| limits.rcm_stop_mm = 100.0,
        from_mm: 79.0,
        wanted: |_| insert(80.0),
        break_it: |robot| robot.forward_mm = 5.0,
        told: ["depth beyond the portal is", "limit 80.500 mm"],
    },
    Case {
        reason: "CONE",
        limits: |limits| {
            limits.rcm_stop_mm = 100.0;
            limits.cone_max_rad = 0.2;
        },
        from_mm: 30.0,
        wanted: deeper,
        break_it: |robot| robot.encoder_error[4] = 0.25,
        told: [
            "angle of the shaft to the axis of the portal is",
            "limit 0.210 rad",
        ],
    },
    Case {
        reason: "JOINT_SPEED",
        limits: keep_limits,
        from_mm: -5.0,
        wanted: aside,
        break_it: |robot| robot.speed_error[3] = 3.0,
        told: ["speed of joint 4 is", "limit 1.200 rad/s"],
    },
    Case {
        reason: "TIP_SPEED_INSIDE",
        limits: keep_limits,
        from_mm: 30.0,
        wanted: deeper,
        break_it: |robot| robot.speed_error[0] = 0.1,
        told: ["speed of the tip inside is", "limit 40.000 mm/s"],
    },
    Case {
        reason: "WORKSPACE",
        limits: |limits| {
            limits.planes = vec![Plane {
                name: "wall".to_owned(),
                normal: [1.0, 0.0, 0.0],
                offset_mm: 350.0,
                keeps: vec![Part::Tip],
            }];
        },
        from_mm: -60.0,
        wanted: away,
        break_it: |robot| robot.encoder_error[0] = 1.2,
        told: ["room of the tip to the plane wall is -", "limit 0.000 mm"],
    },
    Case {
        reason: "TOOL_INSIDE",
        limits: keep_limits,
        from_mm: -60.0,
        wanted: away,
        break_it: |robot| robot.forward_mm = 120.0,
        told: [
            "depth beyond the portal in a move outside is",
            "limit 0.000 mm",
        ],
    },
    Case {
        reason: "STATE_STALE",
        limits: keep_limits,
        from_mm: -5.0,
        wanted: aside,
        break_it: |robot| robot.gap_s = 0.2,
        told: [
            "controller time since the state before is 0.2",
            "limit 0.100 s",
        ],
    },
    Case {
        reason: "STATE_UNKNOWN",
        limits: keep_limits,
        from_mm: -5.0,
        wanted: aside,
        break_it: |robot| robot.encoder_error[2] = f64::NAN,
        told: ["a measured joint", "is no number"],
    },
    Case {
        reason: "SAFETY_MODE",
        limits: keep_limits,
        from_mm: 30.0,
        wanted: deeper,
        break_it: |robot| robot.safety_mode = SafetyMode::ProtectiveStop,
        told: [
            "safety mode is PROTECTIVE_STOP",
            "must be NORMAL or REDUCED",
        ],
    },
    Case {
        reason: "SAFETY_MODE",
        limits: keep_limits,
        from_mm: 30.0,
        wanted: deeper,
        break_it: |robot| robot.safety_mode = SafetyMode::RobotEmergencyStop,
        told: [
            "safety mode is ROBOT_EMERGENCY_STOP",
            "must be NORMAL or REDUCED",
        ],
    },
    Case {
        reason: "SAFETY_MODE",
        limits: keep_limits,
        from_mm: -60.0,
        wanted: away,
        break_it: |robot| robot.safety_mode = SafetyMode::SafeguardStop,
        told: ["safety mode is SAFEGUARD_STOP", "must be NORMAL or REDUCED"],
    },
    Case {
        reason: "MODE_CHANGED",
        limits: keep_limits,
        from_mm: 30.0,
        wanted: deeper,
        break_it: |robot| robot.safety_mode = SafetyMode::Reduced,
        told: [
            "safety mode was NORMAL and is REDUCED",
            "must not change during a move",
        ],
    },
    Case {
        reason: "ROBOT_MODE",
        limits: keep_limits,
        from_mm: 30.0,
        wanted: deeper,
        break_it: |robot| robot.robot_mode = RobotMode::Idle,
        told: ["robot mode is IDLE", "must be RUNNING"],
    },
];

impl Case {
    async fn run(&self) {
        let mut limits = Limits::default();
        (self.limits)(&mut limits);
        let mut cell = Cell::limited(limits).await;
        if self.from_mm > -20.0 {
            cell.go_to_depth(self.from_mm).await;
        }
        let wanted = (self.wanted)(&cell);
        let mut progress = cell.begin(wanted).await.unwrap();
        under_way(&mut progress).await;
        let before = {
            let mut robot = cell.robot.lock();
            (self.break_it)(&mut robot);
            robot.commands.len()
        };
        cell.published(|published| published.state.as_ref().unwrap().fault.is_some())
            .await;
        // A sensor that showed a speed for ever would leave the arm stopping for ever.
        cell.robot.lock().speed_error = [0.0; 6];
        let progress = ended(&mut progress).await;
        let operation = &progress.operation;
        assert_eq!(
            (operation.state, operation.reason.as_str()),
            (OperationState::Failed, self.reason),
            "{operation:?}"
        );
        for told in self.told {
            let detail = &operation.detail;
            assert!(detail.contains(told), "{}: {detail}", self.reason);
        }
        let commands = cell.commands();
        let stop = commands[before..]
            .iter()
            .position(|command| *command == Command::Stop);
        // One command may have been on its way when the rule was broken; the next is the stop.
        assert!(stop.unwrap() < 2, "{}: {stop:?}", self.reason);
        assert!(
            commands[before + stop.unwrap()..]
                .iter()
                .all(|command| *command == Command::Stop),
            "{}: something was commanded after the stop",
            self.reason
        );
        let fault = cell.state().await.fault.unwrap();
        assert_eq!(fault.reason, self.reason);
        assert_eq!(cell.refusal(insert(61.0)).await, "FAULT_LATCHED");
    }
}

#[tokio::test]
async fn every_rule_that_is_broken_stops_the_arm_within_two_cycles_and_says_why() {
    for case in CASES {
        case.run().await;
    }
}

#[tokio::test]
async fn after_an_acknowledged_fault_inside_the_way_on_is_out() {
    let mut cell = Cell::new().await;
    cell.go_to_depth(30.0).await;
    let mut progress = cell.begin(insert(60.0)).await.unwrap();
    under_way(&mut progress).await;
    cell.robot.lock().safety_mode = SafetyMode::SafeguardStop;
    ended(&mut progress).await;
    cell.robot.lock().safety_mode = SafetyMode::Normal;
    cell.state().await;
    cell.recover().await.unwrap();
    for wanted in [insert(60.0), pivot(&cell, 0.1), free(&cell, -60.0, 0.0)] {
        let refusal = cell.begin(wanted).await.unwrap_err();
        assert_eq!(refusal.reason(), "RETRACT_ONLY");
        assert!(refusal.to_string().contains("after SAFETY_MODE the tip"));
    }
    // Part of the way is not out.
    cell.carry_out(retract(10.0)).await.unwrap();
    assert_eq!(cell.refusal(insert(20.0)).await, "RETRACT_ONLY");
    cell.carry_out(retract(-5.0)).await.unwrap();
    cell.carry_out(insert(20.0)).await.unwrap();
}

#[tokio::test]
async fn a_shaft_on_its_way_off_the_portal_is_a_warning_and_the_arm_goes_on() {
    let mut cell = Cell::new().await;
    cell.go_to_depth(30.0).await;
    assert_eq!(cell.state().await.warning, None);
    let mut progress = cell.begin(insert(60.0)).await.unwrap();
    under_way(&mut progress).await;
    // 0.001 rad about the base at some 700 mm.
    cell.robot.lock().encoder_error[0] = 0.001;
    let warned = cell
        .published(|published| published.state.as_ref().unwrap().warning.is_some())
        .await;
    let warning = warned.state.unwrap().warning.unwrap();
    assert_eq!(warning.reason, "RCM_DEVIATION");
    assert!(
        warning
            .detail
            .contains("warning from 0.500 mm, stop beyond 1.000 mm"),
        "{}",
        warning.detail
    );
    cell.robot.lock().encoder_error[0] = 0.0;
    assert_eq!(
        ended(&mut progress).await.operation.state,
        OperationState::Done
    );
    assert_eq!(cell.state().await.warning, None);
}

#[tokio::test]
async fn an_arm_beyond_a_plane_moves_back_once_that_is_acknowledged() {
    let pose = tool_arm().base_from_tool(&START);
    let limits = Limits {
        planes: vec![Plane {
            name: "table".to_owned(),
            normal: [0.0, 0.0, 1.0],
            offset_mm: pose.origin().z + 5.0,
            keeps: vec![Part::Tip],
        }],
        ..Limits::default()
    };
    let mut cell = Cell::limited(limits).await;
    let up = free(&cell, -80.0, 40.0);
    let refusal = cell.begin(up.clone()).await.unwrap_err();
    assert_eq!(refusal.reason(), "WORKSPACE");
    cell.recover().await.unwrap();
    assert_eq!(cell.refusal(free(&cell, -80.0, -40.0)).await, "WORKSPACE");
    let progress = cell.carry_out(up).await.unwrap();
    assert_eq!(
        progress.operation.state,
        OperationState::Done,
        "{progress:?}"
    );
    assert_eq!(cell.refusal(free(&cell, -80.0, 0.0)).await, "WORKSPACE");
}
