use proptest::prelude::*;

use super::super::super::{Request, Response};
use super::*;

const RECORDING: Address = Address::new(0x30C4, 0);

/// A server that speaks block transfer and loses the segments it is told to lose.
struct Server {
    data: Vec<u8>,
    /// Segments a block in a download.
    block_len: u8,
    /// Which segments, counted over the whole transfer, do not arrive.
    lost: Vec<usize>,
    segments: usize,
    taken: usize,
    block: Vec<[u8; 8]>,
    corrupt: bool,
    downloading: bool,
    /// The last segment of a download has been taken.
    complete: bool,
}

impl Server {
    fn new(data: &[u8], block_len: u8, lost: &[usize]) -> Self {
        Self {
            data: data.to_vec(),
            block_len,
            lost: lost.to_vec(),
            segments: 0,
            taken: 0,
            block: Vec::new(),
            corrupt: false,
            downloading: false,
            complete: false,
        }
    }

    fn arrives(&mut self) -> bool {
        self.segments += 1;
        !self.lost.contains(&self.segments)
    }

    fn answer(&mut self, request: [u8; 8]) -> Vec<[u8; 8]> {
        if self.complete {
            let unused = usize::from(request[0] >> 2 & 7);
            assert_eq!(request[0] & 0xE3, 0xC1);
            self.data.truncate(self.data.len() - unused);
            assert_eq!(request[1..3], checksum(&self.data).to_le_bytes());
            return vec![bare(0xA1)];
        }
        if self.downloading {
            return self.take(request);
        }
        match request[0] {
            0xA4 => vec![with_address(
                0xC6,
                RECORDING,
                (self.data.len() as u32).to_le_bytes(),
            )],
            0xA3 => self.next_block(),
            0xA2 => {
                self.taken += 7 * usize::from(request[1]);
                if self.taken < self.data.len() {
                    return self.next_block();
                }
                let unused = (self.taken - self.data.len()) as u8;
                let mut end = bare(0xC1 | unused << 2);
                let crc = checksum(&self.data) ^ u16::from(self.corrupt);
                end[1..3].copy_from_slice(&crc.to_le_bytes());
                vec![end]
            }
            0xA1 => vec![],
            0xC6 => {
                self.downloading = true;
                vec![with_address(0xA4, RECORDING, [self.block_len, 0, 0, 0])]
            }
            other => panic!("request {other:02X}"),
        }
    }

    fn next_block(&mut self) -> Vec<[u8; 8]> {
        let rest = self.data[self.taken..].to_vec();
        let segments = rest.len().div_ceil(7);
        let chunks = rest.chunks(7).zip(1..=127_u8);
        let frames: Vec<[u8; 8]> = chunks
            .map(|(chunk, sequence)| {
                let last = if usize::from(sequence) == segments {
                    LAST
                } else {
                    0
                };
                let mut frame = bare(sequence | last);
                frame[1..=chunk.len()].copy_from_slice(chunk);
                frame
            })
            .collect();
        let end = frames.len();
        let arriving = frames.into_iter().enumerate().filter(|(place, _)| {
            // The end of a block must arrive, else the client waits for its timeout.
            self.arrives() || place + 1 == end
        });
        arriving.map(|(_, frame)| frame).collect()
    }

    fn take(&mut self, segment: [u8; 8]) -> Vec<[u8; 8]> {
        let sequence = segment[0] & 0x7F;
        let ends = segment[0] & LAST != 0 || sequence == self.block_len;
        if (self.arrives() || ends) && usize::from(sequence) == self.block.len() + 1 {
            self.block.push(segment);
            self.complete = segment[0] & LAST != 0;
        }
        if !ends {
            return vec![];
        }
        let taken = self.block.len();
        self.taken += taken;
        for segment in self.block.drain(..) {
            self.data.extend_from_slice(&segment[1..]);
        }
        let mut answer = bare(0xA2);
        answer[1..3].copy_from_slice(&[taken as u8, self.block_len]);
        vec![answer]
    }
}

fn carry_out(
    (mut transfer, first): (Transfer, [u8; 8]),
    mut answer: impl FnMut([u8; 8]) -> Vec<[u8; 8]>,
) -> Result<Vec<u8>, Failure> {
    let mut requests = std::collections::VecDeque::from([first]);
    while let Some(request) = requests.pop_front() {
        for response in answer(request) {
            match transfer.on_response(response)? {
                Step::Send(next) => requests.push_back(next),
                Step::SendAll(all) => requests.extend(all),
                Step::Wait => {}
                Step::SendAndDone(_, data) | Step::Done(data) => return Ok(data),
                Step::Ignored => panic!("an own answer was ignored"),
            }
        }
    }
    panic!("the transfer stands still")
}

