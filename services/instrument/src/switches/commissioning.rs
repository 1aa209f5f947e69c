//! Each configured switch is pressed by hand, one after the other, while the drive has no power. A switch has passed when
//! its own input went from free to active and back, and the drive took its function for active just then.

use std::time::Duration;

use epos4_link::objects::INPUT_COUNT;

use super::{Inputs, SwitchSpec};

/// A level that changes counts when it has stayed for this long: contacts bounce.
const SETTLED_AFTER: Duration = Duration::from_millis(30);

/// Watches an operator press the switches of one axis.
#[derive(Clone, PartialEq, Debug)]
pub struct Commissioning {
    switches: Vec<Progress>,
    /// How long each switch may take, on the clock of the bus.
    timeout: Duration,
    levels: Settled,
    trial: Option<Trial>,
}

/// One switch and how far it is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Progress {
    /// As configured.
    pub switch: SwitchSpec,
    /// Whether its input has the active level.
    pub active: bool,
    /// How far it is.
    pub step: Step,
}

/// How far a switch is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Step {
    /// Others come first.
    Waiting,
    /// It shall be pressed now.
    Press,
    /// It is pressed and shall be released.
    Release,
    /// Free, active, free again, on the right input and with the right polarity.
    Passed,
    /// Not so.
    Failed(SwitchError),
}

/// What is wrong with a switch.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum SwitchError {
    /// Nothing happened.
    #[error("was not pressed in time; its input did not change")]
    NeverPressed,
    /// It stays active.
    #[error("was pressed and did not become free again in time")]
    NotReleased,
    /// Another input changed instead.
    #[error("is wired to input {0}: that one changed instead")]
    WrongInput(u8),
    /// It is active while free, and free while pressed.
    #[error(
        "is active while it is free and free while it is pressed: its polarity is the other one"
    )]
    WrongPolarity,
    /// Active all the time.
    #[error(
        "is active all the time: a normally closed switch shows so when its wire is cut, when it has no supply, or \
         when something presses it"
    )]
    ActiveAtRest,
    /// The level is right, what the drive makes of it is not.
    #[error(
        "has the right levels, but the drive does not take its function for active with them (objects 0x3142 and 0x3141:02)"
    )]
    FunctionNotMapped,
}

/// The switch that is being pressed.
#[derive(Clone, Copy, PartialEq, Debug)]
struct Trial {
    place: usize,
    started: Duration,
    /// All levels when it began.
    rest_levels: u16,
    /// Changes of its own level.
    changes: u8,
    /// Changes of the first other input that changed.
    other: Option<(u8, u8)>,
    function_followed: bool,
}

/// Levels without bounce.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
struct Settled {
    levels: Option<u16>,
    candidate: u16,
    since: Duration,
}

impl SwitchError {
    /// A stable word.
    pub const fn reason(self) -> &'static str {
        match self {
            Self::NeverPressed => "SWITCH_NEVER_PRESSED",
            Self::NotReleased => "SWITCH_NOT_RELEASED",
            Self::WrongInput(_) => "SWITCH_WRONG_INPUT",
            Self::WrongPolarity => "SWITCH_WRONG_POLARITY",
            Self::ActiveAtRest => "SWITCH_ACTIVE_AT_REST",
            Self::FunctionNotMapped => "SWITCH_FUNCTION_NOT_MAPPED",
        }
    }
}

impl Commissioning {
    /// Nothing has been pressed yet.
    pub fn new(switches: &[SwitchSpec], timeout: Duration) -> Self {
        let waiting = |switch: &SwitchSpec| Progress {
            switch: *switch,
            active: false,
            step: Step::Waiting,
        };
        Self {
            switches: switches.iter().map(waiting).collect(),
            timeout,
            levels: Settled::default(),
            trial: None,
        }
    }

    /// Every switch, in the order in which they are pressed.
    pub fn switches(&self) -> &[Progress] {
        &self.switches
    }

