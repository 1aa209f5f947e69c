//! What can be done to the drives of one bus on demand, and what is being done now.
//!
//! Chance comes from the seed of each fault, so that the same frames meet the same faults.

use epos4_link::canopen::sdo::response_cob_id;
use epos4_link::canopen::{emcy, heartbeat};
use epos4_link::frame::Frame;
use epos4_link::objects;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::defects::{Defects, WireDefect};

/// One thing that goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The drive has no supply; given back, it boots.
    DropNode,
    /// Heartbeats come this much later, s.
    LateHeartbeat(f64),
    /// The drive raises this error, once.
    Emergency(u16),
    /// The encoder counts no more.
    FrozenEncoder,
    /// This share of the motor's turns does not arrive at the mechanism.
    SlippingBelt(f64),
    /// The wire of this digital input, from 1, is cut.
    CutWire(u8),
    /// The switch at this digital input is held pressed.
    PressedSwitch(u8),
    /// SDO answers come this much later, s.
    SlowSdo(f64),
    /// SDO requests are not answered.
    SilentSdo,
    /// One bit of this share of the drive's frames is another.
    CorruptFrame(f64),
    /// This share of the drive's process data is lost.
    LostPdo(f64),
    /// A second drive has the same node id.
    DuplicateNode,
    /// The drive says that it is this product.
    WrongIdentity(u32),
    /// The drive says that it is configured for this gear, numerator and denominator.
    SwappedGear(u32, u32),
    /// Safe torque off is open.
    StoOpen,
    /// The supply has this voltage, V.
    Supply(f64),
    /// The power stage has this temperature, degrees Celsius.
    PowerStageTemperature(f64),
    /// The shaft cannot turn.
    Jam,
    /// The I2t level of the motor is this, %, once; then it goes on by itself.
    I2tLevel(f64),
    /// The controller of every host on the bus is bus-off, until this is cleared or the host joins anew.
    BusOff,
    /// The controller of every host on the bus reports that it is error-passive.
    ErrorPassive,
}

/// A fault in force.
#[derive(Clone, Debug)]
pub struct Active {
    /// Its number.
    pub id: u64,
    /// Whom it meets; none: all drives, or the bus.
    pub node_id: Option<u8>,
    /// What it is.
    pub fault: Fault,
    /// Its seed.
    pub seed: u64,
    /// Frames that it has met; of what is no matter of frames, 1 for each drive that has it.
    pub affected: u64,
    dice: ChaCha8Rng,
}

/// The faults of one bus.
#[derive(Clone, Debug, Default)]
pub struct Faults {
    active: Vec<Active>,
    last_id: u64,
    /// Counts that changed and were not told yet.
    changed: bool,
}

/// What becomes of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fate {
    /// It goes out, maybe changed.
    Sent(Frame),
    /// It goes out later, s.
    Held(Frame, f64),
    /// It is lost.
    Lost,
}

/// More at once are refused.
pub const MAX_FAULTS: usize = 64;

/// What a frame of a drive is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Service {
    Sdo,
    Heartbeat,
    Emergency,
    ProcessData,
}

impl Fault {
    /// Whether it is one of the hosts' controllers, not of a drive.
    #[must_use]
    pub fn is_of_the_bus(self) -> bool {
        matches!(self, Self::BusOff | Self::ErrorPassive)
    }

    /// Whether it happens once and leaves nothing to end.
    #[must_use]
    pub fn happens_once(self) -> bool {
        matches!(self, Self::Emergency(_) | Self::I2tLevel(_))
    }

    /// Whether it is met by frames, and counts them.
    fn meets_frames(self) -> bool {
        matches!(
            self,
            Self::LateHeartbeat(_)
                | Self::SlowSdo(_)
                | Self::SilentSdo
                | Self::CorruptFrame(_)
                | Self::LostPdo(_)
                | Self::BusOff
                | Self::ErrorPassive
        )
    }
}

impl Active {
    fn meets(&self, node_id: u8) -> bool {
        !self.fault.is_of_the_bus() && self.node_id.is_none_or(|only| only == node_id)
    }
}

