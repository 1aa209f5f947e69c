use std::collections::BTreeMap;

use proptest::prelude::*;

use super::client::{Failure, Step, Transfer};
use super::server::{Dictionary, Length, Server};
use super::*;

const STATUSWORD: Address = Address::new(0x6041, 0);

#[test]
fn the_bytes_are_those_of_the_standard() {
    let upload = Request::Upload(STATUSWORD);
    assert_eq!(upload.encode(), [0x40, 0x41, 0x60, 0, 0, 0, 0, 0]);
    let sizes = [
        (1, 0x2F, 0x4F),
        (2, 0x2B, 0x4B),
        (3, 0x27, 0x47),
        (4, 0x23, 0x43),
    ];
    for (len, download, upload) in sizes {
        let initiate = Initiate::of(&[1, 2, 3, 4][..len]);
        assert_eq!(
            Request::Download(STATUSWORD, initiate).encode()[0],
            download
        );
        assert_eq!(Response::Upload(STATUSWORD, initiate).encode()[0], upload);
    }
    assert_eq!(
        Request::Download(STATUSWORD, Initiate::ExpeditedUnsized([0; 4])).encode()[0],
        0x22
    );
    assert_eq!(
        Response::Download(STATUSWORD).encode(),
        [0x60, 0x41, 0x60, 0, 0, 0, 0, 0]
    );
    assert_eq!(
        Response::Upload(STATUSWORD, Initiate::of(&[0; 5])).encode(),
        [0x41, 0x41, 0x60, 0, 5, 0, 0, 0]
    );
    assert_eq!(Request::UploadSegment { toggle: true }.encode()[0], 0x70);
    let abort = Response::Abort(STATUSWORD, AbortCode::READ_ONLY);
    assert_eq!(abort.encode(), [0x80, 0x41, 0x60, 0, 0x02, 0, 0x01, 0x06]);
}

#[test]
fn abort_codes_have_names() {
    assert_eq!(
        AbortCode::NMT_STATE.to_string(),
        "0x0F00FFC0 (device is in wrong nmt state)"
    );
    assert_eq!(
        AbortCode(0x1234).to_string(),
        "0x00001234 (unknown abort code)"
    );
    assert!(AbortCode::NAMED.iter().all(|code| code.text().is_some()));
}

#[test]
fn a_wrong_toggle_bit_is_refused_by_both_sides() {
    let mut memory = Memory::with(STATUSWORD, &[7; 20]);
    let mut server = Server::default();
    server.answer(Request::Upload(STATUSWORD).encode(), &mut memory);
    let answer = server
        .answer(
            Request::UploadSegment { toggle: true }.encode(),
            &mut memory,
        )
        .unwrap();
    assert_eq!(
        Response::decode(answer),
        Response::Abort(STATUSWORD, AbortCode::TOGGLE_BIT)
    );

    let (mut transfer, _) = Transfer::upload(STATUSWORD);
    transfer
        .on_response(Response::Upload(STATUSWORD, Initiate::Segmented { size: None }).encode())
        .unwrap();
    let segment = Segment {
        toggle: true,
        last: true,
        payload: Payload::new(&[1]).unwrap(),
    };
    let failure = transfer.on_response(Response::UploadSegment(segment).encode());
    assert_eq!(failure, Err(Failure::Protocol(AbortCode::TOGGLE_BIT)));
}

#[test]
fn a_segment_out_of_the_blue_and_block_transfer_are_unknown_commands() {
    let mut server = Server::default();
    for request in [[0x60; 8], [0x00; 8], [0xA0; 8], [0xC0; 8]] {
        let answer = server.answer(request, &mut Memory::default()).unwrap();
        assert!(
            matches!(
                Response::decode(answer),
                Response::Abort(_, AbortCode::UNKNOWN_COMMAND)
            ),
            "{request:02X?}"
        );
    }
}

#[test]
fn a_server_does_not_collect_without_bound() {
    let mut server = Server::default();
    let mut memory = Memory::default();
    let huge = Request::Download(
        STATUSWORD,
        Initiate::Segmented {
            size: Some(u32::MAX),
        },
    );
    let answer = server.answer(huge.encode(), &mut memory).unwrap();
    assert_eq!(
        Response::decode(answer),
        Response::Abort(STATUSWORD, AbortCode::OUT_OF_MEMORY)
    );

    server.answer(
        Request::Download(STATUSWORD, Initiate::Segmented { size: None }).encode(),
        &mut memory,
    );
    let payload = Payload::new(&[0; 7]).unwrap();
    let aborted_after = (0..10_000).position(|i| {
        let segment = Segment {
            toggle: i % 2 == 1,
            last: false,
            payload,
        };
        let answer = server
            .answer(Request::DownloadSegment(segment).encode(), &mut memory)
            .unwrap();
        Response::decode(answer) == Response::Abort(STATUSWORD, AbortCode::OUT_OF_MEMORY)
    });
    assert_eq!(aborted_after, Some(Server::MAX_DOWNLOAD_LEN / 7));
}

