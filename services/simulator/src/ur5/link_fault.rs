//! What can go wrong on the connections of a controller, packet by packet, drawn from a seed.
//!
//! A packet is what one write of the controller makes (a frame, a message, a line), or what it takes in at once. TCP itself
//! stays whole: a dropped packet is one that the controller never wrote.

use std::time::Duration;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Faults at once.
pub const MAX_FAULTS: usize = 64;
/// Longest delay of a packet.
pub const MAX_DELAY: Duration = Duration::from_secs(5);

/// One of the controller's network services.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Service {
    /// 29999
    Dashboard,
    /// 30001
    Primary,
    /// 30002
    Secondary,
    /// 30003
    Realtime,
    /// 30004
    Rtde,
    /// 30011
    PrimaryReadOnly,
    /// 30012
    SecondaryReadOnly,
    /// 30013
    RealtimeReadOnly,
}

/// Which way packets go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// To the client.
    FromController,
    /// To the controller.
    ToController,
}

/// What is done to a packet, or to a connection.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Never sent, or never taken in.
    Drop,
    /// Nothing is sent, connections are taken. Answers wait until the fault is cleared; periodic packets are lost.
    Stall,
    /// Connections end with a reset; new ones too.
    Reset,
    /// Connections are taken and nothing is ever answered; new ones stay dead when the fault is cleared.
    HalfOpen,
    /// Sent after the next one.
    Reorder,
    /// One byte is another.
    Corrupt,
    /// One number in an RTDE data package is not a number; of this field, or of any that has floating point.
    NotANumber {
        /// Name of an output.
        field: Option<String>,
    },
    /// Sent later, by the controller's clock.
    Delay(Duration),
}

/// A fault to be.
#[derive(Clone, Debug, PartialEq)]
pub struct Spec {
    /// Where; `None`: everywhere.
    pub service: Option<Service>,
    /// Which packets. Only `Drop` and `Corrupt` know packets to the controller.
    pub direction: Direction,
    /// What.
    pub kind: Kind,
    /// Share of the packets, above 0 to 1.
    pub share: f64,
    /// So many packets or connections, then no more; 0: no end.
    pub limit: u64,
    /// Same packets and seed, same faults.
    pub seed: u64,
}

/// A fault that is in force.
#[derive(Clone, Debug)]
pub struct Active {
    /// Number that it was given.
    pub id: u64,
    /// What it is.
    pub spec: Spec,
    /// Packets or connections it met.
    pub affected: u64,
    rng: ChaCha8Rng,
}

/// Where numbers are in an RTDE data package.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// Name of the output.
    pub field: String,
    /// First byte in the frame.
    pub offset: usize,
    /// Doubles of the field; none of a field without floating point.
    pub doubles: usize,
}

/// What becomes of a packet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fate {
    /// Sent, perhaps changed.
    Send,
    /// Lost.
    Lose,
    /// Sent after the next.
    AfterNext,
    /// Sent at this time of the controller, s.
    At(f64),
}

/// All faults of one controller's connections.
#[derive(Debug, Default)]
pub struct Faults(Vec<Active>);

impl Faults {
    /// Adds one. False when there are too many.
    pub fn add(&mut self, id: u64, spec: Spec) -> bool {
        let fits = self.0.len() < MAX_FAULTS;
        if fits {
            self.0.push(Active {
                id,
                affected: 0,
                rng: ChaCha8Rng::seed_from_u64(spec.seed),
                spec,
            });
        }
        fits
    }

    /// Takes one away, or all; how many.
    pub fn clear(&mut self, id: Option<u64>) -> usize {
        let before = self.0.len();
        self.0
            .retain(|fault| id.is_some_and(|wanted| fault.id != wanted));
        before - self.0.len()
    }

    /// In the order in which they were added.
    pub fn list(&self) -> &[Active] {
        &self.0
    }

    /// A fault of this kind holds at this service; it is not counted.
    pub fn holds(&self, service: Service, kind: &Kind) -> bool {
        self.0
            .iter()
            .any(|fault| fault.concerns(service) && fault.spec.kind == *kind)
    }

    /// Counts a connection that meets a fault of this kind. False when there is none.
    pub fn meet(&mut self, service: Service, kind: &Kind) -> bool {
        let met = self
            .0
            .iter_mut()
            .find(|fault| fault.concerns(service) && fault.spec.kind == *kind);
        met.is_some_and(|fault| {
            fault.affected += 1;
            true
        })
    }

    /// What becomes of a packet to a client. `places` tells where numbers are in it.
    pub fn outgoing(
        &mut self,
        service: Service,
        packet: &mut [u8],
        places: &[Place],
        now_s: f64,
    ) -> Fate {
        let mut fate = Fate::Send;
        for fault in &mut self.0 {
            if fault.spec.direction != Direction::FromController || !fault.strikes(service) {
                continue;
            }
            let met = match &fault.spec.kind {
                Kind::Drop | Kind::Stall | Kind::HalfOpen => Some(Fate::Lose),
                Kind::Reset => None,
                Kind::Reorder => Some(Fate::AfterNext),
                Kind::Delay(by) => Some(Fate::At(now_s + by.as_secs_f64())),
                Kind::Corrupt => corrupt(packet, &mut fault.rng).then_some(Fate::Send),
                Kind::NotANumber { field } => {
                    let wanted = |place: &&Place| {
                        place.doubles > 0
                            && field.as_ref().is_none_or(|field| place.field == *field)
                    };
                    spoil(packet, places, wanted, &mut fault.rng).then_some(Fate::Send)
                }
            };
            let Some(met) = met else { continue };
            fault.affected += 1;
            match met {
                Fate::Send => {}
                Fate::Lose => return Fate::Lose,
                Fate::AfterNext | Fate::At(_) => fate = met,
            }
        }
        fate
    }

