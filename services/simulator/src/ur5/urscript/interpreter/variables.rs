//! Where the value of a name is.

use super::{Machine, thread::Thread};
use crate::ur5::urscript::{code::Symbol, syntax::Scope, value::Value};

impl Machine {
    /// What a name stands for here.
    pub(super) fn load(&mut self, thread: &mut Thread, symbol: Symbol) -> Result<Value, String> {
        self.variable(thread, symbol).cloned()
    }

    /// A local of this name, else a global. The body of the program has globals only, so that its functions see them.
    pub(super) fn variable<'t>(
        &'t mut self,
        thread: &'t mut Thread,
        symbol: Symbol,
    ) -> Result<&'t mut Value, String> {
        let local = thread.calls.last_mut().and_then(|call| call.local(symbol));
        let found = local.or(self.globals[symbol].as_mut());
        match found {
            None | Some(Value::None) => Err(format!(
                "variable {} has no value",
                self.program.symbols[symbol]
            )),
            Some(value) => Ok(value),
        }
    }

    /// Gives a name a value, in the scope that it is bound to.
    pub(super) fn store(
        &mut self,
        thread: &mut Thread,
        scope: Scope,
        symbol: Symbol,
        value: Value,
    ) {
        let in_body = thread.calls.last().is_none_or(|call| call.function == 0);
        let Some(call) = thread.calls.last_mut() else {
            return;
        };
        let global = match scope {
            Scope::Global => true,
            Scope::Local => in_body,
            Scope::Nearest => {
                call.local(symbol).is_none() && (in_body || self.globals[symbol].is_some())
            }
        };
        if global {
            self.globals[symbol] = Some(value);
        } else if let Some(local) = call.local(symbol) {
            *local = value;
        } else {
            call.locals.push((symbol, value));
        }
    }
}
