//! The rows of the scorecard for people.

use super::row::Row;
use crate::arguments::ScenarioName;
use crate::exit::Failure;

pub const HEAD: &str = "                                          bites    bound  region %  lesion %  outside mm3  rim mm  scallop mm  blocked   robot s       s";

/// One row.
pub fn line(title: &str, row: &Result<Row, Failure>) -> String {
    let row = match row {
        Ok(row) => row,
        Err(failure) => return format!("{title:<40} {}: {}", failure.reason, failure.message),
    };
    let (score, evaluation) = (&row.score, &row.score.evaluation);
    let number = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
    };
    columns(
        title,
        &[
            evaluation.bites.to_string(),
            row.choice
                .map_or_else(|| "-".to_owned(), |choice| choice.bound.to_string()),
            number(score.region_percent(), 1),
            number(score.lesion_percent(), 1),
            number(score.outside_mm3(), 1),
            number(Some(evaluation.rim_min_mm), 2),
            number(evaluation.scallop.map(|scallop| scallop.rms_mm), 2),
            evaluation.infeasible.len().to_string(),
            number(Some(evaluation.predicted_seconds), 0),
            number(row.seconds, 2),
        ],
    )
}

/// What is asked of a case on the phantom.
pub fn limits(title: &str, name: ScenarioName) -> String {
    let words = match name {
        ScenarioName::Tear => [
            "<= 5", "-", ">= 95", "100", "<= 4.5", ">= 3", "-", "0", "-", "<= 0.2",
        ],
        ScenarioName::Band => [
            "<= 20", "-", ">= 95", "-", "<= 15", ">= 3.2", "-", "0", "-", "<= 1",
        ],
    };
    columns(title, &words.map(str::to_owned))
}

fn columns(title: &str, cells: &[String; 10]) -> String {
    let widths = [6, 8, 9, 9, 12, 7, 11, 8, 9, 7];
    let mut line = format!("{title:<40}");
    for (cell, width) in cells.iter().zip(widths) {
        line.push_str(&format!(" {cell:>width$}"));
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_ends_under_its_head() {
        let row = limits("phantom tear, asked", ScenarioName::Tear);
        assert_eq!(row.len(), HEAD.len());
        let limit = row.find("<= 4.5").unwrap() + "<= 4.5".len();
        assert!(HEAD[..limit].ends_with("outside mm3"));
    }
}
