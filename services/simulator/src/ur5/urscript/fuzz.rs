//! Inputs that nobody would write: whatever arrives at a script interface must neither panic nor take the controller's
//! time or memory. The suite runs a few thousand; `ARTHRO_FUZZ_INPUTS` asks for more, and `ARTHRO_FUZZ_SCRIPTS` names a
//! folder of programs that are damaged along with our own.

use rand::{Rng, SeedableRng, seq::IndexedRandom};
use rand_chacha::ChaCha8Rng;

use super::{Machine, Upload, builtins, compile};
use crate::ur5::{Config, Series, robot::Robot};

const INPUTS: u64 = 4_000;
/// Cycles that a program gets that compiles.
const CYCLES: usize = 3;
/// Lines of a real program that are damaged at a time.
const WINDOW: usize = 60;

const OWN: &str = include_str!("../../../../drivers/ur/src/program/link.script");

/// What the grammar is made of, whole and in pieces.
const TOKENS: &[&str] = &[
    "def",
    "end",
    "thread",
    "sec",
    "if",
    "elif",
    "else",
    "while",
    "break",
    "continue",
    "return",
    "run",
    "kill",
    "join",
    "global",
    "local",
    "and",
    "or",
    "xor",
    "not",
    "True",
    "False",
    "None",
    "enter_critical",
    "exit_critical",
    "halt",
    "(",
    ")",
    "[",
    "]",
    ",",
    ":",
    ".",
    "=",
    "==",
    "!=",
    "<",
    ">=",
    "+",
    "-",
    "*",
    "/",
    "%",
    "p[",
    "\n",
    "\n",
    "\n",
    ";",
    "#",
    "$",
    "\"",
    "a",
    "b",
    "c",
    "f()",
    "0",
    "1",
    "2.5",
    "1e308",
    "2147483647",
    "4294967296",
    "\"text\"",
    "struct(a=1)",
    "[1, 2, 3]",
    "p[0, 0, 0, 0, 0, 0]",
    "append",
    "pop",
    "@",
    "é",
    "\u{0}",
];

/// Literals that go wrong most easily.
const VALUES: &[&str] = &[
    "0",
    "1",
    "-1",
    "2147483647",
    "-2147483648",
    "0.0",
    "1e308",
    "1e-308",
    "3.5",
    "True",
    "False",
    "\"\"",
    "\"abc\"",
    "[]",
    "[1, 2, 3, 4, 5, 6]",
    "[0, 0, 0, 0, 0, 0]",
    "[[1, 2], [3, 4]]",
    "[0.1, -1.5, 1.2, -1.0, -1.5, 0.3]",
    "p[0.4, 0.1, 0.3, 0, 3.1, 0]",
    "p[0, 0, 0, 0, 0, 0]",
    "struct(a=1, b=[2, 3])",
    "a",
    "b",
    "c",
    "a[0]",
    "b.a",
    "[\"x\", 1]",
];

struct Fuzz {
    rng: ChaCha8Rng,
    scripts: Vec<String>,
}

