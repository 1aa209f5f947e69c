//! `arthro bench registration FOLDER`: every case of a folder by both methods, held to its known truth.
//!
//! The scale is given three ways: not at all, within ten percent (the truth somewhere in the range, not in its middle),
//! and as known. A case is solved when rotation, centroid and scale are near the truth; the program's own verdict is
//! then held against that.

use std::time::Instant;

use arthro_geometry::{Rotation, Similarity, Vector3};
use arthro_registration::budget::Budget;
use arthro_registration::input::options_violations;
use arthro_registration::pipeline::{Method, Options, register};
use arthro_registration::problem::Problem;
use arthro_registration::robust;
use arthro_registration::scale::ScaleRange;
use serde_json::json;

use crate::arguments::BenchRegistration;
use crate::exit::Failure;
use crate::output::Output;

pub mod budget;
mod cases;
pub mod cell;
mod score;

use cases::Case;
use score::{Judged, Outcome, Row};

/// Scales tried when nothing is known.
const FREE: ScaleRange = ScaleRange {
    low: 0.3,
    high: 3.5,
};
/// Half the width of a rough prior, as a fraction.
const ROUGH: f64 = 0.1;

/// What is told of the scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Told {
    Nothing,
    Roughly,
    Exactly,
}

/// The columns of the table.
const COLUMNS: [(&str, Work, Told); 5] = [
    ("paper, free", Work::Register(Method::Paper), Told::Nothing),
    ("scale free", Work::Register(Method::Robust), Told::Nothing),
    (
        "scale +-10 %",
        Work::Register(Method::Robust),
        Told::Roughly,
    ),
    ("scale known", Work::Register(Method::Robust), Told::Exactly),
    ("fine alone", Work::Refine, Told::Roughly),
];

/// What is done with a case.
#[derive(Clone, Copy, Debug)]
enum Work {
    /// The whole registration.
    Register(Method),
    /// The fine stage, from a pose that is off by [`START_OFF`]; the model and the view are ready before.
    Refine,
}

/// How far the fine stage starts from the truth: degrees, mm of the source, and the logarithm of scale.
const START_OFF: (f64, f64, f64) = (5.0, 3.0, 0.05);

/// Runs the benchmark to its end.
pub async fn run(arguments: BenchRegistration, output: &Output) -> Result<(), Failure> {
    let mut cases = cases::read_all(&arguments.folder)?;
    if let Some(only) = &arguments.only {
        cases.retain(|case| case.name.contains(only.as_str()));
    }
    if cases.is_empty() {
        return Err(Failure::refused(
            "NO_CASES",
            format!("{} has no case of that name", arguments.folder.display()),
        ));
    }
    let bar = output.progress("registering", (cases.len() * COLUMNS.len()) as u64);
    let each = arguments.each;
    let advance = bar.clone();
    let computed = tokio::task::spawn_blocking(move || {
        let mut rows: Vec<Row> = Vec::new();
        let mut lines = Vec::new();
        for (column, (title, work, told)) in COLUMNS.into_iter().enumerate() {
            for (index, case) in cases.iter().enumerate() {
                let outcome = match work {
                    Work::Register(method) => solve(case, method, told, index)?,
                    Work::Refine => refine(case, index)?,
                };
                if each {
                    lines.push(format!("{title:<13} {}", outcome.line(&case.name)));
                }
                score::add(&mut rows, &case.level, column, COLUMNS.len(), outcome);
                advance.inc(1);
            }
        }
        Ok::<_, Failure>((rows, lines))
    });
    let (rows, lines) = computed
        .await
        .map_err(|error| Failure::failed("COMPUTATION_FAILED", error))??;
    bar.finish_and_clear();
    lines.iter().for_each(|line| output.line(line));
    let titles = COLUMNS.map(|(title, ..)| title);
    output.line(score::table(&titles, &rows));
    output.result(&json!({"columns": titles, "levels": score::json(&rows)}));
    Ok(())
}

fn solve(case: &Case, method: Method, told: Told, index: usize) -> Result<Outcome, Failure> {
    let scale = case.truth.scale;
    let options = Options {
        method,
        scale: match told {
            Told::Nothing => FREE,
            Told::Roughly => ScaleRange::around(scale * off_middle(index), ROUGH),
            Told::Exactly => ScaleRange::known(scale),
        },
        viewpoint: case.viewpoint,
        ..Options::default()
    };
    if let Some(violation) = options_violations(&options).into_iter().next() {
        let message = format!(
            "{}: {} {}",
            case.name, violation.field, violation.description
        );
        return Err(Failure::refused("CASE_INVALID", message));
    }
    let began = Instant::now();
    let answer = register(
        &case.source,
        &case.target,
        &options,
        &mut |_| {},
        &Budget::default(),
    );
    let seconds = began.elapsed().as_secs_f64();
    let judged = answer.ok().map(|answer| Judged {
        camera_from_ct: answer.camera_from_ct,
        tre_predicted_mm: answer.evidence.tre_predicted_mm,
        verdict: Some(answer.verdict),
    });
    Ok(Outcome::of(case, judged, seconds))
}

/// The fine stage from a start in a direction that depends on the case's number alone.
fn refine(case: &Case, index: usize) -> Result<Outcome, Failure> {
    let truth = case.truth;
    let problem = Problem::new(
        &case.source,
        &case.target,
        case.viewpoint,
        ScaleRange::around(truth.scale, 2.0 * ROUGH),
    );
    let (degrees, millimetres, log_scale) = START_OFF;
    let turn = Rotation::new(direction(index, 0) * degrees.to_radians());
    let sign = if index.is_multiple_of(2) { 1.0 } else { -1.0 };
    let scale = truth.scale * (sign * log_scale).exp();
    // About the middle of the source, so that each of the three is off by what is said and no more.
    let middle = truth * case.centroid + direction(index, 1) * (millimetres * truth.scale);
    let rotation = turn * truth.rotation;
    let start = Similarity::new(
        scale,
        rotation,
        middle.coords - rotation * case.centroid.coords * scale,
    );
    let start = problem.pose(&start);
    let began = Instant::now();
    let candidate = robust::refined_from(&problem, start, &Budget::default())?;
    let seconds = began.elapsed().as_secs_f64();
    let judged = Judged {
        camera_from_ct: problem.camera_from_ct(&candidate.pose),
        tre_predicted_mm: f64::NAN,
        verdict: None,
    };
    Ok(Outcome::of(case, Some(judged), seconds))
}

/// Directions spread evenly over the sphere (a Fibonacci lattice), another series for each `lane`.
fn direction(index: usize, lane: usize) -> Vector3 {
    let step = (index * 2 + lane) as f64;
    let z = 1.0 - 2.0 * (step * GOLDEN).fract();
    let angle = std::f64::consts::TAU * (step * PLASTIC).fract();
    let across = (1.0 - z * z).sqrt();
    Vector3::new(across * angle.cos(), across * angle.sin(), z)
}

/// Ratios whose multiples fill an interval, and a square, evenly.
const GOLDEN: f64 = 0.618_033_988_749_895;
const PLASTIC: f64 = 0.754_877_666_246_693;

/// Where the middle of a rough prior lies beside the truth, as a factor: spread evenly over what leaves the truth inside.
fn off_middle(index: usize) -> f64 {
    let share = (index as f64 * GOLDEN).fract();
    1.0 / (1.0 - 0.9 * ROUGH + 1.8 * ROUGH * share)
}
