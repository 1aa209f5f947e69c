//! The tree to operations. Names of functions and all arguments are settled here, so that a wrong call is refused before
//! anything moves.

use std::{collections::HashMap, sync::Arc};

use super::{
    Error, Place,
    builtins::{self, Builtin, versions},
    code::{self, Op, Program, Symbol},
    parts::{Method, Path, PathStep},
    syntax::{Call, Expression, Function, Statement, StatementKind, Step, Unit},
    value::Value,
};
use crate::ur5::series::{Since, Version};

/// Variables of one program.
const MAX_NAMES: usize = 4096;

/// Compiles an upload for a controller of this version.
///
/// # Errors
/// An unknown function, wrong arguments, `break` outside a loop, two functions of one name.
pub fn compile(unit: &Unit, version: Version) -> Result<Program, Error> {
    let mut compiler = Compiler::new(version);
    compiler.declare(&unit.main)?;
    let declared = std::mem::take(&mut compiler.declared);
    let mut functions = Vec::with_capacity(declared.len());
    for function in &declared {
        functions.push(compiler.function(function)?);
    }
    if compiler.symbols.len() > MAX_NAMES {
        let text = format!("{} variables, at most {MAX_NAMES}", compiler.symbols.len());
        return Err(Error::new(unit.main.place, text));
    }
    Ok(Program {
        name: unit.main.name.clone(),
        secondary: unit.secondary,
        symbols: compiler.symbols,
        functions,
    })
}

struct Compiler<'a> {
    version: Version,
    symbols: Vec<String>,
    symbol_of: HashMap<String, Symbol>,
    /// In the order of their numbers; the body of the program is the first.
    declared: Vec<&'a Function>,
    function_of: HashMap<&'a str, (usize, &'a Function)>,
    ops: Vec<Op>,
    places: Vec<Place>,
    place: Place,
    loops: Vec<Loop>,
}

struct Loop {
    start: usize,
    /// Jumps to fill in once the end is known.
    breaks: Vec<usize>,
}

impl<'a> Compiler<'a> {
    fn new(version: Version) -> Self {
        Self {
            version,
            symbols: Vec::new(),
            symbol_of: HashMap::new(),
            declared: Vec::new(),
            function_of: HashMap::new(),
            ops: Vec::new(),
            places: Vec::new(),
            place: (1, 1),
            loops: Vec::new(),
        }
    }

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
                function.place,
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
        self.place = function.place;
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
            places: std::mem::take(&mut self.places),
        })
    }

    fn body(&mut self, body: &[Statement]) -> Result<(), Error> {
        body.iter()
            .try_for_each(|statement| self.statement(statement))
    }

    fn statement(&mut self, statement: &Statement) -> Result<(), Error> {
        self.place = statement.place;
        match &statement.kind {
            StatementKind::Expression(expression) => {
                self.expression(expression)?;
                self.emit(Op::Pop);
            }
            StatementKind::Assign {
                scope,
                name,
                path,
                value,
            } => {
                let symbol = self.symbol(name);
                let path = self.path(path)?;
                self.expression(value)?;
                self.emit(if path.is_empty() {
                    Op::Store(*scope, symbol)
                } else {
                    Op::StorePart(symbol, path)
                });
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
                    .ok_or_else(|| Error::new(statement.place, "break outside a loop"))?
                    .breaks
                    .push(jump);
            }
            StatementKind::Continue => {
                let inside = self.loops.last().map(|inside| inside.start);
                let start =
                    inside.ok_or_else(|| Error::new(statement.place, "continue outside a loop"))?;
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
            Expression::Member(owner, name) => {
                self.expression(owner)?;
                self.emit(Op::Member(Arc::from(name.as_str())));
            }
            Expression::Method { name, path, call } => {
                let symbol = self.symbol(name);
                let path = self.path(path)?;
                let Some(method) = Method::from_name(&call.name) else {
                    return Err(Error::new(call.place, format!("no method {}", call.name)));
                };
                let wanted = method.arguments();
                if !call.named.is_empty() || !wanted.contains(&call.positional.len()) {
                    let text = format!("{}() takes {wanted:?} arguments by position", call.name);
                    return Err(Error::new(call.place, text));
                }
                self.available(call.place, &call.name, versions::LISTS)?;
                let arguments = &call.positional;
                arguments
                    .iter()
                    .try_for_each(|value| self.expression(value))?;
                self.place = call.place;
                self.emit(Op::Method(symbol, path, method, arguments.len()));
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
                    return Err(Error::new(self.place, format!("no thread {}", call.name)));
                };
                if !function.thread {
                    return Err(Error::new(
                        self.place,
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

    /// Pushes the indices of a path.
    fn path(&mut self, steps: &[Step]) -> Result<Path, Error> {
        let mut path = Vec::with_capacity(steps.len());
        for step in steps {
            path.push(match step {
                Step::Index(index) => {
                    self.expression(index)?;
                    PathStep::Index
                }
                Step::Member(name) => PathStep::Member(Arc::from(name.as_str())),
            });
        }
        Ok(path.into())
    }

    /// `struct(a=1, b=2)`
    fn structure(&mut self, call: &Call) -> Result<(), Error> {
        self.available(call.place, "struct", versions::STRUCTS)?;
        let refuse = |text: String| Err(Error::new(call.place, format!("struct(): {text}")));
        if !call.positional.is_empty() || call.named.is_empty() {
            return refuse("takes members by name".to_owned());
        }
        let mut names: Vec<Arc<str>> = Vec::with_capacity(call.named.len());
        for (name, value) in &call.named {
            if names.iter().any(|other| **other == **name) {
                return refuse(format!("member {name} is there twice"));
            }
            self.expression(value)?;
            names.push(Arc::from(name.as_str()));
        }
        self.emit(Op::Struct(names.into()));
        Ok(())
    }

    fn available(&self, place: Place, name: &str, since: Since) -> Result<(), Error> {
        if self.version.has(since) {
            return Ok(());
        }
        let text = format!("{name}() is not available in version {}", self.version);
        Err(Error::new(place, text))
    }

    fn call(&mut self, call: &Call) -> Result<(), Error> {
        self.place = call.place;
        if let Some((number, function)) = self.function_of.get(call.name.as_str()).copied() {
            if function.thread {
                return Err(Error::new(
                    self.place,
                    format!("{} is a thread: run it", call.name),
                ));
            }
            self.arguments(call, &user_params(function))?;
            self.emit(Op::Call(number));
            return Ok(());
        }
        if call.name == "struct" {
            return self.structure(call);
        }
        let Some((number, builtin)) = builtins::find(&call.name) else {
            return Err(Error::new(self.place, format!("no function {}", call.name)));
        };
        self.available(call.place, builtin.name, versions::since(builtin.name))?;
        let count = self.arguments(call, &builtin_params(builtin))?;
        self.place = call.place;
        self.emit(Op::Builtin(number, count));
        Ok(())
    }

    /// Pushes one value for each parameter: given by position, by name, or the default.
    fn arguments(&mut self, call: &Call, params: &[(&str, Option<Value>)]) -> Result<usize, Error> {
        let refuse =
            |place, text: String| Err(Error::new(place, format!("{}(): {text}", call.name)));
        if call.positional.len() > params.len() {
            return refuse(
                self.place,
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
                return refuse(self.place, format!("no parameter {name} is free"));
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
                (None, None) => return refuse(self.place, format!("argument {param} is missing")),
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
        self.places.push(self.place);
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
