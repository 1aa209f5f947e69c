//! What the campaign found: a table for people, one line for machines.

use std::collections::BTreeMap;

/// Everything that was struck and what came of it.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    rows: BTreeMap<(&'static str, String), Row>,
    pub procedures: u32,
    pub moved_by_itself: u32,
    pub bites_lost: u32,
    pub bites_repeated: u32,
    pub disagreements: u32,
    /// Sentences, with what repeats them.
    pub findings: Vec<String>,
    /// Interruptions that no blow explains, by reason: a recovery that had to be decided again.
    pub setbacks: BTreeMap<String, u32>,
}

/// What came of one blow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The procedure stopped between or within steps that may be done again.
    Interrupted,
    /// The procedure stopped within a bite of unknown outcome.
    InDoubt,
    /// What was struck was not needed, or not any more.
    WentOn,
}

#[derive(Clone, Copy, Debug, Default)]
struct Row {
    blows: u32,
    interrupted: u32,
    in_doubt: u32,
    went_on: u32,
}

impl Tally {
    /// A blow at `victim` in this phase.
    pub fn blow(&mut self, victim: &'static str, phase: &str, outcome: Outcome) {
        let row = self.rows.entry((victim, phase.to_owned())).or_default();
        row.blows += 1;
        match outcome {
            Outcome::Interrupted => row.interrupted += 1,
            Outcome::InDoubt => row.in_doubt += 1,
            Outcome::WentOn => row.went_on += 1,
        }
    }

    pub fn add(&mut self, other: Self) {
        for (at, row) in other.rows {
            let mine = self.rows.entry(at).or_default();
            mine.blows += row.blows;
            mine.interrupted += row.interrupted;
            mine.in_doubt += row.in_doubt;
            mine.went_on += row.went_on;
        }
        self.procedures += other.procedures;
        self.moved_by_itself += other.moved_by_itself;
        self.bites_lost += other.bites_lost;
        self.bites_repeated += other.bites_repeated;
        self.disagreements += other.disagreements;
        self.findings.extend(other.findings);
        for (reason, times) in other.setbacks {
            *self.setbacks.entry(reason).or_default() += times;
        }
    }

    fn blows(&self, wanted: impl Fn(&str) -> bool) -> u32 {
        let rows = self.rows.iter().filter(|((victim, _), _)| wanted(victim));
        rows.map(|(_, row)| row.blows).sum()
    }

    /// SIGKILLs.
    pub fn kills(&self) -> u32 {
        self.blows(|victim| !is_link(victim))
    }

    pub fn passed(&self) -> bool {
        self.findings.is_empty()
            && self.moved_by_itself + self.bites_lost + self.bites_repeated + self.disagreements
                == 0
    }

    /// The table, the findings, and the line for machines last.
    pub fn print(&self, seed: u64, wall_s: f64) {
        println!(
            "{:<14} {:<12} {:>6} {:>12} {:>9} {:>8}",
            "struck", "phase", "blows", "interrupted", "in doubt", "went on"
        );
        for ((victim, phase), row) in &self.rows {
            println!(
                "{victim:<14} {phase:<12} {:>6} {:>12} {:>9} {:>8}",
                row.blows, row.interrupted, row.in_doubt, row.went_on
            );
        }
        for (reason, times) in &self.setbacks {
            println!("decided again after {reason}: {times} times");
        }
        for finding in &self.findings {
            println!("FOUND: {finding}");
        }
        println!(
            "{}",
            serde_json::json!({
                "kills": self.kills(),
                "moved_by_itself": self.moved_by_itself,
                "bites_lost": self.bites_lost,
                "bites_repeated": self.bites_repeated,
                "disagreements": self.disagreements,
                "link_cuts": self.blows(is_link),
                "procedures": self.procedures,
                "seed": seed,
                "wall_s": wall_s.round(),
            })
        );
    }
}

fn is_link(victim: &str) -> bool {
    victim == "arm links" || victim == "CAN bus"
}
