//! The mechanisms behind the four drives: gears, screws and belts, where they stop, and their switches.
//!
//! Drives in the order of their nodes 1 to 4. An ENX16 encoder of 2048 quadcounts a motor turn and a
//! gear of 21:1; the screws of the feeds have a lead of 2 mm, the belts of the rotations are 1:1.

use std::f64::consts::PI;

use epos4_link::objects;

use crate::epos4::{Contact, Drives, Input, Mechanics, Node, NodeConfig};

/// Index of the drive that turns the jaw.
pub const FORCEPS_ROTATION: usize = 0;
/// Index of the drive that closes the jaw.
pub const FORCEPS_FEED: usize = 1;
/// Index of the drive that turns the view.
pub const ARTHROSCOPE_ROTATION: usize = 2;
/// Index of the drive that moves the optics in their sheath.
pub const ARTHROSCOPE_FEED: usize = 3;

const GEAR: f64 = 21.0;
const QC_PER_GEAR_TURN: f64 = 2048.0 * GEAR;
const LEAD_MM: f64 = 2.0;
const QC_PER_MM: f64 = QC_PER_GEAR_TURN / LEAD_MM;
const QC_PER_DEG: f64 = QC_PER_GEAR_TURN / 360.0;
/// Object 0x3001:05 of the motors.
const TORQUE_CONSTANT_NMM_MA: f64 = 9e-3;
/// Of gear and screw together; assumed.
const EFFICIENCY: f64 = 0.6;
/// Force of a feed for each milliampere beyond friction.
pub const FEED_N_PER_MA: f64 = 2.0 * PI * EFFICIENCY * GEAR * TORQUE_CONSTANT_NMM_MA / LEAD_MM;

/// Serial numbers count from here.
const FIRST_SERIAL: u32 = 0x5467_1400;

/// The screws run against their ends here, mm.
const FEED_STOPS_MM: [f64; 2] = [-2.0, 15.0];
/// The switch at the retracted end of a feed is free from here on, mm.
const FEED_SWITCH_MM: f64 = -1.0;
/// The arthroscope's proximity sensor reacts this much deeper than it lets go, mm.
const PROXIMITY_HYSTERESIS_MM: f64 = 0.1;
/// The arthroscope's rotation runs against its ends here, degrees. The forceps' has none.
const ARTHROSCOPE_STOPS_DEG: [f64; 2] = [-55.0, 190.0];

/// What a drive turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Turns the jaw, without an end.
    ForcepsRotation,
    /// Closes the jaw; an optoelectronic switch, normally closed, at its retracted end.
    ForcepsFeed,
    /// Turns the view, between two stops.
    ArthroscopeRotation,
    /// Moves the optics; a proximity sensor with hysteresis at its retracted end.
    ArthroscopeFeed,
    /// A gear that turns nothing.
    Free,
}

/// What the jaw asks of its feed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JawLoad {
    /// Of the spring that opens it, N at the screw.
    pub spring_n: f64,
    /// Between the blades, N.
    pub bite_n: f64,
}

/// The mechanisms of some drives, and what they remember.
#[derive(Clone, Debug)]
pub struct Mechanisms {
    axes: Vec<Axis>,
    /// Whether each one's proximity sensor has reacted.
    reacted: Vec<bool>,
}

impl Axis {
    /// Those of the cell, in the order of its nodes.
    pub const ALL: [Self; 4] = [
        Self::ForcepsRotation,
        Self::ForcepsFeed,
        Self::ArthroscopeRotation,
        Self::ArthroscopeFeed,
    ];

    /// The axis of a node: 1 to 4 are those of the cell.
    #[must_use]
    pub fn of_node(node_id: u8) -> Self {
        let place = usize::from(node_id).checked_sub(1);
        place
            .and_then(|place| Self::ALL.get(place).copied())
            .unwrap_or(Self::Free)
    }

    /// Where the true shaft stands when the cell is switched on: the rotations in their sockets at zero, the feeds
    /// somewhere, which homing has to find.
    #[must_use]
    pub fn start_qc(self) -> f64 {
        match self {
            Self::ForcepsFeed => 2.5 * QC_PER_MM,
            Self::ArthroscopeFeed => 1.3 * QC_PER_MM,
            Self::ForcepsRotation | Self::ArthroscopeRotation | Self::Free => 0.0,
        }
    }

    /// The axis' drive as it was commissioned, just powered up.
    #[must_use]
    pub fn drive(self, node_id: u8) -> Node {
        let mut config = NodeConfig::new(node_id, FIRST_SERIAL + u32::from(node_id));
        config.position_qc = self.start_qc();
        if self == Self::ForcepsFeed {
            // Input 1 is low when active.
            config
                .parameters
                .push((objects::INPUT_POLARITY.address, 0b1));
        }
        Node::new(config)
    }

