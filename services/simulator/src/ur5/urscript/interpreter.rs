//! Runs a program a little each controller cycle: every thread goes on until it waits for something or has used up its
//! share of the cycle.

mod memory;
mod operations;
mod thread;
mod variables;

use std::sync::Arc;

use self::{operations::Flow, thread::Thread};
use super::{
    Error,
    code::{Program, Symbol},
    sockets::Sockets,
    value::Value,
};
use crate::ur5::robot::{Robot, ThreadId, Ticket};

/// Operations in one cycle, shared by the threads: far more than a well-made program needs, few enough that an endless
/// loop does not hold up the controller.
const OPS_PER_CYCLE: u32 = 6_000;
/// Handle of the program's body, which no thread gets: programs initialise their handles with 0 and kill that.
const BODY: i32 = -1;
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
}
