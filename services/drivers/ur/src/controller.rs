//! An arm under our program: [`Controller`].

use std::time::{SystemTime, UNIX_EPOCH};

use tokio::{io::AsyncWriteExt, net::TcpStream, time::Instant};

use crate::{
    Command, Dashboard, Error, Fault, Options, ProgramState, RobotLink, RobotMode, RuntimeState,
    SafetyMode, Startup, State,
    program::{self, FIRST_REGISTER},
    rtde::{
        Client, InputRecipe, OutputRecipe,
        wire::{Type, Value},
    },
};

/// A connected arm that runs this crate's program. See [`RobotLink`] for how to drive it.
pub struct Controller {
    options: Options,
    rtde: Client,
    outputs: OutputRecipe,
    inputs: InputRecipe,
    /// Number of the program uploaded last; 0 before the first.
    session: i32,
    /// Changes with every package; the program counts cycles in which it does not.
    counter: i32,
    sequence: i32,
    last_command: Option<Command>,
    /// A fault was returned by `next_state`, so the next `Hold` acknowledges it.
    fault_seen: bool,
}

impl Controller {
    /// Connects to all services, brings the arm up as [`Options::startup`] allows, uploads the program and waits until it
    /// reports ready.
    ///
    /// # Errors
    /// Any service unreachable, a refused recipe, an arm that does not come up within [`Options::startup_timeout`], a
    /// protective stop ([`Error::NotReady`]).
    pub async fn connect(options: Options) -> Result<Self, Error> {
        let endpoint = &options.endpoint;
        let mut rtde =
            Client::connect(&endpoint.host, endpoint.rtde_port, options.reply_timeout).await?;
        let outputs = rtde
            .setup_outputs(options.frequency_hz, &output_fields(&OUTPUT_REGISTERS))
            .await?;
        let names = InputNames::new();
        let inputs = rtde.setup_inputs(&names.fields()).await?;
        rtde.start().await?;
        let mut controller = Self {
            options,
            rtde,
            outputs,
            inputs,
            session: 0,
            counter: 0,
            sequence: 0,
            last_command: None,
            fault_seen: false,
        };
        controller.bring_up().await?;
        controller.start_program().await?;
        Ok(controller)
    }

    /// Makes a stopped arm ready again: unlocks a protective stop (which the controller refuses within 5 s of its
    /// occurrence), brings it up as [`Options::startup`] allows and starts the program anew. Nothing moves by itself.
    /// Ask for it only once the cause was inspected.
    ///
    /// # Errors
    /// As [`Controller::connect`], and [`Error::Refused`] for an unlock that comes too early.
    pub async fn recover(&mut self) -> Result<(), Error> {
        // Answers the state that the caller saw last.
        self.send(&Command::Hold).await?;
        if self.hold().await?.safety_mode == SafetyMode::ProtectiveStop {
            let mut dashboard = self.dashboard().await?;
            dashboard.unlock_protective_stop().await?;
            self.state_where("end of the protective stop", |state| {
                state.safety_mode.allows_motion()
            })
            .await?;
        }
        self.bring_up().await?;
        self.start_program().await
    }

    /// Opens a dashboard connection to the same controller.
    ///
    /// # Errors
    /// Connection failures.
    pub async fn dashboard(&self) -> Result<Dashboard, Error> {
        let endpoint = &self.options.endpoint;
        Dashboard::connect(
            &endpoint.host,
            endpoint.dashboard_port,
            self.options.reply_timeout,
        )
        .await
    }

    /// Power on, brakes off. Mode changes are asynchronous, so each is asked for once and then awaited as a state.
    async fn bring_up(&mut self) -> Result<(), Error> {
        let mut state = self.hold().await?;
        if !state.safety_mode.allows_motion() {
            return Err(not_ready(&state));
        }
        if state.robot_mode == RobotMode::Running {
            return Ok(());
        }
        if self.options.startup == Startup::RequireRunning {
            return Err(not_ready(&state));
        }
        let mut dashboard = self.dashboard().await?;
        if matches!(state.robot_mode, RobotMode::PowerOff) {
            dashboard.power_on().await?;
        }
        if state.robot_mode != RobotMode::Idle {
            state = self
                .state_where("power at the arm", |state| {
                    state.robot_mode == RobotMode::Idle
                })
                .await?;
        }
        tracing::debug!(robot_mode = %state.robot_mode, "arm has power");
        dashboard.brake_release().await?;
        self.state_where("brake release", |state| {
            state.robot_mode == RobotMode::Running
        })
        .await
        .map(|_| ())
    }

