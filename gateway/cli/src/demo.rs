//! `arthro demo`: a whole simulated meniscoplasty, from the CT model to the report.
//!
//! The demo is a client like any other. It starts the simulated cell and the five services, takes a
//! frame with the simulated camera, has it registered, planned, approved and performed through the
//! gateway, and asks the referee what truly happened.

mod comparison;
mod summary;

use std::fs::File;
use std::path::Path;
use std::time::Instant;

use arthro_geometry::{Cloud, Mesh, ply};
use arthro_proto::gateway::v1::{GetReportRequest, RegisterCaseRequest};
use arthro_proto::simulator::v1::referee_service_client::RefereeServiceClient;
use arthro_proto::simulator::v1::{GetAccountRequest, ScoreRegistrationRequest};
use arthro_simulator::scenario::{LESION_SPACING_MM, Mounting, Scenario, Spec};

use crate::arguments::{self, ScenarioName};
use crate::cell::targets::{Marks, Targets};
use crate::cell::{Cell, Ports, Urls};
use crate::commands::{plan_request, read, unreadable};
use crate::connection;
use crate::exit::{Failure, Kind};
use crate::gateway::{Gateway, Model, completed};
use crate::output::Output;
use crate::{report, scene};

use self::comparison::Judge;
pub use self::summary::Summary;

/// The name under which the demo accepts, approves and starts.
const OPERATOR: &str = "arthro demo";

/// Runs the demo to its end.
pub async fn run(arguments: &arguments::Demo, output: &Output) -> Result<(), Failure> {
    let scenario = scenario(&arguments.cell, output)?;
    // Better now than after the procedure.
    let opened = File::options()
        .create(true)
        .append(true)
        .open(&arguments.report);
    opened.map_err(|error| report_unwritable(&arguments.report, &error))?;
    let (folder, _removed_at_the_end) = match &arguments.keep {
        Some(folder) => (folder.clone(), None),
        None => {
            let folder = tempfile::Builder::new().prefix("arthro-demo-").tempdir()?;
            (folder.path().to_owned(), Some(folder))
        }
    };
    let mut cell = Box::pin(Cell::start(
        &scenario,
        &folder,
        arguments.cell.time_scale,
        Ports::Free,
        None,
        output,
    ))
    .await?;
    let urls = cell.urls();
    let outcome = tokio::select! {
        outcome = perform(&scenario, &urls, arguments, output) => outcome,
        failure = cell.failed() => Err(failure),
        _ = tokio::signal::ctrl_c() => Err(Failure::new(Kind::Interrupted, "INTERRUPTED", "interrupted from the terminal")),
    };
    cell.stop().await;
    let summary = outcome?;
    output.line(summary.table());
    output.line(format!("report: {}", arguments.report.display()));
    output.result(&summary.json());
    summary.limits_kept()
}

/// The case that the cell shall hold, everything mounted as drawn.
pub fn scenario(cell: &arguments::Cell, output: &Output) -> Result<Scenario, Failure> {
    mounted_scenario(cell, Mounting::default(), output)
}

/// The same with a mounting that may be off the drawing.
pub fn mounted_scenario(
    cell: &arguments::Cell,
    mounting: Mounting,
    output: &Output,
) -> Result<Scenario, Failure> {
    if !(0.1..=1000.0).contains(&cell.time_scale) {
        return Err(Failure::refused(
            "TIME_SCALE_OUT_OF_RANGE",
            format!("--time-scale {} is not within 0.1 .. 1000", cell.time_scale),
        ));
    }
    let spec = Spec {
        seed: cell.seed,
        mounting,
        ..Spec::default()
    };
    let scenario = match &cell.model {
        Some(path) => Scenario::of_mesh(spec, read_model(path, output)?),
        None => Scenario::phantom(spec),
    };
    scenario.map_err(|error| Failure::refused_because("MODEL_REFUSED", &error))
}

