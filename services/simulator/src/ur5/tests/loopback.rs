//! The link's client against the simulated controller over loopback sockets.

use std::{
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
    task::JoinHandle,
};
use ur_link::rtde::wire::Type;
use ur_link::{
    Command, Dashboard, Endpoint, Error, Fault, Options, RobotLink, SafetyMode, State, Stream,
    Window,
};

use crate::ur5::{
    Config, Controller, Series, ServerOptions, Shared, kinematics,
    motion::largest_difference,
    servers::{Addresses, Ports, lock, serve},
};

/// A served controller whose clock runs as fast as its clients answer.
pub(super) struct Cell {
    controller: Shared,
    addresses: Addresses,
    paused: Arc<AtomicBool>,
    clock: JoinHandle<()>,
}

impl Cell {
    pub(super) async fn start(config: Config) -> Self {
        let controller: Shared = Arc::new(Mutex::new(Controller::new(config)));
        let options = ServerOptions {
            ports: Ports::FREE,
            ..ServerOptions::default()
        };
        let servers = serve(controller.clone(), options).await.unwrap();
        let addresses = servers.addresses();
        let paused = Arc::new(AtomicBool::new(false));
        let clock = tokio::spawn({
            let (controller, paused) = (controller.clone(), paused.clone());
            async move {
                loop {
                    if !paused.load(Ordering::Acquire) {
                        lock(&controller).tick();
                        servers.ticked();
                        servers.wait_for_clients(Duration::from_secs(2)).await;
                    }
                    tokio::task::yield_now().await;
                }
            }
        });
        Self {
            controller,
            addresses,
            paused,
            clock,
        }
    }

    pub(super) fn addresses(&self) -> Addresses {
        self.addresses
    }

    fn options(&self) -> Options {
        Options::new(Endpoint {
            host: "127.0.0.1".to_owned(),
            dashboard_port: self.addresses.dashboard.port(),
            rtde_port: self.addresses.rtde.port(),
            script_port: self.addresses.realtime.port(),
        })
    }

    async fn connect(&self) -> ur_link::Controller {
        ur_link::Controller::connect(self.options()).await.unwrap()
    }

    /// Lets the clock go on without clients until the arm is as wanted.
    async fn until(&self, what: &str, wanted: impl Fn(&Controller) -> bool) {
        let deadline = Instant::now() + Duration::from_secs(20);
        while !wanted(&lock(&self.controller)) {
            assert!(Instant::now() < deadline, "not within 20 s: {what}");
            tokio::task::yield_now().await;
        }
    }
}

impl Drop for Cell {
    fn drop(&mut self) {
        self.clock.abort();
    }
}

/// Sends a command each cycle until the state is as wanted.
async fn drive(
    arm: &mut ur_link::Controller,
    command: Command,
    wanted: impl Fn(&State) -> bool,
) -> State {
    let mut first = None;
    loop {
        let state = arm.next_state().await.unwrap();
        let start_s = *first.get_or_insert(state.timestamp_s);
        arm.send(&command).await.unwrap();
        if state.timestamp_s > start_s && wanted(&state) {
            return state;
        }
        assert!(
            state.timestamp_s - start_s < 60.0,
            "not within 60 s of the arm: {command:?}, {state:?}"
        );
    }
}

/// Streams samples 1 to `last` until the last is consumed.
async fn follow(
    arm: &mut ur_link::Controller,
    last: i32,
    sample: impl Fn(i32) -> [f64; 6],
) -> State {
    let mut stream = Stream::new();
    let mut consumed = 0;
    loop {
        let state = arm.next_state().await.unwrap();
        assert_eq!(state.program.fault, None, "{state:?}");
        stream.consume(state.program.sample_consumed).unwrap();
        assert!(state.program.sample_consumed - consumed <= 1, "skipped");
        consumed = state.program.sample_consumed;
        if consumed > 0 {
            let apart = (state.actual_q[0] - sample(consumed)[0]).abs();
            assert!(apart < 0.03, "{apart} rad behind: {state:?}");
        }
        while stream.wants() {
            stream.push(sample(stream.next_number()));
            if stream.next_number() > last {
                stream.end();
            }
        }
        let window = stream.window().unwrap();
        arm.send(&Command::Stream(window)).await.unwrap();
        if stream.is_consumed() {
            return state;
        }
    }
}

