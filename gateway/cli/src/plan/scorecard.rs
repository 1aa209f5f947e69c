//! `arthro plan --scorecard`: the standard cases beside the paper's 39 bites, on the phantom and on menisci of a folder.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

use arthro_geometry::Point3;
use arthro_geometry::stated::Stated;
use serde_json::{Value, json};

use super::files::Model;
use super::request::Asked;
use super::score::Score;
use crate::arguments::{Plan, ScenarioName};
use crate::bites_file::{BitesFile, ListedBite};
use crate::commands::stated;
use crate::exit::Failure;
use crate::output::Output;

/// Bites of the paper's experiment, each with its middle on the contour.
const PAPER_BITES: usize = 39;
const SCENARIOS: [(&str, ScenarioName); 2] =
    [("tear", ScenarioName::Tear), ("band", ScenarioName::Band)];

/// Runs the command to its end.
pub fn run(arguments: &Plan, output: &Output) -> Result<(), Failure> {
    let models = match &arguments.data {
        Some(folder) => models(folder, stated(arguments.stated))?,
        None => Vec::new(),
    };
    output.line(format!(
        "{:<40} {:>5} {:>8} {:>8} {:>12} {:>8} {:>9} {:>8}",
        "", "bites", "region %", "lesion %", "outside mm3", "rim mm", "blocked", "s"
    ));
    let phantom = Model::phantom();
    let mut value = both(&phantom, arguments, output);
    let menisci: Vec<Value> = models
        .iter()
        .map(|model| {
            let mut value = both(model, arguments, output);
            value["name"] = json!(model.name);
            value
        })
        .collect();
    value["menisci"] = json!(menisci);
    output.result(&value);
    Ok(())
}

/// Both cases on a model, ours and the paper's.
fn both(model: &Model, arguments: &Plan, output: &Output) -> Value {
    let mut value = json!({"paper": {}});
    for (word, name) in SCENARIOS {
        let asked = Asked::standard(name, model.clone(), arguments);
        let ours = asked.as_ref().map_err(again).and_then(planned);
        let theirs = asked.as_ref().map_err(again).and_then(paper);
        for (who, row) in [("ours", &ours), ("paper", &theirs)] {
            let title = format!("{} {word}, {who}", model.name);
            output.line(line(&title, row));
        }
        value[word] = describe(&ours);
        value["paper"][word] = describe(&theirs);
    }
    value
}

struct Row {
    score: Score,
    seconds: Option<f64>,
}

fn planned(asked: &Asked) -> Result<Row, Failure> {
    let began = Instant::now();
    let list = asked.plan(|_, _| ControlFlow::Continue(()))?;
    let seconds = Some(began.elapsed().as_secs_f64());
    let score = Score::of(&asked.model.mesh, &list, asked.voxel_mm)?;
    Ok(Row { score, seconds })
}

/// The paper's bites: jaws on the contour at equal distances, along the shaft.
fn paper(asked: &Asked) -> Result<Row, Failure> {
    // The paper knows no limit to the rim.
    let contour = Asked {
        rim_min_mm: 0.0,
        ..asked.clone()
    }
    .contour()?;
    let portal = asked.portals[0];
    let bites = spread(&contour, PAPER_BITES)
        .into_iter()
        .filter_map(|center| {
            Some(ListedBite {
                center,
                long_axis: (center - portal).try_normalize(1e-6)?,
                opening: None,
                portal: Some(0),
            })
        });
    let list = BitesFile {
        bites: bites.collect(),
        ..asked.list(contour)
    };
    let score = Score::of(&asked.model.mesh, &list, asked.voxel_mm)?;
    Ok(Row {
        score,
        seconds: None,
    })
}

/// `count` points at equal distances along a polyline, its ends among them.
fn spread(polyline: &[Point3], count: usize) -> Vec<Point3> {
    let length_mm: f64 = polyline
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).norm())
        .sum();
    let step_mm = length_mm / (count - 1) as f64;
    let mut points: Vec<Point3> = polyline.first().copied().into_iter().collect();
    let mut way_mm = 0.0;
    for pair in polyline.windows(2) {
        let piece_mm = (pair[1] - pair[0]).norm();
        while points.len() + 1 < count && points.len() as f64 * step_mm <= way_mm + piece_mm {
            let share = (points.len() as f64 * step_mm - way_mm) / piece_mm.max(f64::MIN_POSITIVE);
            points.push(pair[0] + (pair[1] - pair[0]) * share);
        }
        way_mm += piece_mm;
    }
    points.extend(polyline.last());
    points
}

fn describe(row: &Result<Row, Failure>) -> Value {
    match row {
        Ok(Row { score, seconds }) => json!({
            "bites": score.evaluation.bites,
            "region_percent": score.region_percent(),
            "lesion_percent": score.lesion_percent(),
            "outside_mm3": score.outside_mm3(),
            "rim_min_mm": score.evaluation.rim_min_mm,
            "order_feasible": score.blocked().is_empty(),
            "bound": Value::Null,
            "seconds": seconds,
        }),
        Err(failure) => json!({"refused": failure.reason, "message": failure.message}),
    }
}

fn line(title: &str, row: &Result<Row, Failure>) -> String {
    let Row { score, seconds } = match row {
        Ok(row) => row,
        Err(failure) => return format!("{title:<40} {}: {}", failure.reason, failure.message),
    };
    let number = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
    };
    format!(
        "{title:<40} {:>5} {:>8} {:>8} {:>12} {:>8.2} {:>9} {:>8}",
        score.evaluation.bites,
        number(score.region_percent(), 1),
        number(score.lesion_percent(), 1),
        number(score.outside_mm3(), 1),
        score.evaluation.rim_min_mm,
        score.blocked().len(),
        number(*seconds, 2)
    )
}

fn again(failure: &Failure) -> Failure {
    Failure::new(
        failure.kind,
        failure.reason.clone(),
        failure.message.clone(),
    )
}

/// The menisci of a folder in the order of their names.
fn models(folder: &Path, stated: Option<Stated>) -> Result<Vec<Model>, Failure> {
    let inner = folder.join("menisci");
    let folder = if inner.is_dir() { &inner } else { folder };
    let unreadable = |error: std::io::Error| {
        Failure::refused("FILE_UNREADABLE", format!("{}: {error}", folder.display()))
    };
    let mut paths: Vec<PathBuf> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path
            .extension()
            .is_some_and(|ending| ending.eq_ignore_ascii_case("ply"))
        {
            paths.push(path);
        }
    }
    if paths.is_empty() {
        return Err(Failure::refused(
            "NO_CASES",
            format!("{} has no .ply file", folder.display()),
        ));
    }
    paths.sort();
    paths
        .iter()
        .map(|path| Model::of_file(path, stated))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_spread_at_equal_distances_from_end_to_end() {
        let bent = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 1.0, 0.0]].map(Point3::from);
        let points = spread(&bent, 5);
        assert_eq!(points.len(), 5);
        assert_eq!((points[0], points[4]), (bent[0], bent[2]));
        assert!((points[3] - bent[1]).norm() < 1e-12);
    }
}
