//! `CaseService`.

mod acceptance;
mod accuracy;
mod plans;
mod uploads;

use std::sync::Arc;

use arthro_bootstrap::Caller;
use arthro_proto::common::v1::Frame;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::case_service_server::CaseService;
use arthro_proto::registration::v1 as registration;
use tokio::sync::{Semaphore, mpsc};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status, Streaming};

use super::procedure::digest;
use super::{Answers, id, paging, person, refuse, text};
use crate::approval::{Approval, Signatory};
use crate::aside::aside;
use crate::audit::Who;
use crate::cases::case::{Case, Stage, Verdict};
use crate::cases::{Cases, surface};
use crate::clients::{Clients, replicas};
use crate::config::{ErrorBudget, Jaw};
use crate::error::{Error, Result as DomainResult};
use crate::journal::Blob;
use crate::wall_clock::now_ms;
use crate::wire;

/// Uploads and computations that hold a model or a cloud in memory at the same time.
const LARGE_CALLS_MAX: usize = 4;
/// Events of a computation that a slow client may lag behind.
const EVENTS_BUFFERED: usize = 64;

/// Serves the cases.
#[derive(Clone)]
pub(super) struct CaseApi {
    cases: Cases,
    clients: Clients,
    jaw: Jaw,
    error_budget: ErrorBudget,
    large_calls: Arc<Semaphore>,
}

impl CaseApi {
    pub(super) fn new(cases: Cases, clients: Clients, jaw: Jaw, error_budget: ErrorBudget) -> Self {
        Self {
            cases,
            clients,
            jaw,
            error_budget,
            large_calls: Arc::new(Semaphore::new(LARGE_CALLS_MAX)),
        }
    }

    fn large_call(&self) -> DomainResult<tokio::sync::OwnedSemaphorePermit> {
        self.large_calls
            .clone()
            .try_acquire_owned()
            .map_err(|_| Error::TooManyUploads {
                limit: LARGE_CALLS_MAX,
            })
    }

    fn message(&self, case: &Case) -> proto::Case {
        let plan_digest = self.cases.plan_digest(case);
        // An approval of another digest is void: a recalibrated cell voids it without touching the case.
        let approval = case
            .approval
            .as_ref()
            .filter(|approval| Some(approval.digest) == plan_digest);
        let text = |digest: Option<crate::approval::Digest>| {
            digest.map_or_else(String::new, |digest| digest.to_string())
        };
        proto::Case {
            case_id: case.id.clone(),
            label: case.label.clone(),
            state: stage_message(case.stage(plan_digest, self.cases.policy())).into(),
            created_at_ms: case.created_at_ms,
            model_digest: text(case.model.as_ref().map(|model| model.digest)),
            scene_digest: text(case.scene.as_ref().map(|scene| scene.digest)),
            plan_digest: text(plan_digest),
            approved_by: approval
                .map_or_else(String::new, |approval| approval.surgeon.name.clone()),
            approved_digest: text(approval.map(|approval| approval.digest)),
            approvals: approval.map_or_else(Vec::new, approval_messages),
            approvals_needed: self.cases.policy().persons.into(),
            acceptance: acceptance_message(case),
        }
    }
}

#[tonic::async_trait]
impl CaseService for CaseApi {
    async fn create_case(
        &self,
        request: Request<proto::CreateCaseRequest>,
    ) -> Result<Response<proto::CreateCaseResponse>, Status> {
        let label = text("label", request.into_inner().label, 200).map_err(refuse)?;
        let case = self.cases.create(label).await.map_err(refuse)?;
        Ok(Response::new(proto::CreateCaseResponse {
            case: Some(self.message(&case)),
        }))
    }

    async fn list_cases(
        &self,
        request: Request<proto::ListCasesRequest>,
    ) -> Result<Response<proto::ListCasesResponse>, Status> {
        let request = request.into_inner();
        let size = paging::size(request.page_size).map_err(refuse)?;
        let page = paging::page(size, request.page_token);
        let mut cases = self.cases.list(&page).await.map_err(refuse)?;
        let next_page_token = paging::cut(&mut cases, size, |case| &case.id);
        Ok(Response::new(proto::ListCasesResponse {
            cases: cases.iter().map(|case| self.message(case)).collect(),
            next_page_token,
        }))
    }

