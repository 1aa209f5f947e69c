//! What is asked of the planner, and its answer: the one place that knows the planner's own request.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use arthro_geometry::Point3;
use arthro_planning::Error;
use arthro_planning::bites::{Partial, Patience};
use arthro_planning::jaw::Jaw;
use arthro_planning::lesion::Lesion;
use arthro_planning::paper::{Cost, Search};
use arthro_planning::plan::{
    self, Arthroscope, Choice, Limits, Planned, Planner, Progress, Request,
};
use arthro_planning::reach::{self, Clearance, Knee, Popliteal, Shaft};
use arthro_planning::target::{Aim, Rules, Target};
use arthro_planning::view::{Optics, View};

use super::files::{self, Model};
use super::marks::{self, Marked};
use super::scenario::{self, Marks};
use super::site::Site;
use crate::arguments::{PaperCostName, Plan, PlannerName, Region, ScenarioName};
use crate::bites_file::{
    BitesFile, JAW_LENGTH_MM, JAW_WIDTH_MM, LesionPoints, ListedBite, ListedView, MAX_PORTALS,
};
use crate::commands::stated;
use crate::exit::Failure;

/// Width and length of the jaw if nobody says its size, mm.
const JAW_MM: [f64; 2] = [3.0, 4.5];
/// Coordinates of a CT, mm.
const COORDINATE_MM: std::ops::RangeInclusive<f64> = -10_000.0..=10_000.0;
/// Radius of the cell's forceps, mm.
const FORCEPS_RADIUS_MM: f64 = 1.75;
/// Distance between the points of a contour, mm.
const CONTOUR_SPACING_MM: f64 = 0.2;

/// What is to be planned; all points in ct, mm.
#[derive(Clone, Debug)]
pub struct Asked {
    /// What people call the meniscus.
    pub name: String,
    /// What the planner is asked.
    pub request: Request,
}

/// What the planner answered.
#[derive(Clone, Debug)]
pub struct Answer {
    /// The bites and what they aim at.
    pub list: BitesFile,
    /// How good the choice is, if one was made.
    pub choice: Option<Choice>,
    /// How much room the shaft has at each bite; empty if nothing is known of the joint.
    pub clearances: Vec<Clearance>,
    /// How long the planner took, s.
    pub seconds: f64,
}

/// Until when the planner may go on.
#[derive(Clone, Copy, Debug, Default)]
pub struct Deadline {
    /// `None`: there is no hurry.
    pub at: Option<Instant>,
}

impl Deadline {
    /// So many seconds from now.
    pub fn after(seconds: Option<f64>) -> Self {
        let from_now = |seconds| Instant::now() + Duration::from_secs_f64(seconds);
        Self {
            at: seconds.map(from_now),
        }
    }

    fn patience(self) -> Patience {
        match self.at {
            Some(at) if Instant::now() >= at => Patience::Hurry,
            _ => Patience::GoOn,
        }
    }
}

impl Asked {
    /// What the command line asks.
    pub fn read(arguments: &Plan, model: Model) -> Result<Self, Failure> {
        let region = &arguments.region;
        let portals = portals(region, &model)?;
        let marks = match region.scenario {
            Some(name) => Marks::standard(name, &model, &portals[0], region.voxel_mm)?,
            None => Marks {
                aim: aim(arguments)?,
                target_box: arguments.target_box,
                lesion: read_lesion(arguments, &model, &portals[0])?,
                rim_min_mm: Rules::default().rim_min_mm,
            },
        };
        let mut asked = Self::of(arguments, model, portals, marks)?;
        asked.request.planner = planner(arguments);
        asked.request.arthroscope = match arguments.arthroscope {
            None => None,
            Some(portal) => {
                check_place("--arthroscope", &portal)?;
                Some(Arthroscope {
                    portal,
                    optics: Optics::default(),
                    forceps_radius_mm: FORCEPS_RADIUS_MM,
                })
            }
        };
        asked.request.knee = knee(arguments, &asked.request.jaw)?;
        Ok(asked)
    }

    /// A standard case through the anterolateral portal, as the command line has it otherwise.
    pub fn standard(name: ScenarioName, model: Model, arguments: &Plan) -> Result<Self, Failure> {
        let portal = scenario::anterolateral(&model)?;
        let marks = Marks::standard(name, &model, &portal, arguments.region.voxel_mm)?;
        Self::of(arguments, model, vec![portal], marks)
    }

