//! The two tables of the machine as docs/procedure.md shows them: a diagram and a table each.

use std::fmt::Write as _;

use super::{Event, STEP_TRANSITIONS, StepEvent, TRANSITIONS, next, next_of_step};
use crate::procedure::State;
use crate::procedure::steps::{CYCLE, Effect, Kind, StepState};

/// Diagram and table of the procedure's states.
pub fn procedure() -> String {
    let mut text = String::from("```mermaid\nstateDiagram-v2\n    [*] --> RUNNING: START\n");
    for (from, event, to) in TRANSITIONS {
        // Writing to a string cannot fail.
        writeln!(text, "    {from} --> {to}: {event}").ok();
    }
    text.push_str("    COMPLETED --> [*]\n    ABORTED --> [*]\n```\n\n| event |");
    for state in State::ALL {
        write!(text, " {state} |").ok();
    }
    text.push_str("\n|---|");
    text.push_str(&"---|".repeat(State::ALL.len()));
    text.push('\n');
    for event in Event::ALL {
        write!(text, "| {event} |").ok();
        for state in State::ALL {
            match next(*state, *event) {
                Ok(to) => write!(text, " {to} |").ok(),
                Err(_) => write!(text, " refused |").ok(),
            };
        }
        text.push('\n');
    }
    text
}

/// Diagram and table of a step's states, and the effect class of each kind.
pub fn step() -> String {
    let mut text = String::from("```mermaid\nstateDiagram-v2\n    [*] --> INTENDED\n");
    for (from, event, effect, to) in STEP_TRANSITIONS {
        let of = effect.map_or(String::new(), |effect| format!(" ({effect})"));
        writeln!(text, "    {from} --> {to}: {event}{of}").ok();
    }
    text.push_str("```\n\n| event | effect |");
    for state in StepState::ALL {
        write!(text, " {state} |").ok();
    }
    text.push_str("\n|---|---|");
    text.push_str(&"---|".repeat(StepState::ALL.len()));
    text.push('\n');
    for event in StepEvent::ALL {
        for effect in Effect::ALL {
            write!(text, "| {event} | {effect} |").ok();
            for state in StepState::ALL {
                match next_of_step(*state, *event, *effect) {
                    Some(to) => write!(text, " {to} |").ok(),
                    None => write!(text, " - |").ok(),
                };
            }
            text.push('\n');
        }
    }
    text.push_str("\n| step | effect | in the cycle of a bite |\n|---|---|---|\n");
    for kind in Kind::ALL {
        let place = CYCLE.iter().position(|of_cycle| of_cycle == kind);
        let place = place.and_then(|place| u8::try_from(place).ok());
        let place = place.map_or(String::from("-"), |place| {
            format!("({})", char::from(b'a' + place))
        });
        writeln!(text, "| {kind} | {} | {place} |", kind.effect()).ok();
    }
    text
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    /// Set to write the drawings into the page instead of comparing them.
    const REWRITE: &str = "ARTHRO_WRITE_DOCS";

    /// The page with everything between the two marks of `name` replaced.
    fn replaced(page: &str, name: &str, drawing: &str) -> String {
        let begin = format!("<!-- {name}: drawn from the code -->\n");
        let end = format!("<!-- end of {name} -->");
        let (before, rest) = page.split_once(&begin).unwrap();
        let (_, after) = rest.split_once(&end).unwrap();
        format!("{before}{begin}\n{drawing}\n{end}{after}")
    }

    #[test]
    fn the_page_shows_the_tables_of_the_code() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/procedure.md");
        let page = std::fs::read_to_string(&path).unwrap();
        let drawn = replaced(&page, "procedure", &super::procedure());
        let drawn = replaced(&drawn, "step", &super::step());
        if std::env::var_os(REWRITE).is_some() {
            std::fs::write(&path, drawn).unwrap();
            return;
        }
        assert!(
            drawn == page,
            "docs/procedure.md is not what the code says; run this test with {REWRITE}=1"
        );
    }
}
