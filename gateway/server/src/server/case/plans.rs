//! Plans of a case: what is asked of the planning service, and what of its answer is kept.
//!
//! The portals lie in the cell; they are carried into ct through hand-eye and registration, the inverse of the way that
//! the bites go when they are executed. The numbers of a request are judged by the planning service; what it says of
//! them is told under the names that this request has.

use arthro_geometry::Point3;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::planning::v1 as planning;
use tokio::sync::mpsc;
use tonic::Status;

use super::super::{Violations, id};
use super::{CaseApi, begun_anew_message, decoded};
use crate::cases::case::{self, Case};
use crate::clients::replicas;
use crate::config::{Cell, Jaw};
use crate::error::{Error, Result as DomainResult, Violation};
use crate::procedure::poses;
use crate::wire;

/// Most bites of a plan.
const BITES_MAX: usize = 1_000;
/// Most points of a drawn contour.
const CONTOUR_MAX: usize = 10_000;
/// How far a bite's approach may be from the line from the portal, as the sine of the angle.
const APPROACH_TOLERANCE: f64 = 0.02;
/// Where the planning service finds what this request holds at its top.
const PLANNING_PREFIX: &str = "options.";

/// Where the instruments enter, ct, mm.
struct Portals {
    forceps: Point3,
    arthroscope: Point3,
}

impl Portals {
    fn of(case: &Case, cell: &Cell) -> DomainResult<Self> {
        let ct_from_base = poses::base_from_ct(case.accepted()?, cell).inverse();
        let arthroscope = cell.forceps_base_from_arthroscope_base * cell.arthroscope_portal;
        Ok(Self {
            forceps: ct_from_base * cell.forceps_portal,
            arthroscope: ct_from_base * arthroscope,
        })
    }
}

/// Checks what does not need the model; answers the jaw to plan with.
pub(super) fn check(request: &proto::PlanCaseRequest, configured: Jaw) -> DomainResult<Jaw> {
    let mut violations = Violations::default();
    violations.check(id("case_id", request.case_id.clone()));
    violations.check(check_aim(request));
    for (field, point) in [("start", request.start), ("goal", request.goal)] {
        if point.is_some() {
            violations.check(wire::point(point, field));
        }
    }
    if let Some(target_box) = &request.target_box {
        violations.check(check_box(target_box));
    }
    let jaw = match request.jaw {
        None => Some(configured),
        Some(jaw) => violations.check(wire::jaw(jaw, "jaw")),
    };
    if !(0.0..=20.0).contains(&request.rim_min_mm) {
        violations.check::<()>(Err(Violation::new(
            "rim_min_mm",
            format!("is {} mm; must be within 0 .. 20 mm", request.rim_min_mm),
        )));
    }
    if proto::ViewPlanning::try_from(request.views).is_err() {
        let problem = format!("is {}; unknown", request.views);
        violations.check::<()>(Err(Violation::new("views", problem)));
    }
    violations.finish()?;
    Ok(jaw.unwrap_or(configured))
}

/// Where the contour comes from has to be said once or not at all.
fn check_aim(request: &proto::PlanCaseRequest) -> Result<(), Violation> {
    let count = request.contour.len();
    if count > CONTOUR_MAX {
        let problem = format!("holds {count} points; must hold at most {CONTOUR_MAX}");
        return Err(Violation::new("contour", problem));
    }
    match (request.start.is_some(), request.goal.is_some()) {
        (true, false) => Err(Violation::new("goal", "is missing beside start")),
        (false, true) => Err(Violation::new("start", "is missing beside goal")),
        _ => Ok(()),
    }
}

fn check_box(target_box: &arthro_proto::common::v1::Box) -> Result<(), Violation> {
    let min = wire::point(target_box.min, "target_box.min")?;
    let max = wire::point(target_box.max, "target_box.max")?;
    for (axis, name) in ["x_mm", "y_mm", "z_mm"].into_iter().enumerate() {
        if min[axis] >= max[axis] {
            return Err(Violation::new(
                format!("target_box.min.{name}"),
                format!("is {}; must be below max, {}", min[axis], max[axis]),
            ));
        }
    }
    Ok(())
}