    /// Takes the inputs at this time of the bus; `true` when every switch has passed or failed.
    pub fn observe(&mut self, inputs: &Inputs, stamp: Duration) -> bool {
        let Some((before, levels)) = self.levels.observe(inputs.levels, stamp) else {
            return self.switches.is_empty();
        };
        let settled = Inputs { levels, ..*inputs };
        for progress in &mut self.switches {
            progress.active = progress.switch.is_active(&settled);
        }
        let Some(place) = self
            .switches
            .iter()
            .position(|progress| !matches!(progress.step, Step::Passed | Step::Failed(_)))
        else {
            return true;
        };
        let mut trial = match self.trial {
            Some(trial) if trial.place == place => trial,
            _ => Trial::new(place, levels, stamp),
        };
        let progress = &mut self.switches[place];
        let late = stamp.saturating_sub(trial.started) > self.timeout;
        progress.step = trial.observe(&progress.switch, before, &settled, late);
        self.trial = Some(trial);
        self.switches
            .iter()
            .all(|progress| matches!(progress.step, Step::Passed | Step::Failed(_)))
    }

    /// The first switch that failed.
    pub fn first_failure(&self) -> Option<(SwitchSpec, SwitchError)> {
        self.switches
            .iter()
            .find_map(|progress| match progress.step {
                Step::Failed(error) => Some((progress.switch, error)),
                _ => None,
            })
    }
}

impl Trial {
    const fn new(place: usize, rest_levels: u16, started: Duration) -> Self {
        Self {
            place,
            started,
            rest_levels,
            changes: 0,
            other: None,
            function_followed: false,
        }
    }

    fn observe(&mut self, switch: &SwitchSpec, before: u16, now: &Inputs, late: bool) -> Step {
        let own = 1_u16 << (switch.input - 1);
        let changed = before ^ now.levels;
        if changed & own != 0 {
            self.changes += 1;
        }
        self.note_others(changed & !own);
        let rest = Inputs {
            levels: self.rest_levels,
            ..*now
        };
        let active = switch.is_active(now);
        // The drive's own word and the level come by different messages: once while pressed is enough.
        self.function_followed |= active && now.has(switch.function);
        match (switch.is_active(&rest), self.changes) {
            (true, 2..) => return Step::Failed(SwitchError::WrongPolarity),
            (false, 2..) if !self.function_followed => {
                return Step::Failed(SwitchError::FunctionNotMapped);
            }
            (false, 2..) => return Step::Passed,
            _ => {}
        }
        if let (0, Some((input, 2..))) = (self.changes, self.other) {
            return Step::Failed(SwitchError::WrongInput(input));
        }
        match (late, self.changes) {
            (false, 0) => Step::Press,
            (false, _) => Step::Release,
            (true, 0) => Step::Failed(match self.other {
                Some((input, _)) => SwitchError::WrongInput(input),
                None if active => SwitchError::ActiveAtRest,
                None => SwitchError::NeverPressed,
            }),
            (true, _) => Step::Failed(SwitchError::NotReleased),
        }
    }

    fn note_others(&mut self, changed: u16) {
        for input in 1..=INPUT_COUNT {
            if changed >> (input - 1) & 1 == 0 {
                continue;
            }
            match &mut self.other {
                None => self.other = Some((input, 1)),
                Some((other, changes)) if *other == input => *changes = changes.saturating_add(1),
                Some(_) => {}
            }
        }
    }
}

impl Settled {
    /// The settled levels before and now, once there are any.
    fn observe(&mut self, levels: u16, stamp: Duration) -> Option<(u16, u16)> {
        if levels != self.candidate || (self.levels.is_none() && self.since == Duration::ZERO) {
            self.candidate = levels;
            self.since = stamp;
        }
        let before = self.levels;
        if stamp.saturating_sub(self.since) >= SETTLED_AFTER {
            self.levels = Some(self.candidate);
        }
        let now = self.levels?;
        Some((before.unwrap_or(now), now))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Function, Level};
    use super::*;

    /// Normally closed: high while free.
    const NEGATIVE_LIMIT: SwitchSpec = SwitchSpec {
        input: 1,
        function: Function::NegativeLimit,
        active: Level::Low,
        normally_closed: true,
    };
    const HOME: SwitchSpec = SwitchSpec {
        input: 3,
        function: Function::Home,
        active: Level::High,
        normally_closed: false,
    };
    const TIMEOUT: Duration = Duration::from_secs(10);

