//! `arthro bench cell`: the view of the simulated camera, registered for one knee after another, scored by the referee.
//!
//! As in a procedure the camera's noise is that of a stereo depth camera at 0.35 m; only the wires are left out.

use std::time::Instant;

use arthro_geometry::{Point3, sampled};
use arthro_registration::budget::Budget;
use arthro_registration::depth::distortion::Distortion;
use arthro_registration::depth::fusion::frames::Frame;
use arthro_registration::depth::intrinsics::Intrinsics;
use arthro_registration::depth::lens::Lens;
use arthro_registration::depth::options::Options as DepthOptions;
use arthro_registration::depth::{Capture, from_view};
use arthro_registration::error::Error;
use arthro_registration::gate::Verdict;
use arthro_registration::pipeline::{Options, Registration, register};
use arthro_simulator::camera::Camera;
use arthro_simulator::scenario::{Scenario, Spec};
use serde_json::json;

use super::score::median;
use crate::arguments::BenchCell;
use crate::demo::read_model;
use crate::exit::Failure;
use crate::output::Output;
use crate::scene::is_meniscus;

/// A registration farther off than this is wrong, mm rms.
const WRONG_MM: f64 = 1.0;
/// Distance between points that are spread over the model, mm, and how many there are at most.
const MODEL_SPACING_MM: f64 = 0.5;
const MODEL_POINTS_MAX: usize = 500_000;

/// What became of one knee.
struct Trial {
    tre_mm: f64,
    tre_predicted_mm: f64,
    verdict: Verdict,
    seconds: f64,
}

/// Runs the benchmark to its end.
pub async fn run(arguments: BenchCell, output: &Output) -> Result<(), Failure> {
    let model = match &arguments.model {
        Some(path) => Some(read_model(path, output)?),
        None => None,
    };
    let bar = output.progress("registering", arguments.seeds);
    let advance = bar.clone();
    let computed = tokio::task::spawn_blocking(move || {
        (1..=arguments.seeds)
            .map(|seed| {
                let spec = Spec {
                    seed,
                    ..Spec::default()
                };
                let scenario = match &model {
                    Some(mesh) => Scenario::of_mesh(spec, mesh.clone()),
                    None => Scenario::phantom(spec),
                };
                let scenario =
                    scenario.map_err(|error| Failure::refused_because("MODEL_REFUSED", &error))?;
                let trial = register_once(&scenario, seed)?;
                advance.inc(1);
                Ok((seed, trial))
            })
            .collect::<Result<Vec<(u64, Trial)>, Failure>>()
    });
    let trials = computed
        .await
        .map_err(|error| Failure::failed("COMPUTATION_FAILED", error))??;
    bar.finish_and_clear();
    report(&trials, arguments.each, output);
    Ok(())
}

fn register_once(scenario: &Scenario, seed: u64) -> Result<Trial, Failure> {
    let began = Instant::now();
    let answer = register_view(scenario, seed)?;
    Ok(Trial {
        tre_mm: scenario.score(&answer.camera_from_ct).tre_rms_mm,
        tre_predicted_mm: answer.evidence.tre_predicted_mm,
        verdict: answer.verdict,
        seconds: began.elapsed().as_secs_f64(),
    })
}

/// Registers what the camera of this cell sees.
pub fn register_view(scenario: &Scenario, seed: u64) -> Result<Registration, Failure> {
    let camera = Camera::new(scenario);
    let picture = camera.capture(seed);
    let lens = camera.intrinsics();
    let [cx_px, cy_px] = camera.principal_point_px();
    let mask: Vec<u8> = picture
        .color
        .iter()
        .map(|pixel| is_meniscus(pixel))
        .collect();
    let intrinsics = Intrinsics {
        width_px: lens.width_px,
        height_px: lens.height_px,
        fx_px: lens.focal_px,
        fy_px: lens.focal_px,
        cx_px,
        cy_px,
    };
    let lens_of_view = Lens::new(intrinsics, Distortion::None).map_err(Error::Invalid)?;
    let capture = Capture {
        frames: vec![Frame {
            lens: &lens_of_view,
            depth_unit_mm: lens.depth_unit_mm,
            depth: &picture.depth,
        }],
        mask: Some(&mask),
    };
    let budget = Budget::default();
    let target = from_view(&capture, &DepthOptions::default(), &budget)?.cloud();
    let source = sampled::sample(
        &scenario.preoperative.model,
        MODEL_SPACING_MM,
        MODEL_POINTS_MAX,
    );
    let options = Options {
        viewpoint: Some(Point3::origin()),
        ..Options::default()
    };
    Ok(register(&source, &target, &options, &mut |_| {}, &budget)?)
}

fn report(trials: &[(u64, Trial)], each: bool, output: &Output) {
    if each {
        for (seed, trial) in trials {
            output.line(format!(
                "seed {seed:<4} TRE {:.3} mm (predicted {:.3})  {}  {:.2} s",
                trial.tre_mm,
                trial.tre_predicted_mm,
                crate::register::word(trial.verdict),
                trial.seconds
            ));
        }
    }
    let of = |figure: fn(&Trial) -> f64| -> Vec<f64> {
        trials.iter().map(|(_, trial)| figure(trial)).collect()
    };
    let most = |values: Vec<f64>| values.into_iter().fold(0.0, f64::max);
    let count = |keep: fn(&Trial) -> bool| trials.iter().filter(|(_, trial)| keep(trial)).count();
    let accepted = count(|trial| trial.verdict == Verdict::Accept);
    let wrong_accepted = count(|trial| trial.tre_mm > WRONG_MM && trial.verdict == Verdict::Accept);
    let (tre, seconds) = (of(|trial| trial.tre_mm), of(|trial| trial.seconds));
    output.line(format!(
        "{} knees: TRE median {:.3} mm, most {:.3} mm; {accepted} accepted, {wrong_accepted} of them wrong (> {WRONG_MM} mm); median {:.2} s",
        trials.len(),
        median(tre.clone()),
        most(tre.clone()),
        median(seconds.clone()),
    ));
    output.result(&json!({
        "knees": trials.len(),
        "tre_median_mm": median(tre.clone()),
        "tre_most_mm": most(tre),
        "accepted": accepted,
        "wrong_accepted": wrong_accepted,
        "seconds_median": median(seconds),
    }));
}
