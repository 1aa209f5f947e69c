use proptest::prelude::*;

use super::*;

/// Size, type, body: packets and sub-packages alike.
fn packet(kind: u8, body: &[u8]) -> Vec<u8> {
    let size = (body.len() + HEADER_BYTES) as i32;
    [&size.to_be_bytes()[..], &[kind], body].concat()
}

fn decode(bytes: &[u8]) -> Result<Message, Error> {
    Message::decode(Packet::first(bytes).unwrap().unwrap())
}

fn notice(kind: u8, body: &[u8]) -> Vec<u8> {
    let head = [&77u64.to_be_bytes()[..], &[0xfe, kind], body].concat();
    packet(ROBOT_MESSAGE, &head)
}

fn doubles(values: impl IntoIterator<Item = f64>) -> Vec<u8> {
    values.into_iter().flat_map(f64::to_be_bytes).collect()
}

#[test]
fn notices_are_read() {
    let stamp = Stamp {
        timestamp_us: 77,
        source: -2,
    };
    let version = [
        &[9][..],
        b"URControl",
        &[3, 15],
        &8i32.to_be_bytes(),
        &106_339i32.to_be_bytes(),
        b"01-01-2024",
    ]
    .concat();
    let error: Vec<u8> = [153, 4, 3, 0, 0]
        .into_iter()
        .flat_map(i32::to_be_bytes)
        .collect();
    let exception = [
        &12i32.to_be_bytes()[..],
        &5i32.to_be_bytes(),
        b"compile_error_name_not_found:foo:",
    ]
    .concat();
    let key = [&[0; 8][..], &[3], b"END", b"main"].concat();
    let safety = [&[0; 8][..], &[3, 0, 0, 0, 0, 0, 0, 0, 0]].concat();
    let cases = [
        (0, &b"hello"[..], Notice::Text("hello".into())),
        (
            3,
            &version,
            Notice::Version {
                name: "URControl".into(),
                version: [3, 15],
                bugfix: 8,
                build: 106_339,
                date: "01-01-2024".into(),
            },
        ),
        (
            5,
            &safety,
            Notice::SafetyMode {
                code: 0,
                argument: 0,
                mode: SafetyMode::ProtectiveStop,
            },
        ),
        (
            6,
            &error,
            Notice::ErrorCode(ErrorCode {
                code: 153,
                argument: 4,
                level: Level::Violation,
                data_type: 0,
                data: 0,
                text: String::new(),
            }),
        ),
        (
            7,
            &key,
            Notice::Key {
                code: 0,
                argument: 0,
                title: "END".into(),
                text: "main".into(),
            },
        ),
        (
            10,
            &exception,
            Notice::RuntimeException {
                line: 12,
                column: 5,
                text: "compile_error_name_not_found:foo:".into(),
            },
        ),
        (2, b"abc", Notice::Other { kind: 2, bytes: 3 }),
    ];
    for (kind, body, expected) in cases {
        assert_eq!(
            decode(&notice(kind, body)),
            Ok(Message::Notice(stamp, expected))
        );
    }
}

#[test]
fn remarks_print_as_manuals_list_them() {
    let mut code = ErrorCode {
        code: 153,
        argument: 4,
        level: Level::Violation,
        data_type: 0,
        data: 0,
        text: String::new(),
    };
    assert_eq!(code.to_string(), "C153A4");
    code.text = "position deviates".into();
    assert_eq!(code.to_string(), "C153A4 position deviates");
    assert!(Level::Unknown(-3) > Level::Critical);
    assert_eq!(Level::from_code(130), Level::Debug);
}

#[test]
fn a_state_of_every_software_is_read_and_what_is_new_is_passed_over() {
    let mode = |more: &[u8]| {
        let head = [
            &5u64.to_be_bytes()[..],
            &[1, 1, 1, 0, 0, 1, 0, 7, 0],
            &doubles([1.0, 0.5]),
            more,
        ]
        .concat();
        packet(
            ROBOT_STATE,
            &[packet(0, &head), packet(77, &[1, 2])].concat(),
        )
    };
    let limit = doubles([0.25]);
    for (more, expected) in [
        (vec![], None),
        (limit.clone(), Some(0.25)),
        ([&limit[..], &[9]].concat(), Some(0.25)),
    ] {
        let Ok(Message::State(state)) = decode(&mode(&more)) else {
            panic!("no state");
        };
        let mode = state.mode.unwrap();
        assert_eq!(mode.robot_mode, crate::RobotMode::Running);
        assert!(mode.program_running);
        assert_eq!(mode.speed_scaling, 0.5);
        assert_eq!(mode.target_speed_fraction_limit, expected);
    }
    let kinematics = [
        &[0, 0, 0, 9].repeat(6)[..],
        &doubles((0..24).map(f64::from)),
        &[0, 0, 0, 1],
    ]
    .concat();
    let old = packet(4, &doubles([1.0, 2.0, 3.0, 0.1, 0.2, 0.3]));
    let bytes = packet(ROBOT_STATE, &[packet(5, &kinematics), old].concat());
    let Ok(Message::State(state)) = decode(&bytes) else {
        panic!("no state");
    };
    let kinematics = state.kinematics.unwrap();
    assert_eq!(kinematics.checksum, [9; 6]);
    assert_eq!(kinematics.dh_theta[0], 0.0);
    assert_eq!(kinematics.dh_a[0], 6.0);
    assert_eq!(kinematics.dh_d[0], 12.0);
    assert_eq!(kinematics.dh_alpha[5], 23.0);
    assert_eq!(kinematics.status, 1);
    assert_eq!(state.cartesian.unwrap().flange_from_tool, None);
}

#[test]
fn sizes_that_cannot_be_are_refused() {
    for bytes in [[0, 0, 0, 4, 16], [0xff; 5], [0, 1, 0, 1, 16], [0; 5]] {
        assert!(matches!(
            Packet::first(&bytes),
            Err(Error::Size { of: "packet", .. })
        ));
    }
    assert_eq!(Packet::first(&[0, 0, 0, 6, 16]), Ok(None));
    assert_eq!(Packet::first(&[0, 0]), Ok(None));
    for part in [&[0, 0, 0, 9, 0, 1][..], &[0, 0, 0, 0, 0], &[0, 0]] {
        assert!(decode(&packet(ROBOT_STATE, part)).is_err(), "{part:?}");
    }
}

proptest! {
    #[test]
    fn any_body_is_a_message_or_an_error(kind in prop_oneof![Just(16u8), Just(20), any::<u8>()], body in proptest::collection::vec(any::<u8>(), 0..400)) {
        let _ = decode(&packet(kind, &body));
    }

    #[test]
    fn any_sub_package_is_read_or_an_error(kind in 0..14u8, body in proptest::collection::vec(any::<u8>(), 0..500)) {
        let _ = decode(&packet(ROBOT_STATE, &packet(kind, &body)));
    }

    #[test]
    fn any_notice_is_read_or_an_error(kind in 0..12u8, body in proptest::collection::vec(any::<u8>(), 0..300)) {
        let _ = decode(&notice(kind, &body));
    }
}
