//! What a recording holds, in a few figures.

use std::collections::BTreeMap;
use std::path::Path;

use arthro_proto::gateway::v1 as proto;
use prost::Message as _;

use super::read::{End, Lines, ReadError};
use super::segment::Line;
use super::topics::Topic;

/// Events that are told one by one; a recording has a few.
const EVENTS_MAX: usize = 10_000;

/// The figures of one file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// What it is about; unset when even its first line is missing.
    pub head: Option<proto::RecordingHead>,
    /// The procedure as it stood at last.
    pub procedure: Option<proto::Procedure>,
    /// Lines of each topic that has any.
    pub lines: BTreeMap<Topic, u64>,
    /// When the first and the last line came, nanoseconds since 1970-01-01 UTC.
    pub span_ns: Option<(u64, u64)>,
    /// Decisions, alarms and what happened to the recording, each with its time.
    pub events: Vec<(u64, proto::RecordedEvent)>,
    /// Lines that are missing because the disk was too slow.
    pub missing_lines: u64,
    /// Whether the file has its end.
    pub whole: bool,
}

impl Summary {
    /// Reads a whole file.
    pub fn of(path: &Path) -> Result<Self, ReadError> {
        let mut lines = Lines::open(path)?;
        let mut summary = Self::default();
        while let Some(line) = lines.next_line()? {
            summary.add(&line);
        }
        summary.whole = lines.end() == Some(End::Whole);
        Ok(summary)
    }

    /// From the first to the last line, s.
    pub fn seconds(&self) -> f64 {
        self.span_ns
            .map_or(0.0, |(first, last)| (last - first) as f64 * 1e-9)
    }

    fn add(&mut self, line: &Line) {
        *self.lines.entry(line.topic).or_default() += 1;
        let (first, last) = self.span_ns.unwrap_or((line.at_ns, line.at_ns));
        self.span_ns = Some((first.min(line.at_ns), last.max(line.at_ns)));
        let message = line.message.as_slice();
        match line.topic {
            Topic::Recording => self.head = proto::RecordingHead::decode(message).ok(),
            Topic::Procedure => self.procedure = proto::Procedure::decode(message).ok(),
            Topic::Event => {
                if let Ok(event) = proto::RecordedEvent::decode(message) {
                    self.missing_lines += event.missing_messages;
                    if self.events.len() < EVENTS_MAX {
                        self.events.push((line.at_ns, event));
                    }
                }
            }
            _ => {}
        }
    }
}