#[test]
fn an_answer_to_another_object_is_not_taken() {
    let (mut transfer, _) = Transfer::upload(STATUSWORD);
    let late = Response::Upload(Address::new(0x6064, 0), Initiate::of(&[1, 2, 3, 4]));
    assert_eq!(transfer.on_response(late.encode()), Ok(Step::Ignored));
}

/// A dictionary of byte strings.
#[derive(Default)]
struct Memory(BTreeMap<Address, Vec<u8>>);

impl Memory {
    fn with(address: Address, data: &[u8]) -> Self {
        Self(BTreeMap::from([(address, data.to_vec())]))
    }
}

impl Dictionary for Memory {
    fn read(&mut self, address: Address) -> Result<Vec<u8>, AbortCode> {
        self.0.get(&address).cloned().ok_or(AbortCode::NO_OBJECT)
    }

    fn write(&mut self, address: Address, data: &[u8], _: Length) -> Result<(), AbortCode> {
        self.0.insert(address, data.to_vec());
        Ok(())
    }
}

fn carry_out(
    (mut transfer, first): (Transfer, [u8; 8]),
    memory: &mut Memory,
) -> Result<Vec<u8>, Failure> {
    let mut server = Server::default();
    let mut request = first;
    loop {
        let answer = server.answer(request, memory).unwrap();
        match transfer.on_response(answer)? {
            Step::Send(next) => request = next,
            Step::Done(data) => return Ok(data),
            step => panic!("{step:?} in answer to an own request"),
        }
    }
}

proptest! {
    #[test]
    fn what_is_written_is_read_again(
        index: u16, subindex: u8, data in prop::collection::vec(any::<u8>(), 0..60),
    ) {
        let address = Address::new(index, subindex);
        let mut memory = Memory::default();
        prop_assert_eq!(
            carry_out(Transfer::upload(address), &mut memory),
            Err(Failure::Aborted(AbortCode::NO_OBJECT))
        );
        prop_assert_eq!(carry_out(Transfer::download(address, &data), &mut memory), Ok(vec![]));
        prop_assert_eq!(carry_out(Transfer::upload(address), &mut memory), Ok(data));
    }

    #[test]
    fn decoding_is_total_and_encoding_its_inverse(bytes: [u8; 8]) {
        let request = Request::decode(bytes);
        prop_assert_eq!(Request::decode(request.encode()), request);
        let response = Response::decode(bytes);
        prop_assert_eq!(Response::decode(response.encode()), response);
    }

    #[test]
    fn no_bytes_panic_a_server(requests in prop::collection::vec(any::<[u8; 8]>(), 0..40)) {
        let mut server = Server::default();
        let mut memory = Memory::with(STATUSWORD, &[1; 30]);
        for request in requests {
            server.answer(request, &mut memory);
        }
    }
}

/// Requests of a client that knows no protocol. The server must answer or ignore each, and hold no more than its limit.
fn server_survives(requests: u32) {
    let mut server = Server::default();
    let mut memory = Memory::with(STATUSWORD, &[1; 30]);
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    let mut aborts = 0_u32;
    for _ in 0..requests {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        let mut request = state.wrapping_mul(0x2545_F491_4F6C_DD1D).to_le_bytes();
        // Mostly of an object that is there, so that transfers get beyond their beginning.
        if state & 7 != 0 {
            request[1..4].copy_from_slice(&[0x41, 0x60, 0]);
        }
        if let Some(answer) = server.answer(request, &mut memory) {
            let is_abort = matches!(Response::decode(answer), Response::Abort(..));
            aborts += u32::from(is_abort);
        }
        memory
            .0
            .retain(|address, data| *address == STATUSWORD && data.len() <= 4096);
        memory.0.entry(STATUSWORD).or_insert_with(|| vec![1; 30]);
    }
    assert!(aborts > requests / 10 && aborts < requests, "{aborts}");
}

#[test]
fn noise_does_not_end_a_server() {
    server_survives(300_000);
}

#[test]
#[ignore = "ten million requests: cargo test --release -p epos4-link -- --ignored noise"]
fn ten_million_requests_of_noise() {
    server_survives(10_000_000);
}
