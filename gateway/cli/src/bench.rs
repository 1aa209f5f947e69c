//! `arthro bench registration FOLDER`: every case of a folder by both methods, held to its known truth.
//!
//! The scale is given three ways: not at all, within ten percent (the truth somewhere in the range, not in its middle),
//! and as known. A case is solved when rotation, centroid and scale are near the truth; the program's own verdict is
//! then held against that.

use std::time::Instant;

use arthro_registration::budget::Budget;
use arthro_registration::input::options_violations;
use arthro_registration::pipeline::{Method, Options, register};
use arthro_registration::scale::ScaleRange;
use serde_json::json;

use crate::arguments::BenchRegistration;
use crate::exit::Failure;
use crate::output::Output;

mod cases;
mod score;

use cases::Case;
use score::{Outcome, Row};

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
const COLUMNS: [(&str, Method, Told); 4] = [
    ("paper, free", Method::Paper, Told::Nothing),
    ("scale free", Method::Robust, Told::Nothing),
    ("scale +-10 %", Method::Robust, Told::Roughly),
    ("scale known", Method::Robust, Told::Exactly),
];

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
        for (column, (title, method, told)) in COLUMNS.into_iter().enumerate() {
            for (index, case) in cases.iter().enumerate() {
                let outcome = solve(case, method, told, index)?;
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
    Ok(Outcome::of(case, answer.ok(), seconds))
}

/// Where the middle of a rough prior lies beside the truth, as a factor: spread evenly over what leaves the truth inside.
fn off_middle(index: usize) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let share = (index as f64 * GOLDEN).fract();
    1.0 / (1.0 - 0.9 * ROUGH + 1.8 * ROUGH * share)
}
