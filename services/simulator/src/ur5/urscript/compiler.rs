//! The tree to operations. Names of functions and all arguments are settled here, so that a wrong call is refused before
//! anything moves.

use std::collections::HashMap;

use super::{
    Error,
    builtins::{self, Builtin},
    code::{self, Op, Program, Symbol},
    syntax::{Call, Expression, Function, Statement, StatementKind, Unit},
    value::Value,
};

/// Compiles an upload.
///
/// # Errors
/// An unknown function, wrong arguments, `break` outside a loop, two functions of one name.
pub fn compile(unit: &Unit) -> Result<Program, Error> {
    let mut compiler = Compiler::default();
    compiler.declare(&unit.main)?;
    let declared = std::mem::take(&mut compiler.declared);
    let mut functions = Vec::with_capacity(declared.len());
    for function in &declared {
        functions.push(compiler.function(function)?);
    }
    Ok(Program {
        name: unit.main.name.clone(),
        secondary: unit.secondary,
        symbols: compiler.symbols,
        functions,
    })
}

#[derive(Default)]
struct Compiler<'a> {
    symbols: Vec<String>,
    symbol_of: HashMap<String, Symbol>,
    /// In the order of their numbers; the body of the program is the first.
    declared: Vec<&'a Function>,
    function_of: HashMap<&'a str, (usize, &'a Function)>,
    ops: Vec<Op>,
    lines: Vec<u32>,
    line: u32,
    loops: Vec<Loop>,
}

struct Loop {
    start: usize,
    /// Jumps to fill in once the end is known.
    breaks: Vec<usize>,
}

impl<'a> Compiler<'a> {
    /// Numbers a function and those inside it, so that calls may come before definitions.
    fn declare(&mut self, function: &'a Function) -> Result<(), Error> {
        let number = self.declared.len();
        self.declared.push(function);
        if number > 0
            && self
                .function_of
                .insert(&function.name, (number, function))
                .is_some()
        {
            return Err(Error::new(
                function.line,
                format!("{} is defined twice", function.name),
            ));
        }
        self.declare_inside(&function.body)
    }