    async fn start_program(&mut self) -> Result<(), Error> {
        self.session = new_session(self.session);
        self.last_command = None;
        self.fault_seen = false;
        // The registers are ours, and harmless, before a program can read them.
        self.send(&Command::Hold).await?;
        let text = program::text(&self.options, self.session)?;
        let endpoint = &self.options.endpoint;
        let mut script = crate::error::connect(
            "script",
            &endpoint.host,
            endpoint.script_port,
            self.options.reply_timeout,
        )
        .await?;
        let written = script.write_all(text.as_bytes()).await;
        written.map_err(|source| Error::Io {
            service: "script",
            source,
        })?;
        let deadline = Instant::now() + self.options.startup_timeout;
        loop {
            let state = self.hold().await?;
            if state.program.ready {
                return Ok(());
            }
            if state.robot_mode != RobotMode::Running || !state.safety_mode.allows_motion() {
                return Err(not_ready(&state));
            }
            if Instant::now() > deadline {
                return Err(Error::Timeout {
                    what: "start of the program",
                    limit: self.options.startup_timeout,
                });
            }
            // Closing a socket with unread data may drop what was written to it, so it is read and kept until now.
            discard(&script)?;
        }
    }

    /// The first state that is as `wanted`.
    async fn state_where(
        &mut self,
        what: &'static str,
        wanted: impl Fn(&State) -> bool + Send,
    ) -> Result<State, Error> {
        let limit = self.options.startup_timeout;
        let deadline = Instant::now() + limit;
        loop {
            let state = self.hold().await?;
            if wanted(&state) {
                return Ok(state);
            }
            if Instant::now() > deadline {
                return Err(Error::Timeout { what, limit });
            }
        }
    }

    /// One state and its answer, which keeps a controller in lock step going.
    async fn hold(&mut self) -> Result<State, Error> {
        let state = self.next_state().await?;
        self.send(&Command::Hold).await?;
        Ok(state)
    }

    fn input_values(&self, command: &Command) -> [Value; INPUT_INTS + INPUT_DOUBLES] {
        let (mode, target, speed, accel) = match *command {
            Command::Hold => (0, [0.0; 6], 0.0, 0.0),
            Command::Servo { joints_rad } => (1, joints_rad, 0.0, 0.0),
            Command::MoveL {
                base_from_tool,
                speed_m_s,
                accel_m_s2,
            } => (2, base_from_tool, speed_m_s, accel_m_s2),
            Command::MoveJ {
                joints_rad,
                speed_rad_s,
                accel_rad_s2,
            } => (3, joints_rad, speed_rad_s, accel_rad_s2),
            Command::Stop => (4, [0.0; 6], 0.0, 0.0),
        };
        let [t0, t1, t2, t3, t4, t5] = target;
        let ints = [
            self.counter,
            mode,
            self.sequence,
            self.session,
            i32::from(self.fault_seen),
        ];
        let doubles = [t0, t1, t2, t3, t4, t5, speed, accel];
        let mut values = [Value::Int32(0); INPUT_INTS + INPUT_DOUBLES];
        let all = ints
            .into_iter()
            .map(Value::Int32)
            .chain(doubles.into_iter().map(Value::Double));
        values
            .iter_mut()
            .zip(all)
            .for_each(|(slot, value)| *slot = value);
        values
    }
}

impl RobotLink for Controller {
    async fn next_state(&mut self) -> Result<State, Error> {
        let fields = self
            .rtde
            .newest(&self.outputs, self.options.silence_timeout)
            .await?;
        let state = decode(fields, self.session, self.sequence)?;
        self.fault_seen = state.program.fault.is_some();
        Ok(state)
    }

    async fn send(&mut self, command: &Command) -> Result<(), Error> {
        command.check()?;
        if !self
            .last_command
            .is_some_and(|before| command.continues(&before))
        {
            self.sequence = next_number(self.sequence);
        }
        self.last_command = Some(*command);
        self.counter = next_number(self.counter);
        let values = self.input_values(command);
        self.rtde.send(&self.inputs, &values).await
    }
}

const INPUT_INTS: usize = 5;
const INPUT_DOUBLES: usize = 8;

/// Names of the input registers in the order of [`Controller::input_values`].
struct InputNames(Vec<(String, Type)>);

impl InputNames {
    fn new() -> Self {
        let named = |kind: &str, count: usize, of: Type| -> Vec<(String, Type)> {
            (FIRST_REGISTER..FIRST_REGISTER + count)
                .map(|n| (format!("input_{kind}_register_{n}"), of))
                .collect()
        };
        Self(
            [
                named("int", INPUT_INTS, Type::Int32),
                named("double", INPUT_DOUBLES, Type::Double),
            ]
            .concat(),
        )
    }

