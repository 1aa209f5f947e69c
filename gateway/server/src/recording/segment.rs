//! One file of a recording as it is written: MCAP in chunks that reach the disk with every flush, so that a file without an
//! end is whole up to its last chunk.

use std::collections::BTreeMap;
use std::io::{self, Seek, SeekFrom, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, WriteOptions, Writer};

use super::topics::{Topic, schemas};

const MAGIC: &[u8] = b"\x89MCAP0\r\n";
const OP_FOOTER: u8 = 0x02;
const OP_MESSAGE: u8 = 0x05;
const OP_DATA_END: u8 = 0x0F;

/// Where a file goes: a file, or what stands for one in tests.
pub trait Sink: Write + Seek + Send {
    /// Cuts off everything from `length` on.
    fn cut(&mut self, length: u64) -> io::Result<()>;
    /// Has what was written survive a loss of power.
    fn sync(&mut self) -> io::Result<()>;
}

impl Sink for std::fs::File {
    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.set_len(length)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.sync_data()
    }
}

/// A line of a recording, encoded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Line {
    /// Where it goes.
    pub topic: Topic,
    /// When it came, nanoseconds since 1970-01-01 UTC.
    pub at_ns: u64,
    /// The message.
    pub message: Vec<u8>,
}

/// A file under way.
pub struct Segment<S: Sink> {
    writer: Writer<Counting<S>>,
    written_bytes: Arc<AtomicU64>,
    channels: BTreeMap<Topic, Channel>,
    /// Up to here the file is whole.
    whole_bytes: u64,
}

#[derive(Clone, Copy, Debug)]
struct Channel {
    id: u16,
    lines: u32,
}

impl<S: Sink> Segment<S> {
    /// Begins a file with its schemas and channels. `about` becomes the file's metadata.
    pub fn begin(sink: S, about: BTreeMap<String, String>) -> Result<Self, McapError> {
        let options = WriteOptions::new()
            .compression(None)
            .profile("arthro")
            .library(concat!("arthro ", env!("CARGO_PKG_VERSION")))
            // A chunk is written in one go, and nothing that was written is changed later.
            .disable_seeking(true);
        let written_bytes = Arc::new(AtomicU64::new(0));
        let mut writer = options.create(Counting {
            inner: sink,
            position: written_bytes.clone(),
        })?;
        writer.write_metadata(&Metadata {
            name: "arthro".to_owned(),
            metadata: about,
        })?;
        let schemas = schemas().map_err(io::Error::other)?;
        let mut channels = BTreeMap::new();
        for (topic, schema) in schemas {
            let schema_id = writer.add_schema(topic.schema(), "protobuf", &schema)?;
            let id = writer.add_channel(schema_id, topic.name(), "protobuf", &BTreeMap::new())?;
            channels.insert(topic, Channel { id, lines: 0 });
        }
        let mut this = Self {
            writer,
            written_bytes,
            channels,
            whole_bytes: 0,
        };
        this.flush()?;
        Ok(this)
    }

    /// Adds a line.
    pub fn write(&mut self, line: &Line) -> Result<(), McapError> {
        let Some(channel) = self.channels.get_mut(&line.topic) else {
            return Ok(());
        };
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: channel.lines,
            log_time: line.at_ns,
            publish_time: line.at_ns,
        };
        channel.lines = channel.lines.wrapping_add(1);
        self.writer.write_to_known_channel(&header, &line.message)
    }

    /// Hands everything so far to the system: it survives the end of this process.
    pub fn flush(&mut self) -> Result<(), McapError> {
        self.writer.flush()?;
        self.whole_bytes = self.written_bytes.load(Ordering::Relaxed);
        Ok(())
    }

    /// How far the file is whole.
    pub fn whole_bytes(&self) -> u64 {
        self.whole_bytes
    }

    /// Ends the file with its index.
    pub fn finish(mut self) -> Result<(), McapError> {
        self.writer.finish()?;
        let mut sink = self.writer.into_inner().inner;
        sink.flush()?;
        sink.sync()?;
        Ok(())
    }

    /// Ends a file that could not be written on: cuts off what is not whole, and adds one last line and an end without an
    /// index. `make_room` may free some room first.
    pub fn give_up(self, last: &Line, make_room: impl FnOnce()) -> io::Result<()> {
        let channel = self.channels.get(&last.topic).copied();
        let whole_bytes = self.whole_bytes;
        let mut sink = self.writer.into_inner().inner;
        sink.cut(whole_bytes)?;
        make_room();
        sink.seek(SeekFrom::Start(whole_bytes))?;
        let mut end = Vec::new();
        if let Some(channel) = channel {
            let mut body = Vec::with_capacity(22 + last.message.len());
            body.extend(channel.id.to_le_bytes());
            body.extend(channel.lines.to_le_bytes());
            body.extend(last.at_ns.to_le_bytes());
            body.extend(last.at_ns.to_le_bytes());
            body.extend(&last.message);
            record(&mut end, OP_MESSAGE, &body);
        }
        // No checksum of the data, no summary: zeros say so.
        record(&mut end, OP_DATA_END, &[0; 4]);
        record(&mut end, OP_FOOTER, &[0; 20]);
        end.extend(MAGIC);
        sink.write_all(&end)?;
        sink.flush()?;
        sink.sync()
    }
}

fn record(out: &mut Vec<u8>, opcode: u8, body: &[u8]) {
    out.push(opcode);
    out.extend((body.len() as u64).to_le_bytes());
    out.extend(body);
}

/// Knows how far it has written.
struct Counting<S> {
    inner: S,
    position: Arc<AtomicU64>,
}

impl<S: Write> Write for Counting<S> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(bytes)?;
        self.position.fetch_add(written as u64, Ordering::Relaxed);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

impl<S: Seek> Seek for Counting<S> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let position = self.inner.seek(to)?;
        self.position.store(position, Ordering::Relaxed);
        Ok(position)
    }
}

#[cfg(test)]
mod tests;
