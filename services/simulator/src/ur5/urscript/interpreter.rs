//! Runs a program a little each controller cycle: every thread goes on until it waits for something or has used up its
//! share of the cycle.

use std::sync::Arc;

use super::{
    Error,
    builtins::{self, Context, Outcome},
    code::{Op, Program, Symbol},
    operators::{binary, is_nested, item, store_item, truth, unary},
    syntax::Scope,
    value::Value,
};
use crate::ur5::robot::{Robot, ThreadId, Ticket};

/// Operations in one cycle, shared by the threads: far more than a well-made program needs, few enough that an endless
/// loop does not hold up the controller.
const OPS_PER_CYCLE: u32 = 6_000;
/// Handle of the program's body, which no thread gets: programs initialise their handles with 0 and kill that.
const BODY: i32 = -1;
const MAX_CALLS: usize = 100;
const MAX_THREADS: usize = 50;

/// A running program.
#[derive(Debug)]
pub struct Machine {
    program: Arc<Program>,
    globals: Vec<Option<Value>>,
    /// The body of the program is in the first slot.
    slots: Vec<Slot>,
    /// Handle of the thread started last.
    last_handle: i32,
    /// The only slot that runs.
    critical: Option<usize>,
}

/// Room for one thread. A running thread is taken out, so that it can reach the rest of the machine.
#[derive(Debug)]
enum Slot {
    Free,
    Running,
    Waiting(Thread),
}

#[derive(Debug)]
struct Thread {
    id: ThreadId,
    /// What `run` gave; never used again for another thread.
    handle: i32,
    stack: Vec<Value>,
    calls: Vec<Call>,
    wait: Wait,
}

#[derive(Debug)]
struct Call {
    function: usize,
    next: usize,
    locals: Vec<(Symbol, Value)>,
}

/// What a thread waits for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wait {
    /// The next cycle.
    Cycle,
    /// This time of the controller.
    Until(f64),
    /// So many seconds of path time, which the speed slider stretches.
    PathTime(f64),
    /// The end of a motion.
    Motion(Ticket),
    /// The end of another thread.
    Thread(i32),
}

/// How a program ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ending {
    /// It came to its end or halted.
    Finished,
    /// Runtime exception.
    Failed(Error),
}

/// What follows one operation.
enum Flow {
    /// Goes on, having cost so many operations.
    Next(u32),
    Wait(Wait),
    ThreadEnds,
    ProgramEnds,
}

impl Machine {
    /// Ready to run its first line.
    pub fn new(program: Program, robot: &mut Robot) -> Self {
        let globals = vec![None; program.symbols.len()];
        let body = Thread::new(robot.new_thread(), BODY, 0, Vec::new());
        Self {
            program: Arc::new(program),
            globals,
            slots: vec![Slot::Waiting(body)],
            last_handle: 0,
            critical: None,
        }
    }

    /// Name of the program.
    pub fn name(&self) -> &str {
        &self.program.name
    }

    /// One cycle. Gives how the program ended, once it has.
    pub fn step(&mut self, robot: &mut Robot) -> Option<Ending> {
        let share = OPS_PER_CYCLE / self.live().max(1) as u32;
        let mut slot = 0;
        while slot < self.slots.len() {
            if self.critical.is_none_or(|critical| critical == slot) {
                match self.step_thread(slot, share, robot) {
                    Ok(true) => {}
                    Ok(false) => return Some(Ending::Finished),
                    Err(error) => return Some(Ending::Failed(error)),
                }
            }
            slot += 1;
        }
        None
    }

    /// Runs one thread until it waits. False when the program ends.
    fn step_thread(&mut self, slot: usize, mut ops: u32, robot: &mut Robot) -> Result<bool, Error> {
        let Slot::Waiting(thread) = &mut self.slots[slot] else {
            return Ok(true);
        };
        let mut wait = thread.wait;
        let due = self.is_due(&mut wait, robot);
        let Slot::Waiting(mut thread) = std::mem::replace(&mut self.slots[slot], Slot::Running)
        else {
            return Ok(true);
        };
        thread.wait = wait;
        while due && ops > 0 {
            let line = thread.line(&self.program);
            match self
                .operate(slot, &mut thread, robot)
                .map_err(|text| Error::new(line, text))?
            {
                Flow::Next(cost) => {
                    ops = ops.saturating_sub(cost);
                    thread.wait = Wait::Cycle;
                }
                Flow::Wait(wait) => {
                    thread.wait = wait;
                    break;
                }
                Flow::ThreadEnds => {
                    self.end(slot, thread.id, robot);
                    return Ok(slot != 0);
                }
                Flow::ProgramEnds => return Ok(false),
            }
        }
        self.slots[slot] = Slot::Waiting(thread);
        Ok(true)
    }