impl CaseApi {
    /// Passes the events on, and keeps the plan before the client hears of it.
    pub(super) async fn plan(
        &self,
        case: Case,
        request: proto::PlanCaseRequest,
        jaw: Jaw,
        answers: &mpsc::Sender<Result<proto::PlanCaseResponse, Status>>,
    ) -> DomainResult<()> {
        use planning::plan_resection_response::Event;
        let cell = self.cases.calibrated_cell().await?;
        let portals = Portals::of(&case, &cell)?;
        let joint = cell
            .joint_opening_mm
            .map(|opening_mm| planning::JointOptions {
                opening_mm,
                ..planning::JointOptions::default()
            });
        let options = planning::PlanResectionOptions {
            joint,
            ..options(&case, request, jaw, &portals)
        };
        let model = self.cases.packed_model(&case.id).await?;
        let planning = &self.clients.planning;
        let renamed = |failure: crate::clients::Failure| failure.without_prefix(PLANNING_PREFIX);
        let mut events = planning.plan(options, model).await.map_err(renamed)?;
        while let Some(event) = events.next().await.map_err(renamed)? {
            let event = match event {
                replicas::Event::Message(event) => event,
                replicas::Event::BegunAnew(anew) => {
                    let answer = proto::PlanCaseResponse {
                        event: None,
                        predicted_errors: None,
                        begun_anew: Some(begun_anew_message(anew)),
                    };
                    if answers.send(Ok(answer)).await.is_err() {
                        return Ok(());
                    }
                    continue;
                }
            };
            let mut predicted_errors = None;
            if let Some(Event::Plan(message)) = &event.event {
                let plan = wire::plan(message, jaw)?;
                let planned = self.cases.keep_plan(&case.id, case.revision, plan).await?;
                predicted_errors = self.predicted_errors(&planned);
            }
            let answer = proto::PlanCaseResponse {
                event: Some(event),
                predicted_errors,
                begun_anew: None,
            };
            if answers.send(Ok(answer)).await.is_err() {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Scores the revised bites and keeps them in the place of the planned ones.
    pub(super) async fn revise(
        &self,
        request: proto::RevisePlanRequest,
    ) -> DomainResult<(Case, planning::ResectionEvaluation)> {
        let case_id = id("case_id", request.case_id)?;
        let count = request.bites.len();
        if !(1..=BITES_MAX).contains(&count) {
            return Err(Error::invalid(
                "bites",
                format!("holds {count}; must hold 1 to {BITES_MAX}"),
            ));
        }
        let bites = wire::bites(&request.bites)?;
        let case = self.cases.get(&case_id).await?;
        let plan = case.plan.as_ref().ok_or(Error::NotPlanned)?;
        let portals = Portals::of(&case, &*self.cases.calibrated_cell().await?)?;
        check_approaches(&bites, &portals.forceps)?;

        let planned = decoded::<planning::ResectionPlan>(&plan.encoded);
        let options = planning::EvaluateResectionOptions {
            lesion_spacing_mm: lesion_spacing_mm(&case),
            contour: planned.contour.clone(),
            bites: request.bites.clone(),
            jaw: Some(wire::jaw_message(&plan.jaw)),
            portals: vec![wire::point_message(&portals.forceps)],
            ..planning::EvaluateResectionOptions::default()
        };
        let model = self.cases.packed_model(&case_id).await?;
        let evaluation = self.clients.planning.evaluate(options, model).await?;
        let message = planning::ResectionPlan {
            views: kept_views(&planned, &request.bites),
            bites: request.bites,
            contour: planned.contour,
            evaluation: Some(evaluation.clone()),
            ..planning::ResectionPlan::default()
        };
        let plan = wire::plan(&message, plan.jaw)?;
        let case = self.cases.keep_plan(&case_id, case.revision, plan).await?;
        Ok((case, evaluation))
    }
}

fn options(
    case: &Case,
    request: proto::PlanCaseRequest,
    jaw: Jaw,
    portals: &Portals,
) -> planning::PlanResectionOptions {
    let arthroscope = match request.views() {
        proto::ViewPlanning::Off => None,
        proto::ViewPlanning::On | proto::ViewPlanning::Unspecified => {
            Some(planning::ArthroscopeViewOptions {
                portal: Some(wire::point_message(&portals.arthroscope)),
                ..planning::ArthroscopeViewOptions::default()
            })
        }
    };
    planning::PlanResectionOptions {
        lesion_spacing_mm: lesion_spacing_mm(case),
        start: request.start,
        goal: request.goal,
        contour: request.contour,
        target_box: request.target_box,
        portal: Some(wire::point_message(&portals.forceps)),
        jaw: Some(wire::jaw_message(&jaw)),
        rim_min_mm: request.rim_min_mm,
        seed: request.seed,
        planner: request.planner,
        paper_cost: request.paper_cost,
        allow_partial: request.allow_partial,
        effort: request.effort,
        region_percent: request.region_percent,
        outside_limit_mm3: request.outside_limit_mm3,
        placement_error_mm: request.placement_error_mm,
        arthroscope,
        ..planning::PlanResectionOptions::default()
    }
}

fn lesion_spacing_mm(case: &Case) -> f64 {
    case.model
        .as_ref()
        .map_or(0.0, |model| model.lesion_spacing_mm)
}

/// The views of bites that were planned; none at all when any bite is another one, which nobody looked for a view of.
fn kept_views(
    planned: &planning::ResectionPlan,
    revised: &[planning::Bite],
) -> Vec<planning::ArthroscopeView> {
    let view_of = |bite: &planning::Bite| {
        let place = planned.bites.iter().position(|other| other == bite)?;
        planned.views.get(place).copied()
    };
    let views: Option<_> = revised.iter().map(view_of).collect();
    views.unwrap_or_default()
}

/// What is executed goes straight from the portal to the center, so what is approved has to say the same.
fn check_approaches(bites: &[case::Bite], portal_in_ct: &Point3) -> Result<(), Violation> {
    for (index, bite) in bites.iter().enumerate() {
        let shaft = (bite.center - portal_in_ct).normalize();
        let sine = bite.approach.cross(&shaft).norm();
        if !(sine <= APPROACH_TOLERANCE && bite.approach.dot(&shaft) > 0.0) {
            return Err(Violation::new(
                format!("bites[{index}].approach"),
                format!(
                    "is {:.1} deg off the line from the portal to the center; must be within 1.1 deg",
                    bite.approach.angle(&shaft).to_degrees()
                ),
            ));
        }
    }
    Ok(())
}