    /// Whether a packet from a client is taken in; it may be changed.
    pub fn incoming(&mut self, service: Service, packet: &mut [u8]) -> bool {
        for fault in &mut self.0 {
            let dead = fault.spec.kind == Kind::HalfOpen;
            if !(dead || fault.spec.direction == Direction::ToController) || !fault.strikes(service)
            {
                continue;
            }
            match fault.spec.kind {
                Kind::Drop | Kind::HalfOpen => {
                    fault.affected += 1;
                    return false;
                }
                Kind::Corrupt if corrupt(packet, &mut fault.rng) => fault.affected += 1,
                _ => {}
            }
        }
        true
    }
}

impl Active {
    /// In force at this service.
    fn concerns(&self, service: Service) -> bool {
        let Spec {
            service: only,
            limit,
            ..
        } = self.spec;
        only.is_none_or(|only| only == service) && (limit == 0 || self.affected < limit)
    }

    /// In force, and this packet is among its share.
    fn strikes(&mut self, service: Service) -> bool {
        self.concerns(service) && self.rng.random::<f64>() < self.spec.share
    }
}

fn corrupt(packet: &mut [u8], rng: &mut ChaCha8Rng) -> bool {
    if packet.is_empty() {
        return false;
    }
    let at = rng.random_range(0..packet.len());
    packet[at] ^= rng.random_range(1..=u8::MAX);
    true
}

fn spoil(
    packet: &mut [u8],
    places: &[Place],
    wanted: impl Fn(&&Place) -> bool,
    rng: &mut ChaCha8Rng,
) -> bool {
    let candidates: Vec<_> = places.iter().filter(wanted).collect();
    if candidates.is_empty() {
        return false;
    }
    let place = candidates[rng.random_range(0..candidates.len())];
    let start = place.offset + 8 * rng.random_range(0..place.doubles);
    match packet.get_mut(start..start + 8) {
        Some(bytes) => {
            bytes.copy_from_slice(&f64::NAN.to_be_bytes());
            true
        }
        None => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spec(kind: Kind) -> Spec {
        Spec {
            service: Some(Service::Rtde),
            direction: Direction::FromController,
            kind,
            share: 1.0,
            limit: 0,
            seed: 5,
        }
    }

    fn with(spec: Spec) -> Faults {
        let mut faults = Faults::default();
        assert!(faults.add(1, spec));
        faults
    }

    #[test]
    fn the_same_seed_loses_the_same_packets_and_about_the_share() {
        let lost = || {
            let mut faults = with(Spec {
                share: 0.3,
                ..spec(Kind::Drop)
            });
            let fates: Vec<_> = (0..1000)
                .map(|_| faults.outgoing(Service::Rtde, &mut [0; 4], &[], 0.0) == Fate::Lose)
                .collect();
            assert_eq!(
                faults.list()[0].affected,
                fates.iter().filter(|lost| **lost).count() as u64
            );
            fates
        };
        let share = lost().iter().filter(|lost| **lost).count();
        assert!((250..350).contains(&share), "{share}");
        assert_eq!(lost(), lost());
    }

    #[test]
    fn a_limited_fault_ends_by_itself_and_other_services_do_not_feel_it() {
        let mut faults = with(Spec {
            limit: 2,
            ..spec(Kind::Drop)
        });
        let mut fate = |service| faults.outgoing(service, &mut [0; 4], &[], 0.0);
        assert_eq!(fate(Service::Dashboard), Fate::Send);
        let fates = [(); 3].map(|()| fate(Service::Rtde));
        assert_eq!(fates, [Fate::Lose, Fate::Lose, Fate::Send]);
    }

    #[test]
    fn a_corrupt_packet_differs_in_one_byte() {
        let mut faults = with(spec(Kind::Corrupt));
        let mut packet = [7; 40];
        assert_eq!(
            faults.outgoing(Service::Rtde, &mut packet, &[], 0.0),
            Fate::Send
        );
        assert_eq!(packet.iter().filter(|byte| **byte != 7).count(), 1);
    }

    #[test]
    fn a_number_of_the_named_field_is_spoiled() {
        let places = [
            ("timestamp", 4, 1),
            ("actual_q", 12, 6),
            ("robot_mode", 60, 0),
        ];
        let places = places.map(|(field, offset, doubles)| Place {
            field: field.to_owned(),
            offset,
            doubles,
        });
        let mut faults = with(spec(Kind::NotANumber {
            field: Some("actual_q".to_owned()),
        }));
        let mut packet = [0; 64];
        faults.outgoing(Service::Rtde, &mut packet, &places, 0.0);
        let spoiled = packet[12..60]
            .chunks(8)
            .filter(|bytes| f64::from_be_bytes((*bytes).try_into().unwrap()).is_nan())
            .count();
        assert_eq!(spoiled, 1);
        let mut none = with(spec(Kind::NotANumber {
            field: Some("robot_mode".to_owned()),
        }));
        none.outgoing(Service::Rtde, &mut packet, &places, 0.0);
        assert_eq!(none.list()[0].affected, 0);
    }

    #[test]
    fn packets_to_the_controller_have_faults_of_their_own() {
        let mut faults = with(Spec {
            direction: Direction::ToController,
            ..spec(Kind::Drop)
        });
        assert_eq!(
            faults.outgoing(Service::Rtde, &mut [0; 4], &[], 0.0),
            Fate::Send
        );
        assert!(!faults.incoming(Service::Rtde, &mut [0; 4]));
        assert_eq!(faults.clear(Some(2)), 0);
        assert_eq!(faults.clear(None), 1);
        assert!(faults.incoming(Service::Rtde, &mut [0; 4]));
    }
}
