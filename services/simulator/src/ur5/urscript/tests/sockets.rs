//! Sockets of programs, against a network that the test plays.

use std::{
    collections::VecDeque,
    sync::{Arc, Mutex},
};

use super::Run;
use crate::ur5::{
    Config,
    robot::Robot,
    urscript::{Connection, Ending, Machine, Network, State, compile},
};

#[derive(Debug, Default)]
struct Wire {
    state: Option<State>,
    to_program: VecDeque<u8>,
    from_program: Vec<u8>,
}

/// One peer, whom every address reaches.
#[derive(Clone, Debug, Default)]
struct Peer(Arc<Mutex<Wire>>);

impl Network for Peer {
    fn connect(&self, host: &str, port: u16) -> Result<Box<dyn Connection>, String> {
        assert_eq!((host, port), ("10.0.0.1", 50001));
        self.0
            .lock()
            .unwrap()
            .state
            .get_or_insert(State::Connecting);
        Ok(Box::new(self.clone()))
    }
}

impl Connection for Peer {
    fn state(&mut self) -> State {
        self.0.lock().unwrap().state.unwrap()
    }

    fn receive(&mut self, into: &mut Vec<u8>, at_most: usize) {
        let mut wire = self.0.lock().unwrap();
        let count = wire.to_program.len().min(at_most);
        into.extend(wire.to_program.drain(..count));
    }

    fn send(&mut self, bytes: &[u8]) -> bool {
        self.0.lock().unwrap().from_program.extend_from_slice(bytes);
        true
    }
}

/// A program beside its peer.
struct Talk {
    peer: Peer,
    run: Run,
    machine: Machine,
}

impl Talk {
    fn of(lines: &str, state: State) -> Self {
        let peer = Peer::default();
        peer.0.lock().unwrap().state = Some(state);
        let config = Config {
            powered: true,
            ..Config::default()
        };
        let text = format!("def test():\n{lines}\nend");
        let program = compile(&text, config.software()).unwrap();
        let mut robot = Robot::new(config);
        robot.network = Arc::new(peer.clone());
        let machine = Machine::new(program, &mut robot);
        let run = Run {
            robot,
            ending: None,
        };
        Self { peer, run, machine }
    }

    fn cycles(&mut self, count: usize) -> &mut Self {
        for _ in 0..count {
            if self.run.ending.is_none() {
                self.run.ending = self.machine.step(&mut self.run.robot);
                self.run.robot.advance();
            }
        }
        self
    }

    fn hears(&mut self, bytes: &[u8]) -> &mut Self {
        self.peer.0.lock().unwrap().to_program.extend(bytes);
        self
    }

    fn sets(&mut self, state: State) -> &mut Self {
        self.peer.0.lock().unwrap().state = Some(state);
        self
    }

    fn sent(&self) -> Vec<u8> {
        self.peer.0.lock().unwrap().from_program.clone()
    }
}

const OPEN: &str = "open = socket_open(\"10.0.0.1\", 50001, \"s\")\n";

#[test]
fn opening_waits_for_the_connection() {
    let lines = format!("{OPEN}textmsg(open)");
    let mut talk = Talk::of(&lines, State::Connecting);
    assert!(talk.cycles(20).run.said().is_empty());
    assert_eq!(talk.sets(State::Open).cycles(2).run.said(), ["True"]);
    let mut refused = Talk::of(&lines, State::Closed);
    assert_eq!(refused.cycles(3).run.said(), ["False"]);
    let mut silent = Talk::of(&lines, State::Connecting);
    assert_eq!(silent.cycles(260).run.said(), ["False"]);
}

#[test]
fn a_controller_without_network_opens_nothing() {
    let run = Run::of(&format!("def test():\n{OPEN}textmsg(open)\nend"), 10);
    assert_eq!(run.said(), ["False"]);
}

