//! What the RTDE client makes of controllers: old ones, busy ones, those that lie.
#![allow(clippy::unwrap_used, missing_docs)]

mod robot;

use std::{sync::mpsc, time::Duration};

use robot::{CB3, E_SERIES, Robot, Served, Talk};
use ur_link::{
    Error,
    rtde::{
        Client, Reader,
        wire::{self, Request, Type, Version},
    },
};

const PATIENCE: Duration = Duration::from_secs(20);

ur_link::outputs! {
    struct Joints {
        actual_q: [f64; 6],
        robot_mode: ur_link::RobotMode,
    }
}

ur_link::inputs! {
    struct Mode {
        input_int_register_24 as mode: i32,
        input_double_register_24 as target: f64,
    }
}

async fn connect(served: &Served) -> Result<Client, Error> {
    let address = served.address;
    Client::connect(&address.ip().to_string(), address.port(), PATIENCE).await
}

fn read(served: &Served) -> Result<Reader<Joints>, Error> {
    let address = served.address;
    Reader::connect(&address.ip().to_string(), address.port(), 0.0, PATIENCE)
}

#[tokio::test]
async fn a_controller_that_has_only_version_1_is_spoken_to_in_version_1() {
    let robot = Robot {
        protocol: 1,
        ..Robot::new([3, 3, 1, 0])
    };
    let served = robot.serve(|line| {
        assert_eq!((line.version, line.frequency_hz), (Version::V1, None));
        let state = line.state(7.0);
        line.send(&state);
    });
    let mut client = connect(&served).await.unwrap();
    assert_eq!(client.protocol(), Version::V1);
    assert!(matches!(
        client.subscribe::<Joints>(25.0).await,
        Err(Error::Value {
            field: "frequency_hz",
            ..
        })
    ));
    let mut states = client.subscribe::<Joints>(125.0).await.unwrap();
    client.start().await.unwrap();
    let sample = client.sample(&mut states, PATIENCE).await.unwrap();
    assert_eq!((sample.timestamp_s, sample.skipped), (7.0, 0));
    drop(client);
    served.join();
}

#[tokio::test]
async fn a_controller_with_neither_version_is_refused() {
    let robot = Robot {
        protocol: 0,
        ..Robot::new(CB3)
    };
    let served = robot.serve(|_| {});
    assert!(matches!(connect(&served).await, Err(Error::Refused { .. })));
    served.join();
}

#[tokio::test]
async fn software_whose_rtde_is_wrong_is_refused() {
    let served = Robot::new([3, 2, 18744, 0]).serve(|_| {});
    assert!(matches!(connect(&served).await, Err(Error::TooOld { .. })));
    served.join();
}

#[tokio::test]
async fn a_rate_that_the_controller_does_not_have_is_refused_and_0_is_the_highest() {
    for (software, highest) in [(CB3, 125.0), (E_SERIES, 500.0)] {
        let (told, asked) = mpsc::channel();
        let served = Robot::new(software).serve(move |line| told.send(line.frequency_hz).unwrap());
        let mut client = connect(&served).await.unwrap();
        for wrong in [-1.0, highest + 1.0, f64::NAN, f64::INFINITY] {
            assert!(
                matches!(
                    client.subscribe::<Joints>(wrong).await,
                    Err(Error::Value {
                        field: "frequency_hz",
                        ..
                    })
                ),
                "{wrong}"
            );
        }
        client.subscribe::<Joints>(0.0).await.unwrap();
        client.start().await.unwrap();
        assert_eq!(asked.recv().unwrap(), Some(highest));
        drop(client);
        served.join();
    }
}

#[tokio::test]
async fn missing_and_taken_fields_are_named() {
    let robot = Robot {
        taken: &["input_double_register_24"],
        ..Robot::new([3, 10, 0, 0])
    };
    let served = robot.serve(|_| {});
    let mut client = connect(&served).await.unwrap();
    let unknown = client
        .setup_outputs(
            0.0,
            &[("actual_q", Type::Vector6D), ("nonsense", Type::Bool)],
        )
        .await;
    assert!(
        matches!(&unknown, Err(Error::Field { name, answer: Type::NotFound, .. }) if name == "nonsense"),
        "{unknown:?}"
    );
    let later = client
        .setup_outputs(0.0, &[("payload", Type::Double)])
        .await;
    let text = later.unwrap_err().to_string();
    assert_eq!(
        text,
        "rtde field payload came with 3.11.0 on CB3, 5.5.1 on e-Series; the controller has 3.10.0.0"
    );
    let other = client
        .setup_outputs(0.0, &[("actual_q", Type::Double)])
        .await;
    assert!(
        matches!(&other, Err(Error::Field { name, answer: Type::Vector6D, .. }) if name == "actual_q"),
        "{other:?}"
    );
    let taken = client.publish::<Mode>().await;
    assert!(
        matches!(&taken, Err(Error::Field { name, answer: Type::InUse, .. }) if name == "input_double_register_24"),
        "{taken:?}"
    );
    let long = vec![("output_int_register_24", Type::Int32); 100];
    assert!(matches!(
        client.setup_outputs(0.0, &long).await,
        Err(Error::Wire(wire::Error::Names(_)))
    ));
    drop(client);
    served.join();
}