/// Any surface will do here; a clinical case refuses one that does not state its space and unit.
pub fn read_model(path: &Path, output: &Output) -> Result<Mesh, Failure> {
    let bytes = read(path)?;
    match ply::read_mesh(&bytes, None) {
        Err(ply::Error::Unstated(..)) => {
            output.note(format!(
                "{} does not state its space and unit; it is taken as LPS in mm, with a small radial tear put into it",
                path.display()
            ));
            let stated = ply::Stated {
                space: ply::Space::Lps,
                unit: ply::Unit::Millimetre,
            };
            ply::read_mesh(&bytes, Some(stated))
        }
        read => read,
    }
    .map_err(|error| unreadable(path, &error))
}

async fn perform(
    scenario: &Scenario,
    urls: &Urls,
    arguments: &arguments::Demo,
    output: &Output,
) -> Result<Summary, Failure> {
    let began = Instant::now();
    let mut gateway = Gateway::connect(&urls.gateway).await?;
    let mut referee = RefereeServiceClient::new(connection::open(&urls.simulator).await?);

    let lesion = Cloud::new(scenario.preoperative.lesion.clone());
    let model = Model {
        mesh: &scenario.preoperative.model,
        lesion: &lesion,
        lesion_spacing_mm: LESION_SPACING_MM,
    };
    let case = gateway.create_case("demo", &model).await?;
    let frame = scene::capture(&urls.simulator, arguments.cell.seed).await?;
    let stored = gateway.upload_frame(&case.case_id, &frame).await?;
    output.note(format!(
        "the camera sees {} points of the meniscus",
        stored.point_count
    ));

    let request = RegisterCaseRequest {
        case_id: case.case_id.clone(),
        seed: arguments.cell.seed,
        ..RegisterCaseRequest::default()
    };
    let registration = gateway.register(request, output).await?;
    let score = referee
        .score_registration(ScoreRegistrationRequest {
            camera_from_ct: registration.camera_from_ct,
        })
        .await?
        .into_inner();
    output.note(format!(
        "registered in {:.1} s: residual {:.3} mm2, true error {:.2} mm",
        registration.seconds, registration.mse_mm2, score.tre_rms_mm
    ));
    gateway.accept(&case.case_id, OPERATOR, OPERATOR).await?;

    let marks = match arguments.scenario {
        ScenarioName::Tear => Marks::default(),
        ScenarioName::Band => Targets::of(scenario).into(),
    };
    let request = plan_request(&case.case_id, &marks, arguments.cell.seed);
    let plan = gateway.plan(request, output).await?;
    let digest = gateway.case(&case.case_id).await?.case.unwrap_or_default();
    let mut judge = Judge::of(urls.planning.clone(), scenario, &registration, &plan).await?;
    let evaluation = judge.score(plan.bites.clone()).await?;
    let papers = judge.papers_bites();
    let paper = judge.score(papers).await?;
    output.note(format!(
        "planned {} bites, {} at least; the paper has {} on this contour",
        plan.bites.len(),
        plan.bound,
        paper.bites
    ));
    gateway
        .approve(&case.case_id, &digest.plan_digest, OPERATOR)
        .await?;

    let started = Instant::now();
    let procedure = gateway
        .start(&case.case_id, &digest.plan_digest, OPERATOR)
        .await?;
    let procedure = gateway.watch(&procedure.procedure_id, output).await?;
    completed(&procedure)?;
    let wall_seconds = started.elapsed().as_secs_f64();

    let account = referee
        .get_account(GetAccountRequest {})
        .await?
        .into_inner();
    let request = GetReportRequest {
        procedure_id: procedure.procedure_id.clone(),
    };
    let journal = gateway.procedures.get_report(request).await?.into_inner();
    let summary = Summary {
        source: scenario.source,
        scenario: arguments.scenario,
        seed: arguments.cell.seed,
        registration,
        score,
        plan,
        evaluation,
        paper,
        procedure,
        account,
        wall_seconds,
        total_seconds: began.elapsed().as_secs_f64(),
    };
    let html = report::html(scenario, &frame, &summary, &journal);
    std::fs::write(&arguments.report, html)
        .map_err(|error| report_unwritable(&arguments.report, &error))?;
    Ok(summary)
}

fn report_unwritable(path: &Path, error: &std::io::Error) -> Failure {
    Failure::refused("REPORT_UNWRITABLE", format!("{}: {error}", path.display()))
}
