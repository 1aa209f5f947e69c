mod inputs;
mod loopback;
mod modes;
mod readers;
mod wires;

use ur_link::{RobotMode, RuntimeState, SafetyMode};

use super::{Config, Controller, Message, kinematics, motion::largest_difference};

/// A controller that stands ready, with shortcuts to let time pass.
struct Bench(Controller);

impl Bench {
    fn ready() -> Self {
        Self(Controller::new(Config {
            powered: true,
            ..Config::default()
        }))
    }

    fn off() -> Self {
        Self(Controller::new(Config::default()))
    }

    fn pass(&mut self, seconds: f64) {
        for _ in 0..(seconds / self.0.step_s()).round() as usize {
            self.0.tick();
        }
    }

    /// Runs a program to its end and gives the seconds it took.
    fn run(&mut self, lines: &str) -> f64 {
        let start_s = self.0.timestamp_s();
        self.0
            .load_program(&format!("def test():\n{lines}\nend\n"))
            .unwrap();
        while self.0.runtime_state() == RuntimeState::Playing {
            self.0.tick();
            assert!(
                self.0.timestamp_s() - start_s < 100.0,
                "program does not end"
            );
        }
        self.0.timestamp_s() - start_s
    }

    fn exceptions(&self) -> Vec<String> {
        let text = |message: &Message| match message {
            Message::RuntimeException { text, .. } | Message::Error { text, .. } => {
                Some(text.clone())
            }
            _ => None,
        };
        self.0.robot.log.since(0).filter_map(text).collect()
    }
}

#[test]
fn power_and_brakes_take_their_time() {
    let mut bench = Bench::off();
    assert_eq!(
        bench.0.dashboard("brake release"),
        "Failed to execute: brake release"
    );
    assert_eq!(bench.0.dashboard("power on"), "Powering on");
    assert_eq!(bench.0.dashboard("robotmode"), "Robotmode: POWER_OFF");
    bench.pass(1.1);
    assert_eq!(bench.0.robot_mode(), RobotMode::PowerOn);
    bench.pass(1.1);
    assert_eq!(bench.0.robot_mode(), RobotMode::Idle);
    assert!(bench.0.load_program("movej([0,0,0,0,0,0])\n").is_err());
    assert_eq!(bench.0.dashboard("brake release"), "Brake releasing");
    bench.pass(1.1);
    assert_eq!(bench.0.dashboard("robotmode"), "Robotmode: RUNNING");
    bench.0.dashboard("power off");
    assert_eq!(bench.0.robot_mode(), RobotMode::PowerOff);
}

#[test]
fn movej_reaches_its_goal_in_the_time_of_a_trapezoid() {
    let mut bench = Bench::ready();
    let seconds = bench.run(
        "q = get_target_joint_positions()\nq[0] = q[0] + 1.0\nmovej(q, a=2.0, v=0.5)\nsleep(0.3)",
    );
    // 1 rad at 0.5 rad/s, 0.25 s each to speed up and slow down count half.
    assert!((seconds - (2.25 + 0.3)).abs() < 0.05, "{seconds}");
    assert!(
        (bench.0.joints_rad()[0] - 1.0).abs() < 1e-6,
        "{:?}",
        bench.0.joints_rad()
    );
}

#[test]
fn movel_keeps_the_tool_on_its_line() {
    let mut bench = Bench::ready();
    bench.run("set_tcp(p[0, 0, 0.31, 0, -1.5707963267948966, 0])");
    let start = bench.0.actual_tool_pose();
    let program = "def line():\nmovel(pose_add(get_target_tcp_pose(), p[0.05, 0.1, -0.06, 0, 0, 0]), a=0.5, v=0.1)\nsleep(0.2)\nend";
    bench.0.load_program(program).unwrap();
    let direction = nalgebra::Vector3::new(0.05, 0.1, -0.06).normalize();
    let mut fastest: f64 = 0.0;
    while bench.0.runtime_state() == RuntimeState::Playing {
        bench.0.tick();
        let pose = bench.0.target_tool_pose();
        let way =
            nalgebra::Vector3::new(pose[0] - start[0], pose[1] - start[1], pose[2] - start[2]);
        assert!((way - direction * way.dot(&direction)).norm() < 1e-9);
        let speed = bench.0.actual_tool_speed();
        fastest = fastest.max(nalgebra::Vector3::new(speed[0], speed[1], speed[2]).norm());
    }
    assert!(fastest > 0.098 && fastest < 0.102, "{fastest}");
    let end = bench.0.actual_tool_pose();
    assert!((end[1] - start[1] - 0.1).abs() < 1e-6);
    assert!(
        largest_difference(
            &[0.0, 0.0, 0.0, end[3], end[4], end[5]],
            &[0.0, 0.0, 0.0, start[3], start[4], start[5]]
        ) < 1e-6
    );
}

