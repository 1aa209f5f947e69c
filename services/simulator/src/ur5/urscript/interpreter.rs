//! Runs a program a little each controller cycle: every thread goes on until it waits for something or has used up its
//! share of the cycle.

use std::sync::Arc;

use super::{
    Error, Place,
    builtins::{self, Context, Outcome},
    code::{Op, Program, Symbol},
    operators::{binary, truth, unary},
    parts::{self, PathStep, item},
    sockets::Sockets,
    syntax::Scope,
    value::Value,
};
use crate::ur5::robot::{Robot, ThreadId, Ticket};

/// Operations in one cycle, shared by the threads: far more than a well-made program needs, few enough that an endless
/// loop does not hold up the controller.
const OPS_PER_CYCLE: u32 = 6_000;
/// Handle of the program's body, which no thread gets: programs initialise their handles with 0 and kill that.
const BODY: i32 = -1;
/// Elements of all values that a program may hold.
const MAX_HELD: usize = 2_000_000;
/// They are counted after so many elements of values were made.
const COUNT_AFTER: usize = 500_000;
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
    /// The slot whose time slice is not cut short.
    critical: Option<usize>,
    sockets: Sockets,
    /// Elements of values made since they were all counted last.
    made: usize,
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
    /// When the built-in began that is not done yet.
    began_s: Option<f64>,
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
    /// The end of a motion, or that it has come within its blend radius.
    Blend(Ticket),
    /// That nobody has a message box before them.
    Popup,
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
            sockets: Sockets::new(Arc::clone(&robot.network)),
            made: 0,
        }
    }

    /// The same, but its first line waits until this time of the controller.
    pub fn starting_at(mut self, time_s: f64) -> Self {
        if let Some(Slot::Waiting(body)) = self.slots.first_mut() {
            body.wait = Wait::Until(time_s);
        }
        self
    }

    /// Name of the program.
    pub fn name(&self) -> &str {
        &self.program.name
    }

    /// One cycle. Gives how the program ended, once it has.
    pub fn step(&mut self, robot: &mut Robot) -> Option<Ending> {
        let share = OPS_PER_CYCLE / self.live().max(1) as u32;
        // A critical section that was cut short by the end of the cycle goes on before any other thread.
        let first = self.critical;
        if let Some(critical) = first {
            match self.step_thread(critical, OPS_PER_CYCLE, robot) {
                Ok(true) if self.critical == Some(critical) => return None,
                Ok(true) => {}
                Ok(false) => return Some(Ending::Finished),
                Err(error) => return Some(Ending::Failed(error)),
            }
        }
        let mut slot = 0;
        while slot < self.slots.len() && self.critical.is_none() {
            if first != Some(slot) {
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
            let place = thread.place(&self.program);
            match self
                .operate(slot, &mut thread, robot)
                .map_err(|text| Error::new(place, text))?
            {
                Flow::Next(cost) => {
                    ops = ops.saturating_sub(cost);
                    thread.wait = Wait::Cycle;
                }
                Flow::Wait(wait) => {
                    // What waits does not hold its time slice, critical or not: programs wait for motions and
                    // sockets in critical sections while other threads move the arm.
                    if self.critical == Some(slot) {
                        self.critical = None;
                    }
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
            Wait::Blend(ticket) => robot.may_blend(*ticket) || robot.has_ended(*ticket),
            Wait::Popup => !robot.popup_open,
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
        let at = call.next;
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
            Op::StorePart(symbol, path) => {
                let value = thread.pop();
                let indices = thread.pop_many(index_count(path));
                let variable = self.variable(thread, *symbol)?;
                parts::store(variable, path, &indices, value)?;
                let weight = variable.bounded()?;
                return self.made(thread, weight);
            }
            Op::Method(symbol, path, method, count) => {
                let arguments = thread.pop_many(*count);
                let indices = thread.pop_many(index_count(path));
                let variable = self.variable(thread, *symbol)?;
                let result = method.call(variable, path, &indices, &arguments)?;
                let weight = variable.bounded()? + result.bounded()?;
                thread.stack.push(result);
                return self.made(thread, weight);
            }
            Op::List(count) => {
                let list = Value::list(thread.pop_many(*count));
                return self.push(thread, list);
            }
            Op::Struct(names) => {
                let members = names.iter().cloned().zip(thread.pop_many(names.len()));
                let structure = Value::Struct(Arc::new(members.collect()));
                return self.push(thread, structure);
            }
            Op::Member(name) => {
                let owner = thread.pop();
                thread.stack.push(parts::member(&owner, name)?);
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
                return self.push(thread, unary(*operator, &operand)?);
            }
            Op::Binary(operator) => {
                let (right, left) = (thread.pop(), thread.pop());
                return self.push(thread, binary(*operator, &left, &right)?);
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
                let now_s = robot.now_s();
                let mut context = Context {
                    robot,
                    sockets: &mut self.sockets,
                    thread: thread.id,
                    secondary: program.secondary,
                    waited_s: thread.began_s.map(|began_s| now_s - began_s),
                };
                return match builtins::call(*number, &mut context, &arguments)? {
                    Outcome::Value(value) => {
                        thread.began_s = None;
                        let cost = builtins::cost(*number);
                        match self.push(thread, value)? {
                            Flow::Next(more) => Ok(Flow::Next(cost + more)),
                            other => Ok(other),
                        }
                    }
                    Outcome::Wait(wait) => {
                        thread.stack.push(Value::None);
                        Ok(Flow::Wait(wait))
                    }
                    Outcome::Again => {
                        thread.began_s.get_or_insert(now_s);
                        thread.stack.extend(arguments);
                        thread.jump(at);
                        Ok(Flow::Wait(Wait::Cycle))
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

    /// Pushes a value just made.
    fn push(&mut self, thread: &mut Thread, value: Value) -> Result<Flow, String> {
        let weight = value.bounded()?;
        thread.stack.push(value);
        self.made(thread, weight)
    }

    /// A value of this weight was made. Once in a while all that the program holds is counted.
    fn made(&mut self, running: &Thread, weight: usize) -> Result<Flow, String> {
        self.made += weight;
        if self.made > COUNT_AFTER {
            self.made = 0;
            let mut room = MAX_HELD;
            let mut count = |value: &Value| {
                room = room.saturating_sub(value.weight());
                room > 0
            };
            let fits = self.globals.iter().flatten().all(&mut count)
                && self.slots.iter().all(|slot| match slot {
                    Slot::Waiting(thread) => thread.values().all(&mut count),
                    Slot::Free | Slot::Running => true,
                })
                && running.values().all(&mut count);
            if !fits {
                return Err(format!("the program holds more than {MAX_HELD} elements"));
            }
        }
        Ok(Flow::Next(1 + weight as u32 / 8))
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
            began_s: None,
        }
    }

    fn place(&self, program: &Program) -> Place {
        let call = self.calls.last();
        call.and_then(|call| program.functions[call.function].places.get(call.next))
            .copied()
            .unwrap_or_default()
    }

    fn values(&self) -> impl Iterator<Item = &Value> {
        let locals = self.calls.iter().flat_map(|call| &call.locals);
        self.stack.iter().chain(locals.map(|(_, value)| value))
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

fn index_count(path: &[PathStep]) -> usize {
    path.iter().filter(|step| **step == PathStep::Index).count()
}

fn thread_handle(value: &Value) -> Result<i32, String> {
    match value {
        Value::Int(handle) => Ok(*handle),
        other => Err(format!("{} where a thread should be", other.kind())),
    }
}