    /// A hand over inputs whose drive has this mapping.
    struct Bench {
        commissioning: Commissioning,
        now: Duration,
        levels: u16,
        mapped: Vec<SwitchSpec>,
        over: bool,
    }

    impl Bench {
        fn new(levels: u16, switches: &[SwitchSpec]) -> Self {
            let mut bench = Self {
                commissioning: Commissioning::new(switches, TIMEOUT),
                now: Duration::from_secs(100),
                levels,
                mapped: switches.to_vec(),
                over: false,
            };
            bench.wait_ms(100);
            bench
        }

        fn wait_ms(&mut self, ms: u64) {
            for _ in 0..ms / 10 {
                let mut inputs = Inputs {
                    levels: self.levels,
                    functions: 0,
                };
                for switch in &self.mapped {
                    inputs.functions |=
                        u32::from(switch.is_active(&inputs)) << switch.function.code();
                }
                self.over = self.commissioning.observe(&inputs, self.now);
                self.now += Duration::from_millis(10);
            }
        }

        fn press(&mut self, input: u8) {
            for _ in 0..2 {
                self.levels ^= 1 << (input - 1);
                self.wait_ms(200);
            }
        }

        fn step(&self, place: usize) -> Step {
            self.commissioning.switches()[place].step
        }
    }

    #[test]
    fn switches_that_are_pressed_one_after_the_other_pass() {
        let mut bench = Bench::new(0b001, &[NEGATIVE_LIMIT, HOME]);
        assert_eq!([bench.step(0), bench.step(1)], [Step::Press, Step::Waiting]);
        bench.levels ^= 1;
        bench.wait_ms(200);
        assert_eq!(bench.step(0), Step::Release);
        bench.levels ^= 1;
        bench.wait_ms(200);
        assert_eq!([bench.step(0), bench.step(1)], [Step::Passed, Step::Press]);
        assert!(!bench.over);
        bench.press(3);
        assert!(bench.over);
        assert_eq!(bench.step(1), Step::Passed);
        assert_eq!(bench.commissioning.first_failure(), None);
    }

    #[test]
    fn a_bounce_is_no_press() {
        let mut bench = Bench::new(0b001, &[NEGATIVE_LIMIT]);
        for _ in 0..6 {
            bench.levels ^= 1;
            bench.wait_ms(20);
        }
        assert_eq!(bench.step(0), Step::Press);
    }

    #[test]
    fn what_is_wrong_with_a_switch_is_named() {
        let mut swapped = Bench::new(0b001, &[NEGATIVE_LIMIT]);
        swapped.press(2);
        assert_eq!(swapped.step(0), Step::Failed(SwitchError::WrongInput(2)));

        let mut inverted = Bench::new(0b000, &[NEGATIVE_LIMIT]);
        inverted.press(1);
        assert_eq!(inverted.step(0), Step::Failed(SwitchError::WrongPolarity));

        let mut unmapped = Bench::new(0b001, &[NEGATIVE_LIMIT]);
        unmapped.mapped.clear();
        unmapped.press(1);
        assert_eq!(
            unmapped.step(0),
            Step::Failed(SwitchError::FunctionNotMapped)
        );

        let late = [
            (0b000, SwitchError::ActiveAtRest),
            (0b001, SwitchError::NeverPressed),
        ];
        for (levels, error) in late {
            let mut idle = Bench::new(levels, &[NEGATIVE_LIMIT]);
            idle.wait_ms(10_100);
            assert!(idle.over);
            assert_eq!(idle.step(0), Step::Failed(error));
        }

        let mut stuck = Bench::new(0b001, &[NEGATIVE_LIMIT]);
        stuck.levels = 0;
        stuck.wait_ms(10_100);
        assert_eq!(stuck.step(0), Step::Failed(SwitchError::NotReleased));
        let (switch, error) = stuck.commissioning.first_failure().unwrap();
        assert_eq!(
            (switch.to_string().as_str(), error.reason()),
            ("negative limit switch on input 1", "SWITCH_NOT_RELEASED")
        );
    }
}
