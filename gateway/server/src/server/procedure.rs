//! `ProcedureService`.

mod recovery;
pub(super) mod watch;

use arthro_bootstrap::Caller;
use arthro_proto::gateway::v1::procedure_service_server::ProcedureService;
use arthro_proto::gateway::v1::{self as proto};
use prost::Message as _;
use tokio_stream::StreamExt as _;
use tonic::{Request, Response, Status};

use self::watch::Watch;
use super::{Answers, Violations, id, paging, person, refuse};
use crate::approval::Digest;
use crate::error::{Error, Violation};
use crate::procedure::control::Procedures;
use crate::procedure::recovery::{Action, Decision};
use crate::procedure::steps::{BiteOutcome, Effect, Kind, Step, StepState};
use crate::procedure::{Procedure, State};
use crate::wire;

/// Serves the procedures.
pub(super) struct ProcedureApi(Procedures, Watch);

impl ProcedureApi {
    fn new(procedures: Procedures, watch: Watch) -> Self {
        Self(procedures, watch)
    }
}

#[tonic::async_trait]
impl ProcedureService for ProcedureApi {
    async fn start_procedure(
        &self,
        request: Request<proto::StartProcedureRequest>,
    ) -> Result<Response<proto::StartProcedureResponse>, Status> {
        let caller = Caller::of(request.extensions());
        let request = request.into_inner();
        let mut violations = Violations::default();
        let case_id = violations.check(id("case_id", request.case_id));
        let digest = violations.check(digest("plan_digest", &request.plan_digest));
        let operator = violations.check(person(&caller, "operator", request.operator));
        violations.finish().map_err(refuse)?;
        let (Some(case_id), Some(digest), Some(operator)) = (case_id, digest, operator) else {
            return Err(refuse(Error::Invalid(Vec::new())));
        };
        let procedure = self.0.start(case_id, digest, operator).await;
        Ok(Response::new(proto::StartProcedureResponse {
            procedure: Some(procedure_message(&procedure.map_err(refuse)?)),
        }))
    }

    async fn pause_procedure(
        &self,
        request: Request<proto::PauseProcedureRequest>,
    ) -> Result<Response<proto::PauseProcedureResponse>, Status> {
        let procedure_id = procedure_id(request.into_inner().procedure_id)?;
        let procedure = self.0.pause(&procedure_id).await.map_err(refuse)?;
        Ok(Response::new(proto::PauseProcedureResponse {
            procedure: Some(procedure_message(&procedure)),
        }))
    }

    async fn resume_procedure(
        &self,
        request: Request<proto::ResumeProcedureRequest>,
    ) -> Result<Response<proto::ResumeProcedureResponse>, Status> {
        let request = request.into_inner();
        let procedure_id = procedure_id(request.procedure_id)?;
        if !request.acknowledge {
            return Err(refuse(Error::AcknowledgementNeeded));
        }
        let procedure = self.0.resume(&procedure_id).await.map_err(refuse)?;
        Ok(Response::new(proto::ResumeProcedureResponse {
            procedure: Some(procedure_message(&procedure)),
        }))
    }

    async fn abort_procedure(
        &self,
        request: Request<proto::AbortProcedureRequest>,
    ) -> Result<Response<proto::AbortProcedureResponse>, Status> {
        let procedure_id = procedure_id(request.into_inner().procedure_id)?;
        let procedure = self.0.abort(&procedure_id).await.map_err(refuse)?;
        Ok(Response::new(proto::AbortProcedureResponse {
            procedure: Some(procedure_message(&procedure)),
        }))
    }

    /// Takes any reason, even none: nothing may keep a stop from being a stop.
    async fn stop_procedure(
        &self,
        request: Request<proto::StopProcedureRequest>,
    ) -> Result<Response<proto::StopProcedureResponse>, Status> {
        let request = request.into_inner();
        let reason: String = request
            .reason
            .chars()
            .filter(|character| !character.is_control())
            .take(200)
            .collect();
        if request.wait_for_devices {
            self.0.stop_confirmed(reason).await.map_err(refuse)?;
        } else {
            self.0.stop(reason);
        }
        Ok(Response::new(proto::StopProcedureResponse {}))
    }

