use proptest::prelude::*;

use super::*;

/// Each column holds its own number.
fn packet(size: usize) -> Vec<u8> {
    let columns = (size - 4) / 8;
    let mut bytes = (size as i32).to_be_bytes().to_vec();
    bytes.extend((1..=columns).flat_map(|column| (column as f64).to_be_bytes()));
    bytes
}

#[test]
fn every_size_has_the_columns_of_its_software() {
    for (size, software) in SIZES {
        let bytes = packet(size);
        let state = State::decode(first(&bytes).unwrap().unwrap()).unwrap();
        assert_eq!(state.time_s, 1.0);
        assert_eq!(state.actual_q, [32.0, 33.0, 34.0, 35.0, 36.0, 37.0]);
        assert_eq!(state.target_tool_speed[5], 85.0);
        assert_eq!(state.digital_inputs, 86f64.to_bits());
        assert_eq!(state.robot_mode, RobotMode::Unknown(95));
        assert_eq!(state.joint_modes[5], 101);
        assert_eq!(state.tool_acceleration, [109.0, 110.0, 111.0]);
        assert_eq!(state.joint_voltages[5], 130.0);
        assert_eq!(state.program.is_some(), size >= 1060, "{software}");
        assert_eq!(state.elbow.is_some(), size >= 1108, "{software}");
        assert_eq!(state.safety_status.is_some(), size >= 1116, "{software}");
        assert_eq!(state.payload.is_some(), size >= 1220, "{software}");
    }
    let state = State::decode(&packet(1220 + 80)).unwrap();
    assert_eq!(state.payload.unwrap().inertia[5], 152.0);
}

#[test]
fn old_packets_and_nonsense_are_refused() {
    for size in [-1, 0, 3, 756, 764, 812, 1043, 1221, 5000, i32::MAX] {
        let bytes = [&size.to_be_bytes()[..], &[0; 2000]].concat();
        assert!(
            matches!(first(&bytes), Err(Error::RealtimeSize { size: told }) if told == size),
            "{size}"
        );
    }
    assert_eq!(first(&[0, 0]).unwrap(), None);
    assert_eq!(State::decode(&[0; 4]), None);
    assert_eq!(State::decode(&packet(812)), None);
}

#[test]
fn a_code_that_is_no_whole_number_is_no_mode() {
    let mut bytes = packet(1220);
    bytes[4 + 8 * 94..][..8].copy_from_slice(&f64::NAN.to_be_bytes());
    bytes[4 + 8 * 101..][..8].copy_from_slice(&1.5f64.to_be_bytes());
    let state = State::decode(&bytes).unwrap();
    assert_eq!(state.robot_mode, RobotMode::Unknown(i32::MIN));
    assert_eq!(state.safety_mode, SafetyMode::Unknown(i32::MIN));
}

proptest! {
    #[test]
    fn any_bytes_are_a_packet_or_an_error(bytes in proptest::collection::vec(any::<u8>(), 0..1300)) {
        if let Ok(Some(packet)) = first(&bytes) {
            let _ = State::decode(packet);
        }
        let _ = State::decode(&bytes);
    }
}
