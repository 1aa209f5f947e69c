//! The one physical truth: arms, drives, jaw, knee and referee in step with each other.
//!
//! Pure: a tick is 8 ms of the cell, and the same inputs give the same account.

pub mod axes;

use arthro_geometry::Rigid;
use arthro_geometry::frame::{Base, Flange, ForcepsBase};

use self::axes::{Axis, FORCEPS_FEED, FORCEPS_ROTATION, Mechanisms};
use crate::epos4::Mechanics;
use crate::jaw::{self, Jaw};
use crate::knee::{Knee, Volume};
use crate::referee::body::{ArmBody, ArmShape};
use crate::referee::{Place, Referee};
use crate::scenario::{Layout, Scenario};

/// One tick of both arm controllers, s.
pub const TICK_S: f64 = 0.008;
/// Drives that turn are taken through a tick in steps of 1 ms; while all stand, in one.
const DRIVE_STEPS: u32 = 8;

/// Radius of both shafts, mm.
const SHAFT_RADIUS_MM: f64 = 1.75;

/// Everything between the wires.
#[derive(Clone, Debug)]
pub struct Cell {
    ticks: u64,
    layout: Layout,
    arms: [ArmShape; 2],
    forceps_base_from_flange: Rigid<ForcepsBase, Flange>,
    knee: Knee,
    jaw: Jaw,
    referee: Referee,
    mechanisms: Mechanisms,
    shafts_qc: [f64; 4],
    drives_turn: bool,
}

/// What the referee says at one moment.
#[derive(Clone, Debug)]
pub struct Account {
    /// The cell's clock.
    pub time_s: f64,
    /// Contacts, shafts and the whereabouts of the tissue.
    pub referee: Referee,
    /// The tissue as it is.
    pub knee: Knee,
    /// What the jaw holds.
    pub held: Volume,
}

impl Cell {
    /// A cell at rest. The true shafts of the drives stand at [`axes::start_qc`].
    pub fn new(scenario: &Scenario) -> Self {
        let layout = scenario.spec.layout.clone();
        let arthroscope_base = layout.forceps_base_from_arthroscope_base();
        let [forceps_tool, arthroscope_tool] = scenario.truth.mounted.flange_from_tools;
        let arm = |forceps_base_from_base, flange_from_tool, jaw_mm| ArmShape {
            forceps_base_from_base,
            flange_from_tool,
            shaft_radius_mm: SHAFT_RADIUS_MM,
            jaw_mm,
        };
        let half_jaw_mm = 0.5 * scenario.spec.jaw.length_mm;
        let arms: [ArmShape; 2] = [
            arm(Rigid::identity(), forceps_tool, half_jaw_mm),
            arm(
                Rigid::<ForcepsBase, Base>::from_isometry(*arthroscope_base.isometry()),
                arthroscope_tool,
                0.0,
            ),
        ];
        Self {
            ticks: 0,
            forceps_base_from_flange: arms[0]
                .at(&layout.start_joints_rad[0])
                .forceps_base_from_flange,
            arms,
            layout,
            knee: Knee::new(scenario),
            jaw: Jaw::new(&scenario.spec.jaw),
            referee: Referee::default(),
            mechanisms: Mechanisms::new(&Axis::ALL),
            shafts_qc: axes::start_qc(),
            drives_turn: false,
        }
    }

    /// The cell's clock, s.
    pub fn now_s(&self) -> f64 {
        self.ticks as f64 * TICK_S
    }

    /// Where the flange of the forceps arm truly is.
    pub fn forceps_base_from_flange(&self) -> Rigid<ForcepsBase, Flange> {
        self.forceps_base_from_flange
    }

    /// What the referee says now.
    pub fn account(&self) -> Account {
        Account {
            time_s: self.now_s(),
            referee: self.referee.clone(),
            knee: self.knee.clone(),
            held: self.jaw.held(),
        }
    }

    /// One tick. `joints_rad` are the true joints of both arms at its end, forceps first.
    /// `turn_drives` lets all drives turn for a step (duration, cell time at its end, what the
    /// mechanisms do to them) and returns where their true shafts are then, in quadcounts.
    pub fn tick(
        &mut self,
        joints_rad: &[[f64; 6]; 2],
        mut turn_drives: impl FnMut(f64, f64, &[Mechanics]) -> [f64; 4],
    ) {
        let start_s = self.now_s();
        self.ticks += 1;
        let bodies = [0, 1].map(|arm| self.arms[arm].at(&joints_rad[arm]));
        let rotation_rad = axes::rotation_rad(self.shafts_qc[FORCEPS_ROTATION]);
        let forceps_base_from_tool =
            bodies[0].forceps_base_from_flange * self.arms[0].flange_from_tool;
        self.forceps_base_from_flange = bodies[0].forceps_base_from_flange;
        let forceps_base_from_jaw = jaw::turned(forceps_base_from_tool, rotation_rad);
        let feed_mm = axes::feed_mm(self.shafts_qc[FORCEPS_FEED]);
        self.jaw.look(forceps_base_from_jaw, feed_mm, &self.knee);

        let before_qc = self.shafts_qc;
        let steps = if self.drives_turn { DRIVE_STEPS } else { 1 };
        let step_s = TICK_S / f64::from(steps);
        for step in 1..=steps {
            let feed_mm = axes::feed_mm(self.shafts_qc[FORCEPS_FEED]);
            let mechanics = self.mechanisms.act(&self.shafts_qc, self.jaw.load(feed_mm));
            let now_s = start_s + f64::from(step) * step_s;
            self.shafts_qc = turn_drives(step_s, now_s, &mechanics);
            let feed_mm = axes::feed_mm(self.shafts_qc[FORCEPS_FEED]);
            if let Some(event) = self
                .jaw
                .feed(feed_mm, forceps_base_from_jaw, &mut self.knee)
            {
                self.note(event, &bodies[0]);
            }
        }
        self.drives_turn = self.shafts_qc != before_qc;
        self.referee.tick(self.now_s(), &bodies, &self.knee);
    }

    fn note(&mut self, event: jaw::Event, forceps: &ArmBody) {
        let place = if self.layout.over_tray(&forceps.tip) {
            Place::Tray
        } else if self.knee.under_skin(&forceps.tip) {
            Place::Inside
        } else {
            Place::Elsewhere
        };
        tracing::info!(
            time_s = self.now_s(),
            ?event,
            ?place,
            "the jaw did something"
        );
        self.referee.jaw(event, place);
    }
}

#[cfg(test)]
mod tests;
