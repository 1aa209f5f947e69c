//! The steps of a procedure as a table: what each one is, what it does to the world, and in which
//! order they come (Fig. 10 and 11 of the paper, (a) to (h) for every bite, the arthroscope's view before it).

use arthro_geometry::Point3;

use crate::procedure::machine::{self, StepEvent};
use crate::words::words;

words! {
    /// What a step does.
    Kind {
        /// Both arms to their start, the arthroscope in front of its portal.
        Prepare = "PREPARE",
        /// The arthroscope to where it watches the bite from, the forceps outside.
        View = "VIEW",
        /// (a) Free move of the forceps to the portal.
        Approach = "APPROACH",
        /// (b) Pivot towards the bite, jaw turned to its opening direction.
        Pivot = "PIVOT",
        /// (c) Insert to the bite.
        Insert = "INSERT",
        /// (d) Close the jaw.
        Bite = "BITE",
        /// (e) Retract along the shaft.
        Retract = "RETRACT",
        /// (f) Pivot back to the neutral direction.
        PivotBack = "PIVOT_BACK",
        /// (g) Free move to the tray.
        ToTray = "TO_TRAY",
        /// (h) Open the jaw and let the tissue go.
        Release = "RELEASE",
        /// Both arms withdrawn.
        Withdraw = "WITHDRAW",
    }
}

words! {
    /// Whether a step may be done again.
    Effect {
        /// Changes nothing.
        Pure = "PURE",
        /// May be done again after looking where the arms are.
        Reversible = "REVERSIBLE",
        /// Removes tissue: done at most once.
        Irreversible = "IRREVERSIBLE",
    }
}

words! {
    /// Where a step stands.
    StepState {
        /// Written before its first command is sent.
        Intended = "INTENDED",
        /// Confirmed.
        Done = "DONE",
        /// Ended otherwise; known not to have removed tissue.
        Failed = "FAILED",
        /// Irreversible and of unknown outcome.
        InDoubt = "IN_DOUBT",
        /// Was in doubt; decided by the operator.
        Resolved = "RESOLVED",
    }
}

/// The cycle of one bite, (a) to (h).
pub const CYCLE: [Kind; 8] = [
    Kind::Approach,
    Kind::Pivot,
    Kind::Insert,
    Kind::Bite,
    Kind::Retract,
    Kind::PivotBack,
    Kind::ToTray,
    Kind::Release,
];

/// Out of the body from anywhere: along the shaft first, the tissue to the tray, then both arms away.
pub const RETREAT: [Kind; 4] = [Kind::Retract, Kind::ToTray, Kind::Release, Kind::Withdraw];

impl Kind {
    /// The effect class of each kind.
    pub const fn effect(self) -> Effect {
        match self {
            Self::Bite => Effect::Irreversible,
            Self::Prepare
            | Self::View
            | Self::Approach
            | Self::Pivot
            | Self::Insert
            | Self::Retract
            | Self::PivotBack
            | Self::ToTray
            | Self::Release
            | Self::Withdraw => Effect::Reversible,
        }
    }
}

/// A step that is to come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Planned {
    /// What it does.
    pub kind: Kind,
    /// Which bite it belongs to, from 0; `None` for the steps around the bites. A retract that belongs to no bite
    /// draws back both arms wherever they are inside.
    pub bite: Option<u32>,
}

/// Preparation, the cycles of the bites from `first` on, and the withdrawal. `views` says of each bite of the plan whether
/// the arthroscope watches it from another place than the bite before; the first to come is always gone to.
pub fn from_bite(first: u32, views: &[bool]) -> Vec<Planned> {
    let mut steps = Vec::new();
    if (first as usize) < views.len() {
        steps.push(around(Kind::Prepare));
    }
    for (bite, moves) in (0..).zip(views).skip(first as usize) {
        let view = (*moves || bite == first).then_some(Kind::View);
        steps.extend(view.into_iter().chain(CYCLE).map(|kind| Planned {
            kind,
            bite: Some(bite),
        }));
    }
    steps.push(around(Kind::Withdraw));
    steps
}

/// The retreat from anywhere.
pub fn retreat() -> Vec<Planned> {
    RETREAT.map(around).to_vec()
}

/// What is left after a pause that drew both arms back. Where the bite under way was not taken its cycle begins anew; where it
/// was, the rest of its cycle comes, without the retraction. Whatever bite comes next, the arthroscope is gone in again to see it.
pub fn after_drawing_back(
    left: impl IntoIterator<Item = Planned>,
    bites_done: u32,
    views: &[bool],
) -> Vec<Planned> {
    let left: Vec<_> = left.into_iter().collect();
    let Some(bite) = left.first().and_then(|step| step.bite) else {
        return left;
    };
    if bite >= bites_done {
        return without_preparation(bite, views);
    }
    let rest = left
        .into_iter()
        .filter(|step| step.bite == Some(bite) && step.kind != Kind::Retract);
    rest.chain(without_preparation(bite + 1, views)).collect()
}

fn without_preparation(first: u32, views: &[bool]) -> Vec<Planned> {
    let steps = from_bite(first, views).into_iter();
    steps.filter(|step| step.kind != Kind::Prepare).collect()
}

/// A step that belongs to no bite.
pub const fn around(kind: Kind) -> Planned {
    Planned { kind, bite: None }
}

