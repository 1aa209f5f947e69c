//! `ProcedureService` of a recording.

use arthro_bootstrap::status;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::procedure_service_server::ProcedureService;
use tokio_stream::StreamExt as _;
use tokio_stream::wrappers::WatchStream;
use tonic::{Request, Response, Status};

use super::{Answers, refused};
use crate::replay::player::Player;

pub(super) struct ProcedureApi(pub Player);

impl ProcedureApi {
    fn get(&self, procedure_id: &str) -> Result<proto::Procedure, Status> {
        let shown = self.0.procedure.borrow().clone();
        shown
            .filter(|procedure| procedure.procedure_id == procedure_id)
            .ok_or_else(|| {
                status::not_found(
                    "UNKNOWN_PROCEDURE",
                    format!("the recording does not show the procedure {procedure_id:?} now"),
                    &[("procedure_id", procedure_id.to_owned())],
                )
            })
    }
}

#[tonic::async_trait]
impl ProcedureService for ProcedureApi {
    async fn start_procedure(
        &self,
        _: Request<proto::StartProcedureRequest>,
    ) -> Result<Response<proto::StartProcedureResponse>, Status> {
        refused()
    }

    async fn pause_procedure(
        &self,
        _: Request<proto::PauseProcedureRequest>,
    ) -> Result<Response<proto::PauseProcedureResponse>, Status> {
        refused()
    }

    async fn resume_procedure(
        &self,
        _: Request<proto::ResumeProcedureRequest>,
    ) -> Result<Response<proto::ResumeProcedureResponse>, Status> {
        refused()
    }

    async fn abort_procedure(
        &self,
        _: Request<proto::AbortProcedureRequest>,
    ) -> Result<Response<proto::AbortProcedureResponse>, Status> {
        refused()
    }

    async fn stop_procedure(
        &self,
        _: Request<proto::StopProcedureRequest>,
    ) -> Result<Response<proto::StopProcedureResponse>, Status> {
        refused()
    }

    async fn recover_procedure(
        &self,
        _: Request<proto::RecoverProcedureRequest>,
    ) -> Result<Response<proto::RecoverProcedureResponse>, Status> {
        refused()
    }

    async fn get_recovery(
        &self,
        _: Request<proto::GetRecoveryRequest>,
    ) -> Result<Response<proto::GetRecoveryResponse>, Status> {
        refused()
    }

    type WatchProcedureStream = Answers<proto::WatchProcedureResponse>;
    async fn watch_procedure(
        &self,
        request: Request<proto::WatchProcedureRequest>,
    ) -> Result<Response<Self::WatchProcedureStream>, Status> {
        let id = request.into_inner().procedure_id;
        self.get(&id)?;
        // Other files may follow that hold other procedures.
        let states = WatchStream::new(self.0.procedure.clone())
            .filter_map(move |procedure| procedure.filter(|shown| shown.procedure_id == id))
            .map(|procedure| {
                Ok(proto::WatchProcedureResponse {
                    procedure: Some(procedure),
                })
            });
        Ok(Response::new(Box::pin(states)))
    }

    async fn get_procedure(
        &self,
        request: Request<proto::GetProcedureRequest>,
    ) -> Result<Response<proto::GetProcedureResponse>, Status> {
        Ok(Response::new(proto::GetProcedureResponse {
            procedure: Some(self.get(&request.into_inner().procedure_id)?),
        }))
    }

    async fn list_procedures(
        &self,
        _: Request<proto::ListProceduresRequest>,
    ) -> Result<Response<proto::ListProceduresResponse>, Status> {
        Ok(Response::new(proto::ListProceduresResponse {
            procedures: self.0.procedure.borrow().iter().cloned().collect(),
            // A recording holds one.
            next_page_token: String::new(),
        }))
    }

    async fn get_report(
        &self,
        request: Request<proto::GetReportRequest>,
    ) -> Result<Response<proto::GetReportResponse>, Status> {
        let procedure = self.get(&request.into_inner().procedure_id)?;
        let shown = self.0.shown();
        Ok(Response::new(proto::GetReportResponse {
            procedure: Some(procedure),
            steps: shown.steps.into_values().collect(),
            bites: shown.bites,
        }))
    }
}