#[test]
fn integers_arrive_whole_or_not_at_all() {
    let lines = format!(
        "{OPEN}
        textmsg(socket_read_binary_integer(2, \"s\", 0.1))
        textmsg(socket_read_binary_integer(2, \"s\", 0.1))"
    );
    let mut talk = Talk::of(&lines, State::Open);
    talk.cycles(3).hears(&[0, 0, 0, 7, 255, 255]);
    assert_eq!(talk.cycles(14).run.said(), ["[0, -1, -1]"]);
    talk.hears(&[255, 254]);
    assert_eq!(talk.cycles(14).run.said()[1], "[2, 7, -2]");
}

#[test]
fn a_timeout_of_zero_waits_until_the_other_side_closes() {
    let lines = format!("{OPEN}textmsg(socket_read_binary_integer(1, \"s\", 0))");
    let mut talk = Talk::of(&lines, State::Open);
    assert!(talk.cycles(1000).run.said().is_empty());
    assert_eq!(talk.sets(State::Closed).cycles(3).run.said(), ["[0, -1]"]);
}

#[test]
fn text_is_read_by_line_by_frame_and_by_number() {
    let lines = format!(
        "{OPEN}
        textmsg(socket_read_line(\"s\"))
        textmsg(socket_read_string(\"s\", prefix=\"<\", suffix=\">\"))
        textmsg(socket_read_ascii_float(2, \"s\"))
        textmsg(socket_read_byte_list(2, \"s\"))
        textmsg(socket_get_var(\"POS_X\", \"s\"))"
    );
    let mut talk = Talk::of(&lines, State::Open);
    talk.hears(b"hello\r\nnoise<inner>(1.5, -2)\x07\x08POS_X 42\n");
    assert_eq!(
        talk.cycles(20).run.said(),
        ["hello", "inner", "[2, 1.5, -2]", "[2, 7, 8]", "42"]
    );
    assert_eq!(talk.sent(), b"GET POS_X\n");
}

#[test]
fn what_is_sent_goes_out_as_the_manual_says() {
    let lines = format!(
        "{OPEN}
        socket_send_int(-2, \"s\")
        socket_send_byte(65, \"s\")
        socket_send_string(\"x\", \"s\")
        socket_send_line(1.5, \"s\")
        socket_set_var(\"n\", 3, \"s\")
        socket_close(\"s\")
        textmsg(socket_send_int(1, \"s\"))"
    );
    let mut talk = Talk::of(&lines, State::Open);
    assert_eq!(talk.cycles(10).run.said(), ["False"]);
    assert_eq!(talk.sent(), b"\xff\xff\xff\xfeAx1.5\nSET n 3\n");
}

#[test]
fn a_read_in_a_critical_section_lets_the_arm_move_meanwhile() {
    let lines = format!(
        "{OPEN}
        global cycles = 0
        thread servo():
          while True:
            enter_critical
            servoj(get_target_joint_positions(), t=0.008)
            cycles = cycles + 1
            exit_critical
          end
        end
        h = run servo()
        enter_critical
        m = socket_read_binary_integer(1, \"s\", 0.5)
        textmsg(cycles > 50)
        exit_critical"
    );
    let mut talk = Talk::of(&lines, State::Open);
    assert_eq!(talk.cycles(100).run.said(), ["True"]);
    assert_eq!(talk.run.ending, Some(Ending::Finished));
}

#[test]
fn an_endless_sender_does_not_fill_the_memory() {
    let lines = format!(
        "{OPEN}
        while True:
          n = length(socket_read_line(\"s\"))
          sync()
        end"
    );
    let mut talk = Talk::of(&lines, State::Open);
    for _ in 0..50 {
        talk.hears(&[b'x'; 100_000]).cycles(1);
    }
    // What the program does not take stays with the sender.
    assert!(talk.peer.0.lock().unwrap().to_program.len() > 4_000_000);
    assert_eq!(talk.run.ending, None);
}