    fn live(&self) -> usize {
        self.slots
            .iter()
            .filter(|slot| !matches!(slot, Slot::Free))
            .count()
    }

    fn slot_of(&self, wanted: i32) -> Option<usize> {
        self.slots
            .iter()
            .position(|slot| matches!(slot, Slot::Waiting(thread) if thread.handle == wanted))
    }

    fn is_due(&self, wait: &mut Wait, robot: &Robot) -> bool {
        match wait {
            Wait::Cycle => true,
            Wait::Until(time_s) => robot.now_s() >= *time_s - 1e-9,
            Wait::PathTime(left_s) => {
                *left_s -= robot.step_s() * robot.scaling();
                *left_s <= 1e-9
            }
            Wait::Motion(ticket) => robot.has_ended(*ticket),
            Wait::Thread(handle) => self.slot_of(*handle).is_none(),
        }
    }

    fn operate(
        &mut self,
        slot: usize,
        thread: &mut Thread,
        robot: &mut Robot,
    ) -> Result<Flow, String> {
        let program = Arc::clone(&self.program);
        let Some(call) = thread.calls.last_mut() else {
            return Ok(Flow::ThreadEnds);
        };
        let Some(op) = program.functions[call.function].ops.get(call.next) else {
            return Ok(Flow::ThreadEnds);
        };
        call.next += 1;
        match op {
            Op::Const(value) => thread.stack.push(value.clone()),
            Op::Load(symbol) => {
                let value = self.load(thread, *symbol)?;
                thread.stack.push(value);
            }
            Op::Store(scope, symbol) => {
                let value = thread.pop();
                self.store(thread, *scope, *symbol, value);
            }
            Op::StoreItem(symbol) => {
                let (value, index) = (thread.pop(), thread.pop());
                let variable = self.variable(thread, *symbol)?;
                store_item(variable, &index, value)?;
            }
            Op::List(count) => {
                let items = thread.pop_many(*count);
                if items.iter().any(is_nested) {
                    return Err("lists are at most two levels deep".to_owned());
                }
                thread.stack.push(Value::List(Arc::new(items)));
            }
            Op::Pose => {
                let numbers: Option<Vec<_>> =
                    thread.pop_many(6).iter().map(Value::number).collect();
                let pose = numbers.and_then(|numbers| numbers.try_into().ok());
                thread
                    .stack
                    .push(Value::Pose(pose.ok_or("a pose is made of numbers")?));
            }
            Op::Index => {
                let (index, list) = (thread.pop(), thread.pop());
                thread.stack.push(item(&list, &index)?);
            }
            Op::Unary(operator) => {
                let operand = thread.pop();
                thread.stack.push(unary(*operator, &operand)?);
            }
            Op::Binary(operator) => {
                let (right, left) = (thread.pop(), thread.pop());
                thread.stack.push(binary(*operator, &left, &right)?);
            }
            Op::Jump(to) => call.next = *to,
            Op::JumpIfFalse(to) => {
                let to = *to;
                if !truth(&thread.pop())? {
                    thread.jump(to);
                }
            }
            Op::ShortCut(decisive, to) => {
                let (decisive, to) = (*decisive, *to);
                if truth(thread.top())? == decisive {
                    thread.jump(to);
                } else {
                    thread.pop();
                }
            }
            Op::CheckBool => {
                truth(thread.top())?;
            }
            Op::Call(function) => {
                if thread.calls.len() >= MAX_CALLS {
                    return Err(format!("more than {MAX_CALLS} calls inside each other"));
                }
                let locals = thread.arguments(&program, *function);
                thread.calls.push(Call {
                    function: *function,
                    next: 0,
                    locals,
                });
            }
            Op::Builtin(number, count) => {
                let arguments = thread.pop_many(*count);
                let mut context = Context {
                    robot,
                    thread: thread.id,
                    secondary: program.secondary,
                };
                return match builtins::call(*number, &mut context, &arguments)? {
                    Outcome::Value(value) => {
                        thread.stack.push(value);
                        Ok(Flow::Next(builtins::cost(*number)))
                    }
                    Outcome::Wait(wait) => {
                        thread.stack.push(Value::None);
                        Ok(Flow::Wait(wait))
                    }
                };
            }
            Op::Run(function) => {
                let locals = thread.arguments(&program, *function);
                let handle = self.start(robot.new_thread(), *function, locals)?;
                thread.stack.push(Value::Int(handle));
            }
            Op::Return => {
                let value = thread.pop();
                thread.calls.pop();
                if thread.calls.is_empty() {
                    return Ok(Flow::ThreadEnds);
                }
                thread.stack.push(value);
            }
            Op::Pop => drop(thread.pop()),
            Op::Kill => {
                let victim = thread_handle(&thread.pop())?;
                if victim == thread.handle {
                    return Ok(Flow::ThreadEnds);
                }
                if let Some(slot) = self.slot_of(victim)
                    && let Slot::Waiting(killed) = &self.slots[slot]
                {
                    self.end(slot, killed.id, robot);
                }
            }
            Op::Join => {
                let other = thread_handle(&thread.pop())?;
                return Ok(Flow::Wait(Wait::Thread(other)));
            }
            Op::EnterCritical => self.critical = Some(slot),
            Op::ExitCritical => self.critical = None,
            Op::Halt => return Ok(Flow::ProgramEnds),
        }
        Ok(Flow::Next(1))
    }

