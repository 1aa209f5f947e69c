//! Cases, procedures and steps as the tests write them.

use arthro_gateway::approval::{Approval, Digest};
use arthro_gateway::cases::case::{Case, ModelInfo, SceneInfo};
use arthro_gateway::procedure::steps::{BiteOutcome, Kind, Planned, Step, StepState};
use arthro_gateway::procedure::{Procedure, State};
use arthro_geometry::Point3;

pub fn digest(first: char) -> Digest {
    Digest::parse(&first.to_string().repeat(64)).unwrap()
}

pub fn case(id: &str) -> Case {
    Case::new(
        id.to_owned(),
        "left knee, 'second' look \u{1F9B5}".to_owned(),
        1_700_000_000_123,
    )
}

/// Everything that a case holds beside the services' own messages.
pub fn filled(id: &str) -> Case {
    Case {
        revision: 7,
        model: Some(ModelInfo {
            digest: digest('a'),
            lesion_spacing_mm: 0.1,
        }),
        scene: Some(SceneInfo {
            digest: digest('b'),
            point_count: u32::MAX,
            has_normals: true,
        }),
        accepted_by: Some("operator".to_owned()),
        approval: Some(Approval {
            surgeon: "Dr. Adams".to_owned(),
            digest: digest('c'),
        }),
        ..case(id)
    }
}

pub fn procedure(id: &str, case_id: &str) -> Procedure {
    Procedure {
        id: id.to_owned(),
        case_id: case_id.to_owned(),
        operator: "operator".to_owned(),
        state: State::Running,
        plan_digest: digest('c'),
        bites_planned: 3,
        next_bite: 0,
        bites_done: 0,
        step: None,
        reason: String::new(),
        detail: String::new(),
        started_at_ms: 1_700_000_000_456,
        ended_at_ms: None,
        robot_seconds: 0.0,
        rcm_deviation_max_mm: 0.0,
    }
}

pub fn step(sequence: u32, kind: Kind, bite: Option<u32>) -> Step {
    Step {
        sequence,
        planned: Planned { kind, bite },
        state: StepState::Intended,
        operation_id: format!("operation {sequence}"),
        intended_at_ms: 1_700_000_001_000 + i64::from(sequence),
        ended_at_ms: None,
        started_controller_s: 12.5,
        ended_controller_s: None,
        detail: String::new(),
    }
}

pub fn done(step: &Step) -> Step {
    Step {
        state: StepState::Done,
        ended_at_ms: Some(step.intended_at_ms + 1),
        ended_controller_s: Some(1.0 / 3.0),
        detail: "confirmed".to_owned(),
        ..step.clone()
    }
}

pub fn outcome(bite: u32) -> BiteOutcome {
    BiteOutcome {
        bite,
        tip: Point3::new(0.1, -2.0, 1e-9),
        jaw: "CLOSED_ON_TISSUE".to_owned(),
        peak_current_ma: 812.0,
    }
}
