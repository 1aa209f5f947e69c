//! Every command of the dashboard against a server that answers as UR's manual says.
#![allow(clippy::unwrap_used, missing_docs)]

use std::{
    io::{BufRead, BufReader, Write},
    net::{SocketAddr, TcpListener},
    thread::JoinHandle,
    time::Duration,
};

use ur_link::{
    Dashboard, Error, RobotMode, SafetyMode,
    dashboard::{OperationalMode, Player, UserRole},
};

const PATIENCE: Duration = Duration::from_secs(20);

/// A server that expects these lines and gives these answers.
struct Server {
    address: SocketAddr,
    thread: JoinHandle<()>,
}

impl Server {
    fn new(lines: Vec<(&'static str, String)>) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let thread = std::thread::spawn(move || {
            let mut stream = BufReader::new(listener.accept().unwrap().0);
            let greeting = b"Connected: Universal Robots Dashboard Server\n";
            stream.get_mut().write_all(greeting).unwrap();
            for (expected, answer) in lines {
                let mut line = String::new();
                stream.read_line(&mut line).unwrap();
                assert_eq!(line, format!("{expected}\n"));
                stream.get_mut().write_all(answer.as_bytes()).unwrap();
            }
            // Until the client goes.
            let _ = stream.read_line(&mut String::new());
        });
        Self { address, thread }
    }

    async fn connect(&self, patience: Duration) -> Dashboard {
        let address = self.address;
        Dashboard::connect(&address.ip().to_string(), address.port(), patience)
            .await
            .unwrap()
    }

    fn join(self) {
        self.thread.join().unwrap();
    }
}

/// One question, its answer, and what is made of it.
macro_rules! asked {
    ($expected:literal, $answer:expr, $method:ident($($argument:expr),*)) => {{
        let server = Server::new(vec![($expected, format!("{}\n", $answer))]);
        let mut dashboard = server.connect(PATIENCE).await;
        let outcome = dashboard.$method($($argument),*).await;
        drop(dashboard);
        server.join();
        outcome
    }};
}

#[tokio::test]
async fn what_is_accepted_is_done() {
    asked!(
        "load a.urp",
        "Loading program: /programs/a.urp",
        load("a.urp")
    )
    .unwrap();
    asked!(
        "load installation d",
        "Loading installation: d",
        load_installation("d")
    )
    .unwrap();
    asked!("play", "Starting program", play()).unwrap();
    asked!("pause", "Pausing program", pause()).unwrap();
    asked!("stop", "Stopped", stop()).unwrap();
    asked!("popup look", "showing popup", popup("look")).unwrap();
    asked!("close popup", "closing popup", close_popup()).unwrap();
    asked!("addToLog here", "Added log message", add_to_log("here")).unwrap();
    asked!("power on", "Powering on", power_on()).unwrap();
    asked!("power off", "Powering off", power_off()).unwrap();
    asked!("brake release", "Brake releasing", brake_release()).unwrap();
    asked!(
        "unlock protective stop",
        "Protective stop releasing",
        unlock_protective_stop()
    )
    .unwrap();
    asked!(
        "close safety popup",
        "closing safety popup",
        close_safety_popup()
    )
    .unwrap();
    asked!("restart safety", "Restarting safety", restart_safety()).unwrap();
    asked!(
        "setUserRole operator",
        "Setting user role: operator",
        set_user_role(UserRole::Operator)
    )
    .unwrap();
    asked!(
        "set operational mode automatic",
        "Operational mode AUTOMATIC is set",
        set_operational_mode(OperationalMode::Automatic)
    )
    .unwrap();
    asked!(
        "clear operational mode",
        "No longer controlling the operational mode. Current operational mode: 'MANUAL'.",
        clear_operational_mode()
    )
    .unwrap();
    for (command, answer) in [("quit", "Disconnected\n"), ("shutdown", "Shutting down\n")] {
        let server = Server::new(vec![(command, answer.to_owned())]);
        let dashboard = server.connect(PATIENCE).await;
        match command {
            "quit" => dashboard.quit().await.unwrap(),
            _ => dashboard.shutdown().await.unwrap(),
        }
        server.join();
    }
}

