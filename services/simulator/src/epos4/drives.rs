//! All drives of one bus, and what is done to them.

use std::collections::VecDeque;

use epos4_link::frame::Frame;

use super::fault::{Active, Fate, Fault, Faults};
use super::mechanics::Mechanics;
use super::node::{Node, NodeConfig};

/// The drives of one bus. What one sends, the others hear.
#[derive(Debug)]
pub struct Drives {
    /// In the order in which [`tick`](Self::tick) takes their mechanics.
    pub nodes: Vec<Node>,
    /// Drives with the node id of another, each with the number of the fault that put it there.
    duplicates: Vec<(u64, Node)>,
    faults: Faults,
    /// Frames that go out later: when, and the place of their sender.
    held: Vec<(f64, usize, Frame)>,
}

/// Drives could be configured to answer each other's process data without end; this many frames are delivered at once.
const CONVERSATION_MAX: usize = 256;
/// So many frames wait for their time; more are lost.
const HELD_MAX: usize = 4096;
/// The serial number of a drive that has another one's node id.
const DUPLICATE_SERIAL: u32 = 0xD0B1_E000;

impl Drives {
    /// These drives.
    #[must_use]
    pub fn new(nodes: Vec<Node>) -> Self {
        Self {
            nodes,
            duplicates: Vec::new(),
            faults: Faults::default(),
            held: Vec::new(),
        }
    }

    /// A frame of a master; what all drives answer, in the order of the bus.
    pub fn on_frame(&mut self, frame: &Frame, now_s: f64) -> Vec<Frame> {
        let mut answers = VecDeque::new();
        self.tell(frame, None, now_s, &mut answers);
        self.deliver(answers, now_s)
    }

    /// Lets `dt_s` pass, up to `now_s`; what all drives send. A drive without mechanics turns freely.
    pub fn tick(&mut self, dt_s: f64, now_s: f64, mechanics: &[Mechanics]) -> Vec<Frame> {
        let mechanics = mechanics
            .iter()
            .copied()
            .chain(std::iter::repeat(Mechanics::default()));
        let mut sent = VecDeque::new();
        let (due, later) = std::mem::take(&mut self.held)
            .into_iter()
            .partition(|(due_s, ..)| *due_s <= now_s);
        self.held = later;
        for (sender, node, mechanics) in self
            .nodes
            .iter_mut()
            .zip(mechanics)
            .chain(
                self.duplicates
                    .iter_mut()
                    .map(|(_, node)| (node, Mechanics::default())),
            )
            .enumerate()
            .map(|(sender, (node, mechanics))| (sender, node, mechanics))
        {
            let node_id = node.node_id();
            for frame in node.step(dt_s, now_s, &mechanics) {
                sent.extend(put(
                    &mut self.faults,
                    &mut self.held,
                    (sender, node_id),
                    frame,
                    now_s,
                ));
            }
        }
        let due: Vec<(f64, usize, Frame)> = due;
        sent.extend(due.into_iter().map(|(_, sender, frame)| (sender, frame)));
        self.deliver(sent, now_s)
    }

    /// Does something to one drive, or to all; its number. None when too much is done already.
    pub fn inject(&mut self, node_id: Option<u8>, fault: Fault, seed: u64) -> Option<u64> {
        let id = self.faults.add(node_id, fault, seed, self.nodes.len())?;
        let chosen = self
            .nodes
            .iter_mut()
            .filter(|node| node_id.is_none_or(|only| only == node.node_id()));
        for node in chosen {
            match fault {
                Fault::Emergency(code) => node.inject_error(code),
                Fault::I2tLevel(percent) => node.heat_motor(percent),
                _ => {}
            }
        }
        self.suffer();
        Some(id)
    }

    /// Ends a fault, or all; those that ended. Errors that they raised stay until a master acknowledges them.
    pub fn clear(&mut self, id: Option<u64>) -> Vec<Active> {
        let ended = self.faults.clear(id);
        self.suffer();
        ended
    }

    /// What is done to them.
    pub fn faults(&mut self) -> &mut Faults {
        &mut self.faults
    }

    /// How many frames wait for their time.
    #[cfg(test)]
    pub fn held_len(&self) -> usize {
        self.held.len()
    }

    /// Brings the drives to what the faults say.
    fn suffer(&mut self) {
        for node in &mut self.nodes {
            node.suffer(self.faults.defects(node.node_id()));
            node.supply(self.faults.supplies(node.node_id()));
        }
        let wanted: Vec<(u64, u8)> = self
            .nodes
            .iter()
            .flat_map(|node| {
                let node_id = node.node_id();
                self.faults.duplicates(node_id).map(move |id| (id, node_id))
            })
            .collect();
        self.duplicates
            .retain(|(id, node)| wanted.contains(&(*id, node.node_id())));
        for (id, node_id) in wanted {
            let there = |(other, node): &(u64, Node)| *other == id && node.node_id() == node_id;
            if !self.duplicates.iter().any(there) {
                let serial = DUPLICATE_SERIAL + u32::from(node_id);
                let node = Node::new(NodeConfig::new(node_id, serial));
                self.duplicates.push((id, node));
            }
        }
    }

    /// Lets every drive but the sender hear a frame; their answers go to the end of `answers`.
    fn tell(
        &mut self,
        frame: &Frame,
        sender: Option<usize>,
        now_s: f64,
        answers: &mut VecDeque<(usize, Frame)>,
    ) {
        let nodes = self
            .nodes
            .iter_mut()
            .chain(self.duplicates.iter_mut().map(|(_, node)| node));
        for (listener, node) in nodes.enumerate() {
            if sender == Some(listener) {
                continue;
            }
            let from = (listener, node.node_id());
            for answer in node.on_frame(frame, now_s) {
                answers.extend(put(&mut self.faults, &mut self.held, from, answer, now_s));
            }
        }
    }

    /// Lets every drive hear what the others sent, and what they answer.
    fn deliver(&mut self, mut heard: VecDeque<(usize, Frame)>, now_s: f64) -> Vec<Frame> {
        let mut frames = Vec::new();
        while let Some((sender, frame)) = heard.pop_front() {
            if frames.len() < CONVERSATION_MAX {
                self.tell(&frame, Some(sender), now_s, &mut heard);
            }
            frames.push(frame);
        }
        frames
    }
}

/// A frame of a drive on its way to the bus: what goes out now.
fn put(
    faults: &mut Faults,
    held: &mut Vec<(f64, usize, Frame)>,
    (sender, node_id): (usize, u8),
    frame: Frame,
    now_s: f64,
) -> Option<(usize, Frame)> {
    match faults.fate(node_id, frame) {
        Fate::Sent(frame) => Some((sender, frame)),
        Fate::Held(frame, delay_s) if held.len() < HELD_MAX => {
            held.push((now_s + delay_s, sender, frame));
            None
        }
        Fate::Held(..) | Fate::Lost => None,
    }
}