    async fn recover_procedure(
        &self,
        request: Request<proto::RecoverProcedureRequest>,
    ) -> Result<Response<proto::RecoverProcedureResponse>, Status> {
        let caller = Caller::of(request.extensions());
        let request = request.into_inner();
        let mut violations = Violations::default();
        let action = violations.check(action(request.action()));
        let procedure_id = violations.check(id("procedure_id", request.procedure_id));
        let operator = violations.check(person(&caller, "operator", request.operator));
        violations.finish().map_err(refuse)?;
        let (Some(procedure_id), Some(action), Some(operator)) = (procedure_id, action, operator)
        else {
            return Err(refuse(Error::Invalid(Vec::new())));
        };
        let decision = Decision {
            action,
            operator,
            acknowledged: request.acknowledge,
            recover_faults: request.recover_faults,
        };
        let procedure = self.0.recover(procedure_id, decision).await;
        Ok(Response::new(proto::RecoverProcedureResponse {
            procedure: Some(procedure_message(&procedure.map_err(refuse)?)),
        }))
    }

    async fn get_recovery(
        &self,
        request: Request<proto::GetRecoveryRequest>,
    ) -> Result<Response<proto::GetRecoveryResponse>, Status> {
        let procedure_id = procedure_id(request.into_inner().procedure_id)?;
        let situation = self.0.situation(&procedure_id).await.map_err(refuse)?;
        Ok(Response::new(recovery::situation_message(&situation)))
    }

    type WatchProcedureStream = Answers<proto::WatchProcedureResponse>;

    /// For whoever serves these methods without [`watch::Watched`] before them.
    async fn watch_procedure(
        &self,
        request: Request<proto::WatchProcedureRequest>,
    ) -> Result<Response<Self::WatchProcedureStream>, Status> {
        let answers = self.1.states(request.into_inner()).await?.map(|state| {
            proto::WatchProcedureResponse::decode(state?)
                .map_err(|error| Status::internal(error.to_string()))
        });
        Ok(Response::new(Box::pin(answers)))
    }

    async fn get_procedure(
        &self,
        request: Request<proto::GetProcedureRequest>,
    ) -> Result<Response<proto::GetProcedureResponse>, Status> {
        let procedure_id = procedure_id(request.into_inner().procedure_id)?;
        let procedure = self.0.get(&procedure_id).await.map_err(refuse)?;
        Ok(Response::new(proto::GetProcedureResponse {
            procedure: Some(procedure_message(&procedure)),
        }))
    }

    async fn list_procedures(
        &self,
        request: Request<proto::ListProceduresRequest>,
    ) -> Result<Response<proto::ListProceduresResponse>, Status> {
        let request = request.into_inner();
        let size = paging::size(request.page_size).map_err(refuse)?;
        let page = paging::page(size, request.page_token);
        let mut procedures = self.0.list(&page).await.map_err(refuse)?;
        let next_page_token = paging::cut(&mut procedures, size, |procedure| &procedure.id);
        Ok(Response::new(proto::ListProceduresResponse {
            procedures: procedures.iter().map(procedure_message).collect(),
            next_page_token,
        }))
    }

    async fn get_report(
        &self,
        request: Request<proto::GetReportRequest>,
    ) -> Result<Response<proto::GetReportResponse>, Status> {
        let procedure_id = procedure_id(request.into_inner().procedure_id)?;
        let report = self.0.report(&procedure_id).await.map_err(refuse)?;
        Ok(Response::new(proto::GetReportResponse {
            procedure: Some(procedure_message(&report.procedure)),
            steps: report.steps.iter().map(step_message).collect(),
            bites: report.bites.iter().map(outcome_message).collect(),
        }))
    }
}

// === reading ===

fn procedure_id(value: String) -> Result<String, Status> {
    id("procedure_id", value).map_err(refuse)
}

/// The 64 hexadecimal digits of a digest.
pub(super) fn digest(field: &str, text: &str) -> Result<Digest, Violation> {
    Digest::parse(text).ok_or_else(|| {
        Violation::new(
            field,
            format!(
                "has {} characters; must be a SHA-256 of 64 hexadecimal digits",
                text.chars().count()
            ),
        )
    })
}