#[tokio::test]
async fn states_and_messages_between_a_request_and_its_answer_are_no_answer() {
    let robot = Robot {
        talkative: Talk::Latin1,
        states_before_pause: 50,
        piece: 5,
        ..Robot::new(CB3)
    };
    let served = robot.serve(|line| {
        let state = line.state(1.0);
        line.send(&state);
    });
    let mut client = connect(&served).await.unwrap();
    let mut states = client.subscribe::<Joints>(0.0).await.unwrap();
    client.publish::<Mode>().await.unwrap();
    client.start().await.unwrap();
    let sample = client.sample(&mut states, PATIENCE).await.unwrap();
    assert_eq!(sample.timestamp_s, 1.0);
    client.pause().await.unwrap();
    drop(client);
    served.join();
}

#[tokio::test]
async fn inputs_arrive_as_they_were_put() {
    let (told, got) = mpsc::channel();
    let served = Robot::new(E_SERIES).serve(move |line| told.send(line.request()).unwrap());
    let mut client = connect(&served).await.unwrap();
    client.subscribe::<Joints>(0.0).await.unwrap();
    let modes = client.publish::<Mode>().await.unwrap();
    client.start().await.unwrap();
    let mode = Mode {
        mode: 3,
        target: -0.5,
    };
    client.put(&modes, &mode).await.unwrap();
    let mut fields = 3i32.to_be_bytes().to_vec();
    fields.extend((-0.5f64).to_be_bytes());
    assert_eq!(
        got.recv().unwrap(),
        Some(Request::Data { recipe: 1, fields })
    );
    drop(client);
    served.join();
}

const BACKLOG: u32 = 4000;

/// Sends many states of 125 Hz, then tells that they are under way.
fn backlog() -> (Served, mpsc::Receiver<()>) {
    let (told, sent) = mpsc::channel();
    let served = Robot::new(CB3).serve(move |line| {
        let all: Vec<u8> = (1..=BACKLOG)
            .flat_map(|number| line.state(f64::from(number) * 0.008))
            .collect();
        line.send(&all);
        told.send(()).unwrap();
    });
    (served, sent)
}

/// Takes samples up to the last state. The system hands a backlog over in a few pieces, so it is far fewer samples than
/// states, and they account for all.
fn account(mut next: impl FnMut() -> (f64, u64)) {
    let (mut samples, mut seen, mut last_s) = (0, 0, 0.0);
    while seen < u64::from(BACKLOG) {
        let (timestamp_s, skipped) = next();
        assert!(timestamp_s > last_s);
        // The states before the first sample are not known to have been.
        seen = if samples == 0 {
            (timestamp_s / 0.008).round() as u64
        } else {
            seen + skipped + 1
        };
        assert_eq!(seen, (timestamp_s / 0.008).round() as u64);
        (samples, last_s) = (samples + 1, timestamp_s);
    }
    assert!(samples < BACKLOG / 10, "{samples} samples");
}

#[test]
fn under_backlog_the_newest_state_comes_first_and_tells_what_it_replaced() {
    let (served, sent) = backlog();
    let executor = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    let mut client = executor.block_on(connect(&served)).unwrap();
    let mut states = executor.block_on(client.subscribe::<Joints>(0.0)).unwrap();
    executor.block_on(client.start()).unwrap();
    sent.recv().unwrap();
    account(|| {
        let sample = executor.block_on(client.sample(&mut states, PATIENCE));
        let sample = sample.unwrap();
        (sample.timestamp_s, sample.skipped)
    });
    drop(client);
    served.join();
}

#[test]
fn a_blocking_reader_gets_the_newest_state_too() {
    let (served, sent) = backlog();
    let mut reader = read(&served).unwrap();
    sent.recv().unwrap();
    account(|| {
        let sample = reader.next(PATIENCE).unwrap();
        (sample.timestamp_s, sample.skipped)
    });
    assert!(matches!(
        reader.next(Duration::from_millis(20)),
        Err(Error::Timeout { .. })
    ));
    drop(reader);
    served.join();
}

