mod language;
mod movement;
mod sockets;

use proptest::prelude::*;

use super::{Ending, Machine};
use crate::ur5::{
    Config, Series,
    robot::{Message, Robot},
};

fn compile(text: &str) -> Result<super::Program, super::Error> {
    super::compile(text, Series::Cb3.default_version())
}

/// Runs a program for at most so many cycles of a robot that stands ready.
struct Run {
    robot: Robot,
    ending: Option<Ending>,
}

impl Run {
    fn of(text: &str, cycles: usize) -> Self {
        Self::on(text, cycles, Series::Cb3, "3.15.8")
    }

    fn on(text: &str, cycles: usize, series: Series, version: &str) -> Self {
        let version = version.parse().unwrap();
        let program =
            super::compile(text, version).unwrap_or_else(|error| panic!("{error}\n{text}"));
        let mut robot = Robot::new(Config {
            powered: true,
            version: Some(version),
            ..Config::of(series)
        });
        let mut machine = Machine::new(program, &mut robot);
        let mut ending = None;
        for _ in 0..cycles {
            ending = machine.step(&mut robot);
            if ending.is_some() {
                break;
            }
            robot.advance();
        }
        Self { robot, ending }
    }

    /// What `textmsg` said.
    fn said(&self) -> Vec<String> {
        let text = |message: &Message| match message {
            Message::Text(text) => Some(text.clone()),
            _ => None,
        };
        self.robot.log.since(0).filter_map(text).collect()
    }
}

/// What a program of these lines says.
fn say(lines: &str) -> Vec<String> {
    said_by(lines, Series::Cb3, "3.15.8")
}

fn said_by(lines: &str, series: Series, version: &str) -> Vec<String> {
    let text = format!("def test():\n{lines}\nend\n");
    let run = Run::on(&text, 1000, series, version);
    assert_eq!(run.ending, Some(Ending::Finished), "{lines}");
    run.said()
}

