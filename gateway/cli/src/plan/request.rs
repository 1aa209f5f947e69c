//! What is asked of the planner, and its answer: the one place that knows the planner's own request.

use std::ops::ControlFlow;

use arthro_geometry::Point3;
use arthro_planning::jaw::{Bite, Jaw};
use arthro_planning::lesion::Lesion;
use arthro_planning::plan::{self, Progress, Request};
use arthro_planning::reference::{Ends, Reference};
use arthro_planning::rrt::Search;

use super::files::{self, Model};
use super::scenario::{self, Marked};
use super::site::Site;
use crate::arguments::{Plan, Region, ScenarioName, StatedSpace};
use crate::bites_file::{BitesFile, LesionPoints, ListedBite};
use crate::exit::Failure;

/// The jaw if nobody says its size.
pub const JAW: Jaw = Jaw {
    width_mm: 3.0,
    length_mm: 4.5,
};
/// How far a point may be from tissue, mm.
const TOLERANCE_MM: f64 = 1.0;
/// Distance between the points of a contour, mm.
const CONTOUR_SPACING_MM: f64 = 0.5;

/// What is to be planned; all points in ct, mm.
#[derive(Clone, Debug)]
pub struct Asked {
    pub model: Model,
    pub portals: Vec<Point3>,
    pub marked: Marked,
    pub jaw: Jaw,
    pub rim_min_mm: f64,
    pub voxel_mm: f64,
    pub seed: u64,
}

impl Asked {
    /// What the command line asks.
    pub fn read(arguments: &Plan, model: Model) -> Result<Self, Failure> {
        let region = &arguments.region;
        let portals = portals(region, &model)?;
        if region.contour.is_some() {
            return Err(Failure::refused(
                "CONTOUR_NOT_TAKEN",
                "--contour: the planner draws its own contour; give --start and --goal",
            ));
        }
        let marked = match (region.scenario, arguments.start, arguments.goal) {
            (Some(name), ..) => scenario::marked(name, &model, &portals[0], region.voxel_mm)?,
            (None, Some(start), Some(goal)) => Marked {
                start,
                goal,
                target_box: arguments
                    .target_box
                    .or_else(|| scenario::box_around(&model.mesh))
                    .ok_or(arthro_planning::Error::Surface(
                        arthro_geometry::volume::Error::Empty,
                    ))?,
                lesion: read_lesion(region, arguments.stated)?,
            },
            (None, ..) => {
                return Err(Failure::refused(
                    "REGION_NOT_GIVEN",
                    "nothing says what to remove; give --start and --goal, or --scenario",
                ));
            }
        };
        Ok(Self {
            model,
            portals,
            marked,
            jaw: region.jaw.unwrap_or(JAW),
            rim_min_mm: arguments.rim_min_mm,
            voxel_mm: region.voxel_mm,
            seed: arguments.seed,
        })
    }

    /// A standard case through the anterolateral portal, as the command line has it otherwise.
    pub fn standard(name: ScenarioName, model: Model, arguments: &Plan) -> Result<Self, Failure> {
        let portal = scenario::anterolateral(&model)?;
        let voxel_mm = arguments.region.voxel_mm;
        Ok(Self {
            marked: scenario::marked(name, &model, &portal, voxel_mm)?,
            model,
            portals: vec![portal],
            jaw: arguments.region.jaw.unwrap_or(JAW),
            rim_min_mm: arguments.rim_min_mm,
            voxel_mm,
            seed: arguments.seed,
        })
    }

