//! Sends a program and finds out what became of it. A controller does not answer an upload: it says on the primary
//! interface that a program of this name began, ended or failed, and RTDE shows that something runs.

use std::time::Duration;

use tokio::time::Instant;

use crate::{
    Error, RuntimeState,
    error::deadline,
    primary::{Message, Notice, Primary, wire::ErrorCode, wire::Level},
};

/// Longest program sent; controllers choke on megabytes.
pub const MAX_BYTES: usize = 1 << 20;

const STARTED: &str = "PROGRAM_XXX_STARTED";
const STOPPED: &str = "PROGRAM_XXX_STOPPED";
/// How texts of exceptions begin that tell that a program was never run.
const COMPILING: [&str; 3] = ["compile_error", "syntax_error", "syntax error"];

/// A program in URScript: `def NAME():` to its `end`.
///
/// A new program ends the one that runs. On e-Series the controller takes programs in remote control only.
///
/// ```no_run
/// use std::time::Duration;
/// use ur_link::{Primary, Script};
///
/// # async fn demo() -> Result<(), ur_link::Error> {
/// let mut primary = Primary::connect("192.168.0.10", 30001, Duration::from_secs(2)).await?;
/// let script = Script::new("def hello():\n  textmsg(\"hello\")\nend\n")?;
/// script.run(&mut primary, Duration::from_secs(5)).await?; // started, or why not
/// let outcome = script.outcome(&mut primary, Duration::from_secs(60)).await?;
/// println!("{outcome:?}");
/// # Ok(()) }
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Script {
    name: String,
    text: String,
}

/// What became of a program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It does not compile, and nothing ran.
    NotCompiled(Exception),
    /// It failed while it ran.
    Failed(Exception),
    /// It came to its end, or was stopped; the controller does not tell which.
    Ended,
}

/// Where and why a program failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exception {
    /// Line of the program, from 1.
    pub line: i32,
    /// Column of the line, from 1.
    pub column: i32,
    /// In the controller's words.
    pub text: String,
}

/// Follows one program through what a controller says.
#[derive(Clone, Debug)]
pub struct Progress {
    name: String,
    began: bool,
    outcome: Option<Outcome>,
    /// The last grave remark, which explains an end.
    remark: Option<ErrorCode>,
}

impl Script {
    /// Takes a program's text.
    ///
    /// # Errors
    /// [`Error::Script`] for a text that is not one `def NAME(): ... end`, or is too long. What is between is for the
    /// controller to judge.
    pub fn new(text: impl Into<String>) -> Result<Self, Error> {
        let mut text: String = text.into();
        if text.len() > MAX_BYTES {
            return Err(Error::Script("is longer than 1048576 bytes"));
        }
        // A controller takes a program as complete once the line of its `end` is.
        text.truncate(text.trim_end().len());
        text.push('\n');
        let mut lines = code_lines(&text);
        let name = lines
            .next()
            .and_then(defined)
            .ok_or(Error::Script("does not begin with def NAME():"))?
            .to_owned();
        if lines.last() != Some("end") {
            return Err(Error::Script("does not end with end"));
        }
        if text.contains('\0') {
            return Err(Error::Script("holds a zero byte"));
        }
        Ok(Self { name, text })
    }

    /// The name by which the controller speaks of it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// As it is sent.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// To be shown what the controller says from before the upload on.
    pub fn progress(&self) -> Progress {
        Progress {
            name: self.name.clone(),
            began: false,
            outcome: None,
            remark: None,
        }
    }

    /// Sends the program and waits until it began. A program that is over by then has begun too.
    ///
    /// # Errors
    /// [`Error::Program`] when it does not compile, or fails at once; [`Error::Timeout`] when nothing is heard of it:
    /// the controller is not in remote control, or a program of another name runs on; connection failures.
    pub async fn run(&self, primary: &mut Primary, limit: Duration) -> Result<(), Error> {
        let mut progress = self.progress();
        primary.send_script(&self.text).await?;
        let until = deadline(limit);
        while !progress.began() {
            progress.observe(&next(primary, until, "start of the program", limit).await?);
            if let Some(Outcome::NotCompiled(exception) | Outcome::Failed(exception)) =
                progress.outcome()
            {
                return Err(Error::Program {
                    name: self.name.clone(),
                    exception: exception.clone(),
                });
            }
        }
        Ok(())
    }

