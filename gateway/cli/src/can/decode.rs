//! What a frame means in CANopen. The bus is only listened to, so what PDOs carry is taken from the factory until a
//! master is seen to map them anew.

use std::collections::BTreeMap;

use epos4_link::canopen::emcy::{self, Emergency};
use epos4_link::canopen::object::Address;
use epos4_link::canopen::sdo::{Initiate, Request, Response};
use epos4_link::canopen::{heartbeat, nmt};
use epos4_link::dictionary::{self, Kind, PDO_COUNT, PDO_ENTRIES_MAX, PDO_OFF};
use epos4_link::frame::error::{Class, Report};
use epos4_link::frame::{Frame, Id};

use super::meaning;

const SYNC_COB_ID: u16 = 0x080;
/// Segmented transfers are kept up to this length, bytes.
const TRANSFER_MAX: usize = 4096;

/// What was learnt from the frames before.
#[derive(Default)]
pub struct Decoder {
    /// Communication and mapping objects that were read or written, by node.
    seen: BTreeMap<(u8, Address), i64>,
    /// Segmented transfers under way, by node: the object and the bytes so far.
    transfers: BTreeMap<u8, (Address, Vec<u8>)>,
}

impl Decoder {
    /// The meaning of the next frame.
    pub fn explain(&mut self, frame: &Frame) -> String {
        let cob_id = match frame.id() {
            Id::Standard(cob_id) => cob_id,
            Id::Extended(_) => return "extended frame, not CANopen".to_owned(),
            Id::Error(_) => return report(frame),
        };
        if let Some((command, target)) = nmt::decode(frame) {
            let target = match target {
                nmt::Target::All => "all nodes".to_owned(),
                nmt::Target::Node(node_id) => format!("node {node_id}"),
            };
            return format!("NMT {} {target}", order(command));
        }
        if let Some((node_id, state)) = heartbeat::decode(frame) {
            if state == nmt::State::BootUp {
                self.forget(node_id);
                return format!("node {node_id} boot-up");
            }
            return format!("node {node_id} heartbeat {state}");
        }
        if let Some((node_id, emergency)) = Emergency::decode(frame) {
            let Emergency {
                code,
                error_register,
                ..
            } = emergency;
            return format!(
                "node {node_id} EMCY 0x{code:04X} ({}), register {}",
                emcy::text(code),
                meaning::error_register(error_register)
            );
        }
        let eight = <[u8; 8]>::try_from(frame.data());
        match (cob_id, eight) {
            (SYNC_COB_ID, _) => "SYNC".to_owned(),
            (0x581..=0x5FF, Ok(bytes)) => self.response((cob_id - 0x580) as u8, bytes),
            (0x601..=0x67F, Ok(bytes)) => self.request((cob_id - 0x600) as u8, bytes),
            _ => self
                .pdo(cob_id, frame.data())
                .unwrap_or_else(|| "not known".to_owned()),
        }
    }

    /// A node that starts anew has its stored mapping, which is not known.
    fn forget(&mut self, node_id: u8) {
        self.seen.retain(|(node, _), _| *node != node_id);
        self.transfers.remove(&node_id);
    }

    fn request(&mut self, node_id: u8, bytes: [u8; 8]) -> String {
        let what = match Request::decode(bytes) {
            Request::Upload(address) => format!("read {}", named(address)),
            Request::Download(address, Initiate::Segmented { .. }) => {
                self.transfers.insert(node_id, (address, Vec::new()));
                format!("write {} in segments", named(address))
            }
            Request::Download(address, initiate) => {
                let data = expedited(address, &initiate);
                self.learn(node_id, address, &data);
                format!("write {} := {}", named(address), value(address, &data))
            }
            Request::DownloadSegment(segment) => {
                self.segment(node_id, segment.payload.as_slice(), segment.last)
            }
            Request::UploadSegment { .. } => "next segment".to_owned(),
            Request::Abort(address, code) => format!("abort {}: {code}", named(address)),
            Request::Other(command) => format!("command 0x{command:02X}"),
        };
        format!("node {node_id} SDO request, {what}")
    }

    fn response(&mut self, node_id: u8, bytes: [u8; 8]) -> String {
        let what = match Response::decode(bytes) {
            Response::Upload(address, Initiate::Segmented { .. }) => {
                self.transfers.insert(node_id, (address, Vec::new()));
                format!("{} follows in segments", named(address))
            }
            Response::Upload(address, initiate) => {
                let data = expedited(address, &initiate);
                self.learn(node_id, address, &data);
                format!("{} = {}", named(address), value(address, &data))
            }
            Response::UploadSegment(segment) => {
                self.segment(node_id, segment.payload.as_slice(), segment.last)
            }
            Response::Download(address) => format!("{} written", named(address)),
            Response::DownloadSegment { .. } => "segment taken".to_owned(),
            Response::Abort(address, code) => {
                self.transfers.remove(&node_id);
                format!("abort {}: {code}", named(address))
            }
            Response::Other(command) => format!("command 0x{command:02X}"),
        };
        format!("node {node_id} SDO answer, {what}")
    }

    fn segment(&mut self, node_id: u8, part: &[u8], is_last: bool) -> String {
        let Some((address, data)) = self.transfers.get_mut(&node_id) else {
            return "segment of a transfer whose start was not seen".to_owned();
        };
        data.extend_from_slice(part);
        if !is_last && data.len() <= TRANSFER_MAX {
            return format!("segment of {}", named(*address));
        }
        let (address, data) = (*address, std::mem::take(data));
        self.transfers.remove(&node_id);
        format!(
            "last segment, {} = {}",
            named(address),
            value(address, &data)
        )
    }

