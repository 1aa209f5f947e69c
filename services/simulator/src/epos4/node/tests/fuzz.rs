//! Frames that no master would send, at drives on which everything is wrong by turns.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

/// Ids that the drives look at, more often than others.
const COB_IDS: &[u16] = &[
    0x000, 0x080, 0x202, 0x302, 0x402, 0x502, 0x602, 0x702, 0x77F, 0x582, 0x182,
];
/// First bytes of SDO requests.
const COMMANDS: &[u8] = &[
    0x40, 0x2F, 0x2B, 0x27, 0x23, 0x22, 0x21, 0x60, 0x70, 0x00, 0x80, 0xA0,
];

fn frame(dice: &mut ChaCha8Rng) -> Frame {
    let mut data = [0; 8];
    dice.fill(&mut data);
    let cob_id = match dice.random_range(0..4) {
        0 => dice.random_range(0..0x800),
        _ => COB_IDS[dice.random_range(0..COB_IDS.len())],
    };
    if cob_id == 0x602 {
        data[0] = COMMANDS[dice.random_range(0..COMMANDS.len())];
        let entries = epos4_link::dictionary::entries();
        let address = entries[dice.random_range(0..entries.len())].address;
        [data[1], data[2]] = address.index.to_le_bytes();
        data[3] = address.subindex;
        if dice.random_bool(0.5) {
            data[4..].copy_from_slice(&[dice.random_range(0..4), 0, 0, 0]);
        }
    }
    if cob_id == 0 {
        data[0] = [0x01, 0x02, 0x80, 0x81, 0x82, 0x07][dice.random_range(0..6)];
        data[1] = dice.random_range(0..4);
    }
    let len = if dice.random_bool(0.8) {
        8
    } else {
        dice.random_range(0..8)
    };
    Frame::new(Id::standard(cob_id), &data[..len]).unwrap()
}

#[test]
fn no_frame_harms_a_drive() {
    let mut dice = ChaCha8Rng::seed_from_u64(6);
    let mut drives = Drives::new(
        (1..=3)
            .map(|id| Node::new(NodeConfig::new(id, 1)))
            .collect(),
    );
    let everything = [
        Fault::SlowSdo(60.0),
        Fault::CorruptFrame(0.5),
        Fault::LostPdo(0.5),
        Fault::DuplicateNode,
        Fault::FrozenEncoder,
        Fault::SlippingBelt(1.0),
        Fault::Jam,
        Fault::DropNode,
        Fault::Supply(0.0),
        Fault::Emergency(0xFFFF),
        Fault::LateHeartbeat(60.0),
    ];
    let mut now_s = 0.0;
    for round in 0..300_000 {
        let most = drives.on_frame(&frame(&mut dice), now_s).len();
        assert!(most < 10_000, "{most} answers to one frame");
        if round % 64 == 0 {
            now_s += 0.0008;
            drives.tick(0.0008, now_s, &[]);
        }
        if round % 5000 == 0 {
            drives.clear(None);
            let fault = everything[dice.random_range(0..everything.len())];
            drives.inject(None, fault, round).unwrap();
        }
        assert!(drives.held_len() <= 4096);
    }
    // Whatever they were told, a restart brings them back.
    drives.clear(None);
    drives.on_frame(&nmt::encode(Command::ResetNode, Target::All), now_s);
    drives.tick(0.0008, now_s + 0.0008, &[]);
    let upload = Request::Upload(Address::new(0x1000, 0)).encode();
    let answers = drives.on_frame(&Frame::standard(0x602, upload), now_s);
    let answer = Response::decode(answers[0].data().try_into().unwrap());
    let device_type = Initiate::of(&0x0002_0192_u32.to_le_bytes());
    assert_eq!(
        answer,
        Response::Upload(Address::new(0x1000, 0), device_type)
    );
    for node in &drives.nodes {
        assert!(node.position_quadcounts().is_finite() && node.current_ma().is_finite());
    }
}
