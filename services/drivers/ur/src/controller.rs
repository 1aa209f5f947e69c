//! An arm under our program: [`Controller`].

mod registers;

use std::time::{SystemTime, UNIX_EPOCH};

use tokio::{io::AsyncWriteExt, net::TcpStream, time::Instant};

use self::registers::Envelope;
use crate::{
    Command, Dashboard, Error, Identity, Options, RobotLink, RobotMode, SafetyMode, Startup, State,
    program,
    rtde::{Client, InputRecipe, OutputRecipe, wire::Type},
};

/// Cycles after which a program whose beat stands still has ended.
const BEATS_MISSED: f64 = 5.0;

/// A connected arm that runs this crate's program. See [`RobotLink`] for how to drive it.
pub struct Controller {
    options: Options,
    identity: Identity,
    period_s: f64,
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
    beat: Beat,
}

/// The last sign of life of the program.
#[derive(Clone, Copy, Debug)]
struct Beat {
    number: i32,
    /// Controller time at which it changed.
    since_s: f64,
}

impl Controller {
    /// Connects to all services, checks that it is the robot meant and may be commanded, brings the arm up as
    /// [`Options::startup`] allows, uploads the program and waits until it reports ready.
    ///
    /// # Errors
    /// Any service unreachable; [`Error::TooOld`], [`Error::WrongRobot`], [`Error::LocalControl`]; [`Error::InUse`] when
    /// another client commands the arm; another refused recipe; an arm that does not come up within
    /// [`Options::startup_timeout`]; a protective stop ([`Error::NotReady`]).
    pub async fn connect(options: Options) -> Result<Self, Error> {
        let endpoint = &options.endpoint;
        let mut rtde =
            Client::connect(&endpoint.host, endpoint.rtde_port, options.reply_timeout).await?;
        let mut identity = Identity::from_version(rtde.controller_version().await?)?;
        let mut dashboard = Dashboard::connect(
            &endpoint.host,
            endpoint.dashboard_port,
            options.reply_timeout,
        )
        .await?;
        identity
            .complete(&mut dashboard, options.expected.as_ref())
            .await?;
        let frequency_hz = identity.series.frequency_hz();
        let outputs = rtde
            .setup_outputs(frequency_hz, &borrowed(&registers::output_names()))
            .await?;
        let inputs = rtde
            .setup_inputs(&borrowed(&registers::input_names()))
            .await
            .map_err(in_use)?;
        rtde.start().await?;
        let mut controller = Self {
            options,
            identity,
            period_s: 1.0 / frequency_hz,
            rtde,
            outputs,
            inputs,
            session: 0,
            counter: 0,
            sequence: 0,
            last_command: None,
            fault_seen: false,
            beat: Beat {
                number: 0,
                since_s: f64::NEG_INFINITY,
            },
        };
        controller.bring_up().await?;
        controller.start_program().await?;
        Ok(controller)
    }

    /// What the controller says it is.
    pub fn identity(&self) -> &Identity {
        &self.identity
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
}

impl RobotLink for Controller {
    fn period_s(&self) -> f64 {
        self.period_s
    }

    async fn next_state(&mut self) -> Result<State, Error> {
        let fields = self
            .rtde
            .newest(&self.outputs, self.options.silence_timeout)
            .await?;
        let received = registers::outputs(fields, self.session, self.sequence)?;
        let mut state = received.state;
        if received.beat != self.beat.number {
            self.beat = Beat {
                number: received.beat,
                since_s: state.timestamp_s,
            };
        }
        // Another program may run, and the registers still show what ours said last.
        let silent_s = state.timestamp_s - self.beat.since_s;
        state.program.ready &= silent_s <= BEATS_MISSED * self.period_s;
        self.fault_seen = state.program.fault.is_some();
        Ok(state)
    }

    async fn send(&mut self, command: &Command) -> Result<(), Error> {
        command.check()?;
        if !self
            .last_command
            .is_some_and(|before| command.continues(&before))
        {
            // The program obeys growing sequences only; a new connection begins anew.
            self.sequence = self.sequence.checked_add(1).ok_or_else(|| Error::Refused {
                request: "command".into(),
                answer: "the sequence numbers of this connection are used up".into(),
            })?;
        }
        self.last_command = Some(*command);
        self.counter = next_number(self.counter);
        let envelope = Envelope {
            counter: self.counter,
            sequence: self.sequence,
            session: self.session,
            fault_seen: self.fault_seen,
        };
        let values = registers::inputs(&envelope, command);
        self.rtde.send(&self.inputs, &values).await
    }
}

fn borrowed(fields: &[(String, Type)]) -> Vec<(&str, Type)> {
    fields
        .iter()
        .map(|(name, kind)| (name.as_str(), *kind))
        .collect()
}

/// Inputs have one writer: somebody else commands the arm.
fn in_use(error: Error) -> Error {
    match error {
        Error::Field {
            name,
            answer: Type::InUse,
            ..
        } => Error::InUse { name },
        other => other,
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
