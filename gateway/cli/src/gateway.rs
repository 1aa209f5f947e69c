//! A client of the gateway: the calls that the commands and the demo share.

use arthro_geometry::{Cloud, Mesh};
use arthro_proto::common::v1::Frame;
use arthro_proto::gateway::v1::audit_service_client::AuditServiceClient;
use arthro_proto::gateway::v1::calibration_service_client::CalibrationServiceClient;
use arthro_proto::gateway::v1::case_service_client::CaseServiceClient;
use arthro_proto::gateway::v1::procedure_service_client::ProcedureServiceClient;
use arthro_proto::gateway::v1::{
    AcceptRegistrationRequest, ApprovePlanRequest, BegunAnew, Case, CountersignPlanRequest,
    CreateCaseRequest, GetCaseRequest, GetCaseResponse, ListCasesRequest, ListProceduresRequest,
    ModelHeader, PlanCaseRequest, Procedure, ProcedureState, RegisterCaseRequest, SceneHeader,
    StartProcedureRequest, UploadModelRequest, UploadSceneRequest, UploadSceneResponse,
    WatchProcedureRequest, scene_header, upload_model_request, upload_scene_request,
};
use arthro_proto::planning::v1::{PlanProgress, ResectionPlan, plan_resection_response};
use arthro_proto::registration::v1::{RegistrationResult, register_response};
use tonic::transport::Channel;

use crate::connection;
use crate::exit::{Failure, Kind};
use crate::output::Output;
use crate::scene::Scene;
use crate::upload;

/// Large answers (residuals of a big view, long plans) exceed the transport's default.
const MAX_ANSWER_BYTES: usize = 64 * 1024 * 1024;

/// A connected gateway.
#[derive(Clone, Debug)]
pub struct Gateway {
    /// Cases.
    pub cases: CaseServiceClient<Channel>,
    /// Calibrations.
    pub calibrations: CalibrationServiceClient<Channel>,
    /// Procedures.
    pub procedures: ProcedureServiceClient<Channel>,
    /// The audit.
    pub audit: AuditServiceClient<Channel>,
}

/// The preoperative data of a case.
#[derive(Debug)]
pub struct Model<'a> {
    /// Closed surface in ct.
    pub mesh: &'a Mesh,
    /// Points inside the damaged tissue in ct; may be empty.
    pub lesion: &'a Cloud,
    /// Distance between the lesion's points, mm.
    pub lesion_spacing_mm: f64,
}

impl Gateway {
    /// Connects to `address`, such as `http://127.0.0.1:50050`.
    pub async fn connect(address: &str) -> Result<Self, Failure> {
        let channel = connection::open(address).await.map_err(|failure| {
            if failure.kind != Kind::Unreachable {
                return failure;
            }
            Failure::new(Kind::Unreachable, "GATEWAY_UNREACHABLE", failure.message)
        })?;
        Ok(Self {
            cases: CaseServiceClient::new(channel.clone())
                .max_decoding_message_size(MAX_ANSWER_BYTES),
            calibrations: CalibrationServiceClient::new(channel.clone())
                .max_decoding_message_size(MAX_ANSWER_BYTES),
            procedures: ProcedureServiceClient::new(channel.clone())
                .max_decoding_message_size(MAX_ANSWER_BYTES),
            audit: AuditServiceClient::new(channel).max_decoding_message_size(MAX_ANSWER_BYTES),
        })
    }

    /// Creates a case and stores its model.
    pub async fn create_case(&mut self, label: &str, model: &Model<'_>) -> Result<Case, Failure> {
        let request = CreateCaseRequest {
            label: label.to_owned(),
        };
        let created = self.cases.create_case(request).await?.into_inner();
        let case = created.case.ok_or_else(missing("case"))?;
        let header = ModelHeader {
            case_id: case.case_id,
            mesh: Some(upload::mesh_header(model.mesh)),
            lesion: (!model.lesion.points.is_empty())
                .then(|| upload::cloud_header(model.lesion, Frame::Ct)),
            lesion_spacing_mm: model.lesion_spacing_mm,
        };
        use upload_model_request::Payload;
        let payloads = std::iter::once(Payload::Header(header))
            .chain(upload::mesh_chunks(model.mesh).map(Payload::Mesh))
            .chain(upload::cloud_chunks(model.lesion).map(Payload::Lesion));
        let stream = tokio_stream::iter(payloads.map(|payload| UploadModelRequest {
            payload: Some(payload),
        }));
        let stored = self.cases.upload_model(stream).await?.into_inner();
        stored.case.ok_or_else(missing("case"))
    }

    /// Stores a masked depth image as the case's scene.
    pub async fn upload_frame(
        &mut self,
        case_id: &str,
        scene: &Scene,
    ) -> Result<UploadSceneResponse, Failure> {
        use upload_scene_request::Payload;
        let header = scene_header::Scene::Depth(scene.header.clone());
        let payloads = upload::chunks(scene.depth.clone())
            .map(Payload::Depth)
            .chain(upload::chunks(scene.mask.clone()).map(Payload::Mask));
        self.upload_scene(case_id, header, payloads).await
    }

