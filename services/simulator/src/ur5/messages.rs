//! What the controller tells its clients on the primary interface.

use std::collections::VecDeque;

use ur_link::SafetyMode;

/// Lines kept for clients that are slow to fetch them.
const LOG_LINES: usize = 256;

/// One message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Message {
    /// `textmsg`.
    Text(String),
    /// `popup`.
    Popup(String),
    /// A program started or ended.
    Key {
        /// Such as "PROGRAM_XXX_STARTED".
        title: String,
        /// Name of the program.
        text: String,
    },
    /// Printed as C153A0.
    Error {
        /// Code.
        code: i32,
        /// Argument.
        argument: i32,
        /// How bad.
        level: Level,
        /// Explanation.
        text: String,
    },
    /// The safety system changed to another mode.
    Safety(SafetyMode),
    /// A program went wrong.
    RuntimeException {
        /// From 1.
        line: i32,
        /// From 1.
        column: i32,
        /// Explanation.
        text: String,
    },
}

/// How bad an error is, with its number on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// For information.
    Info = 1,
    /// Goes on.
    Warning = 2,
    /// Stopped.
    Violation = 3,
    /// Broken.
    Fault = 4,
}

/// The last messages, numbered without end.
#[derive(Debug, Default)]
pub struct Log {
    first: u64,
    lines: VecDeque<Message>,
}

impl Log {
    /// Appends; the oldest is forgotten when there are too many.
    pub fn push(&mut self, message: Message) {
        if self.lines.len() == LOG_LINES {
            self.lines.pop_front();
            self.first += 1;
        }
        self.lines.push_back(message);
    }

    /// Number that the next message gets.
    pub fn next(&self) -> u64 {
        self.first + self.lines.len() as u64
    }

    /// Messages from this number on that are still kept.
    pub fn since(&self, number: u64) -> impl Iterator<Item = &Message> {
        let skipped = usize::try_from(number.saturating_sub(self.first)).unwrap_or(usize::MAX);
        self.lines.iter().skip(skipped)
    }
}