impl Faults {
    /// Puts a fault in force on one drive, or on all of these; its number. None when there are too many.
    pub fn add(
        &mut self,
        node_id: Option<u8>,
        fault: Fault,
        seed: u64,
        drives: usize,
    ) -> Option<u64> {
        if self.active.len() >= MAX_FAULTS {
            return None;
        }
        self.last_id += 1;
        let affected = match fault {
            fault if fault.meets_frames() => 0,
            _ if node_id.is_some() => 1,
            _ => drives as u64,
        };
        self.active.push(Active {
            id: self.last_id,
            node_id,
            fault,
            seed,
            affected,
            dice: ChaCha8Rng::seed_from_u64(seed),
        });
        self.changed = true;
        Some(self.last_id)
    }

    /// Ends a fault, or all; those that ended.
    pub fn clear(&mut self, id: Option<u64>) -> Vec<Active> {
        let (ended, kept) = std::mem::take(&mut self.active)
            .into_iter()
            .partition(|active| id.is_none_or(|id| active.id == id));
        self.active = kept;
        self.changed = true;
        ended
    }

    /// Those in force.
    #[must_use]
    pub fn list(&self) -> &[Active] {
        &self.active
    }

    /// Whether a fault came, went or met something since this was asked last.
    pub fn take_changed(&mut self) -> bool {
        std::mem::take(&mut self.changed)
    }

    /// Counts what a fault of the bus has met.
    pub fn meet(&mut self, fault: Fault, times: u64) {
        for active in self.active.iter_mut().filter(|it| it.fault == fault) {
            active.affected += times;
            self.changed = true;
        }
    }

    /// Whether the drive has its supply.
    #[must_use]
    pub fn supplies(&self, node_id: u8) -> bool {
        !self
            .of(node_id)
            .any(|active| active.fault == Fault::DropNode)
    }

    /// The numbers of the faults that put a second drive beside this one.
    pub fn duplicates(&self, node_id: u8) -> impl Iterator<Item = u64> {
        self.of(node_id)
            .filter(|active| active.fault == Fault::DuplicateNode)
            .map(|active| active.id)
    }

    /// What is wrong with a drive.
    #[must_use]
    pub fn defects(&self, node_id: u8) -> Defects {
        let mut defects = Defects::default();
        for active in self.of(node_id) {
            let mut wire = |input: u8, defect| {
                let place = usize::from(input).checked_sub(1);
                if let Some(wire) = place.and_then(|place| defects.wires.get_mut(place)) {
                    *wire = Some(defect);
                }
            };
            match active.fault {
                Fault::FrozenEncoder => defects.drivetrain.encoder_frozen = true,
                Fault::SlippingBelt(share) => defects.drivetrain.slip_share = share,
                Fault::Jam => defects.drivetrain.jammed = true,
                Fault::CutWire(input) => wire(input, WireDefect::Cut),
                Fault::PressedSwitch(input) => wire(input, WireDefect::Pressed),
                Fault::WrongIdentity(product) => defects
                    .claims
                    .push((objects::PRODUCT_CODE.address, i64::from(product))),
                Fault::SwappedGear(numerator, denominator) => defects.claims.extend([
                    (objects::GEAR_NUMERATOR.address, i64::from(numerator)),
                    (objects::GEAR_DENOMINATOR.address, i64::from(denominator)),
                ]),
                Fault::StoOpen => defects.sto_open = true,
                Fault::Supply(volt) => defects.supply_v = Some(volt),
                Fault::PowerStageTemperature(celsius) => defects.power_stage_c = Some(celsius),
                Fault::DropNode
                | Fault::LateHeartbeat(_)
                | Fault::Emergency(_)
                | Fault::SlowSdo(_)
                | Fault::SilentSdo
                | Fault::CorruptFrame(_)
                | Fault::LostPdo(_)
                | Fault::DuplicateNode
                | Fault::I2tLevel(_)
                | Fault::BusOff
                | Fault::ErrorPassive => {}
            }
        }
        defects
    }

