//! Every parser on arbitrary, cut and changed input: none may panic, hang, or keep more than its bound.
//!
//! `ARTHRO_FUZZ_INPUTS=10000000 cargo test --release -p ur-link --test fuzz` is a long run.
#![allow(clippy::unwrap_used, missing_docs)]

use ur_link::{
    Calibration, Model, Script,
    primary::wire::{Message, Notice, Packet},
    realtime,
    rtde::{
        FieldValue, Outputs,
        wire::{self, Frame, Reply, Request, Text, Type, Version, take_values},
    },
    script::Progress,
};

ur_link::outputs! {
    struct State {
        timestamp: f64,
        actual_q: [f64; 6],
        robot_mode: i32,
        output_bit_register_64: bool,
    }
}

/// Inputs of each parser.
fn inputs() -> u64 {
    std::env::var("ARTHRO_FUZZ_INPUTS")
        .ok()
        .map_or(30_000, |text| text.parse().unwrap())
}

/// xorshift64*: quick, and the same in every run.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    fn below(&mut self, limit: usize) -> usize {
        (self.next() >> 33) as usize % limit.max(1)
    }

    fn bytes(&mut self, most: usize) -> Vec<u8> {
        (0..self.below(most)).map(|_| self.next() as u8).collect()
    }
}

/// Feeds what a parser must bear: noise, and valid input that was cut, changed, doubled or joined.
fn fuzz(seed: u64, valid: &[Vec<u8>], mut parse: impl FnMut(&[u8])) {
    let mut random = Random(seed);
    let mut input = Vec::new();
    for _ in 0..inputs() {
        input.clear();
        match random.below(4) {
            0 => input = random.bytes(200),
            _ => input.extend_from_slice(&valid[random.below(valid.len())]),
        }
        for _ in 0..random.below(4) {
            let at = random.below(input.len());
            match random.below(5) {
                0 => input.truncate(at),
                1 if !input.is_empty() => input[at] = random.next() as u8,
                2 if !input.is_empty() => input[at] ^= 1 << random.below(8),
                3 => input.extend_from_slice(&valid[random.below(valid.len())]),
                _ => {
                    let more = random.bytes(20);
                    input.splice(at..at, more);
                }
            }
        }
        parse(&input);
    }
}

fn requests() -> Vec<Vec<u8>> {
    let names = vec!["timestamp".to_owned(), "actual_q".to_owned()];
    let text = Text {
        message: "hello".into(),
        source: "me".into(),
        level: 3,
    };
    let all = [
        Request::ProtocolVersion(2),
        Request::ControllerVersion,
        Request::Text(text),
        Request::SetupOutputs {
            frequency_hz: Some(125.0),
            names: names.clone(),
        },
        Request::SetupInputs { names },
        Request::Start,
        Request::Pause,
        Request::Data {
            recipe: 1,
            fields: vec![7; 61],
        },
    ];
    all.iter()
        .map(|request| {
            let mut bytes = Vec::new();
            request.encode(Version::V2, &mut bytes);
            bytes
        })
        .collect()
}

fn replies() -> Vec<Vec<u8>> {
    let types = vec![Type::Double, Type::Vector6D, Type::NotFound];
    let text = Text {
        message: "hello".into(),
        source: "RTDE".into(),
        level: 0,
    };
    let all = [
        Reply::ProtocolVersion { accepted: true },
        Reply::ControllerVersion([3, 15, 8, 0]),
        Reply::Text(text),
        Reply::SetupOutputs {
            recipe: Some(1),
            types: types.clone(),
        },
        Reply::SetupInputs { recipe: 2, types },
        Reply::Start { accepted: true },
        Reply::Pause { accepted: false },
        Reply::Data {
            recipe: Some(1),
            fields: vec![3; 61],
        },
    ];
    all.iter()
        .map(|reply| {
            let mut bytes = Vec::new();
            reply.encode(Version::V2, &mut bytes);
            bytes
        })
        .collect()
}