    fn start(
        &mut self,
        id: ThreadId,
        function: usize,
        locals: Vec<(Symbol, Value)>,
    ) -> Result<i32, String> {
        if self.live() >= MAX_THREADS {
            return Err(format!("more than {MAX_THREADS} threads"));
        }
        self.last_handle = self
            .last_handle
            .checked_add(1)
            .ok_or("too many threads were started")?;
        let thread = Slot::Waiting(Thread::new(id, self.last_handle, function, locals));
        match self
            .slots
            .iter_mut()
            .find(|slot| matches!(slot, Slot::Free))
        {
            Some(free) => *free = thread,
            None => self.slots.push(thread),
        }
        Ok(self.last_handle)
    }

    fn end(&mut self, slot: usize, id: ThreadId, robot: &mut Robot) {
        robot.release(id);
        self.slots[slot] = Slot::Free;
        if self.critical == Some(slot) {
            self.critical = None;
        }
    }

    fn load(&mut self, thread: &mut Thread, symbol: Symbol) -> Result<Value, String> {
        self.variable(thread, symbol).cloned()
    }

    /// A local of this name, else a global. The body of the program has globals only, so that its functions see them.
    fn variable<'t>(
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

    fn store(&mut self, thread: &mut Thread, scope: Scope, symbol: Symbol, value: Value) {
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

impl Thread {
    fn new(id: ThreadId, handle: i32, function: usize, locals: Vec<(Symbol, Value)>) -> Self {
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
        }
    }

    fn line(&self, program: &Program) -> u32 {
        let call = self.calls.last();
        call.and_then(|call| program.functions[call.function].lines.get(call.next))
            .copied()
            .unwrap_or_default()
    }

    fn pop(&mut self) -> Value {
        self.stack.pop().unwrap_or(Value::None)
    }

    fn pop_many(&mut self, count: usize) -> Vec<Value> {
        self.stack.split_off(self.stack.len().saturating_sub(count))
    }

    fn top(&self) -> &Value {
        self.stack.last().unwrap_or(&Value::None)
    }

    fn jump(&mut self, to: usize) {
        if let Some(call) = self.calls.last_mut() {
            call.next = to;
        }
    }

    fn arguments(&mut self, program: &Program, function: usize) -> Vec<(Symbol, Value)> {
        let params = &program.functions[function].params;
        params
            .iter()
            .copied()
            .zip(self.pop_many(params.len()))
            .collect()
    }
}

impl Call {
    fn local(&mut self, symbol: Symbol) -> Option<&mut Value> {
        self.locals
            .iter_mut()
            .find(|(name, _)| *name == symbol)
            .map(|(_, value)| value)
    }
}

fn thread_handle(value: &Value) -> Result<i32, String> {
    match value {
        Value::Int(handle) => Ok(*handle),
        other => Err(format!("{} where a thread should be", other.kind())),
    }
}
