//! Process data: which frames carry which objects, and when the drive sends its own.

use epos4_link::canopen::object::Address;
use epos4_link::dictionary::{PDO_COUNT, PDO_OFF};
use epos4_link::frame::Frame;

use super::objects::Objects;

/// What was sent last in each of the drive's own PDOs.
#[derive(Clone, Debug, Default)]
pub struct TransmitPdos {
    sent: [Sent; PDO_COUNT as usize],
}

#[derive(Clone, Debug, Default)]
struct Sent {
    payload: Vec<u8>,
    at_s: Option<f64>,
    syncs: u8,
}

/// What lets a PDO go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occasion {
    /// Time passed or an object changed.
    Event,
    /// A SYNC was on the bus.
    Sync,
}

/// A frame that the drive receives as process data.
#[derive(Debug)]
pub enum Received {
    /// The objects with their bytes, in the order of the mapping.
    Objects(Vec<(Address, Vec<u8>)>),
    /// Likewise, to be taken with the next SYNC; the number of the PDO counts from 0.
    OnSync(u16, Vec<(Address, Vec<u8>)>),
    /// Fewer bytes than are mapped.
    TooShort,
}

/// Transmission types of 0x1800:02: on each SYNC if changed, on every nth SYNC, on change.
const ON_SYNC_IF_CHANGED: i64 = 0;
const EVERY_SYNC_MAX: i64 = 240;
const ON_CHANGE_MIN: i64 = 254;

impl TransmitPdos {
    /// Starts anew, as on entering OPERATIONAL: everything counts as changed.
    pub fn restart(&mut self) {
        *self = Self::default();
    }

    /// The frames to send.
    pub fn due(&mut self, objects: &Objects, occasion: Occasion, now_s: f64) -> Vec<Frame> {
        (0..PDO_COUNT)
            .zip(&mut self.sent)
            .filter_map(|(number, sent)| sent.due(number, objects, occasion, now_s))
            .collect()
    }
}

impl Sent {
    fn due(
        &mut self,
        number: u16,
        objects: &Objects,
        occasion: Occasion,
        now_s: f64,
    ) -> Option<Frame> {
        let communication = 0x1800 + number;
        let cob_id = objects.get(Address::new(communication, 1));
        if cob_id & PDO_OFF != 0 {
            return None;
        }
        let payload: Vec<u8> = objects
            .mapped(0x1A00 + number)
            .flat_map(|(address, kind)| kind.encode(objects.get(address)))
            .collect();
        let changed = self.at_s.is_none() || payload != self.payload;
        let due = match (objects.get(Address::new(communication, 2)), occasion) {
            (ON_CHANGE_MIN.., Occasion::Event) => {
                let inhibit_s = objects.get(Address::new(communication, 3)) as f64 * 1e-4;
                changed && self.at_s.is_none_or(|at_s| now_s - at_s >= inhibit_s)
            }
            (ON_SYNC_IF_CHANGED, Occasion::Sync) => changed,
            (every @ 1..=EVERY_SYNC_MAX, Occasion::Sync) => {
                self.syncs = self.syncs.saturating_add(1);
                i64::from(self.syncs) >= every
            }
            _ => false,
        };
        if !due {
            return None;
        }
        self.syncs = 0;
        self.at_s = Some(now_s);
        let frame = Frame::new(standard_id(cob_id), &payload);
        self.payload = payload;
        frame
    }
}

/// The objects in a frame; none if it is no PDO of this drive.
#[must_use]
pub fn receive(frame: &Frame, objects: &Objects) -> Option<Received> {
    let number = (0..PDO_COUNT).find(|number| {
        let cob_id = objects.get(Address::new(0x1400 + number, 1));
        cob_id & PDO_OFF == 0 && standard_id(cob_id) == frame.id()
    })?;
    let mut rest = frame.data();
    let mut received = Vec::new();
    for (address, kind) in objects.mapped(0x1600 + number) {
        let Some((bytes, after)) = rest.split_at_checked(kind.size()) else {
            return Some(Received::TooShort);
        };
        received.push((address, bytes.to_vec()));
        rest = after;
    }
    let transmission = objects.get(Address::new(0x1400 + number, 2));
    Some(if transmission <= EVERY_SYNC_MAX {
        Received::OnSync(number, received)
    } else {
        Received::Objects(received)
    })
}

fn standard_id(cob_id: i64) -> epos4_link::frame::Id {
    epos4_link::frame::Id::standard((cob_id & 0x7FF) as u16)
}
