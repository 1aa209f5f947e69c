//! `MotionService` of a recording.

use arthro_proto::motion::v1 as proto;
use arthro_proto::motion::v1::motion_service_server::MotionService;
use tonic::{Request, Response, Status};

use super::{Answers, not_recorded, refused, states};
use crate::replay::player::Player;

pub(super) struct MotionApi(pub Player);

#[tonic::async_trait]
impl MotionService for MotionApi {
    async fn get_cell(
        &self,
        _: Request<proto::GetCellRequest>,
    ) -> Result<Response<proto::GetCellResponse>, Status> {
        let cell = self.0.shown().cell;
        cell.map(Response::new)
            .ok_or_else(|| not_recorded("the cell"))
    }

    type WatchStateStream = Answers<proto::WatchStateResponse>;
    async fn watch_state(
        &self,
        request: Request<proto::WatchStateRequest>,
    ) -> Result<Response<Self::WatchStateStream>, Status> {
        states(self.0.arms.clone(), request.into_inner().period_s, 0.008)
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

    async fn set_portal(
        &self,
        _: Request<proto::SetPortalRequest>,
    ) -> Result<Response<proto::SetPortalResponse>, Status> {
        refused()
    }

    async fn check_motion(
        &self,
        _: Request<proto::CheckMotionRequest>,
    ) -> Result<Response<proto::CheckMotionResponse>, Status> {
        refused()
    }

    type MoveStream = Answers<proto::MoveResponse>;
    async fn r#move(
        &self,
        _: Request<proto::MoveRequest>,
    ) -> Result<Response<Self::MoveStream>, Status> {
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
}