#[test]
fn stopl_stops_on_the_line_with_its_deceleration() {
    let mut bench = Bench::ready();
    let program = "def line():
      thread go():
        movel(pose_add(get_target_tcp_pose(), p[0, 0.3, 0, 0, 0, 0]), a=1.0, v=0.2)
      end
      h = run go()
      sleep(0.6)
      kill h
      stopl(0.5)
      write_output_integer_register(0, 1)
      sleep(0.5)
    end";
    let start = bench.0.target_tool_pose();
    bench.0.load_program(program).unwrap();
    let mut stopped_s = 0.0;
    while bench.0.runtime_state() == RuntimeState::Playing {
        bench.0.tick();
        let pose = bench.0.target_tool_pose();
        assert!((pose[0] - start[0]).hypot(pose[2] - start[2]) < 1e-9);
        if bench.0.robot.outputs.ints[0] == 0 {
            stopped_s = bench.0.timestamp_s();
        }
    }
    assert!((stopped_s - 1.0).abs() < 0.03, "{stopped_s}");
    let way = bench.0.target_tool_pose()[1] - start[1];
    // 0.2 s of speeding up, 0.4 s at 0.2 m/s, then 0.2^2 / (2 * 0.5).
    assert!((way - (0.02 + 0.08 + 0.04)).abs() < 0.004, "{way}");
}

#[test]
fn the_speed_slider_stretches_a_move() {
    let mut bench = Bench::ready();
    bench.0.set_speed_slider(0.5);
    bench.pass(0.1);
    let seconds =
        bench.run("q = get_target_joint_positions()\nq[0] = q[0] + 1.0\nmovej(q, a=2.0, v=0.5)");
    assert!((seconds - 4.5).abs() < 0.1, "{seconds}");
}

#[test]
fn a_protective_stop_ends_the_program_and_can_be_unlocked_after_five_seconds() {
    let mut bench = Bench::ready();
    bench
        .0
        .load_program("def go():\nmovej([1, -1.7, 1.9, -1.77, -1.57, 0], v=0.5)\nend")
        .unwrap();
    bench.pass(1.0);
    bench.0.protective_stop("collision");
    bench.pass(0.5);
    assert_eq!(
        (bench.0.safety_mode(), bench.0.runtime_state()),
        (SafetyMode::ProtectiveStop, RuntimeState::Stopped)
    );
    assert_eq!(
        bench.0.speeds_rad_s(),
        bench
            .0
            .speeds_rad_s()
            .map(|speed| if speed.abs() < 1e-6 { speed } else { 1.0 })
    );
    let stopped_at = bench.0.joints_rad();
    assert!(
        bench
            .0
            .dashboard("unlock protective stop")
            .starts_with("Cannot unlock")
    );
    assert!(bench.0.load_program("def again():\nsync()\nend").is_err());
    bench.pass(4.6);
    assert_eq!(
        bench.0.dashboard("unlock protective stop"),
        "Protective stop releasing"
    );
    bench.pass(1.0);
    assert_eq!(bench.0.dashboard("safetymode"), "Safetymode: NORMAL");
    assert!(largest_difference(&bench.0.joints_rad(), &stopped_at) < 1e-6);
}

#[test]
fn commands_beyond_a_limit_are_a_protective_stop() {
    for (lines, word) in [
        ("movej([7, -1.7, 1.9, -1.77, -1.57, 0])", "limit 6.33"),
        (
            "movel(pose_add(get_target_tcp_pose(), p[0, 0, 2, 0, 0, 0]), v=0.5)",
            "protective stop",
        ),
        ("while True:\nservoj([2, 0, 0, 0, 0, 0])\nend", "rad/s"),
        ("speedj([4, 0, 0, 0, 0, 0], 20, 5)", "rad/s"),
    ] {
        let mut bench = Bench::ready();
        bench.run(lines);
        assert_eq!(bench.0.safety_mode(), SafetyMode::ProtectiveStop, "{lines}");
        assert!(
            bench.exceptions().iter().any(|text| text.contains(word)),
            "{lines}: {:?}",
            bench.exceptions()
        );
    }
}

#[test]
fn a_watchdog_stops_a_program_whose_client_is_silent() {
    let mut bench = Bench::ready();
    bench.0.load_program("def w():\nrtde_set_watchdog(\"input_int_register_24\", 10, \"stop\")\nwhile True:\nsync()\nend\nend").unwrap();
    let input = super::Input::from_name("input_int_register_24").unwrap();
    for _ in 0..20 {
        bench.pass(0.048);
        bench
            .0
            .write_input(input, ur_link::rtde::wire::Value::Int32(1));
    }
    assert_eq!(bench.0.runtime_state(), RuntimeState::Playing);
    bench.pass(0.2);
    assert_eq!(bench.0.runtime_state(), RuntimeState::Stopped);
}

#[test]
fn pause_slows_down_on_the_path_and_play_goes_on() {
    let mut bench = Bench::ready();
    bench
        .0
        .load_program("def go():\nmovej([1, -1.7, 1.9, -1.77, -1.57, 0], v=0.5)\nend")
        .unwrap();
    bench.pass(1.0);
    assert_eq!(bench.0.dashboard("pause"), "Pausing program");
    bench.pass(0.5);
    let paused_at = bench.0.joints_rad();
    bench.pass(1.0);
    assert!(largest_difference(&paused_at, &bench.0.joints_rad()) < 1e-6);
    assert_eq!(bench.0.dashboard("programState"), "PAUSED go");
    assert_eq!(bench.0.dashboard("play"), "Starting program");
    bench.pass(3.0);
    assert!((bench.0.joints_rad()[0] - 1.0).abs() < 1e-6);
}

#[test]
fn the_flange_is_where_the_true_joints_put_it() {
    let mut bench = Bench::ready();
    bench.run("movej([0.4, -1.2, 1.4, -1.0, -1.2, 0.3])");
    assert_eq!(
        bench.0.flange(),
        kinematics::UR5.flange(&bench.0.joints_rad())
    );
}
