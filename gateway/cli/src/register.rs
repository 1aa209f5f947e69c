//! `arthro register SOURCE TARGET`: finds the model in a view, in this process, from two files.

use std::path::Path;
use std::time::{Duration, Instant};

use arthro_geometry::surface::Surface;
use arthro_geometry::{Cloud, sampled, surface_file};
use arthro_registration::budget::Budget;
use arthro_registration::gate::Verdict;
use arthro_registration::input::MIN_DEADLINE_S;
use arthro_registration::pipeline::{Event, Method, Options, Registration, register};
use serde_json::{Value, json};

use crate::arguments::{MethodName, Register};
use crate::commands::{read, stated};
use crate::exit::Failure;
use crate::output::Output;

mod picture;

/// Distance between points that are spread over a mesh, mm, and how many there are at most.
const MESH_SPACING_MM: f64 = 0.5;
const MESH_POINTS_MAX: usize = 500_000;
/// Share of a deadline that the search may use; the rest finishes and judges what it found.
const SEARCH_SHARE: f64 = 0.6;

/// Runs the command to its end.
pub async fn run(arguments: Register, output: &Output) -> Result<(), Failure> {
    let began = Instant::now();
    let source = cloud(&arguments.source, "source", &arguments, output)?;
    let target = cloud(&arguments.target, "target", &arguments, output)?;
    let options = Options {
        method: method(arguments.method),
        scale: arguments.scale,
        viewpoint: arguments.viewpoint.or(target.viewpoint),
        target_region: arguments.target_region,
        seed: arguments.seed,
    };
    let budget = Budget::default();
    if let Some(deadline_s) = arguments.deadline {
        hurry_within(deadline_s, began, &budget)?;
    }
    let progress = output.progress("searching", 0);
    let bar = progress.clone();
    let (source, target) = (source.cloud, target.cloud);
    let computed = tokio::task::spawn_blocking(move || {
        let mut watch = |event: Event| {
            if let Event::Searched {
                scales,
                scales_in_all,
                score_mm,
                ..
            } = event
            {
                bar.set_length(scales_in_all.into());
                bar.set_position(scales.into());
                bar.set_message(format!("scales, residual {score_mm:.2}"));
            }
        };
        let registration = register(&source, &target, &options, &mut watch, &budget);
        (registration, source, target)
    });
    let (registration, source, target) = computed
        .await
        .map_err(|error| Failure::failed("COMPUTATION_FAILED", error))?;
    progress.finish_and_clear();
    let registration = registration?;
    let value = describe(&registration, began.elapsed());
    if let Some(path) = &arguments.svg {
        let svg = picture::svg(&source, &target, &registration);
        std::fs::write(path, svg).map_err(|error| {
            Failure::refused("PICTURE_UNWRITABLE", format!("{}: {error}", path.display()))
        })?;
    }
    output.line(table(&registration, &value));
    output.result(&value);
    Ok(())
}

/// Raises the flag that ends the search when most of the time is used.
fn hurry_within(deadline_s: f64, began: Instant, budget: &Budget) -> Result<(), Failure> {
    if !(MIN_DEADLINE_S..=86_400.0).contains(&deadline_s) {
        return Err(Failure::refused(
            "DEADLINE_TOO_SHORT",
            format!("--deadline is {deadline_s} s, must be {MIN_DEADLINE_S} to 86400 s"),
        ));
    }
    let until = began + Duration::from_secs_f64(SEARCH_SHARE * deadline_s);
    let budget = budget.clone();
    tokio::spawn(async move {
        tokio::time::sleep_until(until.into()).await;
        budget.hurry();
    });
    Ok(())
}

/// The words of the command line for the methods.
pub fn method(name: MethodName) -> Method {
    match name {
        MethodName::Robust => Method::Robust,
        MethodName::Paper => Method::Paper,
    }
}