    /// Quadcounts for a millimetre of a feed, or a degree of a rotation.
    #[must_use]
    pub fn qc_per_unit(self) -> f64 {
        if self.is_feed() {
            QC_PER_MM
        } else {
            QC_PER_DEG
        }
    }

    /// Whether it moves along, in mm; else it turns, in degrees.
    #[must_use]
    pub fn is_feed(self) -> bool {
        matches!(self, Self::ForcepsFeed | Self::ArthroscopeFeed)
    }

    fn stops(self) -> Option<[f64; 2]> {
        match self {
            Self::ForcepsFeed | Self::ArthroscopeFeed => Some(FEED_STOPS_MM),
            Self::ArthroscopeRotation => Some(ARTHROSCOPE_STOPS_DEG),
            Self::ForcepsRotation | Self::Free => None,
        }
    }
}

impl Mechanisms {
    /// Of drives that turn these axes.
    #[must_use]
    pub fn new(axes: &[Axis]) -> Self {
        Self {
            axes: axes.to_vec(),
            reacted: vec![false; axes.len()],
        }
    }

    /// What they do to their drives while the true shafts stand here.
    pub fn act(&mut self, shafts_qc: &[f64], jaw: JawLoad) -> Vec<Mechanics> {
        let axes = self.axes.iter().zip(&mut self.reacted).zip(shafts_qc);
        axes.map(|((axis, reacted), shaft_qc)| {
            let position = shaft_qc / axis.qc_per_unit();
            let [low, high] = axis.stops().map_or([None; 2], |stops| {
                stops.map(|stop| Some(stop * axis.qc_per_unit()))
            });
            let mut mechanics = Mechanics {
                hard_stop_low_qc: low,
                hard_stop_high_qc: high,
                ..Mechanics::default()
            };
            match axis {
                Axis::ForcepsFeed => {
                    mechanics.load_ma = (jaw.spring_n + jaw.bite_n) / FEED_N_PER_MA;
                    mechanics.tool_force_n = jaw.bite_n;
                    mechanics.inputs[0] =
                        Input::new(Contact::NormallyClosed, position <= FEED_SWITCH_MM);
                }
                Axis::ArthroscopeFeed => {
                    let reacts_at_mm = FEED_SWITCH_MM - PROXIMITY_HYSTERESIS_MM;
                    *reacted = position
                        <= if *reacted {
                            FEED_SWITCH_MM
                        } else {
                            reacts_at_mm
                        };
                    mechanics.inputs[0] = Input::new(Contact::NormallyOpen, *reacted);
                }
                Axis::ForcepsRotation | Axis::ArthroscopeRotation | Axis::Free => {}
            }
            mechanics
        })
        .collect()
    }
}

/// Where the true shafts of the cell stand when it is switched on.
pub fn start_qc() -> [f64; 4] {
    Axis::ALL.map(Axis::start_qc)
}

/// The four drives of the cell, just powered up.
pub fn drives() -> Drives {
    Drives::new(
        (1..)
            .zip(Axis::ALL)
            .map(|(id, axis)| axis.drive(id))
            .collect(),
    )
}

/// Position of a feed.
pub fn feed_mm(shaft_qc: f64) -> f64 {
    shaft_qc / QC_PER_MM
}

/// Angle of a rotation.
pub fn rotation_rad(shaft_qc: f64) -> f64 {
    (shaft_qc / QC_PER_DEG).to_radians()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_proximity_sensor_lets_go_later_than_it_reacts() {
        let mut mechanisms = Mechanisms::new(&[Axis::ArthroscopeFeed]);
        let seen: Vec<bool> = [0.0, -1.05, -1.15, -1.05, -0.99, -1.05]
            .into_iter()
            .map(|mm| mechanisms.act(&[mm * QC_PER_MM], JawLoad::default())[0].inputs[0].level())
            .collect();
        assert_eq!(seen, [false, false, true, true, false, false]);
    }

    #[test]
    fn the_optoelectronic_switch_is_high_while_free() {
        let mut mechanisms = Mechanisms::new(&[Axis::ForcepsFeed]);
        let seen = [-0.99, -1.0]
            .map(|mm| mechanisms.act(&[mm * QC_PER_MM], JawLoad::default())[0].inputs[0].level());
        assert_eq!(seen, [true, false]);
    }

    #[test]
    fn the_force_of_a_feed_follows_from_torque_constant_gear_and_lead() {
        let load = JawLoad {
            spring_n: 2.0,
            bite_n: 35.0,
        };
        let [mechanics] = Mechanisms::new(&[Axis::ForcepsFeed]).act(&[0.0], load)[..] else {
            panic!("one axis")
        };
        // 2 pi 0.6 · 21 · 9 mNm/A / 2 mm = 0.3563 N/mA
        assert!(
            (mechanics.load_ma - 103.85).abs() < 0.05,
            "{}",
            mechanics.load_ma
        );
        assert_eq!(mechanics.tool_force_n, 35.0);
    }
}