/// One line of the journal.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// From 1.
    pub sequence: u32,
    /// What it does, and for which bite.
    pub planned: Planned,
    /// Where it stands.
    pub state: StepState,
    /// Idempotency key of its commands.
    pub operation_id: String,
    /// Milliseconds since 1970-01-01 UTC.
    pub intended_at_ms: i64,
    /// Unset while it is under way.
    pub ended_at_ms: Option<i64>,
    /// The forceps controller's clock, s.
    pub started_controller_s: f64,
    /// Unset while it is under way, and when the end was not seen.
    pub ended_controller_s: Option<f64>,
    /// Outcome or failure, for a person.
    pub detail: String,
}

/// What the jaw did in a BITE step.
#[derive(Clone, Debug, PartialEq)]
pub struct BiteOutcome {
    /// From 0.
    pub bite: u32,
    /// The measured tip when the jaw had closed, forceps arm's base.
    pub tip: Point3,
    /// The jaw's state in the instrument service's word.
    pub jaw: String,
    /// Highest current seen, mA.
    pub peak_current_ma: f64,
}

impl Step {
    /// Ends the step, or decides on it, by the machine's table. A step that has ended stays as it is.
    pub fn apply(&mut self, event: StepEvent) -> bool {
        let effect = self.planned.kind.effect();
        match machine::next_of_step(self.state, event, effect) {
            Some(state) => {
                self.state = state;
                true
            }
            None => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bite_has_its_eight_steps_between_preparation_and_withdrawal() {
        let steps = from_bite(0, &[true, false, true]);
        assert_eq!(steps.len(), 1 + 3 * 8 + 2 + 1);
        assert_eq!(steps[0].kind, Kind::Prepare);
        assert_eq!(
            steps[10],
            Planned {
                kind: Kind::Approach,
                bite: Some(1)
            }
        );
        assert_eq!(steps[27].kind, Kind::Withdraw);
    }

    #[test]
    fn the_arthroscope_goes_to_a_view_before_its_bite_and_only_if_it_is_another() {
        let views = |first| {
            let steps = from_bite(first, &[true, false, true]);
            let views = steps.iter().filter(|step| step.kind == Kind::View);
            views.map(|step| step.bite.unwrap()).collect::<Vec<_>>()
        };
        assert_eq!(views(0), [0, 2]);
        assert_eq!(views(1), [1, 2], "after a retreat it stands at none");
        let steps = from_bite(2, &[true, false, true]);
        let kinds: Vec<_> = steps.iter().map(|step| step.kind).take(3).collect();
        assert_eq!(kinds, [Kind::Prepare, Kind::View, Kind::Approach]);
    }

    #[test]
    fn after_the_last_bite_only_the_withdrawal_is_left() {
        assert_eq!(from_bite(3, &[true; 3]), [around(Kind::Withdraw)]);
    }

    #[test]
    fn only_the_bite_is_irreversible() {
        let irreversible: Vec<_> = Kind::ALL
            .iter()
            .filter(|kind| kind.effect() == Effect::Irreversible)
            .collect();
        assert_eq!(irreversible, [&Kind::Bite]);
    }

    #[test]
    fn a_bite_not_taken_begins_anew_after_drawing_back() {
        let views = [true, false, true];
        let all = from_bite(0, &views);
        // Halted before the insertion of bite 1.
        let place = all
            .iter()
            .position(|step| step.kind == Kind::Insert && step.bite == Some(1))
            .unwrap();
        let left = after_drawing_back(all[place..].iter().copied(), 1, &views);
        let first: Vec<_> = left.iter().map(|step| (step.kind, step.bite)).collect();
        assert_eq!(first[0], (Kind::View, Some(1)), "the arthroscope is out");
        assert_eq!(first[1], (Kind::Approach, Some(1)));
        assert_eq!(left.last(), Some(&around(Kind::Withdraw)));
    }

    #[test]
    fn a_bite_that_was_taken_is_not_taken_again_after_drawing_back() {
        let views = [true, false, true];
        let all = from_bite(0, &views);
        let place = all
            .iter()
            .position(|step| step.kind == Kind::Retract && step.bite == Some(0))
            .unwrap();
        let left = after_drawing_back(all[place..].iter().copied(), 1, &views);
        let first: Vec<_> = left.iter().map(|step| (step.kind, step.bite)).collect();
        assert_eq!(
            first[..5],
            [
                (Kind::PivotBack, Some(0)),
                (Kind::ToTray, Some(0)),
                (Kind::Release, Some(0)),
                (Kind::View, Some(1)),
                (Kind::Approach, Some(1)),
            ]
        );
        let bites = left.iter().filter(|step| step.kind == Kind::Bite);
        assert_eq!(bites.count(), 2);
    }

    #[test]
    fn drawing_back_around_the_bites_changes_nothing() {
        let left = from_bite(3, &[true; 3]);
        assert_eq!(after_drawing_back(left.clone(), 3, &[true; 3]), left);
    }

    #[test]
    fn the_retreat_begins_along_the_shaft_and_never_bites() {
        let steps = retreat();
        assert_eq!(steps[0], around(Kind::Retract));
        assert!(
            steps
                .iter()
                .all(|step| step.kind.effect() != Effect::Irreversible)
        );
    }
}