/// Reads a cloud, or a mesh that points are spread over. What states neither space nor unit is taken as it stands: the
/// answer then maps the coordinates of the one file to those of the other.
fn cloud(
    path: &Path,
    what: &str,
    arguments: &Register,
    output: &Output,
) -> Result<Surface, Failure> {
    let bytes = read(path)?;
    let invalid =
        |error: &(dyn std::error::Error + 'static)| crate::commands::unreadable(path, error);
    let surface = surface_file::read_as_it_stands(path, &bytes).map_err(|error| invalid(&error))?;
    let given = stated(arguments.stated);
    let states_something = surface.statements.space.is_some() || surface.statements.unit.is_some();
    let mut surface = if states_something || given.is_some() {
        surface
            .into_lps_mm(given)
            .map_err(|error| invalid(&error))?
    } else {
        output.note(format!(
            "{what}: {} states neither space nor unit; taken as it stands, in mm",
            path.display()
        ));
        surface
    };
    if !surface.triangles.is_empty() {
        let mesh = arthro_geometry::Mesh {
            vertices: std::mem::take(&mut surface.cloud.points),
            triangles: std::mem::take(&mut surface.triangles),
        };
        surface.cloud = sampled::sample(&mesh, MESH_SPACING_MM, MESH_POINTS_MAX);
    }
    Ok(surface)
}

/// The answer as one JSON object.
pub fn describe(registration: &Registration, elapsed: Duration) -> Value {
    let pose = &registration.camera_from_ct;
    let matrix = pose.rotation.to_rotation_matrix();
    let rows: Vec<Vec<f64>> = matrix
        .matrix()
        .row_iter()
        .map(|row| row.iter().copied().collect())
        .collect();
    let evidence = &registration.evidence;
    json!({
        "scale": pose.scale,
        "rotation": rows,
        "translation_mm": pose.translation_mm.as_slice(),
        "mse_mm2": registration.mse_mm2,
        "coarse_mse_mm2": registration.coarse_mse_mm2,
        "inlier_share": evidence.inlier_share,
        "overlap": evidence.overlap,
        "tre_predicted_mm": evidence.tre_predicted_mm,
        "scale_deviation": evidence.scale_deviation,
        "misfit": evidence.misfit,
        "free_space_violation_share": evidence.violation_share,
        "ambiguity": evidence.ambiguity,
        "mirror": evidence.mirror,
        "verdict": word(registration.verdict),
        "reasons": registration.reasons,
        "seconds": elapsed.as_secs_f64(),
    })
}

/// The verdict as the API names it.
pub fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Accept => "ACCEPT",
        Verdict::Review => "REVIEW",
        Verdict::Reject => "REJECT",
    }
}

fn table(registration: &Registration, value: &Value) -> String {
    let pose = &registration.camera_from_ct;
    let evidence = &registration.evidence;
    let mut lines = vec![
        format!("verdict          {}", word(registration.verdict)),
        format!(
            "scale            {:.5} +- {:.5}",
            pose.scale,
            pose.scale * evidence.scale_deviation
        ),
    ];
    let matrix = pose.rotation.to_rotation_matrix();
    for (row, title) in ["rotation", "", ""].iter().enumerate() {
        let row: Vec<String> = matrix
            .matrix()
            .row(row)
            .iter()
            .map(|c| format!("{c:10.6}"))
            .collect();
        lines.push(format!("{title:<15} {}", row.join(" ")));
    }
    let shift: Vec<String> = pose
        .translation_mm
        .iter()
        .map(|c| format!("{c:10.4}"))
        .collect();
    lines.push(format!("translation mm  {}", shift.join(" ")));
    lines.push(format!(
        "residual mm2     {:.4} (coarse {:.4})",
        registration.mse_mm2, registration.coarse_mse_mm2
    ));
    lines.push(format!("inlier share     {:.3}", evidence.inlier_share));
    lines.push(format!("overlap          {:.3}", evidence.overlap));
    lines.push(format!("predicted TRE mm {:.3}", evidence.tre_predicted_mm));
    lines.push(format!(
        "ambiguity        {:.3}, mirror {:.3}",
        evidence.ambiguity, evidence.mirror
    ));
    lines.extend(
        registration
            .reasons
            .iter()
            .map(|reason| format!("  {reason}")),
    );
    lines.push(format!(
        "seconds          {:.3}",
        value["seconds"].as_f64().unwrap_or_default()
    ));
    lines.join("\n")
}

impl From<arthro_registration::error::Error> for Failure {
    fn from(error: arthro_registration::error::Error) -> Self {
        tonic::Status::from(error).into()
    }
}

/// A cloud for a picture: every so many points, so that a large one does not make a large file.
fn thinned(cloud: &Cloud, count: usize) -> impl Iterator<Item = usize> + '_ {
    (0..cloud.points.len()).step_by(cloud.points.len() / count + 1)
}