    async fn get_case(
        &self,
        request: Request<proto::GetCaseRequest>,
    ) -> Result<Response<proto::GetCaseResponse>, Status> {
        let case_id = id("case_id", request.into_inner().case_id).map_err(refuse)?;
        Ok(Response::new(
            self.describe(&case_id).await.map_err(refuse)?,
        ))
    }

    async fn upload_model(
        &self,
        request: Request<Streaming<proto::UploadModelRequest>>,
    ) -> Result<Response<proto::UploadModelResponse>, Status> {
        let _permit = self.large_call().map_err(refuse)?;
        let case = self.receive_model(request.into_inner()).await?;
        Ok(Response::new(proto::UploadModelResponse {
            case: Some(self.message(&case)),
        }))
    }

    async fn upload_scene(
        &self,
        request: Request<Streaming<proto::UploadSceneRequest>>,
    ) -> Result<Response<proto::UploadSceneResponse>, Status> {
        let _permit = self.large_call().map_err(refuse)?;
        let case = self.receive_scene(request.into_inner()).await?;
        Ok(Response::new(proto::UploadSceneResponse {
            point_count: case.scene.as_ref().map_or(0, |scene| scene.point_count),
            case: Some(self.message(&case)),
        }))
    }

    type RegisterCaseStream = Answers<proto::RegisterCaseResponse>;

    async fn register_case(
        &self,
        request: Request<proto::RegisterCaseRequest>,
    ) -> Result<Response<Self::RegisterCaseStream>, Status> {
        let permit = self.large_call().map_err(refuse)?;
        let request = request.into_inner();
        let case_id = id("case_id", request.case_id.clone()).map_err(refuse)?;
        let case = self.cases.get(&case_id).await.map_err(refuse)?;
        case.model_and_scene().map_err(refuse)?;
        let this = self.clone();
        Ok(Response::new(streamed(move |answers| async move {
            let _permit = permit;
            this.register(case, request, &answers).await
        })))
    }

    async fn accept_registration(
        &self,
        request: Request<proto::AcceptRegistrationRequest>,
    ) -> Result<Response<proto::AcceptRegistrationResponse>, Status> {
        let caller = Caller::of(request.extensions());
        let request = request.into_inner();
        let acceptance = acceptance::acceptance(&caller, &request).map_err(refuse)?;
        let case_id = id("case_id", request.case_id).map_err(refuse)?;
        let case = self
            .cases
            .accept(&case_id, acceptance)
            .await
            .map_err(refuse)?;
        Ok(Response::new(proto::AcceptRegistrationResponse {
            case: Some(self.message(&case)),
        }))
    }

    async fn verify_target(
        &self,
        request: Request<proto::VerifyTargetRequest>,
    ) -> Result<Response<proto::VerifyTargetResponse>, Status> {
        let caller = Caller::of(request.extensions());
        let answer = self.verify(&caller, request.into_inner()).await;
        Ok(Response::new(answer.map_err(refuse)?))
    }

    async fn remove_touch(
        &self,
        request: Request<proto::RemoveTouchRequest>,
    ) -> Result<Response<proto::RemoveTouchResponse>, Status> {
        let caller = Caller::of(request.extensions());
        let answer = self.take_back(&caller, request.into_inner()).await;
        Ok(Response::new(answer.map_err(refuse)?))
    }

    type PlanCaseStream = Answers<proto::PlanCaseResponse>;

    async fn plan_case(
        &self,
        request: Request<proto::PlanCaseRequest>,
    ) -> Result<Response<Self::PlanCaseStream>, Status> {
        let permit = self.large_call().map_err(refuse)?;
        let request = request.into_inner();
        let jaw = plans::check(&request, self.jaw).map_err(refuse)?;
        let case = self.cases.get(&request.case_id).await.map_err(refuse)?;
        case.accepted().map_err(refuse)?;
        self.cases.calibrated_cell().await.map_err(refuse)?;
        let this = self.clone();
        Ok(Response::new(streamed(move |answers| async move {
            let _permit = permit;
            this.plan(case, request, jaw, &answers).await
        })))
    }