    /// Stores a cloud in the camera's frame as the case's scene.
    pub async fn upload_cloud(
        &mut self,
        case_id: &str,
        cloud: &Cloud,
    ) -> Result<UploadSceneResponse, Failure> {
        use upload_scene_request::Payload;
        let header = scene_header::Scene::Cloud(upload::cloud_header(cloud, Frame::Camera));
        let payloads = upload::cloud_chunks(cloud).map(Payload::Points);
        self.upload_scene(case_id, header, payloads).await
    }

    async fn upload_scene(
        &mut self,
        case_id: &str,
        scene: scene_header::Scene,
        chunks: impl Iterator<Item = upload_scene_request::Payload> + Send + 'static,
    ) -> Result<UploadSceneResponse, Failure> {
        let header = SceneHeader {
            case_id: case_id.to_owned(),
            scene: Some(scene),
        };
        let payloads = std::iter::once(upload_scene_request::Payload::Header(header)).chain(chunks);
        let stream = tokio_stream::iter(payloads.map(|payload| UploadSceneRequest {
            payload: Some(payload),
        }));
        Ok(self.cases.upload_scene(stream).await?.into_inner())
    }

    /// Registers a case, showing the stages as they go.
    pub async fn register(
        &mut self,
        request: RegisterCaseRequest,
        output: &Output,
    ) -> Result<RegistrationResult, Failure> {
        let bar = output.progress("registration", 2);
        let mut events = self.cases.register_case(request).await?.into_inner();
        let mut result = None;
        while let Some(message) = events.message().await? {
            if let Some(anew) = message.begun_anew {
                bar.reset();
                bar.set_message(anew_text(&anew));
            }
            match message.event.and_then(|event| event.event) {
                Some(register_response::Event::Progress(progress)) => bar.set_message(format!(
                    "search: scale {} of {}, residual {:.2} mm",
                    progress.scales, progress.scales_in_all, progress.score_mm
                )),
                Some(register_response::Event::Candidate(candidate)) => bar.set_message(format!(
                    "coarse: {:.0} % inliers, {:.2} mm2",
                    candidate.inlier_share * 100.0,
                    candidate.mse_mm2
                )),
                Some(register_response::Event::Iteration(iteration)) => bar.set_message(format!(
                    "fine: iteration {}, {:.3} mm2",
                    iteration.iteration, iteration.mse_mm2
                )),
                Some(register_response::Event::Stage(_)) => bar.inc(1),
                Some(register_response::Event::Result(last)) => result = Some(last),
                None => {}
            }
        }
        bar.finish_and_clear();
        result.ok_or_else(missing("registration result"))
    }

    /// Accepts the registration in force; a surgeon may be named, whom a doubtful one needs.
    pub async fn accept(
        &mut self,
        case_id: &str,
        operator: &str,
        surgeon: &str,
    ) -> Result<Case, Failure> {
        let request = AcceptRegistrationRequest {
            case_id: case_id.to_owned(),
            operator: operator.to_owned(),
            surgeon: surgeon.to_owned(),
        };
        let accepted = self.cases.accept_registration(request).await?.into_inner();
        accepted.case.ok_or_else(missing("case"))
    }

    /// Plans a case, showing progress.
    pub async fn plan(
        &mut self,
        request: PlanCaseRequest,
        output: &Output,
    ) -> Result<ResectionPlan, Failure> {
        let bar = output.progress("planning", 100);
        let mut events = self.cases.plan_case(request).await?.into_inner();
        let mut plan = None;
        while let Some(message) = events.message().await? {
            if let Some(anew) = message.begun_anew {
                bar.reset();
                bar.set_message(anew_text(&anew));
            }
            match message.event.and_then(|event| event.event) {
                Some(plan_resection_response::Event::Progress(progress)) => {
                    bar.set_position((progress.fraction * 100.0) as u64);
                    bar.set_message(planning_text(&progress));
                }
                Some(plan_resection_response::Event::Plan(last)) => plan = Some(last),
                None => {}
            }
        }
        bar.finish_and_clear();
        plan.ok_or_else(missing("plan"))
    }

    /// Approves the plan with this digest.
    pub async fn approve(
        &mut self,
        case_id: &str,
        plan_digest: &str,
        surgeon: &str,
    ) -> Result<Case, Failure> {
        let request = ApprovePlanRequest {
            case_id: case_id.to_owned(),
            plan_digest: plan_digest.to_owned(),
            surgeon: surgeon.to_owned(),
        };
        let approved = self.cases.approve_plan(request).await?.into_inner();
        approved.case.ok_or_else(missing("case"))
    }

    /// Puts a second person's name to the plan with this digest.
    pub async fn countersign(
        &mut self,
        case_id: &str,
        plan_digest: &str,
        person: &str,
    ) -> Result<Case, Failure> {
        let request = CountersignPlanRequest {
            case_id: case_id.to_owned(),
            plan_digest: plan_digest.to_owned(),
            person: person.to_owned(),
        };
        let signed = self.cases.countersign_plan(request).await?.into_inner();
        signed.case.ok_or_else(missing("case"))
    }

