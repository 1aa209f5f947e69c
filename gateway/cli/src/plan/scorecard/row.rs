//! One plan of the scorecard.

use arthro_geometry::Vector3;
use arthro_planning::jaw::Bite;
use arthro_planning::paper::{self, PAPERS_BITES};
use arthro_planning::plan::Choice;
use serde_json::{Value, json};

use crate::bites_file::{BitesFile, ListedBite};
use crate::exit::Failure;
use crate::plan::ended;
use crate::plan::request::{Asked, Deadline};
use crate::plan::score::Score;

/// A scored plan.
pub struct Row {
    pub score: Score,
    /// How good the choice is; `None` where none was made.
    pub choice: Option<Choice>,
    /// Wall time of the planner, s; `None` where none ran.
    pub seconds: Option<f64>,
}

/// Our plan.
pub fn planned(asked: &Asked, deadline_s: Option<f64>) -> Result<Row, Failure> {
    let answer = asked.plan(Deadline::after(deadline_s), &mut |_| {})?;
    let request = &asked.request;
    Ok(Row {
        score: Score::of(&request.model, &answer.list, request.voxel_mm)?,
        choice: answer.choice,
        seconds: Some(answer.seconds),
    })
}

/// The paper's bites: jaws with their middle on the contour at equal distances, along the shaft.
pub fn paper(asked: &Asked) -> Result<Row, Failure> {
    let (site, target) = asked.target()?;
    let request = &asked.request;
    let ct_from_meniscal = &site.crescent.ct_from_meniscal;
    let portal = ct_from_meniscal.inverse() * request.portals[0];
    let bites = paper::equally_spaced(&target.spline, PAPERS_BITES, &portal, &Vector3::z())?;
    let listed = |bite: &Bite| {
        let bite = bite.carried(ct_from_meniscal);
        ListedBite {
            center: bite.center,
            long_axis: bite.approach,
            opening: Some(bite.opening),
            portal: Some(0),
        }
    };
    let list = BitesFile {
        bites: bites.iter().map(listed).collect(),
        ..asked.list(Asked::contour(&site, &target))
    };
    Ok(Row {
        score: Score::of(&request.model, &list, request.voxel_mm)?,
        choice: None,
        seconds: None,
    })
}

/// A row for programs.
pub fn describe(row: &Result<Row, Failure>) -> Value {
    let Row {
        score,
        choice,
        seconds,
    } = match row {
        Ok(row) => row,
        Err(failure) => return refused(failure),
    };
    let evaluation = &score.evaluation;
    json!({
        "outcome": "planned",
        "detail": score.line(),
        "bites": evaluation.bites,
        "region_percent": score.region_percent(),
        "lesion_percent": score.lesion_percent(),
        "outside_mm3": score.outside_mm3(),
        "rim_min_mm": evaluation.rim_min_mm,
        "scallop_rms_mm": evaluation.scallop.map(|scallop| scallop.rms_mm),
        "predicted_seconds": evaluation.predicted_seconds,
        "order_feasible": evaluation.is_order_feasible(),
        "blocked": evaluation.infeasible.len(),
        "bound": choice.map(|choice| choice.bound),
        "gap": choice.map(|choice| evaluation.bites - choice.bound.min(evaluation.bites)),
        "ended": choice.map(|choice| ended(choice.ended)),
        "complete": choice.map(|choice| choice.complete),
        "seconds": seconds,
    })
}

/// A refusal for programs.
pub fn refused(failure: &Failure) -> Value {
    json!({"outcome": failure.reason, "detail": failure.message})
}

/// The same failure for another row.
pub fn again(failure: &Failure) -> Failure {
    Failure::new(
        failure.kind,
        failure.reason.clone(),
        failure.message.clone(),
    )
}
