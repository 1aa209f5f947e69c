//! How much a program may hold.

use super::{Machine, Slot, operations::Flow, thread::Thread};
use crate::ur5::urscript::value::Value;

/// Elements of all values that a program may hold.
const MAX_HELD: usize = 2_000_000;
/// They are counted after so many elements of values were made.
const COUNT_AFTER: usize = 500_000;

impl Machine {
    /// Pushes a value just made.
    pub(super) fn push(&mut self, thread: &mut Thread, value: Value) -> Result<Flow, String> {
        let weight = value.bounded()?;
        thread.stack.push(value);
        self.made(thread, weight)
    }

    /// A value of this weight was made. Once in a while all that the program holds is counted.
    pub(super) fn made(&mut self, running: &Thread, weight: usize) -> Result<Flow, String> {
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
}
