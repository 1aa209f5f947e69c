//! Where a plan starts, ends and stays, as the file `targets.toml` in ct, mm.

use std::path::Path;

use arthro_geometry::Point3;
use arthro_simulator::scenario::Scenario;
use serde::{Deserialize, Serialize};

use crate::commands::{read, unreadable};
use crate::exit::Failure;

/// What the surgeon marks on the model.
#[derive(Clone, Copy, Debug)]
pub struct Targets {
    /// Where the new contour leaves the free edge.
    pub start: Point3,
    /// Where it meets it again.
    pub goal: Point3,
    /// Lowest and highest corner of the box that targets stay inside.
    pub target_box: (Point3, Point3),
}

/// What is said of where to cut; what is not is left to the planner.
#[derive(Clone, Copy, Debug, Default)]
pub struct Marks {
    /// Where the new contour leaves and meets the free edge.
    pub ends: Option<(Point3, Point3)>,
    /// Lowest and highest corner of the box that targets stay inside.
    pub target_box: Option<(Point3, Point3)>,
}

impl From<Targets> for Marks {
    fn from(targets: Targets) -> Self {
        Self {
            ends: Some((targets.start, targets.goal)),
            target_box: Some(targets.target_box),
        }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    start_mm: [f64; 3],
    goal_mm: [f64; 3],
    box_low_mm: [f64; 3],
    box_high_mm: [f64; 3],
}

impl Targets {
    /// Reads `path`.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let file: File =
            toml::from_slice(&read(path)?).map_err(|error| unreadable(path, &error))?;
        Ok(Self {
            start: file.start_mm.into(),
            goal: file.goal_mm.into(),
            target_box: (file.box_low_mm.into(), file.box_high_mm.into()),
        })
    }

    /// Writes `path`.
    pub fn write(&self, path: &Path) -> Result<(), Failure> {
        let file = File {
            start_mm: self.start.into(),
            goal_mm: self.goal.into(),
            box_low_mm: self.target_box.0.into(),
            box_high_mm: self.target_box.1.into(),
        };
        let text =
            toml::to_string(&file).map_err(|error| Failure::failed("TARGETS_UNWRITABLE", error))?;
        Ok(std::fs::write(path, text)?)
    }
}

impl Targets {
    /// What a scenario's surgeon marked.
    pub fn of(scenario: &Scenario) -> Self {
        let marked = &scenario.preoperative;
        Self {
            start: marked.start,
            goal: marked.goal,
            target_box: marked.target_box,
        }
    }
}