    /// Remembers what PDOs carry.
    fn learn(&mut self, node_id: u8, address: Address, data: &[u8]) {
        let is_pdo = matches!(
            address.index,
            0x1400..=0x1403 | 0x1600..=0x1603 | 0x1800..=0x1803 | 0x1A00..=0x1A03
        );
        let read = dictionary::entry(address).and_then(|entry| entry.kind.decode(data));
        if let Some(value) = read.filter(|_| is_pdo) {
            self.seen.insert((node_id, address), value);
        }
    }

    /// What was seen of a PDO object, or its factory value.
    fn pdo_object(&self, node_id: u8, address: Address) -> i64 {
        let factory = || dictionary::entry(address).map_or(0, |entry| entry.factory_value(node_id));
        self.seen
            .get(&(node_id, address))
            .copied()
            .unwrap_or_else(factory)
    }

    /// The objects of a PDO by its factory COB-ID, or by one that was seen to be given.
    fn pdo(&self, cob_id: u16, data: &[u8]) -> Option<String> {
        let (node_id, communication) = self.pdo_of(cob_id)?;
        let number = communication & 3;
        let direction = if communication >= 0x1800 {
            "TPDO"
        } else {
            "RPDO"
        };
        let head = format!("node {node_id} {direction}{}", number + 1);
        let record = communication + 0x200;
        let at = |subindex| self.pdo_object(node_id, Address::new(record, subindex));
        let count = at(0).clamp(0, i64::from(PDO_ENTRIES_MAX)) as u8;
        let mut rest = data;
        let mut words = Vec::new();
        for subindex in 1..=count {
            let (address, bits) = meaning::mapped_object(at(subindex));
            let Some((part, after)) = rest.split_at_checked(usize::from(bits / 8)) else {
                return Some(format!("{head}, mapping not seen"));
            };
            words.push(format!("{} = {}", named(address), value(address, part)));
            rest = after;
        }
        if !rest.is_empty() {
            return Some(format!("{head}, mapping not seen"));
        }
        Some(format!("{head}, {}", words.join(", ")))
    }

    fn pdo_of(&self, cob_id: u16) -> Option<(u8, u16)> {
        let given = self
            .seen
            .iter()
            .filter(|((_, address), value)| {
                address.subindex == 1
                    && matches!(address.index, 0x1400..=0x1403 | 0x1800..=0x1803)
                    && **value & PDO_OFF == 0
                    && **value & 0x7FF == i64::from(cob_id)
            })
            .map(|((node_id, address), _)| (*node_id, address.index))
            .next();
        given.or_else(|| factory_pdo(cob_id))
    }
}

/// 0x180 and 0x200 + 0x100 a number, and the node id (CiA 301, 7.3.5).
fn factory_pdo(cob_id: u16) -> Option<(u8, u16)> {
    let node_id = (cob_id & 0x7F) as u8;
    let base = cob_id & !0x7F;
    let number = match base {
        0x180..=0x500 => (base - 0x180) >> 8,
        _ => return None,
    };
    let index = if base & 0x80 != 0 { 0x1800 } else { 0x1400 };
    (node_id != 0 && number < PDO_COUNT).then_some((node_id, index + number))
}

/// An error frame of the controller, in words.
fn report(frame: &Frame) -> String {
    let Some(report) = Report::decode(frame) else {
        return "error frame".to_owned();
    };
    let classes = [
        (Class::TRANSMIT_TIMEOUT, "transmit timeout"),
        (Class::LOST_ARBITRATION, "lost arbitration"),
        (Class::CONTROLLER, "controller"),
        (Class::PROTOCOL, "protocol"),
        (Class::TRANSCEIVER, "transceiver"),
        (Class::NO_ACKNOWLEDGE, "no acknowledge"),
        (Class::BUS_OFF, "bus-off"),
        (Class::BUS_ERROR, "bus error"),
        (Class::RESTARTED, "restarted"),
    ];
    let named = classes.iter().filter(|(class, _)| report.has(*class));
    let mut words: Vec<String> = named.map(|(_, name)| (*name).to_owned()).collect();
    words.extend(report.state().map(|state| format!("{state:?}")));
    if let Some(counters) = report.counters() {
        words.push(format!(
            "transmit errors {}, receive errors {}",
            counters.transmit, counters.receive
        ));
    }
    format!("error frame: {}", words.join(", "))
}

fn order(command: nmt::Command) -> &'static str {
    match command {
        nmt::Command::Start => "start",
        nmt::Command::Stop => "stop",
        nmt::Command::EnterPreOperational => "enter pre-operational",
        nmt::Command::ResetNode => "reset",
        nmt::Command::ResetCommunication => "reset communication",
    }
}

fn named(address: Address) -> String {
    match dictionary::entry(address) {
        Some(entry) => format!("{address} {}", entry.name),
        None => address.to_string(),
    }
}

/// The bytes of an expedited transfer, cut to the object's size when the sender left it open.
fn expedited(address: Address, initiate: &Initiate) -> Vec<u8> {
    match initiate {
        Initiate::Expedited(payload) => payload.as_slice().to_vec(),
        Initiate::ExpeditedUnsized(data) => {
            let size = dictionary::entry(address).map_or(4, |entry| entry.kind.size().min(4));
            data[..size].to_vec()
        }
        Initiate::Segmented { .. } => Vec::new(),
    }
}

fn value(address: Address, data: &[u8]) -> String {
    let entry = dictionary::entry(address);
    if let Some(Kind::Text(_)) = entry.map(|entry| entry.kind) {
        return format!("{:?}", String::from_utf8_lossy(data));
    }
    match entry.and_then(|entry| Some((entry, entry.kind.decode(data)?))) {
        Some((entry, value)) => meaning::words(entry, value),
        None => data.iter().map(|byte| format!("{byte:02X}")).collect(),
    }
}

#[cfg(test)]
mod tests;
