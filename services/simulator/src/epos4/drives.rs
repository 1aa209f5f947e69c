//! All drives of one bus.

use std::collections::VecDeque;

use epos4_link::frame::Frame;

use super::mechanics::Mechanics;
use super::node::Node;

/// The drives of one bus. What one sends, the others hear.
#[derive(Debug)]
pub struct Drives {
    /// In the order in which [`tick`](Self::tick) takes their mechanics.
    pub nodes: Vec<Node>,
}

/// Drives could be configured to answer each other's process data without end; this many frames are delivered at once.
const CONVERSATION_MAX: usize = 256;

impl Drives {
    /// These drives.
    #[must_use]
    pub fn new(nodes: Vec<Node>) -> Self {
        Self { nodes }
    }

    /// A frame of a master; what all drives answer, in the order of the bus.
    pub fn on_frame(&mut self, frame: &Frame, now_s: f64) -> Vec<Frame> {
        let answers = self
            .nodes
            .iter_mut()
            .enumerate()
            .flat_map(|(sender, node)| {
                node.on_frame(frame, now_s)
                    .into_iter()
                    .map(move |answer| (sender, answer))
            });
        let answers = answers.collect();
        self.deliver(answers, now_s)
    }

    /// Lets `dt_s` pass, up to `now_s`; what all drives send. A drive without mechanics turns freely.
    pub fn tick(&mut self, dt_s: f64, now_s: f64, mechanics: &[Mechanics]) -> Vec<Frame> {
        let mechanics = mechanics
            .iter()
            .copied()
            .chain(std::iter::repeat(Mechanics::default()));
        let sent = self.nodes.iter_mut().zip(mechanics).enumerate().flat_map(
            |(sender, (node, mechanics))| {
                node.step(dt_s, now_s, &mechanics)
                    .into_iter()
                    .map(move |frame| (sender, frame))
            },
        );
        let sent = sent.collect();
        self.deliver(sent, now_s)
    }

    /// Lets every drive hear what the others sent, and what they answer.
    fn deliver(&mut self, mut heard: VecDeque<(usize, Frame)>, now_s: f64) -> Vec<Frame> {
        let mut frames = Vec::new();
        while let Some((sender, frame)) = heard.pop_front() {
            if frames.len() < CONVERSATION_MAX {
                for (listener, node) in self
                    .nodes
                    .iter_mut()
                    .enumerate()
                    .filter(|(listener, _)| *listener != sender)
                {
                    heard.extend(
                        node.on_frame(&frame, now_s)
                            .into_iter()
                            .map(|answer| (listener, answer)),
                    );
                }
            }
            frames.push(frame);
        }
        frames
    }
}
