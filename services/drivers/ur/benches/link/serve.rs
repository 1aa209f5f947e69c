//! The stand-in controller: one thread a connection, version 2, e-Series, any recipe of known fields.

use std::{
    io::{Read, Write},
    net::{TcpListener, TcpStream},
};

use rustix::{
    thread::clock_nanosleep_absolute,
    time::{ClockId, Timespec},
};
use ur_link::rtde::{
    fields,
    wire::{self, Frame, Reply, Request, Type, Version},
};

use crate::{PORT, now_s};

/// States that one write carries when nothing paces them.
const FLOOD_BATCH: usize = 16;

/// Until standard input ends.
pub fn serve(host: &str, rate_hz: Option<f64>) {
    let listener = TcpListener::bind((host, PORT)).unwrap();
    println!("ready");
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let stream = stream.unwrap();
            stream.set_nodelay(true).unwrap();
            std::thread::spawn(move || {
                if let Some(recipe) = set_up(&stream) {
                    let sent = stream_states(&stream, &recipe, rate_hz);
                    println!("{{\"sent\": {}, \"seconds\": {}}}", sent.0, sent.1);
                }
            });
        }
    });
    let _ = std::io::stdin().read_to_end(&mut Vec::new());
}

/// A state with all fields 0, and where the time and the number of the state go.
struct Recipe {
    frame: Vec<u8>,
    stamp: usize,
    number: Option<usize>,
}

fn set_up(mut stream: &TcpStream) -> Option<Recipe> {
    let (mut inbox, mut version, mut recipe) = (Vec::new(), Version::V1, None);
    loop {
        while let Some(frame) = Frame::first(&inbox).ok()? {
            let size = frame.size();
            let request = Request::decode(frame, version).ok()?;
            inbox.drain(..size);
            let reply = match request {
                Request::ProtocolVersion(wanted) => Reply::ProtocolVersion {
                    accepted: wanted <= 2,
                },
                Request::ControllerVersion => Reply::ControllerVersion([5, 12, 2, 1_101_534]),
                Request::SetupOutputs { names, .. } => {
                    let types: Vec<Type> = names
                        .iter()
                        .map(|name| fields::output(name).map_or(Type::NotFound, |field| field.kind))
                        .collect();
                    recipe = Some(recipe_of(&names, &types));
                    Reply::SetupOutputs {
                        recipe: Some(1),
                        types,
                    }
                }
                Request::SetupInputs { names } => Reply::SetupInputs {
                    recipe: 1,
                    types: names
                        .iter()
                        .map(|name| fields::input(name).map_or(Type::NotFound, |field| field.kind))
                        .collect(),
                },
                Request::Start => Reply::Start { accepted: true },
                Request::Pause => Reply::Pause { accepted: true },
                Request::Text(_) | Request::Data { .. } => continue,
            };
            let mut bytes = Vec::new();
            reply.encode(version, &mut bytes);
            stream.write_all(&bytes).ok()?;
            if matches!(reply, Reply::ProtocolVersion { accepted: true }) {
                version = Version::V2;
            }
            if matches!(reply, Reply::Start { .. }) {
                return recipe;
            }
        }
        let mut buffer = [0; 4096];
        match stream.read(&mut buffer).ok()? {
            0 => return None,
            bytes => inbox.extend_from_slice(&buffer[..bytes]),
        }
    }
}

fn recipe_of(names: &[String], types: &[Type]) -> Recipe {
    let place = |wanted: &str| {
        let at = names.iter().position(|name| name == wanted)?;
        let before: usize = types[..at].iter().map(|kind| kind.bytes()).sum();
        Some(wire::HEADER_BYTES + 1 + before)
    };
    let mut frame = Vec::new();
    wire::data_frame(&mut frame, Some(1), |out| {
        out.extend(vec![0; types.iter().map(|kind| kind.bytes()).sum()])
    });
    Recipe {
        frame,
        stamp: place("timestamp").unwrap_or(usize::MAX),
        number: place("output_int_register_2"),
    }
}

/// States sent, and seconds it took, when the client is gone.
fn stream_states(mut stream: &TcpStream, recipe: &Recipe, rate_hz: Option<f64>) -> (u64, f64) {
    let batch = if rate_hz.is_some() { 1 } else { FLOOD_BATCH };
    let size = recipe.frame.len();
    let mut bytes = recipe.frame.repeat(batch);
    let (began, mut sent) = (now_s(), 0u64);
    loop {
        if let Some(rate_hz) = rate_hz {
            until(began + sent as f64 / rate_hz);
        }
        for frame in bytes.chunks_mut(size) {
            sent += 1;
            if let Some(stamp) = frame.get_mut(recipe.stamp..recipe.stamp.saturating_add(8)) {
                stamp.copy_from_slice(&now_s().to_be_bytes());
            }
            if let Some(at) = recipe.number {
                frame[at..at + 4].copy_from_slice(&(sent as i32).to_be_bytes());
            }
        }
        if stream.write_all(&bytes).is_err() {
            return (sent, now_s() - began);
        }
    }
}

fn until(time_s: f64) {
    // A sleep takes longer than it is asked for; one that is overdue is none.
    if time_s > now_s() {
        let request = Timespec {
            tv_sec: time_s as i64,
            tv_nsec: (time_s.fract() * 1e9) as i64,
        };
        let _ = clock_nanosleep_absolute(ClockId::Monotonic, &request);
    }
}
