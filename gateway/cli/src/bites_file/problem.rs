//! Why a list of bites is not taken.

use std::path::Path;

use crate::exit::Failure;

/// What is wrong with a field.
#[derive(Debug, PartialEq)]
pub struct Problem {
    pub field: String,
    pub problem: String,
}

impl Problem {
    pub fn new(field: impl Into<String>, problem: impl Into<String>) -> Self {
        Self {
            field: field.into(),
            problem: problem.into(),
        }
    }

    /// JSON has no word for what is no number; some writers use it all the same.
    pub fn of_syntax(error: &serde_json::Error, bytes: &[u8]) -> Self {
        let text = String::from_utf8_lossy(bytes);
        let line = text
            .lines()
            .nth(error.line().saturating_sub(1))
            .unwrap_or_default();
        let before = line
            .get(..error.column().saturating_sub(1))
            .unwrap_or_default();
        let after = line.get(before.len()..).unwrap_or_default();
        let is_no_number = ["NaN", "Infinity", "nan", "inf"]
            .into_iter()
            .any(|word| after.starts_with(word));
        if !is_no_number {
            return Self::new("file", error.to_string());
        }
        let field = before.rsplit('"').nth(1).unwrap_or("file");
        Self::new(
            field,
            format!(
                "holds what is no number (line {} column {})",
                error.line(),
                error.column()
            ),
        )
    }

    /// The refusal of the file.
    pub fn of(self, path: &Path) -> Failure {
        let message = format!("{}: {} {}", path.display(), self.field, self.problem);
        let mut failure = Failure::refused("FILE_INVALID", message);
        failure.violations.push((self.field, self.problem));
        failure
    }
}