fn finished(state: &State) -> bool {
    state.program.finished()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_arm_is_brought_up_moved_and_stopped() {
    let cell = Cell::start(Config::default()).await;
    let mut options = cell.options();
    options.tcp_offset = [0.0, 0.0, 0.31, 0.0, -std::f64::consts::FRAC_PI_2, 0.0];
    let mut arm = ur_link::Controller::connect(options).await.unwrap();

    let joints_rad = [0.2, -1.5, 1.7, -1.6, -1.4, 0.1];
    let move_j = Command::MoveJ {
        joints_rad,
        speed_rad_s: 1.0,
        accel_rad_s2: 2.0,
    };
    drive(&mut arm, move_j, finished).await;
    assert!(largest_difference(&lock(&cell.controller).joints_rad(), &joints_rad) < 1e-3);

    let here = drive(&mut arm, Command::Hold, finished).await;
    let mut base_from_tool = here.actual_tcp_pose;
    base_from_tool[2] += 0.08;
    let move_l = Command::MoveL {
        base_from_tool,
        speed_m_s: 0.1,
        accel_m_s2: 0.5,
    };
    let there = drive(&mut arm, move_l, finished).await;
    assert!(
        (there.actual_tcp_pose[2] - base_from_tool[2]).abs() < 1e-3,
        "{there:?}"
    );
    let seconds = there.timestamp_s - here.timestamp_s;
    assert!(
        seconds > 0.95 && seconds < 1.2,
        "restarted by its repetitions? {seconds} s"
    );

    // A stream: 0.2 rad of the base in one second, tracked closely, every sample of it.
    let start = drive(&mut arm, Command::Hold, finished).await.target_q;
    let sample = |number: i32| {
        let share = f64::from(number) / 125.0;
        let mut joints_rad = start;
        joints_rad[0] += 0.2 * share * share * (3.0 - 2.0 * share);
        joints_rad
    };
    let state = follow(&mut arm, 125, sample).await;
    assert_eq!(state.program.sample_consumed, 125);
    let window = Window {
        first: 125,
        joints_rad: [sample(125); 4],
        last: Some(125),
    };
    let arrived = |state: &State| (state.actual_q[0] - start[0] - 0.2).abs() < 1e-4;
    drive(&mut arm, Command::Stream(window), arrived).await;

    // Stop in the middle of a move.
    let far = Command::MoveJ {
        joints_rad: [1.5, -1.5, 1.7, -1.6, -1.4, 0.1],
        speed_rad_s: 1.0,
        accel_rad_s2: 2.0,
    };
    let moving = drive(&mut arm, far, |state| state.actual_qd[0] > 0.9).await;
    let stopped = drive(&mut arm, Command::Stop, |state| {
        finished(state) && state.actual_qd[0].abs() < 1e-4
    })
    .await;
    // v^2 / 2a and some cycles of delay.
    let way = stopped.actual_q[0] - moving.actual_q[0];
    assert!(way > 0.0 && way < 1.0 / (2.0 * 4.0) + 0.1, "{way}");
    let later = drive(&mut arm, Command::Stop, |state| {
        state.timestamp_s > stopped.timestamp_s + 1.0
    })
    .await;
    assert!(
        largest_difference(&later.actual_q, &stopped.actual_q) < 1e-4,
        "goes on after a stop"
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_moving_arm_stops_when_its_client_dies() {
    let cell = Cell::start(Config {
        powered: true,
        ..Config::default()
    })
    .await;
    let mut arm = cell.connect().await;
    let far = Command::MoveJ {
        joints_rad: [1.5, -1.7, 1.9, -1.77, -1.57, 0.0],
        speed_rad_s: 0.5,
        accel_rad_s2: 2.0,
    };
    let moving = drive(&mut arm, far, |state| state.actual_qd[0] > 0.45).await;
    drop(arm);
    cell.until("standstill", |controller| {
        controller.speeds_rad_s()[0].abs() < 1e-6
    })
    .await;
    let controller = lock(&cell.controller);
    let way = controller.joints_rad()[0] - moving.actual_q[0];
    // Ten silent cycles and the deceleration.
    assert!(
        way > 0.0 && way < 0.5 * (12.0 * Series::Cb3.step_s()) + 0.5 * 0.5 / 8.0 + 0.02,
        "{way}"
    );
    assert_eq!(controller.robot.outputs.ints[27], 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_client_that_comes_back_must_see_the_fault_before_it_moves_again() {
    let cell = Cell::start(Config {
        powered: true,
        ..Config::default()
    })
    .await;
    let mut arm = cell.connect().await;
    let goal = [0.6, -1.7, 1.9, -1.77, -1.57, 0.0];
    let far = Command::MoveJ {
        joints_rad: goal,
        speed_rad_s: 0.5,
        accel_rad_s2: 2.0,
    };
    drive(&mut arm, far, |state| state.actual_qd[0] > 0.45).await;
    cell.until("watchdog", |controller| {
        controller.robot.outputs.ints[27] == 1 && controller.robot.is_steady()
    })
    .await;
    // A hold that was sent before the fault was seen does not clear it.
    arm.send(&Command::Hold).await.unwrap();
    let state = drive(&mut arm, far, |state| state.program.fault.is_some()).await;
    assert_eq!(state.program.fault, Some(Fault::ClientSilent));
    let start_s = state.timestamp_s;
    let state = drive(&mut arm, far, |state| state.timestamp_s > start_s + 0.5).await;
    assert!(
        state.actual_qd[0].abs() < 1e-3 && (state.actual_q[0] - 0.6).abs() > 0.1,
        "moves with a fault"
    );
    drive(&mut arm, Command::Hold, |state| {
        state.program.fault.is_none()
    })
    .await;
    drive(&mut arm, far, finished).await;
    assert!(largest_difference(&lock(&cell.controller).joints_rad(), &goal) < 1e-3);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_sample_far_from_the_arm_is_refused() {
    let cell = Cell::start(Config {
        powered: true,
        ..Config::default()
    })
    .await;
    let mut arm = cell.connect().await;
    let jump = Command::Stream(Window {
        first: 1,
        joints_rad: [[0.05, -1.7, 1.9, -1.77, -1.57, 0.0]; 4],
        last: Some(4),
    });
    let state = drive(&mut arm, jump, |state| state.program.fault.is_some()).await;
    assert_eq!(state.program.fault, Some(Fault::SampleStep));
    assert_eq!(lock(&cell.controller).safety_mode(), SafetyMode::Normal);
    assert!(lock(&cell.controller).joints_rad()[0].abs() < 1e-9);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stream_that_is_used_up_stops_the_arm_and_never_goes_on() {
    let cell = Cell::start(Config {
        powered: true,
        ..Config::default()
    })
    .await;
    let mut arm = cell.connect().await;
    let sample = |number: i32| [f64::from(number) * 0.004, -1.7, 1.9, -1.77, -1.57, 0.0];
    let window = |first: i32| {
        Command::Stream(Window {
            first,
            joints_rad: [0, 1, 2, 3].map(|n| sample(first + n)),
            last: None,
        })
    };
    // Packages keep coming, but never a newer window.
    let starved = |state: &State| state.program.fault.is_some();
    let state = drive(&mut arm, window(1), starved).await;
    assert_eq!(state.program.fault, Some(Fault::Starved));
    assert_eq!(state.program.sample_consumed, 4);
    let due_s = state.timestamp_s + 0.4;
    let stands = drive(&mut arm, window(5), |state| state.timestamp_s > due_s).await;
    let later = drive(&mut arm, window(9), |state| state.timestamp_s > due_s + 0.5).await;
    assert!(largest_difference(&later.actual_q, &stands.actual_q) < 1e-6);
    assert_eq!(later.program.sample_consumed, 4);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_slider_stretches_a_stream_and_no_sample_is_skipped() {
    let cell = Cell::start(Config {
        powered: true,
        ..Config::default()
    })
    .await;
    let mut arm = cell.connect().await;
    let mut full_s = 0.0;
    for slider in [1.0, 0.5, 0.2] {
        lock(&cell.controller).set_speed_slider(slider);
        let settled = |state: &State| finished(state) && state.speed_scaling == slider;
        let start = drive(&mut arm, Command::Hold, settled).await;
        let sample = |number: i32| {
            let mut joints_rad = start.target_q;
            joints_rad[0] += 0.1 * (1.0 - (f64::from(number) * 0.02).cos());
            joints_rad
        };
        // Asserts that the numbers consumed go up by one.
        let end = follow(&mut arm, 157, sample).await;
        let taken_s = end.timestamp_s - start.timestamp_s;
        if slider == 1.0 {
            full_s = taken_s;
        }
        assert!((taken_s * slider / full_s - 1.0).abs() < 0.05, "{taken_s}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_e_series_follows_a_stream_at_500_samples_a_second() {
    let cell = Cell::start(Config {
        powered: true,
        ..Config::of(Series::E)
    })
    .await;
    let mut arm = cell.connect().await;
    assert_eq!(arm.identity().series, ur_link::Series::ESeries);
    assert_eq!(arm.period_s(), 0.002);
    let start = drive(&mut arm, Command::Hold, finished).await;
    let sample = |number: i32| {
        let mut joints_rad = start.target_q;
        joints_rad[0] += 0.1 * (1.0 - (f64::from(number) * 0.005).cos());
        joints_rad
    };
    let end = follow(&mut arm, 628, sample).await;
    let taken_s = end.timestamp_s - start.timestamp_s;
    assert!((taken_s - 628.0 * 0.002).abs() < 0.02, "{taken_s}");
    drive(&mut arm, Command::Stop, |state| {
        finished(state) && state.actual_qd[0].abs() < 1e-4
    })
    .await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_controller_that_must_not_be_commanded_is_named() {
    let cell = Cell::start(Config {
        control: crate::ur5::Control::Local,
        ..Config::of(Series::E)
    })
    .await;
    let refusal = ur_link::Controller::connect(cell.options()).await.err();
    assert!(matches!(refusal, Some(Error::LocalControl)), "{refusal:?}");

    let cell = Cell::start(Config {
        version: Some("3.8.0.1".parse().unwrap()),
        ..Config::default()
    })
    .await;
    let refusal = ur_link::Controller::connect(cell.options()).await.err();
    assert!(matches!(refusal, Some(Error::TooOld { .. })), "{refusal:?}");

    let cell = Cell::start(Config::of(Series::E)).await;
    let mut options = cell.options();
    options.expected = Some(ur_link::Expected {
        series: ur_link::Series::Cb3,
        model: "UR5".to_owned(),
    });
    let refusal = ur_link::Controller::connect(options).await.err();
    assert!(
        matches!(refusal, Some(Error::WrongRobot { .. })),
        "{refusal:?}"
    );
    assert_eq!(
        lock(&cell.controller).robot_mode(),
        ur_link::RobotMode::PowerOff
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_program_that_was_paused_does_not_go_on_with_its_stream() {
    let cell = Cell::start(Config {
        powered: true,
        ..Config::default()
    })
    .await;
    let mut arm = cell.connect().await;
    let sample = |number: i32| [f64::from(number) * 0.002, -1.7, 1.9, -1.77, -1.57, 0.0];
    let mut stream = Stream::new();
    let mut paused_at_s = f64::INFINITY;
    let state = loop {
        let state = arm.next_state().await.unwrap();
        stream.consume(state.program.sample_consumed).unwrap();
        while stream.wants() {
            stream.push(sample(stream.next_number()));
        }
        let window = stream.window().unwrap();
        arm.send(&Command::Stream(window)).await.unwrap();
        if state.program.sample_consumed == 50 && paused_at_s.is_infinite() {
            paused_at_s = state.timestamp_s;
            lock(&cell.controller).set_paused(true);
        }
        if state.timestamp_s > paused_at_s + 0.5 {
            lock(&cell.controller).set_paused(false);
        }
        if state.program.fault.is_some() {
            break state;
        }
        assert!(state.program.sample_consumed < 54, "{state:?}");
    };
    assert_eq!(state.program.fault, Some(Fault::Paused));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_program_that_is_started_again_does_not_go_on_with_its_move() {
    let cell = Cell::start(Config {
        powered: true,
        ..Config::default()
    })
    .await;
    let mut arm = cell.connect().await;
    let far = Command::MoveJ {
        joints_rad: [1.5, -1.7, 1.9, -1.77, -1.57, 0.0],
        speed_rad_s: 0.5,
        accel_rad_s2: 2.0,
    };
    drive(&mut arm, far, |state| state.actual_qd[0] > 0.45).await;
    // The same program over the same registers, as PolyScope's play button has it.
    let session = lock(&cell.controller).robot.outputs.ints[24];
    let text = ur_link::program::text(&cell.options(), session).unwrap();
    lock(&cell.controller).load_program(&text).unwrap();
    let start_s = lock(&cell.controller).timestamp_s();
    let stands = drive(&mut arm, far, |state| state.timestamp_s > start_s + 0.5).await;
    let later = drive(&mut arm, far, |state| state.timestamp_s > start_s + 1.5).await;
    assert!(later.program.ready, "{later:?}");
    assert!(largest_difference(&later.actual_q, &stands.actual_q) < 1e-5);
    // What is commanded anew is obeyed.
    drive(&mut arm, Command::Hold, finished).await;
    drive(&mut arm, far, finished).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_program_that_another_replaced_is_not_ready() {
    let cell = Cell::start(Config {
        powered: true,
        ..Config::default()
    })
    .await;
    let mut arm = cell.connect().await;
    drive(&mut arm, Command::Hold, finished).await;
    let other = "def other():\n  while True:\n    sync()\n  end\nend\n";
    lock(&cell.controller).load_program(other).unwrap();
    let state = drive(&mut arm, Command::Hold, |state| !state.program.ready).await;
    assert_eq!(state.runtime_state, ur_link::RuntimeState::Playing);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn after_a_protective_stop_nothing_moves_until_recovered_and_commanded_anew() {
    let cell = Cell::start(Config {
        powered: true,
        ..Config::default()
    })
    .await;
    let mut arm = cell.connect().await;
    let far = Command::MoveJ {
        joints_rad: [1.5, -1.7, 1.9, -1.77, -1.57, 0.0],
        speed_rad_s: 0.5,
        accel_rad_s2: 2.0,
    };
    drive(&mut arm, far, |state| state.actual_qd[0] > 0.45).await;
    lock(&cell.controller).protective_stop("collision");
    let state = drive(&mut arm, far, |state| {
        state.safety_mode == SafetyMode::ProtectiveStop
    })
    .await;
    assert!(!state.program.ready);
    assert!(
        matches!(arm.recover().await, Err(Error::UnlockTooEarly { .. })),
        "unlocked within five seconds"
    );
    let due_s = state.timestamp_s + 5.1;
    drive(&mut arm, far, |state| state.timestamp_s > due_s).await;
    let before = lock(&cell.controller).joints_rad();
    arm.recover().await.unwrap();
    let state = drive(&mut arm, Command::Hold, finished).await;
    assert!(state.program.ready && state.safety_mode == SafetyMode::Normal);
    assert!(
        largest_difference(&lock(&cell.controller).joints_rad(), &before) < 1e-6,
        "moved by itself"
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_input_has_one_writer() {
    let cell = Cell::start(Config {
        powered: true,
        ..Config::default()
    })
    .await;
    let arm = cell.connect().await;
    let second = ur_link::Controller::connect(cell.options()).await;
    assert!(matches!(second, Err(Error::InUse { .. })));
    drop(arm);
    let deadline = Instant::now() + Duration::from_secs(10);
    while let Err(error) = ur_link::Controller::connect(cell.options()).await {
        assert!(Instant::now() < deadline, "{error}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_dashboard_answers_line_by_line() {
    let cell = Cell::start(Config::default()).await;
    let mut dashboard = Dashboard::connect(
        "127.0.0.1",
        cell.addresses.dashboard.port(),
        Duration::from_secs(5),
    )
    .await
    .unwrap();
    assert_eq!(
        dashboard.polyscope_version().await.unwrap(),
        "3.15.8.106339"
    );
    assert_eq!(
        dashboard.robot_mode().await.unwrap(),
        ur_link::RobotMode::PowerOff
    );
    assert!(
        dashboard
            .ask("nonsense")
            .await
            .unwrap()
            .starts_with("could not understand")
    );
    assert!(matches!(
        dashboard.brake_release().await,
        Err(Error::Refused { .. })
    ));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn script_interfaces_send_their_packets_and_take_programs() {
    let cell = Cell::start(Config {
        powered: true,
        ..Config::default()
    })
    .await;
    let mut realtime = TcpStream::connect(cell.addresses.realtime).await.unwrap();
    assert_eq!(realtime.read_i32().await.unwrap(), 1116);
    let mut primary = TcpStream::connect(cell.addresses.primary).await.unwrap();
    let size = primary.read_i32().await.unwrap();
    assert_eq!(primary.read_u8().await.unwrap(), 20);
    let mut version = vec![0; size as usize - 5];
    primary.read_exact(&mut version).await.unwrap();
    assert_eq!(&version[9..19], b"\x03\x09URContro");
    let mut secondary = TcpStream::connect(cell.addresses.secondary).await.unwrap();
    secondary
        .write_all(b"def one():\n  movej([0.1, -1.7, 1.9, -1.77, -1.57, 0])\n")
        .await
        .unwrap();
    secondary.write_all(b"end\n").await.unwrap();
    cell.until("arrival", |controller| {
        (controller.joints_rad()[0] - 0.1).abs() < 1e-6
    })
    .await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn garbage_ends_its_connection_and_nothing_else() {
    let cell = Cell::start(Config {
        powered: true,
        ..Config::default()
    })
    .await;
    for garbage in [&[0u8, 1, 86][..], &[0, 3, 1], &[0xff; 4096]] {
        let mut stream = TcpStream::connect(cell.addresses.rtde).await.unwrap();
        stream.write_all(garbage).await.unwrap();
        stream.shutdown().await.unwrap();
        let mut rest = Vec::new();
        let _ = stream.read_to_end(&mut rest).await;
        assert!(rest.is_empty());
    }
    cell.connect().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_client_that_does_not_read_gets_the_newest_state_later() {
    let cell = Cell::start(Config {
        powered: true,
        ..Config::default()
    })
    .await;
    let mut slow = ur_link::rtde::Client::connect(
        "127.0.0.1",
        cell.addresses.rtde.port(),
        Duration::from_secs(5),
    )
    .await
    .unwrap();
    let recipe = slow
        .setup_outputs(
            125.0,
            &[
                ("timestamp", Type::Double),
                ("target_q", Type::Vector6D),
                ("target_qd", Type::Vector6D),
                ("target_qdd", Type::Vector6D),
                ("actual_q", Type::Vector6D),
                ("actual_qd", Type::Vector6D),
                ("joint_temperatures", Type::Vector6D),
                ("actual_joint_voltage", Type::Vector6D),
                ("tcp_offset", Type::Vector6D),
            ],
        )
        .await
        .unwrap();
    slow.start().await.unwrap();
    // 40 MB: far more than all socket buffers hold.
    cell.until("a long time", |controller| controller.timestamp_s() > 800.0)
        .await;
    cell.paused.store(true, Ordering::Release);
    let truth = lock(&cell.controller).timestamp_s();
    let mut newest = 0.0;
    let mut quiet = false;
    while !quiet {
        match slow.newest(&recipe, Duration::from_millis(300)).await {
            Ok(mut fields) => {
                newest = f64::from_be_bytes(ur_link::rtde::wire::take(&mut fields).unwrap())
            }
            Err(Error::Timeout { .. }) => quiet = true,
            Err(error) => panic!("{error}"),
        }
    }
    assert!(newest <= truth);
    cell.paused.store(false, Ordering::Release);
    // The package that was half sent comes first; no other old one does.
    let mut now = 0.0;
    for _ in 0..2 {
        let mut fields = slow.newest(&recipe, Duration::from_secs(5)).await.unwrap();
        now = f64::from_be_bytes(ur_link::rtde::wire::take(&mut fields).unwrap());
    }
    assert!(now > truth, "{now} after {truth}");
}

/// Not a judgement: prints what lock step costs. Run with `--ignored --nocapture`.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "a measurement"]
async fn measure_cycles_per_second_with_one_controlling_client() {
    let cell = Cell::start(Config {
        powered: true,
        ..Config::default()
    })
    .await;
    let mut arm = cell.connect().await;
    let start = drive(&mut arm, Command::Hold, finished).await;
    let wall = Instant::now();
    let mut received = 0u32;
    let mut stream = Stream::new();
    let mut state = start;
    while wall.elapsed() < Duration::from_secs(3) {
        state = arm.next_state().await.unwrap();
        stream.consume(state.program.sample_consumed).unwrap();
        while stream.wants() {
            let mut joints_rad = start.target_q;
            let time_s = f64::from(stream.next_number()) * arm.period_s();
            joints_rad[0] += 0.3 * (1.0 - time_s.cos());
            stream.push(joints_rad);
        }
        let window = stream.window().unwrap();
        arm.send(&Command::Stream(window)).await.unwrap();
        assert_eq!(state.program.fault, None);
        received += 1;
    }
    let seconds = wall.elapsed().as_secs_f64();
    let cycles = (state.timestamp_s - start.timestamp_s) / Series::Cb3.step_s();
    eprintln!(
        "{:.0} cycles/s, {:.0} states/s",
        cycles / seconds,
        f64::from(received) / seconds
    );
    let reached = kinematics::UR5.flange(&lock(&cell.controller).joints_rad());
    assert!(reached.translation.vector.norm() > 0.1);
}
