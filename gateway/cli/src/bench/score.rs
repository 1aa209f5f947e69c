//! Answers held to the truth, and the table of them.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::{Point3, Similarity};
use arthro_registration::gate::Verdict;
use serde_json::{Value, json};

use super::cases::Case;

/// A case is solved within these.
const ROTATION_DEG: f64 = 5.0;
const CENTROID_MM: f64 = 2.0;
const SCALE_PERCENT: f64 = 3.0;

/// An answer and what the program says of it.
#[derive(Debug)]
pub struct Judged {
    pub camera_from_ct: Similarity<Camera, Ct>,
    pub tre_predicted_mm: f64,
    /// `None` if it was not asked for one.
    pub verdict: Option<Verdict>,
}

/// How far an answer is from the truth; lengths in mm of the source.
#[derive(Clone, Debug)]
pub struct Outcome {
    rotation_deg: f64,
    centroid_mm: f64,
    scale_percent: f64,
    tre_mm: f64,
    tre_predicted_mm: f64,
    /// `None` if there was no answer at all, or none was asked for.
    verdict: Option<Verdict>,
    seconds: f64,
}

/// All outcomes of one level, a column each.
#[derive(Debug)]
pub struct Row {
    level: String,
    columns: Vec<Vec<Outcome>>,
}

// === impl Outcome ===

impl Outcome {
    /// Holds `answer` to the truth of `case`.
    pub fn of(case: &Case, answer: Option<Judged>, seconds: f64) -> Self {
        let Some(answer) = answer else {
            return Self {
                rotation_deg: f64::INFINITY,
                centroid_mm: f64::INFINITY,
                scale_percent: f64::INFINITY,
                tre_mm: f64::INFINITY,
                tre_predicted_mm: f64::INFINITY,
                verdict: None,
                seconds,
            };
        };
        let (found, truth) = (answer.camera_from_ct, case.truth);
        let off = |p: Point3| (found * p - truth * p).norm() / truth.scale;
        let squares: f64 = case.source.points.iter().map(|p| off(*p).powi(2)).sum();
        Self {
            rotation_deg: found.rotation.angle_to(&truth.rotation).to_degrees(),
            centroid_mm: off(case.centroid),
            scale_percent: (found.scale / truth.scale - 1.0).abs() * 100.0,
            tre_mm: (squares / case.source.points.len() as f64).sqrt(),
            tre_predicted_mm: answer.tre_predicted_mm,
            verdict: answer.verdict,
            seconds,
        }
    }

    fn is_solved(&self) -> bool {
        self.rotation_deg < ROTATION_DEG
            && self.centroid_mm < CENTROID_MM
            && self.scale_percent < SCALE_PERCENT
    }

    /// The outcome as a line.
    pub fn line(&self, name: &str) -> String {
        format!(
            "{name:<24} {:<7} {:>7.2} deg {:>6.2} mm {:>6.2} %  TRE {:>7.3} mm (predicted {:.3})  {:.3} s  {}",
            if self.is_solved() { "solved" } else { "FAILED" },
            self.rotation_deg,
            self.centroid_mm,
            self.scale_percent,
            self.tre_mm,
            self.tre_predicted_mm,
            self.seconds,
            self.verdict.map_or("no verdict", crate::register::word),
        )
    }
}

/// Puts an outcome into its row and column.
pub fn add(rows: &mut Vec<Row>, level: &str, column: usize, columns: usize, outcome: Outcome) {
    let index = rows
        .iter()
        .position(|row| row.level == level)
        .unwrap_or_else(|| {
            rows.push(Row {
                level: level.to_owned(),
                columns: vec![Vec::new(); columns],
            });
            rows.len() - 1
        });
    rows[index].columns[column].push(outcome);
}

/// Figures of one cell of the table.
struct Figures {
    solved: usize,
    cases: usize,
    tre_median_mm: f64,
    wrong_accepted: usize,
    solved_accepted: usize,
    solved_rejected: usize,
    seconds_median: f64,
    seconds_most: f64,
}

impl Figures {
    fn of(outcomes: &[Outcome]) -> Self {
        let count = |keep: &dyn Fn(&Outcome) -> bool| {
            outcomes.iter().filter(|outcome| keep(outcome)).count()
        };
        let solved = || outcomes.iter().filter(|outcome| outcome.is_solved());
        Self {
            solved: solved().count(),
            cases: outcomes.len(),
            tre_median_mm: median(solved().map(|outcome| outcome.tre_mm).collect()),
            wrong_accepted: count(&|o| !o.is_solved() && o.verdict == Some(Verdict::Accept)),
            solved_accepted: count(&|o| o.is_solved() && o.verdict == Some(Verdict::Accept)),
            solved_rejected: count(&|o| o.is_solved() && o.verdict == Some(Verdict::Reject)),
            seconds_median: median(outcomes.iter().map(|outcome| outcome.seconds).collect()),
            seconds_most: outcomes
                .iter()
                .map(|outcome| outcome.seconds)
                .fold(0.0, f64::max),
        }
    }
}

/// The middle value, the upper one of two; NaN of nothing.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// The table: a block of lines a level, a column a way of telling the scale.
pub fn table(titles: &[&str], rows: &[Row]) -> String {
    let mut lines = vec![line("", titles.iter().map(|title| (*title).to_owned()))];
    for row in rows {
        let figures: Vec<Figures> = row
            .columns
            .iter()
            .map(|outcomes| Figures::of(outcomes))
            .collect();
        let mut put = |title: &str, show: &dyn Fn(&Figures) -> String| {
            lines.push(line(
                &format!("{} {title}", row.level),
                figures.iter().map(show),
            ));
        };
        put("solved", &|f| format!("{}/{}", f.solved, f.cases));
        put("median TRE, solved", &|f| match f.solved {
            0 => "-".to_owned(),
            _ => format!("{:.3} mm", f.tre_median_mm),
        });
        put("wrong accepted", &|f| f.wrong_accepted.to_string());
        put("solved accepted", &|f| f.solved_accepted.to_string());
        put("solved rejected", &|f| f.solved_rejected.to_string());
        put("time median / most", &|f| {
            format!("{:.3} / {:.3} s", f.seconds_median, f.seconds_most)
        });
    }
    lines.join("\n")
}

fn line(title: &str, cells: impl Iterator<Item = String>) -> String {
    let cells: Vec<String> = cells.map(|cell| format!("{cell:>17}")).collect();
    format!("{title:<26}{}", cells.join(""))
}

/// The same for programs.
pub fn json(rows: &[Row]) -> Value {
    rows.iter()
        .map(|row| {
            let columns: Vec<Value> = row
                .columns
                .iter()
                .map(|outcomes| {
                    let f = Figures::of(outcomes);
                    json!({
                        "solved": f.solved,
                        "cases": f.cases,
                        "tre_median_mm": f.tre_median_mm,
                        "wrong_accepted": f.wrong_accepted,
                        "solved_accepted": f.solved_accepted,
                        "solved_rejected": f.solved_rejected,
                        "seconds_median": f.seconds_median,
                        "seconds_most": f.seconds_most,
                    })
                })
                .collect();
            json!({"level": row.level, "columns": columns})
        })
        .collect()
}