    /// The case with its registration and plan.
    pub async fn case(&mut self, case_id: &str) -> Result<GetCaseResponse, Failure> {
        let request = GetCaseRequest {
            case_id: case_id.to_owned(),
        };
        Ok(self.cases.get_case(request).await?.into_inner())
    }

    /// Starts the approved plan of a case.
    pub async fn start(
        &mut self,
        case_id: &str,
        plan_digest: &str,
        operator: &str,
    ) -> Result<Procedure, Failure> {
        let request = StartProcedureRequest {
            case_id: case_id.to_owned(),
            plan_digest: plan_digest.to_owned(),
            operator: operator.to_owned(),
        };
        let started = self.procedures.start_procedure(request).await?.into_inner();
        started.procedure.ok_or_else(missing("procedure"))
    }

    /// Watches a procedure until it ends or is interrupted; returns its last state.
    pub async fn watch(
        &mut self,
        procedure_id: &str,
        output: &Output,
    ) -> Result<Procedure, Failure> {
        let request = WatchProcedureRequest {
            procedure_id: procedure_id.to_owned(),
            ..WatchProcedureRequest::default()
        };
        let mut states = self.procedures.watch_procedure(request).await?.into_inner();
        let bar = output.progress("procedure", 0);
        let mut last = None;
        while let Some(message) = states.message().await? {
            let Some(procedure) = message.procedure else {
                continue;
            };
            bar.set_length(procedure.bites_planned.into());
            bar.set_position(procedure.bites_done.into());
            bar.set_message(progress_text(&procedure));
            let over = is_over(&procedure);
            last = Some(procedure);
            if over {
                break;
            }
        }
        bar.finish_and_clear();
        last.ok_or_else(missing("procedure"))
    }

    /// All cases, newest first.
    pub async fn all_cases(&mut self) -> Result<Vec<Case>, Failure> {
        let mut cases = Vec::new();
        let mut request = ListCasesRequest {
            page_size: 1000,
            ..ListCasesRequest::default()
        };
        loop {
            let page = self.cases.list_cases(request.clone()).await?.into_inner();
            cases.extend(page.cases);
            if page.next_page_token.is_empty() {
                return Ok(cases);
            }
            request.page_token = page.next_page_token;
        }
    }

    /// `given`, or the newest procedure's id.
    pub async fn procedure_id(&mut self, given: Option<String>) -> Result<String, Failure> {
        if let Some(id) = given {
            return Ok(id);
        }
        let listed = self.procedures.list_procedures(ListProceduresRequest {
            page_size: 1,
            ..ListProceduresRequest::default()
        });
        let newest = listed.await?.into_inner().procedures.into_iter().next();
        newest
            .map(|procedure| procedure.procedure_id)
            .ok_or_else(|| Failure::refused("NO_PROCEDURE", "there is no procedure yet"))
    }
}

/// Whether nothing more happens without an operator.
pub fn is_over(procedure: &Procedure) -> bool {
    matches!(
        procedure.state(),
        ProcedureState::Completed | ProcedureState::Aborted | ProcedureState::Interrupted
    )
}

/// `Ok` for a completed procedure, else the failure that says where it ended.
pub fn completed(procedure: &Procedure) -> Result<(), Failure> {
    if procedure.state() == ProcedureState::Completed {
        return Ok(());
    }
    Err(Failure::new(
        Kind::Interrupted,
        if procedure.reason.is_empty() {
            state_word(procedure.state())
        } else {
            procedure.reason.clone()
        },
        format!(
            "procedure {} is {} after {} of {} bites: {}",
            procedure.procedure_id,
            state_word(procedure.state()),
            procedure.bites_done,
            procedure.bites_planned,
            procedure.detail
        ),
    ))
}

/// A state as one word, e.g. `RUNNING`.
pub fn state_word(state: ProcedureState) -> String {
    state
        .as_str_name()
        .trim_start_matches("PROCEDURE_STATE_")
        .to_owned()
}

fn anew_text(anew: &BegunAnew) -> String {
    format!(
        "begun anew on another replica ({}): {} was lost",
        anew.times, anew.lost_replica
    )
}

fn planning_text(progress: &PlanProgress) -> String {
    match (progress.incumbent, progress.bound) {
        (Some(bites), Some(bound)) => {
            format!("{}: {bites} bites, at least {bound}", progress.stage)
        }
        (Some(bites), None) => format!("{}: {bites} bites", progress.stage),
        (None, _) => progress.stage.clone(),
    }
}

fn progress_text(procedure: &Procedure) -> String {
    let step = procedure.step.as_ref().map_or_else(String::new, |step| {
        step.kind()
            .as_str_name()
            .trim_start_matches("STEP_KIND_")
            .to_lowercase()
            .replace('_', " ")
    });
    format!(
        "{step}; {:.0} s of robot time; RCM {:.3} mm",
        procedure.robot_seconds, procedure.rcm_deviation_max_mm
    )
}

/// The contract promises a field that did not come.
fn missing(what: &'static str) -> impl Fn() -> Failure {
    move || {
        Failure::failed(
            "ANSWER_INCOMPLETE",
            format!("the gateway's answer has no {what}"),
        )
    }
}