    fn fields(&self) -> Vec<(&str, Type)> {
        self.0
            .iter()
            .map(|(name, kind)| (name.as_str(), *kind))
            .collect()
    }
}

const OUTPUT_REGISTERS: [&str; 5] = [
    "output_int_register_24",
    "output_int_register_25",
    "output_int_register_26",
    "output_int_register_27",
    "output_int_register_28",
];

fn output_fields(registers: &[&'static str; 5]) -> Vec<(&'static str, Type)> {
    let mut fields = vec![
        ("timestamp", Type::Double),
        ("actual_q", Type::Vector6D),
        ("target_q", Type::Vector6D),
        ("actual_qd", Type::Vector6D),
        ("actual_TCP_pose", Type::Vector6D),
        ("robot_mode", Type::Int32),
        ("safety_mode", Type::Int32),
        ("runtime_state", Type::UInt32),
        ("speed_scaling", Type::Double),
        ("target_speed_fraction", Type::Double),
    ];
    fields.extend(registers.iter().map(|name| (*name, Type::Int32)));
    fields
}

/// Reads one package in the order of [`output_fields`].
fn decode(mut fields: &[u8], session: i32, sequence_sent: i32) -> Result<State, Error> {
    let mut next = |kind| Value::decode(kind, &mut fields).ok_or(SHORT);
    let mut state = State {
        timestamp_s: double(next(Type::Double)?),
        actual_q: vector(next(Type::Vector6D)?),
        target_q: vector(next(Type::Vector6D)?),
        actual_qd: vector(next(Type::Vector6D)?),
        actual_tcp_pose: vector(next(Type::Vector6D)?),
        robot_mode: RobotMode::from_code(int(next(Type::Int32)?)),
        safety_mode: SafetyMode::from_code(int(next(Type::Int32)?)),
        runtime_state: RuntimeState::from_code(int(next(Type::UInt32)?)),
        speed_scaling: double(next(Type::Double)?),
        target_speed_fraction: double(next(Type::Double)?),
        program: ProgramState {
            sequence_sent,
            ..ProgramState::default()
        },
    };
    let mut registers = [0; 5];
    for register in &mut registers {
        *register = int(next(Type::Int32)?);
    }
    let [
        program_session,
        sequence_running,
        sequence_done,
        fault,
        missed_cycles,
    ] = registers;
    if session != 0 && program_session == session {
        state.program = ProgramState {
            ready: state.runtime_state == RuntimeState::Playing,
            sequence_sent,
            sequence_running,
            sequence_done,
            missed_cycles,
            fault: match fault {
                0 => None,
                1 => Some(Fault::ClientSilent),
                2 => Some(Fault::ServoLead),
                other => Some(Fault::Unknown(other)),
            },
        };
    }
    Ok(state)
}

const SHORT: Error = Error::Wire(crate::rtde::wire::Error::Short(b'U'));

fn double(value: Value) -> f64 {
    if let Value::Double(value) = value {
        value
    } else {
        f64::NAN
    }
}

fn vector(value: Value) -> [f64; 6] {
    if let Value::Vector6D(values) = value {
        values
    } else {
        [f64::NAN; 6]
    }
}

fn int(value: Value) -> i32 {
    match value {
        Value::Int32(value) => value,
        Value::UInt32(value) => value as i32,
        _ => 0,
    }
}

fn not_ready(state: &State) -> Error {
    Error::NotReady {
        robot_mode: state.robot_mode,
        safety_mode: state.safety_mode,
    }
}

/// The next number of a count that never shows 0.
fn next_number(number: i32) -> i32 {
    if number == i32::MAX { 1 } else { number + 1 }
}

/// A number that no earlier client is likely to have left in the registers.
fn new_session(before: i32) -> i32 {
    let nanos = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(1, |since| since.as_nanos() as u64);
    let mixed =
        (nanos ^ u64::from(std::process::id()) << 20).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 33;
    let session = (mixed as i32).max(1);
    if session == before {
        next_number(session)
    } else {
        session
    }
}

/// Reads and forgets what a script interface sends by itself.
fn discard(script: &TcpStream) -> Result<(), Error> {
    let mut waste = [0; 16 * 1024];
    match script.try_read(&mut waste) {
        Ok(0) => Err(Error::Closed { service: "script" }),
        Ok(_) => Ok(()),
        Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => Ok(()),
        Err(source) => Err(Error::Io {
            service: "script",
            source,
        }),
    }
}
