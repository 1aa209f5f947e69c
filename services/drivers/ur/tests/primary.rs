//! The primary and realtime clients, and programs that are followed through what a controller says.
#![allow(clippy::unwrap_used, missing_docs)]

use std::{
    io::{Read, Write},
    net::{SocketAddr, TcpListener},
    thread::JoinHandle,
    time::Duration,
};

use ur_link::{
    Error, Primary, Realtime, RuntimeState, Script,
    primary::{Message, Notice},
    script::{Exception, Outcome},
};

const PATIENCE: Duration = Duration::from_secs(20);

/// Sends these bytes in pieces once the client has sent as many as it is to.
struct Controller {
    address: SocketAddr,
    /// Gives what the client sent.
    thread: JoinHandle<Vec<u8>>,
}

impl Controller {
    fn new(awaited: usize, bytes: Vec<u8>, piece: usize) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let thread = std::thread::spawn(move || {
            let mut stream = listener.accept().unwrap().0;
            let mut got = vec![0; awaited];
            stream.read_exact(&mut got).unwrap();
            for piece in bytes.chunks(piece) {
                // The client may have seen enough.
                if stream.write_all(piece).is_err() {
                    return got;
                }
            }
            let _ = stream.read(&mut [0]);
            got
        });
        Self { address, thread }
    }

    async fn primary(&self) -> Primary {
        let address = self.address;
        Primary::connect(&address.ip().to_string(), address.port(), PATIENCE)
            .await
            .unwrap()
    }

    fn join(self) -> Vec<u8> {
        self.thread.join().unwrap()
    }
}

fn packet(kind: u8, body: &[u8]) -> Vec<u8> {
    let size = (body.len() + 5) as i32;
    [&size.to_be_bytes()[..], &[kind], body].concat()
}

fn key(title: &str, text: &str) -> Vec<u8> {
    let head = [&[0; 9][..], &[7], &[0; 8], &[title.len() as u8]].concat();
    packet(20, &[&head, title.as_bytes(), text.as_bytes()].concat())
}

fn exception(line: i32, column: i32, text: &str) -> Vec<u8> {
    let place = [line.to_be_bytes(), column.to_be_bytes()].concat();
    packet(20, &[&[0; 9][..], &[10], &place, text.as_bytes()].concat())
}

fn state_with_identity() -> Vec<u8> {
    let parts = [packet(6, &[0; 440]), packet(5, &[0; 220])].concat();
    packet(16, &parts)
}

#[tokio::test]
async fn every_message_comes_in_order_however_the_stream_is_cut() {
    let messages = [
        packet(16, &[]),
        key("A", "b"),
        packet(25, &[1, 2, 3]),
        state_with_identity(),
    ];
    let controller = Controller::new(0, messages.concat(), 7);
    let mut primary = controller.primary().await;
    assert!(matches!(
        primary.next(PATIENCE).await.unwrap(),
        Message::State(_)
    ));
    assert!(matches!(
        primary.next(PATIENCE).await.unwrap(),
        Message::Notice(_, Notice::Key { title, .. }) if title == "A"
    ));
    assert_eq!(
        primary.next(PATIENCE).await.unwrap(),
        Message::Other { kind: 25, bytes: 3 }
    );
    primary.identity().await.unwrap();
    assert!(matches!(
        primary.next(Duration::from_millis(20)).await,
        Err(Error::Timeout { .. })
    ));
    drop(primary);
    controller.join();
}

#[tokio::test]
async fn bytes_that_are_no_packets_end_the_connection() {
    let controller = Controller::new(0, vec![0xff; 1000], 100);
    let mut primary = controller.primary().await;
    assert!(matches!(
        primary.next(PATIENCE).await,
        Err(Error::Primary(_))
    ));
    drop(primary);
    controller.join();
}

const TEXT: &str = "def main():\n  sync()\nend\n";

#[tokio::test]
async fn a_program_is_followed_from_its_upload_to_its_end() {
    let said = [
        key("PROGRAM_XXX_STOPPED", "before"),
        key("PROGRAM_XXX_STARTED", "main"),
        packet(16, &[]),
        exception(2, 3, "something_failed"),
        key("PROGRAM_XXX_STOPPED", "main"),
    ];
    let controller = Controller::new(TEXT.len(), said.concat(), 11);
    let mut primary = controller.primary().await;
    let script = Script::new(TEXT).unwrap();
    script.run(&mut primary, PATIENCE).await.unwrap();
    let outcome = script.outcome(&mut primary, PATIENCE).await.unwrap();
    let failed = Exception {
        line: 2,
        column: 3,
        text: "something_failed".into(),
    };
    assert_eq!(outcome, Outcome::Failed(failed));
    drop(primary);
    assert_eq!(controller.join(), TEXT.as_bytes());
}

#[tokio::test]
async fn a_program_that_does_not_compile_is_an_error_with_its_place() {
    let said = exception(1, 5, "compile_error_name_not_found:foo:");
    let controller = Controller::new(TEXT.len(), said, 11);
    let mut primary = controller.primary().await;
    let script = Script::new(TEXT).unwrap();
    let error = script.run(&mut primary, PATIENCE).await.unwrap_err();
    assert_eq!(
        error.to_string(),
        "program main failed at line 1, column 5: compile_error_name_not_found:foo:"
    );
    drop(primary);
    controller.join();
}

#[tokio::test]
async fn a_program_of_which_nothing_is_heard_did_not_begin() {
    let controller = Controller::new(TEXT.len(), packet(16, &[]), 11);
    let mut primary = controller.primary().await;
    let script = Script::new(TEXT).unwrap();
    assert!(matches!(
        script.run(&mut primary, Duration::from_millis(50)).await,
        Err(Error::Timeout {
            what: "start of the program",
            ..
        })
    ));
    drop(primary);
    controller.join();
}

#[tokio::test]
async fn the_realtime_interface_gives_the_newest_of_what_came() {
    let cycle = |time_s: f64| {
        let mut bytes = 1060i32.to_be_bytes().to_vec();
        bytes.extend(time_s.to_be_bytes());
        bytes.extend([2.0f64.to_be_bytes(); 131].concat());
        bytes
    };
    let all: Vec<u8> = (1..=30)
        .flat_map(|number| cycle(f64::from(number)))
        .collect();
    let controller = Controller::new(0, all, 1000);
    let address = controller.address;
    let host = address.ip().to_string();
    let mut realtime = Realtime::connect(&host, address.port(), PATIENCE)
        .await
        .unwrap();
    let mut last_s = 0.0;
    while last_s < 30.0 {
        let state = realtime.newest(PATIENCE).await.unwrap();
        assert!(state.time_s > last_s);
        assert_eq!(state.program, Some(RuntimeState::Playing));
        last_s = state.time_s;
    }
    drop(realtime);
    controller.join();
}
