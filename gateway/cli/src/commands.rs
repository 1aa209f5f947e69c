//! The commands, one function each.

use std::path::Path;

use arthro_geometry::ply::{self, Space, Stated, Unit};
use arthro_geometry::{Cloud, Point3};
use arthro_proto::common::v1::{Box as TargetBox, Point};
use arthro_proto::gateway::v1::{
    AbortProcedureRequest, GetRecoveryRequest, PauseProcedureRequest, PlanCaseRequest, Procedure,
    RecoverProcedureRequest, RecoveryAction, RegisterCaseRequest, RemoveTouchRequest,
    ResumeProcedureRequest, StopProcedureRequest, VerifyTargetRequest, ViewPlanning,
};
use arthro_proto::planning::v1::Planner;
use serde_json::json;

use crate::arguments::{
    Arguments, Bench, Case, Command, PlanCase, PlannerName, RecoveryName, SpaceName, StatedSpace,
    UnitName,
};
use crate::cell::targets::{Marks, Targets};
use crate::exit::Failure;
use crate::gateway::{Gateway, Model, completed, state_word};
use crate::output::Output;
use crate::plan::marks;
use crate::{
    audit, bench, calibrate, calibrations, can, cell, connection, demo, evaluate, pki, plan,
    reconstruct, record, register, requests, robot, scene,
};

/// Runs one command to its end.
pub async fn run(arguments: Arguments, output: &Output) -> Result<(), Failure> {
    connection::identify(&arguments.tls)?;
    let connect = || Gateway::connect(&arguments.gateway);
    match arguments.command {
        Command::Demo(demo) => Box::pin(demo::run(&demo, output)).await,
        Command::Up(up) => Box::pin(cell::up(&up, output)).await,
        Command::Pki(pki) => pki::run(&pki, output),
        Command::Calibrate(calibrate) => {
            Box::pin(calibrate::run(calibrate, &arguments.gateway, output)).await
        }
        Command::Calibration(calibration) => {
            calibrations::run(calibration, &arguments.gateway, output).await
        }
        // Started before any runtime exists; see `main`.
        Command::Serve(_) | Command::Replay(_) => Ok(()),
        Command::Audit(audit) => Box::pin(audit::run(audit, connect, output)).await,
        Command::Case(case) => run_case(case, &mut connect().await?, output).await,
        Command::Requests(which) => requests::run(which).await,
        Command::Register(register) => register::run(register, output).await,
        Command::Plan(arguments) => plan::run(*arguments, output).await,
        Command::Evaluate(arguments) => evaluate::run(&arguments, output),
        Command::Bench(Bench::Registration(bench)) => bench::run(bench, output).await,
        Command::Bench(Bench::Cell(bench)) => bench::cell::run(bench, output).await,
        Command::Bench(Bench::Budget(bench)) => bench::budget::run(bench, output).await,
        Command::Reconstruct(arguments) => reconstruct::run(&arguments, output),
        Command::Record(record) => record::run(record, output),
        Command::Can(arguments) => Box::pin(can::run(arguments, output)).await,
        Command::Robot(arguments) => Box::pin(robot::run(arguments, output)).await,
        Command::Run(run) => {
            let mut gateway = connect().await?;
            let digest = match run.digest {
                Some(digest) => digest,
                None => {
                    let case = gateway.case(&run.case).await?.case.unwrap_or_default();
                    if case.plan_digest.is_empty() {
                        return Err(Failure::refused("NOT_PLANNED", "the case has no plan"));
                    }
                    case.plan_digest
                }
            };
            let procedure = gateway.start(&run.case, &digest, &run.operator).await?;
            if run.detach {
                print(&procedure, output);
                return Ok(());
            }
            watch_to_the_end(&mut gateway, &procedure.procedure_id, output).await
        }
        Command::Watch(watch) => {
            let mut gateway = connect().await?;
            let id = gateway.procedure_id(watch.procedure).await?;
            watch_to_the_end(&mut gateway, &id, output).await
        }
        Command::Stop(stop) => {
            let request = StopProcedureRequest {
                reason: stop.reason,
                wait_for_devices: true,
            };
            connect().await?.procedures.stop_procedure(request).await?;
            output.line("stopped");
            output.result(&json!({"stopped": true}));
            Ok(())
        }
        Command::Pause(which) => {
            let mut gateway = connect().await?;
            let procedure_id = gateway.procedure_id(which.procedure).await?;
            let request = PauseProcedureRequest { procedure_id };
            let answer = gateway.procedures.pause_procedure(request).await?;
            print(&answer.into_inner().procedure.unwrap_or_default(), output);
            Ok(())
        }
        Command::Resume(which) => {
            let mut gateway = connect().await?;
            let procedure_id = gateway.procedure_id(which.procedure).await?;
            let request = ResumeProcedureRequest {
                procedure_id,
                acknowledge: which.acknowledge,
            };
            let answer = gateway.procedures.resume_procedure(request).await?;
            print(&answer.into_inner().procedure.unwrap_or_default(), output);
            Ok(())
        }
        Command::Abort(which) => {
            let mut gateway = connect().await?;
            let procedure_id = gateway.procedure_id(which.procedure).await?;
            let request = AbortProcedureRequest { procedure_id };
            let answer = gateway.procedures.abort_procedure(request).await?;
            print(&answer.into_inner().procedure.unwrap_or_default(), output);
            Ok(())
        }
        Command::Recovery(which) => {
            let mut gateway = connect().await?;
            let procedure_id = gateway.procedure_id(which.procedure).await?;
            let request = GetRecoveryRequest { procedure_id };
            let answer = gateway.procedures.get_recovery(request).await?;
            let value = recovery::show(&answer.into_inner());
            output.line(show::table(&value));
            output.result(&value);
            Ok(())
        }
        Command::Recover(recover) => {
            let mut gateway = connect().await?;
            let procedure_id = gateway.procedure_id(recover.procedure).await?;
            let action = match recover.action {
                RecoveryName::Withdraw => RecoveryAction::Withdraw,
                RecoveryName::RepeatBite => RecoveryAction::RepeatBite,
                RecoveryName::MarkDone => RecoveryAction::MarkDone,
            };
            let request = RecoverProcedureRequest {
                procedure_id,
                action: action.into(),
                operator: recover.operator,
                acknowledge: recover.acknowledge,
                recover_faults: recover.recover_faults,
            };
            let answer = gateway.procedures.recover_procedure(request).await?;
            print(&answer.into_inner().procedure.unwrap_or_default(), output);
            Ok(())
        }
    }
}

