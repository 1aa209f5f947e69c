//! URScript: text to program ([`compile`]), and a machine that runs it a little each controller cycle ([`Machine`]).
//! It knows the language, not any particular program.

mod builtins;
mod code;
mod compiler;
mod interpreter;
mod lexer;
mod operators;
mod parser;
mod syntax;
mod upload;
mod value;

pub use code::Program;
pub use interpreter::{Ending, Machine};
pub use upload::Upload;

/// Text that is no program, or a program that went wrong.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {text}")]
pub struct Error {
    /// From 1.
    pub line: u32,
    /// What is wrong.
    pub text: String,
}

impl Error {
    fn new(line: u32, text: impl Into<String>) -> Self {
        Self {
            line,
            text: text.into(),
        }
    }
}

/// Reads a program: a `def`, a `sec`, or bare lines.
///
/// # Errors
/// The first thing that is not URScript, a name of a function that does not exist, or a program too deep or too long.
pub fn compile(text: &str) -> Result<Program, Error> {
    let tokens = lexer::tokens(text)?;
    let unit = parser::parse(&tokens)?;
    compiler::compile(&unit)
}

#[cfg(test)]
mod tests;
