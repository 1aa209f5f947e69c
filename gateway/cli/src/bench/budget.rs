//! `arthro bench budget`: whether the predicted error of a bite is honest. One cell after another is mounted off its
//! drawing, calibrated and registered with the noise that its sensors have, and the referee says how far the tip would be
//! from the places that a plan could bite.
//!
//! Only the wires and the motions are left out: board, divot and camera are those of the simulated cell, the solvers are
//! those of the registration service, and the prediction is the gateway's. The arm's own error is drawn, because the
//! simulated arm has none.

use arthro_gateway::cases::case::{Bite, Registration as Registered, Verdict};
use arthro_gateway::config::{Calibration, Cell, Config, Pose};
use arthro_gateway::error_budget::{Part, Sources, Uncertainty};
use arthro_gateway::procedure::poses::{base_from_ct, upright};
use arthro_geometry::frame::{Base, Board, Camera, Flange, ForcepsBase, Tool};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};
use arthro_registration::calibration::board::{self, Corner, Lens};
use arthro_registration::calibration::hand_eye::{self, HandEye, Station};
use arthro_registration::calibration::noise::PoseNoise;
use arthro_registration::calibration::tool_tip::{self, ToolTip};
use arthro_simulator::referee::score::Believed;
use arthro_simulator::scenario::{Mounting, Scenario, Spec, SystemView};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;

use super::cell::register_view;
use super::score::median;
use crate::arguments::BenchBudget;
use crate::calibrate::cell::{board as views, divot};
use crate::calibrate::refused;
use crate::exit::Failure;
use crate::output::Output;

/// Views of the board.
const VIEWS: usize = 20;
/// Repeatability of a UR5: each axis, of the flange.
const ARM: PoseNoise = PoseNoise {
    rotation_rad: 2e-4,
    translation_mm: 0.1,
};
/// Play of the tip in the divot once the gauges read nothing, each axis, mm.
const PLAY_MM: f64 = 0.03;
/// Corrections of the tip in the divot.
const CORRECTIONS: u64 = 3;
/// Of the lesion's points, every so many is a bite.
const EVERY: usize = 7;

/// Sums over the bites of one cell, mm2.
struct Trial {
    missed_mm2: f64,
    predicted_mm2: f64,
    parts_mm2: [f64; 4],
    verdict: arthro_registration::gate::Verdict,
}

/// Runs the benchmark to its end.
pub async fn run(arguments: BenchBudget, output: &Output) -> Result<(), Failure> {
    let bar = output.progress("calibrating and registering", arguments.seeds);
    let advance = bar.clone();
    let computed = tokio::task::spawn_blocking(move || {
        (1..=arguments.seeds)
            .map(|seed| {
                let trial = one_cell(seed)?;
                advance.inc(1);
                Ok(trial)
            })
            .collect::<Result<Vec<Trial>, Failure>>()
    });
    let trials = computed
        .await
        .map_err(|error| Failure::failed("COMPUTATION_FAILED", error))??;
    bar.finish_and_clear();
    report(&trials, arguments.each, output);
    Ok(())
}

