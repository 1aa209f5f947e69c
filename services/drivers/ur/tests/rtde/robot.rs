//! A controller that does what a test tells it: answers the setup of one client from the table of known fields, then
//! hands the connection over.

use std::{
    io::{Read, Write},
    net::{SocketAddr, TcpListener, TcpStream},
    thread::JoinHandle,
    time::Duration,
};

use ur_link::rtde::{
    ControllerVersion, fields,
    wire::{self, Frame, Reply, Request, Text, Type, Version},
};

/// What the controller is.
#[derive(Clone)]
pub struct Robot {
    pub software: [u32; 4],
    /// Highest protocol version it accepts.
    pub protocol: u16,
    /// Inputs another client has.
    pub taken: &'static [&'static str],
    /// Sends states while it is asked to pause.
    pub states_before_pause: u32,
    /// Sends a line for the log before each answer.
    pub talkative: Talk,
    /// Cuts what it sends into pieces of this size.
    pub piece: usize,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Talk {
    Silent,
    /// In an encoding that nobody expects.
    Latin1,
}

pub const CB3: [u32; 4] = [3, 15, 8, 106_339];
pub const E_SERIES: [u32; 4] = [5, 12, 2, 1_101_534];

impl Robot {
    pub fn new(software: [u32; 4]) -> Self {
        Self {
            software,
            protocol: 2,
            taken: &[],
            states_before_pause: 0,
            talkative: Talk::Silent,
            piece: usize::MAX,
        }
    }

    /// Serves one client: its setup by itself, and once it has started, `then`.
    pub fn serve(self, then: impl FnOnce(&mut Line) + Send + 'static) -> Served {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let thread = std::thread::spawn(move || {
            let stream = listener.accept().unwrap().0;
            stream
                .set_read_timeout(Some(Duration::from_secs(20)))
                .unwrap();
            let mut line = Line {
                stream,
                robot: self,
                version: Version::V1,
                frequency_hz: None,
                outputs: Vec::new(),
                inbox: Vec::new(),
            };
            if line.until_started() {
                then(&mut line);
                // Answers, such as to a pause, until the client goes.
                while line.answer_next() {}
            }
        });
        Served { address, thread }
    }
}

/// A controller at work.
pub struct Served {
    pub address: SocketAddr,
    thread: JoinHandle<()>,
}

impl Served {
    /// Waits until it has seen the client go.
    pub fn join(self) {
        self.thread.join().unwrap();
    }
}

/// The connection of a started client.
pub struct Line {
    stream: TcpStream,
    robot: Robot,
    pub version: Version,
    /// As the client asked for it.
    pub frequency_hz: Option<f64>,
    /// Types of the output recipe.
    pub outputs: Vec<Type>,
    inbox: Vec<u8>,
}

impl Line {
    /// Sends bytes as they are.
    pub fn send(&mut self, bytes: &[u8]) {
        for piece in bytes.chunks(self.robot.piece.max(1)) {
            // A client may be gone, which it is for the test to judge.
            if self.stream.write_all(piece).is_err() {
                return;
            }
        }
    }

    /// A state of this time whose other fields are 0.
    pub fn state(&self, timestamp_s: f64) -> Vec<u8> {
        let mut bytes = Vec::new();
        let recipe = (self.version == Version::V2).then_some(1);
        let zeros: usize = self.outputs.iter().skip(1).map(|kind| kind.bytes()).sum();
        wire::data_frame(&mut bytes, recipe, |out| {
            out.extend(timestamp_s.to_be_bytes());
            out.extend(vec![0; zeros]);
        });
        bytes
    }

    /// The next package of the client; `None` when it is gone.
    pub fn request(&mut self) -> Option<Request> {
        loop {
            if let Some(frame) = Frame::first(&self.inbox).unwrap() {
                let size = frame.size();
                let request = Request::decode(frame, self.version).unwrap();
                self.inbox.drain(..size);
                return Some(request);
            }
            let mut buffer = [0; 4096];
            match self.stream.read(&mut buffer) {
                Ok(0) | Err(_) => return None,
                Ok(bytes) => self.inbox.extend_from_slice(&buffer[..bytes]),
            }
        }
    }

    fn until_started(&mut self) -> bool {
        loop {
            match self.request() {
                None => return false,
                Some(request) => {
                    let start = request == Request::Start;
                    self.answer(request);
                    if start {
                        return true;
                    }
                }
            }
        }
    }

    fn answer_next(&mut self) -> bool {
        let request = self.request();
        let more = request.is_some();
        if let Some(request) = request {
            self.answer(request);
        }
        more
    }

    fn answer(&mut self, request: Request) {
        let version = self.version;
        let reply = match request {
            Request::ProtocolVersion(wanted) => {
                let accepted = wanted <= self.robot.protocol;
                if accepted && wanted == 2 {
                    self.version = Version::V2;
                }
                Reply::ProtocolVersion { accepted }
            }
            Request::ControllerVersion => Reply::ControllerVersion(self.robot.software),
            Request::SetupOutputs {
                frequency_hz,
                names,
            } => {
                self.frequency_hz = frequency_hz;
                let types = self.types(&names, fields::output);
                self.outputs = types.clone();
                let sound = types.iter().all(|kind| kind.is_field());
                Reply::SetupOutputs {
                    recipe: (version == Version::V2).then_some(u8::from(sound)),
                    types,
                }
            }
            Request::SetupInputs { names } => {
                let mut types = self.types(&names, fields::input);
                for (name, kind) in names.iter().zip(&mut types) {
                    if self.robot.taken.contains(&name.as_str()) {
                        *kind = Type::InUse;
                    }
                }
                let sound = types.iter().all(|kind| kind.is_field());
                Reply::SetupInputs {
                    recipe: u8::from(sound),
                    types,
                }
            }
            Request::Start => Reply::Start { accepted: true },
            Request::Pause => {
                for number in 0..self.robot.states_before_pause {
                    let state = self.state(1000.0 + f64::from(number));
                    self.send(&state);
                }
                Reply::Pause { accepted: true }
            }
            Request::Text(_) | Request::Data { .. } => return,
        };
        let mut bytes = Vec::new();
        if self.robot.talkative == Talk::Latin1 {
            let text = Text {
                message: "Gr~~e".into(),
                source: "RTDE".into(),
                level: 2,
            };
            Reply::Text(text).encode(version, &mut bytes);
            bytes
                .iter_mut()
                .filter(|byte| **byte == b'~')
                .for_each(|byte| *byte = 0xfc);
        }
        reply.encode(version, &mut bytes);
        self.send(&bytes);
    }

    fn types(&self, names: &[String], known: fn(&str) -> Option<fields::Field>) -> Vec<Type> {
        let software = ControllerVersion::new(self.robot.software);
        names
            .iter()
            .map(|name| match known(name) {
                Some(field) if field.since.is_none_or(|since| software.has(&since)) => field.kind,
                _ => Type::NotFound,
            })
            .collect()
    }
}
