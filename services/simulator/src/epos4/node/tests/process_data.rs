//! PDOs in both directions.

use super::*;

#[test]
fn process_data_command_and_report() {
    let mut rig = Rig::new();
    rig.nmt(Command::Start);
    let tpdo = |rig: &Rig| {
        rig.sent
            .iter()
            .filter(|frame| frame.cob_id() == Some(0x182))
            .map(|frame| frame.data().to_vec())
            .next_back()
    };
    assert_eq!(tpdo(&rig), Some(vec![0x40, 0x02]));
    for (controlword, statusword) in [(0x06, 0x0221_u16), (0x07, 0x0233), (0x0F, 0x0637)] {
        rig.run(STEP_S);
        rig.send(Frame::standard(0x202, [controlword, 0]));
        assert_eq!(tpdo(&rig), Some(statusword.to_le_bytes().to_vec()));
    }
    rig.send(Frame::standard(0x402, [0x1F, 0, 0xE8, 0x03, 0, 0]));
    rig.run(0.5);
    assert_eq!(rig.node().position_quadcounts().round(), 1000.0);
    rig.send(Frame::standard(0x402, [0x0F, 0]));
    rig.run(0.5);
    assert_eq!(
        (rig.emergencies(), rig.state()),
        (vec![0x8210], State::Fault)
    );
}

#[test]
fn process_data_on_sync_comes_with_every_nth() {
    let mut rig = Rig::new();
    rig.write(0x1802, 2, &[2]);
    rig.write(0x1802, 1, &0x4000_0382_u32.to_le_bytes());
    rig.nmt(Command::Start);
    rig.sent.clear();
    for _ in 0..6 {
        rig.run(0.01);
        rig.send(Frame::standard(0x080, []));
    }
    let synced: Vec<_> = rig
        .sent
        .iter()
        .filter(|frame| frame.id() == Id::standard(0x382))
        .collect();
    assert_eq!(synced.len(), 3);
    assert_eq!(synced[0].data().len(), 6);
}
