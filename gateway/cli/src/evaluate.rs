//! `arthro evaluate MODEL BITES.json`: scores a list of bites, wherever it was planned, as ours are scored.

use arthro_planning::jaw::Jaw;

use crate::arguments::Evaluate;
use crate::bites_file::BitesFile;
use crate::commands::show;
use crate::exit::Failure;
use crate::output::Output;
use crate::plan::Page;
use crate::plan::files::Model;
use crate::plan::marks::{self, Marked};
use crate::plan::request::{self, Asked};
use crate::plan::scenario::Marks;
use crate::plan::score::{self, Score};
use crate::plan::site::Site;

/// Runs the command to its end.
pub fn run(arguments: &Evaluate, output: &Output) -> Result<(), Failure> {
    let model = Model::read(&arguments.model, arguments.stated)?;
    let mut list = BitesFile::read(&arguments.bites, arguments.stated)?;
    aim(&mut list, arguments, &model)?;
    let score = Score::of(&model.mesh, &list, arguments.region.voxel_mm)?;
    let page = Page {
        title: &model.name,
        headline: &score.line(),
        rim_min_mm: None,
    };
    page.draw(&arguments.pictures, &list, &score)?;
    let value = score.json();
    output.line(show::table(&value));
    output.result(&value);
    Ok(())
}

/// Lets the flags count more than the file.
fn aim(list: &mut BitesFile, arguments: &Evaluate, model: &Model) -> Result<(), Failure> {
    let region = &arguments.region;
    if region.jaw.is_some() {
        let throat_mm = list.jaw.map(|jaw| jaw.throat_mm);
        let jaw = request::jaw(region.jaw)?;
        list.jaw = Some(Jaw {
            throat_mm: throat_mm.unwrap_or(jaw.throat_mm),
            ..jaw
        });
    }
    if !region.portal.is_empty() {
        list.portals = request::portals(region, model)?;
    }
    if let Some(marked) = Marked::read(region, arguments.stated)? {
        let above = score::above(&model.mesh, list);
        let site = Site::of(&model.mesh, &above, region.voxel_mm)?;
        list.lesion = Some(marked.on(&site)?);
    }
    if let Some(path) = &region.contour {
        list.contour = marks::read_contour(path, arguments.stated)?;
    }
    let Some(name) = region.scenario else {
        return Ok(());
    };
    if list.portals.is_empty() {
        list.portals = request::portals(region, model)?;
    }
    let (portals, voxel_mm) = (list.portals.clone(), region.voxel_mm);
    let marks = Marks::standard(name, model, &portals[0], voxel_mm)?;
    let asked = Asked::usual(model.clone(), portals, marks, voxel_mm);
    let (site, target) = asked.target()?;
    let aimed = asked.list(Asked::contour(&site, &target));
    (list.contour, list.lesion) = (aimed.contour, aimed.lesion);
    Ok(())
}
