//! Whether an answer has the shape that a page shows: the same fields of the same types, and the same words in capitals. Other texts and
//! numbers are those of another day. A line `...` stands for whatever is left out.

use serde_json::Value;

const LEFT_OUT: &str = "...";
/// Where a procedure stands while it goes on is a matter of the moment.
const GOING_ON: [&str; 2] = ["PROCEDURE_STATE_RUNNING", "PROCEDURE_STATE_PAUSED"];

/// The first difference, as a sentence.
pub fn differs(shown: &str, told: &str) -> Option<String> {
    let left_out = shown.lines().any(|line| line.trim() == LEFT_OUT);
    let whole: Vec<&str> = shown
        .lines()
        .filter(|line| line.trim() != LEFT_OUT)
        .collect();
    let shown = whole.join("\n");
    if !shown.trim_start().starts_with('{') {
        let mut lines = told.lines();
        let missing = whole.iter().find(|line| {
            !lines
                .by_ref()
                .any(|told| told.trim_end() == line.trim_end())
        });
        return missing.map(|line| format!("the line {line:?} does not come"));
    }
    let (shown, told) = match (messages(&shown), messages(told)) {
        (Ok(shown), Ok(told)) => (shown, told),
        (Err(error), _) => return Some(format!("the page's answer is no JSON: {error}")),
        (_, Err(error)) => return Some(format!("the answer is no JSON: {error}")),
    };
    if !left_out && shown.len() != told.len() {
        return Some(format!(
            "{} messages instead of {}",
            told.len(),
            shown.len()
        ));
    }
    // Messages that are shown come in their order, others may come between.
    let mut told = told.iter();
    for message in &shown {
        let mut last = Some("it does not come".to_owned());
        for candidate in told.by_ref() {
            last = unlike(message, candidate, left_out, "");
            if last.is_none() || !left_out {
                break;
            }
        }
        if let Some(difference) = last {
            return Some(format!("{message}: {difference}"));
        }
    }
    None
}

fn messages(text: &str) -> Result<Vec<Value>, serde_json::Error> {
    serde_json::Deserializer::from_str(text)
        .into_iter()
        .collect()
}

fn unlike(shown: &Value, told: &Value, left_out: bool, at: &str) -> Option<String> {
    match (shown, told) {
        (Value::Object(shown), Value::Object(told)) => {
            let unknown = told.keys().find(|key| !shown.contains_key(*key));
            if let Some(key) = unknown.filter(|_| !left_out) {
                return Some(format!("{at}/{key} is not shown"));
            }
            shown.iter().find_map(|(key, value)| {
                let at = format!("{at}/{key}");
                match told.get(key) {
                    Some(told) => unlike(value, told, left_out, &at),
                    None => Some(format!("{at} is missing")),
                }
            })
        }
        (Value::Array(shown), Value::Array(told)) => {
            if shown.len() > told.len() || (!left_out && shown.len() < told.len()) {
                return Some(format!("{at} has {} entries", told.len()));
            }
            let pairs = shown.iter().zip(told);
            pairs
                .into_iter()
                .find_map(|(shown, told)| unlike(shown, told, left_out, at))
        }
        (Value::String(shown), Value::String(told)) => {
            let moment = |word: &String| GOING_ON.contains(&word.as_str());
            let other = is_word(shown) && shown != told && !(moment(shown) && moment(told));
            other.then(|| format!("{at} is {told} instead of {shown}"))
        }
        _ => {
            let same = std::mem::discriminant(shown) == std::mem::discriminant(told);
            (!same).then(|| format!("{at} is {told} instead of the like of {shown}"))
        }
    }
}

/// A stable word: capitals, digits and underscores.
fn is_word(text: &str) -> bool {
    text.chars().any(|c| c.is_ascii_uppercase())
        && text
            .chars()
            .all(|c| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_')
}
