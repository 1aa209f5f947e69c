//! What the codec costs: a state written and read, and the newest found in a backlog.
#![allow(missing_docs, clippy::unwrap_used)]

use std::{
    hint::black_box,
    io::Write,
    net::{TcpListener, TcpStream},
    time::Duration,
};

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use ur_link::rtde::{
    FieldValue, Inputs, Outputs, Reader,
    wire::{self, Frame, Reply, Request, Type, Value, Version, take_values},
};

ur_link::outputs! {
    struct State {
        timestamp: f64,
        actual_q: [f64; 6],
        actual_qd: [f64; 6],
        target_q: [f64; 6],
        actual_TCP_pose as tool_pose: [f64; 6],
        robot_mode: i32,
        safety_mode: i32,
        runtime_state: u32,
        speed_scaling: f64,
        output_int_register_24 as session: i32,
    }
}

ur_link::inputs! {
    struct Command {
        input_int_register_24 as counter: i32,
        input_double_register_24 as first: f64,
        external_force_torque as wrench: [f64; 6],
    }
}

fn payload() -> Vec<u8> {
    let mut bytes = Vec::new();
    for (number, (_, kind)) in (0u8..).zip(State::FIELDS) {
        bytes.extend(vec![number; kind.bytes()]);
    }
    bytes
}

fn codec(criterion: &mut Criterion) {
    let payload = payload();
    let kinds: Vec<Type> = State::FIELDS.iter().map(|(_, kind)| *kind).collect();
    let mut group = criterion.benchmark_group("codec");
    group.throughput(Throughput::Bytes(payload.len() as u64));
    group.bench_function("decode_typed", |bencher| {
        bencher.iter(|| State::decode(&mut black_box(&payload[..])).unwrap());
    });
    group.bench_function("decode_values", |bencher| {
        bencher.iter(|| take_values(&kinds, black_box(&payload)).unwrap());
    });
    let command = Command {
        counter: 1,
        first: 0.5,
        wrench: [0.0; 6],
    };
    let mut out = Vec::with_capacity(256);
    group.bench_function("encode_typed", |bencher| {
        bencher.iter(|| {
            out.clear();
            wire::data_frame(&mut out, Some(1), |out| black_box(&command).encode(out));
        });
    });
    let values = [
        Value::Int32(1),
        Value::Double(0.5),
        Value::Vector6D([0.0; 6]),
    ];
    group.bench_function("encode_values", |bencher| {
        bencher.iter(|| {
            out.clear();
            wire::data_frame(&mut out, Some(1), |out| {
                black_box(&values)
                    .iter()
                    .for_each(|value| value.encode(out));
            });
        });
    });
    group.finish();
}

/// A controller that sends this many states whenever it is told to.
fn backlog(states: usize) -> (Reader<State>, TcpStream) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let controller = std::thread::spawn(move || {
        let mut stream = listener.accept().unwrap().0;
        let mut version = Version::V1;
        loop {
            let request = request(&mut stream, version);
            let reply = match request {
                Request::ProtocolVersion(_) => Reply::ProtocolVersion { accepted: true },
                Request::ControllerVersion => Reply::ControllerVersion([5, 12, 2, 0]),
                Request::SetupOutputs { .. } => Reply::SetupOutputs {
                    recipe: Some(1),
                    types: State::FIELDS.iter().map(|(_, kind)| *kind).collect(),
                },
                _ => Reply::Start { accepted: true },
            };
            let mut bytes = Vec::new();
            reply.encode(version, &mut bytes);
            stream.write_all(&bytes).unwrap();
            version = Version::V2;
            if matches!(reply, Reply::Start { .. }) {
                return stream;
            }
        }
    });
    let reader = Reader::connect("127.0.0.1", port, 0.0, Duration::from_secs(5)).unwrap();
    let stream = controller.join().unwrap();
    assert!(
        states * 300 < 60_000,
        "a backlog that a socket holds at once"
    );
    (reader, stream)
}

fn request(stream: &mut TcpStream, version: Version) -> Request {
    use std::io::Read;
    let mut bytes = Vec::new();
    loop {
        let mut byte = [0];
        stream.read_exact(&mut byte).unwrap();
        bytes.extend(byte);
        if let Some(frame) = Frame::first(&bytes).unwrap() {
            return Request::decode(frame, version).unwrap();
        }
    }
}

/// Sending is part of it: what a system takes to carry the bytes is the larger part.
fn newest(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("newest");
    for states in [1usize, 10, 100] {
        let (mut reader, mut controller) = backlog(states);
        let mut time_s = 0.0;
        let payload = payload();
        group.throughput(Throughput::Elements(states as u64));
        group.bench_function(format!("of_{states}"), |bencher| {
            bencher.iter(|| {
                let mut bytes = Vec::with_capacity(states * 300);
                for _ in 0..states {
                    time_s += 0.002;
                    wire::data_frame(&mut bytes, Some(1), |out| {
                        f64::encode(time_s, out);
                        out.extend_from_slice(&payload[8..]);
                    });
                }
                controller.write_all(&bytes).unwrap();
                let mut sample = reader.next(Duration::from_secs(5)).unwrap();
                while sample.timestamp_s < time_s {
                    sample = reader.next(Duration::from_secs(5)).unwrap();
                }
                sample
            });
        });
    }
    group.finish();
}

criterion_group!(benches, codec, newest);
criterion_main!(benches);