    /// What is marked on a model, with the usual limits.
    pub fn usual(model: Model, portals: Vec<Point3>, marks: Marks, voxel_mm: f64) -> Self {
        let lesion = marks.lesion.unwrap_or_default();
        let [width_mm, length_mm] = JAW_MM;
        let request = Request {
            model: model.mesh,
            lesion: lesion.points,
            lesion_spacing_mm: lesion.spacing_mm,
            aim: marks.aim,
            contour_rules: Rules {
                rim_min_mm: marks.rim_min_mm,
                ..Rules::default()
            },
            target_box: marks.target_box,
            portals,
            jaw: Jaw::new(width_mm, length_mm),
            voxel_mm,
            planner: Planner::Bites,
            limits: Limits::default(),
            effort: 1,
            knee: None,
            arthroscope: None,
            seed: 1,
        };
        Self {
            name: model.name,
            request,
        }
    }

    fn of(
        arguments: &Plan,
        model: Model,
        portals: Vec<Point3>,
        mut marks: Marks,
    ) -> Result<Self, Failure> {
        let (region, bites) = (&arguments.region, &arguments.bites);
        marks.rim_min_mm = arguments.rim_min_mm.unwrap_or(marks.rim_min_mm);
        let usual = Self::usual(model, portals, marks, region.voxel_mm);
        let limits = Limits {
            region_percent: bites.region_percent,
            outside_limit_mm3: bites.outside_limit_mm3,
            placement_error_mm: bites.placement_error_mm,
            partial: if bites.partial {
                Partial::Allow
            } else {
                Partial::Refuse
            },
            ..Limits::default()
        };
        Ok(Self {
            request: Request {
                jaw: jaw(region.jaw)?,
                limits,
                effort: bites.effort,
                seed: arguments.seed,
                ..usual.request
            },
            ..usual
        })
    }

    /// Plans the bites; `watch` hears of the progress.
    pub fn plan(
        &self,
        deadline: Deadline,
        watch: &mut dyn FnMut(Progress),
    ) -> Result<Answer, Failure> {
        let began = Instant::now();
        let plan = plan::plan(&self.request, &|| deadline.patience(), watch);
        let seconds = began.elapsed().as_secs_f64();
        let plan = plan.map_err(|error| match error {
            // Nothing but the deadline ends the work early.
            Error::Deadline | Error::Cancelled => {
                let message = format!("there was no plan yet after {seconds:.3} s");
                Failure::refused("DEADLINE", message)
            }
            error => error.into(),
        })?;
        let list = BitesFile {
            bites: plan.bites.iter().map(ListedBite::from).collect(),
            views: plan.views.iter().map(ListedView::from).collect(),
            ..self.list(plan.contour)
        };
        let rooms = plan.bites.iter().filter_map(|planned| planned.clearance);
        Ok(Answer {
            clearances: rooms.collect(),
            list,
            choice: plan.choice,
            seconds,
        })
    }

    /// The contour that is aimed at, whatever rim it leaves, and the place that it is drawn on.
    pub fn target(&self) -> Result<(Site, Target), Failure> {
        let request = &self.request;
        let site = Site::of(&request.model, &request.portals[0], request.voxel_mm)?;
        let (crescent, voxels) = (&site.crescent, &site.voxels);
        let rules = Rules {
            rim_min_mm: 0.0,
            ..request.contour_rules
        };
        let lesion = match request.lesion.as_slice() {
            [] => None,
            points => Some(Lesion::of(
                points,
                request.lesion_spacing_mm,
                crescent,
                voxels,
                rules.tolerance_mm,
            )?),
        };
        let aim = request.aim.carried(&crescent.ct_from_meniscal.inverse());
        let target = Target::draw(&aim, &rules, lesion.as_ref(), crescent, voxels)?;
        Ok((site, target))
    }

    /// The points of [`Asked::target`] in ct.
    pub fn contour(site: &Site, target: &Target) -> Vec<Point3> {
        let points = target.spline.points_every(CONTOUR_SPACING_MM).into_iter();
        points
            .map(|point| site.crescent.ct_from_meniscal * point)
            .collect()
    }

    /// A list without bites that aims at `contour`.
    pub fn list(&self, contour: Vec<Point3>) -> BitesFile {
        let request = &self.request;
        BitesFile {
            jaw: Some(request.jaw),
            portals: request.portals.clone(),
            contour,
            lesion: (!request.lesion.is_empty()).then(|| LesionPoints {
                spacing_mm: request.lesion_spacing_mm,
                points: request.lesion.clone(),
            }),
            ..BitesFile::default()
        }
    }
}