fn failure(lines: &str) -> String {
    match Run::of(&format!("def test():\n{lines}\nend\n"), 1000).ending {
        Some(Ending::Failed(error)) => error.to_string(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn arithmetic_follows_the_usual_precedence() {
    assert_eq!(say("textmsg(1 + 2 * 3 - 4 / 2)"), ["5"]);
    assert_eq!(say("textmsg(7 / 2)"), ["3.5"]);
    assert_eq!(say("textmsg(-2 * -(3 + 1) % 5)"), ["3"]);
    assert_eq!(say("textmsg(1 < 2 and not 2 <= 1 or False)"), ["True"]);
    assert_eq!(say("textmsg(True xor True)"), ["False"]);
    assert_eq!(say("textmsg(1e-3 + .5)"), ["0.501"]);
}

#[test]
fn branches_and_loops_take_their_way() {
    let lines = "
      i = 0
      while True:
        i = i + 1
        if i == 2:
          continue
        elif i > 4:
          break
        else:
          textmsg(\"i=\", i)
        end
      end";
    assert_eq!(say(lines), ["i=1", "i=3", "i=4"]);
}

#[test]
fn functions_take_arguments_by_position_name_and_default() {
    let lines = "
      def scaled(x, factor=10, offset=0):
        return x * factor + offset
      end
      textmsg(scaled(1))
      textmsg(scaled(1, offset=5))
      textmsg(scaled(2, 3, 1))";
    assert_eq!(say(lines), ["10", "15", "7"]);
}

#[test]
fn a_name_is_local_unless_a_global_of_that_name_exists() {
    let lines = "
      global known = 1
      def change():
        known = 2
        fresh = 3
        local hidden = 4
        return fresh + hidden
      end
      textmsg(change())
      textmsg(known)
      textmsg(fresh)";
    let run = Run::of(&format!("def test():\n{lines}\nend"), 10);
    assert_eq!(run.said(), ["7", "2"]);
    assert!(matches!(run.ending, Some(Ending::Failed(error)) if error.text.contains("fresh")));
}

#[test]
fn lists_are_values_and_poses_are_made_of_six_numbers() {
    let lines = "
      a = [1, 2, 3]
      b = a
      b[1] = 20
      textmsg(a)
      textmsg(b[1] + length(b))
      p1 = p[0.1, 0, 0, 0, 0, 0]
      p1[2] = 0.5
      textmsg(norm(pose_trans(p1, pose_inv(p1))))
      textmsg(pose_add(p1, p1)[2])";
    assert_eq!(say(lines), ["[1, 2, 3]", "23", "0", "1"]);
}

#[test]
fn the_right_side_of_and_and_or_is_left_alone_when_it_does_not_matter() {
    let lines = "
      def shout(answer):
        textmsg(\"called\")
        return answer
      end
      a = False and shout(True)
      b = True or shout(True)
      c = True and shout(False)
      textmsg(a, b)";
    assert_eq!(say(lines), ["called", "FalseTrue"]);
}

#[test]
fn threads_run_side_by_side_and_can_be_killed_and_joined() {
    let lines = "
      global count = 0
      thread counter():
        while True:
          count = count + 1
          sync()
        end
      end
      thread brief():
        sleep(0.1)
        textmsg(\"brief ends\")
      end
      h = run counter()
      g = run brief()
      join g
      kill h
      before = count
      sleep(0.2)
      textmsg(count - before)
      textmsg(count > 10)";
    assert_eq!(say(lines), ["brief ends", "0", "True"]);
}

#[test]
fn a_critical_section_is_not_interrupted_by_other_threads() {
    // More work than one cycle has room for.
    let lines = "
      global count = 0
      thread counter():
        while True:
          count = count + 1
          sync()
        end
      end
      h = run counter()
      sync()
      enter_critical
      before = count
      i = 0
      while i < 3000:
        i = i + 1
      end
      textmsg(count - before)
      exit_critical
      i = 0
      while i < 3000:
        i = i + 1
      end
      textmsg(count > before)";
    assert_eq!(say(lines), ["0", "True"]);
}

#[test]
fn what_waits_in_a_critical_section_lets_others_run_meanwhile() {
    let lines = "
      global count = 0
      thread counter():
        while True:
          enter_critical
          count = count + 1
          sync()
          exit_critical
        end
      end
      h = run counter()
      enter_critical
      sleep(0.1)
      textmsg(count > 5)
      exit_critical";
    assert_eq!(say(lines), ["True"]);
}

#[test]
fn the_program_ends_with_its_body_and_takes_its_threads_along() {
    let text = "def test():\nthread forever():\nwhile True:\nsync()\nend\nend\nrun forever()\nsleep(0.05)\nend\n";
    assert_eq!(Run::of(text, 20).ending, Some(Ending::Finished));
}

#[test]
fn what_goes_wrong_is_a_runtime_exception_with_its_line() {
    assert_eq!(
        failure("a = [1]\nb = a[3]"),
        "line 3: index 3 in a list of 1"
    );
    assert_eq!(failure("a = 1 / 0"), "line 2: division by zero");
    assert_eq!(
        failure("if 1:\nsync()\nend"),
        "line 2: int where a bool should be"
    );
    assert_eq!(
        failure("def f():\nreturn f()\nend\nf()"),
        "line 3: more than 100 calls inside each other"
    );
    assert_eq!(
        failure("while True:\nrun g()\nend\nthread g():\nsleep(1)\nend"),
        "line 3: more than 50 threads"
    );
    assert!(failure("movej([0, 0])").contains("six numbers"));
    assert!(failure("write_output_integer_register(48, 1)").contains("within 0 to 47"));
    assert!(failure("a = \"x\"\nwhile True:\na = str_cat(a, a)\nend").contains("at most 1023"));
}

#[test]
fn text_that_is_no_program_is_refused_with_its_line() {
    let refused = |text: &str| compile(text).unwrap_err().to_string();
    assert_eq!(
        refused("def a():\nfrobnicate()\nend"),
        "line 2: no function frobnicate"
    );
    assert_eq!(
        refused("def a():\nmovej()\nend"),
        "line 2: movej(): argument q is missing"
    );
    assert_eq!(
        refused("def a():\nmovej([0], speed=1)\nend"),
        "line 2: movej(): no parameter speed is free"
    );
    assert_eq!(
        refused("def a():\nbreak\nend"),
        "line 2: break outside a loop"
    );
    assert!(refused("def a():\nif True:\nsync()\n").contains("where end should be"));
    assert!(refused("x = \"open").contains("string without end"));
    assert!(refused(&format!("x = {}1", "(".repeat(100_000))).contains("nested deeper"));
    assert!(refused(&format!("x = {}1", "1 + ".repeat(100_000))).contains("operators"));
    assert!(refused(&format!("x = {}1", "not ".repeat(100_000))).contains("nested deeper"));
    assert!(refused(&"if True:\n".repeat(100_000)).contains("nested deeper"));
}

#[test]
fn an_endless_loop_does_not_hold_up_the_controller() {
    let run = Run::of("def a():\nwhile True:\nx = 1\nend\nend", 50);
    assert_eq!(run.ending, None);
    let starving = "def a():\nthread t():\nwhile True:\nx = 1\nend\nend\nrun t()\nsleep(0.05)\nend";
    assert_eq!(Run::of(starving, 50).ending, Some(Ending::Finished));
}

#[test]
fn a_secondary_program_may_not_move_the_arm() {
    let run = Run::of(
        "sec s():\nset_standard_digital_out(3, True)\nstopj(2.0)\nend",
        10,
    );
    assert_eq!(run.robot.digital_outputs, 1 << 3);
    assert!(matches!(run.ending, Some(Ending::Failed(error)) if error.text.contains("secondary")));
}

#[test]
fn bare_lines_and_labels_are_a_program() {
    let run = Run::of(
        "$ 1 \"Robot Program\"\ntextmsg(\"a\")\ntextmsg(\"b\") # end\n",
        10,
    );
    assert_eq!(run.said(), ["a", "b"]);
}

const SEED: &str = "def seed(n=3):
  global total = 0
  thread work(step):
    while total < 20:
      enter_critical
      total = total + step
      exit_critical
      sync()
    end
  end
  h = run work(2)
  q = get_actual_joint_positions()
  q[0] = q[0] + 0.01
  movej(q, a=1.4, v=1.05)
  if not (total >= n and True) or q[5] != 0.0:
    movel(pose_trans(get_actual_tcp_pose(), p[0, 0, 0.01, 0, 0, 0]), v=0.2)
  elif total == 1:
    kill h
  else:
    join h
  end
  x = [1, -2.5e0, \"text\", p[1,2,3,4,5,6]]
  textmsg(x, to_str(total))
  halt
end
";

proptest! {
    #[test]
    fn random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let _ = compile(&String::from_utf8_lossy(&bytes));
    }

    #[test]
    fn a_damaged_program_never_panics(
        edits in proptest::collection::vec((0..SEED.len(), 0..SEED.len(), 0..30usize, 0..3u8), 1..6),
    ) {
        let mut text = SEED.as_bytes().to_vec();
        for (to, from, length, kind) in edits {
            let piece: Vec<u8> = SEED.bytes().skip(from).take(length).collect();
            let to = to.min(text.len());
            match kind {
                0 => drop(text.drain(to..(to + length).min(text.len()))),
                1 => drop(text.splice(to..to, piece)),
                _ => drop(text.splice(to..(to + piece.len()).min(text.len()), piece)),
            }
        }
        let text = String::from_utf8_lossy(&text).into_owned();
        if let Ok(program) = compile(&text) {
            let mut robot = Robot::new(Config { powered: true, ..Config::default() });
            let mut machine = Machine::new(program, &mut robot);
            for _ in 0..20 {
                if machine.step(&mut robot).is_some() {
                    break;
                }
                robot.advance();
            }
        }
    }
}

#[test]
fn a_value_may_stand_on_the_next_line_and_a_statement_behind_it() {
    let text = "def a():\n  global x = # offset\n0    global y = 2\n  textmsg(x + y)\nend\n";
    assert_eq!(Run::of(text, 10).said(), ["2"]);
}

#[test]
fn a_variable_may_be_named_p() {
    let lines = "
      def first(p):
        p[0] = p[0] * 2
        return p[0] + p[5]
      end
      textmsg(first(p[1, 2, 3, 4, 5, 6]))";
    assert_eq!(say(lines), ["8"]);
}

#[test]
fn killing_a_handle_that_was_never_run_does_nothing() {
    assert_eq!(say("h = 0\nkill h\ntextmsg(1)"), ["1"]);
}
