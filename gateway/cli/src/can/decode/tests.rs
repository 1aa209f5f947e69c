use epos4_link::canopen::nmt::{Command, State, Target};
use epos4_link::canopen::sdo::AbortCode;

use super::*;

fn explained(frames: &[Frame]) -> String {
    let mut decoder = Decoder::default();
    let mut last = String::new();
    for frame in frames {
        last = decoder.explain(frame);
    }
    last
}

fn request(node_id: u16, request: &Request) -> Frame {
    Frame::standard(0x600 + node_id, request.encode())
}

fn response(node_id: u16, response: &Response) -> Frame {
    Frame::standard(0x580 + node_id, response.encode())
}

#[test]
fn each_service_is_told_in_words() {
    let statusword = Address::new(0x6041, 0);
    for (frame, words) in [
        (
            nmt::encode(Command::Start, Target::All),
            "NMT start all nodes",
        ),
        (heartbeat::encode(3, State::BootUp), "node 3 boot-up"),
        (
            heartbeat::encode(3, State::Operational),
            "node 3 heartbeat OPERATIONAL",
        ),
        (
            Emergency::new(0x8611, 0x80).encode(2),
            "node 2 EMCY 0x8611 (following error), register motion",
        ),
        (Frame::standard(0x080, []), "SYNC"),
        (
            request(1, &Request::Upload(statusword)),
            "node 1 SDO request, read 0x6041:00 statusword",
        ),
        (
            response(
                1,
                &Response::Upload(statusword, Initiate::of(&[0x40, 0x02])),
            ),
            "node 1 SDO answer, 0x6041:00 statusword = 0x0240 (SWITCH_ON_DISABLED, remote)",
        ),
        (
            response(1, &Response::Abort(statusword, AbortCode::READ_ONLY)),
            "node 1 SDO answer, abort 0x6041:00 statusword: 0x06010002 (attempt to write a read-only object)",
        ),
        (
            Frame::standard(0x181, [0x37, 0x82]),
            "node 1 TPDO1, 0x6041:00 statusword = 0x8237 (OPERATION_ENABLED, voltage, remote, referenced)",
        ),
        (
            Frame::standard(0x404, [0x0F, 0, 0x10, 0, 0, 0]),
            "node 4 RPDO3, 0x6040:00 controlword = 0x000F (enable operation), 0x607A:00 target position = 16 qc",
        ),
        (
            Frame::standard(0x181, [0; 6]),
            "node 1 TPDO1, mapping not seen",
        ),
        (Frame::standard(0x7E5, [0; 8]), "not known"),
    ] {
        assert_eq!(explained(&[frame]), words);
    }
}

#[test]
fn a_mapping_that_was_seen_is_used_until_the_node_restarts() {
    let write = |index, subindex, data: &[u8]| {
        let address = Address::new(index, subindex);
        request(2, &Request::Download(address, Initiate::of(data)))
    };
    let data = Frame::standard(0x1C2, [0x40, 0x02, 0x2A, 0, 0, 0]);
    let mut frames = vec![
        write(0x1A00, 2, &0x6064_0020_u32.to_le_bytes()),
        write(0x1A00, 0, &[2]),
        write(0x1800, 1, &0x0000_01C2_u32.to_le_bytes()),
        data,
    ];
    assert_eq!(
        explained(&frames),
        "node 2 TPDO1, 0x6041:00 statusword = 0x0240 (SWITCH_ON_DISABLED, remote), 0x6064:00 position actual value = 42 qc"
    );
    frames.extend([heartbeat::encode(2, State::BootUp), data]);
    assert_eq!(explained(&frames), "node 66 TPDO1, mapping not seen");
}

#[test]
fn a_text_is_put_together_from_its_segments() {
    let segment = |toggle, last, part: &[u8]| {
        let payload = epos4_link::canopen::sdo::Payload::new(part).expect("at most 7 bytes");
        let segment = epos4_link::canopen::sdo::Segment {
            toggle,
            last,
            payload,
        };
        response(1, &Response::UploadSegment(segment))
    };
    let begin = Response::Upload(
        Address::new(0x1008, 0),
        Initiate::Segmented { size: Some(5) },
    );
    assert_eq!(
        explained(&[response(1, &begin), segment(false, true, b"EPOS4")]),
        "node 1 SDO answer, last segment, 0x1008:00 manufacturer device name = \"EPOS4\""
    );
    assert_eq!(
        explained(&[segment(false, true, b"EPOS4")]),
        "node 1 SDO answer, segment of a transfer whose start was not seen"
    );
}