    /// Waits until the running program is over.
    ///
    /// # Errors
    /// It is not within `limit`; connection failures.
    pub async fn outcome(&self, primary: &mut Primary, limit: Duration) -> Result<Outcome, Error> {
        let mut progress = self.progress();
        progress.began = true;
        let until = deadline(limit);
        loop {
            if let Some(outcome) = progress.outcome() {
                return Ok(outcome.clone());
            }
            progress.observe(&next(primary, until, "end of the program", limit).await?);
        }
    }
}

async fn next(
    primary: &mut Primary,
    deadline: Instant,
    what: &'static str,
    limit: Duration,
) -> Result<Message, Error> {
    let left = deadline.saturating_duration_since(Instant::now());
    match primary.next(left).await {
        Err(Error::Timeout { .. }) => Err(Error::Timeout { what, limit }),
        other => other,
    }
}

impl Progress {
    /// Takes note of what the primary interface brought.
    pub fn observe(&mut self, message: &Message) {
        let Message::Notice(_, notice) = message else {
            return;
        };
        match notice {
            Notice::Key { title, text, .. } if *text == self.name => match title.as_str() {
                STARTED => self.began = true,
                // Before its begin this is the end of an earlier program of the same name, which the upload stopped.
                STOPPED if self.began => self.end(Outcome::Ended),
                _ => {}
            },
            Notice::RuntimeException { line, column, text } => {
                let exception = Exception {
                    line: *line,
                    column: *column,
                    text: text.clone(),
                };
                let never_ran = !self.began || COMPILING.iter().any(|head| text.starts_with(head));
                self.end(if never_ran {
                    Outcome::NotCompiled(exception)
                } else {
                    Outcome::Failed(exception)
                });
            }
            Notice::ErrorCode(code) if code.level >= Level::Violation => {
                self.remark = Some(code.clone());
            }
            _ => {}
        }
    }

    /// Takes note of what RTDE shows, for those who have no primary interface: a program begins when the controller
    /// plays, and ends when it stops. Call it only with states from after the upload; the program that ran before, and
    /// one that is over between two states, cannot be told apart this way.
    pub fn observe_runtime(&mut self, state: RuntimeState) {
        match state {
            RuntimeState::Playing => self.began = true,
            RuntimeState::Stopped if self.began => self.end(Outcome::Ended),
            _ => {}
        }
    }

    /// It began.
    pub fn began(&self) -> bool {
        self.began
    }

    /// What became of it; `None` while it has not begun, or runs.
    pub fn outcome(&self) -> Option<&Outcome> {
        self.outcome.as_ref()
    }

    /// The last violation or fault that the controller told since: the likely cause of an end nobody asked for.
    pub fn remark(&self) -> Option<&ErrorCode> {
        self.remark.as_ref()
    }

    /// The first outcome counts: an exception is followed by the end.
    fn end(&mut self, outcome: Outcome) {
        self.outcome.get_or_insert(outcome);
    }
}

impl std::fmt::Display for Exception {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { line, column, text } = self;
        write!(f, "line {line}, column {column}: {text}")
    }
}

/// Lines without comments and margins that are not empty.
fn code_lines(text: &str) -> impl DoubleEndedIterator<Item = &str> {
    text.lines()
        .map(|line| line.split('#').next().unwrap_or_default().trim())
        .filter(|line| !line.is_empty())
}

/// The name in `def NAME():`.
fn defined(line: &str) -> Option<&str> {
    let (name, rest) = line.strip_prefix("def ")?.split_once('(')?;
    let name = name.trim();
    let word = |text: &str| {
        !text.is_empty()
            && text
                .chars()
                .all(|next| next.is_ascii_alphanumeric() || next == '_')
            && !text.starts_with(|first: char| first.is_ascii_digit())
    };
    (word(name) && rest.replace(' ', "") == "):").then_some(name)
}

#[cfg(test)]
mod tests;
