//! `arthro plan --scorecard`: the standard cases beside the paper's 39 bites on the same contour and beside what is asked
//! of them, on the phantom and on the menisci of a folder.

use std::path::{Path, PathBuf};

use arthro_geometry::stated::{Stated, Statements};
use arthro_geometry::surface_file;
use serde_json::{Value, json};

use super::files::Model;
use super::request::Asked;
use crate::arguments::{Plan, ScenarioName};
use crate::commands::{self, stated};
use crate::exit::Failure;
use crate::output::Output;

mod row;
mod search;
mod table;

use row::Row;

const SCENARIOS: [(&str, ScenarioName); 2] =
    [("tear", ScenarioName::Tear), ("band", ScenarioName::Band)];

/// Runs the command to its end.
pub fn run(arguments: &Plan, output: &Output) -> Result<(), Failure> {
    let paths = match &arguments.data {
        Some(folder) => menisci(folder)?,
        None => Vec::new(),
    };
    output.line(table::HEAD);
    let mut value = phantom(arguments, output);
    let stated = stated(arguments.stated);
    let rows = paths.iter().flat_map(|path| {
        let model = read(path, stated, output);
        SCENARIOS.map(|(word, name)| meniscus(path, (word, name), &model, arguments, output))
    });
    value["menisci"] = rows.collect();
    output.result(&value);
    Ok(())
}

/// Both cases on the phantom, and the paper's search.
fn phantom(arguments: &Plan, output: &Output) -> Value {
    let mut value = json!({"paper": {}});
    for (word, name) in SCENARIOS {
        let asked = Asked::standard(name, Model::phantom(), arguments);
        let case = Case::of(asked, Warming::Once, arguments.deadline_s);
        case.print(&format!("phantom {word}"), Some(name), output);
        value[word] = row::describe(&case.ours);
        value["paper"][word] = row::describe(&case.paper);
        if name == ScenarioName::Band {
            value["paper"]["search"] = match case.asked.and_then(|asked| search::run(&asked)) {
                Ok(found) => {
                    output.line(found.line());
                    found.json()
                }
                Err(failure) => row::refused(&failure),
            };
        }
    }
    value
}

/// A case on a meniscus from a file, as one entry of the list.
fn meniscus(
    path: &Path,
    (word, name): (&str, ScenarioName),
    model: &Result<Model, Failure>,
    arguments: &Plan,
    output: &Output,
) -> Value {
    let asked = match model {
        Ok(model) => Asked::standard(name, model.clone(), arguments),
        Err(failure) => Err(row::again(failure)),
    };
    let case = Case::of(asked, Warming::None, arguments.deadline_s);
    let file = path
        .file_name()
        .unwrap_or(path.as_os_str())
        .to_string_lossy();
    let stem = path
        .file_stem()
        .unwrap_or(path.as_os_str())
        .to_string_lossy();
    case.print(&format!("{stem} {word}"), None, output);
    let mut value = row::describe(&case.ours);
    value["file"] = json!(file);
    value["scenario"] = json!(word);
    value["paper"] = row::describe(&case.paper);
    value
}

/// Reads a meniscus. One that states neither axes nor unit is taken as it stands, in mm: its case is put on its own
/// shape, which no turn changes. The planner refuses what has not the size of a meniscus.
fn read(path: &Path, given: Option<Stated>, output: &Output) -> Result<Model, Failure> {
    let bytes = commands::read(path)?;
    let surface = surface_file::read_as_it_stands(path, &bytes)
        .map_err(|error| commands::unreadable(path, &error))?;
    if given.is_some() || surface.statements != Statements::default() {
        return Model::of_file(path, given);
    }
    output.note(format!(
        "{} states neither axes nor unit; taken are LPS and mm",
        path.display()
    ));
    Model::of_file(path, Some(Stated::LPS_MM))
}

/// Whether the planner runs once before its time is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Warming {
    None,
    Once,
}

/// A case, our plan and the paper's.
struct Case {
    asked: Result<Asked, Failure>,
    ours: Result<Row, Failure>,
    paper: Result<Row, Failure>,
}

impl Case {
    fn of(asked: Result<Asked, Failure>, warming: Warming, deadline_s: Option<f64>) -> Self {
        let with = |make: &dyn Fn(&Asked) -> Result<Row, Failure>| match &asked {
            Ok(asked) => make(asked),
            Err(failure) => Err(row::again(failure)),
        };
        if warming == Warming::Once {
            // What it says is told by the run that counts.
            with(&|asked| row::planned(asked, deadline_s)).ok();
        }
        let ours = with(&|asked| row::planned(asked, deadline_s));
        let paper = with(&row::paper);
        Self { asked, ours, paper }
    }

    fn print(&self, title: &str, limits: Option<ScenarioName>, output: &Output) {
        output.line(table::line(&format!("{title}, ours"), &self.ours));
        output.line(table::line(&format!("{title}, paper"), &self.paper));
        if let Some(name) = limits {
            output.line(table::limits(&format!("{title}, asked"), name));
        }
    }
}

/// The surfaces of a folder in the order of their names.
fn menisci(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let inner = folder.join("menisci");
    let folder = if inner.is_dir() { &inner } else { folder };
    let unreadable = |error: std::io::Error| {
        Failure::refused("FILE_UNREADABLE", format!("{}: {error}", folder.display()))
    };
    let mut paths: Vec<PathBuf> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let ending = path.extension();
        if ending.is_some_and(|ending| ending.eq_ignore_ascii_case("ply")) {
            paths.push(path);
        }
    }
    if paths.is_empty() {
        let problem = format!("{} has no .ply file", folder.display());
        return Err(Failure::refused("NO_CASES", problem));
    }
    paths.sort();
    Ok(paths)
}
