//! Cases, procedures and steps as the tests write them.

use arthro_bootstrap::Role;
use arthro_gateway::approval::{Approval, Digest, Signatory};
use arthro_gateway::calibrations::record::Calibration;
use arthro_gateway::cases::case::{Acceptance, Case, ModelInfo, SceneInfo};
use arthro_gateway::journal::Page;
use arthro_gateway::procedure::steps::{BiteOutcome, Kind, Planned, Step, StepState};
use arthro_gateway::procedure::{Procedure, State};
use arthro_gateway::verification::{Touch, Verification};
use arthro_gateway::wire;
use arthro_geometry::Point3;
use arthro_proto::common::v1 as common;
use arthro_proto::registration::v1 as registration;
use prost::Message as _;

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
        acceptance: Some(Acceptance {
            by: "Dr. Adams".to_owned(),
            role: Role::Surgeon,
            at_ms: 1_700_000_000_124,
        }),
        verification: Some(Verification {
            basis: digest('d'),
            touches: vec![Touch {
                landmark: "notch".to_owned(),
                point: Point3::new(0.1, -2.0, 1e-9),
                expected: Point3::new(1.0 / 3.0, 0.0, 700.0),
                tip: Point3::new(0.5, 0.25, 700.0),
                operator: "operator".to_owned(),
                touched_at_ms: 1_700_000_000_125,
            }],
        }),
        approval: Some(Approval {
            surgeon: signatory("Dr. Adams"),
            second: Some(signatory("Dr. Brown")),
            digest: digest('c'),
        }),
        ..case(id)
    }
}

/// A tool tip that was measured in ten poses.
pub fn calibration(id: &str, saved_at_ms: i64) -> Calibration {
    let result = registration::SolveToolTipResponse {
        tip: Some(common::Point {
            x_mm: 0.1,
            y_mm: -0.2,
            z_mm: 450.0,
        }),
        tip_covariance_mm2: vec![0.01, 0.0, 0.0, 0.0, 0.02, 0.0, 0.0, 0.0, 0.03],
        residuals: vec![registration::CalibrationResidual::default(); 10],
        ..registration::SolveToolTipResponse::default()
    };
    Calibration {
        id: id.to_owned(),
        label: "forceps 3".to_owned(),
        saved_by: "engineer".to_owned(),
        saved_at_ms,
        valid_until_ms: saved_at_ms + 1,
        measured: wire::tool_tip(&result, "result").unwrap(),
        encoded: result.encode_to_vec().into(),
        revoked: None,
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

fn signatory(name: &str) -> Signatory {
    Signatory {
        name: name.to_owned(),
        role: "surgeon".to_owned(),
        at_ms: 7,
    }
}

/// A part of a list.
pub fn page(after: Option<&str>, limit: u32) -> Page {
    Page {
        after: after.map(str::to_owned),
        limit,
    }
}
