use proptest::prelude::*;

use super::*;

fn name() -> impl Strategy<Value = String> {
    proptest::string::string_regex("[a-z][a-z0-9_]{0,30}").unwrap()
}

fn text() -> impl Strategy<Value = Text> {
    (".{0,60}", ".{0,60}", 0..4u8).prop_map(|(message, source, level)| Text {
        message,
        source,
        level,
    })
}

fn request() -> impl Strategy<Value = Request> {
    let names = || proptest::collection::vec(name(), 0..40);
    prop_oneof![
        any::<u16>().prop_map(Request::ProtocolVersion),
        Just(Request::ControllerVersion),
        text().prop_map(Request::Text),
        (1.0..500.0f64, names()).prop_map(|(hz, names)| Request::SetupOutputs {
            frequency_hz: Some(hz),
            names
        }),
        names().prop_map(|names| Request::SetupInputs { names }),
        Just(Request::Start),
        Just(Request::Pause),
        (any::<u8>(), proptest::collection::vec(any::<u8>(), 0..300))
            .prop_map(|(recipe, fields)| Request::Data { recipe, fields }),
    ]
}

fn kind() -> impl Strategy<Value = Type> {
    proptest::sample::select(Type::ALL.to_vec())
}

fn reply() -> impl Strategy<Value = Reply> {
    let types = || proptest::collection::vec(kind(), 0..40);
    prop_oneof![
        any::<bool>().prop_map(|accepted| Reply::ProtocolVersion { accepted }),
        any::<[u32; 4]>().prop_map(Reply::ControllerVersion),
        text().prop_map(Reply::Text),
        (any::<u8>(), types()).prop_map(|(id, types)| Reply::SetupOutputs {
            recipe: Some(id),
            types
        }),
        (any::<u8>(), types()).prop_map(|(recipe, types)| Reply::SetupInputs { recipe, types }),
        any::<bool>().prop_map(|accepted| Reply::Start { accepted }),
        any::<bool>().prop_map(|accepted| Reply::Pause { accepted }),
        (any::<u8>(), proptest::collection::vec(any::<u8>(), 0..300)).prop_map(|(id, fields)| {
            Reply::Data {
                recipe: Some(id),
                fields,
            }
        }),
    ]
}

fn value() -> impl Strategy<Value = Value> {
    prop_oneof![
        any::<bool>().prop_map(Value::Bool),
        any::<u8>().prop_map(Value::UInt8),
        any::<u32>().prop_map(Value::UInt32),
        any::<u64>().prop_map(Value::UInt64),
        any::<i32>().prop_map(Value::Int32),
        (-1e9..1e9f64).prop_map(Value::Double),
        proptest::array::uniform3(-1e3..1e3f64).prop_map(Value::Vector3D),
        proptest::array::uniform6(-1e3..1e3f64).prop_map(Value::Vector6D),
        any::<[i32; 6]>().prop_map(Value::Vector6Int32),
        any::<[u32; 6]>().prop_map(Value::Vector6UInt32),
    ]
}

proptest! {
    #[test]
    fn a_request_comes_back_as_it_was(request in request()) {
        let mut bytes = Vec::new();
        request.encode(Version::V2, &mut bytes);
        let frame = Frame::first(&bytes).unwrap().unwrap();
        prop_assert_eq!(frame.size(), bytes.len());
        prop_assert_eq!(Request::decode(frame, Version::V2).unwrap(), request);
    }

    #[test]
    fn a_reply_comes_back_as_it_was(reply in reply()) {
        let mut bytes = Vec::new();
        reply.encode(Version::V2, &mut bytes);
        let frame = Frame::first(&bytes).unwrap().unwrap();
        prop_assert_eq!(Reply::decode(frame, Version::V2).unwrap(), reply);
    }

    #[test]
    fn values_come_back_as_they_were_and_no_byte_may_be_missing(values in proptest::collection::vec(value(), 1..20)) {
        let kinds: Vec<_> = values.iter().map(Value::kind).collect();
        let mut bytes = Vec::new();
        values.iter().for_each(|value| value.encode(&mut bytes));
        prop_assert_eq!(bytes.len(), kinds.iter().map(|kind| kind.bytes()).sum::<usize>());
        prop_assert_eq!(take_values(&kinds, &bytes), Some(values));
        prop_assert_eq!(take_values(&kinds, &bytes[..bytes.len() - 1]), None);
        bytes.push(0);
        prop_assert_eq!(take_values(&kinds, &bytes), None);
    }

    #[test]
    fn any_bytes_are_frames_or_an_error(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        if let Ok(Some(frame)) = Frame::first(&bytes) {
            for version in [Version::V1, Version::V2] {
                let _ = Request::decode(frame, version);
                let _ = Reply::decode(frame, version);
            }
        }
    }

    #[test]
    fn a_frame_in_pieces_is_none_until_its_last_byte(request in request()) {
        let mut bytes = Vec::new();
        request.encode(Version::V2, &mut bytes);
        for end in 0..bytes.len() {
            prop_assert_eq!(Frame::first(&bytes[..end]).unwrap(), None);
        }
    }
}

