//! The instrument service's stand-in: a jaw that closes wherever the forceps is.

use std::pin::Pin;
use std::sync::Arc;

use arthro_bootstrap::status;
use arthro_geometry::{Rotation, Vector3};
use arthro_proto::common::v1::{self as common, OperationState};
use arthro_proto::instrument::v1::instrument_service_server::InstrumentService;
use arthro_proto::instrument::v1::*;
use tokio::sync::mpsc;
use tokio_stream::Stream;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status};

use super::{World, operation};

pub struct FakeInstrument(pub Arc<World>);

type Answers<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

fn angle(angle_deg: f64) -> Option<AxisPosition> {
    Some(AxisPosition {
        value: Some(axis_position::Value::AngleDeg(angle_deg)),
    })
}

impl FakeInstrument {
    fn token(&self) -> Option<u64> {
        self.0.tokens.lock().unwrap().instrument
    }
}

impl World {
    /// The jaw closes: remembers where, and how it was turned.
    fn close_jaw(&self) {
        let [forceps, arthroscope] = *self.arms.lock().unwrap();
        self.watched_from.lock().unwrap().push(arthroscope.tip);
        let turn = self.rotation_deg.lock().unwrap().to_radians();
        let opening =
            forceps.rotation * Rotation::from_axis_angle(&Vector3::x_axis(), turn) * Vector3::z();
        self.bitten_at.lock().unwrap().push(forceps.tip);
        self.bitten_along.lock().unwrap().push(opening);
    }
}

#[tonic::async_trait]
impl InstrumentService for FakeInstrument {
    async fn list_axes(
        &self,
        _: Request<ListAxesRequest>,
    ) -> Result<Response<ListAxesResponse>, Status> {
        Ok(Response::new(ListAxesResponse {
            axes: vec![AxisDescription {
                axis: Axis::ForcepsRotation.into(),
                lowest: angle(-180.0),
                highest: angle(180.0),
                ..AxisDescription::default()
            }],
            lease: None,
        }))
    }

    type WatchStateStream = Answers<WatchStateResponse>;
    async fn watch_state(
        &self,
        _: Request<WatchStateRequest>,
    ) -> Result<Response<Self::WatchStateStream>, Status> {
        let state = WatchStateResponse {
            axes: vec![AxisState {
                axis: Axis::ForcepsRotation.into(),
                position: angle(*self.0.rotation_deg.lock().unwrap()),
                homed: *self.0.homed.lock().unwrap(),
                fault_reason: if *self.0.drives_faulty.lock().unwrap() {
                    "HEARTBEAT_LOST"
                } else {
                    ""
                }
                .to_owned(),
                ..AxisState::default()
            }],
            jaw: (*self.0.jaw.lock().unwrap()).into(),
            bus: None,
        };
        Ok(Response::new(Box::pin(tokio_stream::once(Ok(state)))))
    }

    async fn acquire_lease(
        &self,
        _: Request<AcquireLeaseRequest>,
    ) -> Result<Response<AcquireLeaseResponse>, Status> {
        let mut tokens = self.0.tokens.lock().unwrap();
        tokens.last += 1;
        tokens.instrument = Some(tokens.last);
        Ok(Response::new(AcquireLeaseResponse {
            lease: Some(common::Lease {
                fencing_token: tokens.last,
                ..common::Lease::default()
            }),
        }))
    }

    async fn renew_lease(
        &self,
        _: Request<RenewLeaseRequest>,
    ) -> Result<Response<RenewLeaseResponse>, Status> {
        self.0.renewals.send_modify(|renewals| *renewals += 1);
        Ok(Response::new(RenewLeaseResponse { lease: None }))
    }

    async fn release_lease(
        &self,
        _: Request<ReleaseLeaseRequest>,
    ) -> Result<Response<ReleaseLeaseResponse>, Status> {
        self.0.tokens.lock().unwrap().instrument = None;
        Ok(Response::new(ReleaseLeaseResponse {}))
    }

    type HomeStream = Answers<HomeResponse>;
    async fn home(
        &self,
        request: Request<HomeRequest>,
    ) -> Result<Response<Self::HomeStream>, Status> {
        let authorization = request.into_inner().authorization;
        let id = self
            .0
            .note("HOME".to_owned(), authorization, self.token())
            .await?;
        *self.0.homed.lock().unwrap() = true;
        Ok(Response::new(Box::pin(tokio_stream::once(Ok(
            HomeResponse {
                operation: operation(&id, OperationState::Done),
                axes: Vec::new(),
            },
        )))))
    }