    async fn revise_plan(
        &self,
        request: Request<proto::RevisePlanRequest>,
    ) -> Result<Response<proto::RevisePlanResponse>, Status> {
        let _permit = self.large_call().map_err(refuse)?;
        let request = request.into_inner();
        let (case, evaluation) = self.revise(request).await.map_err(refuse)?;
        Ok(Response::new(proto::RevisePlanResponse {
            case: Some(self.message(&case)),
            evaluation: Some(evaluation),
            predicted_errors: self.predicted_errors(&case),
        }))
    }

    async fn approve_plan(
        &self,
        request: Request<proto::ApprovePlanRequest>,
    ) -> Result<Response<proto::ApprovePlanResponse>, Status> {
        let (caller, who) = (Caller::of(request.extensions()), who(&request));
        let request = request.into_inner();
        let case_id = id("case_id", request.case_id).map_err(refuse)?;
        let seen = digest("plan_digest", &request.plan_digest).map_err(refuse)?;
        let name = person(&caller, "surgeon", request.surgeon).map_err(refuse)?;
        let surgeon = Signatory::new(&caller, name, now_ms());
        let case = self.cases.approve(&case_id, surgeon, who, seen).await;
        Ok(Response::new(proto::ApprovePlanResponse {
            case: Some(self.message(&case.map_err(refuse)?)),
        }))
    }

    async fn countersign_plan(
        &self,
        request: Request<proto::CountersignPlanRequest>,
    ) -> Result<Response<proto::CountersignPlanResponse>, Status> {
        let (caller, who) = (Caller::of(request.extensions()), who(&request));
        let request = request.into_inner();
        let case_id = id("case_id", request.case_id).map_err(refuse)?;
        let seen = digest("plan_digest", &request.plan_digest).map_err(refuse)?;
        let name = person(&caller, "person", request.person).map_err(refuse)?;
        let person = Signatory::new(&caller, name, now_ms());
        let case = self.cases.countersign(&case_id, person, who, seen).await;
        Ok(Response::new(proto::CountersignPlanResponse {
            case: Some(self.message(&case.map_err(refuse)?)),
        }))
    }
}

impl CaseApi {
    async fn describe(&self, case_id: &str) -> DomainResult<proto::GetCaseResponse> {
        let case = self.cases.get(case_id).await?;
        let registration = match &case.registration {
            None => None,
            Some(registration) => {
                let mut result = decoded::<registration::RegistrationResult>(&registration.encoded);
                result.residuals_mm = self.cases.blob(case_id, Blob::Residuals).await?;
                Some(result)
            }
        };
        Ok(proto::GetCaseResponse {
            case: Some(self.message(&case)),
            registration,
            plan: case.plan.as_ref().map(|plan| decoded(&plan.encoded)),
            verification: case
                .registration
                .as_ref()
                .and(self.cases.calibrations().cell())
                .map(|_| self.verification_message(&case)),
            predicted_errors: self.predicted_errors(&case),
        })
    }

