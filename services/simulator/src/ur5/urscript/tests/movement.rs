//! Paths: corners, arcs, and who may move.

use super::{Run, failure};
use crate::ur5::{
    Config,
    kinematics::Joints,
    robot::Robot,
    urscript::{Ending, Machine, compile},
};

/// The tool of every cycle of a program, and the cycle in which it ended.
fn track(lines: &str) -> (Vec<Joints>, Run) {
    let config = Config {
        powered: true,
        ..Config::default()
    };
    let program = compile(&format!("def test():\n{lines}\nend"), config.software()).unwrap();
    let mut robot = Robot::new(config);
    let mut machine = Machine::new(program, &mut robot);
    let mut poses = vec![robot.tool_pose(&robot.target.q)];
    let mut ending = None;
    while ending.is_none() && poses.len() < 5000 {
        ending = machine.step(&mut robot);
        robot.advance();
        poses.push(robot.tool_pose(&robot.target.q));
    }
    (poses, Run { robot, ending })
}

fn nearest(poses: &[Joints], to: [f64; 3]) -> f64 {
    let distance = |pose: &Joints| {
        let square = |axis: usize| (pose[axis] - to[axis]).powi(2);
        (square(0) + square(1) + square(2)).sqrt()
    };
    poses.iter().map(distance).fold(f64::MAX, f64::min)
}

const CORNER: &str = "
  start = get_target_tcp_pose()
  movel(pose_add(start, p[0, 0, 0.1, 0, 0, 0]), a=1, v=0.2, r=@)
  movel(pose_add(start, p[0, 0.1, 0.1, 0, 0, 0]), a=1, v=0.2)
  textmsg(norm(pose_sub(get_target_tcp_pose(), pose_add(start, p[0, 0.1, 0.1, 0, 0, 0]))) < 1e-6)";

#[test]
fn a_corner_with_a_radius_is_rounded_without_a_stop() {
    let (sharp, run) = track(&CORNER.replace('@', "0"));
    assert_eq!(run.said(), ["True"]);
    let (round, run) = track(&CORNER.replace('@', "0.02"));
    assert_eq!(
        (run.said(), run.ending),
        (vec!["True".to_owned()], Some(Ending::Finished))
    );
    let start = sharp[0];
    let corner = [start[0], start[1], start[2] + 0.1];
    assert!(nearest(&sharp, corner) < 1e-6);
    let missed = nearest(&round, corner);
    assert!((0.001..0.02).contains(&missed), "{missed}");
    assert!(
        round.len() + 10 < sharp.len(),
        "{} {}",
        round.len(),
        sharp.len()
    );
    // Nowhere a jump: no two cycles are farther apart than the speed allows.
    for pair in round.windows(2) {
        let from = [pair[0][0], pair[0][1], pair[0][2]];
        assert!(nearest(&pair[1..], from) < 0.2 * 1.5 * 0.008);
    }
}

#[test]
fn a_radius_without_a_next_move_leads_to_the_goal() {
    let lines = "
      start = get_target_tcp_pose()
      goal = pose_add(start, p[0, 0, 0.05, 0, 0, 0])
      movel(goal, a=1, v=0.2, r=0.02)
      textmsg(point_dist(get_target_tcp_pose(), goal) > 0.005)
      sleep(1)
      textmsg(point_dist(get_target_tcp_pose(), goal) < 1e-6)";
    assert_eq!(track(lines).1.said(), ["True", "True"]);
}

#[test]
fn a_move_that_is_told_its_time_needs_no_speed() {
    let lines = "
      q = get_target_joint_positions()
      q[0] = q[0] + 0.1
      movej(q, a=0, v=0, t=1)
      textmsg(norm(get_target_joint_positions() - q))";
    let (poses, run) = track(lines);
    assert_eq!(run.said(), ["0"]);
    assert!((124..=130).contains(&poses.len()), "{}", poses.len());
    assert!(failure("movej([0, 0, 0, 0, 0, 0], a=0)").contains("a is 0, must be above 0"));
}

#[test]
fn an_arc_passes_its_via_point() {
    let lines = "
      start = get_target_tcp_pose()
      via = pose_add(start, p[0, 0.05, 0.05, 0, 0, 0])
      goal = pose_add(start, p[0, 0.1, 0, 0, 0, 0])
      movec(via, goal, a=0.5, v=0.1)
      textmsg(norm(pose_sub(get_target_tcp_pose(), goal)) < 1e-6)";
    let (poses, run) = track(lines);
    assert_eq!(run.said(), ["True"]);
    let start = poses[0];
    assert!(nearest(&poses, [start[0], start[1] + 0.05, start[2] + 0.05]) < 1e-3);
    let straight = "s = get_target_tcp_pose()
      movec(pose_add(s, p[0, 0.05, 0, 0, 0, 0]), pose_add(s, p[0, 0.1, 0, 0, 0, 0]))";
    assert!(failure(straight).contains("on a line"));
}

#[test]
fn servoc_brings_the_tool_to_its_goal() {
    let lines = "
      goal = pose_add(get_target_tcp_pose(), p[0, 0.05, 0, 0, 0, 0])
      i = 0
      while i < 200:
        servoc(goal, a=0.5, v=0.1)
        i = i + 1
      end
      textmsg(point_dist(get_target_tcp_pose(), goal) < 1e-6)";
    assert_eq!(track(lines).1.said(), ["True"]);
}

#[test]
fn two_threads_may_not_move_at_once() {
    let lines = "
      thread other():
        movej([0, -1.6, 1.9, -1.77, -1.57, 0.5])
      end
      h = run other()
      sync()
      movel(get_target_tcp_pose())";
    assert!(failure(lines).contains("another thread is already controlling the robot"));
}

#[test]
fn force_mode_is_accepted_and_checked_and_moves_nothing() {
    let lines = "
      q = get_target_joint_positions()
      force_mode(p[0,0,0,0,0,0], [0,0,1,0,0,0], [0,0,-10,0,0,0], 2, [0.1,0.1,0.1,0.1,0.1,0.1])
      sleep(0.2)
      end_force_mode()
      textmsg(norm(get_target_joint_positions() - q))";
    assert_eq!(track(lines).1.said(), ["0"]);
    assert!(
        failure("force_mode(p[0,0,0,0,0,0], [0,0,1,0,0,0], [0,0,0,0,0,0], 9, [1,1,1,1,1,1])")
            .contains("type 9")
    );
}

#[test]
fn what_is_not_modelled_says_so_once_it_is_reached() {
    assert!(failure("track_conveyor_linear(p[0,0,0,0,0,0], 1000)").contains("does not model"));
}