    /// What becomes of a frame that a drive sends.
    pub fn fate(&mut self, node_id: u8, frame: Frame) -> Fate {
        let service = service(node_id, &frame);
        let (mut frame, mut delay_s) = (frame, 0.0);
        let mut lost = false;
        for active in self.active.iter_mut().filter(|it| it.meets(node_id)) {
            let met = match (active.fault, service) {
                (Fault::LateHeartbeat(extra_s), Service::Heartbeat)
                | (Fault::SlowSdo(extra_s), Service::Sdo) => {
                    delay_s += extra_s;
                    true
                }
                (Fault::SilentSdo, Service::Sdo) => {
                    lost = true;
                    true
                }
                (Fault::LostPdo(share), Service::ProcessData) => {
                    let hit = active.dice.random_bool(share);
                    lost |= hit;
                    hit
                }
                (Fault::CorruptFrame(share), _) if !frame.data().is_empty() => {
                    let hit = active.dice.random_bool(share);
                    if hit {
                        frame = flipped(frame, &mut active.dice);
                    }
                    hit
                }
                _ => false,
            };
            active.affected += u64::from(met);
            self.changed |= met;
        }
        if lost {
            Fate::Lost
        } else if delay_s > 0.0 {
            Fate::Held(frame, delay_s)
        } else {
            Fate::Sent(frame)
        }
    }

    fn of(&self, node_id: u8) -> impl Iterator<Item = &Active> {
        self.active
            .iter()
            .filter(move |active| active.meets(node_id))
    }
}

fn service(node_id: u8, frame: &Frame) -> Service {
    match frame.cob_id() {
        Some(cob_id) if cob_id == response_cob_id(node_id) => Service::Sdo,
        Some(cob_id) if cob_id == emcy::cob_id(node_id) => Service::Emergency,
        _ if heartbeat::decode(frame).is_some() => Service::Heartbeat,
        _ => Service::ProcessData,
    }
}

fn flipped(frame: Frame, dice: &mut ChaCha8Rng) -> Frame {
    let mut data = frame.data().to_vec();
    let bit = dice.random_range(0..data.len() * 8);
    data[bit / 8] ^= 1 << (bit % 8);
    Frame::new(frame.id(), &data).unwrap_or(frame)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn faults(node_id: Option<u8>, fault: Fault) -> Faults {
        let mut faults = Faults::default();
        faults.add(node_id, fault, 7, 4);
        faults
    }

    #[test]
    fn a_share_of_the_frames_is_met_the_same_for_the_same_seed() {
        let lost = || {
            let mut faults = faults(None, Fault::LostPdo(0.25));
            let lost = (0..1000_u16)
                .filter(|_| faults.fate(2, Frame::standard(0x182, [1, 2])) == Fate::Lost)
                .count();
            assert_eq!(faults.list()[0].affected, lost as u64);
            lost
        };
        assert_eq!(lost(), lost());
        assert!((200..300).contains(&lost()), "{}", lost());
    }

    #[test]
    fn a_corrupt_frame_differs_by_one_bit() {
        let mut faults = faults(Some(2), Fault::CorruptFrame(1.0));
        let frame = Frame::standard(0x182, [0; 8]);
        for _ in 0..100 {
            let Fate::Sent(met) = faults.fate(2, frame) else {
                panic!("a corrupt frame goes out")
            };
            let ones: u32 = met.data().iter().map(|byte| byte.count_ones()).sum();
            assert_eq!((ones, met.id()), (1, frame.id()));
        }
        assert_eq!(faults.fate(3, frame), Fate::Sent(frame), "another drive");
    }

    #[test]
    fn each_fault_of_frames_meets_its_service_alone() {
        let (sdo, beat) = (
            Frame::standard(0x582, [0; 8]),
            heartbeat::encode(2, epos4_link::canopen::nmt::State::Stopped),
        );
        let pdo = Frame::standard(0x182, [0]);
        for (fault, frame, fate) in [
            (Fault::SilentSdo, sdo, Fate::Lost),
            (Fault::SlowSdo(0.2), sdo, Fate::Held(sdo, 0.2)),
            (Fault::LateHeartbeat(0.3), beat, Fate::Held(beat, 0.3)),
            (Fault::LostPdo(1.0), pdo, Fate::Lost),
        ] {
            let mut faults = faults(Some(2), fault);
            for other in [sdo, beat, pdo] {
                let expected = if other == frame {
                    fate
                } else {
                    Fate::Sent(other)
                };
                assert_eq!(faults.fate(2, other), expected, "{fault:?}");
            }
            assert_eq!(faults.list()[0].affected, 1);
        }
    }
}
