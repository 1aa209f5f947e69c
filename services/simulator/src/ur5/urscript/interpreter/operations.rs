//! What each operation does to the thread that runs it and to the machine.

use std::sync::Arc;

use super::{
    Machine, Slot, Wait,
    thread::{Call, Thread},
};
use crate::ur5::{
    robot::Robot,
    urscript::{
        builtins::{self, Context, Outcome},
        code::Op,
        operators::{binary, truth, unary},
        parts::{self, PathStep, item},
        value::Value,
    },
};

/// Calls inside each other.
const MAX_CALLS: usize = 100;

/// What follows one operation.
pub(super) enum Flow {
    /// Goes on, having cost so many operations.
    Next(u32),
    Wait(Wait),
    ThreadEnds,
    ProgramEnds,
}

impl Machine {
    /// Does the next operation of a thread that is taken out of this slot.
    pub(super) fn operate(
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