    /// Passes the events on and keeps the result before the client hears of it.
    async fn register(
        &self,
        case: Case,
        request: proto::RegisterCaseRequest,
        answers: &mpsc::Sender<Result<proto::RegisterCaseResponse, Status>>,
    ) -> DomainResult<()> {
        use registration::register_response::Event;
        let (_, scene) = case.model_and_scene()?;
        let model = self.cases.packed_model(&case.id).await?;
        let source =
            aside(move || surface::sample(&surface::mesh(&model.vertices, &model.triangles))).await;
        let target = self.cases.blob(&case.id, Blob::Scene).await?;
        let options = registration::RegisterOptions {
            source: Some(wire::cloud_header(Frame::Ct, source.point_count, true)),
            target: Some(wire::cloud_header(
                Frame::Camera,
                scene.point_count,
                scene.has_normals,
            )),
            scale_prior: request.scale_prior,
            scale_tolerance: request.scale_tolerance,
            viewpoint: None,
            seed: request.seed,
            ..registration::RegisterOptions::default()
        };
        let mut events = self
            .clients
            .registration
            .register(options, source.packed, target)
            .await?;
        while let Some(event) = events.next().await? {
            let event = match event {
                replicas::Event::Message(event) => event,
                replicas::Event::BegunAnew(anew) => {
                    let answer = proto::RegisterCaseResponse {
                        event: None,
                        begun_anew: Some(begun_anew_message(anew)),
                    };
                    if answers.send(Ok(answer)).await.is_err() {
                        return Ok(());
                    }
                    continue;
                }
            };
            if let Some(Event::Result(result)) = &event.event {
                let residuals = result.residuals_mm.clone();
                let registration = wire::registration(result.clone())?;
                self.cases
                    .keep_registration(&case.id, case.revision, registration, residuals)
                    .await?;
            }
            let answer = proto::RegisterCaseResponse {
                event: Some(event),
                begun_anew: None,
            };
            if answers.send(Ok(answer)).await.is_err() {
                return Ok(());
            }
        }
        Ok(())
    }
}

/// Runs `work` in a task of its own, which is dropped, and its computation with it, when the client goes.
pub(super) fn streamed<T, W, F>(work: W) -> Answers<T>
where
    T: Send + 'static,
    W: FnOnce(mpsc::Sender<Result<T, Status>>) -> F + Send + 'static,
    F: Future<Output = DomainResult<()>> + Send,
{
    let (answers, receiver) = mpsc::channel(EVENTS_BUFFERED);
    tokio::spawn(async move {
        let gone = answers.clone();
        tokio::select! {
            () = gone.closed() => {}
            outcome = work(answers) => if let Err(error) = outcome {
                // The client may be gone by now; then nobody is left to tell.
                gone.send(Err(refuse(error))).await.ok();
            }
        }
    });
    Box::pin(ReceiverStream::new(receiver))
}

/// What was read from the journal has been decoded before, when the case was loaded.
fn decoded<M: prost::Message + Default>(encoded: &[u8]) -> M {
    M::decode(encoded).unwrap_or_default()
}

fn begun_anew_message(anew: replicas::BegunAnew) -> proto::BegunAnew {
    proto::BegunAnew {
        times: anew.times,
        lost_replica: anew.lost,
        detail: anew.detail,
    }
}

fn approval_messages(approval: &Approval) -> Vec<proto::PlanApproval> {
    let signatories = std::iter::once(&approval.surgeon).chain(&approval.second);
    signatories
        .map(|signatory| proto::PlanApproval {
            name: signatory.name.clone(),
            role: signatory.role.clone(),
            at_ms: signatory.at_ms,
        })
        .collect()
}

/// Who calls, for the record.
fn who<T>(request: &Request<T>) -> Who {
    let peer = request.remote_addr();
    Who {
        peer: peer.map_or_else(String::new, |peer| peer.to_string()),
        ..Who::from(&Caller::of(request.extensions()))
    }
}

fn acceptance_message(case: &Case) -> Option<proto::Acceptance> {
    let (acceptance, registration) = (case.acceptance.as_ref()?, case.registration.as_ref()?);
    let verdict = match registration.verdict {
        Verdict::Accept => registration::Verdict::Accept,
        Verdict::Review => registration::Verdict::Review,
        Verdict::Reject => registration::Verdict::Reject,
    };
    Some(proto::Acceptance {
        accepted_by: acceptance.by.clone(),
        role: acceptance.role.to_string(),
        accepted_at_ms: acceptance.at_ms,
        verdict: verdict.into(),
        reasons: registration.reasons.clone(),
    })
}

fn stage_message(stage: Stage) -> proto::CaseState {
    match stage {
        Stage::Created => proto::CaseState::Created,
        Stage::Ready => proto::CaseState::Ready,
        Stage::Registered => proto::CaseState::Registered,
        Stage::Accepted => proto::CaseState::Accepted,
        Stage::Planned => proto::CaseState::Planned,
        Stage::Approved => proto::CaseState::Approved,
    }
}