fn one_cell(seed: u64) -> Result<Trial, Failure> {
    let spec = Spec {
        seed,
        mounting: Mounting::uncalibrated(),
        ..Spec::default()
    };
    let scenario = Scenario::phantom(spec);
    let scenario = scenario.map_err(|error| Failure::refused_because("MODEL_REFUSED", &error))?;
    let drawn = scenario.system_view();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let eye = look(&scenario, &drawn, &mut rng)?;
    let tip = pivot(&scenario, &drawn, &mut rng)?;
    let found = register_view(&scenario, seed)?;

    let flange_from_tool = drawn.flange_from_tool.rotation();
    let sources = Sources {
        registration: Some(Uncertainty::Covariance {
            covariance: Box::new(found.covariance),
            about: found.covariance_about,
            scale_about: found.scale_about,
        }),
        hand_eye: Some(eye.mount_from_camera_covariance),
        arm_mm: ARM.translation_mm * 3.0_f64.sqrt(),
        tool_tip: Some(tip.tip_covariance_mm2),
        flange_from_tool,
    };
    let registration = Registered {
        camera_from_ct: found.camera_from_ct,
        verdict: Verdict::Accept,
        reasons: Vec::new(),
        encoded: bytes::Bytes::new(),
    };
    let cell = cell(&drawn, &eye)?;
    let base_from_ct = base_from_ct(&registration, &cell);
    let places = scenario.preoperative.lesion.iter().step_by(EVERY);
    let count = places.len() as f64;
    let mut trial = Trial {
        missed_mm2: 0.0,
        predicted_mm2: 0.0,
        parts_mm2: [0.0; 4],
        verdict: found.verdict,
    };
    for place in places {
        let shaft = (base_from_ct * *place - cell.forceps_portal).normalize();
        let bite = Bite {
            center: *place,
            approach: base_from_ct.rotation.inverse() * shaft,
            opening: Vector3::z(),
            contour_point: *place,
        };
        let believed = Believed {
            base_from_ct,
            tip_in_flange: tip.tip_in_flange,
            base_from_flange: upright(shaft) * flange_from_tool.inverse(),
        };
        let arm = normal_vector(&mut rng) * ARM.translation_mm;
        let error = sources.bite(&bite, &registration, &cell);
        trial.missed_mm2 += (scenario.miss(place, &believed) + arm).norm_squared() / count;
        trial.predicted_mm2 += error.rms_mm.powi(2) / count;
        for (sum, part) in trial.parts_mm2.iter_mut().zip(error.parts_mm) {
            *sum += part.powi(2) / count;
        }
    }
    Ok(trial)
}

/// Hand-eye from views of the board, as `arthro calibrate cell` takes them.
fn look(
    scenario: &Scenario,
    drawn: &SystemView,
    rng: &mut ChaCha8Rng,
) -> Result<HandEye<Base, Flange>, Failure> {
    let lens = &scenario.spec.camera;
    let lens_of_board = Lens {
        focal_px: [lens.focal_px; 2],
        center_px: lens.principal_point_px(),
    };
    let mut stations = Vec::new();
    for view in 0.. {
        if stations.len() == VIEWS {
            break;
        }
        let camera_from_board: Rigid<Camera, Board> = views::view(drawn, rng);
        let flange: Rigid<ForcepsBase, Flange> =
            drawn.forceps_base_from_camera * camera_from_board * drawn.flange_from_board.inverse();
        // A board that is out of the picture is no view.
        let Ok(seen) = scenario.board_corners(&flange, view) else {
            continue;
        };
        let corners: Vec<Corner> = seen
            .iter()
            .map(|corner| Corner {
                on_board_mm: corner.on_board_mm,
                seen_px: corner.seen_px,
            })
            .collect();
        let solved = board::solve(&corners, &lens_of_board, None).map_err(refused)?;
        stations.push(Station {
            base_from_flange: measured(&flange, rng),
            camera_from_board: solved.camera_from_board,
            camera_covariance: Some(solved.covariance),
        });
    }
    let options = hand_eye::Options {
        arm_noise: Some(ARM),
        ..views::options()
    };
    hand_eye::eye_on_base(&stations, &options).map_err(refused)
}

/// The tip from poses about the divot, each corrected until the gauges read nothing.
fn pivot(
    scenario: &Scenario,
    drawn: &SystemView,
    rng: &mut ChaCha8Rng,
) -> Result<ToolTip, Failure> {
    let mut poses = Vec::new();
    for pose in 0..divot::POSES {
        let turn = divot::leaning(pose);
        let mut seat = drawn.divot_in_forceps_base.coords;
        for correction in 0..=CORRECTIONS {
            let tool: Rigid<ForcepsBase, Tool> = Rigid::new(turn, seat);
            let flange = tool * drawn.flange_from_tool.inverse();
            if correction == CORRECTIONS {
                poses.push(measured(&flange, rng));
                break;
            }
            let seed = u64::from(pose) * CORRECTIONS + correction;
            let reading = scenario.divot_reading(&flange, seed);
            seat -= reading.map_err(|empty| Failure::refused_because("DIVOT_EMPTY", &empty))?;
        }
    }
    let options = tool_tip::Options {
        arm_noise: Some(ARM),
        divot_play_mm: PLAY_MM,
        ..tool_tip::Options::default()
    };
    tool_tip::solve(&poses, &options).map_err(refused)
}

/// What an arm of this repeatability tells of where it is.
fn measured(flange: &Rigid<ForcepsBase, Flange>, rng: &mut ChaCha8Rng) -> Rigid<Base, Flange> {
    let turn = Rotation::from_scaled_axis(normal_vector(rng) * ARM.rotation_rad);
    let shift = normal_vector(rng) * ARM.translation_mm;
    Rigid::new(turn * flange.rotation(), flange.translation_mm() + shift)
}

