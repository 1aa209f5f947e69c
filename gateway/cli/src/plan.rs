//! `arthro plan MODEL`: decides which bites leave a smooth crescent, in this process, from files.

use std::path::Path;

use arthro_planning::bites::Ended;
use arthro_planning::plan::{Choice, Progress};
use serde_json::{Value, json};

use crate::arguments::{Pictures, Plan};
use crate::bites_file::{BitesFile, ListedView};
use crate::commands::show;
use crate::drawing;
use crate::exit::{Failure, Kind};
use crate::output::Output;

pub mod files;
pub mod marks;
pub mod picture;
pub mod request;
pub mod scenario;
pub mod score;
mod scorecard;
pub mod site;

use files::Model;
use picture::Picture;
use request::{Answer, Asked, Deadline};
use score::Score;

/// Pixels of a PNG for a millimetre.
const PNG_PX_PER_MM: f64 = 20.0;

/// Runs the command to its end.
pub async fn run(arguments: Plan, output: &Output) -> Result<(), Failure> {
    if arguments.scorecard {
        return scorecard::run(&arguments, output);
    }
    let Some(path) = &arguments.model else {
        // The command line demands a model or the scorecard.
        return Ok(());
    };
    let model = Model::read(path, arguments.stated)?;
    let is_generic = arguments.region.portal.is_empty() && model.source == files::Source::Surface;
    let asked = Asked::read(&arguments, model)?;
    if is_generic {
        let [x, y, z] = <[f64; 3]>::from(asked.request.portals[0]);
        output.note(format!(
            "no portal is given; taken is that of a generic knee at {x:.1},{y:.1},{z:.1}"
        ));
    }
    let answer = answer(&asked, arguments.deadline_s, output).await?;
    let list = &answer.list;
    output.note(told(&answer));
    let score = Score::of(&asked.request.model, list, asked.request.voxel_mm)?;
    if let Some(path) = &arguments.out {
        list.write(path)?;
    }
    let title = match arguments.region.scenario {
        Some(name) => format!("{}: {}", asked.name, format!("{name:?}").to_lowercase()),
        None => asked.name.clone(),
    };
    let rim_min_mm = Some(asked.request.contour_rules.rim_min_mm);
    let headline = match answer.choice {
        Some(choice) if !choice.complete => {
            let left_mm3 = score.evaluation.left_mm3;
            format!("PARTIAL, {left_mm3:.1} mm3 left   {}", score.line())
        }
        _ => score.line(),
    };
    let page = Page {
        title: &title,
        headline: &headline,
        rim_min_mm,
    };
    page.draw(&arguments.pictures, list, &score)?;
    let mut value = score.json();
    value["seconds"] = json!(answer.seconds);
    value["choice"] = choice(answer.choice.as_ref());
    value["portals"] = json!(portals(list));
    if !list.views.is_empty() {
        value["views"] = list.views.iter().map(view).collect();
    }
    output.line(show::table(&value));
    output.result(&value);
    Ok(())
}

/// Plans while the terminal shows how far it is; an interruption ends the command at once.
async fn answer(
    asked: &Asked,
    deadline_s: Option<f64>,
    output: &Output,
) -> Result<Answer, Failure> {
    let bar = output.progress("planning", 100);
    let shown = bar.clone();
    let work = asked.clone();
    let deadline = Deadline::after(deadline_s);
    let computed = tokio::task::spawn_blocking(move || {
        work.plan(deadline, &mut |progress: Progress| {
            shown.set_position((100.0 * progress.fraction) as u64);
            shown.set_message(words(&progress));
        })
    });
    let answer = tokio::select! {
        computed = computed => computed.map_err(|error| Failure::failed("COMPUTATION_FAILED", error))?,
        _ = tokio::signal::ctrl_c() => {
            Err(Failure::new(Kind::Interrupted, "INTERRUPTED", "interrupted from the terminal"))
        }
    };
    bar.finish_and_clear();
    answer
}

/// The stage, and what there is by then.
fn words(progress: &Progress) -> String {
    let mut words = progress.stage.to_owned();
    if let Some(bites) = progress.incumbent {
        words.push_str(&format!(": {bites} bites so far"));
    }
    if let Some(bound) = progress.bound {
        words.push_str(&format!(", none with fewer than {bound}"));
    }
    words
}

/// What there is in the end.
fn told(answer: &Answer) -> String {
    let (bites, seconds) = (answer.list.bites.len(), answer.seconds);
    let Some(choice) = answer.choice else {
        return format!("{bites} bites on a path, {seconds:.2} s");
    };
    let why = match choice.ended {
        Ended::Optimal => "no fewer can do",
        Ended::Effort => "the search is used up",
        Ended::Deadline => "the time is up",
    };
    let partial = if choice.complete { "" } else { "PARTIAL: " };
    let bound = choice.bound;
    format!("{partial}{bites} bites, none with fewer than {bound}; {why}, {seconds:.2} s")
}

/// How good the choice is; null where none was made.
pub fn choice(choice: Option<&Choice>) -> Value {
    choice.map_or(Value::Null, |choice| {
        json!({
            "bound": choice.bound,
            "complete": choice.complete,
            "ended": ended(choice.ended),
        })
    })
}

/// Why a search ended, as one word.
pub fn ended(ended: Ended) -> &'static str {
    match ended {
        Ended::Optimal => "OPTIMAL",
        Ended::Effort => "EFFORT",
        Ended::Deadline => "DEADLINE",
    }
}

/// How many bites come through each portal.
fn portals(list: &BitesFile) -> Vec<usize> {
    let bites = |portal| {
        list.bites
            .iter()
            .filter(move |bite| bite.portal == Some(portal))
    };
    (0..list.portals.len())
        .map(|portal| bites(portal).count())
        .collect()
}

fn view(view: &ListedView) -> Value {
    json!({
        "tip_mm": view.tip.coords.as_slice(),
        "roll_deg": view.roll_rad.to_degrees(),
        "depth_mm": view.depth_mm,
        "distance_mm": view.distance_mm,
        "occluded_percent": view.occluded_percent,
    })
}

/// The words around a picture.
pub struct Page<'a> {
    /// What people call the meniscus.
    pub title: &'a str,
    /// The score in one line.
    pub headline: &'a str,
    /// The rim that must be left, if there is a limit, mm.
    pub rim_min_mm: Option<f64>,
}

impl Page<'_> {
    /// Draws what is asked for.
    pub fn draw(
        &self,
        pictures: &Pictures,
        list: &BitesFile,
        score: &Score,
    ) -> Result<(), Failure> {
        if pictures.svg.is_none() && pictures.png.is_none() {
            return Ok(());
        }
        let through: Vec<Option<usize>> = list.bites.iter().map(|bite| bite.portal).collect();
        let drawing = Picture {
            title: self.title,
            headline: self.headline,
            site: &score.site,
            jaw: score.jaw,
            bites: &score.bites,
            through: &through,
            contour: &list.contour,
            lesion: list.lesion.as_ref(),
            portals: &list.portals,
            measured: &[],
            rim_min_mm: self.rim_min_mm,
        }
        .draw();
        if let Some(path) = &pictures.svg {
            write(path, drawing::svg(&drawing).as_bytes())?;
        }
        if let Some(path) = &pictures.png {
            let png =
                drawing::png(&drawing, PNG_PX_PER_MM).map_err(|error| unwritable(path, &error))?;
            write(path, &png)?;
        }
        Ok(())
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    std::fs::write(path, bytes).map_err(|error| unwritable(path, &error))
}

fn unwritable(path: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::refused("FILE_UNWRITABLE", format!("{}: {error}", path.display()))
}
