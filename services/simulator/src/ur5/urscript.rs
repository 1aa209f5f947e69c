//! URScript: text to program ([`compile`]), and a machine that runs it a little each controller cycle ([`Machine`]).
//! It knows the language, not any particular program.

mod arrays;
mod builtins;
mod code;
mod compiler;
mod interpreter;
mod lexer;
mod operators;
mod parser;
mod parts;
mod sockets;
mod syntax;
mod upload;
mod value;

pub use code::Program;
pub use interpreter::{Ending, Machine};
pub use sockets::{Connection, Isolated, Network, State};
pub use upload::Upload;

use super::series::Version;

/// Text that is no program, or a program that went wrong.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {text}")]
pub struct Error {
    /// From 1.
    pub line: u32,
    /// Of the statement, call or character, from 1.
    pub column: u32,
    /// What is wrong.
    pub text: String,
}

/// Line and column, from 1.
type Place = (u32, u32);

impl Error {
    fn new((line, column): Place, text: impl Into<String>) -> Self {
        Self {
            line,
            column,
            text: text.into(),
        }
    }
}

/// Reads a program for a controller of this version: a `def`, a `sec`, or bare lines.
///
/// # Errors
/// The first thing that is not URScript, a name of a function that does not exist in
/// this version, or a program too deep or too long.
pub fn compile(text: &str, version: Version) -> Result<Program, Error> {
    let tokens = lexer::tokens(text)?;
    let unit = parser::parse(&tokens)?;
    compiler::compile(&unit, version)
}

#[cfg(test)]
mod fuzz;
#[cfg(test)]
mod tests;
