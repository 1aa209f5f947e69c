//! `arthro plan MODEL`: decides which bites leave a smooth crescent, in this process, from files.

use std::ops::ControlFlow;
use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::json;

use crate::arguments::{Pictures, Plan};
use crate::bites_file::BitesFile;
use crate::commands::show;
use crate::drawing;
use crate::exit::Failure;
use crate::output::Output;

pub mod files;
pub mod picture;
pub mod request;
pub mod scenario;
pub mod score;
mod scorecard;
pub mod site;

use files::Model;
use picture::Picture;
use request::Asked;
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
    let asked = Asked::read(&arguments, model)?;
    if arguments.region.portal.is_empty() && asked.model.source == files::Source::Surface {
        let [x, y, z] = <[f64; 3]>::from(asked.portals[0]);
        output.note(format!(
            "no portal is given; taken is that of a generic knee at {x:.1},{y:.1},{z:.1}"
        ));
    }
    let began = Instant::now();
    let until = arguments
        .deadline_s
        .map(|deadline_s| began + Duration::from_secs_f64(deadline_s));
    let bar = output.progress("planning", 100);
    let shown = bar.clone();
    let work = asked.clone();
    let computed = tokio::task::spawn_blocking(move || {
        work.plan(|stage, share| {
            shown.set_position((100.0 * share) as u64);
            shown.set_message(stage.to_owned());
            match until {
                Some(until) if Instant::now() >= until => ControlFlow::Break(()),
                _ => ControlFlow::Continue(()),
            }
        })
    });
    let planned = computed
        .await
        .map_err(|error| Failure::failed("COMPUTATION_FAILED", error))?;
    bar.finish_and_clear();
    // Nothing but the deadline ends the work early.
    let list = planned.map_err(|failure| match failure.reason.as_str() {
        "CANCELLED" => too_late(&arguments),
        _ => failure,
    })?;
    let seconds = began.elapsed().as_secs_f64();
    let score = Score::of(&asked.model.mesh, &list, asked.voxel_mm)?;
    if let Some(path) = &arguments.out {
        list.write(path)?;
    }
    let title = match arguments.region.scenario {
        Some(name) => format!("{}: {name:?}", asked.model.name).to_lowercase(),
        None => asked.model.name.clone(),
    };
    draw(
        &arguments.pictures,
        &title,
        &list,
        &score,
        Some(asked.rim_min_mm),
    )?;
    let mut value = score.json();
    value["seconds"] = json!(seconds);
    output.line(show::table(&value));
    output.result(&value);
    Ok(())
}

/// Draws what is asked for.
pub fn draw(
    pictures: &Pictures,
    name: &str,
    list: &BitesFile,
    score: &Score,
    rim_min_mm: Option<f64>,
) -> Result<(), Failure> {
    if pictures.svg.is_none() && pictures.png.is_none() {
        return Ok(());
    }
    let drawing = Picture {
        title: name,
        headline: &score.line(),
        site: &score.site,
        jaw: score.jaw,
        bites: &score.bites,
        contour: &list.contour,
        lesion: list.lesion.as_ref(),
        portals: &list.portals,
        measured: &[],
        rim_min_mm,
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

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    std::fs::write(path, bytes).map_err(|error| unwritable(path, &error))
}

fn unwritable(path: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::refused("FILE_UNWRITABLE", format!("{}: {error}", path.display()))
}

fn too_late(arguments: &Plan) -> Failure {
    let deadline_s = arguments.deadline_s.unwrap_or_default();
    Failure::refused(
        "DEADLINE_TOO_SHORT",
        format!("no plan within --deadline-s {deadline_s}"),
    )
}