fn action(action: proto::RecoveryAction) -> Result<Action, Violation> {
    match action {
        proto::RecoveryAction::Withdraw => Ok(Action::Withdraw),
        proto::RecoveryAction::RepeatBite => Ok(Action::RepeatBite),
        proto::RecoveryAction::MarkDone => Ok(Action::MarkDone),
        proto::RecoveryAction::Unspecified => Err(Violation::new(
            "action",
            "is unspecified; must be WITHDRAW, REPEAT_BITE or MARK_DONE",
        )),
    }
}

// === writing ===

pub(crate) fn procedure_message(procedure: &Procedure) -> proto::Procedure {
    proto::Procedure {
        procedure_id: procedure.id.clone(),
        case_id: procedure.case_id.clone(),
        state: state_message(procedure.state).into(),
        plan_digest: procedure.plan_digest.to_string(),
        bites_planned: procedure.bites_planned,
        bites_done: procedure.bites_done,
        step: procedure.step.as_ref().map(step_message),
        reason: procedure.reason.clone(),
        detail: procedure.detail.clone(),
        started_at_ms: procedure.started_at_ms,
        ended_at_ms: procedure.ended_at_ms.unwrap_or_default(),
        robot_seconds: procedure.robot_seconds,
        rcm_deviation_max_mm: procedure.rcm_deviation_max_mm,
    }
}

pub(crate) fn step_message(step: &Step) -> proto::Step {
    proto::Step {
        sequence: step.sequence,
        kind: kind_message(step.planned.kind).into(),
        effect: effect_message(step.planned.kind.effect()).into(),
        state: step_state_message(step.state).into(),
        bite: step
            .planned
            .bite
            .and_then(|bite| i32::try_from(bite).ok())
            .unwrap_or(-1),
        operation_id: step.operation_id.clone(),
        intended_at_ms: step.intended_at_ms,
        ended_at_ms: step.ended_at_ms.unwrap_or_default(),
        started_controller_s: step.started_controller_s,
        ended_controller_s: step.ended_controller_s.unwrap_or_default(),
        detail: step.detail.clone(),
    }
}

pub(crate) fn outcome_message(outcome: &BiteOutcome) -> proto::BiteOutcome {
    proto::BiteOutcome {
        bite: outcome.bite,
        tip: Some(wire::point_message(&outcome.tip)),
        jaw: outcome.jaw.clone(),
        peak_current_ma: outcome.peak_current_ma,
    }
}

fn state_message(state: State) -> proto::ProcedureState {
    match state {
        State::Running => proto::ProcedureState::Running,
        State::Paused => proto::ProcedureState::Paused,
        State::Aborting => proto::ProcedureState::Aborting,
        State::Completed => proto::ProcedureState::Completed,
        State::Aborted => proto::ProcedureState::Aborted,
        State::Interrupted => proto::ProcedureState::Interrupted,
    }
}

fn kind_message(kind: Kind) -> proto::StepKind {
    match kind {
        Kind::Prepare => proto::StepKind::Prepare,
        Kind::View => proto::StepKind::View,
        Kind::Approach => proto::StepKind::Approach,
        Kind::Pivot => proto::StepKind::Pivot,
        Kind::Insert => proto::StepKind::Insert,
        Kind::Bite => proto::StepKind::Bite,
        Kind::Retract => proto::StepKind::Retract,
        Kind::PivotBack => proto::StepKind::PivotBack,
        Kind::ToTray => proto::StepKind::ToTray,
        Kind::Release => proto::StepKind::Release,
        Kind::Withdraw => proto::StepKind::Withdraw,
    }
}

fn effect_message(effect: Effect) -> proto::StepEffect {
    match effect {
        Effect::Pure => proto::StepEffect::Pure,
        Effect::Reversible => proto::StepEffect::Reversible,
        Effect::Irreversible => proto::StepEffect::Irreversible,
    }
}

fn step_state_message(state: StepState) -> proto::StepState {
    match state {
        StepState::Intended => proto::StepState::Intended,
        StepState::Done => proto::StepState::Done,
        StepState::Failed => proto::StepState::Failed,
        StepState::InDoubt => proto::StepState::InDoubt,
        StepState::Resolved => proto::StepState::Resolved,
    }
}