impl Fuzz {
    fn pick<'t>(&mut self, from: &'t [&'t str]) -> &'t str {
        from.choose(&mut self.rng).copied().unwrap_or_default()
    }

    fn input(&mut self) -> String {
        match self.rng.random_range(0..10) {
            0 => {
                let length = self.rng.random_range(0..200);
                let bytes: Vec<u8> = (0..length).map(|_| self.rng.random()).collect();
                String::from_utf8_lossy(&bytes).into_owned()
            }
            1..=3 => self.soup(),
            4..=5 => self.damaged(),
            _ => self.program(),
        }
    }

    fn soup(&mut self) -> String {
        let count = self.rng.random_range(1..80);
        let mut text = String::new();
        for _ in 0..count {
            text.push_str(self.pick(TOKENS));
            text.push_str(if self.rng.random_bool(0.8) { " " } else { "" });
        }
        text
    }

    /// Some lines of a real program, in a frame that lets them compile, with a few edits.
    fn damaged(&mut self) -> String {
        let script = self
            .scripts
            .choose(&mut self.rng)
            .cloned()
            .unwrap_or_default();
        let lines: Vec<&str> = script.lines().collect();
        let from = self.rng.random_range(0..lines.len().max(1));
        let window = lines.iter().skip(from).take(WINDOW).copied();
        let mut bytes =
            format!("def a():\n{}\nend\n", window.collect::<Vec<_>>().join("\n")).into_bytes();
        for _ in 0..self.rng.random_range(0..4) {
            let at = self.rng.random_range(0..=bytes.len());
            let to = (at + self.rng.random_range(0..20)).min(bytes.len());
            match self.rng.random_range(0..3) {
                0 => drop(bytes.drain(at..to)),
                1 => {
                    let piece = bytes[at..to].to_vec();
                    let target = self.rng.random_range(0..=bytes.len());
                    bytes.splice(target..target, piece);
                }
                _ => {
                    let token = self.pick(TOKENS).as_bytes().to_vec();
                    bytes.splice(at..at, token);
                }
            }
        }
        String::from_utf8_lossy(&bytes).into_owned()
    }

    /// A program that parses more often than not, of calls that mostly make no sense.
    fn program(&mut self) -> String {
        let mut text = "def f(x=1):\nreturn x\nend\nthread t():\n".to_owned();
        self.block(&mut text, 1);
        text.push_str("end\na = 1\nb = [1, 2, 3]\nc = 0.5\n");
        for _ in 0..self.rng.random_range(1..4) {
            self.block(&mut text, 0);
        }
        format!("def main():\n{text}end\n")
    }

    fn block(&mut self, text: &mut String, depth: u32) {
        for _ in 0..self.rng.random_range(1..5) {
            let name = self.pick(&["a", "b", "c", "a[0]", "b[1]", "c.a", "global a", "local b"]);
            match self.rng.random_range(0..12) {
                0 if depth < 3 => {
                    text.push_str(&format!("if {} == {}:\n", self.value(0), self.value(0)));
                    self.block(text, depth + 1);
                    text.push_str("else:\n");
                    self.block(text, depth + 1);
                    text.push_str("end\n");
                }
                1 if depth < 3 => {
                    text.push_str(&format!("while {} < {}:\n", self.value(0), self.value(0)));
                    self.block(text, depth + 1);
                    text.push_str("end\n");
                }
                2 => text.push_str("run t()\n"),
                3 => text.push_str(self.pick(&[
                    "enter_critical\n",
                    "exit_critical\n",
                    "sync()\n",
                    "kill a\n",
                    "join a\n",
                ])),
                4 => text.push_str(&format!(
                    "b.{}({})\n",
                    self.pick(&["append", "insert", "remove", "extend", "pop", "clear"]),
                    self.value(0)
                )),
                5..=7 => text.push_str(&format!("{name} = {}\n", self.value(0))),
                _ => text.push_str(&format!("{}\n", self.call(0))),
            }
        }
    }

    fn value(&mut self, depth: u32) -> String {
        match self.rng.random_range(0..8) {
            0 if depth < 3 => format!(
                "({} {} {})",
                self.value(depth + 1),
                self.pick(&["+", "-", "*", "/", "%", "==", "<", "and", "or", "xor"]),
                self.value(depth + 1)
            ),
            1 | 2 if depth < 3 => self.call(depth + 1),
            3 => format!("{}[{}]", self.pick(&["a", "b", "c"]), self.pick(VALUES)),
            _ => self.pick(VALUES).to_owned(),
        }
    }

    fn call(&mut self, depth: u32) -> String {
        let (name, most, least) = builtins::signatures()
            .choose(&mut self.rng)
            .copied()
            .unwrap_or(("sync", 0, 0));
        let count = self.rng.random_range(least..=most);
        let arguments: Vec<_> = (0..count).map(|_| self.value(depth)).collect();
        format!("{name}({})", arguments.join(", "))
    }
}

fn scripts() -> Vec<String> {
    let mut scripts = vec![OWN.to_owned()];
    if let Some(folder) = std::env::var_os("ARTHRO_FUZZ_SCRIPTS") {
        let files = std::fs::read_dir(folder).unwrap();
        let texts = files.map(|file| std::fs::read(file.unwrap().path()).unwrap());
        scripts.extend(texts.map(|text| String::from_utf8_lossy(&text).into_owned()));
    }
    scripts
}

#[test]
fn no_input_panics_or_outgrows_its_bounds() {
    let inputs = std::env::var("ARTHRO_FUZZ_INPUTS").map_or(INPUTS, |count| count.parse().unwrap());
    let seed = std::env::var("ARTHRO_FUZZ_SEED").map_or(1, |seed| seed.parse().unwrap());
    let mut fuzz = Fuzz {
        rng: ChaCha8Rng::seed_from_u64(seed),
        scripts: scripts(),
    };
    let (mut compiled, mut failed) = (0u64, 0u64);
    for number in 0..inputs {
        let input = fuzz.input();
        if number % 100_000 == 0 {
            println!("{number} inputs");
        }
        let mut upload = Upload::default();
        let units = upload.feed(input.as_bytes()).unwrap();
        let rest = upload.finish();
        for text in units.iter().chain(&rest).take(4) {
            let series = if number % 2 == 0 {
                Series::Cb3
            } else {
                Series::E
            };
            let mut config = Config::of(series);
            config.powered = true;
            let Ok(program) = compile(text, "5.25.1".parse().unwrap()) else {
                continue;
            };
            compiled += 1;
            let mut robot = Robot::new(config);
            let mut machine = Machine::new(program, &mut robot);
            for _ in 0..CYCLES {
                if let Some(ending) = machine.step(&mut robot) {
                    failed += u64::from(ending != super::Ending::Finished);
                    break;
                }
                robot.advance();
                assert!(
                    robot.target.q.iter().all(|joint| joint.is_finite()),
                    "{text}"
                );
            }
        }
    }
    println!("{inputs} inputs, {compiled} programs ran, {failed} runtime exceptions");
    // An input that never compiles tests the parser alone.
    assert!(compiled > inputs / 10 && failed < compiled);
}