#[test]
fn the_checksum_is_that_of_the_standard() {
    assert_eq!(checksum(b"123456789"), 0x31C3);
}

#[test]
fn a_wrong_checksum_is_refused() {
    let mut server = Server::new(&[7; 100], 127, &[]);
    server.corrupt = true;
    let read = carry_out(Transfer::block_upload(RECORDING), |request| {
        server.answer(request)
    });
    assert_eq!(read, Err(Failure::Protocol(AbortCode::CRC)));
}

#[test]
fn a_drive_without_block_transfer_is_asked_in_segments() {
    let mut server = crate::canopen::sdo::server::Server::default();
    struct One;
    impl crate::canopen::sdo::server::Dictionary for One {
        fn read(&mut self, _: Address) -> Result<Vec<u8>, AbortCode> {
            Ok(vec![5; 20])
        }
        fn write(
            &mut self,
            _: Address,
            data: &[u8],
            _: crate::canopen::sdo::server::Length,
        ) -> Result<(), AbortCode> {
            assert_eq!(data, [6; 30]);
            Ok(())
        }
    }
    let mut answer = |request| server.answer(request, &mut One).into_iter().collect();
    let read = carry_out(Transfer::block_upload(RECORDING), &mut answer);
    assert_eq!(read, Ok(vec![5; 20]));
    let written = carry_out(Transfer::block_download(RECORDING, &[6; 30]), &mut answer);
    assert_eq!(written, Ok(vec![]));
}

#[test]
fn a_small_object_may_come_at_once_and_an_abort_ends_a_block() {
    let read = carry_out(Transfer::block_upload(RECORDING), |_| {
        vec![Response::Upload(RECORDING, crate::canopen::sdo::Initiate::of(&[1, 2])).encode()]
    });
    assert_eq!(read, Ok(vec![1, 2]));
    let (mut transfer, _) = Transfer::block_upload(RECORDING);
    transfer
        .on_response(with_address(0xC4, RECORDING, [0; 4]))
        .unwrap();
    let abort = Request::Abort(RECORDING, AbortCode::HARDWARE).encode();
    assert_eq!(
        transfer.on_response(abort),
        Err(Failure::Aborted(AbortCode::HARDWARE))
    );
}

#[test]
fn a_server_that_says_more_than_is_taken_is_refused() {
    let (mut transfer, _) = Transfer::block_upload(RECORDING);
    let huge = with_address(0xC6, RECORDING, u32::MAX.to_le_bytes());
    assert_eq!(
        transfer.on_response(huge),
        Err(Failure::Protocol(AbortCode::OUT_OF_MEMORY))
    );
    let (mut transfer, _) = Transfer::block_upload(RECORDING);
    transfer
        .on_response(with_address(0xC4, RECORDING, [0; 4]))
        .unwrap();
    let endless = (0..10_000).find_map(|i| {
        let sequence = (i % 127) as u8 + 1;
        transfer.on_response(bare(sequence)).err()
    });
    assert_eq!(endless, Some(Failure::Protocol(AbortCode::OUT_OF_MEMORY)));
}

proptest! {
    #[test]
    fn what_is_read_by_blocks_is_what_is_there_whatever_is_lost(
        data in prop::collection::vec(any::<u8>(), 1..2000),
        lost in prop::collection::vec(1_usize..300, 0..3),
    ) {
        let mut server = Server::new(&data, 127, &lost);
        let read = carry_out(Transfer::block_upload(RECORDING), |request| server.answer(request));
        prop_assert_eq!(read, Ok(data));
    }

    #[test]
    fn what_is_written_by_blocks_arrives_whatever_is_lost(
        data in prop::collection::vec(any::<u8>(), 1..2000),
        block_len in 2_u8..=127,
        lost in prop::collection::vec(1_usize..300, 0..3),
    ) {
        let mut server = Server::new(&[], block_len, &lost);
        let written = carry_out(Transfer::block_download(RECORDING, &data), |request| server.answer(request));
        prop_assert_eq!(written, Ok(vec![]));
        prop_assert_eq!(server.data, data);
    }
}