async fn run_case(case: Case, gateway: &mut Gateway, output: &Output) -> Result<(), Failure> {
    match case {
        Case::Create(create) => {
            let stated = stated(create.stated);
            let mesh = ply::read_mesh(&read(&create.model)?, stated)
                .map_err(|error| unreadable(&create.model, &error))?;
            let lesion = match &create.lesion {
                Some(path) => ply::read_cloud(&read(path)?, stated)
                    .map_err(|error| unreadable(path, &error))?,
                None => Cloud::default(),
            };
            let model = Model {
                mesh: &mesh,
                lesion: &lesion,
                lesion_spacing_mm: create.lesion_spacing_mm,
            };
            let case = gateway.create_case(&create.label, &model).await?;
            output.line(&case.case_id);
            output.result(&show::case(&case));
        }
        Case::List => {
            let cases = gateway.all_cases().await?;
            for case in &cases {
                output.line(format!(
                    "{}  {:<10}  {}",
                    case.case_id,
                    show::case_state(case),
                    case.label
                ));
            }
            output.result(&json!({
                "cases": cases.iter().map(show::case).collect::<Vec<_>>(),
            }));
        }
        Case::Show { case } => {
            let shown = gateway.case(&case).await?;
            let value = json!({
                "case": shown.case.as_ref().map(show::case),
                "registration": shown.registration.as_ref().map(show::registration),
                "verification": shown.verification.as_ref().map(show::verification),
                "plan": shown.plan.as_ref().map(show::plan),
                "predicted_errors": shown.predicted_errors.as_ref().map(show::predicted_errors),
            });
            output.line(show::table(&value));
            output.result(&value);
        }
        Case::Scene(scene) => {
            let stored = match (&scene.cloud, &scene.simulator) {
                (Some(path), _) => {
                    let stated = Some(Stated {
                        space: Space::Lps,
                        unit: Unit::Millimetre,
                    });
                    let cloud = ply::read_cloud(&read(path)?, stated)
                        .map_err(|error| unreadable(path, &error))?;
                    gateway.upload_cloud(&scene.case, &cloud).await?
                }
                (None, Some(address)) => {
                    let frame = scene::capture(address, scene.seed).await?;
                    gateway.upload_frame(&scene.case, &frame).await?
                }
                // The command line demands one of them.
                (None, None) => return Ok(()),
            };
            output.line(format!("{} points", stored.point_count));
            output.result(&json!({"points": stored.point_count}));
        }
        Case::Register(register) => {
            let request = RegisterCaseRequest {
                case_id: register.case,
                scale_prior: register.scale_prior,
                scale_tolerance: register.scale_tolerance,
                seed: register.seed,
            };
            let result = gateway.register(request, output).await?;
            let value = show::registration(&result);
            output.line(show::table(&value));
            output.result(&value);
        }
        Case::Accept {
            case,
            operator,
            surgeon,
        } => {
            let (operator, surgeon) = (operator.unwrap_or_default(), surgeon.unwrap_or_default());
            let case = gateway.accept(&case, &operator, &surgeon).await?;
            output.line(show::case_state(&case));
            output.result(&show::case(&case));
        }
        Case::Verify {
            case,
            landmark,
            at,
            operator,
        } => {
            let request = VerifyTargetRequest {
                case_id: case,
                landmark,
                point: Some(point(&at)),
                operator,
            };
            let verified = gateway.cases.verify_target(request).await?.into_inner();
            let value = json!({
                "distance_mm": verified.touch.map_or(0.0, |touch| touch.distance_mm),
                "verification": verified.verification.as_ref().map(show::verification),
            });
            output.line(show::table(&value));
            output.result(&value);
        }
        Case::Untouch {
            case,
            landmark,
            operator,
        } => {
            let request = RemoveTouchRequest {
                case_id: case,
                landmark,
                operator,
            };
            let left = gateway.cases.remove_touch(request).await?.into_inner();
            let value = json!({"verification": left.verification.as_ref().map(show::verification)});
            output.line(show::table(&value));
            output.result(&value);
        }
        Case::Plan(plan) => plan_case(*plan, gateway, output).await?,
        Case::Approve {
            case,
            digest,
            surgeon,
        } => {
            let case = gateway.approve(&case, &digest, &surgeon).await?;
            output.line(show::case_state(&case));
            output.result(&show::case(&case));
        }
        Case::Countersign {
            case,
            digest,
            person,
        } => {
            let case = gateway.countersign(&case, &digest, &person).await?;
            output.line(show::case_state(&case));
            output.result(&show::case(&case));
        }
    }
    Ok(())
}

