//! The mechanisms behind the four drives: gears, screws and belts, where they stop, and their switches.
//!
//! Drives in the order of their nodes 1 to 4. An ENX16 encoder of 2048 quadcounts a motor turn and a
//! gear of 21:1; the screws of the feeds have a lead of 2 mm, the belts of the rotations are 1:1.

use crate::epos4::{Drives, Mechanics, Node, NodeConfig};

/// Index of the drive that turns the jaw.
pub const FORCEPS_ROTATION: usize = 0;
/// Index of the drive that closes the jaw.
pub const FORCEPS_FEED: usize = 1;
/// Index of the drive that turns the view.
pub const ARTHROSCOPE_ROTATION: usize = 2;
/// Index of the drive that moves the optics in their sheath.
pub const ARTHROSCOPE_FEED: usize = 3;

const QC_PER_GEAR_TURN: f64 = 2048.0 * 21.0;
const LEAD_MM: f64 = 2.0;
const QC_PER_MM: f64 = QC_PER_GEAR_TURN / LEAD_MM;
const QC_PER_DEG: f64 = QC_PER_GEAR_TURN / 360.0;

/// Serial numbers count from here.
const FIRST_SERIAL: u32 = 0x5467_1400;

/// The screws run against their ends here, mm.
const FEED_STOPS_MM: [f64; 2] = [-2.0, 15.0];
/// The switch at the retracted end of a feed is active up to here, mm.
const FEED_SWITCH_MM: f64 = -1.0;
/// The arthroscope's rotation runs against its ends here, degrees. The forceps' has none.
const ARTHROSCOPE_STOPS_DEG: [f64; 2] = [-55.0, 190.0];

/// Where the true shafts stand when the cell is switched on: the rotations in their sockets at zero,
/// the feeds somewhere, which homing has to find.
pub fn start_qc() -> [f64; 4] {
    [0.0, 2.5 * QC_PER_MM, 0.0, 1.3 * QC_PER_MM]
}

/// The four drives, just powered up.
pub fn drives() -> Drives {
    let start = (1..).zip(start_qc());
    let nodes = start.map(|(node_id, position_qc)| {
        Node::new(NodeConfig {
            position_qc,
            ..NodeConfig::new(node_id, FIRST_SERIAL + u32::from(node_id))
        })
    });
    Drives {
        nodes: nodes.collect(),
    }
}

/// Position of a feed.
pub fn feed_mm(shaft_qc: f64) -> f64 {
    shaft_qc / QC_PER_MM
}

/// Angle of a rotation.
pub fn rotation_rad(shaft_qc: f64) -> f64 {
    (shaft_qc / QC_PER_DEG).to_radians()
}

/// What the mechanisms do to the drives while the true shafts stand here.
pub fn mechanics(shafts_qc: &[f64; 4], jaw_resistance_ma: f64) -> [Mechanics; 4] {
    let feed = |axis: usize, load_ma: f64| Mechanics {
        load_ma,
        hard_stop_low_qc: Some(FEED_STOPS_MM[0] * QC_PER_MM),
        hard_stop_high_qc: Some(FEED_STOPS_MM[1] * QC_PER_MM),
        negative_switch: feed_mm(shafts_qc[axis]) <= FEED_SWITCH_MM,
        ..Mechanics::default()
    };
    let arthroscope_rotation = Mechanics {
        hard_stop_low_qc: Some(ARTHROSCOPE_STOPS_DEG[0] * QC_PER_DEG),
        hard_stop_high_qc: Some(ARTHROSCOPE_STOPS_DEG[1] * QC_PER_DEG),
        ..Mechanics::default()
    };
    [
        Mechanics::default(),
        feed(FORCEPS_FEED, jaw_resistance_ma),
        arthroscope_rotation,
        feed(ARTHROSCOPE_FEED, 0.0),
    ]
}
