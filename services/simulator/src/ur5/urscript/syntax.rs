//! The tree of a program.

use super::{Place, value::Value};

/// What one upload holds.
#[derive(Debug)]
pub struct Unit {
    /// The program; bare lines are one without name.
    pub main: Function,
    /// `sec`: runs beside the program and may not move.
    pub secondary: bool,
}

/// `def`, `thread` or `sec`.
#[derive(Debug)]
pub struct Function {
    /// Its name.
    pub name: String,
    /// Parameters with their defaults.
    pub params: Vec<(String, Option<Value>)>,
    /// Statements.
    pub body: Vec<Statement>,
    /// A thread: to be run, not called.
    pub thread: bool,
    /// Where it begins.
    pub place: Place,
}

/// A statement and where it begins.
#[derive(Debug)]
pub struct Statement {
    /// Line and column.
    pub place: Place,
    /// What it does.
    pub kind: StatementKind,
}

/// Where an assignment goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// A local of this name, else a global, else a new local.
    Nearest,
    /// `local`
    Local,
    /// `global`
    Global,
}

/// What statements do.
#[derive(Debug)]
pub enum StatementKind {
    /// A call, usually.
    Expression(Expression),
    /// `name = value`, `name[index] = value`, `name.member = value`
    Assign {
        /// Where.
        scope: Scope,
        /// Variable.
        name: String,
        /// From the variable to the part that changes.
        path: Vec<Step>,
        /// What.
        value: Expression,
    },
    /// `if`, `elif`..., `else`
    If {
        /// Conditions with their statements.
        arms: Vec<(Expression, Vec<Statement>)>,
        /// `else`
        otherwise: Vec<Statement>,
    },
    /// `while`
    While(Expression, Vec<Statement>),
    /// `break`
    Break,
    /// `continue`
    Continue,
    /// `return`
    Return(Option<Expression>),
    /// `kill`
    Kill(Expression),
    /// `join`
    Join(Expression),
    /// `enter_critical`
    EnterCritical,
    /// `exit_critical`
    ExitCritical,
    /// `halt`
    Halt,
    /// A function or thread inside.
    Define(Function),
}

/// From a value to one of its parts.
#[derive(Debug)]
pub enum Step {
    /// `[index]`
    Index(Expression),
    /// `.name`
    Member(String),
}

/// What gives a value.
#[derive(Debug)]
pub enum Expression {
    /// As written.
    Literal(Value),
    /// A variable.
    Name(String),
    /// `[...]`
    List(Vec<Expression>),
    /// `p[...]` of six.
    Pose(Vec<Expression>),
    /// `a[b]`
    Index(Box<Expression>, Box<Expression>),
    /// `a.b`
    Member(Box<Expression>, String),
    /// `a.append(b)`: a method of what a variable holds, which it may change.
    Method {
        /// Variable.
        name: String,
        /// From the variable to what the method belongs to.
        path: Vec<Step>,
        /// Method and arguments.
        call: Call,
    },
    /// `-a`, `not a`
    Unary(Unary, Box<Expression>),
    /// `a + b`
    Binary(Binary, Box<Expression>, Box<Expression>),
    /// `a and b`: the right side only when the left one does not decide.
    And(Box<Expression>, Box<Expression>),
    /// `a or b`
    Or(Box<Expression>, Box<Expression>),
    /// `f(a, n=b)`
    Call(Call),
    /// `run f(a)`
    Run(Call),
}

/// Function and arguments.
#[derive(Debug)]
pub struct Call {
    /// Where it begins.
    pub place: Place,
    /// Function.
    pub name: String,
    /// Arguments by position.
    pub positional: Vec<Expression>,
    /// Arguments by name.
    pub named: Vec<(String, Expression)>,
}

/// Operators with one operand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unary {
    /// `-`
    Negate,
    /// `not`
    Not,
}

/// Operators with two operands that are both evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Binary {
    /// `+`
    Add,
    /// `-`
    Subtract,
    /// `*`
    Multiply,
    /// `/`
    Divide,
    /// `%`
    Modulo,
    /// `==`
    Equal,
    /// `!=`
    NotEqual,
    /// `<`
    Less,
    /// `<=`
    LessEqual,
    /// `>`
    Greater,
    /// `>=`
    GreaterEqual,
    /// `xor`
    Xor,
}