#[test]
fn the_latest_sample_is_kept_for_everybody_until_the_line_ends() {
    let (go, gone) = mpsc::channel::<()>();
    let served = Robot::new(E_SERIES).serve(move |line| {
        for number in 0..100 {
            let state = line.state(1.0 + f64::from(number) * 0.002);
            line.send(&state);
        }
        gone.recv().unwrap();
        line.send(&[0, 2, 0]);
    });
    let latest = read(&served).unwrap().keep_latest(PATIENCE).unwrap();
    let (mut last, mut last_s) = (0, f64::NEG_INFINITY);
    while last_s < 1.197 {
        let sample = latest.newer_than(last, PATIENCE).unwrap();
        assert!(sample.timestamp_s > last_s);
        if last > 0 {
            assert_eq!(sample.number, last + sample.skipped + 1);
            let between = ((sample.timestamp_s - last_s) / 0.002).round() as u64 - 1;
            assert_eq!(sample.skipped, between);
        }
        (last, last_s) = (sample.number, sample.timestamp_s);
    }
    assert_eq!(latest.newest().unwrap().timestamp_s, last_s);
    assert!(matches!(
        latest.newer_than(last, Duration::from_millis(10)),
        Err(Error::Timeout { .. })
    ));
    go.send(()).unwrap();
    assert!(matches!(
        latest.newer_than(last, PATIENCE),
        Err(Error::Wire(wire::Error::Size(2)))
    ));
    assert!(matches!(
        latest.newer_than(last, PATIENCE),
        Err(Error::Closed { .. })
    ));
    // A dead line still shows its last sample, and its age.
    let age = latest.newest().unwrap().age();
    assert!(latest.newest().unwrap().age() >= age);
    drop(latest);
    served.join();
}

#[tokio::test]
async fn a_state_that_comes_again_or_late_is_not_taken_for_a_new_one() {
    let (go, gone) = mpsc::channel::<()>();
    let served = Robot::new(CB3).serve(move |line| {
        for timestamp_s in [5.0, 5.0, 4.0] {
            let state = line.state(timestamp_s);
            line.send(&state);
            gone.recv().unwrap();
        }
        let state = line.state(5.016);
        line.send(&state);
    });
    let mut client = connect(&served).await.unwrap();
    let mut states = client.subscribe::<Joints>(0.0).await.unwrap();
    client.start().await.unwrap();
    assert_eq!(
        client
            .sample(&mut states, PATIENCE)
            .await
            .unwrap()
            .timestamp_s,
        5.0
    );
    for _ in 0..2 {
        go.send(()).unwrap();
        assert!(matches!(
            client.sample(&mut states, Duration::from_millis(50)).await,
            Err(Error::Timeout { .. })
        ));
    }
    go.send(()).unwrap();
    let sample = client.sample(&mut states, PATIENCE).await.unwrap();
    assert_eq!((sample.timestamp_s, sample.skipped), (5.016, 1));
    drop(client);
    served.join();
}

#[tokio::test]
async fn a_time_that_is_no_number_and_bytes_that_are_no_protocol_end_the_connection() {
    let not_a_number: fn(&robot::Line) -> Vec<u8> = |line| line.state(f64::NAN);
    let garbage: fn(&robot::Line) -> Vec<u8> = |_| b"HTTP/1.1 400 Bad Request\r\n\r\n".repeat(3000);
    let short: fn(&robot::Line) -> Vec<u8> = |_| vec![0, 12, b'U', 1, 0, 0, 0, 0, 0, 0, 0, 0];
    let no_header: fn(&robot::Line) -> Vec<u8> = |_| vec![0, 1, 2, 3];
    for (bytes, wanted) in [
        (not_a_number, "timestamp is NaN, allowed is finite numbers"),
        (garbage, "rtde protocol violated"),
        (short, "rtde protocol violated"),
        (no_header, "rtde protocol violated"),
    ] {
        let served = Robot::new(CB3).serve(move |line| {
            let bytes = bytes(line);
            line.send(&bytes);
        });
        let mut client = connect(&served).await.unwrap();
        let mut states = client.subscribe::<Joints>(0.0).await.unwrap();
        client.start().await.unwrap();
        let error = client.sample(&mut states, PATIENCE).await.unwrap_err();
        assert_eq!(error.to_string(), wanted);
        drop(client);
        served.join();
    }
}