async fn plan_case(plan: PlanCase, gateway: &mut Gateway, output: &Output) -> Result<(), Failure> {
    let targets = match &plan.targets {
        Some(path) => Targets::read(path)?.into(),
        None => Marks {
            ends: plan.start.zip(plan.goal),
            target_box: plan.target_box,
        },
    };
    let contour = match &plan.contour {
        Some(path) => marks::read_contour(path, plan.stated)?,
        None => Vec::new(),
    };
    let planner = match plan.planner {
        PlannerName::Bites => Planner::Bites,
        PlannerName::Paper => Planner::Paper,
    };
    let views = match plan.no_views {
        true => ViewPlanning::Off,
        false => ViewPlanning::On,
    };
    let request = PlanCaseRequest {
        contour: contour.iter().map(point).collect(),
        planner: planner.into(),
        allow_partial: plan.partial,
        views: views.into(),
        rim_min_mm: plan.rim_min_mm,
        ..plan_request(&plan.case, &targets, plan.seed)
    };
    let result = gateway.plan(request, output).await?;
    let planned = gateway.case(&plan.case).await?;
    let mut value = show::plan(&result);
    value["plan_digest"] = json!(planned.case.unwrap_or_default().plan_digest);
    let errors = planned.predicted_errors.as_ref();
    value["predicted_errors"] = json!(errors.map(show::predicted_errors));
    output.line(show::table(&value));
    output.result(&value);
    Ok(())
}

/// What the gateway is asked to plan.
pub fn plan_request(case_id: &str, marks: &Marks, seed: u64) -> PlanCaseRequest {
    PlanCaseRequest {
        case_id: case_id.to_owned(),
        start: marks.ends.as_ref().map(|(start, _)| point(start)),
        goal: marks.ends.as_ref().map(|(_, goal)| point(goal)),
        target_box: marks.target_box.as_ref().map(|(low, high)| TargetBox {
            min: Some(point(low)),
            max: Some(point(high)),
        }),
        seed,
        ..PlanCaseRequest::default()
    }
}

async fn watch_to_the_end(
    gateway: &mut Gateway,
    procedure_id: &str,
    output: &Output,
) -> Result<(), Failure> {
    let procedure = gateway.watch(procedure_id, output).await?;
    print(&procedure, output);
    completed(&procedure)
}

fn print(procedure: &Procedure, output: &Output) {
    output.line(format!(
        "{}  {}  {} of {} bites  {:.0} s",
        procedure.procedure_id,
        state_word(procedure.state()),
        procedure.bites_done,
        procedure.bites_planned,
        procedure.robot_seconds
    ));
    output.result(&show::procedure(procedure));
}

/// A point as a message.
pub fn point(point: &Point3) -> Point {
    Point {
        x_mm: point.x,
        y_mm: point.y,
        z_mm: point.z,
    }
}

/// What the command line says of a file.
pub fn stated(given: StatedSpace) -> Option<Stated> {
    Some(Stated {
        space: match given.space? {
            SpaceName::Lps => Space::Lps,
            SpaceName::Ras => Space::Ras,
        },
        unit: match given.unit? {
            UnitName::Mm => Unit::Millimetre,
            UnitName::M => Unit::Metre,
        },
    })
}

/// The bytes of a file, or a failure that names it.
pub fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    std::fs::read(path).map_err(|error| {
        Failure::refused("FILE_UNREADABLE", format!("{}: {error}", path.display()))
    })
}

/// A file that is there but not what it should be.
pub fn unreadable(path: &Path, error: &(dyn std::error::Error + 'static)) -> Failure {
    let failure = Failure::refused_because("FILE_INVALID", error);
    Failure::refused(
        "FILE_INVALID",
        format!("{}: {}", path.display(), failure.message),
    )
}

mod recovery;
/// Answers of the gateway as JSON for programs and as lines for people.
pub mod show;
