//! What is killed, and when: at the boundaries and in the middle of every step, and at every write of the journal.

use arthro_proto::gateway::v1::StepKind;
use rand::Rng as _;
use rand::seq::SliceRandom as _;
use rand_chacha::ChaCha8Rng;

/// What is struck.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Victim {
    Gateway,
    Registration,
    Planning,
    Motion,
    Instrument,
    /// The connections of both arms' controllers, cut until the procedure has halted.
    ArmLinks,
    /// The CAN bus of the drives, likewise.
    CanBus,
}

/// When within a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Moment {
    /// As soon as it is journalled as intended.
    Begin,
    /// Somewhere in its course, by the controllers' clock.
    Middle,
    /// As soon as it is journalled as done.
    End,
}

/// A call that ends in the kernel when the journal is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Call {
    /// A page or a frame of the log.
    Write,
    /// The log made durable.
    Sync,
}

/// One blow at a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AtStep {
    pub victim: Victim,
    pub kind: StepKind,
    pub moment: Moment,
}

/// The gateway is killed as it makes its `number`th call of this kind, before the call acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AtWrite {
    pub call: Call,
    pub number: u32,
}

/// What is still to be struck in one cell.
#[derive(Clone, Debug, Default)]
pub struct Schedule {
    pub steps: Vec<AtStep>,
    pub writes: Vec<AtWrite>,
}

/// How much is struck.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// For every change: each victim and each step at least once, not every pair.
    Sample,
    /// All pairs of victim, step and moment, several times, and every write of a whole procedure.
    Full,
}

/// Every step that the sequencer takes.
const KINDS: [StepKind; 11] = [
    StepKind::Prepare,
    StepKind::View,
    StepKind::Approach,
    StepKind::Pivot,
    StepKind::Insert,
    StepKind::Bite,
    StepKind::Retract,
    StepKind::PivotBack,
    StepKind::ToTray,
    StepKind::Release,
    StepKind::Withdraw,
];
const MOMENTS: [Moment; 3] = [Moment::Begin, Moment::Middle, Moment::End];

/// Rounds of the full campaign over the five services; the links are cut in one.
const ROUNDS: usize = 4;
/// Calls of a procedure of two bites, from the start of the gateway on, are fewer than these.
const SYNCS: u32 = 50;
const WRITES: u32 = 300;

impl Victim {
    pub const ALL: [Self; 7] = [
        Self::Gateway,
        Self::Registration,
        Self::Planning,
        Self::Motion,
        Self::Instrument,
        Self::ArmLinks,
        Self::CanBus,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Self::Gateway => "gateway",
            Self::Registration => "registration",
            Self::Planning => "planning",
            Self::Motion => "motion",
            Self::Instrument => "instrument",
            Self::ArmLinks => "arm links",
            Self::CanBus => "CAN bus",
        }
    }

    /// Whether it is a process, which is killed, and not a wire, which is cut.
    pub fn is_process(self) -> bool {
        !matches!(self, Self::ArmLinks | Self::CanBus)
    }

    /// Whether a procedure needs it.
    pub fn is_needed(self) -> bool {
        !matches!(self, Self::Registration | Self::Planning)
    }
}

impl Moment {
    pub fn name(self) -> &'static str {
        match self {
            Self::Begin => "begin",
            Self::Middle => "middle",
            Self::End => "end",
        }
    }
}

impl Call {
    /// As strace names it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Write => "pwrite64",
            Self::Sync => "fsync",
        }
    }
}

impl Schedule {
    /// The whole campaign, in an order drawn from `rng`.
    pub fn new(extent: Extent, rng: &mut ChaCha8Rng) -> Self {
        let mut this = match extent {
            Extent::Sample => Self::sample(rng),
            Extent::Full => Self::full(),
        };
        this.steps.shuffle(rng);
        this
    }

    fn full() -> Self {
        let mut steps = Vec::new();
        for kind in KINDS {
            for moment in MOMENTS {
                let at = |victim| AtStep {
                    victim,
                    kind,
                    moment,
                };
                for victim in [
                    Victim::Gateway,
                    Victim::Registration,
                    Victim::Planning,
                    Victim::Motion,
                    Victim::Instrument,
                ] {
                    steps.extend([at(victim); ROUNDS]);
                }
                steps.extend([at(Victim::ArmLinks), at(Victim::CanBus)]);
            }
        }
        let syncs = (1..=SYNCS).map(|number| (Call::Sync, number));
        let writes = (1..=WRITES).map(|number| (Call::Write, number));
        let writes = syncs.chain(writes);
        Self {
            steps,
            writes: writes
                .map(|(call, number)| AtWrite { call, number })
                .collect(),
        }
    }

    fn sample(rng: &mut ChaCha8Rng) -> Self {
        let mut steps = Vec::new();
        let mut each = |victim, kinds: &[StepKind]| {
            for &kind in kinds {
                let moment = MOMENTS[rng.random_range(0..MOMENTS.len())];
                steps.push(AtStep {
                    victim,
                    kind,
                    moment,
                });
            }
        };
        each(Victim::Gateway, &KINDS);
        each(Victim::Registration, &KINDS);
        each(Victim::Planning, &KINDS);
        // The rest of the house by turns; the bite, of which most can be lost, by all.
        each(
            Victim::Motion,
            &[KINDS[1], KINDS[4], KINDS[5], KINDS[6], KINDS[8], KINDS[10]],
        );
        each(
            Victim::Instrument,
            &[KINDS[0], KINDS[3], KINDS[5], KINDS[6], KINDS[9]],
        );
        each(Victim::ArmLinks, &[KINDS[4], KINDS[6]]);
        each(Victim::CanBus, &[KINDS[5], KINDS[9]]);
        let sync = |number| AtWrite {
            call: Call::Sync,
            number,
        };
        let write = |number| AtWrite {
            call: Call::Write,
            number,
        };
        let mut writes: Vec<_> = (0..8)
            .map(|_| rng.random_range(1..=SYNCS / 2))
            .map(sync)
            .collect();
        writes.extend((0..8).map(|_| rng.random_range(9..=WRITES / 2)).map(write));
        writes.sort_by_key(|at| at.number);
        Self { steps, writes }
    }

    /// Leaves out what strikes others. Whoever dies at a write is the gateway.
    pub fn keep_only(&mut self, victim: Victim) {
        self.steps.retain(|at| at.victim == victim);
        if victim != Victim::Gateway {
            self.writes.clear();
        }
    }

    /// Every `of`th blow, from the `part`th on.
    pub fn part(&self, part: usize, of: usize) -> Self {
        let mine = |number: &usize| number % of == part;
        let steps = self.steps.iter().enumerate();
        let writes = self.writes.iter().enumerate();
        Self {
            steps: steps
                .filter(|(number, _)| mine(number))
                .map(|(_, at)| *at)
                .collect(),
            writes: writes
                .filter(|(number, _)| mine(number))
                .map(|(_, at)| *at)
                .collect(),
        }
    }

    /// Takes a blow that is due at this step and moment.
    pub fn take(&mut self, kind: StepKind, moment: Moment) -> Option<AtStep> {
        let due = |at: &AtStep| at.kind == kind && at.moment == moment;
        let place = self.steps.iter().position(due)?;
        Some(self.steps.swap_remove(place))
    }

    pub fn len(&self) -> usize {
        self.steps.len() + self.writes.len()
    }

    pub fn is_empty(&self) -> bool {
        self.steps.is_empty() && self.writes.is_empty()
    }
}
