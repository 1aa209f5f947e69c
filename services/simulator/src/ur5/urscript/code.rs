//! A compiled program: operations of a small stack machine.

use std::sync::Arc;

use super::{
    Place,
    parts::{Method, Path},
    syntax::{Binary, Scope, Unary},
    value::Value,
};

/// A variable name.
pub type Symbol = usize;

/// A program ready to run; function 0 is its body.
#[derive(Debug)]
pub struct Program {
    /// As its `def` names it.
    pub name: String,
    /// A `sec`.
    pub secondary: bool,
    pub(super) symbols: Vec<String>,
    pub(super) functions: Vec<Function>,
}

/// Code of a function or thread.
#[derive(Debug)]
pub struct Function {
    pub params: Vec<Symbol>,
    pub ops: Vec<Op>,
    /// Line and column of the statement or call of each operation.
    pub places: Vec<Place>,
}

/// One step of the machine.
#[derive(Clone, Debug)]
pub enum Op {
    /// Pushes a value.
    Const(Value),
    /// Pushes a variable.
    Load(Symbol),
    /// Pops into a variable.
    Store(Scope, Symbol),
    /// Pops a value and the indices of a path into a part of a variable.
    StorePart(Symbol, Path),
    /// Pops arguments and the indices of a path; calls a method of a part of a variable, pushes its value.
    Method(Symbol, Path, Method, usize),
    /// Pops a value for each of these members into a struct.
    Struct(Arc<[Arc<str>]>),
    /// Pops a struct, pushes its member.
    Member(Arc<str>),
    /// Pops so many values into a list.
    List(usize),
    /// Pops six numbers into a pose.
    Pose,
    /// Pops index and list, pushes the element.
    Index,
    /// Pops one, pushes the result.
    Unary(Unary),
    /// Pops two, pushes the result.
    Binary(Binary),
    /// Goes on there.
    Jump(usize),
    /// Pops a condition; goes on there when it is false.
    JumpIfFalse(usize),
    /// When the top equals this, keeps it and goes on there; else pops it. The short cut of `and` and `or`.
    ShortCut(bool, usize),
    /// Fails when the top is no bool.
    CheckBool,
    /// Calls a function with all its arguments on the stack.
    Call(usize),
    /// Calls a built-in with so many arguments on the stack.
    Builtin(usize, usize),
    /// Starts a thread with its arguments on the stack, pushes its handle.
    Run(usize),
    /// Pops the value of the function and returns.
    Return,
    /// Forgets the top.
    Pop,
    /// Pops a handle and ends its thread.
    Kill,
    /// Pops a handle and waits for the end of its thread.
    Join,
    /// No other thread runs from here on.
    EnterCritical,
    /// All threads run again.
    ExitCritical,
    /// Ends the program.
    Halt,
}
