//! Why a surface file was refused; the same for every format.

/// Why a surface file was refused.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// The text of the file is not what the format asks for.
    #[error("line {line}: {what}")]
    Line {
        /// Line, the first is 1.
        line: usize,
        /// What stands there and what should.
        what: String,
    },
    /// The binary part of the file is not what the format asks for.
    #[error("byte {byte}: {what}")]
    Byte {
        /// Offset from the start of the file.
        byte: usize,
        /// What stands there and what should.
        what: String,
    },
    /// Neither the file nor the caller says it.
    #[error("the file does not state its {0}: add `{1}` to its header or state it with the file")]
    Unstated(&'static str, String),
    /// The statement is not one of the known words.
    #[error("the file states {field} {value}, known are {known}")]
    UnknownStatement {
        /// `space` or `unit`.
        field: &'static str,
        /// What stands in the file, quoted.
        value: String,
        /// The words that are understood.
        known: &'static str,
    },
    /// Two statements contradict each other.
    #[error("{field} is stated as both {first} and {second}")]
    Contradiction {
        /// `space` or `unit`.
        field: &'static str,
        /// The first statement.
        first: String,
        /// The statement that contradicts it.
        second: String,
    },
    /// A part that the reader needs is absent.
    #[error("the file has no {0}")]
    Missing(&'static str),
    /// More elements than are accepted, or than the file can hold.
    #[error("the file announces {count} elements {element}, the limit is {limit}")]
    TooMany {
        /// Name of the element, quoted.
        element: String,
        /// Announced count.
        count: usize,
        /// Limit.
        limit: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("vertex[{vertex}].{field} is {value}, must be finite")]
    NotFinite {
        /// Index of the vertex.
        vertex: usize,
        /// Property.
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// A normal has no direction.
    #[error("vertex[{vertex}] has a normal of length {length}, must be 1")]
    NoDirection {
        /// Index of the vertex.
        vertex: usize,
        /// Length of the normal.
        length: f64,
    },
    /// A face names a vertex that is not there.
    #[error("face[{face}] names vertex {index}, the file has {vertices}")]
    IndexOutOfRange {
        /// Index of the face.
        face: usize,
        /// The vertex it names, counted as the format counts.
        index: i64,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A face with fewer than three corners.
    #[error("face[{face}] has {corners} corners, needs at least 3")]
    TooFewCorners {
        /// Index of the face.
        face: usize,
        /// How many corners it has.
        corners: usize,
    },
}

/// A word of a file as it is shown in a message: what is not printable escaped, what is long cut.
pub(crate) fn quoted(word: &str) -> String {
    const SHOWN: usize = 32;
    match word.char_indices().nth(SHOWN) {
        Some((cut, _)) => format!("{:?}...", &word[..cut]),
        None => format!("{word:?}"),
    }
}