/// The portals that are given; at least one.
pub fn portals(region: &Region, model: &Model) -> Result<Vec<Point3>, Failure> {
    let count = region.portal.len();
    if count > MAX_PORTALS {
        let problem = format!("are {count}; must be at most {MAX_PORTALS}");
        return Err(invalid("--portal", problem));
    }
    for portal in &region.portal {
        check_place("--portal", portal)?;
    }
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

/// The jaw of this width and length; the usual one if nobody says them.
pub fn jaw(size_mm: Option<[f64; 2]>) -> Result<Jaw, Failure> {
    let [width_mm, length_mm] = size_mm.unwrap_or(JAW_MM);
    for (part, value, range) in [
        ("width", width_mm, JAW_WIDTH_MM),
        ("length", length_mm, JAW_LENGTH_MM),
    ] {
        if !range.contains(&value) {
            let (low, high) = (range.start(), range.end());
            let problem = format!("has a {part} of {value} mm; must be {low} .. {high}");
            return Err(invalid("--jaw", problem));
        }
    }
    Ok(Jaw::new(width_mm, length_mm))
}

fn aim(arguments: &Plan) -> Result<Aim, Failure> {
    if let Some(path) = &arguments.region.contour {
        let points = marks::read_contour(path, arguments.stated)?;
        return Ok(Aim::Curve { points });
    }
    let Some((start, goal)) = arguments.start.zip(arguments.goal) else {
        return Ok(Aim::Lesion);
    };
    check_place("--start", &start)?;
    check_place("--goal", &goal)?;
    Ok(Aim::Ends { start, goal })
}

fn read_lesion(
    arguments: &Plan,
    model: &Model,
    portal: &Point3,
) -> Result<Option<LesionPoints>, Failure> {
    let region = &arguments.region;
    let Some(marked) = Marked::read(region, arguments.stated)? else {
        return Ok(None);
    };
    let site = Site::of(&model.mesh, portal, region.voxel_mm)?;
    marked.on(&site).map(Some)
}

/// What is known of the joint.
fn knee(arguments: &Plan, jaw: &Jaw) -> Result<Option<Knee>, Failure> {
    let joint = &arguments.joint;
    let Some(opening_mm) = joint.opening_mm else {
        return Ok(None);
    };
    let bone = |path: &Option<PathBuf>| {
        let stated = stated(arguments.stated);
        let model = path.as_ref().map(|path| Model::of_file(path, stated));
        model.transpose().map(|model| model.map(|model| model.mesh))
    };
    Ok(Some(Knee {
        femur: bone(&joint.femur)?,
        tibia: bone(&joint.tibia)?,
        opening_mm,
        shaft: Shaft::forceps(jaw),
        limits: reach::Limits::default(),
        popliteal: Popliteal::default(),
    }))
}

fn planner(arguments: &Plan) -> Planner {
    let cost = match arguments.bites.paper_cost {
        PaperCostName::Corrected => Cost::Corrected,
        PaperCostName::AsPrinted => Cost::AsPrinted,
    };
    match arguments.bites.planner {
        PlannerName::Bites => Planner::Bites,
        PlannerName::Paper => Planner::Paper(papers_search(cost, arguments.seed)),
    }
}

/// The paper's search, with the limit that lets its printed cost pass.
pub fn papers_search(cost: Cost, seed: u64) -> Search {
    Search {
        cost,
        step_mm: 1.0,
        tolerance_mm: Rules::default().tolerance_mm,
        cost_limit_per_mm: 0.4,
        max_iterations: 100_000,
        seed,
    }
}

fn check_place(field: &str, point: &Point3) -> Result<(), Failure> {
    let is_place = |value: &f64| COORDINATE_MM.contains(value);
    if point.iter().all(is_place) {
        return Ok(());
    }
    let (low, high) = (COORDINATE_MM.start(), COORDINATE_MM.end());
    let [x, y, z] = <[f64; 3]>::from(*point);
    Err(invalid(
        field,
        format!("is {x},{y},{z}; each must be {low} .. {high} mm"),
    ))
}

fn invalid(field: &str, problem: String) -> Failure {
    let mut failure = Failure::refused("INVALID_ARGUMENT", format!("{field} {problem}"));
    failure.violations.push((field.to_owned(), problem));
    failure
}

impl From<&Planned> for ListedBite {
    fn from(planned: &Planned) -> Self {
        let bite = &planned.bite;
        Self {
            center: bite.center,
            long_axis: bite.approach,
            opening: Some(bite.opening),
            portal: Some(planned.portal),
        }
    }
}

impl From<&View> for ListedView {
    fn from(view: &View) -> Self {
        Self {
            tip: view.tip,
            approach: view.approach,
            optical_axis: view.optical_axis,
            roll_rad: view.roll_rad,
            depth_mm: view.depth_mm,
            distance_mm: view.distance_mm,
            occluded_percent: view.occluded_percent,
        }
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        tonic::Status::from(error).into()
    }
}