#[tokio::test]
async fn answers_are_read_as_what_they_say() {
    for (answer, running) in [
        ("Program running: true", true),
        ("Program running: false", false),
        ("Robot running: True", true),
    ] {
        assert_eq!(asked!("running", answer, running()).unwrap(), running);
    }
    let state = asked!("programState", "PAUSED a b.urp", program_state());
    assert_eq!(state.unwrap(), (Player::Paused, "a b.urp".to_owned()));
    let path = asked!("get loaded program", "Loaded program: /x", loaded_program());
    assert_eq!(path.unwrap(), Some("/x".to_owned()));
    let none = asked!("get loaded program", "No program loaded", loaded_program());
    assert_eq!(none.unwrap(), None);
    let saved = asked!("isProgramSaved", "false a.urp", is_program_saved());
    assert_eq!(saved.unwrap(), (false, "a.urp".to_owned()));
    let mode = asked!("robotmode", "Robotmode: NO_CONTROLLER", robot_mode());
    assert_eq!(mode.unwrap(), RobotMode::NoController);
    let safety = asked!("safetymode", "Safetymode: RECOVERY", safety_mode());
    assert_eq!(safety.unwrap(), SafetyMode::Recovery);
    let status = asked!(
        "safetystatus",
        "Safetystatus: SYSTEM_THREE_POSITION_ENABLING_STOP",
        safety_status()
    );
    assert_eq!(status.unwrap(), SafetyMode::ThreePositionEnablingStop);
    let version = asked!(
        "PolyscopeVersion",
        "URSoftware 5.12.2.1101534 (Jun 01 2022)",
        polyscope_version()
    );
    assert_eq!(version.unwrap(), "5.12.2.1101534");
    let serial = asked!("get serial number", "20195500001", serial_number());
    assert_eq!(serial.unwrap(), "20195500001");
    assert_eq!(
        asked!("get robot model", "UR5", robot_model()).unwrap(),
        "UR5"
    );
    let remote = asked!("is in remote control", "false", is_in_remote_control());
    assert!(!remote.unwrap());
    let role = asked!("getUserRole", "LOCKED", user_role());
    assert_eq!(role.unwrap(), UserRole::Locked);
    let mode = asked!("get operational mode", "MANUAL", operational_mode());
    assert_eq!(mode.unwrap(), Some(OperationalMode::Manual));
    let mode = asked!("get operational mode", "NONE", operational_mode());
    assert_eq!(mode.unwrap(), None);
}

#[tokio::test]
async fn a_refusal_carries_the_answer() {
    let refused = |outcome: Result<(), Error>| match outcome {
        Err(Error::Refused { request, answer }) => (request, answer),
        other => panic!("{other:?}"),
    };
    let (request, answer) = refused(asked!("load x.urp", "File not found: x.urp", load("x.urp")));
    assert_eq!(
        (request.as_str(), answer.as_str()),
        ("load x.urp", "File not found: x.urp")
    );
    refused(asked!("play", "Failed to execute: play", play()));
    let unknown = "could not understand: 'is in remote control'";
    refused(asked!("is in remote control", unknown, is_in_remote_control()).map(drop));
    refused(asked!("robotmode", "Robotmode: DANCING", robot_mode()).map(drop));
    refused(asked!("get serial number", "2019x", serial_number()).map(drop));
    let early = "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop before unlocking";
    assert!(matches!(
        asked!("unlock protective stop", early, unlock_protective_stop()),
        Err(Error::UnlockTooEarly { answer }) if answer == early
    ));
}

#[tokio::test]
async fn more_than_one_line_is_not_sent() {
    let server = Server::new(vec![]);
    let mut dashboard = server.connect(PATIENCE).await;
    for text in ["look\nplay", "look\rplay"] {
        assert!(matches!(
            dashboard.popup(text).await,
            Err(Error::Refused { .. })
        ));
    }
    drop(dashboard);
    server.join();
}

#[tokio::test]
async fn an_answer_that_was_not_waited_for_is_not_taken_for_the_next_one() {
    let server = Server::new(vec![("robotmode", String::new())]);
    let mut dashboard = server.connect(Duration::from_millis(50)).await;
    assert!(matches!(
        dashboard.robot_mode().await,
        Err(Error::Timeout { .. })
    ));
    assert!(matches!(
        dashboard.power_off().await,
        Err(Error::Refused { .. })
    ));
    drop(dashboard);
    server.join();
}

#[tokio::test]
async fn a_line_without_end_is_given_up() {
    let server = Server::new(vec![("robotmode", "R".repeat(5000))]);
    let mut dashboard = server.connect(PATIENCE).await;
    assert!(matches!(
        dashboard.robot_mode().await,
        Err(Error::Refused { .. })
    ));
    drop(dashboard);
    server.join();
}
