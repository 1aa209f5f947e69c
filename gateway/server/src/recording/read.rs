//! A recording as it is read again: its lines in order, also of a file whose end is missing.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::io::MessageReader;
use mcap::sans_io::LinearReaderOptions;

use super::segment::Line;
use super::topics::Topic;

/// Longer records than any that a recording has; a damaged length must not fill the memory.
const RECORD_MAX_BYTES: usize = 64 * 1024 * 1024;

/// A recording, line by line. It ends where the file does, also in the middle of a line.
pub struct Lines {
    reader: MessageReader<BufReader<File>>,
    path: PathBuf,
    ended: Option<End>,
}

/// How a file ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// As it should.
    Whole,
    /// The process that wrote it did not end it; what it wrote before is there.
    Cut,
}

/// Why a recording cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// It is not there.
    #[error("{path} cannot be opened")]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        #[source]
        source: std::io::Error,
    },
    /// It is no MCAP file, or damaged.
    #[error("{path} is no recording that can be read: {problem}")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// A file of something else.
    #[error("{path} holds no procedure: none of its topics is {}", Topic::Procedure.name())]
    NoProcedure {
        /// The file.
        path: PathBuf,
    },
}

impl Lines {
    /// Opens a file.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let file = File::open(path).map_err(|source| ReadError::Unreadable {
            path: path.to_owned(),
            source,
        })?;
        let options = LinearReaderOptions::default()
            .with_validate_chunk_crcs(true)
            .with_record_length_limit(RECORD_MAX_BYTES);
        Ok(Self {
            reader: MessageReader::new_with_options(BufReader::new(file), options),
            path: path.to_owned(),
            ended: None,
        })
    }

    /// The next line of a topic that a recording has; `None` at the end.
    pub fn next_line(&mut self) -> Result<Option<Line>, ReadError> {
        loop {
            match self.reader.next() {
                None => {
                    self.ended.get_or_insert(End::Whole);
                    return Ok(None);
                }
                Some(Ok(message)) => {
                    let schema = message.channel.schema.as_ref();
                    let topic = Topic::parse(&message.channel.topic)
                        .filter(|topic| schema.is_some_and(|schema| schema.name == topic.schema()));
                    if let Some(topic) = topic {
                        return Ok(Some(Line {
                            topic,
                            at_ns: message.log_time,
                            message: message.data.into_owned(),
                        }));
                    }
                }
                Some(Err(McapError::UnexpectedEof | McapError::UnexpectedEoc)) => {
                    self.ended = Some(End::Cut);
                    return Ok(None);
                }
                Some(Err(error)) => {
                    return Err(ReadError::Damaged {
                        path: self.path.clone(),
                        problem: error.to_string(),
                    });
                }
            }
        }
    }

    /// How the file ended; `None` before its end.
    pub fn end(&self) -> Option<End> {
        self.ended
    }
}
