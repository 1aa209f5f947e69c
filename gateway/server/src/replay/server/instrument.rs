//! `InstrumentService` of a recording.

use arthro_proto::instrument::v1 as proto;
use arthro_proto::instrument::v1::instrument_service_server::InstrumentService;
use tonic::{Request, Response, Status};

use super::{Answers, not_recorded, refused, states};
use crate::replay::player::Player;

pub(super) struct InstrumentApi(pub Player);

#[tonic::async_trait]
impl InstrumentService for InstrumentApi {
    async fn list_axes(
        &self,
        _: Request<proto::ListAxesRequest>,
    ) -> Result<Response<proto::ListAxesResponse>, Status> {
        let axes = self.0.shown().axes;
        axes.map(Response::new)
            .ok_or_else(|| not_recorded("the axes"))
    }

    type WatchStateStream = Answers<proto::WatchStateResponse>;
    async fn watch_state(
        &self,
        request: Request<proto::WatchStateRequest>,
    ) -> Result<Response<Self::WatchStateStream>, Status> {
        states(self.0.axes.clone(), request.into_inner().period_s, 0.01)
    }

    async fn acquire_lease(
        &self,
        _: Request<proto::AcquireLeaseRequest>,
    ) -> Result<Response<proto::AcquireLeaseResponse>, Status> {
        refused()
    }

    async fn renew_lease(
        &self,
        _: Request<proto::RenewLeaseRequest>,
    ) -> Result<Response<proto::RenewLeaseResponse>, Status> {
        refused()
    }

    async fn release_lease(
        &self,
        _: Request<proto::ReleaseLeaseRequest>,
    ) -> Result<Response<proto::ReleaseLeaseResponse>, Status> {
        refused()
    }

    type HomeStream = Answers<proto::HomeResponse>;
    async fn home(
        &self,
        _: Request<proto::HomeRequest>,
    ) -> Result<Response<Self::HomeStream>, Status> {
        refused()
    }

    type MoveAxisStream = Answers<proto::MoveAxisResponse>;
    async fn move_axis(
        &self,
        _: Request<proto::MoveAxisRequest>,
    ) -> Result<Response<Self::MoveAxisStream>, Status> {
        refused()
    }

    type BiteStream = Answers<proto::BiteResponse>;
    async fn bite(
        &self,
        _: Request<proto::BiteRequest>,
    ) -> Result<Response<Self::BiteStream>, Status> {
        refused()
    }

    type OpenJawStream = Answers<proto::OpenJawResponse>;
    async fn open_jaw(
        &self,
        _: Request<proto::OpenJawRequest>,
    ) -> Result<Response<Self::OpenJawStream>, Status> {
        refused()
    }

    async fn stop(
        &self,
        _: Request<proto::StopRequest>,
    ) -> Result<Response<proto::StopResponse>, Status> {
        refused()
    }

    async fn recover_fault(
        &self,
        _: Request<proto::RecoverFaultRequest>,
    ) -> Result<Response<proto::RecoverFaultResponse>, Status> {
        refused()
    }

    type CommissionSwitchesStream = Answers<proto::CommissionSwitchesResponse>;
    async fn commission_switches(
        &self,
        _: Request<proto::CommissionSwitchesRequest>,
    ) -> Result<Response<Self::CommissionSwitchesStream>, Status> {
        refused()
    }

    async fn read_object(
        &self,
        _: Request<proto::ReadObjectRequest>,
    ) -> Result<Response<proto::ReadObjectResponse>, Status> {
        refused()
    }

    async fn write_object(
        &self,
        _: Request<proto::WriteObjectRequest>,
    ) -> Result<Response<proto::WriteObjectResponse>, Status> {
        refused()
    }
}