/// The cell as the gateway has it once the camera is calibrated.
fn cell(drawn: &SystemView, eye: &HandEye<Base, Flange>) -> Result<Cell, Failure> {
    let pose = Pose {
        rotation: [1.0, 0.0, 0.0, 0.0],
        translation_mm: [0.0; 3],
    };
    let config = Config {
        calibration: Some(Calibration {
            forceps_base_from_camera: Pose::of(&eye.mount_from_camera),
            forceps_base_from_arthroscope_base: pose,
            forceps_portal_mm: drawn.portal_in_forceps_base.into(),
            arthroscope_portal_mm: drawn.portal_in_arthroscope_base.into(),
            forceps_base_from_tool_at_tray: pose,
            arthroscope_rest_mm: Point3::origin().into(),
            valid_until: None,
            hand_eye_covariance: None,
            tool_tip_covariance_mm2: None,
        }),
        ..Config::default()
    };
    let cell = config
        .cell()
        .map_err(|error| Failure::refused_because("CONFIGURATION_INVALID", &error))?;
    cell.ok_or_else(|| Failure::failed("CONFIGURATION_INVALID", "the cell has no calibration"))
}

/// Three normal numbers of mean 0 and deviation 1 (Box and Muller).
fn normal_vector(rng: &mut ChaCha8Rng) -> Vector3 {
    Vector3::from_fn(|_, _| {
        let radius = (-2.0 * rng.random_range(f64::MIN_POSITIVE..1.0).ln()).sqrt();
        radius * rng.random_range(0.0..std::f64::consts::TAU).cos()
    })
}

fn report(trials: &[Trial], each: bool, output: &Output) {
    use arthro_registration::gate::Verdict;
    if each {
        for (index, trial) in trials.iter().enumerate() {
            output.line(format!(
                "seed {:<4} off {:.3} mm (predicted {:.3})  {}",
                index + 1,
                trial.missed_mm2.sqrt(),
                trial.predicted_mm2.sqrt(),
                crate::register::word(trial.verdict),
            ));
        }
    }
    // Nobody bites by a registration that is not accepted.
    let kept: Vec<&Trial> = trials
        .iter()
        .filter(|trial| trial.verdict == Verdict::Accept)
        .collect();
    let count = kept.len().max(1) as f64;
    let rms =
        |of: &dyn Fn(&Trial) -> f64| (kept.iter().copied().map(of).sum::<f64>() / count).sqrt();
    let (missed_mm, predicted_mm) = (
        rms(&|trial| trial.missed_mm2),
        rms(&|trial| trial.predicted_mm2),
    );
    let ratio_of = |trial: &&Trial| (trial.missed_mm2 / trial.predicted_mm2).sqrt();
    let ratios: Vec<f64> = kept.iter().map(ratio_of).collect();
    let within_two = ratios.iter().filter(|ratio| **ratio <= 2.0).count();
    let most = ratios.iter().copied().fold(0.0, f64::max);
    output.line(format!(
        "{} cells, {} accepted: true error {missed_mm:.3} mm rms, predicted {predicted_mm:.3}; ratio {:.2} (median {:.2}, most {most:.2}), {within_two} within twice",
        trials.len(),
        kept.len(),
        missed_mm / predicted_mm,
        median(ratios.clone()),
    ));
    let parts: Vec<(String, f64)> = Part::ALL
        .iter()
        .enumerate()
        .map(|(index, part)| {
            let part_mm = rms(&|trial| trial.parts_mm2[index]);
            (part.as_str().to_lowercase(), part_mm)
        })
        .collect();
    for (name, part_mm) in &parts {
        output.line(format!("  {name:<13} {part_mm:.3} mm predicted"));
    }
    output.result(&json!({
        "cells": trials.len(),
        "accepted": kept.len(),
        "true_rms_mm": missed_mm,
        "predicted_rms_mm": predicted_mm,
        "ratio": missed_mm / predicted_mm,
        "ratio_median": median(ratios),
        "ratio_most": most,
        "within_twice": within_two,
        "parts_mm": parts.into_iter().map(|(name, mm)| (name, json!(mm))).collect::<serde_json::Map<_, _>>(),
    }));
}