#[test]
fn rtde_frames() {
    let valid = [requests(), replies()].concat();
    let kinds: Vec<Type> = State::FIELDS.iter().map(|(_, kind)| *kind).collect();
    fuzz(1, &valid, |mut input| {
        while let Ok(Some(frame)) = Frame::first(input) {
            assert!(frame.size() <= input.len());
            input = &input[frame.size()..];
            for version in [Version::V1, Version::V2] {
                let _ = Request::decode(frame, version);
                if let Ok(reply) = Reply::decode(frame, version) {
                    // What was understood can be said again.
                    let mut again = Vec::new();
                    reply.encode(version, &mut again);
                    assert!(again.len() <= wire::MAX_FRAME_BYTES);
                }
            }
        }
    });
    fuzz(2, &[vec![1; 61]], |input| {
        let _ = take_values(&kinds, input);
        let mut rest = input;
        if State::decode(&mut rest).is_some() {
            assert_eq!(input.len() - rest.len(), 61);
        }
        let _ = <[u32; 6]>::decode(&mut &input[..]);
    });
}

fn packet(kind: u8, body: &[u8]) -> Vec<u8> {
    let size = (body.len() + 5) as i32;
    [&size.to_be_bytes()[..], &[kind], body].concat()
}

#[test]
fn primary_packets() {
    let sizes = [
        (0, 42),
        (1, 246),
        (2, 32),
        (3, 70),
        (4, 96),
        (5, 220),
        (6, 440),
        (7, 56),
        (9, 3),
    ];
    let parts: Vec<Vec<u8>> = sizes
        .iter()
        .map(|(kind, bytes)| packet(*kind, &vec![*kind; *bytes]))
        .collect();
    let mut valid = vec![packet(16, &parts.concat())];
    valid.extend(parts.iter().map(|part| packet(16, part)));
    valid.extend((0..12).map(|kind| {
        let body = [&[0; 9][..], &[kind], &[2; 40]].concat();
        packet(20, &body)
    }));
    let name = b"\x13PROGRAM_XXX_STARTEDmain";
    valid.push(packet(20, &[&[0; 9][..], &[7], &[0; 8], name].concat()));
    let mut progress: Progress = Script::new("def main():\nend\n").unwrap().progress();
    fuzz(3, &valid, |mut input| {
        while let Ok(Some(packet)) = Packet::first(input) {
            assert!(packet.size() <= input.len());
            input = &input[packet.size()..];
            let Ok(message) = Message::decode(packet) else {
                continue;
            };
            progress.observe(&message);
            match message {
                Message::State(state) => {
                    if let Some(kinematics) = &state.kinematics {
                        let _ = Calibration::import(kinematics, Model::Ur5);
                    }
                }
                // Lossy text can take three bytes for one.
                Message::Notice(_, Notice::Text(text)) => {
                    assert!(text.len() <= 3 * packet.body.len());
                }
                _ => {}
            }
        }
    });
}

#[test]
fn realtime_packets() {
    let valid: Vec<Vec<u8>> = realtime::SIZES
        .iter()
        .map(|(size, _)| [&(*size as i32).to_be_bytes()[..], &vec![0x40; size - 4]].concat())
        .collect();
    fuzz(4, &valid, |input| {
        if let Ok(Some(packet)) = realtime::first(input) {
            assert!(packet.len() <= realtime::MAX_PACKET_BYTES);
            assert!(realtime::State::decode(packet).is_some());
        }
        let _ = realtime::State::decode(input);
    });
}

#[test]
fn programs() {
    let valid = [
        b"def main():\n  movej([0, 0, 0, 0, 0, 0])\nend\n".to_vec(),
        b"# comment\ndef a_1( ) :\n\n  if True: # x\n  end\nend # all".to_vec(),
    ];
    fuzz(5, &valid, |input| {
        let text = String::from_utf8_lossy(input);
        if let Ok(script) = Script::new(text.as_ref()) {
            assert!(script.text().ends_with('\n'));
            assert!(!script.name().is_empty());
        }
    });
}
