//! A thread of a program: its stack, the functions it is in, and what it waits for.

use super::Wait;
use crate::ur5::{
    robot::ThreadId,
    urscript::{
        Place,
        code::{Program, Symbol},
        value::Value,
    },
};

/// One flow of control and what it holds.
#[derive(Debug)]
pub(super) struct Thread {
    pub(super) id: ThreadId,
    /// What `run` gave; never used again for another thread.
    pub(super) handle: i32,
    pub(super) stack: Vec<Value>,
    pub(super) calls: Vec<Call>,
    pub(super) wait: Wait,
    /// When the built-in began that is not done yet.
    pub(super) began_s: Option<f64>,
}

/// A function that is running.
#[derive(Debug)]
pub(super) struct Call {
    pub(super) function: usize,
    pub(super) next: usize,
    pub(super) locals: Vec<(Symbol, Value)>,
}

impl Thread {
    pub(super) fn new(
        id: ThreadId,
        handle: i32,
        function: usize,
        locals: Vec<(Symbol, Value)>,
    ) -> Self {
        Self {
            id,
            handle,
            stack: Vec::new(),
            calls: vec![Call {
                function,
                next: 0,
                locals,
            }],
            wait: Wait::Cycle,
            began_s: None,
        }
    }

    pub(super) fn place(&self, program: &Program) -> Place {
        let call = self.calls.last();
        call.and_then(|call| program.functions[call.function].places.get(call.next))
            .copied()
            .unwrap_or_default()
    }

    pub(super) fn values(&self) -> impl Iterator<Item = &Value> {
        let locals = self.calls.iter().flat_map(|call| &call.locals);
        self.stack.iter().chain(locals.map(|(_, value)| value))
    }

    pub(super) fn pop(&mut self) -> Value {
        self.stack.pop().unwrap_or(Value::None)
    }

    pub(super) fn pop_many(&mut self, count: usize) -> Vec<Value> {
        self.stack.split_off(self.stack.len().saturating_sub(count))
    }

    pub(super) fn top(&self) -> &Value {
        self.stack.last().unwrap_or(&Value::None)
    }

    pub(super) fn jump(&mut self, to: usize) {
        if let Some(call) = self.calls.last_mut() {
            call.next = to;
        }
    }

    pub(super) fn arguments(&mut self, program: &Program, function: usize) -> Vec<(Symbol, Value)> {
        let params = &program.functions[function].params;
        params
            .iter()
            .copied()
            .zip(self.pop_many(params.len()))
            .collect()
    }
}

impl Call {
    pub(super) fn local(&mut self, symbol: Symbol) -> Option<&mut Value> {
        self.locals
            .iter_mut()
            .find(|(name, _)| *name == symbol)
            .map(|(_, value)| value)
    }
}