#[test]
fn the_bytes_are_those_of_the_guide() {
    let mut bytes = Vec::new();
    Request::ProtocolVersion(2).encode(Version::V1, &mut bytes);
    assert_eq!(bytes, [0, 5, 86, 0, 2]);
    bytes.clear();
    let names = vec!["timestamp".to_owned(), "actual_q".to_owned()];
    Request::SetupOutputs {
        frequency_hz: Some(125.0),
        names,
    }
    .encode(Version::V2, &mut bytes);
    assert_eq!(
        bytes,
        [
            &b"\x00\x1dO\x40\x5f\x40\0\0\0\0\0"[..],
            b"timestamp,actual_q"
        ]
        .concat()
    );
    bytes.clear();
    Reply::SetupOutputs {
        recipe: Some(1),
        types: vec![Type::Double, Type::NotFound],
    }
    .encode(Version::V2, &mut bytes);
    assert_eq!(bytes, b"\x00\x14O\x01DOUBLE,NOT_FOUND");
}

#[test]
fn empty_names_after_a_trailing_comma_are_skipped() {
    let frame = Frame {
        kind: b'I',
        payload: b"input_int_register_24, speed_slider_mask,,",
    };
    let names = vec![
        "input_int_register_24".to_owned(),
        "speed_slider_mask".to_owned(),
    ];
    assert_eq!(
        Request::decode(frame, Version::V2),
        Ok(Request::SetupInputs { names })
    );
}

#[test]
fn version_1_has_neither_frequency_nor_recipe() {
    let frame = Frame {
        kind: b'O',
        payload: b"timestamp",
    };
    let expected = Request::SetupOutputs {
        frequency_hz: None,
        names: vec!["timestamp".to_owned()],
    };
    assert_eq!(Request::decode(frame, Version::V1), Ok(expected));
    let mut bytes = Vec::new();
    Reply::Data {
        recipe: None,
        fields: vec![7],
    }
    .encode(Version::V1, &mut bytes);
    assert_eq!(bytes, [0, 4, 85, 7]);
}

#[test]
fn what_cannot_be_is_refused() {
    assert_eq!(Frame::first(&[0, 2, 86]), Err(Error::Size(2)));
    let decode = |kind, payload: &[u8]| Request::decode(Frame { kind, payload }, Version::V2);
    assert_eq!(decode(b'V', &[0]), Err(Error::Short(b'V')));
    assert_eq!(decode(b'S', &[1]), Err(Error::Long(b'S', 1)));
    assert_eq!(decode(b'x', &[]), Err(Error::PackageType(b'x')));
    assert_eq!(decode(b'I', &[0xff]), Err(Error::Text(b'I')));
    assert_eq!(decode(b'I', &[b'a'; 2049]), Err(Error::Names(2049)));
    let unknown = Reply::decode(
        Frame {
            kind: b'I',
            payload: b"\x01FLOAT",
        },
        Version::V2,
    );
    assert_eq!(unknown, Err(Error::FieldType("FLOAT".to_owned())));
}

#[test]
fn what_does_not_fit_a_frame_is_not_sent() {
    let mut bytes = vec![1, 2];
    Request::Data {
        recipe: 1,
        fields: vec![0; MAX_FRAME_BYTES],
    }
    .encode(Version::V2, &mut bytes);
    assert_eq!(bytes, [1, 2]);
}