    fn declare_inside(&mut self, body: &'a [Statement]) -> Result<(), Error> {
        for statement in body {
            match &statement.kind {
                StatementKind::Define(function) => self.declare(function)?,
                StatementKind::While(_, body) => self.declare_inside(body)?,
                StatementKind::If { arms, otherwise } => {
                    for (_, body) in arms {
                        self.declare_inside(body)?;
                    }
                    self.declare_inside(otherwise)?;
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn function(&mut self, function: &Function) -> Result<code::Function, Error> {
        self.line = function.line;
        let params = function
            .params
            .iter()
            .map(|(name, _)| self.symbol(name))
            .collect();
        self.body(&function.body)?;
        self.emit(Op::Const(Value::None));
        self.emit(Op::Return);
        Ok(code::Function {
            params,
            ops: std::mem::take(&mut self.ops),
            lines: std::mem::take(&mut self.lines),
        })
    }

    fn body(&mut self, body: &[Statement]) -> Result<(), Error> {
        body.iter()
            .try_for_each(|statement| self.statement(statement))
    }

    fn statement(&mut self, statement: &Statement) -> Result<(), Error> {
        self.line = statement.line;
        match &statement.kind {
            StatementKind::Expression(expression) => {
                self.expression(expression)?;
                self.emit(Op::Pop);
            }
            StatementKind::Assign {
                scope,
                name,
                index,
                value,
            } => {
                let symbol = self.symbol(name);
                if let Some(index) = index {
                    self.expression(index)?;
                    self.expression(value)?;
                    self.emit(Op::StoreItem(symbol));
                } else {
                    self.expression(value)?;
                    self.emit(Op::Store(*scope, symbol));
                }
            }
            StatementKind::If { arms, otherwise } => {
                let mut exits = Vec::new();
                for (condition, body) in arms {
                    self.expression(condition)?;
                    let skip = self.emit(Op::JumpIfFalse(0));
                    self.body(body)?;
                    exits.push(self.emit(Op::Jump(0)));
                    self.land(skip);
                }
                self.body(otherwise)?;
                exits.into_iter().for_each(|exit| self.land(exit));
            }
            StatementKind::While(condition, body) => {
                let start = self.ops.len();
                self.expression(condition)?;
                let exit = self.emit(Op::JumpIfFalse(0));
                self.loops.push(Loop {
                    start,
                    breaks: vec![exit],
                });
                self.body(body)?;
                self.emit(Op::Jump(start));
                let breaks = self
                    .loops
                    .pop()
                    .map(|ended| ended.breaks)
                    .unwrap_or_default();
                breaks.into_iter().for_each(|jump| self.land(jump));
            }
            StatementKind::Break => {
                let jump = self.emit(Op::Jump(0));
                let inside = self.loops.last_mut();
                inside
                    .ok_or_else(|| Error::new(statement.line, "break outside a loop"))?
                    .breaks
                    .push(jump);
            }
            StatementKind::Continue => {
                let inside = self.loops.last().map(|inside| inside.start);
                let start =
                    inside.ok_or_else(|| Error::new(statement.line, "continue outside a loop"))?;
                self.emit(Op::Jump(start));
            }
            StatementKind::Return(value) => {
                match value {
                    Some(value) => self.expression(value)?,
                    None => drop(self.emit(Op::Const(Value::None))),
                }
                self.emit(Op::Return);
            }
            StatementKind::Kill(handle) => {
                self.expression(handle)?;
                self.emit(Op::Kill);
            }
            StatementKind::Join(handle) => {
                self.expression(handle)?;
                self.emit(Op::Join);
            }
            StatementKind::EnterCritical => drop(self.emit(Op::EnterCritical)),
            StatementKind::ExitCritical => drop(self.emit(Op::ExitCritical)),
            StatementKind::Halt => drop(self.emit(Op::Halt)),
            // Compiled as a function of its own.
            StatementKind::Define(_) => {}
        }
        Ok(())
    }

    fn expression(&mut self, expression: &Expression) -> Result<(), Error> {
        match expression {
            Expression::Literal(value) => drop(self.emit(Op::Const(value.clone()))),
            Expression::Name(name) => {
                let symbol = self.symbol(name);
                self.emit(Op::Load(symbol));
            }
            Expression::List(items) => {
                items.iter().try_for_each(|item| self.expression(item))?;
                self.emit(Op::List(items.len()));
            }
            Expression::Pose(items) => {
                items.iter().try_for_each(|item| self.expression(item))?;
                self.emit(Op::Pose);
            }
            Expression::Index(list, index) => {
                self.expression(list)?;
                self.expression(index)?;
                self.emit(Op::Index);
            }
            Expression::Unary(operator, operand) => {
                self.expression(operand)?;
                self.emit(Op::Unary(*operator));
            }
            Expression::Binary(operator, left, right) => {
                self.expression(left)?;
                self.expression(right)?;
                self.emit(Op::Binary(*operator));
            }
            Expression::And(left, right) => self.short_cut(false, left, right)?,
            Expression::Or(left, right) => self.short_cut(true, left, right)?,
            Expression::Call(call) => self.call(call)?,
            Expression::Run(call) => {
                let Some((number, function)) = self.function_of.get(call.name.as_str()).copied()
                else {
                    return Err(Error::new(self.line, format!("no thread {}", call.name)));
                };
                if !function.thread {
                    return Err(Error::new(
                        self.line,
                        format!("{} is a function, not a thread", call.name),
                    ));
                }
                self.arguments(call, &user_params(function))?;
                self.emit(Op::Run(number));
            }
        }
        Ok(())
    }

    fn short_cut(
        &mut self,
        decisive: bool,
        left: &Expression,
        right: &Expression,
    ) -> Result<(), Error> {
        self.expression(left)?;
        let decided = self.emit(Op::ShortCut(decisive, 0));
        self.expression(right)?;
        self.emit(Op::CheckBool);
        self.land(decided);
        Ok(())
    }

    fn call(&mut self, call: &Call) -> Result<(), Error> {
        if let Some((number, function)) = self.function_of.get(call.name.as_str()).copied() {
            if function.thread {
                return Err(Error::new(
                    self.line,
                    format!("{} is a thread: run it", call.name),
                ));
            }
            self.arguments(call, &user_params(function))?;
            self.emit(Op::Call(number));
            return Ok(());
        }
        let Some((number, builtin)) = builtins::find(&call.name) else {
            return Err(Error::new(self.line, format!("no function {}", call.name)));
        };
        let count = self.arguments(call, &builtin_params(builtin))?;
        self.emit(Op::Builtin(number, count));
        Ok(())
    }

    /// Pushes one value for each parameter: given by position, by name, or the default.
    fn arguments(&mut self, call: &Call, params: &[(&str, Option<Value>)]) -> Result<usize, Error> {
        let refuse = |line, text: String| Err(Error::new(line, format!("{}(): {text}", call.name)));
        if call.positional.len() > params.len() {
            return refuse(
                self.line,
                format!(
                    "{} arguments, at most {}",
                    call.positional.len(),
                    params.len()
                ),
            );
        }
        let later = &params[call.positional.len()..];
        for (index, (name, _)) in call.named.iter().enumerate() {
            let again = call.named[..index].iter().any(|(other, _)| other == name);
            if again || !later.iter().any(|(param, _)| param == name) {
                return refuse(self.line, format!("no parameter {name} is free"));
            }
        }
        for (index, (param, default)) in params.iter().enumerate() {
            let named = call
                .named
                .iter()
                .find(|(name, _)| name == param)
                .map(|(_, value)| value);
            match (call.positional.get(index).or(named), default) {
                (Some(given), _) => self.expression(given)?,
                (None, Some(default)) => drop(self.emit(Op::Const(default.clone()))),
                (None, None) => return refuse(self.line, format!("argument {param} is missing")),
            }
        }
        Ok(params.len())
    }

    fn symbol(&mut self, name: &str) -> Symbol {
        if let Some(symbol) = self.symbol_of.get(name) {
            return *symbol;
        }
        let symbol = self.symbols.len();
        self.symbols.push(name.to_owned());
        self.symbol_of.insert(name.to_owned(), symbol);
        symbol
    }

    fn emit(&mut self, op: Op) -> usize {
        self.ops.push(op);
        self.lines.push(self.line);
        self.ops.len() - 1
    }

    /// Lets a jump go to the next operation.
    fn land(&mut self, jump: usize) {
        let here = self.ops.len();
        if let Op::Jump(to) | Op::JumpIfFalse(to) | Op::ShortCut(_, to) = &mut self.ops[jump] {
            *to = here;
        }
    }
}

fn user_params(function: &Function) -> Vec<(&str, Option<Value>)> {
    function
        .params
        .iter()
        .map(|(name, default)| (name.as_str(), default.clone()))
        .collect()
}

fn builtin_params(builtin: &'static Builtin) -> Vec<(&'static str, Option<Value>)> {
    builtin
        .params
        .iter()
        .map(|param| (param.name, param.default.value()))
        .collect()
}
