//! The bites of one procedure by two accounts: the journal's, and the referee's.

use std::collections::BTreeMap;

use arthro_proto::gateway::v1::{GetReportResponse, ProcedureState, Step, StepKind, StepState};

/// Both accounts of one procedure.
pub struct Books {
    /// Closures of the jaw that this procedure did not make.
    closures_before: u32,
    /// What came of each bite in doubt, by its sequence: how often the jaw had closed.
    judged: BTreeMap<u32, u32>,
    /// Bites that the operator had done again although they were made.
    repeats_decided: BTreeMap<i32, u32>,
}

/// What two accounts of the same bites come to.
#[derive(Clone, Debug, Default)]
pub struct Difference {
    pub lost: u32,
    pub repeated: u32,
    pub disagreements: Vec<String>,
}

impl Books {
    pub fn open(closures: u32) -> Self {
        Self {
            closures_before: closures,
            judged: BTreeMap::new(),
            repeats_decided: BTreeMap::new(),
        }
    }

    /// Compares both accounts while nothing moves. Of a bite in doubt the referee knows what came of it.
    pub fn compare(&mut self, report: &GetReportResponse, closures: u32) -> Difference {
        let mut difference = Difference::default();
        let bites = || {
            report
                .steps
                .iter()
                .filter(|step| step.kind() == StepKind::Bite)
        };
        let done = bites()
            .filter(|step| step.state() == StepState::Done)
            .count() as u32;
        let known = done + self.judged.values().sum::<u32>();
        let mut beyond = i64::from(closures) - i64::from(self.closures_before + known);
        let in_doubt = |step: &&Step| {
            matches!(step.state(), StepState::InDoubt | StepState::Resolved)
                && !self.judged.contains_key(&step.sequence)
        };
        let in_doubt: Vec<u32> = bites().filter(in_doubt).map(|step| step.sequence).collect();
        for sequence in in_doubt {
            let made = beyond.clamp(0, 1);
            beyond -= made;
            self.judged.insert(sequence, made as u32);
        }
        if beyond != 0 {
            difference.disagreements.push(format!(
                "the referee saw {beyond:+} closures beyond the journal's account"
            ));
            difference.lost = (-beyond).max(0) as u32;
            difference.repeated = beyond.max(0) as u32;
            // Told once.
            self.closures_before = (i64::from(self.closures_before) + beyond).max(0) as u32;
        }
        if report.bites.len() as u32 != done {
            difference.disagreements.push(format!(
                "{} outcomes of {done} bites that are done",
                report.bites.len()
            ));
        }
        difference
    }

    /// How often this bite was made.
    pub fn made(&self, report: &GetReportResponse, bite: i32) -> u32 {
        let of_bite = |step: &&Step| step.kind() == StepKind::Bite && step.bite == bite;
        let times = |step: &Step| match step.state() {
            StepState::Done => 1,
            _ => self.judged.get(&step.sequence).copied().unwrap_or(0),
        };
        report.steps.iter().filter(of_bite).map(times).sum()
    }

    /// The operator had a bite done again that was made.
    pub fn decide_repeat(&mut self, bite: i32) {
        *self.repeats_decided.entry(bite).or_default() += 1;
    }

    /// What was lost and repeated in a procedure that is over.
    pub fn close(&self, report: &GetReportResponse) -> Difference {
        let mut difference = Difference::default();
        let Some(procedure) = &report.procedure else {
            difference
                .disagreements
                .push("a report without procedure".to_owned());
            return difference;
        };
        let completed = procedure.state() == ProcedureState::Completed;
        for bite in 0..procedure.bites_planned as i32 {
            let made = self.made(report, bite);
            let decided = self.repeats_decided.get(&bite).copied().unwrap_or(0);
            if completed && made == 0 {
                difference.lost += 1;
                difference
                    .disagreements
                    .push(format!("bite {bite} was never made"));
            }
            if made > 1 + decided {
                difference.repeated += made - 1 - decided;
                difference
                    .disagreements
                    .push(format!("bite {bite} was made {made} times"));
            }
        }
        if completed && procedure.bites_done != procedure.bites_planned {
            difference.disagreements.push(format!(
                "completed with {} of {} bites done",
                procedure.bites_done, procedure.bites_planned
            ));
        }
        difference
    }
}

/// The bite that an operator decides about: the first that was not let go over the tray.
pub fn interrupted_bite(report: &GetReportResponse, decided: i32) -> i32 {
    let released = |step: &&Step| {
        step.kind() == StepKind::Release && step.bite >= 0 && step.state() == StepState::Done
    };
    let released = report
        .steps
        .iter()
        .filter(released)
        .map(|step| step.bite + 1);
    released.max().unwrap_or(0).max(decided)
}

#[cfg(test)]
mod tests {
    use arthro_proto::gateway::v1::{BiteOutcome, Procedure};

    use super::*;

    fn report(bites: &[(i32, StepState)]) -> GetReportResponse {
        let steps: Vec<Step> = (1..)
            .zip(bites)
            .map(|(sequence, &(bite, state))| Step {
                sequence,
                kind: StepKind::Bite.into(),
                state: state.into(),
                bite,
                ..Default::default()
            })
            .collect();
        let done = bites.iter().filter(|(_, state)| *state == StepState::Done);
        GetReportResponse {
            procedure: Some(Procedure {
                state: ProcedureState::Completed.into(),
                bites_planned: 2,
                bites_done: 2,
                ..Default::default()
            }),
            bites: vec![BiteOutcome::default(); done.count()],
            steps,
        }
    }

    #[test]
    fn accounts_that_agree_find_nothing() {
        let mut books = Books::open(7);
        let report = report(&[(0, StepState::Done), (1, StepState::Done)]);
        let difference = books.compare(&report, 9);
        assert!(difference.disagreements.is_empty(), "{difference:?}");
        assert!(books.close(&report).disagreements.is_empty());
    }

    #[test]
    fn a_bite_in_doubt_is_what_the_referee_saw() {
        for (closures, made) in [(0, 0), (1, 1)] {
            let mut books = Books::open(0);
            let report = report(&[(0, StepState::InDoubt)]);
            let difference = books.compare(&report, closures);
            assert!(difference.disagreements.is_empty(), "{difference:?}");
            assert_eq!(books.made(&report, 0), made);
        }
    }

    #[test]
    fn a_done_bite_that_nobody_saw_is_lost() {
        let mut books = Books::open(0);
        let difference = books.compare(&report(&[(0, StepState::Done)]), 0);
        assert_eq!((difference.lost, difference.repeated), (1, 0));
        assert_eq!(difference.disagreements.len(), 1);
    }

    #[test]
    fn a_closure_after_a_bite_that_failed_is_one_too_many() {
        let mut books = Books::open(0);
        let difference = books.compare(&report(&[(0, StepState::Failed)]), 1);
        assert_eq!((difference.lost, difference.repeated), (0, 1));
    }

    #[test]
    fn a_bite_made_twice_is_repeated_unless_that_was_decided() {
        let twice = report(&[
            (0, StepState::Done),
            (0, StepState::Done),
            (1, StepState::Done),
        ]);
        let mut books = Books::open(0);
        books.compare(&twice, 3);
        assert_eq!(books.close(&twice).repeated, 1);
        books.decide_repeat(0);
        assert_eq!(books.close(&twice).repeated, 0);
    }

    #[test]
    fn a_planned_bite_that_was_never_made_is_lost() {
        let mut books = Books::open(0);
        let report = report(&[(0, StepState::Done)]);
        books.compare(&report, 1);
        assert_eq!(books.close(&report).lost, 1);
    }
}
