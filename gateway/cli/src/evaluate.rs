//! `arthro evaluate MODEL BITES.json`: scores a list of bites, wherever it was planned, as ours are scored.

use crate::arguments::Evaluate;
use crate::bites_file::BitesFile;
use crate::commands::show;
use crate::exit::Failure;
use crate::output::Output;
use crate::plan::files::{self, Model};
use crate::plan::request::{self, Asked};
use crate::plan::score::Score;
use crate::plan::{draw, scenario};

/// Rim that the contour of a standard case must leave, mm.
const RIM_MIN_MM: f64 = 3.0;

/// Runs the command to its end.
pub fn run(arguments: &Evaluate, output: &Output) -> Result<(), Failure> {
    let model = Model::read(&arguments.model, arguments.stated)?;
    let mut list = BitesFile::read(&arguments.bites, arguments.stated)?;
    aim(&mut list, arguments, &model)?;
    let score = Score::of(&model.mesh, &list, arguments.region.voxel_mm)?;
    draw(&arguments.pictures, &model.name, &list, &score, None)?;
    let value = score.json();
    output.line(show::table(&value));
    output.result(&value);
    Ok(())
}

/// Lets the flags count more than the file.
fn aim(list: &mut BitesFile, arguments: &Evaluate, model: &Model) -> Result<(), Failure> {
    let region = &arguments.region;
    if let Some(jaw) = region.jaw {
        list.jaw = Some(jaw);
    }
    if !region.portal.is_empty() {
        list.portals.clone_from(&region.portal);
    }
    if let Some(lesion) = request::read_lesion(region, arguments.stated)? {
        list.lesion = Some(lesion);
    }
    if let Some(path) = &region.contour {
        list.contour = files::read_contour(path, arguments.stated)?;
    }
    let Some(name) = region.scenario else {
        return Ok(());
    };
    if list.portals.is_empty() {
        list.portals = request::portals(region, model)?;
    }
    let asked = Asked {
        marked: scenario::marked(name, model, &list.portals[0], region.voxel_mm)?,
        model: model.clone(),
        portals: list.portals.clone(),
        jaw: list.jaw.unwrap_or(request::JAW),
        rim_min_mm: RIM_MIN_MM,
        voxel_mm: region.voxel_mm,
        seed: 0,
    };
    list.contour = asked.contour()?;
    list.lesion = asked.marked.lesion;
    Ok(())
}