    type MoveAxisStream = Answers<MoveAxisResponse>;
    async fn move_axis(
        &self,
        request: Request<MoveAxisRequest>,
    ) -> Result<Response<Self::MoveAxisStream>, Status> {
        let request = request.into_inner();
        let id = self
            .0
            .note("TURN".to_owned(), request.authorization, self.token())
            .await?;
        let Some(axis_position::Value::AngleDeg(angle_deg)) = request.target.unwrap().value else {
            panic!("the forceps turns by an angle");
        };
        *self.0.rotation_deg.lock().unwrap() = angle_deg;
        Ok(Response::new(Box::pin(tokio_stream::once(Ok(
            MoveAxisResponse {
                operation: operation(&id, OperationState::Done),
                state: None,
            },
        )))))
    }

    type BiteStream = Answers<BiteResponse>;
    async fn bite(
        &self,
        request: Request<BiteRequest>,
    ) -> Result<Response<Self::BiteStream>, Status> {
        let authorization = request.into_inner().authorization;
        let id = self
            .0
            .note("BITE".to_owned(), authorization, self.token())
            .await?;
        let (answers, receiver) = mpsc::channel(8);
        let world = self.0.clone();
        tokio::spawn(async move {
            let message = |state: OperationState, jaw: JawState| BiteResponse {
                operation: operation(&id, state),
                state: None,
                jaw: jaw.into(),
                peak_current_ma: 420.0,
                ..BiteResponse::default()
            };
            let running = message(OperationState::Running, JawState::Moving);
            answers.send(Ok(running)).await.ok();
            *world.jaw.lock().unwrap() = JawState::Moving;
            let last = if world.wait_while_held("BITE").await {
                message(OperationState::Stopped, JawState::Unknown)
            } else {
                world.close_jaw();
                *world.jaw.lock().unwrap() = JawState::ClosedOnTissue;
                message(OperationState::Done, JawState::ClosedOnTissue)
            };
            answers.send(Ok(last)).await.ok();
        });
        Ok(Response::new(Box::pin(ReceiverStream::new(receiver))))
    }

    type OpenJawStream = Answers<OpenJawResponse>;
    async fn open_jaw(
        &self,
        request: Request<OpenJawRequest>,
    ) -> Result<Response<Self::OpenJawStream>, Status> {
        let authorization = request.into_inner().authorization;
        let id = self
            .0
            .note("OPEN_JAW".to_owned(), authorization, self.token())
            .await?;
        if !*self.0.homed.lock().unwrap() {
            return Err(status::refused(
                "NOT_HOMED",
                "the feed has no reference",
                &[],
            ));
        }
        *self.0.jaw.lock().unwrap() = JawState::Open;
        Ok(Response::new(Box::pin(tokio_stream::once(Ok(
            OpenJawResponse {
                operation: operation(&id, OperationState::Done),
                state: None,
                jaw: JawState::Open.into(),
            },
        )))))
    }

    /// As in the real service, whatever the jaw held is in doubt then.
    async fn stop(&self, _: Request<StopRequest>) -> Result<Response<StopResponse>, Status> {
        *self.0.jaw.lock().unwrap() = JawState::Unknown;
        self.0.stops.send_modify(|stops| *stops += 1);
        Ok(Response::new(StopResponse {}))
    }

    async fn recover_fault(
        &self,
        request: Request<RecoverFaultRequest>,
    ) -> Result<Response<RecoverFaultResponse>, Status> {
        let authorization = request.into_inner().authorization;
        self.0
            .note(
                "RECOVER_FAULT DRIVES".to_owned(),
                authorization,
                self.token(),
            )
            .await?;
        *self.0.drives_faulty.lock().unwrap() = false;
        Ok(Response::new(RecoverFaultResponse {}))
    }

    type CommissionSwitchesStream = Answers<CommissionSwitchesResponse>;
    async fn commission_switches(
        &self,
        _: Request<CommissionSwitchesRequest>,
    ) -> Result<Response<Self::CommissionSwitchesStream>, Status> {
        Err(status::refused(
            "UNEXPECTED",
            "the gateway commissions no switches",
            &[],
        ))
    }

    async fn read_object(
        &self,
        _: Request<ReadObjectRequest>,
    ) -> Result<Response<ReadObjectResponse>, Status> {
        Err(status::refused(
            "UNEXPECTED",
            "the gateway reads no objects",
            &[],
        ))
    }

    async fn write_object(
        &self,
        _: Request<WriteObjectRequest>,
    ) -> Result<Response<WriteObjectResponse>, Status> {
        Err(status::refused(
            "UNEXPECTED",
            "the gateway writes no objects",
            &[],
        ))
    }
}