    /// Plans the bites; `watch` hears the stage and the share done, and may end the work.
    pub fn plan(
        &self,
        mut watch: impl FnMut(&str, f64) -> ControlFlow<()>,
    ) -> Result<BitesFile, Failure> {
        let [portal] = self.portals.as_slice() else {
            let problem = format!(
                "--portal is given {} times; the planner takes 1",
                self.portals.len()
            );
            return Err(Failure::refused("TOO_MANY_PORTALS", problem));
        };
        let marked = &self.marked;
        let lesion = marked.lesion.clone().unwrap_or_default();
        let request = Request {
            model: self.model.mesh.clone(),
            lesion: lesion.points,
            lesion_spacing_mm: lesion.spacing_mm,
            start: marked.start,
            goal: marked.goal,
            target_box: marked.target_box,
            portal: *portal,
            jaw: self.jaw,
            voxel_mm: self.voxel_mm,
            rim_min_mm: self.rim_min_mm,
            search: Search {
                step_mm: 1.0,
                tolerance_mm: TOLERANCE_MM,
                cost_limit_per_mm: 0.4,
                max_iterations: 100_000,
                seed: self.seed,
            },
        };
        let plan = plan::plan(&request, &mut |progress: Progress| {
            watch(progress.stage, progress.fraction)
        })?;
        Ok(BitesFile {
            bites: plan.bites.iter().map(listed).collect(),
            ..self.list(plan.contour)
        })
    }

    /// The contour that is aimed at, without any bites.
    pub fn contour(&self) -> Result<Vec<Point3>, Failure> {
        let site = Site::of(&self.model.mesh, &self.portals[0], self.voxel_mm)?;
        let (crescent, voxels) = (&site.crescent, &site.voxels);
        let marked = &self.marked;
        let lesion = match &marked.lesion {
            Some(lesion) => {
                let (points, spacing_mm) = (&lesion.points, lesion.spacing_mm);
                Some(Lesion::of(
                    points,
                    spacing_mm,
                    crescent,
                    voxels,
                    TOLERANCE_MM,
                )?)
            }
            None => None,
        };
        let meniscal_from_ct = crescent.ct_from_meniscal.inverse();
        let ends = Ends {
            start: meniscal_from_ct * marked.start,
            goal: meniscal_from_ct * marked.goal,
            tolerance_mm: TOLERANCE_MM,
            rim_min_mm: self.rim_min_mm,
        };
        let reference = Reference::draw(&ends, lesion.as_ref(), crescent, voxels)?;
        let points = reference
            .spline
            .points_every(CONTOUR_SPACING_MM)
            .into_iter();
        Ok(points
            .map(|point| crescent.ct_from_meniscal * point)
            .collect())
    }

    /// A list without bites that aims at `contour`.
    pub fn list(&self, contour: Vec<Point3>) -> BitesFile {
        BitesFile {
            jaw: Some(self.jaw),
            portals: self.portals.clone(),
            contour,
            lesion: self.marked.lesion.clone(),
            bites: Vec::new(),
        }
    }
}

/// The portals that are given; at least one.
pub fn portals(region: &Region, model: &Model) -> Result<Vec<Point3>, Failure> {
    if !region.portal.is_empty() {
        return Ok(region.portal.clone());
    }
    let is_known = model.source == files::Source::Phantom || region.scenario.is_some();
    if !is_known {
        return Err(Failure::refused(
            "PORTAL_NOT_GIVEN",
            "a surface does not say where the forceps enter; give --portal",
        ));
    }
    Ok(vec![scenario::anterolateral(model)?])
}

/// The damaged tissue, if a file is given.
pub fn read_lesion(region: &Region, given: StatedSpace) -> Result<Option<LesionPoints>, Failure> {
    let Some(path) = &region.lesion else {
        return Ok(None);
    };
    Ok(Some(LesionPoints {
        spacing_mm: region.lesion_spacing_mm,
        points: files::read_lesion(path, given)?,
    }))
}

fn listed(bite: &Bite) -> ListedBite {
    ListedBite {
        center: bite.center,
        long_axis: bite.approach,
        opening: Some(bite.opening),
        portal: Some(0),
    }
}

impl From<arthro_planning::Error> for Failure {
    fn from(error: arthro_planning::Error) -> Self {
        tonic::Status::from(error).into()
    }
}
